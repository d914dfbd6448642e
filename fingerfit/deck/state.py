"""What is known while a deck is read: names of nodes, elements and sets, in parts and instances."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.cards import Card
from fingerfit.deck.content import ContactPair, DeckStep, Law, NodeAxis, Orientation, Section, Surface, Table, Tie
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.mesh import Block, Mesh

Key = int | tuple[str, int]
"""Label, or instance and label."""


SPOS, SNEG = -1, -2
"""Sides of a rigid element, in place of a face: where its normal points to, and the other one."""
Pressed = tuple[float, str | None, str]
"""Pressure in MPa, name of its amplitude, and keyword that gave it."""

LINES = {"T3D2": 2, "T3D3": 3}
"""Elements that mesh generators write for the lines of a body, with their number of nodes."""


class Reading:
    """State of the reader.

    Nodes and elements of instances are known by instance and label; their sets by INSTANCE.SET. Elements are numbered
    at the end, because blocks are sorted by type; until then surfaces and springs have their keys.
    """

    def __init__(self, path: Path, handle: Callable[[Reading, Card], None]) -> None:
        self.path, self.handle = path, handle
        self.scope: str = ""
        self.labels: list[tuple[str, int]] = []
        self.coordinates: list[list[float]] = []
        self.index: dict[Key, int] = {}
        self.elements: dict[str, list[tuple[Key, list[Key]]]] = {}
        self.others: dict[Key, tuple[str, list[Key]]] = {}
        self.numbered: set[Key] = set()
        self.awaited: list[tuple[str, list[Key], Card, int]] = []
        self.used: list[tuple[Card, int, NodeAxis]] = []
        self.turned: list[tuple[Card, np.ndarray]] = []
        self.where: dict[tuple[Key, int | None], tuple[Card, int]] = {}
        self.nsets: dict[str, list[Key]] = {}
        self.elsets: dict[str, list[Key]] = {}
        self.parts: dict[str, list[Card]] = {}
        self.part: list[Card] | None = None
        self.placed: tuple[Card, int, int] | None = None
        self.materials: dict[str, Any] = {}
        self.material: str = ""
        self.tested: dict[str, tuple[Card, dict[str, Card]]] = {}
        self.orientations: dict[str, Orientation] = {}
        self.sections: list[tuple[Section, Card]] = []
        self.equations: list[list[tuple[int, int, float]]] = []
        self.springs: list[tuple[str, list[int], float, Table, Card]] = []
        self.surfaces: dict[str, Surface] = {}
        self.faces: dict[str, list[tuple[Key, int | None]]] = {}
        self.rigid: list[tuple[int, int, list[int], list[Key], str]] = []
        self.laws: dict[str, Law] = {}
        self.law: str = ""
        self.contacts: list[tuple[ContactPair, Card]] = []
        self.ties: list[Tie] = []
        self.stress: dict[Key, list[float]] = {}
        self.strain: dict[Key, list[float]] = {}
        self.expansion: dict[str, float] = {}
        self.temperature: dict[int, float] = {}
        self.warmed: dict[str, list[tuple[float, Any]]] = {}
        self.amplitudes: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.fixed: dict[tuple[int, int], float] = {}
        self.pressures: list[dict[tuple[Key, int | None], Pressed]] = []
        self.steps: list[DeckStep] = []
        self.step: DeckStep | None = None
        self.older: dict[str, set[Any]] = {}
        self.finite: bool | None = None
        self.sides: bool = False

    def adopt(self, other: Reading) -> None:
        """Take on nodes, elements and sets of another reading, which stays as it is whatever follows here."""
        self.labels, self.coordinates = list(other.labels), list(other.coordinates)
        self.index, self.others, self.numbered = dict(other.index), dict(other.others), set(other.numbered)
        self.elements = {kind: list(rows) for kind, rows in other.elements.items()}
        self.nsets = {name: list(keys) for name, keys in other.nsets.items()}
        self.elsets = {name: list(keys) for name, keys in other.elsets.items()}

    def key(self, label: int) -> Key:
        """Key of a label in the present instance."""
        return (self.scope, label) if self.scope else label

    def name(self, text: str) -> str:
        """Full name of what is defined in the present instance."""
        return f"{self.scope}.{text.upper()}" if self.scope else text.upper()

    def find(self, names: dict[str, Any], text: str) -> str | None:
        """Full name of something that was defined, seen from the present instance; None where it was not."""
        upper = text.upper().removeprefix("ASSEMBLY.")
        for candidate in (self.name(upper), upper):
            if candidate in names:
                return candidate
        return None

    def keys(self, card: Card, text: str, line: int, sets: dict[str, list[Key]], what: str) -> list[Key]:
        """Keys of a label, of INSTANCE.LABEL or of a set."""
        if text.lstrip("-").isdigit():
            return [self.key(int(text))]
        found = self.find(sets, text)
        if found is not None:
            return sets[found]
        instance, _, label = text.rpartition(".")
        if instance and label.isdigit():
            return [(instance.upper(), int(label))]
        raise card.error(text, f"{what} or a set of them", line)

    def nodes(self, card: Card, text: str, line: int) -> list[int]:
        """Zero-based nodes of a label or a set."""
        try:
            return [self.index[key] for key in self.keys(card, text, line, self.nsets, "a node")]
        except KeyError as error:
            raise card.error(f"node {readable(error.args[0])}", "a node that is defined", line) from None

    def by_node(self, card: Card) -> dict[int, float]:
        """Numbers by zero-based node, from lines of a label or a set and a number."""
        found = dict[int, float]()
        for line, row in card.rows():
            if len(row) != 2:
                raise card.error(row, "a node and a number", line)
            found |= dict.fromkeys(self.nodes(card, row[0], line), card.number(row[1], line))
        return found

    def axis(self, card: Card, text: str, line: int) -> int:
        """Zero-based axis of a node, rotations from 3 on."""
        axis = card.whole(text, line)
        if not 1 <= axis <= 6:
            raise card.error(f"axis {axis}", "an axis from 1 to 6", line)
        return axis - 1

    def await_all(self, what: str, keys: list[Key], card: Card, line: int) -> None:
        """Note which nodes or elements have to be defined by the end."""
        known = self.index if what == "node" else self.numbered
        absent = [key for key in keys if key not in known]
        if absent:
            self.awaited.append((what, absent, card, line))

    def name_sides(self) -> None:
        """Take elements of fewer dimensions than the body's as names of its sides, as mesh generators write them.

        Their element sets become node sets, where no node set has the name.
        """
        dims = {kind: ELEMENTS[kind].dim for kind in self.elements}
        low = {kind for kind, dim in dims.items() if dim < max(dims.values())}
        sides = {key: nodes for kind in low for key, nodes in self.elements.pop(kind)}
        sides |= {key: nodes for key, (kind, nodes) in self.others.items() if kind in LINES}
        for name, keys in self.elsets.items():
            nodes = dict.fromkeys(node for key in keys for node in sides.get(key, ()))
            if nodes:
                self.nsets.setdefault(name, list(nodes))
        self.elsets = {name: keys for name, keys in self.elsets.items() if not keys or not sides.keys() >= set(keys)}

    def mesh(self) -> tuple[Mesh, dict[Key, int]]:
        """The mesh, and the numbers of its elements."""
        if self.part is not None:
            raise InputError(self.path, "*PART", "no end of it", "*END PART")
        if self.placed is not None:
            raise self.placed[0].error("no end of it", "*END INSTANCE")
        if not self.elements:
            raise InputError(self.path, "deck", "no elements", "*ELEMENT")
        for what, keys, card, line in self.awaited:
            known = self.index if what == "node" else self.numbered
            for key in keys:
                if key not in known:
                    raise card.error(f"{what} {readable(key)}", f"{what}s that are defined", line)
        dims = {ELEMENTS[kind].dim for kind in self.elements}
        if len(dims) > 1:
            raise InputError(self.path, "*ELEMENT", "elements in the plane and in space", "one of both")
        dim = dims.pop()
        blocks: list[Block] = []
        numbers: dict[Key, int] = {}
        for kind, rows in self.elements.items():
            blocks.append(Block(kind, np.array([[self.index[key] for key in row] for _, row in rows])))
            for key, _ in rows:
                numbers[key] = len(numbers)
        for card, turn in self.turned:
            if dim == 2 and turn[2, 2] < 1 - 1e-9:
                raise card.error("a rotation out of the plane", "a rotation about an axis along z")
        mesh = Mesh(
            np.array([row[:dim] for row in self.coordinates]),
            tuple(blocks),
            {n: np.array([self.index[i] for i in v], int) for n, v in self.nsets.items()},
            {n: np.array([numbers[i] for i in v if i in numbers], int) for n, v in self.elsets.items()},
            {
                n: np.array([(numbers[i], face) for i, face in v], int).reshape(-1, 2)
                for n, v in self.faces.items()
                if all(i in numbers and face is not None and face >= 0 for i, face in v)
            },
        )
        return mesh, numbers


Handler = Callable[[Reading, Card], None]


def readable(key: Key) -> str:
    """A label as a deck has it."""
    return str(key) if isinstance(key, int) else f"{key[0]}.{key[1]}"
