"""Keywords of constraints, surfaces, contact, springs and the initial state."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fingerfit.deck.cards import Card, squeeze
from fingerfit.deck.content import ContactPair, Law, Surface, Table, Tie
from fingerfit.deck.state import SNEG, SPOS, Handler, Key, Reading

ANALYTICAL = ("SEGMENTS", "CYLINDER", "REVOLUTION")


def on_equation(reading: Reading, card: Card) -> None:
    card.allow()
    rows = card.rows(least=1)
    for line, row in rows:
        count, terms = card.whole(row[0], line), list[tuple[list[int], int, float]]()
        while len(terms) < count:
            line, row = next(rows, (line, []))
            if not row or len(row) % 3:
                raise card.error(f"{len(terms)} terms", f"{count} terms of node, axis and factor", line)
            for at in range(0, len(row), 3):
                node, axis, factor = row[at : at + 3]
                value = card.number(factor, line)
                terms.append((reading.nodes(card, node, line), reading.axis(card, axis, line), value))
                reading.used.extend((card, line, (n, terms[-1][1])) for n in terms[-1][0])
        if count < 1 or terms[0][2] == 0:
            raise card.error("no term, or factor 0", "one term or more, a factor other than 0 in the first one", line)
        length = max(len(nodes) for nodes, _, _ in terms)
        if any(len(nodes) not in (1, length) for nodes, _, _ in terms) or len(terms[0][0]) != length:
            raise card.error("sets of unlike length", "single nodes, or sets of as many nodes as the first", line)
        for n in range(length):
            reading.equations.append([(nodes[n if len(nodes) > 1 else 0], a, f) for nodes, a, f in terms])


def on_rigid_body(reading: Reading, card: Card) -> None:
    card.allow("REF NODE", "ROT NODE", "NSET", "ELSET", "PIN NSET", "TIE NSET", "ANALYTICAL SURFACE", "POSITION")
    if card.options.get("POSITION", "INPUT").upper() != "INPUT":
        raise card.error(card.options["POSITION"], "INPUT")
    reference = _single(reading, card, "REF NODE")
    rotation = _single(reading, card, "ROT NODE") if "ROT NODE" in card.options else -1
    nodes: list[int] = []
    # what is pinned may turn by itself, but nodes of solids have no rotation
    for option in ("NSET", "PIN NSET", "TIE NSET"):
        if option in card.options:
            nodes += reading.nodes(card, card.options[option], card.line)
    elements: list[Key] = []
    if "ELSET" in card.options:
        elements = reading.keys(card, card.options["ELSET"], card.line, reading.elsets, "an element")
    surface = ""
    if "ANALYTICAL SURFACE" in card.options:
        surface = _surface(reading, card, card.options["ANALYTICAL SURFACE"], card.line)
    reading.rigid.append((reference, rotation, nodes, elements, surface))


def _single(reading: Reading, card: Card, option: str) -> int:
    card.need(option)
    found = reading.nodes(card, card.options[option], card.line)
    if len(found) != 1:
        raise card.error(f"{len(found)} nodes", f"a single node as {option}")
    return found[0]


def on_surface(reading: Reading, card: Card) -> None:
    card.allow("NAME", "TYPE", "INTERNAL", "FILLET RADIUS")
    kind, name = card.options.get("TYPE", "ELEMENT").upper(), reading.name(card.need("NAME"))
    surface = Surface(kind)
    if kind in ANALYTICAL:
        _profile(card, surface, bool(reading.scope))
    elif kind == "NODE":
        for line, row in card.rows(least=1):
            surface.nodes += reading.nodes(card, row[0], line)
    elif kind == "ELEMENT":
        faces = reading.faces.setdefault(name, [])
        for line, row in card.rows(least=1):
            face = None
            if len(row) > 1 and row[1]:
                face = _face(card, row[1], line)
            for key in reading.keys(card, row[0], line, reading.elsets, "an element"):
                faces.append((key, face))
                reading.where.setdefault((key, face), (card, line))
    else:
        raise card.error(kind, "ELEMENT, NODE, " + ", ".join(ANALYTICAL))
    reading.surfaces[name] = surface


def _face(card: Card, text: str, line: int) -> int:
    if text.upper() in ("SPOS", "SNEG"):
        return SPOS if text.upper() == "SPOS" else SNEG
    if text[:1].upper() not in ("S", "P") or not text[1:].isdigit() or not 1 <= int(text[1:]) <= 6:
        raise card.error(text, "a face S1 to S6, or SPOS or SNEG of rigid elements", line)
    return int(text[1:]) - 1


def _profile(card: Card, surface: Surface, in_part: bool) -> None:
    """Read a profile and its local system; without one, a surface of a part turns about the part's axis y."""
    frame: list[list[float]] = []
    for line, row in card.rows():
        word = row[0].upper() if row else ""
        if word in ("START", "LINE", "CIRCL"):
            values = [card.number(v, line) for v in row[1:]]
            if len(values) != (4 if word == "CIRCL" else 2):
                raise card.error(row, "START, LINE: x, y; CIRCL: x, y and the centre's x, y", line)
            surface.profile.append((word, values))
            if len(surface.profile) > 2:
                raise card.error(
                    "a second segment", "START and one LINE or CIRCL; a mesh of rigid elements may have any shape", line
                )
        elif surface.profile or word[:1].isalpha():
            raise card.error(row, "START, LINE or CIRCL", line)
        else:
            frame.append([card.number(v, line) if v else 0.0 for v in row])
    if len(surface.profile) != 2 or surface.profile[0][0] != "START" or surface.profile[1][0] == "START":
        raise card.error("another profile", "START and one LINE or CIRCL")
    if surface.kind == "SEGMENTS":
        return
    if not any(frame):
        if surface.kind == "REVOLUTION" and in_part:
            surface.axes = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        return
    places = np.array([[*row, *[0.0] * 6][:6] for row in frame])
    a, b = places[0, :3], places[0, 3:]
    if len(frame) != (2 if surface.kind == "CYLINDER" else 1) or not np.any(a != b):
        raise card.error(frame, "two points, and a third on the next line for a cylinder")
    first = (b - a) / np.linalg.norm(b - a)
    if surface.kind == "CYLINDER":
        # ABAQUS's local axes are right-handed with z against the generator
        z = a - places[1, :3]
        if np.linalg.norm(np.cross(first, z)) <= 1e-9 * np.linalg.norm(z):
            raise card.error(frame, "a third point that is not in line with the first two")
        z /= np.linalg.norm(z)
        surface.axes = np.array([first, np.cross(z, first), z])
    else:  # local r anywhere across the axis of revolution, local z along it
        helper = np.eye(3)[int(np.abs(first).argmin())]
        x = np.cross(helper, first)
        x /= np.linalg.norm(x)
        surface.axes = np.array([x, np.cross(first, x), first])
    surface.origin = a


def _surface(reading: Reading, card: Card, text: str, line: int) -> str:
    found = reading.find(reading.surfaces, text)
    if found is None:
        raise card.error(text, "a surface defined before", line)
    return found


def on_surface_interaction(reading: Reading, card: Card) -> None:
    card.allow("NAME")
    reading.law = card.need("NAME")
    reading.laws[reading.law] = Law()


def _law(reading: Reading, card: Card) -> Law:
    if not reading.law:
        raise card.error("no interaction", "*SURFACE INTERACTION before it")
    return reading.laws[reading.law]


def on_surface_behavior(reading: Reading, card: Card) -> None:
    card.allow("PRESSURE-OVERCLOSURE", "NO SEPARATION")
    law = _law(reading, card)
    law.separates = law.separates and "NO SEPARATION" not in card.options
    if "PRESSURE-OVERCLOSURE" not in card.options and not law.separates:
        return
    kind = card.options.get("PRESSURE-OVERCLOSURE", "HARD").upper()
    if kind not in ("LINEAR", "HARD"):
        raise card.error(kind, "PRESSURE-OVERCLOSURE=LINEAR or HARD")
    law.hard = kind == "HARD"
    if law.hard:
        law.stiffness = 0.0
        card.values(0, 0)
        return
    law.stiffness = card.values(1, 3)[0]
    if law.stiffness <= 0:
        raise card.error(law.stiffness, "a slope above 0")


def on_friction(reading: Reading, card: Card) -> None:
    card.allow("ROUGH", "SLIP TOLERANCE")
    law = _law(reading, card)
    if "SLIP TOLERANCE" in card.options and card.number(card.options["SLIP TOLERANCE"], card.line) <= 0:
        raise card.error(card.options["SLIP TOLERANCE"], "a slip tolerance above 0")
    if "ROUGH" in card.options:
        law.rough = True
        return
    values = card.values(1, 2)
    law.friction, law.stick = values[0], values[1] if len(values) > 1 else 0.0
    if law.friction < 0 or law.stick < 0:
        raise card.error(values, "a coefficient and a stick slope from 0 up")


def on_contact_pair(reading: Reading, card: Card) -> None:
    card.allow("INTERACTION", "TYPE", "ADJUST", "SMALL SLIDING")
    if "SMALL SLIDING" in card.options or "ADJUST" in card.options:
        raise card.error("SMALL SLIDING or ADJUST", "finite sliding from the positions given")
    kind = card.options.get("TYPE", "NODE TO SURFACE").upper()
    if kind not in ("NODE TO SURFACE", "SURFACE TO SURFACE"):
        raise card.error(kind, "NODE TO SURFACE or SURFACE TO SURFACE")
    for line, row in card.rows():
        if len(row) != 2:
            raise card.error(row, "slave and master surface", line)
        slave, master = (_surface(reading, card, text, line) for text in row)
        at_nodes = kind == "NODE TO SURFACE"
        reading.contacts.append((ContactPair(slave, master, card.need("INTERACTION"), at_nodes), card))


def on_tie(reading: Reading, card: Card) -> None:
    card.allow("NAME", "POSITION TOLERANCE", "ADJUST", "TYPE")
    tolerance = None
    if "POSITION TOLERANCE" in card.options:
        tolerance = card.number(card.options["POSITION TOLERANCE"], card.line)
    for option, allowed in (("TYPE", ("NODE TO SURFACE", "SURFACE TO SURFACE")), ("ADJUST", ("YES", "NO"))):
        if card.options.get(option, allowed[0]).upper() not in allowed:
            raise card.error(f"{option}={card.options[option]}", " or ".join(allowed))
    adjust = card.options.get("ADJUST", "YES").upper() == "YES"
    for line, row in card.rows():
        if len(row) != 2:
            raise card.error(row, "slave and master surface", line)
        slave, master = (_surface(reading, card, text, line) for text in row)
        reading.ties.append(Tie(slave, master, tolerance, adjust))


def on_spring(reading: Reading, card: Card) -> None:
    card.allow("ELSET", "NONLINEAR")
    rows = [(line, [v for v in row if v]) for line, row in card.rows()]
    bent = "NONLINEAR" in card.options
    if not rows or len(rows[0][1]) not in (1, 2) or not (bent or (len(rows) == 2 and len(rows[1][1]) == 1)):
        second = "lines of force and relative displacement" if bent else "the stiffness"
        raise card.error(f"{len(rows)} lines", f"the axis (two for SPRING2), then {second}")
    axes = [reading.axis(card, text, rows[0][0]) for text in rows[0][1]]
    stiffness, table = 0.0, _force_table(card) if bent else ()
    if not bent:
        stiffness = card.number(rows[1][1][0], rows[1][0])
    reading.springs.append((reading.name(card.need("ELSET")), axes, stiffness, table, card))


def _force_table(card: Card) -> Table:
    """Force and relative displacement of each line below the axes."""
    found: list[tuple[float, float]] = []
    for line, row in list(card.rows())[1:]:
        if len(row) != 2 or not all(row):
            raise card.error(", ".join(row) or "an empty line", "force and relative displacement", line)
        force, moved = (card.number(text, line) for text in row)
        if found and moved <= found[-1][1]:
            raise card.error(f"displacement {moved:g} after {found[-1][1]:g}", "displacements that ascend", line)
        found.append((force, moved))
    if len(found) < 2:
        raise card.error(f"{len(found)} lines of force and relative displacement", "two or more")
    return tuple(found)


def on_initial_conditions(reading: Reading, card: Card) -> None:
    """Temperature by node; stress or, as in CalculiX, strain without stress, by element.

    These may be given by integration point if those of an element are alike.
    """
    card.allow("TYPE")
    kind = card.options.get("TYPE", "nothing").upper()
    if kind == "TEMPERATURE":
        reading.temperature |= reading.by_node(card)
        return
    if squeeze(kind) not in ("STRESS", "PLASTICSTRAIN"):
        raise card.error(kind, "TYPE=STRESS, TYPE=PLASTIC STRAIN or TYPE=TEMPERATURE")
    target = reading.stress if squeeze(kind) == "STRESS" else reading.strain
    points: set[Key] = set()
    for line, row in card.rows(least=1):
        values = [card.number(v, line) if v else 0.0 for v in row[1:]]
        chosen = reading.keys(card, row[0], line, reading.elsets, "an element")
        reading.await_all("element", chosen, card, line)
        by_point = len(values) == 7
        if by_point:
            values = values[1:]
        elif len(values) > 6:
            raise card.error(row, "an element and 11, 22, 33, 12, 13, 23", line)
        values += [0.0] * (6 - len(values))
        for key in chosen:
            if by_point and key in points and target[key] != values:
                raise card.error(row, "the same at all points of an element", line)
            target[key] = values
        points |= set(chosen) if by_point else set()


def on_amplitude(reading: Reading, card: Card) -> None:
    card.allow("NAME", "DEFINITION", "TIME", "VALUE")
    for option, only in (("DEFINITION", "TABULAR"), ("TIME", "STEP TIME"), ("VALUE", "RELATIVE")):
        if card.options.get(option, only).upper() != only:
            raise card.error(card.options[option], f"{option}={only}")
    values = card.values(2)
    times, factors = np.array(values[::2]), np.array(values[1::2])
    if len(values) % 2 or any(b <= a for a, b in pairwise(times)):
        raise card.error("another table", "pairs of time and factor, times growing")
    reading.amplitudes[card.need("NAME")] = times, factors


KEYWORDS: dict[str, Handler] = {
    "EQUATION": on_equation,
    "RIGID BODY": on_rigid_body,
    "SURFACE": on_surface,
    "SURFACE INTERACTION": on_surface_interaction,
    "SURFACE BEHAVIOR": on_surface_behavior,
    "FRICTION": on_friction,
    "CONTACT PAIR": on_contact_pair,
    "TIE": on_tie,
    "SPRING": on_spring,
    "INITIAL CONDITIONS": on_initial_conditions,
    "AMPLITUDE": on_amplitude,
}
