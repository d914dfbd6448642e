"""What a long command does while it runs: a page beside the results of a study, which a browser reads again."""

from __future__ import annotations

import contextlib
import html
import time
from pathlib import Path
from string import Template

from fingerfit.core.errors import FingerfitError
from fingerfit.core.files import write_text

PAGE, LINES = "progress.html", "progress.log"
SHOWN = 200
"""Most lines on the page, the last ones; a choice."""
AGAIN = 5
"""Seconds after which a browser reads the page again; a choice."""
_HTML = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="refresh" content="$again">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$study: progress</title>
<style>
body { font: 16px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 64rem; padding: 0 1rem }
h1 { font-size: 1.4rem }
.now { font-size: 1.15rem; border-left: 4px solid #06c; padding-left: .8rem }
ol { list-style: none; padding: 0; overflow-wrap: anywhere }
li { font: 14px/1.6 ui-monospace, monospace; padding-left: 2em; text-indent: -2em }
small { color: #555 }
</style>
</head>
<body>
<h1>Study $study: what is being done</h1>
<p class="now">Now: $now</p>
$report
<ol>
$done
</ol>
<p><small>The newest line comes first. The browser reads this page again every $again seconds.
If nothing changes for long, see whether the command still runs.</small></p>
</body>
</html>
""")
_REPORT = '<p>Models that are finished: <a href="report.html">report.html</a></p>'


class Journal:
    """The page of a study: what is being done now, and what was done.

    A page that cannot be written, as on a full disk, stops nothing: the work itself will say so.

    Parameters
    ----------
    folder : Path
        Results of the study.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._now = folder, ""

    def add(self, line: str) -> None:
        """Something was done."""
        with contextlib.suppress(OSError, FingerfitError):
            self._folder.mkdir(parents=True, exist_ok=True)
            with (self._folder / LINES).open("a", encoding="utf-8") as lines:
                lines.write(f"{_clock()}  {line}\n")
            self._write()

    def now(self, text: str) -> None:
        """Something is being done, or nothing more."""
        self._now = f"{text} (since {_clock()})"
        with contextlib.suppress(OSError, FingerfitError):
            self._write()

    def _write(self) -> None:
        file = self._folder / LINES
        lines = file.read_text(encoding="utf-8").splitlines()[-SHOWN:] if file.exists() else []
        done = "\n".join(f"<li>{html.escape(line)}</li>" for line in reversed(lines))
        page = _HTML.substitute(
            again=AGAIN,
            study=html.escape(self._folder.name),
            now=html.escape(self._now) or "see the first line below",
            report=_REPORT if (self._folder / "report.html").exists() else "",
            done=done,
        )
        write_text(self._folder / PAGE, page)


def _clock() -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S")
