"""The body of a deck where it is not as its mesh: borders of layers lie elsewhere, or it is higher without load."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.files import digest, write_text
from fingerfit.deck.borders import followed, moves_borders
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
_ROUNDING = 1e-9
"""Share of a body's size: what the text of a mesh leaves of its digits."""
_ROUNDS = 10
"""At most; three for a body that was pressed by 5 %."""
MESH_LINE = "*INCLUDE"
"""Keyword of the line by which a deck has its mesh: without it no other mesh can take its place."""
_NODES = "** --- the mesh, whose nodes lie where effects say that layers begin and end\n"
_HEAD = "** --- the body without load: the stated height, in the first picture, times {:.10g}\n"
_RAISED = _HEAD.partition("{")[0]
_END = "*END STEP\n"
_known: dict[str, float] = {}


def deck_of_body(
    study: Study,
    mesh: Mesh,
    included: str,
    effects: Mapping[str, Effect],
    values: Mapping[str, float],
    deck_of: Callable[[Mesh], str],
) -> str:
    """The deck of a body, which has the mesh in it where the body is not as that.

    Its nodes follow borders of layers that lie elsewhere (`fingerfit.deck.borders.followed`).

    It is higher than its mesh where the stated height of a block in the plane is that under a load: without load it is
    then so much higher that it has the mesh's height after the first step. All heights grow by one factor, which
    secants find with the built-in solver, whichever one solves the deck. Where the first step has no equilibrium the
    body stays as it is stated. So it does in space, where each guess would take three long simulations more.

    Parameters
    ----------
    study : Study
    mesh : Mesh
        Of the stated body.
    included : str
        What the deck includes as the mesh, which stands in the deck of a higher body.
    effects : mapping
        All that are known; ``border_down`` and ``border_within`` of those that are present say where layers begin and
        end, ``pictured`` that the height is that in the first picture.
    values : mapping
        The guess.
    deck_of : callable
        Text of the deck with a mesh.

    Raises
    ------
    InputError
        For a deck that does not include the mesh, where effects say that its nodes lie elsewhere.
    """
    present = [effect for effect in effects.values() if effect.present(values)]
    body = followed(mesh, [name.upper() for name in study.layer_names], present, values)
    if study.body.mesh is not None or mesh.dim != 2 or not changed_by("pictured", 0.0, {}, present, values):
        deck = deck_of(body)
        # asked for also where nodes stay: other numbers move them
        moved = _with_mesh(deck, included, _NODES, body) if any(map(moves_borders, present)) else deck
        return deck if body is mesh else moved

    @cache
    def raised(factor: float) -> str:
        higher = _scaled(body, factor)
        return _with_mesh(deck_of(higher), included, _HEAD.format(factor), higher)

    key = digest(raised(1.0))
    if key not in _known:
        _known[key] = _factor(raised, float(np.ptp(mesh.body[:, -1])))
    return raised(_known[key])


def _with_mesh(deck: str, included: str, head: str, mesh: Mesh) -> str:
    line = rf"^\*INCLUDE\s*,\s*INPUT\s*=\s*{re.escape(included)}\s*?$\n?"
    # a function: in a text backslashes would mean something
    made, count = re.subn(line, lambda _: head + format_mesh(mesh), deck, flags=re.IGNORECASE | re.MULTILINE)
    if not count:
        found = f"no line *INCLUDE, INPUT={included}"
        raise InputError("deck", MESH_LINE, found, "that line: effects on the mesh put another one in its place")
    return made


def without_load(mesh: Mesh, deck: str) -> Mesh:
    """The mesh of a deck that was made from one: itself where the deck includes it."""
    if _NODES not in deck and _RAISED not in deck:
        return mesh
    return replace(mesh, points=_nodes(deck))


@lru_cache(maxsize=1)  # `lift` and `moved` read the same deck one after the other
def _nodes(deck: str) -> np.ndarray:
    """Where the nodes of a mesh in a deck lie, mm, shape (nodes, dim)."""
    table = deck.partition("*NODE, NSET=ALL\n")[2].partition("*")[0]
    return np.asarray(np.loadtxt(table.splitlines(), delimiter=",", ndmin=2)[:, 1:])


def lift(mesh: Mesh, deck: str) -> np.ndarray | float:
    """How far nodes lie from those of the mesh without load, mm, shape (nodes, dim); 0 where nowhere."""
    body = without_load(mesh, deck)
    return 0.0 if body is mesh else body.points - mesh.points


def moved(mesh: Mesh, deck: str) -> np.ndarray | None:
    """How far nodes were put beside those of the mesh for borders of layers that lie elsewhere; None where nowhere."""
    body, (_, raised, rest) = without_load(mesh, deck), deck.partition(_RAISED)
    away = (_scaled(body, 1.0 / float(rest.partition("\n")[0])) if raised else body).points - mesh.points
    return away if np.abs(away).max() > _ROUNDING * np.ptp(mesh.body) else None


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
        else:
            return 1.0
    return round(factor, _DIGITS)
