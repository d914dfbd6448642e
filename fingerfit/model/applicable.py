"""Whether an effect makes sense in a study: what it needs, and what is there."""

from __future__ import annotations

from fingerfit.model.effect import Effect
from fingerfit.study.study import Study

IN_WORDS = {
    "time": "a time at every step",
    "pictures": "pictures",
    "displacements": "pictures or measured points",
    "layers": "a block of layers in the plane",
    "plane": "a body in the plane",
    "space": "a body in space",
}
"""What an effect may need of a study (`fingerfit.model.effect.NEEDS`), for a person."""
MEASURED = ("time", "pictures", "displacements")
"""Needs that another measurement of the same body would meet."""

CURES = {
    "coarse_mesh": ("the mesh is too coarse", "a finer model.mesh and model.refined"),
    "load_step": ("the load steps are too large", "smaller increments in the template"),
}
"""What is wrong, and what to do, about effects of mesh and load steps, which are no part of a model."""


def cure_of(effect: Effect) -> tuple[str, str]:
    """What is wrong, and what to do, where an effect of mesh and load steps shows."""
    return CURES.get(effect.name, (effect.title, "other settings of the solver"))


def what_is_there(study: Study, dim: int) -> set[str]:
    """Which of the needs of effects a study meets; `dim` is that of its mesh."""
    pictured = any(step.picture for step in study.steps)
    return {
        name
        for name, there in (
            ("time", all(step.time is not None for step in study.steps)),
            ("pictures", pictured),
            ("displacements", pictured or any(step.points for step in study.steps)),
            ("layers", study.body.width is not None),
            ("plane", dim == 2),
            ("space", dim == 3),
        )
        if there
    }


def unmet(effect: Effect, study: Study, dim: int) -> list[str]:
    """Needs of an effect that a study does not meet, in words; none where the effect makes sense in it."""
    there = what_is_there(study, dim)
    found = [IN_WORDS[need] for need in effect.needs if need not in there]
    if effect.control and effect.control != study.control:
        found.append(f"a prescribed {effect.control}")
    return found


def not_measured(effect: Effect, study: Study, dim: int) -> list[str]:
    """What must be measured, in words, before an effect that makes sense for the body can be tested."""
    lacking = unmet(effect, study, dim)
    measurable = [IN_WORDS[need] for need in MEASURED]
    return lacking if all(need in measurable for need in lacking) else []
