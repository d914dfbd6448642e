"""ABAQUS's ASCII results files taken apart into records and put together again, to damage them."""

from stand_in_abaqus import record

from fingerfit.solvers.abaqus_fil import _record
from fingerfit.testing.damage import Format


def split(text):
    """Records; lines of 80 characters have no meaning."""
    text = "".join(line.ljust(80) for line in text.splitlines()).rstrip()
    return [f"*{part}" for part in text.split("*")[1:]]


def join(pieces):
    stream = "".join(pieces)
    return "".join(stream[n : n + 80].ljust(80) + "\n" for n in range(0, len(stream), 80))


def row(piece):
    (key, *values), _ = _record(piece, 1)
    return (values[0], values[1:]) if key in (101, 104) else None


def piece(piece, row):
    (key, *_), _ = _record(piece, 1)
    return record(key, row[0], *row[1])


FIL = Format("deck.fil", split, join, row, piece)
