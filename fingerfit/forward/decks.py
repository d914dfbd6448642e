"""The deck of a guess, and whether a solver takes it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from fingerfit.core.errors import InputError
from fingerfit.core.folders import template_folders
from fingerfit.deck.context import deck_context
from fingerfit.deck.render import render_deck
from fingerfit.forward.bodies import deck_of_body
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import Effect
from fingerfit.solvers.registry import get_solver
from fingerfit.study.study import Study

if TYPE_CHECKING:
    from fingerfit.settings.config import Settings


def template_of(settings: Settings, study: Study) -> str:
    """The deck template of a study, or of a test."""
    return study.template or settings.model.template


def make_deck(
    settings: Settings,
    study: Study,
    mesh: Mesh,
    mesh_name: str,
    values: Mapping[str, float],
    effects: Mapping[str, Effect],
) -> str:
    """Text of the deck of a guess.

    Parameters
    ----------
    settings : Settings
    study : Study
    mesh : Mesh
    mesh_name : str
        Name of its file in the folder ``meshes``, without ending.
    values : mapping
        The guess.
    effects : mapping
        All that are known in the study.
    """
    included = f"../../meshes/{mesh_name}.inp"
    everything = {**settings.fixed(effects), **values}
    fixed, law, folders = settings.model.material, settings.model.law, template_folders(Path(settings.study))

    def deck_of(body: Mesh) -> str:
        context = deck_context(study, body, included, everything, fixed, effects, law)
        return render_deck(template_of(settings, study), context, folders)

    return deck_of_body(study, mesh, included, effects, everything, deck_of)


def with_effect(effect: Effect, place: Mapping[str, float], parameter: str) -> dict[str, float]:
    """Values of an effect at a place that differ from none by a small size of one parameter."""
    chosen = next(p for p in effect.parameters if p.name == parameter)
    return {**effect.null(), **place, effect.key(parameter): chosen.null + chosen.step}


def refusal(solver: str, template: str, deck: str, mesh_file: Path, mesh_name: str) -> InputError | None:
    """Why a solver does not take the deck of a template; None where it does.

    Raises
    ------
    SolverError
        When the solver is not there.
    """
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as name:
        path = Path(name) / "sims/deck/deck.inp"
        path.parent.mkdir(parents=True)
        path.write_text(deck, encoding="utf-8")
        (Path(name) / "meshes").mkdir()
        (Path(name) / f"meshes/{mesh_name}.inp").symlink_to(mesh_file.resolve())
        try:
            get_solver(solver).check(path)
        except InputError as error:
            # the deck is gone when this is read: its template is named, and what it includes
            included = Path(error.where).name if os.sep in error.where and error.where != str(path) else ""
            field = f"{included}, {error.field}" if included else error.field
            return InputError(f"deck of {template} for solver {solver}", field, error.found, error.expected)
    return None
