"""A fitted model against everything that was measured: what it leaves, weighed, and the slopes of that."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.processes import side_by_side
from fingerfit.diagnosis.camera_blur import CameraBlur, camera_blur
from fingerfit.diagnosis.candidates import Candidate
from fingerfit.diagnosis.likelihood import Weighed
from fingerfit.diagnosis.observing import change_seen
from fingerfit.diagnosis.residual import Residual, common_modes, of_fit, residual_of
from fingerfit.diagnosis.rough import rough_covariance
from fingerfit.diagnosis.score_tests import Known, ScoreTest
from fingerfit.fit.finer import as_on_finer_mesh, on_finer_mesh
from fingerfit.fit.first_order import beside
from fingerfit.fit.intervals import at_a_bound
from fingerfit.fit.minimum import best_values, finest, left_over
from fingerfit.fit.problem import REFINED, SEARCH, InverseProblem
from fingerfit.fit.refine import ANCHOR
from fingerfit.fit.rounds import Asked, Round
from fingerfit.fit.slopes import difference, step_of
from fingerfit.forward.patches import Patches, Reader, flat
from fingerfit.forward.predict import Predictor, Synthesis
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import MESH_ERROR, Effect
from fingerfit.model.observation import Observation
from fingerfit.model.parameters import Parameter
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.study.data import Data
from fingerfit.study.several import AT

ACROSS, ACROSS_POINTS = 10, 6
"""Patches over the width of the body that pictures show, and of the region where points alone were measured."""
NEAR = 0.1
"""Share of its step at which a law of the material is tried to first order (decision 15)."""
TOGETHER = {2: 32, 3: 8}
"""Answers to first order that have their models in memory at once, in the plane and in space, at most. A choice: where
materials relax, each such part solves the known deck once more."""
CHANCE = 3.0
"""Standard deviations of a load that chance makes: 997 of 1000 loads are within. A choice (decision 49)."""

Everything = Data | Sequence[Data]
"""What was measured, in one test or in several."""
Slope = Callable[[str], np.ndarray]
"""From the name of a constant, or ``control``, to the slope of displacements and response."""


class Comparison:
    """A fitted model against all pictures of its study.

    Parameters
    ----------
    problem : InverseProblem
    last : Round
        Its last round.
    everything : Data
        Prepared with all pictures, fitted or not.
    base : Asked, optional
        The simulation that is compared; the last one on the finest mesh when left out.
    find_blur : bool
        Whether the camera's blur is looked for where none is stated: refits take that of the model without the effect.

    Raises
    ------
    StateError
        Where the simulation that is compared has no solution for all steps.
    """

    def __init__(
        self,
        problem: InverseProblem,
        last: Round,
        everything: Data,
        base: Asked | None = None,
        find_blur: bool = True,
    ) -> None:
        self.problem, self.last = problem, last
        self.patches = Patches.seen(everything, problem.meshes[SEARCH], ACROSS, ACROSS_POINTS)
        self.base = base or finest(problem, last)
        self.anchor = problem.ask(self.base.values, ANCHOR)
        self.mesh = problem.mesh_of(self.base)
        self.blur: CameraBlur | None = None
        self.data, made = everything, self._made(everything)
        if find_blur and everything.before.ndim == 2 and not everything.blur:  # none is stated
            self.blur = camera_blur(everything, made, self.patches, problem.data.picture_step)
            if self.blur.sure:
                self.data = replace(everything, blur=self.blur.size)
                made = self._made(self.data)
        self.prediction = made.prediction
        self.residual: Residual = residual_of(self.data, made.prediction, made.maps, self.patches)
        self.kept: np.ndarray = self.residual.kept & of_fit(self.residual, self.data, problem.data)
        self.places = self.residual.places, self.residual.place_patch
        seen = problem.seen(self.base.values)
        self._readers = {name: self.reader(mesh, seen) for name, mesh in problem.meshes.items()}
        self._read: dict[str, np.ndarray | None] = {}

    def _made(self, data: Data) -> Synthesis:
        predictor = Predictor(data, self.problem.meshes[self.mesh])
        made = predictor.predict(self.problem.outcome(self.base), self.problem.seen(self.base.values))
        if made is None:
            raise StateError(f"{self.problem.sims / self.base.sim}: no solution for all steps at the estimate")
        return made

    def reader(self, mesh: Mesh, seen: Observation | None) -> Reader:
        """Of solutions on a mesh, at its patches."""
        return Reader(self.data, mesh, self.patches, self.places, seen)

    def read(self, asked: Asked) -> np.ndarray | None:
        """Displacements (mm) and response (N or mm) of a simulation, shape (all,); None without a solution."""
        if asked.sim not in self._read:
            self._read[asked.sim] = self.read_answer(asked, self.problem.outcome(asked))
        return self._read[asked.sim]

    def read_answer(self, asked: Asked, outcome: Outcome) -> np.ndarray | None:
        """The same of an answer that is not kept."""
        solved = outcome.status == CONVERGED and outcome.steps >= len(self.data.step)
        return self._readers[self.problem.mesh_of(asked)].read(outcome) if solved else None

    def read_beside(self, asked: Sequence[Asked], threads: int = 1, here: Asked | None = None) -> list[Asked]:
        """Read candidates' simulations to first order, beside the anchor or, of a model without it, another solved one.

        Not those of states before the first picture: where the sides lie in it is read from whole simulations.

        Returns
        -------
        list of Asked
            What has no answer to first order and must be simulated.
        """
        here = here or self.anchor
        null = self.read(here)
        # a number that changes nothing has the anchor's own deck: its slope is 0, not what rounding leaves
        asked = [one for one in asked if one.sim not in self._read]
        near = [one for one in asked if "before" not in self._effect(one).changes]

        def answered(part: Sequence[Asked]) -> list[np.ndarray | None]:
            nearer = [self._nearer(one) for one in part]
            found = zip(nearer, beside(self.problem, here, [one for one, _ in nearer]), strict=True)
            read = [(self.read_answer(one, answer) if answer else None, share) for (one, share), answer in found]
            return [None if one is None or null is None else null + (one - null) / share for one, share in read]

        # no part is so large that a processor has none
        together = min(TOGETHER[self.problem.meshes[SEARCH].dim], -(-len(near) // threads) or 1)
        parts = [near[n : n + together] for n in range(0, len(near), together)]
        read = [one for part in side_by_side(answered, parts, threads) for one in part]
        self._read |= {one.sim: answer for one, answer in zip(near, read, strict=True) if answer is not None}
        return [one for one in asked if one.sim not in self._read]

    def _effect(self, asked: Asked) -> Effect:
        """The effect that a candidate's simulation shows; its role is the number that is not absent."""
        return self.problem.effects[asked.role.partition(".")[0]]

    def _nearer(self, asked: Asked) -> tuple[Asked, float]:
        """A candidate's simulation nearer to the anchor, and which share of its step is left.

        Of laws of the material, whose energies are far from linear within a step.
        """
        key, effect = asked.role, self._effect(asked)
        if effect.acts != "material":
            return asked, 1.0
        absent = effect.null()[key]
        value = absent + NEAR * (asked.values[key] - absent)
        return self.problem.ask({**asked.values, key: value}, key), NEAR

    def own(self, slope: Slope | None = None) -> np.ndarray:
        """Slopes of the model's own numbers, shape (kept, parameters): as from `column`."""
        columns = [self.column(parameter, slope) for parameter in self.problem.settings.parameters()]
        return np.stack(columns, axis=1)[self.kept]

    def column(self, parameter: Parameter, slope: Slope | None = None) -> np.ndarray:
        """Derivative of all values by the search coordinate of a fitted number, shape (all,).

        Of displacements and response (`slope` gives others than were measured at), and of what is seen of them.
        """
        name, _, own = parameter.name.partition(".")
        effect = self.problem.effects.get(name)
        column: Any = 0.0
        if effect is None or not effect.observes_alone:
            column = (slope or self.slope)(parameter.name)
        if effect and effect.observes:
            values = {**self.problem.settings.fixed(self.problem.effects), **self.base.values}
            # what is observed is known per unit of the number
            unit = values[parameter.name] if parameter.log else parameter.scale
            column = column + self.observed(effect, values, own) * unit
        return np.asarray(column)

    def slope(self, name: str) -> np.ndarray:
        """Slope of these by a constant, shape (all,), where the last round took it; 0 where it has no solution."""
        by_role = {asked.role: asked for asked in self.last.batch}
        ahead, behind = (self.read(by_role[sign + name]) if sign + name in by_role else None for sign in "+-")
        best = best_values(self.last)
        step = step_of(name, by_role, self.problem.settings.parameters(), best)
        found = difference(ahead, behind, lambda: self.read(self.problem.ask(best)), step)
        return np.zeros(len(self.kept)) if found is None else found

    def nuisance(self, slope: Slope | None = None, kept: np.ndarray | None = None) -> np.ndarray:
        """Signals of unknown size with standard deviation 1, shape (kept, 2 steps).

        Of each step that of the noise of the prescribed quantity, then that of the mesh; of other values if `kept`.
        """
        data, columns = self.data, []
        control = (slope or self.slope)("control")
        for step in range(len(data.step)):
            only = self._at_step(step)
            columns.append(control * self.data.control_share[step] * only)
            columns.append(self.mesh_signal * only)
        return np.stack(columns, axis=1)[self.kept if kept is None else kept]

    @cached_property
    def floor(self) -> np.ndarray:
        """Root mean square difference that a perfect model would leave, shape (pictures,).

        Noise of the pictures, and what the noise of the prescribed quantity moves.

        Raises
        ------
        StateError
            Where there is none, so that nothing can be told in its units.
        """
        floor = np.hypot(self.residual.floor, self._by_control[0])
        if not floor.all():
            study = self.problem.settings.study
            raise StateError(f"{study}: its pictures have no noise: give pictures.noise in study.yaml")
        return floor

    @cached_property
    def error(self) -> np.ndarray:
        """Root mean square difference of the pictures that their noise and that of the load do not make: (pictures,).

        What a load as far off as `CHANCE` of its standard deviations makes of a picture counts as its noise does on
        average.
        """
        made, off = self._by_control
        rest = np.maximum(self.residual.error**2 - (made * off) ** 2, 0.0)
        return np.asarray(np.sqrt(rest + made**2 * np.maximum(1.0, off**2 - CHANCE**2 + 1.0)))

    @cached_property
    def _by_control(self) -> tuple[np.ndarray, np.ndarray]:
        """What the noise of the prescribed quantity makes of each picture, and how many of its standard deviations are
        in it, each of shape (pictures,)."""
        by_role = {asked.role: asked for asked in self.last.batch}
        ahead, behind = (self.pictures(by_role.get(sign + "control")) for sign in "+-")
        slope = difference(ahead, behind, lambda: self.pictures(self.problem.ask(best_values(self.last))))
        if slope is None:
            return np.zeros(len(self.data.picture_step)), np.zeros(len(self.data.picture_step))
        noise = self.data.control_share[self.data.picture_step]
        size = self.residual.inside(slope)
        off = self.residual.times(slope, self.data.measured - self.prediction.pictures)
        return size * noise, np.divide(off, noise, out=np.zeros_like(size), where=noise > 0)

    def pictures(self, asked: Asked | None) -> np.ndarray | None:
        """Synthesized pictures of a simulation on the search mesh; None without one, or without a solution."""
        return None if asked is None else self.pictures_of(self.problem.outcome(asked), asked.values)

    def pictures_of(self, outcome: Outcome, values: Mapping[str, float]) -> np.ndarray | None:
        """The same of a solution that a guess has."""
        made = Predictor(self.data, self.problem.meshes[SEARCH]).predict(outcome, self.problem.seen(values))
        return None if made is None else made.prediction.pictures

    @cached_property
    def finer(self) -> tuple[Asked, Outcome] | None:
        """The simulation of the finer mesh, and the solution of the search mesh with what that changes, where known."""
        asked = on_finer_mesh(self.problem, self.last)
        changed = as_on_finer_mesh(self.problem, asked, self.data) if asked else None
        return None if asked is None or changed is None else (asked, changed)

    @cached_property
    def mesh_signal(self) -> np.ndarray:
        """Expected error of the mesh, shape (all,): what a finer one changes, continued by its order of convergence."""
        coarse = fine = None
        if self.mesh == REFINED:
            coarse, fine = self.read(self.anchor), self.read(self.base)
        elif self.finer is not None:  # the coarse mesh is compared, and all that a finer one changes is its error
            asked, changed = self.finer
            coarse, fine = self.read(self.problem.ask(asked.values, ANCHOR)), self._readers[SEARCH].read(changed)
        if coarse is None or fine is None:
            return np.zeros(len(self.kept))
        return (fine - coarse) * left_over(self.problem, self.mesh)

    def rough_covariance(self, signal: np.ndarray, kept: np.ndarray | None = None) -> np.ndarray:
        """Of an error as large as a signal, shape (all,), whose pattern is known only roughly; `kept` as above."""
        height, kept = float(np.ptp(self.problem.meshes[SEARCH].body[:, -1])), self.kept if kept is None else kept
        return rough_covariance(self.residual.value.shape, self.patches.centre, height, signal, kept)

    @cached_property
    def vector(self) -> np.ndarray:
        """What the model leaves of the values that choose, shape (kept,): displacements (mm), brightness, N or mm."""
        return self.whole[self.kept]

    @property
    def whole(self) -> np.ndarray:
        """What it leaves of all that was measured, held-out steps included, shape (all,); NaN where not known."""
        return self.residual.whole

    @cached_property
    def noise(self) -> np.ndarray:
        """Covariance of the noise, shape (kept, kept)."""
        chosen = self.kept[self.residual.kept]
        return self.residual.covariance[np.ix_(chosen, chosen)]

    @cached_property
    def covariance(self) -> np.ndarray:
        """Of the noise, and of the error of the mesh as a random field of its size, shape (kept, kept)."""
        return self.noise + self.rough_covariance(self.mesh_signal)

    @cached_property
    def score_test(self) -> ScoreTest:
        """ScoreTest of what the model leaves."""
        return ScoreTest(self.vector, self.covariance, self.own(), self.nuisance(), self.common(), self.known)

    @cached_property
    def weighed(self) -> Weighed:
        """What the model leaves, for comparisons with other models."""
        left = self.kept, self.vector, self.own(), self.covariance, self.nuisance()
        return Weighed(*left, known=self.known, whole=self.whole)

    @property
    def known(self) -> Known:
        """Priors (those of all tests belong to no single one), and the bounds at which numbers have ended."""
        priors, values = self.problem.priors, self.base.values
        return Known(priors.left(values), priors.rows, at_a_bound(self.problem.settings.parameters(), values))

    def common(self) -> np.ndarray:
        """What all values of a step have in common, shape (kept, modes)."""
        return common_modes(self.residual, self.data, self.slope("control"), self.kept)

    @property
    def everything(self) -> Everything:
        """What was measured."""
        return self.data

    @property
    def every(self) -> tuple[Comparison, ...]:
        """The comparisons of the tests of the study, at least one."""
        return (self,)

    def _at_step(self, step: int) -> np.ndarray:
        value: np.ndarray = np.zeros(self.residual.value.shape)
        value[self.data.entry_step == step] = 1.0
        return flat(value, (self.data.response_step == step).astype(float))

    def columns(self, candidate: Candidate, without: Asked | None = None) -> np.ndarray | None:
        """Slopes of a candidate, shape (kept, its parameters); None where a simulation has no solution.

        `without` is the simulation of the model without it, the anchor when left out.
        """
        effect, columns = candidate.effect, []
        if effect.signal == MESH_ERROR:
            return self.mesh_signal[:, None][self.kept]
        if effect.observes_alone:
            columns = [self.observed(effect, candidate.place, p.name) for p in effect.parameters]
        else:
            for parameter, asked in zip(effect.parameters, candidate.asked, strict=True):
                found = difference(self.read(asked), None, lambda: self.read(without or self.anchor), parameter.step)
                if found is None:
                    return None
                if effect.observes:  # it changes the deck and what is seen of its solution
                    found = found + self.observed(effect, candidate.place, parameter.name)
                columns.append(found)
        return np.stack(columns, axis=1)[self.kept]

    def observed(self, effect: Effect, values: Mapping[str, float], name: str) -> np.ndarray:
        """Slope of an effect on the observation by one of its parameters, of all values, shape (all,).

        There is none by a number of another test, nor where the test cannot have the effect.
        """
        name, _, test = name.partition(AT)
        if self.problem.test and (test not in ("", self.problem.test) or self.problem.lacks(effect)):
            return np.zeros(len(self.kept))
        # a place that the fit moves has bounds in place of a step
        steps = {place: 0.01 * (high - low) for place, (low, high) in effect.refine.items()}
        step = (steps | {p.name: p.step for p in effect.parameters})[name]
        points = self.problem.meshes[SEARCH].body
        now = {**effect.null(), **self.problem.own(values)}
        further = {**now, effect.key(name): now[effect.key(name)] + step}
        # formulas have all numbers of a series
        whole = self.problem.effects[effect.name] if effect.series else effect
        before, after = (
            Observation((whole,), guess, points.min(axis=0), points.max(axis=0), self.problem.study.course)
            for guess in (now, further)
        )
        changed = change_seen(self.data, self.prediction, self.residual, self.patches, before, after)
        if before.moves_first:
            mesh, outcome = self.problem.meshes[self.mesh], self.problem.outcome(self.base)
            changed = changed + self.reader(mesh, after).shown(outcome) - self.reader(mesh, before).shown(outcome)
        return changed / step


def anchor_of(problem: InverseProblem, last: Round) -> Asked:
    """The estimate on the search mesh: what the candidates are compared with."""
    return problem.ask(finest(problem, last).values, ANCHOR)
