"""One line for each job that failed: what was wrong, and where its log is."""

import logging
from types import SimpleNamespace

import pytest

from fingerfit.provenance.failures import Failures

COMMAND = "exec python -P -m fingerfit simulate deck.inp 2> {log}"


def told(log, text, ending, command=COMMAND):
    """What is said of a job with such a log, whose shell ended so."""
    if text is not None:
        log.write_text(text, encoding="utf-8")
    lines = []
    handler, command = Failures(lines.append), command.format(log=log)
    dump = f"RuleException:\nCalledProcessError in file x:\nCommand 'set -euo pipefail;  {command}' {ending}."
    error = logging.makeLogRecord({"msg": dump, "levelno": logging.ERROR})
    assert not handler.shown(error)
    handler.handle(
        logging.makeLogRecord({"msg": "another: returned non-zero exit status 137", "levelno": logging.ERROR})
    )
    handler.handle(error)
    job = {"event": SimpleNamespace(value="job_error"), "rule_name": "simulate", "log": [str(log)], "shellcmd": command}
    handler.handle(logging.makeLogRecord({"msg": "Error in rule", "levelno": logging.ERROR, **job}))
    return lines


@pytest.mark.parametrize(
    ("text", "ending", "expected"),
    [
        ("warning\nfingerfit: error: a: wrong\n", "returned non-zero exit status 1", ["a: wrong"]),
        ("fingerfit: error: a\nfingerfit: error: b\n", "returned non-zero exit status 1", ["a", "b"]),
        ("", "died with <Signals.SIGKILL: 9>", ["was killed (signal 9), perhaps out of memory"]),
        ("some words\n", "returned non-zero exit status 137", ["was killed (signal 9), perhaps out of memory"]),
        ("", "died with <Signals.SIGTERM: 15>", ["was killed (signal 15)"]),
        (
            "Traceback:\n  File x\nValueError: y\n\n",
            "returned non-zero exit status 1",
            ["stopped unexpectedly: ValueError: y"],
        ),
        (None, "returned non-zero exit status 3", ["ended without a message, exit status 3"]),
        ("", "was lost", ["ended without a message, perhaps killed"]),
    ],
)
def test_the_reason_is_one_line_with_the_log(tmp_path, text, ending, expected):
    log = tmp_path / "job.log"
    assert told(log, text, ending) == [
        *[f"simulate: {line}" for line in expected[:-1]], f"simulate: {expected[-1]}; log: {log}",
    ]  # fmt: skip


def test_who_stopped_it_or_saw_it_is_told_nothing(tmp_path):
    log = tmp_path / "job.log"
    assert told(log, "", "died with <Signals.SIGINT: 2>") == []
    assert told(log, "", "returned non-zero exit status 130") == []
    assert (
        told(log, "fingerfit: error: a\n", "returned non-zero exit status 1", "fingerfit discover 2>&1 | tee {log}")
        == []
    )


def test_other_messages_are_shown():
    for text in (
        "WorkflowError in file x: config.yaml: wrong",
        "Complete log(s): x",
        "MissingInputException in rule a",
    ):
        assert Failures.shown(logging.makeLogRecord({"msg": text}))


def test_an_error_before_a_job_is_one_line():
    """Decks are written while Snakemake asks what a job needs; words that Snakemake 9.27 gave for a full disk."""
    said = []
    failures = Failures(said.append)
    dump = (
        'InputFunctionException in rule default in file "Snakefile", line 5:\nError:\n'
        "  FingerfitError: sims/a/deck.inp: cannot be written: No space left on device\nWildcards:\n\nTraceback:\n  File"
    )
    record = logging.LogRecord("snakemake", logging.ERROR, "", 0, dump, None, None)
    failures.emit(record)
    assert said == ["fingerfit: error: sims/a/deck.inp: cannot be written: No space left on device"]
    assert not Failures.shown(record)
    # of others all is shown
    other = logging.LogRecord("snakemake", logging.ERROR, "", 0, dump.replace("FingerfitError", "KeyError"), None, None)
    failures.emit(other)
    assert len(said) == 1 and Failures.shown(other)
