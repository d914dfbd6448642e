"""The bar of a long command: drawn on a terminal only, below the lines, and gone at the end."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios

import pytest

SAYS = """\
import time
from fingerfit.core.progress import Progress, tell

progress = Progress(ticks={ticks})
progress.show("simulate", 1, 4)
progress.line("round   0  1 run")
progress.show("simulate", 3, 4)
time.sleep({seconds})
progress.line("round   1  3 run")
progress.stop()
with progress.working("diagnose"):
    progress.began = time.monotonic()
    tell("tried tilt")
progress.line("table: table.txt")
"""
LINES = ["round   0  1 run", "round   1  3 run", "     0 s  diagnose: tried tilt", "table: table.txt"]
WIDTH = 80
HIDE, SHOW = "\x1b[?25l", "\x1b[?25h"
"""What hides and shows the cursor."""
_PARTS = re.compile(r"\x1b\[([\d;?]*)([A-Za-z])|(\r|\n)|([^\x1b\r\n]+)")


def on_a_terminal(program):
    """All that a program writes on a terminal of 80 columns."""
    ahead, behind = pty.openpty()
    fcntl.ioctl(behind, termios.TIOCSWINSZ, struct.pack("HHHH", 24, WIDTH, 0, 0))
    known = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES", "NO_COLOR")}
    command = [sys.executable, "-c", program]
    ends = dict.fromkeys(("stdin", "stdout", "stderr"), behind)
    with subprocess.Popen(command, env={**known, "TERM": "xterm", "PYTHONUTF8": "1"}, **ends) as running:
        os.close(behind)
        written = b""
        while True:
            try:
                part = os.read(ahead, 4096)
            except OSError:  # nobody has the other end any more
                break
            if not part:
                break
            written += part
        os.close(ahead)
        assert running.wait() == 0, written
    return written.decode()


def screens(written):
    """The lines on the screen after each of the parts that were written: what a terminal makes of them."""
    lines, row, column = [""], 0, 0
    for number, letter, control, text in _PARTS.findall(written):
        if letter == "A":
            row = max(0, row - int(number or 1))
        elif letter == "K":
            assert number == "2"
            lines[row] = ""
        elif control == "\r":
            column = 0
        elif control == "\n":
            row += 1
            lines += [""] * (row + 1 - len(lines))
        elif text:
            lines[row] = lines[row].ljust(column)[:column] + text + lines[row][column + len(text) :]
            column += len(text)
            assert column <= WIDTH
        else:
            assert letter in "mhl", (number, letter)
        yield list(lines)


@pytest.mark.parametrize("ticks", [True, False])
def test_a_terminal_has_a_bar_below_the_lines_and_none_at_the_end(ticks):
    written = on_a_terminal(SAYS.format(ticks=ticks, seconds=0))
    seen = list(screens(written))
    bars = {line.strip() for lines in seen for line in lines if "━" in line}
    assert {bar.split()[0] for bar in bars} == {"simulate", "diagnose"}
    for lines in seen:
        drawn = [n for n, line in enumerate(lines) if "━" in line]
        # one bar, and nothing below it
        assert len(drawn) <= 1 and not any(lines[n + 1 :] != [""] * len(lines[n + 1 :]) for n in drawn), lines
    # it is drawn again below each line
    for n, name in enumerate(("simulate", "simulate", "diagnose"), 1):
        assert any(lines[:n] == LINES[:n] and lines[n:][:1] and lines[n].startswith(name) for lines in seen), n
    assert seen[-1] == [*LINES, ""]
    assert written.count(HIDE) == written.count(SHOW) == 2
    assert written.rindex(SHOW) > written.rindex(HIDE)


def test_it_moves_by_itself_where_it_may():
    moving, still = (on_a_terminal(SAYS.format(ticks=ticks, seconds=1)).count("simulate") for ticks in (True, False))
    assert moving > still + 2  # ten times in a second where the machine has nothing else to do


def test_a_quarter_of_the_work_is_a_quarter_of_the_bar():
    program = "from fingerfit.core.progress import Progress; p = Progress(); p.show('fit', 1, 4); p.stop()"
    *_, bar = re.findall(r"fit \x1b\[\d+m(━+)\x1b\[0m\x1b\[\d+m╺\x1b\[0m\x1b\[\d+m(━+)", on_a_terminal(program))
    done, left = map(len, bar)
    assert done == pytest.approx((done + 1 + left) / 4, abs=1)


def test_a_file_has_the_lines_alone(tmp_path):
    path = tmp_path / "out"
    with path.open("w") as out:
        subprocess.run([sys.executable, "-c", SAYS.format(ticks=True, seconds=0)], stdout=out, check=True)
    assert path.read_text(encoding="utf-8") == "".join(f"{line}\n" for line in LINES)
