"""Reader of the ABAQUS keyword subset that the decks use. What it does not know is an error with its line."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fingerfit.errors import InputError
from fingerfit.fem.elements import ELEMENTS
from fingerfit.material.ogden import Ogden
from fingerfit.mesh import Block, Mesh

IGNORED = frozenset(
    [
        "HEADING",
        "PREPRINT",
        "RESTART",
        "OUTPUT",
        "NODE_OUTPUT",
        "ELEMENT_OUTPUT",
        "NODE_PRINT",
        "EL_PRINT",
        "NODE_FILE",
        "EL_FILE",
        "FILE_FORMAT",
        "CONTACT_OUTPUT",
        "ENERGY_OUTPUT",
        "ENERGY_FILE",
        "ENERGY_PRINT",
        "MONITOR",
    ]
)
"""Keywords that change nothing in the answer."""


@dataclass
class Section:
    """Elements of a set, their material and their thickness in mm."""

    elset: str
    material: str
    thickness: float


@dataclass
class DeckStep:
    """One loading step; the values are totals that hold at its end.

    Parameters
    ----------
    displacement : dict
        Prescribed displacements in mm by (node, axis), zero-based.
    force : dict
        Concentrated forces in N by (node, axis).
    increment : float
        First increment as a share of the step.
    """

    displacement: dict[tuple[int, int], float] = field(default_factory=dict)
    force: dict[tuple[int, int], float] = field(default_factory=dict)
    increment: float = 1.0


@dataclass
class Deck:
    """What a deck says."""

    mesh: Mesh
    materials: dict[str, Ogden]
    sections: list[Section]
    equations: list[list[tuple[int, int, float]]]
    fixed: dict[tuple[int, int], float]
    steps: list[DeckStep]


@dataclass
class _Card:
    """A keyword line with its data lines."""

    path: Path
    line: int
    name: str
    options: dict[str, str]
    data: list[tuple[int, str]] = field(default_factory=list)

    def error(self, found: object, expected: str, line: int | None = None) -> InputError:
        return InputError(self.path, f"line {line or self.line}, *{self.name}", found, expected)

    def allow(self, *names: str) -> None:
        for option in self.options:
            if option not in names:
                raise self.error(option, "one of " + ", ".join(names) if names else "no parameter")

    def need(self, name: str) -> str:
        if not self.options.get(name):
            raise self.error("no " + name, f"{name}=...")
        return self.options[name].upper()

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        for line, text in self.data:
            fields = [part.strip() for part in text.split(",")]
            while fields and not fields[-1]:
                fields.pop()
            yield line, fields

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


def _cards(path: Path, depth: int = 0) -> Iterator[_Card]:
    """Keyword cards of a file and, in place, of the files it includes."""
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, "deck", error, "a readable text file") from error
    card: _Card | None = None
    pending: tuple[int, str] | None = None
    for number, raw in enumerate(lines, 1):
        text = raw.strip()
        if not text or text.startswith("**"):
            continue
        if pending:
            number, text = pending[0], pending[1] + text
            pending = None
        if text.startswith("*"):
            if text.endswith(","):
                pending = (number, text)
                continue
            if card:
                yield card
            card = _keyword(path, number, text)
            if card.name == "INCLUDE":
                if depth > 8:
                    raise card.error(card.options.get("INPUT"), "includes less than 8 deep")
                if not card.options.get("INPUT"):
                    raise card.error("no INPUT", "INPUT=file")
                yield from _cards(path.parent / card.options["INPUT"], depth + 1)
                card = None
        elif card is None:
            raise InputError(path, f"line {number}", text, "a keyword before data")
        else:
            card.data.append((number, text))
    if card:
        yield card


def _keyword(path: Path, line: int, text: str) -> _Card:
    name, *rest = [part.strip() for part in text[1:].split(",")]
    options = {}
    for part in rest:
        if part:
            key, _, value = part.partition("=")
            options[" ".join(key.upper().split())] = value.strip().strip('"')
    return _Card(path, line, " ".join(name.upper().split()), options)


def read_deck(path: Path) -> Deck:
    """Read a deck.

    Parameters
    ----------
    path : Path
        The .inp file; includes are looked up beside it.

    Raises
    ------
    InputError
        For anything that is not understood, with file and line.
    """
    return _read(Path(path)).finish()


def read_deck_mesh(path: Path) -> Mesh:
    """Read only the mesh of a deck, or of a file that holds nothing else."""
    return _read(Path(path)).mesh()


def _read(path: Path) -> _Reader:
    reader = _Reader(path)
    for card in _cards(path):
        if card.name.replace(" ", "_") in IGNORED:
            continue
        handler = getattr(reader, "on_" + card.name.lower().replace(" ", "_"), None)
        if handler is None:
            raise card.error("an unknown keyword", "a keyword that the built-in solver has")
        handler(card)
    return reader


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.labels: list[int] = []
        self.coordinates: list[list[float]] = []
        self.elements: dict[str, list[tuple[int, list[int]]]] = {}
        self.nsets: dict[str, list[int]] = {}
        self.elsets: dict[str, list[int]] = {}
        self.materials: dict[str, Ogden] = {}
        self.sections: list[Section] = []
        self.equations: list[list[tuple[int, int, float]]] = []
        self.fixed: dict[tuple[int, int], float] = {}
        self.steps: list[DeckStep] = []
        self.material = ""
        self.step: DeckStep | None = None
        self.index: dict[int, int] = {}

    def on_node(self, card: _Card) -> None:
        card.allow("NSET")
        first = len(self.labels)
        for line, row in card.rows():
            self.index[card.whole(row[0], line)] = len(self.labels)
            self.labels.append(card.whole(row[0], line))
            self.coordinates.append([card.number(value, line) for value in row[1:4]])
        if "NSET" in card.options:
            self.nsets.setdefault(card.need("NSET"), []).extend(self.labels[first:])

    def on_element(self, card: _Card) -> None:
        card.allow("TYPE", "ELSET")
        kind = card.need("TYPE")
        if kind not in ELEMENTS:
            raise card.error(kind, "one of " + ", ".join(ELEMENTS))
        size = ELEMENTS[kind].nodes + 1
        values: list[int] = []
        lines = self.elements.setdefault(kind, [])
        for line, row in card.rows():
            values += [card.whole(value, line) for value in row]
            if len(values) > size:
                raise card.error(f"{len(values) - 1} nodes", f"{size - 1} nodes", line)
            if len(values) == size:
                lines.append((values[0], values[1:]))
                if "ELSET" in card.options:
                    self.elsets.setdefault(card.need("ELSET"), []).append(values[0])
                values = []
        if values:
            raise card.error(f"{len(values) - 1} nodes", f"{size - 1} nodes")

    def on_nset(self, card: _Card) -> None:
        self._set(card, "NSET", self.nsets)

    def on_elset(self, card: _Card) -> None:
        self._set(card, "ELSET", self.elsets)

    def _set(self, card: _Card, key: str, sets: dict[str, list[int]]) -> None:
        card.allow(key, "GENERATE")
        chosen = sets.setdefault(card.need(key), [])
        for line, row in card.rows():
            if "GENERATE" in card.options:
                start, stop, *step = [card.whole(value, line) for value in row]
                chosen.extend(range(start, stop + 1, step[0] if step else 1))
            else:
                for value in row:
                    if value.lstrip("-").isdigit():
                        chosen.append(int(value))
                    elif value.upper() in sets:
                        chosen.extend(sets[value.upper()])
                    else:
                        raise card.error(value, "a number or a set defined before", line)

    def on_material(self, card: _Card) -> None:
        card.allow("NAME")
        self.material = card.need("NAME")

    def on_hyperelastic(self, card: _Card) -> None:
        card.allow("OGDEN", "N")
        if "OGDEN" not in card.options:
            raise card.error(", ".join(card.options) or "nothing", "OGDEN")
        order = card.whole(card.options.get("N") or "1", card.line)
        values = [card.number(v, line) for line, row in card.rows() for v in row]
        if len(values) != 3 * order:
            raise card.error(f"{len(values)} constants", f"{3 * order}: mu and alpha of each term, then D")
        d = tuple(values[2 * order :])
        if min(d) <= 0 or min(values[1 : 2 * order : 2], key=abs) == 0:
            raise card.error(values, "alpha other than 0 and D above 0")
        self.materials[self.material] = Ogden(tuple(values[0 : 2 * order : 2]), tuple(values[1 : 2 * order : 2]), d)

    def on_solid_section(self, card: _Card) -> None:
        card.allow("ELSET", "MATERIAL")
        thickness = next((card.number(row[0], line) for line, row in card.rows() if row), 1.0)
        self.sections.append(Section(card.need("ELSET"), card.need("MATERIAL"), thickness))

    def _nodes(self, card: _Card, text: str, line: int) -> list[int]:
        if text.lstrip("-").isdigit():
            labels = [int(text)]
        elif text.upper() in self.nsets:
            labels = self.nsets[text.upper()]
        else:
            raise card.error(text, "a node or a node set", line)
        try:
            return [self.index[label] for label in labels]
        except KeyError as error:
            raise card.error(f"node {error}", "a node that is defined", line) from None

    def on_boundary(self, card: _Card) -> None:
        card.allow("OP", "TYPE")
        if card.options.get("TYPE", "DISPLACEMENT").upper() != "DISPLACEMENT":
            raise card.error(card.options["TYPE"], "DISPLACEMENT")
        target = self.step.displacement if self.step else self.fixed
        for line, row in card.rows():
            first = card.whole(row[1], line)
            last = card.whole(row[2], line) if len(row) > 2 and row[2] else first
            value = card.number(row[3], line) if len(row) > 3 else 0.0
            for node in self._nodes(card, row[0], line):
                for axis in range(first, last + 1):
                    if axis <= 3:
                        target[node, axis - 1] = value

    def on_equation(self, card: _Card) -> None:
        card.allow()
        rows = card.rows()
        for line, row in rows:
            count, terms = card.whole(row[0], line), list[tuple[int, int, float]]()
            while len(terms) < count:
                line, row = next(rows, (line, []))
                if not row:
                    raise card.error(f"{len(terms)} terms", f"{count} terms", line)
                for at in range(0, len(row), 3):
                    node, axis, factor = row[at : at + 3]
                    found = self._nodes(card, node, line)
                    if len(found) != 1:
                        raise card.error(node, "a single node", line)
                    terms.append((found[0], card.whole(axis, line) - 1, card.number(factor, line)))
            self.equations.append(terms)

    def on_step(self, card: _Card) -> None:
        card.allow("NLGEOM", "INC", "NAME")
        if "NLGEOM" not in card.options or card.options["NLGEOM"].upper() == "NO":
            raise card.error("no NLGEOM", "NLGEOM: hyperelastic bodies are solved at finite strain")
        last = self.steps[-1] if self.steps else DeckStep(dict(self.fixed))
        self.step = DeckStep(dict(last.displacement), dict(last.force))

    def on_static(self, card: _Card) -> None:
        card.allow("DIRECT", "SOLVER")
        for line, row in card.rows():
            values = [card.number(v, line) for v in row[:2]]
            if self.step and len(values) == 2:
                self.step.increment = min(1.0, values[0] / values[1])

    def on_cload(self, card: _Card) -> None:
        card.allow("OP")
        if self.step is None:
            raise card.error("no step", "*STEP before it")
        if card.options.get("OP", "").upper() == "NEW":
            self.step.force.clear()
        for line, row in card.rows():
            for node in self._nodes(card, row[0], line):
                self.step.force[node, card.whole(row[1], line) - 1] = card.number(row[2], line)

    def on_end_step(self, card: _Card) -> None:
        if self.step is None:
            raise card.error("no step", "*STEP before it")
        self.steps.append(self.step)
        self.step = None

    def mesh(self) -> Mesh:
        if not self.elements:
            raise InputError(self.path, "deck", "no elements", "*ELEMENT")
        dim = ELEMENTS[next(iter(self.elements))].dim
        blocks: list[Block] = []
        numbers: dict[int, int] = {}
        for kind, rows in self.elements.items():
            try:
                nodes = np.array([[self.index[label] for label in row] for _, row in rows])
            except KeyError as error:
                raise InputError(self.path, "*ELEMENT", f"node {error}", "a node that is defined") from None
            blocks.append(Block(kind, nodes))
            for label, _ in rows:
                numbers[label] = len(numbers)
        return Mesh(
            np.array(self.coordinates)[:, :dim],
            tuple(blocks),
            {n: np.array([self.index[i] for i in v if i in self.index], int) for n, v in self.nsets.items()},
            {n: np.array([numbers[i] for i in v if i in numbers], int) for n, v in self.elsets.items()},
        )

    def finish(self) -> Deck:
        mesh = self.mesh()
        if self.step is not None or not self.steps:
            raise InputError(self.path, "deck", "no complete step", "*STEP ... *END STEP")
        for section in self.sections:
            if section.material not in self.materials:
                raise InputError(self.path, "*SOLID SECTION", section.material, "a material that is defined")
            if section.elset not in mesh.element_sets:
                raise InputError(self.path, "*SOLID SECTION", section.elset, "an element set that is defined")
        return Deck(mesh, self.materials, self.sections, self.equations, self.fixed, self.steps)
