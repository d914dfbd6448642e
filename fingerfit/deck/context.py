"""What a deck's template may name: the study, the mesh, the guess and what effects change in them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.changed import changed_by
from fingerfit.deck.loading import ageing, course_of, direction, from_rest, loading_steps, rail
from fingerfit.deck.patch import ball, half_tube
from fingerfit.deck.pieces import Own, comes_down, compressibility, pieces_of
from fingerfit.deck.questions import (
    areas,
    elements,
    lengths,
    nodes_of,
    only,
    quadratic,
    rests_on,
    shares,
    side,
    strips,
)
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.catalogue import catalogue
from fingerfit.model.effect import CONSTANTS, LAYER, Effect
from fingerfit.model.formulas import evaluate
from fingerfit.model.laws import LAWS, OGDEN
from fingerfit.model.scales import bound, extent, scales
from fingerfit.study.study import Study

PARTS = 10
"""Parts number what they add by multiples of `beyond` up to this one; from there on there are rigid surfaces of bricks,
each with room for `PATCH` numbers, and elements that parts have once more."""
PATCH = 10_000
"""More than the nodes of any rigid surface of bricks: those of a sphere, 30 along each side, have 1922. A choice."""
STIFFNESS = 12.5
"""Pressure at which a contact is the indenter's radius deep, MPa: 5 MPa/mm for a radius of 2.5 mm, as the fingertip was
fitted with. A stress, and a choice (docs/decisions/0017-blocks-and-shares.md)."""
ESTABLISHED = 0.12
"""Way on which solvers that need it find the contact first, as a share of the indenter's radius: 0.3 mm of 2.5 mm."""


def deck_context(
    study: Study,
    mesh: Mesh,
    mesh_name: str,
    values: Mapping[str, float],
    material: Mapping[str, float],
    effects: Mapping[str, Effect] | None = None,
    law: str = OGDEN,
) -> dict[str, Any]:
    """Everything that a template may name.

    Parameters
    ----------
    study : Study
        Gives layers, thickness, boundary, control and steps.
    mesh : Mesh
        Gives dimension, elements, and nodes of base and indenter.
    mesh_name : str
        What the deck includes.
    values : mapping
        The guess.
    material : mapping
        Fixed constants; the guess goes first.
    effects : mapping, optional
        All effects that templates may name, ours when left out; those whose values are null change nothing. Shares
        become numbers of this study.
    law : str
        One of `LAWS`; the guess or the fixed constants give each of its constants, for all layers or as ``mu_top`` for
        one.

    Returns
    -------
    dict
        ``title, law, mesh, dim, quadratic, thickness, control, boundary, steps, way, rail, warms, swells,
        increment, top, indenter, layers, effects, parts, from_rest, beside``, ``values`` for templates
        with parameters of their own, and what templates may call: ``fills(block)`` and ``replaced(block)`` for what
        effects do to a block, ``areas(set)``, ``aside(node)``, ``elements(layer)``, ``lengths(set)``, ``shares()``,
        ``strips(set)``, ``side(way)``, ``nodes(set)``, ``node(set)`` and ``point(set)`` of a set of one node,
        ``resting(surface, x, y, radius)`` for the centre of a sphere that touches it from above, and
        ``ball(centre, radius, count)`` and ``half_tube(axis, radius, count)`` of bricks.
    """
    effects = bound(
        catalogue() if effects is None else effects, scales(study, np.ptp(mesh.body, axis=0)), study.control
    )
    present = [effect for effect in effects.values() if effect.present(values)]
    check_blocks(present)
    check_layers(present, values, len(study.layer_names))
    indenter, ages = int(mesh.node_sets["INDENTER"][0]), ageing(study, present, values)
    layers = [
        _layer(number, len(study.layer_names), name, values, material, present, law)
        for number, name in enumerate(study.layer_names, 1)
    ]
    increment = changed_by("increment", 1.0, {}, present, values)
    steps, way = loading_steps(study, mesh, present, values, ages=bool(ages.any())), direction(study, mesh.dim)
    pieces = pieces_of(layers, mesh, present, values, _regions(study, mesh, layers, values, material, present, law))
    # solvers set memory aside up to the highest number: those of parts are just above those of the mesh
    beyond = 10 ** len(str(max(len(mesh.points), mesh.element_count)))
    patch = PARTS * beyond + 1
    numbers = itertools.count(patch + 2 * PATCH)  # of one part after the other
    thickness = study.thickness if mesh.dim == 2 else None
    return {
        "title": study.title,
        "law": law,
        "mesh": mesh_name,
        "dim": mesh.dim,
        "quadratic": quadratic(mesh),
        "thickness": thickness,
        "control": study.control,
        "boundary": {"base": study.base, "indenter": study.indenter},
        "steps": steps,
        "way": way,
        "rail": rail(study, way),
        "warms": any(step["temperature"] for step in steps),
        "swells": any(step["temperature"] for step in steps) and not ages.any(),
        "increment": "1." if increment == 1 else f"{increment:.6g}",
        "top": [int(node) + 1 for node in mesh.node_sets["TOP"]],
        "indenter": indenter + 1,
        "layers": [{**piece, "course": course_of(ages[piece["number"] - 1])} for piece in pieces],
        "values": {**_contact(mesh), **values},
        "effects": {name: effect.own(values) for name, effect in effects.items()},
        "parts": [effect.part for effect in present if effect.part],
        "fills": lambda block: [effect.fills[block] for effect in present if block in effect.fills],
        "replaced": lambda block: any(block in effect.replaces for effect in present),
        "from_rest": from_rest(study, present),
        "beside": {axis: float(changed_by(f"beside_{axis}", 0.0, {}, present, values)) for axis in "xy"},
        "areas": lambda name: areas(mesh, mesh.node_sets[name], thickness or 1.0),
        "aside": lambda node: float(mesh.points[node - 1, 0] - mesh.points[indenter, 0]),
        "beyond": beyond,
        "elements": lambda layer=None: elements(mesh, numbers, layer),
        "lengths": lambda name: lengths(mesh, mesh.node_sets[name]),
        "shares": lambda: shares(mesh),
        "strips": lambda name: strips(mesh, mesh.node_sets[name], thickness or 1.0),
        "side": lambda way: side(mesh, way),
        "nodes": lambda name: [int(node) + 1 for node in nodes_of(mesh, name)],
        "node": lambda name: only(mesh, name) + 1,
        "point": lambda name: mesh.points[only(mesh, name)].tolist(),
        "resting": lambda name, x, y, radius: [x, y, rests_on(mesh, name, (x, y), radius)],
        "ball": lambda centre, radius, count: ball(centre, radius, count, patch),
        "half_tube": lambda axis, radius, count: half_tube(
            axis, radius, 3 * float(np.ptp(mesh.points[:, 0])), count, patch + PATCH
        ),
    }


def check_blocks(effects: Iterable[Effect]) -> None:
    """Refuse effects that replace the same block: only one of them could be in the deck.

    Raises
    ------
    InputError
    """
    owner: dict[str, str] = {}
    for effect in effects:
        for block in effect.replaces:
            if other := owner.get(block):
                found = f"{block}, which effect {other} replaces, too"
                raise InputError(f"effect {effect.name}", "replaces", found, "one of both effects")
            owner[block] = effect.name


def check_layer(effect: Effect, values: Mapping[str, float], count: int) -> None:
    """Refuse an effect in a layer that a body of so many layers does not have; it may be in all of them.

    Raises
    ------
    InputError
    """
    layer = effect.own(values).get(LAYER, 0)
    if layer > count:
        raise InputError(f"effect {effect.name}", LAYER, f"{layer:g}", f"1 to {count}, or 0 for all layers")


def check_layers(present: Iterable[Effect], values: Mapping[str, float], count: int) -> None:
    """Refuse what layers or temperatures do not allow.

    That is a state of a layer that is not there; of two effects that swell one that swells in one layer alone, because
    nodes between layers have one temperature, so that all that swells does so where the material has an expansion; and
    a layer that ages beside a body that swells, because temperatures then are a clock, or where it is the only one.

    Raises
    ------
    InputError
    """
    swelling = [effect for effect in present if "swelling" in effect.changes]
    for effect in present:
        layer = effect.own(values).get(LAYER, 0)
        if "before" in effect.changes:
            check_layer(effect, values, count)
        if "ageing" in effect.changes and (swelling or count == 1):
            expected = f"no effect {swelling[0].name} beside it" if swelling else "an effect of all layers"
            raise InputError(f"effect {effect.name}", "changes.ageing", "stiffness of one layer", expected)
        if effect in swelling and len(swelling) > 1 and layer:
            other = next(one.name for one in swelling if one is not effect)
            raise InputError(f"effect {effect.name}", LAYER, f"{layer:g}", f"0, all layers, beside effect {other}")


def _layer(
    number: int,
    count: int,
    name: str,
    values: Mapping[str, float],
    material: Mapping[str, float],
    present: list[Effect],
    law: str,
    region: str = "",
) -> dict[str, Any]:
    found: dict[str, float] = {}
    for quantity in LAWS[law]:
        for source, key in (
            (values, f"{quantity}_{region}"),
            (material, f"{quantity}_{region}"),
            (values, f"{quantity}_{name}"),
            (values, quantity),
            (material, f"{quantity}_{name}"),
            (material, quantity),
        ):
            if key in source:
                found[quantity] = source[key]
                break
        else:
            raise InputError(
                "config", f"model.material.{quantity}", "nothing", f"a value of {quantity} for layer {name}"
            )
    names = {"number": number, "layers": count}
    for quantity in (quantity for quantity in CONSTANTS if quantity in found):
        found[quantity] = float(changed_by(quantity, found[quantity], names, present, values))
    expansion = float(changed_by("expansion", 1.0, names, present, values))
    shown = {"name": name.upper(), "number": number, "expansion": expansion}
    return {**shown, **found, "d": compressibility(found["mu"], found["poisson"]), "elements": []}


def _regions(
    study: Study,
    mesh: Mesh,
    layers: list[dict[str, Any]],
    values: Mapping[str, float],
    material: Mapping[str, float],
    present: list[Effect],
    law: str,
) -> list[Own]:
    """Regions with constants of their own; the others are as the layers that they lie in."""
    found = []
    for region in study.body.regions:
        if any(f"{quantity}_{region.name}" in source for source in (values, material) for quantity in LAWS[law]):
            own = [
                _layer(number, len(layers), name, values, material, present, law, region.name)
                for number, name in enumerate(study.layer_names, 1)
            ]
            found.append((np.asarray(mesh.element_sets[region.name.upper()]), own))
    return found


def place_of(effect: Effect, values: Mapping[str, float], mesh: Mesh) -> np.ndarray | None:
    """Where in the undeformed body a scanned place of an effect is, mm; None for effects without one.

    Raises
    ------
    InputError
        For another number of formulas than axes, and formulas that are none.
    """
    if not effect.place:
        return None
    if len(effect.place) != mesh.dim:
        expected = f"{mesh.dim}, one for each axis of the body"
        raise InputError(f"effect {effect.name}", "place", f"{len(effect.place)} formulas", expected)
    low, high = mesh.body.min(axis=0), mesh.body.max(axis=0)
    down = {f"indenter_{axis}": float(x) for axis, x in zip("xyz", comes_down(mesh) - low, strict=False)}
    names = {**extent(high - low), **down, **effect.own(values)}
    try:
        return low + np.array([float(evaluate(formula, names)) for formula in effect.place])
    except ValueError as error:
        raise InputError(f"effect {effect.name}", "place", error, "formulas of its names") from error


def _contact(mesh: Mesh) -> dict[str, float]:
    """Numbers of a contact that a guess may change, where nodes tell a sphere's radius; six digits as of shares."""
    touch, centre = (mesh.points[mesh.node_sets.get(name, np.empty(0, int))] for name in ("INDENTER", "INDENTER_TURN"))
    radius = float(np.linalg.norm(centre - touch)) if len(touch) == len(centre) == 1 else 0.0
    if radius == 0:
        return {}
    return {"contact_stiffness": float(f"{STIFFNESS / radius:.6g}"), "establish": float(f"{ESTABLISHED * radius:.6g}")}
