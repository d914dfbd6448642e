"""Keywords of nodes, elements, sets, parts and instances."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from fingerfit.core.files import MESH, megabytes
from fingerfit.deck.cards import Card, squeeze
from fingerfit.deck.state import LINES, Handler, Key, Reading, readable
from fingerfit.mesh.elements import ELEMENTS

OTHERS = {"R2D2": 2, "RAX2": 2, "R3D3": 3, "R3D4": 4, "SPRING1": 1, "SPRING2": 2}
"""Elements without a mesh of their own: of rigid bodies, and springs; with their number of nodes."""
_LEAST = 5
"""Bytes of the line of a node or an element beside its label: two numbers of one digit, two commas, the line's end."""


def on_node(reading: Reading, card: Card) -> None:
    card.allow("NSET", "SYSTEM")
    if card.options.get("SYSTEM", "R").upper() != "R":
        raise card.error(card.options["SYSTEM"], "SYSTEM=R: Cartesian")
    first = len(reading.labels)
    for line, row in card.rows(least=1):
        label = card.whole(row[0], line)
        key = reading.key(label)
        if key in reading.index:
            raise card.error(f"node {label} twice", "each node once", line)
        reading.index[key] = len(reading.labels)
        reading.labels.append((reading.scope, label))
        values = [card.number(value, line) if value else 0.0 for value in row[1:4]]
        reading.coordinates.append(values + [0.0] * (3 - len(values)))
    if "NSET" in card.options:
        chosen = reading.nsets.setdefault(reading.name(card.need("NSET")), [])
        chosen.extend(reading.key(label) for _, label in reading.labels[first:])


def on_element(reading: Reading, card: Card) -> None:
    card.allow("TYPE", "ELSET")
    kind = card.need("TYPE")
    others = OTHERS | LINES if reading.sides else OTHERS
    if kind not in ELEMENTS and kind not in others:
        raise card.error(kind, "one of " + ", ".join([*ELEMENTS, *OTHERS]))
    size = 1 + (ELEMENTS[kind].nodes if kind in ELEMENTS else others[kind])
    values: list[int] = []
    keys: list[Key] = []
    for line, row in card.rows():
        values += [card.whole(value, line) for value in row]
        if len(values) > size:
            raise card.error(f"{len(values) - 1} nodes", f"{size - 1} nodes", line)
        if len(values) == size:
            key, nodes = reading.key(values[0]), [reading.key(value) for value in values[1:]]
            if key in reading.numbered:
                raise card.error(f"element {readable(key)} twice", "each number once", line)
            reading.numbered.add(key)
            reading.await_all("node", nodes, card, line)
            if kind in ELEMENTS:
                reading.elements.setdefault(kind, []).append((key, nodes))
            else:
                reading.others[key] = (kind, nodes)
            keys.append(key)
            values = []
    if values:
        raise card.error(f"{len(values) - 1} nodes", f"{size - 1} nodes")
    if "ELSET" in card.options:
        reading.elsets.setdefault(reading.name(card.need("ELSET")), []).extend(keys)


def on_nset(reading: Reading, card: Card) -> None:
    if "ELSET" in card.options:
        chosen = reading.find(reading.elsets, card.need("ELSET"))
        if chosen is None:
            raise card.error(card.options["ELSET"], "an element set defined before")
        wanted = set(reading.elsets[chosen])
        rows = [row for rows in reading.elements.values() for row in rows]
        rows += [(key, nodes) for key, (_, nodes) in reading.others.items()]
        found = dict.fromkeys(node for key, nodes in rows if key in wanted for node in nodes)
        reading.nsets.setdefault(reading.name(card.need("NSET")), []).extend(found)
        return
    _set(reading, card, "NSET", reading.nsets)


def on_elset(reading: Reading, card: Card) -> None:
    _set(reading, card, "ELSET", reading.elsets)


def _set(reading: Reading, card: Card, name: str, sets: dict[str, list[Key]]) -> None:
    card.allow(name, "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED")
    chosen = sets.setdefault(reading.name(card.need(name)), [])
    known = reading.index if name == "NSET" else reading.numbered
    outer, reading.scope = reading.scope, card.options.get("INSTANCE", reading.scope).upper()
    try:
        for line, row in card.rows():
            found: list[Key] = []
            if "GENERATE" in card.options:
                numbers = [card.whole(value, line) for value in row]
                step = numbers[2] if len(numbers) > 2 else 1
                if not 2 <= len(numbers) <= 3 or step < 1 or numbers[1] < numbers[0]:
                    raise card.error(row, "first, last and step: last not below first, step above 0", line)
                found.extend(_generated(reading, card, line, range(numbers[0], numbers[1] + 1, step), known))
            else:
                for value in row:
                    found.extend(reading.keys(card, value, line, sets, "a number"))
            chosen.extend(found)
            reading.await_all("node" if name == "NSET" else "element", found, card, line)
    finally:
        reading.scope = outer
    if "UNSORTED" not in card.options:
        chosen[:] = dict.fromkeys(chosen)  # a set has each member once


def _generated(reading: Reading, card: Card, line: int, labels: range, known: Collection[Key]) -> Iterator[Key]:
    """Keys of the labels from a first to a last one, which both are known, and of those between that are.

    All labels are wanted where the ends are not known yet: no more than can be defined after them.
    """
    first, last = labels[0], labels[-1]
    count = (last - first) // labels.step + 1  # len() holds no more than 64 bits
    if reading.key(first) in known and reading.key(last) in known:
        if count <= len(known):
            return (key for key in map(reading.key, labels) if key in known)
        there = ((key, key if isinstance(key, int) else key[1]) for key in known)
        chosen = [(label, key) for key, label in there if label in labels and key == reading.key(label)]
        return (key for _, key in sorted(chosen))
    if count * (len(str(last)) + _LEAST) > MESH:
        found = f"{count} labels from {first} to {last}"
        raise card.error(found, f"no more than files of {megabytes(MESH)} can define", line)
    return map(reading.key, labels)


def on_part(reading: Reading, card: Card) -> None:
    card.allow("NAME")
    reading.part = reading.parts.setdefault(card.need("NAME"), [])


def on_instance(reading: Reading, card: Card) -> None:
    card.allow("NAME", "PART")
    if reading.placed is not None:
        raise card.error("an instance within another", "*END INSTANCE before it")
    name = card.need("PART")
    if name not in reading.parts:
        raise card.error(name, "a part defined before")
    reading.scope = card.need("NAME")
    reading.placed = card, len(reading.coordinates), len(reading.springs) + len(reading.equations)
    for part_card in reading.parts[name]:
        dispatch(reading, part_card)


def on_end_instance(reading: Reading, card: Card) -> None:
    """Put the instance where its data lines say: its nodes, its analytical surfaces and its orientations."""
    if reading.placed is None:
        raise card.error("no instance", "*INSTANCE before it")
    instance, first, constraints = reading.placed
    turn, offset = _placement(instance)
    points = np.array(reading.coordinates[first:]).reshape(-1, 3)
    reading.coordinates[first:] = (points @ turn.T + offset).tolist()
    if not np.array_equal(turn, np.eye(3)):
        reading.turned.append((instance, turn))
        if len(reading.springs) + len(reading.equations) > constraints:
            raise instance.error("a rotation of *SPRING or *EQUATION", "those in the assembly, or no rotation")
    for name, surface in reading.surfaces.items():
        if name.startswith(f"{reading.scope}."):
            surface.move(turn, offset)
    for name, local in reading.orientations.items():
        if name.startswith(f"{reading.scope}."):
            reading.orientations[name] = replace(local, axes=local.axes @ turn.T)
    reading.scope, reading.placed = "", None


def _placement(instance: Card) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and what is added after it, mm: a translation, then a rotation about an axis."""
    from fingerfit.fem.rigid import rotation_matrix

    rows = [[instance.number(v, line) if v else 0.0 for v in row] for line, row in instance.rows()]
    if len(rows) > 2 or len((rows or [[]])[0]) > 3:
        raise instance.error(rows, "a line with a translation, and one with a rotation")
    turn, offset = np.eye(3), np.zeros(3)
    if rows:
        offset[: len(rows[0])] = rows[0]
    if len(rows) > 1:
        row = (rows[1] + [0.0])[:7] if len(rows[1]) > 5 else []
        a, b = np.array(row[:3]), np.array(row[3:6])
        if len(rows[1]) > 7 or not np.any(a != b):
            raise instance.error(rows[1], "two points on the axis and an angle in degrees")
        turn = rotation_matrix(np.deg2rad(row[6]) * (b - a) / np.linalg.norm(b - a))
        offset = a + turn @ (offset - a)
    return turn, offset


def on_assembly(reading: Reading, card: Card) -> None:
    card.allow("NAME")


def on_end_assembly(reading: Reading, card: Card) -> None:
    card.allow()


def dispatch(reading: Reading, card: Card) -> None:
    """Hand a card to its keyword; cards of a part wait for its instances."""
    if reading.part is not None:
        if squeeze(card.name) == "ENDPART":
            reading.part = None
        else:
            reading.part.append(card)
        return
    reading.handle(reading, card)


KEYWORDS: dict[str, Handler] = {
    "NODE": on_node,
    "ELEMENT": on_element,
    "NSET": on_nset,
    "ELSET": on_elset,
    "PART": on_part,
    "INSTANCE": on_instance,
    "END INSTANCE": on_end_instance,
    "ASSEMBLY": on_assembly,
    "END ASSEMBLY": on_end_assembly,
}
