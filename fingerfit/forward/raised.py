"""A block whose stated height is that in the first picture, under a load before it: how high it is without load."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from fingerfit.core.files import digest, write_text
from fingerfit.deck.changed import changed_by
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import Effect
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.study.study import Study

_CLOSE, _DIGITS = 1e-6, 7
"""Change of the factor that ends the search (by secants the one after it is far smaller still), and its decimals: below
the last one there is what a solver leaves, which another machine leaves otherwise."""
_ROUNDS = 10
"""At most; three for a body that was pressed by 5 %."""
_HEAD = "** --- the body without load: the stated height, in the first picture, times {:.10g}\n"
_END = "*END STEP\n"
_known: dict[str, float] = {}


def of_height(
    study: Study,
    mesh: Mesh,
    included: str,
    effects: Mapping[str, Effect],
    values: Mapping[str, float],
    deck_of: Callable[[Mesh], str],
) -> str:
    """The deck of a body, higher than its mesh where the stated height of a block in the plane is that under a load.

    Without load it is then so much higher that it has the mesh's height after the first step. All heights grow by one
    factor, which secants find with the built-in solver, whichever one solves the deck. Where the first step has no
    equilibrium the body stays as it is stated. So it does in space, where each guess would take three long simulations
    more.

    Parameters
    ----------
    study : Study
    mesh : Mesh
        Of the stated body.
    included : str
        What the deck includes as the mesh, which stands in the deck of a higher body.
    effects : mapping
        All that are known; ``pictured`` of one that is present says that the height is that in the first picture.
    values : mapping
        The guess.
    deck_of : callable
        Text of the deck with a mesh.
    """
    present = [effect for effect in effects.values() if "pictured" in effect.changes and effect.present(values)]
    if study.body.mesh is not None or mesh.dim != 2 or not changed_by("pictured", 0.0, {}, present, values):
        return deck_of(mesh)
    line = f"*INCLUDE, INPUT={included}\n"

    @cache
    def raised(factor: float) -> str:
        body = _scaled(mesh, factor)
        return deck_of(body).replace(line, _HEAD.format(factor) + format_mesh(body))

    key = digest(raised(1.0))
    if key not in _known:
        _known[key] = _factor(raised, float(np.ptp(mesh.body[:, -1])))
    return raised(_known[key])


def without_load(mesh: Mesh, deck: str) -> Mesh:
    """The mesh of a deck that was made from one: higher, where the stated height is that in the first picture."""
    _, found, rest = deck.partition(_HEAD.partition("{")[0])
    return _scaled(mesh, float(rest.partition("\n")[0])) if found else mesh


def lift(mesh: Mesh, deck: str) -> np.ndarray | float:
    """How far its nodes lie from those of the mesh that it was made from, mm, shape (nodes, dim); 0 where nowhere."""
    body = without_load(mesh, deck)
    return 0.0 if body is mesh else body.points - mesh.points


def _scaled(mesh: Mesh, factor: float) -> Mesh:
    points, low = mesh.points.copy(), mesh.body[:, -1].min()
    points[:, -1] = low + factor * (points[:, -1] - low)
    return replace(mesh, points=points)


def _factor(raised: Callable[[float], str], height: float) -> float:
    """How many times the stated height the body has without load: where the first step leaves the stated one."""
    known: Outcome | None = None
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as folder:
        path = Path(folder) / "deck.inp"

        def off(factor: float) -> float | None:
            """How far the height is off under the load, as a share of it; None without equilibrium."""
            nonlocal known
            write_text(path, raised(factor).partition(_END)[0] + _END)
            known = BuiltinSolver().solve(path, Path(folder), nearby=known)
            return factor - 1.0 + known.indenter[0, -1] / height if known.status == CONVERGED else None

        before, last = 1.0, off(1.0)
        factor = before if last is None else before - last
        for _ in range(_ROUNDS):
            now = off(factor) if last is not None else None
            if now is None or last is None:
                return 1.0
            before, last, factor = factor, now, factor - now * (factor - before) / ((now - last) or np.inf)
            if abs(factor - before) < _CLOSE:
                break
    return round(factor, _DIGITS)
