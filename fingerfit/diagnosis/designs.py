"""Which further measurement would tell two effects apart: each is simulated, and what it would show is compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fingerfit.diagnosis.candidates import Candidate
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.ranking import Ranked
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.problem import REFINED, SEARCH, InverseProblem
from fingerfit.fit.rounds import Asked
from fingerfit.fit.slopes import STEP, difference, neighbours
from fingerfit.mesh.mesh import Mesh
from fingerfit.study.study import Study, with_gain

HALF = "half"
"""The search mesh with an indenter over one half of the upper side."""
FURTHER = 1.2
LONGER = 5.0


@dataclass(frozen=True)
class Design:
    """One way of measuring: as many steps and pictures as were measured, but something is changed.

    Parameters
    ----------
    title : str
        For a person.
    study : Study, optional
        Prescribes other steps; without it the simulations that are there hold.
    mesh : str
        What is solved on.
    pictures, forces, error : float
        Factors on the noise of pictures, on that of forces and displacements, and on the error of the mesh.
    """

    title: str
    study: Study | None = None
    mesh: str = SEARCH
    pictures: float = 1.0
    forces: float = 1.0
    error: float = 1.0


MEASURED = Design("as measured")


def designs(study: Study, refined: bool = True) -> list[Design]:
    """What could be measured next; `refined`: whether the error of the mesh is known."""
    found = [
        Design("forces and displacements measured five times better", forces=0.2),
        Design(f"the same test to {FURTHER:g} times the {study.control}", with_gain(study, FURTHER)),
    ]
    if any(step.picture or step.points for step in study.steps):
        kind = "pictures" if any(step.picture for step in study.steps) else "points"
        found.append(Design(f"{kind} with half the noise (four repetitions averaged)", pictures=0.5))
    if refined:
        found.append(Design("a mesh of half the element size (this needs no measurement)", error=0.2**0.5))
    if study.body.width is not None:
        found.append(Design("an indenter of half the width, to half the " + study.control, with_gain(study, 0.5), HALF))
    times = [step.time for step in study.steps]
    if all(time is not None for time in times):
        slower = tuple(replace(step, time=LONGER * float(step.time or 0.0)) for step in study.steps)
        found.append(Design(f"the same test {LONGER:g} times as slow", replace(study, steps=slower)))
        found.append(Design("the second half of the steps in unloading", _unloading(study)))
    return found


def separation(
    comparison: Comparison, first: Ranked, second: Ranked, threads: int = 1
) -> tuple[list[tuple[str, float]], int]:
    """How much better each further measurement would separate two effects.

    Parameters
    ----------
    comparison : Comparison
    first, second : Ranked
    threads : int
        Simulations beside each other.

    Returns
    -------
    list of (str, float)
        Title and gain, the best first: how much larger the signal of the first effect becomes, in units of the noise
        and after all that the second one and the model's own constants can imitate is taken away, squared.
    int
        Simulations that were not known before.
    """
    problem, run = comparison.problem, 0
    problem = problem.with_mesh(HALF, half_indenter(problem.meshes[SEARCH]))
    base = _Shown(comparison, problem, MEASURED).signal(first, second)
    found = []
    for design in designs(problem.study, REFINED in problem.mesh_files):
        shown = _Shown(comparison, problem, design)
        run += solve_missing(problem, shown.asked(first, second), threads)
        signal = shown.signal(first, second)
        if signal is not None and base:
            found.append((design.title, signal / base))
    return sorted(found, key=lambda pair: -pair[1]), run


class _Shown:
    """What a design would show of a model and of effects."""

    def __init__(self, comparison: Comparison, problem: InverseProblem, design: Design) -> None:
        self.comparison, self.problem, self.design = comparison, problem, design
        self.values = comparison.base.values

    def asked(self, *ranking: Ranked) -> list[Asked]:
        """Simulations that are needed."""
        if self.design.study is None:
            return []
        own = [a for pair in self._sides.values() for a in pair]
        return [self._null, *own, *(a for one in ranking for a in self._candidate(one).asked)]

    def signal(self, first: Ranked, second: Ranked) -> float | None:
        """Squared size of the first effect that nothing else can imitate; None without a solution."""
        comparison, design = self.comparison, self.design
        if any(comparison.read(asked) is None for asked in self.asked(first, second)):
            return None
        residual = comparison.residual
        pictures = np.flatnonzero(residual.kept) < residual.value.size
        scale = np.where(pictures, design.pictures, design.forces)
        covariance = residual.covariance * np.outer(scale, scale) + comparison.mesh_covariance() * design.error**2
        slope = self._slope if design.study else comparison.slope
        own, unknown = comparison.own(slope), comparison.nuisance(slope)
        one, other = self._columns(first), self._columns(second)
        if one is None or other is None:
            return None
        # columns of the prescribed quantity and of the mesh take turns
        unknown = unknown * np.tile([design.forces, design.error], unknown.shape[1] // 2)
        before, rows = comparison.known
        known = before, np.pad(rows, ((0, 0), (0, other.shape[1])))
        score_test = ScoreTest(residual.vector, covariance, np.concatenate([own, other], axis=1), unknown, known=known)
        return float((score_test.signature(one @ first.finding.size[:, None]) ** 2).sum())

    def _ask(self, values: Mapping[str, float], role: str, gain: float = 1.0) -> Asked:
        study = self.design.study or self.problem.study
        return self.problem.ask(values, role, study=with_gain(study, gain), mesh=self.design.mesh)

    @cached_property
    def _null(self) -> Asked:
        return self._ask(self.values, self.design.title)

    @cached_property
    def _sides(self) -> dict[str, tuple[Asked, Asked]]:
        """Simulations on either side, by constant."""
        around = neighbours(self.problem.settings.parameters(), self.values)
        asked = {role: self._ask(values, role) for role, values in around.items()}
        asked |= {"+control": self._ask(self.values, "+control", 1 + STEP)}
        asked |= {"-control": self._ask(self.values, "-control", 1 - STEP)}
        names = [role[1:] for role in asked if role[0] == "+"]
        return {name: (asked["+" + name], asked["-" + name]) for name in names if "-" + name in asked}

    def _candidate(self, one: Ranked) -> Candidate:
        roles = {asked.role: asked.values for asked in one.candidate.asked}
        return replace(one.candidate, asked=tuple(self._ask(values, role) for role, values in roles.items()))

    def _columns(self, one: Ranked) -> np.ndarray | None:
        if self.design.study is None or not one.candidate.asked:
            return one.columns
        return self.comparison.columns(self._candidate(one), self._null)

    def _slope(self, name: str) -> np.ndarray:
        sides = self._sides.get(name)
        ahead, behind = (None, None) if sides is None else map(self.comparison.read, sides)
        found = difference(ahead, behind, lambda: self.comparison.read(self._null))
        return np.zeros(len(self.comparison.residual.kept)) if found is None else found


def _unloading(study: Study) -> Study:
    """The steps up to the middle, then back the same way."""
    steps, half = study.steps, (len(study.steps) + 1) // 2
    name = study.control
    way = [getattr(step, name) for step in steps]
    back = way[:half] + way[: len(way) - half][::-1]
    return replace(study, steps=tuple(replace(s, **{name: value}) for s, value in zip(steps, back, strict=True)))


def half_indenter(mesh: Mesh) -> Mesh:
    """The mesh with only those nodes under the indenter that lie in its half at small x."""
    top, x = mesh.node_sets["TOP"], mesh.points[mesh.node_sets["TOP"], 0]
    left = top[x <= (x.min() + x.max()) / 2 + 1e-9]
    return replace(mesh, node_sets={**mesh.node_sets, "TOP": left, "INDENTER": left[:1]})
