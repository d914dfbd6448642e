"""The table of the battery: how many cases of each area ended how."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

OUTCOMES = ("clear line", "accepted", "healed", "neither")
PROPERTY = "faults"
"""Name of the property of a test that tells area, name of the case, outcome and what happened."""
FILE = "FINGERFIT_FAULTS"
"""Environment variable with the file that the table is written to."""


def rows_of(reporter: Any) -> list[tuple[str, str, str, str]]:
    """What the tests of the battery told, in pytest's terminal reporter."""
    reports = [one for kind in ("passed", "failed") for one in reporter.stats.get(kind, ())]
    return [tuple(value) for one in reports for name, value in one.user_properties if name == PROPERTY]


def format_table(rows: list[tuple[str, str, str, str]]) -> str:
    """Markdown table with a line for each area."""
    lines = ["| area | cases | " + " | ".join(OUTCOMES) + " |", "|---" * (2 + len(OUTCOMES)) + "|"]
    for area in [*sorted({row[0] for row in rows}), "all"]:
        count = Counter(outcome for name, _, outcome, _ in rows if area in (name, "all"))
        cells = [area, count.total(), *(count[outcome] for outcome in OUTCOMES)]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def summarize(reporter: Any) -> None:
    """Print the table, and write it where `FILE` says."""
    rows = rows_of(reporter)
    if not rows:
        return
    text = format_table(rows)
    reporter.section("bad inputs and faults")
    reporter.write_line(text)
    if file := os.environ.get(FILE):
        neither = "".join(f"- {area}: {name}: {why}\n" for area, name, outcome, why in rows if outcome == "neither")
        head = Path(__file__).with_name("head.md").read_text(encoding="utf-8")
        Path(file).write_text(f"{head}\n{text}\n" + (f"\nNeither:\n\n{neither}" if neither else ""), encoding="utf-8")
