"""What is known while a deck is read: names of nodes, elements and sets, in parts and instances."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.deck.cards import Card
from fingerfit.deck.content import ContactPair, DeckStep, Law, Orientation, Section, Surface, Tie
from fingerfit.errors import InputError
from fingerfit.fem.elements import ELEMENTS
from fingerfit.mesh import Block, Mesh

Key = int | tuple[str, int]
"""Label, or instance and label."""


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
        self.nsets: dict[str, list[Key]] = {}
        self.elsets: dict[str, list[Key]] = {}
        self.parts: dict[str, list[Card]] = {}
        self.part: list[Card] | None = None
        self.placed: tuple[Card, int] | None = None
        self.materials: dict[str, Any] = {}
        self.material: str = ""
        self.orientations: dict[str, Orientation] = {}
        self.sections: list[Section] = []
        self.equations: list[list[tuple[int, int, float]]] = []
        self.springs: list[tuple[str, int, int, float, Card]] = []
        self.surfaces: dict[str, Surface] = {}
        self.faces: dict[str, list[tuple[Key, int | None]]] = {}
        self.rigid: list[tuple[int, int, list[int], list[Key], str]] = []
        self.laws: dict[str, Law] = {}
        self.law: str = ""
        self.contacts: list[ContactPair] = []
        self.ties: list[Tie] = []
        self.stress: dict[Key, list[float]] = {}
        self.strain: dict[Key, list[float]] = {}
        self.amplitudes: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.fixed: dict[tuple[int, int], float] = {}
        self.pressures: list[dict[tuple[Key, int | None], tuple[float, str | None]]] = []
        self.steps: list[DeckStep] = []
        self.step: DeckStep | None = None
        self.renewed: DeckStep | None = None
        self.finite: bool | None = None

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
            raise card.error(f"node {_readable(error.args[0])}", "a node that is defined", line) from None

    def mesh(self) -> tuple[Mesh, dict[Key, int]]:
        """The mesh, and the numbers of its elements."""
        if not self.elements:
            raise InputError(self.path, "deck", "no elements", "*ELEMENT")
        dims = {ELEMENTS[kind].dim for kind in self.elements}
        if len(dims) > 1:
            raise InputError(self.path, "*ELEMENT", "elements in the plane and in space", "one of both")
        dim = dims.pop()
        blocks: list[Block] = []
        numbers: dict[Key, int] = {}
        for kind, rows in self.elements.items():
            try:
                nodes = np.array([[self.index[key] for key in row] for _, row in rows])
            except KeyError as error:
                label = _readable(error.args[0])
                raise InputError(self.path, "*ELEMENT", f"node {label}", "a node that is defined") from None
            blocks.append(Block(kind, nodes))
            for key, _ in rows:
                numbers[key] = len(numbers)
        if len(numbers) < sum(len(rows) for rows in self.elements.values()):
            raise InputError(self.path, "*ELEMENT", "an element number twice", "each number once")
        mesh = Mesh(
            np.array([row[:dim] for row in self.coordinates]),
            tuple(blocks),
            {n: np.array([self.index[i] for i in v if i in self.index], int) for n, v in self.nsets.items()},
            {n: np.array([numbers[i] for i in v if i in numbers], int) for n, v in self.elsets.items()},
            {
                n: np.array([(numbers[i], face) for i, face in v], int).reshape(-1, 2)
                for n, v in self.faces.items()
                if all(i in numbers and face is not None for i, face in v)
            },
        )
        return mesh, numbers


Handler = Callable[[Reading, Card], None]


def _readable(key: Key) -> str:
    return str(key) if isinstance(key, int) else f"{key[0]}.{key[1]}"
