"""Reader of the ABAQUS keyword subset that the decks use. What it does not know is an error with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.files import digest
from fingerfit.deck import material_keywords, mesh_keywords, step_keywords
from fingerfit.deck.cards import Card, plain_cards, read_cards, squeeze
from fingerfit.deck.content import Deck, DeckStep, Rigid, Section, Spring
from fingerfit.deck.state import SNEG, SPOS, Handler, Key, Reading, readable
from fingerfit.mesh.mesh import Mesh

__all__ = ["IGNORED", "Deck", "DeckStep", "Section", "read_deck", "read_deck_mesh"]

IGNORED = frozenset(
    [
        "HEADING",
        "PREPRINT",
        "OUTPUT",
        "NODE OUTPUT",
        "ELEMENT OUTPUT",
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


def _on_restart(reading: Reading, card: Card) -> None:
    """Files for a restart change nothing."""
    if "READ" in card.options:
        raise card.error("READ", "a deck that begins at rest")


KEYWORDS: dict[str, Handler] = {
    **mesh_keywords.KEYWORDS,
    **material_keywords.KEYWORDS,
    **dict.fromkeys(LATER, _handle_later),
    **step_keywords.KEYWORDS,
    "RESTART": _on_restart,
}


NAMES = {squeeze(name): name for name in (*KEYWORDS, *IGNORED)}
"""Keywords as ABAQUS writes them, by what CalculiX takes them for: without blanks."""


def _handle(reading: Reading, card: Card) -> None:
    name = NAMES.get(squeeze(card.name), card.name)
    card.name = name
    if name in IGNORED:
        return
    if name not in KEYWORDS:
        raise card.error("an unknown keyword", "a keyword that the built-in solver has")
    KEYWORDS[name](reading, card)


def read_deck(path: Path, text: str | None = None) -> Deck:
    """Read a deck.

    Parameters
    ----------
    path : Path
        The .inp file; includes are looked up beside it.
    text : str, optional
        Of a deck that is not written: the path then says where it would be.

    Raises
    ------
    InputError
        For anything that is not understood, with file and line.
    """
    return _finish(_read(Path(path), text))


def read_deck_mesh(path: Path) -> Mesh:
    """Read only the mesh of a deck, or of a file that holds nothing else."""
    reading = _read(Path(path), sides=True)
    reading.name_sides()
    return reading.mesh()[0]


def _read(path: Path, text: str | None = None, sides: bool = False) -> Reading:
    reading = Reading(path, _handle)
    reading.sides, begun = sides, False

    def taken(included: Path, content: str) -> bool:
        known = None if begun or sides else _known(included, content)
        if known is not None:
            reading.adopt(known)
        return known is not None

    for card in read_cards(path, text, taken):
        mesh_keywords.dispatch(reading, card)
        begun = begun or card.name not in IGNORED
    return reading


_MESHES: dict[str, Reading | None] = {}
_MESHES_KEPT = 4
"""A fit has a mesh and a finer one, and the test of how fine they must be has two more. A choice."""
_OF_MESHES = frozenset(["NODE", "ELEMENT", "NSET", "ELSET"])


def _known(path: Path, content: str) -> Reading | None:
    """What a file of nodes, elements and sets defines, read once for each content; None for any other file."""
    key = digest(content)
    if key not in _MESHES:
        while len(_MESHES) >= _MESHES_KEPT:
            del _MESHES[next(iter(_MESHES))]
        cards = list(plain_cards(path, content))
        only = all(squeeze(card.name) in _OF_MESHES for card in cards)
        reading = Reading(path, _handle)
        for card in cards if only else ():
            mesh_keywords.dispatch(reading, card)
        # what is to be defined later is told with the file that named it, which is another one next time
        _MESHES[key] = reading if only and not reading.awaited else None
    return _MESHES[key]


def _finish(reading: Reading) -> Deck:
    mesh, numbers = reading.mesh()
    if reading.step is not None or not reading.steps:
        raise InputError(reading.path, "deck", "no complete step", "*STEP ... *END STEP")
    for opening, given in reading.tested.values():
        missing = {"UNIAXIAL TEST DATA", "VOLUMETRIC TEST DATA"} - set(given)
        raise opening.error("no *" + " and no *".join(sorted(missing)), "both test data after it")
    assigned = np.zeros(mesh.element_count, dtype=bool)
    for section, card in reading.sections:
        if section.material not in reading.materials:
            raise card.error(section.material, "a material that is defined")
        if section.elset not in mesh.element_sets:
            raise card.error(section.elset, "an element set that is defined")
        if assigned[mesh.element_sets[section.elset]].any():
            raise card.error(f"elements of {section.elset} in another section too", "one section for each element")
        assigned[mesh.element_sets[section.elset]] = True
    for pair, card in reading.contacts:
        if pair.interaction not in reading.laws:
            raise card.error(pair.interaction, "an interaction that is defined")
    faces = _Faces(reading, mesh, numbers)
    for surface, chosen in reading.faces.items():
        found = reading.surfaces[surface]
        found.faces = faces.numbered([at for at in chosen if at[0] not in reading.others])
        found.facets = [_facet(reading, at, mesh.dim) for at in chosen if at[0] in reading.others]
    for step, pressures in zip(reading.steps, reading.pressures, strict=True):
        for at, (value, name, _) in pressures.items():
            for face in faces.numbered([at]):
                step.pressure[face] = value
                if name is not None:
                    step.curve["P", face] = name
    stress, strain = (
        {numbers[key]: values for key, values in given.items() if key in numbers}
        for given in (reading.stress, reading.strain)
    )
    springs, rigid = _springs(reading), _rigid(reading, mesh, numbers)
    _check_axes(reading, mesh.dim, rigid)
    return Deck(
        mesh,
        reading.materials,
        [section for section, _ in reading.sections],
        reading.equations,
        reading.fixed,
        reading.steps,
        reading.labels,
        reading.orientations,
        springs,
        reading.surfaces,
        rigid,
        reading.laws,
        [pair for pair, _ in reading.contacts],
        reading.ties,
        stress,
        strain,
        reading.amplitudes,
        reading.expansion,
        reading.temperature,
        reading.warmed,
    )


def _check_axes(reading: Reading, dim: int, rigid: list[Rigid]) -> None:
    """Refuse loads and the like at axes that a node has not."""
    turning = {key for body in rigid for key in body.turning(dim)}
    for card, line, (node, axis) in reading.used:
        if axis >= dim and (node, axis) not in turning:
            scope, label = reading.labels[node]
            name = readable((scope, label) if scope else label)
            raise card.error(f"axis {axis + 1} of node {name}", f"one that it has: 1 to {dim}", line)


def _facet(reading: Reading, at: tuple[Key, int | None], dim: int) -> tuple[int, ...]:
    """Nodes of a rigid element, turned round where the surface is on its other side."""
    (key, side), (card, line) = at, reading.where[at]
    kind, keys = reading.others[key]
    if not kind.startswith("R"):
        raise card.error(f"element {readable(key)} of type {kind}", "elements with faces", line)
    if kind.startswith("R3") != (dim == 3):
        raise card.error(kind, "R3D3 or R3D4 in space, R2D2 or RAX2 in the plane", line)
    if side not in (SPOS, SNEG):
        raise card.error(f"a surface of {kind} without side", "SPOS or SNEG", line)
    nodes = tuple(reading.index[k] for k in keys)
    if side == SPOS:
        return nodes
    # the first node of a quadrilateral stays, so that it is cut along the same diagonal
    return nodes[::-1] if len(nodes) == 2 else (nodes[0], *nodes[:0:-1])


class _Faces:
    """Faces by number; a surface without face names has all free faces of its elements."""

    def __init__(self, reading: Reading, mesh: Mesh, numbers: dict[Key, int]) -> None:
        self.reading, self.mesh, self.numbers = reading, mesh, numbers
        self._free: set[tuple[int, int]] | None = None
        self._counts: list[int] = []

    def numbered(self, chosen: list[tuple[Key, int | None]]) -> list[tuple[int, int]]:
        found = []
        for key, face in chosen:
            card, line = self.reading.where[key, face]
            if key not in self.numbers:
                raise card.error(f"element {readable(key)}", "an element of a solid that is defined", line)
            if face is None:
                found += [free for free in self._all_free() if free[0] == self.numbers[key]]
                continue
            if not 0 <= face < self._count(self.numbers[key]):
                where = f"face {face + 1}" if face >= 0 else "SPOS or SNEG"
                expected = f"faces 1 to {self._count(self.numbers[key])}"
                raise card.error(f"{where} of element {readable(key)}", expected, line)
            found.append((self.numbers[key], face))
        return found

    def _count(self, number: int) -> int:
        """Number of faces of an element."""
        if not self._counts:
            from fingerfit.mesh.faces import faces_of

            self._counts = [n for block in self.mesh.blocks for n in [len(faces_of(block.element))] * len(block.nodes)]
        return self._counts[number]

    def _all_free(self) -> set[tuple[int, int]]:
        if self._free is None:
            from fingerfit.mesh.faces import faces_of

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
    for elset, axes, stiffness, table, card in reading.springs:
        if elset not in reading.elsets:
            raise card.error(elset, "an element set that is defined")
        for key in reading.elsets[elset]:
            kind, keys = reading.others.get(key, ("no spring", []))
            if not kind.startswith("SPRING"):
                raise card.error(f"element {key}", "elements of type SPRING1 or SPRING2")
            nodes = [reading.index[k] for k in keys]
            ends = list(zip(nodes, (axes[0], axes[-1]), strict=False))
            reading.used.extend((card, card.line, end) for end in ends)
            found.append(Spring(ends[0], ends[1] if kind == "SPRING2" else None, stiffness, table))
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
