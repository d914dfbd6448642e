"""Stands in for ABAQUS in tests: solves deck.inp with the built-in solver and writes deck.fil as ABAQUS does."""

import math
import sys
from pathlib import Path

from fingerfit.deck.reader import read_deck
from fingerfit.solvers.analysis import run_steps


def item(value):
    if isinstance(value, int):
        return f"I{len(str(value)):2d}{value}"
    if isinstance(value, float) and not math.isfinite(value):
        return f"D{value:>22}"
    if isinstance(value, float):
        mantissa, exponent = f"{value:.15E}".split("E")
        return f"D{mantissa:>18}D{int(exponent):+03d}"
    return f"A{value:<8}"


def record(key, *values):
    return "*" + item(2 + len(values)) + item(key) + "".join(item(value) for value in values)


def main():
    job = dict(part.split("=") for part in sys.argv[1:])["job"]
    path = Path(f"{job}.inp")
    deck = read_deck(path)
    text = path.read_text(encoding="utf-8").upper()
    assert text.count("*NODE FILE") == text.count("*END STEP") == len(deck.steps)
    parts = [record(1921, "6.23-1", "stand-in", "", "", 0, 0, 1.0)]
    for label, point in enumerate(deck.mesh.points.tolist(), 1):
        parts.append(record(1901, label, *point))
    code, time, status = 0, 0.0, [" STEP  INC ATT SEVERE EQUIL TOTAL  TOTAL      STEP       INC OF       DOF    IF"]
    for number, step in enumerate(run_steps(deck, path), 1):
        status.append(
            f"{number:4d}     1   1{' ' if step.arrived else 'U'}    0     3     3  1.00       1.00       1.000"
        )
        if not step.arrived:
            Path(f"{job}.msg").write_text(" ***ERROR: TOO MANY ATTEMPTS MADE FOR THIS INCREMENT\n")
            code = 1
            break
        time += deck.steps[number - 1].period
        parts.append(record(2000, time, deck.steps[number - 1].period, 0.0, 0.0, 1, number, 1, 0))
        for key, values in ((101, step.displacement), (104, step.internal)):
            parts += [record(key, label, *row) for label, row in enumerate(values.tolist(), 1)]
        parts.append(record(2001))
    Path(f"{job}.sta").write_text("\n".join(status) + "\n")
    stream = "".join(parts)
    Path(f"{job}.fil").write_text("".join(stream[n : n + 80].ljust(80) + "\n" for n in range(0, len(stream), 80)))
    sys.exit(code)


if __name__ == "__main__":
    main()
