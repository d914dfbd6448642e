"""Which further measurement would tell two effects apart, or identify a constant that is not.

Each is simulated, and what it would show is compared.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fingerfit.deck.questions import quadratic
from fingerfit.diagnosis.candidates import Candidate
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.joint import diagonal, joined
from fingerfit.diagnosis.ranking import Ranked
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.fit.intervals import NORMAL
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.minimum import ORDER
from fingerfit.fit.problem import REFINED, SEARCH, InverseProblem
from fingerfit.fit.rounds import Asked
from fingerfit.fit.slopes import STEP, bounds_of, difference, evenly, moved, neighbours
from fingerfit.mesh.mesh import Mesh
from fingerfit.study.several import AT
from fingerfit.study.study import Study, with_gain

HALF = "half"
"""The search mesh with an indenter over one half of the upper side."""
FURTHER = 1.2
"""How many times as far a test is continued: what a device that was not at its end can do. A choice."""
LONGER = 5.0
"""How many times as long each step takes, where the same test is slower. A choice."""
FORCES, PICTURES = 0.2, 0.5
"""Noise of forces and displacements, and of pictures, that are measured better, as a share of the noise at hand:
another load cell, a choice, and the mean of four pictures."""
FINER = 2.0**-ORDER
"""What a mesh of half the element size leaves of the error of the mesh."""
GOOD = 0.01
"""Noise of a response that was not measured so far, as a share of its largest value: that of a load cell in use."""
NARROW, TWICE = 0.25, 2.0
"""A constant is identified where its 95 % interval covers at most this share of the distance of its bounds and, where
it is searched in the logarithm, goes no farther than this factor either way. Choices."""


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
        Design("forces and displacements measured five times better", forces=FORCES),
        Design(f"the same test to {FURTHER:g} times the {study.control}", with_gain(study, FURTHER)),
    ]
    if any(step.picture or step.points for step in study.steps):
        kind = "pictures" if any(step.picture for step in study.steps) else "points"
        found.append(Design(f"{kind} with half the noise (four repetitions averaged)", pictures=PICTURES))
    if refined:
        found.append(Design("a mesh of half the element size (this needs no measurement)", error=FINER))
    if study.body.width is not None:
        # a choice: half the area carries about half the force
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
        and after all that the second one and the model's own constants can imitate is taken away, squared. In a study
        with several tests each title begins with the one that is changed.
    int
        Simulations that were not known before.
    """
    run, found = 0, list[tuple[str, float]]()
    measured = [_Shown(test, MEASURED, rows) for test, rows in _tests(comparison)]
    base = _signal(comparison, measured, first, second)
    for n, test in enumerate(measured):
        for design in designs(test.problem.study, REFINED in test.problem.mesh_files):
            shown = test.changed(design)
            run += solve_missing(shown.problem, shown.asked(first, second), threads)
            signal = _signal(comparison, [*measured[:n], shown, *measured[n + 1 :]], first, second)
            if signal is not None and base:
                found.append((shown.title, signal / base))
    return sorted(found, key=lambda pair: -pair[1]), run


@dataclass(frozen=True)
class Further:
    """A further measurement, and what it would tell of a constant.

    Parameters
    ----------
    title : str
        Of its design, for a person.
    interval : (float, float)
        The 95 % interval that the constant would have, in its unit, within its bounds.
    identified : bool
        Whether that is narrow enough.
    """

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
    low, high = bounds_of(parameters)
    width, known, run = high - low, comparison.known.slopes, 0
    before = np.diag(evenly(parameters))
    now = comparison.score_test.own.T @ comparison.score_test.own

    def half(information: np.ndarray) -> np.ndarray:
        return np.asarray(NORMAL * np.sqrt(np.diag(np.linalg.inv(information + before))))

    def further(title: str, information: np.ndarray, n: int) -> Further:
        move = half(information)[n] * (np.arange(len(width)) == n)
        ends = [moved(parameters, values, side * move)[parameters[n].name] for side in (-1.0, 1.0)]
        farthest = min(NARROW / 2 * width[n], np.log(TWICE) if parameters[n].log else np.inf)
        return Further(title, (ends[0], ends[1]), bool(move[n] <= farthest))

    def unsure() -> list[int]:
        names = [p.name.partition(AT)[0] for p in parameters]
        return [n for n, name in enumerate(names) if name in own and not further("", now, n).identified]

    if not unsure():
        return {}, 0
    # slopes of the fit may be from a few percent beside: two nearly parallel ones would seem to cross
    measured = [_Shown(test, MEASURED, rows).at_estimate() for test, rows in _tests(comparison)]
    told_now = list[np.ndarray]()
    for test in measured:
        run += solve_missing(test.problem, test.asked(), threads)
        information = test.information()
        if information is None:
            return {}, run
        told_now.append(information)
    now = known.T @ known + sum(told_now)
    if not unsure():
        return {}, run
    found = dict[str, np.ndarray]()
    for n, test in enumerate(measured):
        others = known.T @ known + sum(told_now[:n] + told_now[n + 1 :])
        for design in _designs_of(test.comparison):
            shown = test.changed(design).at_estimate()
            run += solve_missing(shown.problem, shown.asked(), threads)
            information = shown.information()
            if information is not None:
                found[shown.title] = information + (now if design.study else others)
    told = dict[str, list[Further]]()
    for n in unsure():
        ranked = sorted(found, key=lambda title: half(found[title])[n])
        listed = [further(title, found[title], n) for title in ranked]
        told[parameters[n].name] = [further(MEASURED.title, now, n), *listed]
    return told, run


def _designs_of(comparison: Comparison) -> list[Design]:
    """What could be measured next in a test; of a response that was not measured that it is."""
    study = comparison.problem.study
    found = designs(study, REFINED in comparison.problem.mesh_files)
    if not np.isfinite(comparison.residual.response).any():
        name, _ = comparison.data.response_name(0)
        found = [one for one in found if one.forces == 1.0]
        found.append(Design(f"the {name} measured, to {100 * GOOD:g} % of its largest value", response=True))
    return found


def _tests(comparison: Comparison) -> list[tuple[Comparison, slice]]:
    """The tests of a study, and which values of the residual of all of them are theirs."""
    ends = np.cumsum([0, *(len(test.vector) for test in comparison.every)]).tolist()
    return [(test, slice(*ends[n : n + 2])) for n, test in enumerate(comparison.every)]


def _signal(comparison: Comparison, shown: Sequence[_Shown], first: Ranked, second: Ranked) -> float | None:
    """Squared size of the first effect that nothing else can imitate in all tests; None without a solution."""
    if not all(test.solved(first, second) for test in shown):
        return None
    one, other = (joined([test.columns(effect) for test in shown]) for effect in (first, second))
    if one is None or other is None:
        return None
    covariance, own, unknown = zip(*(test.parts() for test in shown), strict=True)
    free = np.concatenate([np.concatenate(own), other], axis=1)
    known, more = comparison.known, free.shape[1] - comparison.known.slopes.shape[1]
    known = replace(known, slopes=np.pad(known.slopes, ((0, 0), (0, more))), held=np.zeros(free.shape[1], dtype=bool))
    score_test = ScoreTest(np.zeros(len(free)), diagonal(covariance), free, diagonal(unknown), known=known)
    return float((score_test.signature(one @ first.finding.size[:, None]) ** 2).sum())


def _with_half(problem: InverseProblem) -> InverseProblem:
    if problem.study.body.width is None:
        return problem  # no design asks for it
    return problem.with_mesh(HALF, half_indenter(problem.meshes[SEARCH]))


def _with_response(comparison: Comparison) -> Comparison:
    """The comparison as if the response had been measured, with a noise of `GOOD`; what was is not known."""
    whole, kept = copy.copy(comparison), comparison.kept.copy()
    kept[comparison.residual.value.size :][: len(comparison.data.step)] = True
    along, _ = comparison.data.split(comparison.prediction.response)
    there, noise = comparison.kept[kept], GOOD * np.abs(along).max()
    covariance = noise**2 * np.eye(len(there))
    covariance[np.ix_(there, there)] = comparison.noise
    whole.kept, whole.noise = kept, covariance
    return whole


class _Shown:
    """What a design would show of a model and of effects in a test.

    Parameters
    ----------
    comparison : Comparison
        Of the test.
    design : Design
    rows : slice
        Its values among those of all tests.
    problem : InverseProblem, optional
        With the mesh of half an indenter; made when left out.
    """

    def __init__(
        self, comparison: Comparison, design: Design, rows: slice, problem: InverseProblem | None = None
    ) -> None:
        self.comparison, self.design, self._rows = comparison, design, rows
        self.problem = problem or _with_half(comparison.problem)
        self.values = comparison.base.values

    @property
    def title(self) -> str:
        """Of the design, after the name of the test where there are several."""
        return f"{self.problem.test}: {self.design.title}" if self.problem.test else self.design.title

    def changed(self, design: Design) -> _Shown:
        """What another design would show in the test."""
        return _Shown(self.comparison, design, self._rows, self.problem)

    def at_estimate(self) -> _Shown:
        """The same, by slopes that are taken at the estimate whatever the design."""
        return self.changed(replace(self.design, study=self.design.study or self.problem.study))

    def asked(self, *ranking: Ranked) -> list[Asked]:
        """Simulations that are needed."""
        if self.design.study is None:
            return []
        own = [a for pair in self._sides.values() for a in pair if a]
        return [self._null, *own, *(a for one in ranking for a in self._candidate(one).asked)]

    def solved(self, *ranking: Ranked) -> bool:
        """Whether all of them have a solution."""
        return all(self.comparison.read(asked) is not None for asked in self.asked(*ranking))

    def information(self) -> np.ndarray | None:
        """Fisher's information on the constants, shape (parameters, parameters); None without a solution."""
        if not self.solved():
            return None
        covariance, own, unknown = self.parts()
        # priors are added once, to all that is known
        whitened = ScoreTest(np.zeros(len(covariance)), covariance, own, unknown).own
        return whitened.T @ whitened

    def parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Covariance of noise and mesh, slopes of the constants, and signals of unknown size."""
        design = self.design
        comparison = _with_response(self.comparison) if design.response else self.comparison
        pictures = np.flatnonzero(comparison.kept) < comparison.residual.value.size
        scale = np.where(pictures, design.pictures, design.forces)
        covariance = (
            comparison.noise * np.outer(scale, scale)
            + comparison.rough_covariance(comparison.mesh_signal) * design.error**2
        )
        slope = self._slope if design.study else comparison.slope
        own, unknown = comparison.own(slope), comparison.nuisance(slope)
        # columns of the prescribed quantity and of the mesh take turns
        return covariance, own, unknown * np.tile([design.forces, design.error], unknown.shape[1] // 2)

    def _ask(self, values: Mapping[str, float], role: str, gain: float = 1.0) -> Asked:
        study = self.design.study or self.problem.study
        return self.problem.ask(values, role, study=with_gain(study, gain), mesh=self.design.mesh)

    @cached_property
    def _null(self) -> Asked:
        return self._ask(self.values, self.design.title)

    @cached_property
    def _sides(self) -> dict[str, list[Asked | None]]:
        """Simulations ahead and behind, by constant; at a bound there is one of them only."""
        around = neighbours(self.problem.settings.parameters(), self.values)
        asked = {role: self._ask(values, role) for role, values in around.items()}
        asked |= {"+control": self._ask(self.values, "+control", 1 + STEP)}
        asked |= {"-control": self._ask(self.values, "-control", 1 - STEP)}
        return {role[1:]: [asked.get(sign + role[1:]) for sign in "+-"] for role in asked}

    def _candidate(self, one: Ranked) -> Candidate:
        roles = {asked.role: asked.values for asked in one.candidate.asked}
        return replace(one.candidate, asked=tuple(self._ask(values, role) for role, values in roles.items()))

    def columns(self, one: Ranked) -> np.ndarray | None:
        """Slopes of an effect; None without a solution."""
        if self.design.study is None or not one.candidate.asked:
            return one.columns[self._rows]
        return self.comparison.columns(self._candidate(one), self._null)

    def _slope(self, name: str) -> np.ndarray:
        sides = self._sides.get(name, (None, None))
        ahead, behind = (self.comparison.read(asked) if asked else None for asked in sides)
        found = difference(ahead, behind, lambda: self.comparison.read(self._null))
        return np.zeros(len(self.comparison.kept)) if found is None else found


def _unloading(study: Study) -> Study:
    """The steps up to the middle, then back the same way."""
    steps, half = study.steps, (len(study.steps) + 1) // 2
    names = (study.control, *(f"displacement_{axis}" for axis in study.moved_sideways))
    back = steps[:half] + steps[: len(steps) - half][::-1]
    pairs = zip(steps, back, strict=True)
    return replace(study, steps=tuple(replace(s, **{n: getattr(b, n) for n in names}) for s, b in pairs))


def half_indenter(mesh: Mesh) -> Mesh:
    """The mesh with only those nodes under the indenter that lie in its half at small x: whole sides of elements."""
    top, x = mesh.node_sets["TOP"], mesh.points[mesh.node_sets["TOP"], 0]
    left = top[x <= (x.min() + x.max()) / 2 + 1e-9]
    if mesh.dim == 2 and quadratic(mesh) and len(left) % 2 == 0:
        left = left[mesh.points[left, 0] < mesh.points[left, 0].max()]
    return replace(mesh, node_sets={**mesh.node_sets, "TOP": left, "INDENTER": left[:1]})
