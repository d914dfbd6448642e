"""What does not fit together in a study whose indenter goes another way than straight down."""

from __future__ import annotations

from collections.abc import Iterator

from fingerfit.core.errors import InputError
from fingerfit.study.study import AXES, Study


def oblique_problems(study: Study) -> Iterator[InputError]:
    """What an indenter cannot do that goes another way than straight down."""
    file = study.path
    for axis in study.moved_sideways:
        name = f"displacement_{axis}"
        for step in study.steps:
            if getattr(step, name) is None:
                expected = f"the {name} of every step, since simulations prescribe it"
                yield InputError(file, "steps", f"step {step.number} without {name}", expected)
    if study.direction and study.moved_sideways:
        found = f"a direction, and displacement_{study.moved_sideways[0]} in the table of the steps"
        yield InputError(file, "boundary.indenter.direction", found, "one of both")
    if study.oblique and study.base != "held":
        expected = "held, since the indenter does not go straight down"
        yield InputError(file, "boundary.base", study.base, expected)

    if study.direction and study.control == "force":
        for axis in AXES:
            if any(getattr(step, f"force_{axis}") is not None for step in study.steps):
                # what a rail takes aside is told by some solvers and not by others
                expected = "control: displacement, or no such column beside a direction"
                yield InputError(file, "steps", f"force_{axis} with control: force", expected)


def wrong_axes(study: Study, dim: int) -> Iterator[InputError]:
    """Problems of directions and columns with the dimension of the body, 2 or 3."""
    columns = [f"{what}_{axis}" for axis in AXES[dim - 1 :] for what in ("displacement", "force")]
    for name in columns:
        if any(getattr(step, name) is not None for step in study.steps):
            yield InputError(study.path, "steps", name, "a body in space")
    if study.direction and len(study.direction) != dim:
        found = f"{len(study.direction)} numbers"
        yield InputError(study.path, "boundary.indenter.direction", found, f"{dim} numbers, one for each axis")
