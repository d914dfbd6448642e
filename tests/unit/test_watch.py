"""What the workflow says while it runs."""

import logging
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from fingerfit.core.progress import Progress, tell
from fingerfit.fit.rounds import Asked, Round
from fingerfit.fit.took import Took
from fingerfit.provenance.watch import Watch, heard_by


class Said(Progress):
    def __init__(self):
        super().__init__()
        self.lines = []

    def line(self, text):
        self.lines.append(text)


def record(event, level=logging.INFO, text="x", **extra):
    return logging.makeLogRecord({"msg": text, "levelno": level, "event": SimpleNamespace(value=event), **extra})


def one_round(folder, number, reached, **others):
    asked = [Asked({"mu": 1.0}, name, "m", "") for name in ("known", "new")]
    path = folder / f"results/s/base/rounds/{number}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    tolerances = {"tolx": [reached, 0.02], "tolf": [1e-4, 1e-3]}
    best = {"values": {"mu": 1.0}, "score": -1.25}
    Round(number, "independent", None, {}, {}, [], asked, best, tolerances=tolerances, **others).save(path)
    return str(path)


def test_a_round_is_one_line_with_what_is_reached_and_what_is_left(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    said = Said()
    watch = Watch(said, said.stop, several=False, works=lambda: True)

    def solve(name, ago=0.0):
        path = tmp_path / f"results/s/sims/{name}/solution.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
        os.utime(path, (time.time() - ago,) * 2)

    def job(number, output, seconds, solves=()):
        watch.handle(record("job_info", jobid=number, output=[output], rule_name="a"))
        now[0] += seconds
        for name in solves:
            solve(name, -1.0)
        watch.handle(record("job_finished", job_id=number))

    solve("known", 10.0)
    job(1, one_round(tmp_path, 3, 0.32), 1.0)
    job(2, str(tmp_path / "results/s/sims/new/solution.npz"), 4.0)
    job(3, one_round(tmp_path, 4, 0.16), 1.0)
    # those of iterations that the job made itself are told with those that it asks for at the end
    job(4, one_round(tmp_path, 5, 0.08, solved=[Asked({"mu": 1.0}, "own", "m", "")]), 1.0, ("own", "new"))
    start = "independent  {}, simulations: {}, best score -1.250000, tolx {} (0.02), tolf 0.0001 (0.001)"
    assert said.lines == [
        "round   3  " + start.format("1 s", "1 known, 1 to run", 0.32),
        # a half in 5 s, three halves to go
        "round   4  " + start.format("6 s", "1 known, 1 to run (4 s each)", 0.16) + ", 15 s left in this stage",
        "round   5  " + start.format("7 s", "1 known, 2 run (4 s each)", 0.08) + ", 6 s left in this stage",
    ]


def test_the_time_of_simulations_inside_a_round_is_told(tmp_path, monkeypatch):
    """The job of a round that solves them itself says in its log how long they took."""
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    said = Said()
    watch = Watch(said, said.stop, several=False, works=lambda: True)
    log, sims = tmp_path / "0.log", tmp_path / "results/s/sims"
    took = Took()
    for seconds in (0.125, 0.25):
        took.add(seconds)

    def job(number, output, solves, text):
        watch.handle(record("job_info", jobid=number, output=[output], rule_name="a", log=[str(log)]))
        now[0] += 4.0
        for sim in ("known", "new"):
            file = sims / sim / "solution.npz"
            if sim in solves:
                file.parent.mkdir(parents=True)
                file.touch()
            if file.exists():
                os.utime(file, (time.time() + (1 if sim in solves else -10),) * 2)
        log.write_text(text, encoding="utf-8")
        watch.handle(record("job_finished", job_id=number))

    job(0, one_round(tmp_path, 0, 0.3), ["known"], f"a warning\n{took.told()}\n")
    job(1, str(sims / "other/solution.npz"), [], "")  # this one is not mixed with those
    job(2, one_round(tmp_path, 1, 0.3), ["new"], f"{took.told()}\n")
    job(3, one_round(tmp_path, 2, 0.3), [], "simulations solved in this job: many\n")
    log.unlink()
    watch.handle(record("job_info", jobid=4, output=[one_round(tmp_path, 3, 0.3)], rule_name="a", log=[str(log)]))
    watch.handle(record("job_finished", job_id=4))
    assert [line.partition("simulations: ")[2].partition(", best")[0] for line in said.lines] == [
        "1 run (0.19 s each), 1 to run",
        "1 known, 1 run (0.19 s each)",
        "2 known (4 s each)",
        "2 known (4 s each)",
    ]


def test_no_time_is_told_where_hardly_any_of_the_way_is_made(tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    said = Said()
    watch = Watch(said, said.stop, several=False, works=lambda: True)
    for number, tolx in enumerate((0.32, 0.3199, 0.0201)):
        watch.handle(record("job_info", jobid=number, output=[one_round(tmp_path, number, tolx)], rule_name="a"))
        now[0] += 10.0
        watch.handle(record("job_finished", job_id=number))
    assert [line.partition("tolf 0.0001 (0.001)")[2] for line in said.lines] == ["", "", ", 10 s left in this stage"]


@pytest.mark.parametrize("works", [True, False])
def test_the_page_of_a_study_has_its_rounds_and_a_dry_run_writes_none(tmp_path, works):
    watch = Watch(Said(), lambda: None, several=False, works=lambda: works)
    output, page = one_round(tmp_path, 3, 0.32), tmp_path / "results/s/progress.html"
    watch.handle(record("job_info", jobid=1, output=[output], rule_name="a"))
    assert page.exists() == works
    if works:
        assert "Now: base: search, round 3 (since " in page.read_text(encoding="utf-8")
        watch.handle(record("job_finished", job_id=1))
        assert "base: round   3  independent" in page.read_text(encoding="utf-8")


def test_a_finished_run_is_shown_and_errors_have_the_screen():
    shown, stopped = [], []
    said = Said()
    said.stop = lambda: stopped.append(True)
    watch = Watch(said, lambda: shown.append(True), several=True, works=lambda: True)
    watch.handle(record("", text="Nothing to be done (all requested files are present and up to date)."))
    assert (shown, stopped) == ([True], [])
    watch.handle(record("job_error", logging.ERROR))
    assert stopped == [True]


def test_only_errors_of_others_are_shown_while_it_is_quiet():
    logger, seen, quiet = logging.Logger("a"), [], [True]
    handler = logging.Handler()
    handler.emit = lambda one: seen.append(one.getMessage())
    logger.addHandler(handler)
    watch = Watch(Said(), lambda: None, several=False, works=lambda: True)
    heard_by(logger, watch, lambda: quiet[0])
    assert logger.handlers == [watch, handler]
    logger.info("Select jobs to execute...")
    logger.error("wrong")
    quiet[0] = False
    logger.info("dry")
    assert seen == ["wrong", "dry"]


def test_what_is_told_is_said_in_plain_lines_where_there_is_no_terminal(capsys):
    with Progress(ticks=False).working("diagnose"):
        tell("tried tilt")
    assert capsys.readouterr().out == "     0 s  diagnose: tried tilt\n"
    tell("nobody listens")
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("error", [False, True])
def test_it_goes_on_without_a_word_once_nobody_reads_it(error):
    """As after `| head -1`, or where a connection was lost: a handler that raised left Snakemake waiting for ever."""
    line = f"from fingerfit.core.progress import say; [say(str(n), error={error}) for n in range(3)]; open('done', 'w')"
    with tempfile.TemporaryDirectory() as folder:
        ends = {"stderr": subprocess.PIPE} if error else {"stdout": subprocess.PIPE}
        with subprocess.Popen(
            [sys.executable, "-c", f"input(); {line}"], cwd=folder, stdin=subprocess.PIPE, **ends
        ) as it:
            (it.stderr if error else it.stdout).close()
            it.stdin.write(b"\n")
            it.stdin.close()
            assert it.wait() == 0
        assert Path(folder, "done").exists()
