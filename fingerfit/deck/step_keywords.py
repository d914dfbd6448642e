"""Keywords of steps and loads."""

from __future__ import annotations

import numpy as np

from fingerfit.deck.cards import Card
from fingerfit.deck.content import DeckStep
from fingerfit.deck.state import Handler, Key, Pressed, Reading

_SYMMETRY = {
    "XSYMM": (0, 4, 5),
    "YSYMM": (1, 3, 5),
    "ZSYMM": (2, 3, 4),
    "PINNED": (0, 1, 2),
    "ENCASTRE": (0, 1, 2, 3, 4, 5),
}


def on_step(reading: Reading, card: Card) -> None:
    card.allow("NLGEOM", "INC", "NAME", "AMPLITUDE", "UNSYMM", "EXTRAPOLATION")
    if reading.step is not None:
        raise card.error("a step within a step", "*END STEP before it")
    finite = card.flag("NLGEOM")
    if reading.finite is True and "NLGEOM" not in card.options:
        finite = True
    if reading.finite is not None and reading.finite != finite:
        raise card.error("steps with and without NLGEOM", "one of both in all steps")
    reading.finite = finite
    last = reading.steps[-1] if reading.steps else DeckStep(dict(reading.fixed))
    reading.step = DeckStep(_ends(reading, last, "U", last.displacement), _ends(reading, last, "F", last.force))
    reading.step.temperature = _ends(reading, last, "T", last.temperature)
    reading.step.kept = set(last.kept)
    reading.step.finite = finite
    reading.step.printed = last.printed
    before = reading.pressures[-1] if reading.pressures else {}
    ends: dict[tuple[Key, int | None], Pressed] = {
        face: (_end(reading, last, value, name), None, by) for face, (value, name, by) in before.items()
    }
    reading.pressures.append(ends)
    reading.older = {"BOUNDARY": set(reading.step.displacement), "CLOAD": set(reading.step.force)}
    reading.older["TEMPERATURE"] = set(reading.step.temperature)
    for keyword in ("DLOAD", "DSLOAD"):
        reading.older[keyword] = {face for face, (_, _, by) in ends.items() if by == keyword}
    amplitude = card.options.get("AMPLITUDE", "").upper()
    if amplitude not in ("", "RAMP", "STEP"):
        raise card.error(amplitude, "RAMP or STEP")
    reading.step.sudden = {"": None, "RAMP": False, "STEP": True}[amplitude]


def _ends(reading: Reading, step: DeckStep, kind: str, values: dict) -> dict:
    """What loads are at the end of a step, their amplitudes taken into account."""
    return {key: _end(reading, step, value, step.curve.get((kind, key))) for key, value in values.items()}


def _end(reading: Reading, step: DeckStep, value: float, name: str | None) -> float:
    return value if name is None else value * float(np.interp(step.period, *reading.amplitudes[name]))


def _procedure(reading: Reading, card: Card) -> DeckStep:
    step = reading.step
    if step is None:
        raise card.error("no step", "*STEP before it")
    for line, row in card.rows():
        values = [card.number(v, line) if v else 0.0 for v in row]
        if len(values) > 1 and values[1] > 0:
            step.period = values[1]
            step.increment = min(1.0, values[0] / values[1]) if values[0] > 0 else 1.0
            if len(values) > 3 and values[3] > 0:
                step.largest = min(1.0, values[3] / values[1])
    step.fixed = "DIRECT" in card.options
    return step


def on_static(reading: Reading, card: Card) -> None:
    card.allow("DIRECT", "SOLVER", "LONG TERM")
    _procedure(reading, card).relaxed = "LONG TERM" in card.options


def on_visco(reading: Reading, card: Card) -> None:
    """Time passes; loads are there at once unless *STEP says AMPLITUDE=RAMP."""
    card.allow("DIRECT", "SOLVER", "CETOL")
    step = _procedure(reading, card)
    step.viscous = True
    if step.sudden is None:
        step.sudden = True


def _curve(reading: Reading, card: Card) -> str | None:
    if "AMPLITUDE" not in card.options:
        return None
    name = card.need("AMPLITUDE")
    if name not in reading.amplitudes:
        raise card.error(name, "an amplitude defined before")
    return name


def on_boundary(reading: Reading, card: Card) -> None:
    card.allow("OP", "TYPE", "AMPLITUDE", "FIXED")
    if card.options.get("TYPE", "DISPLACEMENT").upper() != "DISPLACEMENT":
        raise card.error(card.options["TYPE"], "DISPLACEMENT")
    step, curve, kept = reading.step, _curve(reading, card), card.flag("FIXED")
    if step is not None:
        _renew(reading, card, step.displacement)
        step.kept &= step.displacement.keys()
    if kept and step is None:
        raise card.error("FIXED before any step", "it in a step, of what moved in the steps before it")
    target = step.displacement if step else reading.fixed
    for line, row in card.rows():
        if len(row) < 2:
            raise card.error(row, "a node, axes and a value", line)
        name = row[1].upper()
        if name in _SYMMETRY:
            axes, value = _SYMMETRY[name], 0.0
        else:
            first = reading.axis(card, row[1], line)
            last = reading.axis(card, row[2], line) if len(row) > 2 and row[2] else first
            if last < first:
                raise card.error(row, "a last axis not below the first", line)
            axes, value = tuple(range(first, last + 1)), card.number(row[3], line) if len(row) > 3 else 0.0
        if kept and value:
            raise card.error(row, "no value where FIXED keeps what there is", line)
        for node in reading.nodes(card, row[0], line):
            for axis in axes:
                target[node, axis] = value
                if step is not None:
                    (step.kept.add if kept else step.kept.discard)((node, axis))
                _remember(reading, card, "U", (node, axis), curve)
                if value and axis > 1:
                    # zero is what a node without this axis has anyway
                    reading.used.append((card, line, (node, axis)))


def _renew(reading: Reading, card: Card, values: dict) -> None:
    """With OP=NEW, let go what this keyword gave in earlier steps, and in the model; what this step gave stays."""
    operation = card.options.get("OP", "MOD").upper()
    if operation not in ("MOD", "NEW"):
        raise card.error(operation, "OP=MOD or OP=NEW")
    if operation == "NEW":
        for key in reading.older[card.name]:
            del values[key]
        reading.older[card.name].clear()


def _remember(reading: Reading, card: Card, kind: str, key: tuple[int, int], curve: str | None) -> None:
    """Note that a load is of the present step, and its amplitude."""
    step = reading.step
    if step is not None:
        reading.older[card.name].discard(key)
        step.curve.pop((kind, key), None)
        if curve is not None:
            step.curve[kind, key] = curve


def on_cload(reading: Reading, card: Card) -> None:
    card.allow("OP", "AMPLITUDE")
    step, curve = reading.step, _curve(reading, card)
    if step is None:
        raise card.error("no step", "*STEP before it")
    _renew(reading, card, step.force)
    for line, row in card.rows():
        if len(row) != 3:
            raise card.error(row, "a node, an axis and a force", line)
        for node in reading.nodes(card, row[0], line):
            key = node, reading.axis(card, row[1], line)
            reading.used.append((card, line, key))
            step.force[key] = card.number(row[2], line)
            _remember(reading, card, "F", key, curve)


def on_temperature(reading: Reading, card: Card) -> None:
    card.allow("OP", "AMPLITUDE")
    step, curve = reading.step, _curve(reading, card)
    if step is None:
        raise card.error("no step", "*STEP before it")
    _renew(reading, card, step.temperature)
    for node, value in reading.by_node(card).items():
        step.temperature[node, 0] = value
        _remember(reading, card, "T", (node, 0), curve)


def on_dload(reading: Reading, card: Card) -> None:
    """Pressure on faces of elements."""
    card.allow("OP", "AMPLITUDE")
    curve = _begin_pressures(reading, card)
    for line, row in card.rows():
        if len(row) != 3 or row[1][:1].upper() != "P" or not row[1][1:].isdigit():
            raise card.error(row, "an element, P1 to P6 and a pressure", line)
        for key in reading.keys(card, row[0], line, reading.elsets, "an element"):
            face = key, int(row[1][1:]) - 1
            reading.where.setdefault(face, (card, line))
            _press(reading, card, line, face, row[2], curve)


def on_dsload(reading: Reading, card: Card) -> None:
    """Pressure on a surface."""
    card.allow("OP", "AMPLITUDE")
    curve = _begin_pressures(reading, card)
    for line, row in card.rows():
        if len(row) != 3 or row[1].upper() != "P":
            raise card.error(row, "a surface, P and a pressure", line)
        found = reading.find(reading.faces, row[0])
        if found is None:
            raise card.error(row[0], "a surface of elements defined before", line)
        for face in reading.faces[found]:
            _press(reading, card, line, face, row[2], curve)


def _begin_pressures(reading: Reading, card: Card) -> str | None:
    """Name of the amplitude, after OP=NEW."""
    if reading.step is None:
        raise card.error("no step", "*STEP before it")
    _renew(reading, card, reading.pressures[-1])
    return _curve(reading, card)


def _press(
    reading: Reading, card: Card, line: int, face: tuple[Key, int | None], value: str, curve: str | None
) -> None:
    pressures = reading.pressures[-1]
    if face in pressures and pressures[face][2] != card.name:
        raise card.error(f"a face with *{pressures[face][2]} too", "one of both on each face", line)
    reading.older[card.name].discard(face)
    pressures[face] = card.number(value, line), curve, card.name


def on_node_print(reading: Reading, card: Card) -> None:
    """What is printed changes nothing, but a step that prints all nodes is one of those whose results count."""
    if reading.step is not None and card.options.get("NSET", "").upper() == "ALL":
        reading.step.printed = True


def on_end_step(reading: Reading, card: Card) -> None:
    if reading.step is None:
        raise card.error("no step", "*STEP before it")
    reading.steps.append(reading.step)
    reading.step = None


KEYWORDS: dict[str, Handler] = {
    "STEP": on_step,
    "STATIC": on_static,
    "VISCO": on_visco,
    "BOUNDARY": on_boundary,
    "CLOAD": on_cload,
    "TEMPERATURE": on_temperature,
    "DLOAD": on_dload,
    "DSLOAD": on_dsload,
    "NODE PRINT": on_node_print,
    "END STEP": on_end_step,
}
