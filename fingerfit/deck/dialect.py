"""A deck in ABAQUS's words, where those of CalculiX differ from them; the built-in reader knows both.

What differs (ABAQUS Keywords Guide; CalculiX 2.20 manual): the nodes and the rotation of a rigid body, the number after
a coefficient of friction or a contact stiffness, names of ties, stress by integration point, the solver, prints.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from fingerfit.deck.cards import Card, squeeze
from fingerfit.deck.content import Deck
from fingerfit.deck.reader import NAMES

_PRINTS = frozenset({"NODEPRINT", "ELPRINT", "CONTACTPRINT", "NODEFILE", "ELFILE", "CONTACTFILE", "FILEFORMAT"})
_PARAMETERS = {
    squeeze(name): name
    for name in (
        "ANALYTICAL SURFACE",
        "FILLET RADIUS",
        "LOCAL DIRECTIONS",
        "LONG TERM",
        "NO SEPARATION",
        "PIN NSET",
        "POSITION TOLERANCE",
        "REF NODE",
        "ROT NODE",
        "TIE NSET",
    )
}
_FIRST_AXIS = {2: 3, 3: 1}
"""Of CalculiX's ROT NODE, by dimension: its displacements are rotations; the reference node's axes follow 3 later."""


def to_abaqus(cards: Iterable[Card], deck: Deck, requests: Iterable[Card] = ()) -> Iterator[Card]:
    """Cards for ABAQUS.

    Parameters
    ----------
    cards : iterable of Card
        As `fingerfit.deck.cards.read_cards` finds them: included files in place.
    deck : Deck
        What they say.
    requests : iterable of Card
        Written at the end of each step, in place of the deck's own prints.

    Raises
    ------
    InputError
        For a load on a set of nodes of which one is a ROT NODE.
    """
    words = _Words(deck)
    for card in cards:
        name = squeeze(card.name)
        if name in _PRINTS:
            continue
        if name == "ENDSTEP":
            yield from requests
        # CalculiX takes names without blanks, too
        options = {_PARAMETERS.get(squeeze(option), option): value for option, value in card.options.items()}
        card = replace(card, name=NAMES.get(name, card.name), options=options)
        changed = words.change.get(name, lambda card: card)(card)
        if changed is not None:
            yield changed


class _Words:
    def __init__(self, deck: Deck) -> None:
        self.deck, self.ties, self.least = deck, 0, _FIRST_AXIS[deck.mesh.dim]
        self.labels = {label: n for n, (scope, label) in enumerate(deck.labels) if not scope}
        self.turning = {body.rotation: deck.labels[body.reference][1] for body in deck.rigid if body.rotation >= 0}
        self.stressed: set[str] = set()
        self.change = {
            "RIGIDBODY": self.rigid,
            "BOUNDARY": self.turned,
            "CLOAD": self.turned,
            "FRICTION": self.first_number,
            "SURFACEBEHAVIOR": self.first_number,
            "TIE": self.tie,
            "STATIC": self.procedure,
            "VISCO": self.procedure,
            "INITIALCONDITIONS": self.initial,
        }

    def rigid(self, card: Card) -> Card:
        names = {"NSET": "TIE NSET"}
        options = {names.get(key, key): value for key, value in card.options.items() if key != "ROT NODE"}
        return replace(card, options=options)

    def turned(self, card: Card) -> Card | None:
        """Loads on a ROT NODE as rotations of the reference node."""
        if not self.turning:
            return card
        data = []
        for (_, text), (line, row) in zip(card.data, card.rows(), strict=True):
            nodes = self._nodes(row[0])
            if not nodes & set(self.turning):
                data.append((line, text))
            elif not nodes <= set(self.turning):
                raise card.error(row[0], "for ABAQUS, a set without the ROT NODE of a rigid body", line)
            else:
                rest = self._force(row) if card.name == "CLOAD" else self._displacement(row)
                data += [(line, ", ".join([str(self.turning[node]), *rest])) for node in sorted(nodes) if rest]
        return replace(card, data=data) if data or "OP" in card.options else None

    def _force(self, row: list[str]) -> list[str]:
        return [str(int(row[1]) + 3), *row[2:]] if self.least <= int(row[1]) <= 3 else []

    def _displacement(self, row: list[str]) -> list[str]:
        if not row[1].isdigit():  # ENCASTRE and the like
            return [str(self.least + 3), "6"]
        first, last = int(row[1]), int(row[2]) if len(row) > 2 and row[2] else int(row[1])
        first, last = max(first, self.least), min(last, 3)
        return [str(first + 3), str(last + 3), *row[3:]] if first <= last else []

    def _nodes(self, text: str) -> set[int]:
        if text.isdigit():
            return {self.labels[int(text)]} if int(text) in self.labels else set()
        return set(self.deck.mesh.node_sets.get(text.upper(), np.zeros(0, dtype=int)).tolist())

    def first_number(self, card: Card) -> Card:
        return replace(card, data=[(line, row[0]) for line, row in card.rows() if row])

    def tie(self, card: Card) -> Card:
        self.ties += 1
        return replace(card, options={"NAME": f"TIE-{self.ties}", **card.options})

    def procedure(self, card: Card) -> Card:
        return replace(card, options={key: value for key, value in card.options.items() if key != "SOLVER"})

    def initial(self, card: Card) -> Card:
        """Stress by element: CalculiX has it by integration point, and here all points of an element are alike."""
        data = []
        for line, row in card.rows():
            values = row[2:] if len(row) == 8 else row[1:]
            if len(row) != 8 or row[0] not in self.stressed:
                data.append((line, ", ".join([row[0], *values[: 4 if self.deck.mesh.dim == 2 else 6]])))
            self.stressed.add(row[0])
        return replace(card, data=data)
