"""A deck as it was understood, written back as keywords: flat, includes and parts in place, numbers in full."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from fingerfit.deck.content import Deck, DeckStep, Law, NodeAxis, Surface
from fingerfit.mesh.elements import AXISYMMETRIC, ELEMENTS

_PER_LINE = 12


def format_deck(deck: Deck) -> str:
    """Text of a deck; reading it again gives the same deck.

    Nodes keep their labels where there are no instances; elements are numbered block by block. What a step changes is
    written in it, not what goes on from the step before.

    Parameters
    ----------
    deck : Deck
        As `fingerfit.deck.reader.read_deck` gives it.
    """
    return "\n".join(_Writer(deck).lines()) + "\n"


def _text(value: Any) -> str:
    return repr(float(value))


def _name(text: str) -> str:
    """A name as a keyword line may have it: in quotes where it has a comma."""
    return f'"{text}"' if "," in text else text


def _row(*values: object) -> str:
    return ", ".join(_text(v) if isinstance(v, (float, np.floating)) else str(v) for v in values)


def _wrapped(values: Sequence[object], most: int = _PER_LINE, goes_on: bool = False) -> Iterator[str]:
    """Data lines of so many values; a comma at the end of those that go on."""
    for at in range(0, len(values), most):
        yield _row(*values[at : at + most]) + "," * (goes_on and at + most < len(values))


class _Writer:
    def __init__(self, deck: Deck) -> None:
        self.deck, self.dim = deck, deck.mesh.dim
        labels = deck.labels or [("", n) for n in range(1, len(deck.mesh.points) + 1)]
        flat = not any(scope for scope, _ in labels)
        self.label = [label if flat else n for n, (_, label) in enumerate(labels, 1)]
        self.renumbered = not flat
        round_about = any(ELEMENTS[block.element].state == AXISYMMETRIC for block in deck.mesh.blocks)
        self.line = "RAX2" if round_about else "R2D2"
        self.next = deck.mesh.element_count + len(deck.springs) + 1
        self.named = {tuple(sorted(nodes.tolist())): name for name, nodes in deck.mesh.node_sets.items()}

    def lines(self) -> Iterator[str]:
        deck = self.deck
        if self.renumbered:
            yield "** nodes of instances are numbered through"
        yield from self._mesh()
        for name, (times, factors) in deck.amplitudes.items():
            yield f"*AMPLITUDE, NAME={_name(name)}"
            yield from _wrapped(np.column_stack([times, factors]).ravel().tolist(), 8)
        for name, material in deck.materials.items():
            yield f"*MATERIAL, NAME={_name(name)}"
            yield from _material(material, deck.warmed.get(name, []))
            if name in deck.expansion:
                yield from ("*EXPANSION", _text(deck.expansion[name]))
        for name, local in deck.orientations.items():
            count = len(local.directions)
            yield f"*ORIENTATION, NAME={_name(name)}" + (f", LOCAL DIRECTIONS={count}" if count else "")
            yield _row(*local.axes[0].tolist(), *local.axes[1].tolist())
            yield from (_row(*direction) for direction in local.directions)
        for section in deck.sections:
            axes = f", ORIENTATION={_name(section.orientation)}" if section.orientation else ""
            yield f"*SOLID SECTION, ELSET={_name(section.elset)}, MATERIAL={_name(section.material)}{axes}"
            yield _text(section.thickness)
        yield from self._springs()
        for name, surface in deck.surfaces.items():
            yield from self._surface(name, surface)
        yield from self._constraints()
        for keyword, given in (("STRESS", deck.stress), ("PLASTIC STRAIN", deck.strain)):
            if given:
                yield f"*INITIAL CONDITIONS, TYPE={keyword}"
                yield from (_row(element + 1, *map(float, values)) for element, values in given.items())
        if deck.temperature:
            yield "*INITIAL CONDITIONS, TYPE=TEMPERATURE"
            yield from (_row(self.label[node], float(value)) for node, value in deck.temperature.items())
        for name, law in deck.laws.items():
            yield f"*SURFACE INTERACTION, NAME={_name(name)}"
            yield from _law(law)
        for pair in deck.contacts:
            kind = "NODE TO SURFACE" if pair.at_nodes else "SURFACE TO SURFACE"
            yield f"*CONTACT PAIR, INTERACTION={_name(pair.interaction)}, TYPE={kind}"
            yield _row(_name(pair.slave), _name(pair.master))
        yield from self._prescribed(deck.fixed, {})
        before = DeckStep(dict(deck.fixed))
        for step in deck.steps:
            yield from self._step(step, before)
            before = step

    def _mesh(self) -> Iterator[str]:
        mesh = self.deck.mesh
        yield "*NODE"
        for label, point in zip(self.label, mesh.points.tolist(), strict=True):
            yield _row(label, *point)
        first = 1
        for block in mesh.blocks:
            yield f"*ELEMENT, TYPE={block.element}"
            for number, nodes in enumerate(block.nodes.tolist(), first):
                yield from _wrapped([number, *(self.label[n] for n in nodes)], 15, goes_on=True)
            first += len(block.nodes)
        for name, nodes in mesh.node_sets.items():
            yield f"*NSET, NSET={_name(name)}"
            yield from _wrapped([self.label[n] for n in nodes])
        for name, elements in mesh.element_sets.items():
            yield f"*ELSET, ELSET={_name(name)}"
            yield from _wrapped([n + 1 for n in elements.tolist()])

    def _free_name(self, stem: str, number: int) -> str:
        mesh, name = self.deck.mesh, f"{stem}-{number}"
        while name in mesh.node_sets or name in mesh.element_sets:
            name += "-"
        return name

    def _springs(self) -> Iterator[str]:
        first = self.deck.mesh.element_count + 1
        for number, spring in enumerate(self.deck.springs, first):
            name, (node, axis) = self._free_name("SPRING", number), spring.first
            ends, axes = [self.label[node]], [axis + 1]
            if spring.second is not None:
                ends.append(self.label[spring.second[0]])
                axes.append(spring.second[1] + 1)
            yield f"*ELEMENT, TYPE=SPRING{len(ends)}, ELSET={name}"
            yield _row(number, *ends)
            yield f"*SPRING, ELSET={name}" + ", NONLINEAR" * bool(spring.table)
            yield _row(*axes)
            yield from (_row(*pair) for pair in spring.table or [(float(spring.stiffness),)])

    def _surface(self, name: str, surface: Surface) -> Iterator[str]:
        rigid = []
        for nodes in surface.facets:
            rigid.append(self.next)
            self.next += 1
            yield f"*ELEMENT, TYPE={self.line if self.dim == 2 else f'R3D{len(nodes)}'}"
            yield _row(rigid[-1], *(self.label[node] for node in nodes))
        yield f"*SURFACE, NAME={_name(name)}, TYPE={surface.kind}"
        yield from (f"{element + 1}, S{face + 1}" for element, face in surface.faces)
        yield from (f"{element}, SPOS" for element in rigid)
        yield from (str(self.label[node]) for node in surface.nodes)
        origin, axes = surface.origin, surface.axes
        if surface.kind in ("CYLINDER", "REVOLUTION") and (origin.any() or not np.array_equal(axes, np.eye(3))):
            along = axes[0] if surface.kind == "CYLINDER" else axes[2]
            yield _row(*origin.tolist(), *(origin + along).tolist())
            if surface.kind == "CYLINDER":
                yield _row(*(origin - axes[2]).tolist())
        yield from (_row(word, *values) for word, values in surface.profile)

    def _constraints(self) -> Iterator[str]:
        deck = self.deck
        for number, body in enumerate(deck.rigid, 1):
            name = self._free_name("RIGID", number)
            options = f"REF NODE={self.label[body.reference]}"
            if body.rotation >= 0:
                options += f", ROT NODE={self.label[body.rotation]}"
            if body.nodes:
                yield f"*NSET, NSET={name}"
                yield from _wrapped([self.label[n] for n in body.nodes])
                options += f", NSET={name}"
            if body.elements:
                yield f"*ELSET, ELSET={name}"
                yield from _wrapped([n + 1 for n in body.elements])
                options += f", ELSET={name}"
            if body.surface:
                options += f", ANALYTICAL SURFACE={_name(body.surface)}"
            yield f"*RIGID BODY, {options}"
        for terms in deck.equations:
            yield "*EQUATION"
            yield str(len(terms))
            yield from (_row(self.label[node], axis + 1, factor) for node, axis, factor in terms)
        for tie in deck.ties:
            tolerance = "" if tie.tolerance is None else f", POSITION TOLERANCE={_text(tie.tolerance)}"
            yield f"*TIE, ADJUST={'YES' if tie.adjust else 'NO'}{tolerance}"
            yield _row(_name(tie.slave), _name(tie.master))

    def _step(self, step: DeckStep, before: DeckStep) -> Iterator[str]:
        sudden = "" if step.sudden is None else f", AMPLITUDE={'STEP' if step.sudden else 'RAMP'}"
        yield f"*STEP, NLGEOM={'YES' if step.finite else 'NO'}, INC=1000000{sudden}"
        options = ", DIRECT" * step.fixed + ", LONG TERM" * step.relaxed
        yield ("*VISCO" if step.viscous else "*STATIC") + options
        yield f"{_text(step.increment * step.period)}, {_text(step.period)}, , {_text(step.largest * step.period)}"
        curves = {kind: {key: name for (k, key), name in step.curve.items() if k == kind} for kind in "UFTP"}
        held = self._ends(before, "U", _without(before.displacement, before.kept | step.kept))
        operation, prescribed = _operation(_without(step.displacement, step.kept), held, curves["U"])
        kept = dict.fromkeys(sorted(step.kept if operation else step.kept - before.kept), 0.0)
        yield from self._grouped("BOUNDARY", operation, prescribed, curves["U"])
        if kept:
            yield "*BOUNDARY, FIXED"
            yield from (_row(self.label[node], axis + 1, axis + 1) for node, axis in kept)
        operation, forces = _operation(step.force, self._ends(before, "F", before.force), curves["F"])
        yield from self._grouped("CLOAD", operation, forces, curves["F"])
        operation, warm = _operation(step.temperature, self._ends(before, "T", before.temperature), curves["T"])
        yield from self._grouped("TEMPERATURE", operation, warm, curves["T"])
        operation, pressures = _operation(step.pressure, self._ends(before, "P", before.pressure), curves["P"])
        for name in [None, *dict.fromkeys(curves["P"].values())]:
            chosen = {face: value for face, value in pressures.items() if curves["P"].get(face) == name}
            if chosen or (operation and name is None):
                yield f"*DLOAD{operation}" + (f", AMPLITUDE={_name(name)}" if name else "")
                operation = ""
                yield from (_row(e + 1, f"P{face + 1}", float(value)) for (e, face), value in chosen.items())
        yield "*END STEP"

    def _ends(self, step: DeckStep, kind: str, values: Mapping[Any, float]) -> dict[Any, float]:
        """What loads are at the end of a step, as the reader takes them into the next one."""
        found = dict(values)
        for key in found:
            name = step.curve.get((kind, key))
            if name is not None:
                found[key] *= float(np.interp(step.period, *self.deck.amplitudes[name]))
        return found

    def _prescribed(self, values: Mapping[NodeAxis, float], curve: Mapping[NodeAxis, str]) -> Iterator[str]:
        yield from self._grouped("BOUNDARY", "", values, curve)

    def _grouped(
        self, keyword: str, operation: str, values: Mapping[NodeAxis, float], curve: Mapping[NodeAxis, str]
    ) -> Iterator[str]:
        """Loads with the same value at the same axis together, by the name of their node set where there is one."""
        groups: dict[tuple[str | None, int, float], list[int]] = {}
        for (node, axis), value in values.items():
            groups.setdefault((curve.get((node, axis)), axis, float(value)), []).append(node)
        names = dict.fromkeys([None] * bool(operation) + [name for name, _, _ in groups])
        for name in names:
            yield f"*{keyword}{operation}" + (f", AMPLITUDE={_name(name)}" if name else "")
            operation = ""
            for (of, axis, value), nodes in groups.items():
                if of == name:
                    axes = (axis + 1,) * {"BOUNDARY": 2, "CLOAD": 1}.get(keyword, 0)
                    yield from (_row(who, *axes, value) for who in self._who(nodes))

    def _who(self, nodes: Iterable[int]) -> list[object]:
        nodes = list(nodes)
        name = self.named.get(tuple(sorted(nodes)))
        return [_name(name)] if name else [self.label[node] for node in nodes]


def _changed(now: Mapping[Any, float], before: Mapping[Any, float], curve: Mapping[Any, str]) -> dict[Any, float]:
    return {key: value for key, value in now.items() if key in curve or before.get(key) != value}


def _without(values: Mapping[Any, float], left_out: Collection[Any]) -> dict[Any, float]:
    return {key: value for key, value in values.items() if key not in left_out}


def _operation(
    now: Mapping[Any, float], before: Mapping[Any, float], curve: Mapping[Any, str]
) -> tuple[str, dict[Any, float]]:
    """OP=NEW with all loads where some are gone, else those that change."""
    if set(before) - set(now):
        return ", OP=NEW", dict(now)
    return "", _changed(now, before, curve)


def _law(law: Law) -> Iterator[str]:
    options = "" if law.separates else ", NO SEPARATION"
    if law.stiffness:
        yield f"*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR{options}"
        yield _text(law.stiffness)
    elif law.hard:
        yield f"*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD{options}"
    if law.rough:
        yield "*FRICTION, ROUGH"
    elif law.friction:
        yield "*FRICTION"
        yield _row(float(law.friction), float(law.stick))


def _hyperelastic(material: Any) -> tuple[str, list[float]]:
    """The energy as an option of its keyword, and its constants."""
    kind = type(material).__name__
    order = {"Ogden": lambda m: len(m.mu), "Yeoh": lambda m: len(m.c)}.get(kind, lambda m: 1)(material)
    name, constants = {
        "Ogden": lambda m: (f"OGDEN, N={order}", [x for pair in zip(m.mu, m.alpha, strict=True) for x in pair]),
        "NeoHooke": lambda m: ("NEO HOOKE", [m.c10]),
        "MooneyRivlin": lambda m: ("MOONEY-RIVLIN", [m.c10, m.c01]),
        "Yeoh": lambda m: ("YEOH" if order == 3 else f"REDUCED POLYNOMIAL, N={order}", list(m.c)),
    }[kind](material)
    return name, [*constants, *[*material.d, *[0.0] * order][:order]]


def _material(material: Any, warmed: Sequence[tuple[float | None, Any]]) -> Iterator[str]:
    kind, prony = type(material).__name__, material.prony
    moduli = ", MODULI=INSTANTANEOUS" if prony is not None and prony.instantaneous else ""
    if kind == "Elastic":
        yield f"*ELASTIC{moduli}"
        yield _row(material.young, material.poisson)
    elif kind == "Holzapfel":
        yield f"*ANISOTROPIC HYPERELASTIC, HOLZAPFEL, LOCAL DIRECTIONS={len(material.directions)}{moduli}"
        yield _row(material.c10, material.d, material.k1, material.k2, material.kappa)
    elif kind == "Marlow":
        yield f"*HYPERELASTIC, MARLOW{moduli}"
        yield "*UNIAXIAL TEST DATA"
        for temperature, one in warmed or [(None, material)]:
            for strain, stress in zip(one.strain, one.stress, strict=True):
                yield _row(stress, strain, *([] if temperature is None else ["", temperature]))
        yield "*VOLUMETRIC TEST DATA"
        yield _row(2 / material.d[0], 0.0)
    else:
        name, _ = _hyperelastic(material)
        yield f"*HYPERELASTIC, {name}{moduli}"
        for temperature, one in warmed or [(None, material)]:
            yield from _wrapped([*_hyperelastic(one)[1], *([] if temperature is None else [temperature])], 8)
    if prony is not None and prony.g:
        yield "*VISCOELASTIC, TIME=PRONY"
        yield from map(_row, prony.g, prony.k or [0.0] * len(prony.g), prony.tau)
