"""Whether an effect makes sense in a study: what it needs, and what is there."""

from __future__ import annotations

from collections.abc import Callable

from fingerfit.mesh.flat import is_flat, is_stacked
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import ASIDE, Effect
from fingerfit.model.formulas import names_in
from fingerfit.study.study import Study

IN_WORDS = {
    "time": "a time at every step",
    "pictures": "pictures",
    "displacements": "pictures or measured points",
    "block": "a block or a brick, not a mesh of its own",
    "layers": "flat layers on top of each other",
    "base": "a flat base",
    "indenter": "a flat side under the indenter",
    "sliding_base": "a flat base that slides",
    "sliding_indenter": "a flat side that slides under the indenter",
    "plane": "a body in the plane",
    "space": "a body in space",
    "refined": "a finer mesh",
}
"""What an effect may need of a study (`fingerfit.model.effect.NEEDS`), for a person."""
MEASURED = ("time", "pictures", "displacements", "refined")
"""Needs that another measurement or mesh of the same body would meet."""
CURE = "; take "
"""What stands in a verdict before the cure of what mesh or load steps leave."""


def cure_of(effect: Effect) -> tuple[str, str]:
    """What is wrong, and what to do, where an effect of mesh and load steps shows."""
    return effect.fault or effect.title, effect.cure or "other settings of the solver"


def _is_met(need: str, study: Study, mesh: Mesh, refined: bool) -> bool:
    """Whether a study with a mesh meets a need of effects; `refined`: whether there is a finer one."""
    pictured = any(step.picture for step in study.steps)
    met: dict[str, Callable[[], bool]] = {
        "time": lambda: all(step.time is not None for step in study.steps),
        "pictures": lambda: pictured,
        "displacements": lambda: pictured or any(step.points for step in study.steps),
        "block": lambda: study.body.mesh is None,
        "layers": lambda: is_stacked(mesh, study.layer_names),
        "base": lambda: is_flat(mesh, "BOTTOM"),
        "indenter": lambda: is_flat(mesh, "TOP"),
        "sliding_base": lambda: study.base == "slides" and is_flat(mesh, "BOTTOM"),
        "sliding_indenter": lambda: study.indenter == "slides" and is_flat(mesh, "TOP"),
        "plane": lambda: mesh.dim == 2,
        "space": lambda: mesh.dim == 3,
        "refined": lambda: refined,
    }
    return met[need]()


def unmet(effect: Effect, study: Study, mesh: Mesh, refined: bool) -> list[str]:
    """Needs of an effect that a study does not meet, in words; none where the effect makes sense in it."""
    found = [IN_WORDS[need] for need in effect.needs if not _is_met(need, study, mesh, refined)]
    if effect.control and effect.control != study.control:
        found.append(f"a prescribed {effect.control}")
    numbers = {p.name for p in effect.parameters}
    pushes = bool(numbers) and numbers <= names_in(effect.changes.get("before", "0"))
    if pushes and study.control == "displacement" and (study.body.width is None or study.direction):
        # only the deck of a block goes on from where a force has left the indenter
        found.append("a prescribed force")
    if study.on_a_rail and ("indenter" in effect.replaces or set(ASIDE) & effect.changes.keys()):
        found.append("an indenter that is not on a rail")
    # a side that slides has nothing that could give way
    if "base" in effect.replaces and study.base != "held":
        found.append("a base that is held")
    if "indenter" in effect.replaces and study.indenter != "glued":
        found.append("an indenter that is glued")
    return found or [f"{formula} of the study" for formula in dict.fromkeys(effect.shares_of.values())]


def not_measured(effect: Effect, study: Study, mesh: Mesh, refined: bool) -> list[str]:
    """What must be measured, in words, before an effect that makes sense for the body can be tested."""
    lacking = unmet(effect, study, mesh, refined)
    measurable = [IN_WORDS[need] for need in MEASURED]
    return lacking if all(need in measurable for need in lacking) else []
