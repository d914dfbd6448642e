"""Which further measurement would tell two effects apart, or identify a constant that is not.

Each is simulated, and what it would show is compared.
"""

from __future__ import annotations

import copy
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
from fingerfit.fit.slopes import STEP, coordinates, difference, moved, neighbours
from fingerfit.mesh.mesh import Mesh
from fingerfit.study.several import AT
from fingerfit.study.study import Study, with_gain

HALF = "half"
"""The search mesh with an indenter over one half of the upper side."""
FURTHER = 1.2
LONGER = 5.0
GOOD = 0.01
"""Noise of a response that was not measured so far, as a share of its largest value: that of a load cell in use."""
NARROW, TWICE = 0.25, 2.0
"""A constant is identified where its 95 % interval covers at most this share of the distance of its bounds and, in the
logarithm, goes no farther than this factor either way. Choices."""
NORMAL = 1.96
"""Standard deviations from the middle to the ends of a 95 % interval."""


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
    response : bool
        Whether the response is measured, which was not.
    """

    title: str
    study: Study | None = None
    mesh: str = SEARCH
    pictures: float = 1.0
    forces: float = 1.0
    error: float = 1.0
    response: bool = False


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
    problem, run = _with_half(comparison.problem), 0
    base = _Shown(comparison, problem, MEASURED).signal(first, second)
    found = []
    for design in designs(problem.study, REFINED in problem.mesh_files):
        shown = _Shown(comparison, problem, design)
        run += solve_missing(problem, shown.asked(first, second), threads)
        signal = shown.signal(first, second)
        if signal is not None and base:
            found.append((design.title, signal / base))
    return sorted(found, key=lambda pair: -pair[1]), run


@dataclass(frozen=True)
class Further:
    """A further measurement, and the 95 % interval that a constant would have with it, in its unit, within bounds."""

    title: str
    interval: tuple[float, float]
    identified: bool


def identification(comparison: Comparison, threads: int = 1) -> tuple[dict[str, list[Further]], int]:
    """Further measurements for constants that are not identified, by how narrow the interval would become.

    By the linear model: what the values at hand say of the constants (Fisher's information), and what those of another
    test would add. A better measurement of the same test stands for the one at hand.

    Parameters
    ----------
    comparison : Comparison
    threads : int
        Simulations beside each other.

    Returns
    -------
    dict
        By constant; the first entry is the measurement at hand.
    int
        Simulations that were not known before.
    """
    parameters, values = comparison.problem.settings.parameters(), comparison.base.values
    own = comparison.problem.settings.model.parameters
    low, high = (coordinates(parameters, {p.name: getattr(p, end) for p in parameters}) for end in ("lower", "upper"))
    width, known, run = high - low, comparison.known[1], 0
    # all values between the bounds are as likely: a variance of width^2 / 12
    before = np.diag(12.0 / width**2)
    now = comparison.score_test.own.T @ comparison.score_test.own

    def half(information: np.ndarray) -> np.ndarray:
        return np.asarray(NORMAL * np.sqrt(np.diag(np.linalg.inv(information + before))))

    def further(title: str, information: np.ndarray, n: int) -> Further:
        move = half(information)[n] * (np.arange(len(width)) == n)
        ends = [moved(parameters, values, side * move)[parameters[n].name] for side in (-1.0, 1.0)]
        return Further(title, (ends[0], ends[1]), bool(move[n] <= min(NARROW / 2 * width[n], np.log(TWICE))))

    def unsure() -> list[int]:
        names = [p.name.partition(AT)[0] for p in parameters]
        return [n for n, name in enumerate(names) if name in own and not further("", now, n).identified]

    if not unsure():
        return {}, 0
    problem, found = _with_half(comparison.problem), dict[str, np.ndarray]()
    chosen = designs(problem.study, REFINED in problem.mesh_files)
    if not np.isfinite(comparison.residual.response).any():
        name = "displacement" if problem.study.control == "force" else "force"
        chosen = [one for one in chosen if one.forces == 1.0]
        chosen.append(Design(f"the {name} measured, to {100 * GOOD:g} % of its largest value", response=True))
    # slopes of the fit may be from a few percent beside: two nearly parallel ones would seem to cross
    for design in (MEASURED, *chosen):
        shown = _Shown(comparison, problem, replace(design, study=design.study or problem.study))
        run += solve_missing(problem, shown.asked(), threads)
        information = shown.information()
        if design is MEASURED:
            now = known.T @ known + (0.0 if information is None else information)
            if information is None or not unsure():
                return {}, run
        elif information is not None:
            found[design.title] = information + (now if design.study else known.T @ known)
    told = dict[str, list[Further]]()
    for n in unsure():
        ranked = sorted(found, key=lambda title: half(found[title])[n])
        listed = [further(title, found[title], n) for title in ranked]
        told[parameters[n].name] = [further(MEASURED.title, now, n), *listed]
    return told, run


def _with_half(problem: InverseProblem) -> InverseProblem:
    if problem.study.body.width is None:
        return problem  # no design asks for it
    return problem.with_mesh(HALF, half_indenter(problem.meshes[SEARCH]))


def _with_response(comparison: Comparison) -> Comparison:
    """The comparison as if the response had been measured, with a noise of `GOOD`; what was is not known."""
    whole, residual = copy.copy(comparison), comparison.residual
    kept = residual.kept.copy()
    kept[residual.value.size :][: len(comparison.data.step)] = True
    there, noise = residual.kept[kept], GOOD * np.abs(comparison.prediction.response).max()
    covariance = noise**2 * np.eye(len(there))
    covariance[np.ix_(there, there)] = residual.covariance
    whole.residual = replace(residual, kept=kept, covariance=covariance)
    return whole


class _Shown:
    """What a design would show of a model and of effects."""

    def __init__(self, comparison: Comparison, problem: InverseProblem, design: Design) -> None:
        self.comparison = _with_response(comparison) if design.response else comparison
        self.problem, self.design = problem, design
        self.values = comparison.base.values

    def asked(self, *ranking: Ranked) -> list[Asked]:
        """Simulations that are needed."""
        if self.design.study is None:
            return []
        own = [a for pair in self._sides.values() for a in pair]
        return [self._null, *own, *(a for one in ranking for a in self._candidate(one).asked)]

    def signal(self, first: Ranked, second: Ranked) -> float | None:
        """Squared size of the first effect that nothing else can imitate; None without a solution."""
        one, other = self._columns(first), self._columns(second)
        if one is None or other is None or not self._solved(first, second):
            return None
        score_test = self._score_test(other)
        return float((score_test.signature(one @ first.finding.size[:, None]) ** 2).sum())

    def information(self) -> np.ndarray | None:
        """Fisher's information on the constants, shape (parameters, parameters); None without a solution."""
        if not self._solved():
            return None
        own = self._score_test().own
        return own.T @ own

    def _solved(self, *ranking: Ranked) -> bool:
        return all(self.comparison.read(asked) is not None for asked in self.asked(*ranking))

    def _score_test(self, other: np.ndarray | None = None) -> ScoreTest:
        """Of nothing but noise; `other` columns are as free as the constants."""
        comparison, design = self.comparison, self.design
        residual = comparison.residual
        pictures = np.flatnonzero(residual.kept) < residual.value.size
        scale = np.where(pictures, design.pictures, design.forces)
        covariance = residual.covariance * np.outer(scale, scale) + comparison.mesh_covariance() * design.error**2
        slope = self._slope if design.study else comparison.slope
        own, unknown = comparison.own(slope), comparison.nuisance(slope)
        # columns of the prescribed quantity and of the mesh take turns
        unknown = unknown * np.tile([design.forces, design.error], unknown.shape[1] // 2)
        nothing = np.zeros(len(covariance))
        if other is None:
            return ScoreTest(nothing, covariance, own, unknown)  # priors are added once, to all that is known
        before, rows = comparison.known
        known = before, np.pad(rows, ((0, 0), (0, other.shape[1])))
        return ScoreTest(nothing, covariance, np.concatenate([own, other], axis=1), unknown, known=known)

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
    names = (study.control, *(f"displacement_{axis}" for axis in study.moved_sideways))
    back = steps[:half] + steps[: len(steps) - half][::-1]
    pairs = zip(steps, back, strict=True)
    return replace(study, steps=tuple(replace(s, **{n: getattr(b, n) for n in names}) for s, b in pairs))


def half_indenter(mesh: Mesh) -> Mesh:
    """The mesh with only those nodes under the indenter that lie in its half at small x."""
    top, x = mesh.node_sets["TOP"], mesh.points[mesh.node_sets["TOP"], 0]
    left = top[x <= (x.min() + x.max()) / 2 + 1e-9]
    return replace(mesh, node_sets={**mesh.node_sets, "TOP": left, "INDENTER": left[:1]})
