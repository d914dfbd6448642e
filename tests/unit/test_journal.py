"""The page that says what is being done while a long command works."""

import logging

import pytest

from fingerfit.core.files import write_text
from fingerfit.core.journal import LINES, PAGE, SHOWN, Journal
from fingerfit.core.progress import Progress, begin, tell


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "results/mine"


def page(folder):
    return (folder / PAGE).read_text(encoding="utf-8")


def test_it_says_what_is_tried_and_what_was_found(folder, capsys):
    with Progress(ticks=False).working("diagnose base", Journal(folder)):
        assert "diagnose base (since " in page(folder)
        begin("refit: tilt (tilt of the indenter)")
        assert '<p class="now">Now: diagnose base: refit: tilt (tilt of the indenter) (since ' in page(folder)
        tell("refit: tilt explains 95 %")
        tell("refit: friction explains 3 %")
        found = page(folder)
        assert found.index("friction explains 3 %") < found.index("tilt explains 95 %")
        # another process goes on where one has ended
        Journal(folder).add("base+tilt: adequate")
        assert page(folder).index("base+tilt: adequate") < page(folder).index("friction explains")
    # what has begun is no line of the terminal
    said = capsys.readouterr().out
    assert "explains 95 %" in said and "tilt of the indenter" not in said
    begin("nobody listens")
    assert "nobody listens" not in page(folder)
    assert not logging.getLogger("fingerfit.progress").handlers


def test_it_is_read_again_and_leads_to_the_report(folder):
    journal = Journal(folder)
    journal.now("base: search, round 3")
    assert '<meta http-equiv="refresh"' in page(folder) and "report.html" not in page(folder)
    write_text(folder / "report.html", "")
    journal.add("<b>a & b</b>")
    assert '<a href="report.html">' in page(folder)
    assert "&lt;b&gt;a &amp; b&lt;/b&gt;" in page(folder) and "<b>" not in page(folder)


def test_it_has_the_last_lines_and_the_log_has_all(folder):
    journal = Journal(folder)
    for n in range(SHOWN + 5):
        journal.add(f"line {n}.")
    assert len((folder / LINES).read_text(encoding="utf-8").splitlines()) == SHOWN + 5
    assert "line 5." in page(folder) and "line 4." not in page(folder)


def test_a_page_that_cannot_be_written_stops_nothing(tmp_path):
    write_text(tmp_path / "results", "a file in its place")
    journal = Journal(tmp_path / "results/mine")
    journal.now("work")
    journal.add("done")
    assert (tmp_path / "results").read_text(encoding="utf-8") == "a file in its place"
