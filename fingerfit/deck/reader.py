"""Reader of the ABAQUS keyword subset that the decks use. What it does not know is an error with its line."""

from __future__ import annotations

from pathlib import Path

from fingerfit.deck import material_keywords, mesh_keywords, step_keywords
from fingerfit.deck.cards import Card, read_cards, squeeze
from fingerfit.deck.content import Deck, DeckStep, Rigid, Section, Spring
from fingerfit.deck.state import Handler, Key, Reading
from fingerfit.errors import InputError
from fingerfit.mesh import Mesh

__all__ = ["IGNORED", "Deck", "DeckStep", "Section", "read_deck", "read_deck_mesh"]

IGNORED = frozenset(
    [
        "HEADING",
        "PREPRINT",
        "RESTART",
        "OUTPUT",
        "NODE OUTPUT",
        "ELEMENT OUTPUT",
        "NODE PRINT",
        "EL PRINT",
        "NODE FILE",
        "EL FILE",
        "FILE FORMAT",
        "CONTACT OUTPUT",
        "CONTACT PRINT",
        "CONTACT FILE",
        "ENERGY OUTPUT",
        "ENERGY FILE",
        "ENERGY PRINT",
        "SECTION PRINT",
        "SECTION FILE",
        "MONITOR",
        "PRINT",
        "TIME POINTS",
        "CONTROLS",
    ]
)
"""Keywords that change nothing in the answer."""

LATER = (
    "EQUATION",
    "RIGID BODY",
    "SURFACE",
    "SURFACE INTERACTION",
    "SURFACE BEHAVIOR",
    "FRICTION",
    "CONTACT PAIR",
    "TIE",
    "SPRING",
    "INITIAL CONDITIONS",
    "AMPLITUDE",
)
"""Keywords whose module is loaded when a deck has one of them."""


def _handle_later(reading: Reading, card: Card) -> None:
    from fingerfit.deck.model_keywords import KEYWORDS as RARE

    RARE[NAMES[squeeze(card.name)]](reading, card)


KEYWORDS: dict[str, Handler] = {
    **mesh_keywords.KEYWORDS,
    **material_keywords.KEYWORDS,
    **dict.fromkeys(LATER, _handle_later),
    **step_keywords.KEYWORDS,
}


NAMES = {squeeze(name): name for name in (*KEYWORDS, *IGNORED)}
"""Keywords as ABAQUS writes them, by what CalculiX takes them for: without blanks."""


def _handle(reading: Reading, card: Card) -> None:
    name = NAMES.get(squeeze(card.name), card.name)
    if name in IGNORED:
        return
    if name not in KEYWORDS:
        raise card.error("an unknown keyword", "a keyword that the built-in solver has")
    KEYWORDS[name](reading, card)


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
    return _finish(_read(Path(path)))


def read_deck_mesh(path: Path) -> Mesh:
    """Read only the mesh of a deck, or of a file that holds nothing else."""
    return _read(Path(path)).mesh()[0]


def _read(path: Path) -> Reading:
    reading = Reading(path, _handle)
    for card in read_cards(path):
        mesh_keywords.dispatch(reading, card)
    return reading


def _finish(reading: Reading) -> Deck:
    mesh, numbers = reading.mesh()
    if reading.step is not None or not reading.steps:
        raise InputError(reading.path, "deck", "no complete step", "*STEP ... *END STEP")
    for section in reading.sections:
        if section.material not in reading.materials:
            raise InputError(reading.path, "*SOLID SECTION", section.material, "a material that is defined")
        if section.elset not in mesh.element_sets:
            raise InputError(reading.path, "*SOLID SECTION", section.elset, "an element set that is defined")
    for pair in reading.contacts:
        if pair.interaction not in reading.laws:
            raise InputError(reading.path, "*CONTACT PAIR", pair.interaction, "an interaction that is defined")
    faces = _Faces(reading, mesh, numbers)
    for surface, chosen in reading.faces.items():
        reading.surfaces[surface].faces = faces.numbered(chosen, surface)
    for step, pressures in zip(reading.steps, reading.pressures, strict=True):
        for (key, face), (value, name) in pressures.items():
            for found in faces.numbered([(key, face)], "*DLOAD"):
                step.pressure[found] = value
                if name is not None:
                    step.curve["P", found] = name
    stress, strain = (
        {numbers[key]: values for key, values in given.items() if key in numbers}
        for given in (reading.stress, reading.strain)
    )
    return Deck(
        mesh,
        reading.materials,
        reading.sections,
        reading.equations,
        reading.fixed,
        reading.steps,
        reading.labels,
        reading.orientations,
        _springs(reading),
        reading.surfaces,
        _rigid(reading, mesh, numbers),
        reading.laws,
        reading.contacts,
        reading.ties,
        stress,
        strain,
        reading.amplitudes,
    )


class _Faces:
    """Faces by number; a surface without face names has all free faces of its elements."""

    def __init__(self, reading: Reading, mesh: Mesh, numbers: dict[Key, int]) -> None:
        self.reading, self.mesh, self.numbers = reading, mesh, numbers
        self._free: set[tuple[int, int]] | None = None

    def numbered(self, chosen: list[tuple[Key, int | None]], name: str) -> list[tuple[int, int]]:
        found = []
        for key, face in chosen:
            if key not in self.numbers:
                raise InputError(self.reading.path, f"surface {name}", f"element {key}", "an element with a mesh")
            if face is not None:
                found.append((self.numbers[key], face))
            else:
                found += [free for free in self._all_free() if free[0] == self.numbers[key]]
        return found

    def _all_free(self) -> set[tuple[int, int]]:
        if self._free is None:
            from fingerfit.fem.faces import faces_of

            seen: dict[frozenset[int], list[tuple[int, int]]] = {}
            number = 0
            for block in self.mesh.blocks:
                for nodes in block.nodes:
                    for face, local in enumerate(faces_of(block.element)):
                        seen.setdefault(frozenset(nodes[list(local)].tolist()), []).append((number, face))
                    number += 1
            self._free = {owners[0] for owners in seen.values() if len(owners) == 1}
        return self._free


def _springs(reading: Reading) -> list[Spring]:
    found = []
    for elset, first, second, stiffness, card in reading.springs:
        if elset not in reading.elsets:
            raise card.error(elset, "an element set that is defined")
        for key in reading.elsets[elset]:
            kind, keys = reading.others.get(key, ("no spring", []))
            if not kind.startswith("SPRING"):
                raise card.error(f"element {key}", "elements of type SPRING1 or SPRING2")
            nodes = [reading.index[k] for k in keys]
            end = (nodes[1], second) if kind == "SPRING2" else None
            found.append(Spring((nodes[0], first), end, stiffness))
    return found


def _rigid(reading: Reading, mesh: Mesh, numbers: dict[Key, int]) -> list[Rigid]:
    found = []
    for reference, rotation, nodes, keys, surface in reading.rigid:
        members = dict.fromkeys(nodes)
        elements = [numbers[key] for key in keys if key in numbers]
        first = 0
        for block in mesh.blocks:
            inside = [e - first for e in elements if first <= e < first + len(block.nodes)]
            members.update(dict.fromkeys(block.nodes[inside].ravel().tolist()))
            first += len(block.nodes)
        for key in keys:
            if key in reading.others:
                members.update(dict.fromkeys(reading.index[k] for k in reading.others[key][1]))
        members.pop(reference, None)
        members.pop(rotation, None)
        found.append(Rigid(reference, rotation, tuple(members), tuple(elements), surface))
    return found
