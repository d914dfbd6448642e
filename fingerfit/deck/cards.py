"""Keyword lines of a deck with their data lines, includes in place."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError, LimitError
from fingerfit.core.files import MESH, check_regular, megabytes, read_bytes

_BLOCK = 4096
"""Bytes that each file counts for at least, as on a disk: else a file could include empty ones without end."""
_WIDTH = 110
"""Characters of a keyword line that all programs read."""
_DEEP = 8
"""Files within files; the manuals' examples have two."""
_NAMES = frozenset(
    {"NAME", "NSET", "ELSET", "MATERIAL", "ORIENTATION", "INTERACTION", "PART", "INSTANCE", "AMPLITUDE", "INPUT"}
    | {"REF NODE", "ROT NODE", "PIN NSET", "TIE NSET", "ANALYTICAL SURFACE"}
)
"""Parameters whose values are names: these stand in quotes where they have blanks or commas."""


@dataclass
class Card:
    """A keyword line with its data lines."""

    path: Path
    line: int
    name: str
    options: dict[str, str]
    data: list[tuple[int, str]] = field(default_factory=list)

    def error(self, found: object, expected: str, line: int | None = None) -> InputError:
        return InputError(self.path, f"line {line or self.line}, *{self.name}", found, expected)

    def lines(self) -> Iterator[str]:
        """The card as text; a long keyword line goes on after a comma."""
        line = f"*{self.name}"
        for option, value in self.options.items():
            if option in _NAMES and set(value) & {" ", ","}:
                value = f'"{value}"'
            word = f"{option}={value}" if value else option
            if len(line) + len(word) > _WIDTH:
                yield line + ","
                line = word
            else:
                line += f", {word}"
        yield line
        yield from (text for _, text in self.data)

    def allow(self, *names: str) -> None:
        """Refuse other parameters; those that are written without blanks get their names."""
        known = {squeeze(name): name for name in names}
        self.options = {known.get(squeeze(option), option): value for option, value in self.options.items()}
        for option in self.options:
            if option not in names:
                raise self.error(option, "one of " + ", ".join(names) if names else "no parameter")

    def need(self, name: str) -> str:
        if not self.options.get(name):
            raise self.error("no " + name, f"{name}=...")
        return self.options[name].upper()

    def rows(self, least: int = 0) -> Iterator[tuple[int, list[str]]]:
        """Lines with their fields, without empty ones at the end; InputError where there are less than `least`."""
        for line, text in self.data:
            fields = split(text)
            while fields and not fields[-1]:
                fields.pop()
            if len(fields) < least:
                raise self.error(text, f"{least} values or more", line)
            yield line, fields

    def values(self, least: int = 0, most: int | None = None) -> list[float]:
        """All numbers of the data lines; an empty field is 0."""
        found = [self.number(text, line) if text else 0.0 for line, row in self.rows() for text in row]
        if len(found) < least or (most is not None and len(found) > most):
            wanted = f"{least}" if most == least else f"{least} or more" if most is None else f"{least} to {most}"
            raise self.error(f"{len(found)} numbers", f"{wanted} numbers")
        return found

    def flag(self, name: str) -> bool:
        """Whether a parameter is there and does not say NO."""
        return name in self.options and self.options[name].upper() != "NO"

    def number(self, text: str, line: int) -> float:
        try:
            value = float(text.replace("d", "e").replace("D", "E"))
        except ValueError:
            raise self.error(text, "a number", line) from None
        if not np.isfinite(value):
            raise self.error(text, "a finite number", line)
        return value

    def whole(self, text: str, line: int) -> int:
        try:
            return int(text)
        except ValueError:
            raise self.error(text, "a whole number", line) from None


Taken = Callable[[Path, str], bool]
"""From an included file and its text to whether what is in it was taken as a whole: its cards then do not follow."""


def read_cards(path: Path, text: str | None = None, taken: Taken = lambda path, text: False) -> Iterator[Card]:
    """Keyword cards of a file and, in place, of the files it includes.

    Parameters
    ----------
    path : Path
    text : str, optional
        Of the file, where it is not read: the path then says where included files are.
    taken : function
        Asked about each file that the first one includes.

    Raises
    ------
    InputError
        For files that cannot be read, include themselves, or are more than `fingerfit.core.files.MESH` bytes in all.
    """
    budget = _Budget(path)
    return _cards(path, (), budget, budget.text(path) if text is None else text, taken)


def read_text(path: Path) -> str:
    """Text of one file of keywords or of a template, UTF-8 or Latin-1; errors as of `read_cards`."""
    return _Budget(path).text(path)


class _Budget:
    """What a deck may still read, in bytes: a file that is included often counts as often."""

    def __init__(self, path: Path) -> None:
        self.path, self.left = path, MESH

    def text(self, path: Path) -> str:
        content = read_bytes(path, "deck", MESH, "a readable text file")
        self.left -= max(len(content), _BLOCK)
        if self.left < 0:
            found = f"more than {megabytes(MESH)} with what it includes"
            raise LimitError(self.path, "deck", found, f"at most {megabytes(MESH)}")
        return _decode(content)


def _cards(path: Path, above: tuple[str, ...], budget: _Budget, content: str, taken: Taken) -> Iterator[Card]:
    """Cards of a file that is included by those `above` it."""
    above = (*above, os.path.realpath(path))
    for card in plain_cards(path, content):
        if card.name != "INCLUDE":
            yield card
            continue
        if not card.options.get("INPUT"):
            raise card.error("no INPUT", "INPUT=file")
        included = path.parent / card.options["INPUT"]
        check_regular(included, "deck", MESH, "a readable text file")
        if os.path.realpath(included) in above:
            raise card.error(f"{card.options['INPUT']}, which is being read", "a file that does not include this")
        if len(above) > _DEEP:
            raise card.error(card.options["INPUT"], f"files that include each other at most {_DEEP} deep")
        text = budget.text(included)
        if len(above) > 1 or not taken(included, text):
            yield from _cards(included, above, budget, text, taken)


def plain_cards(path: Path, content: str) -> Iterator[Card]:
    """Cards of one file by its text; those that include others are among them."""
    card: Card | None = None
    for number, text in _keyword_lines(content):
        if text.startswith("*"):
            if card:
                yield card
            card = _keyword(path, number, text)
        elif card is None or card.name == "INCLUDE":
            raise InputError(path, f"line {number}", text, "a keyword before data")
        else:
            card.data.append((number, text))
    if card:
        yield card


_INCLUDE = re.compile(
    r'^[ \t]*\*[ \t]*INCLUDE\s*,\s*INPUT[ \t]*=[ \t]*"?([^"\n]+?)"?[ \t]*$', re.IGNORECASE | re.MULTILINE
)


def includes(text: str) -> list[str]:
    """Names of the files that a text in keywords includes, without looking at anything else in it."""
    return _INCLUDE.findall(text) if "*" in text else []


def _keyword_lines(content: str) -> Iterator[tuple[int, str]]:
    """Lines without comments, by number; a keyword line that ends with a comma has the next data line behind it."""
    pending: tuple[int, str] | None = None
    for number, raw in enumerate(content.splitlines(), 1):
        text = raw.strip()
        if not text or text.startswith("**"):
            continue
        if pending and text.startswith("*"):
            yield pending
        elif pending:
            number, text = pending[0], pending[1] + text
        pending = (number, text) if text.startswith("*") and text.endswith(",") else None
        if not pending:
            yield number, text
    if pending:
        yield pending


def _decode(content: bytes) -> str:
    """Text in UTF-8 or, where it is none, in Latin-1, as comments of old decks are."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def split(text: str) -> list[str]:
    """Fields between commas; those in quotes may have commas, and lose their quotes."""
    if '"' not in text:
        return [part.strip() for part in text.split(",")]
    return [part.strip().replace('"', "") for part in re.findall(r'(?:^|,)((?:[^,"]|"[^"]*"?)*)', text)]


def _keyword(path: Path, line: int, text: str) -> Card:
    name, *rest = split(text[1:])
    options = {}
    for part in rest:
        if part:
            key, _, value = part.partition("=")
            options[" ".join(key.upper().split())] = value.strip()
    return Card(path, line, " ".join(name.upper().split()), options)


@lru_cache(maxsize=1024)
def squeeze(name: str) -> str:
    """A keyword as CalculiX compares it: without blanks, in upper case."""
    return "".join(name.upper().split())
