"""What every round of a fit needs: settings, data, meshes; from a guess to its deck, prediction and score."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fingerfit.core.errors import InputError, StateError
from fingerfit.core.files import digest, write_text
from fingerfit.deck.mesh_file import format_mesh, read_mesh
from fingerfit.fit.aside import predicted
from fingerfit.fit.discrepancy import Discrepancy
from fingerfit.fit.identified import SURE
from fingerfit.fit.kept import Kept
from fingerfit.fit.linear import LinearModel
from fingerfit.fit.lost import Lost
from fingerfit.fit.objective import Objective
from fingerfit.fit.priors import Priors, unit
from fingerfit.fit.rounds import Asked
from fingerfit.forward.bodies import lift, moved
from fingerfit.forward.decks import make_deck, refusal, template_of
from fingerfit.forward.predict import Predictor, Synthesis, since_first_picture
from fingerfit.forward.score import Prediction, chi_square, deviations, score
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.applicable import unmet
from fingerfit.model.effect import Effect
from fingerfit.model.observation import Observation
from fingerfit.search.stages import LEAST_SQUARES
from fingerfit.solvers.contract import BY_PATH, Capabilities, Outcome
from fingerfit.solvers.cost import SHORT, expected_seconds
from fingerfit.solvers.registry import get_solver
from fingerfit.study.data import Data
from fingerfit.study.several import of_test
from fingerfit.study.study import Study, with_gain

if TYPE_CHECKING:
    from fingerfit.forward.match import Matcher
    from fingerfit.settings.config import Settings

SEARCH, REFINED = "search", "refined"
"""Meshes: of the search, and the finer one where there is one."""
SENSITIVITY, FINAL = "sensitivity", "final"
"""Stages after the search; `FINAL` is also the role of a guess that is solved on the finest mesh."""


@dataclass(frozen=True)
class InverseProblem:
    """Everything a round needs.

    Parameters
    ----------
    settings : Settings
    data : Data
        Measurements, prepared.
    mesh_files : dict
        ``search`` and, where there is one, ``refined``.
    sims : Path
        Folder of the simulations.
    asked : set of str
        Names of the simulations that were asked for inside this process.
    test : str
        Which test of the study it is of, where there are several (`fingerfit.fit.joint`).
    counted : bool
        Whether the noise of the data is the one that they count with beside an error of the model.
    kept : Kept, optional
        Where predictions are kept that the next jobs need, too.
    lost : Lost
        Simulations without an answer.
    """

    settings: Settings
    data: Data
    mesh_files: dict[str, Path]
    sims: Path
    asked: set[str] = field(default_factory=set, repr=False, compare=False)
    test: str = ""
    counted: bool = False
    kept: Kept | None = field(default=None, repr=False, compare=False)
    lost: Lost = field(default_factory=Lost, repr=False, compare=False)
    _predictions: dict[str, Prediction] = field(default_factory=dict, repr=False, compare=False)
    _folded: dict[str, bool] = field(default_factory=dict, repr=False, compare=False)
    _names: dict[str, str] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def study(self) -> Study:
        """The study, or its test."""
        return self.settings.read_study().of_test(self.test)

    @property
    def every(self) -> tuple[InverseProblem, ...]:
        """The fits of the tests of the study, at least one."""
        return (self,)

    @cached_property
    def solver(self) -> dict[str, Any]:
        """Identity of the solver."""
        return get_solver(self.settings.solver).identity()

    @cached_property
    def meshes(self) -> dict[str, Mesh]:
        """The meshes."""
        return {name: read_mesh(path) for name, path in self.mesh_files.items()}

    @cached_property
    def mesh_names(self) -> dict[str, str]:
        """Hashes of the mesh files."""
        return {name: digest(path.read_bytes()) for name, path in self.mesh_files.items()}

    @property
    def mesh_paths(self) -> dict[str, Path]:
        """Files of the meshes by the hashes of their contents."""
        return {self.mesh_names[name]: path for name, path in self.mesh_files.items()}

    @property
    def exact(self) -> bool:
        """Whether forces and points alone are fitted, by their likelihood: cheap, smooth, with a scale of its own."""
        return self.settings.fit.score == "likelihood" and not len(self.data.picture_step)

    @property
    def observed(self) -> np.ndarray:
        """Which parameters belong to effects on the observation that the score of pictures may not see, bool."""
        blind = self.settings.fit.score != "likelihood"
        acting = [e for e in self.effects.values() if e.observes_alone]
        mine = {e.key(name) for e in acting for name in (*(p.name for p in e.parameters), *e.refine)}
        return np.array([blind and p.name in mine for p in self.settings.parameters()], dtype=bool)

    @property
    def descends(self) -> bool:
        """Whether a stage of the search is one of least squares, for which displacements are registered."""
        return any(stage.kind == LEAST_SQUARES for stage in self.settings.fit.stages)

    @cached_property
    def matcher(self) -> Matcher:
        """Matches of guesses on the mesh of the search."""
        from fingerfit.forward.match import Matcher

        return Matcher(self.data, self.meshes[SEARCH])

    def predictor(self, mesh: str) -> Predictor:
        """Predictor of solutions on a mesh, for scores."""
        return Predictor(self.data, self.meshes[mesh], partial=True)

    def ask(
        self,
        values: Mapping[str, float],
        role: str = SEARCH,
        gain: float = 1.0,
        study: Study | None = None,
        mesh: str | None = None,
        nearby: Mapping[str, float] | None = None,
        first_order: bool = True,
    ) -> Asked:
        """Deck and name of the simulation of a guess.

        Parameters
        ----------
        values : mapping
        role : str
        gain : float
            Multiplies the prescribed quantity.
        study : Study, optional
            Another one than was measured.
        mesh : str, optional
            Another one than the role has.
        nearby : mapping, optional
            A guess on the same mesh a step away: beside its solution this one is answered to first order, or begins
            there, where it is long; where the solver can. One with the same deck is that guess.
        first_order : bool
            Whether the step is small enough to be answered so.
        """
        mesh = mesh or (REFINED if role == FINAL and REFINED in self.mesh_files else SEARCH)
        study, name = with_gain(study or self.study, gain), self.mesh_names[mesh]
        deck = make_deck(self.settings, study, self.meshes[mesh], name, self.own(values), self.effects)
        asked = Asked(dict(values), "", name, deck, role).named(self.solver)
        if nearby is None or (begun := self._name(nearby, mesh)) == asked.sim:
            return asked
        beside = first_order and self._can.first_order and not BY_PATH.search(deck)
        begins = beside or (self.long and self._can.nearby)
        return replace(asked, nearby=begun, first_order=beside).named(self.solver) if begins else asked

    def _name(self, values: Mapping[str, float], mesh: str) -> str:
        """Name of the simulation of a guess; kept, because each slope asks for that of its middle."""
        key = json.dumps([values, mesh], sort_keys=True)
        if key not in self._names:
            self._names[key] = self.ask(values, mesh=mesh).sim
        return self._names[key]

    @cached_property
    def long(self) -> bool:
        """Whether a simulation takes longer than is worth a job of its own."""
        return expected_seconds(self.settings.solver, self.meshes[SEARCH].dim, len(self.meshes[SEARCH].points)) > SHORT

    @property
    def beside(self) -> int:
        """How many simulations can run beside another one."""
        return self.settings.fit.batch - 1

    @cached_property
    def _can(self) -> Capabilities:
        return get_solver(self.settings.solver).capabilities

    def own(self, values: Mapping[str, float]) -> dict[str, float]:
        """What a guess of all tests is in this one: without numbers of other tests, and effects that it cannot have."""
        if not self.test:
            return dict(values)
        found = of_test(values, self.test)
        return found | {name: value for name, value in self._absent.items() if name in found}

    @cached_property
    def _absent(self) -> dict[str, float]:
        return {name: v for e in self.effects.values() if self.lacks(e) for name, v in e.null().items()}

    def lacks(self, effect: Effect) -> list[str]:
        """What an effect needs that the study, or its test, does not have, in words."""
        return unmet(effect, self.study, self.meshes[SEARCH], REFINED in self.mesh_files)

    def is_solved(self, asked: Asked) -> bool:
        """Whether a guess has an answer, in each of the tests; no equilibrium is one, and so is that it is lost."""
        return all(self.lost.why(one.sim) or (self.sims / one.sim / "solution.npz").exists() for one in asked.every)

    def refusal(self, asked: Asked) -> InputError | None:
        """Why the solver does not take the deck of a guess; None where it does, or has solved it before."""
        if self.is_solved(asked):
            return None
        settings, file = self.settings, self.mesh_files[self.mesh_of(asked)]
        return refusal(settings.solver, template_of(settings, self.study), asked.deck, file, asked.mesh)

    def with_mesh(self, name: str, mesh: Mesh) -> InverseProblem:
        """The fit with one mesh more."""
        text = format_mesh(mesh)
        path = self.sims.parent / "meshes" / f"{digest(text)}.inp"
        write_text(path, text)
        files = {**self.mesh_files, name: path}
        return InverseProblem(self.settings, self.data, files, self.sims, self.asked, self.test, lost=self.lost)

    def with_settings(self, settings: Settings) -> InverseProblem:
        """The fit of another model to the same measurements."""
        return InverseProblem(settings, self.data, self.mesh_files, self.sims, test=self.test, lost=self.lost)

    @cached_property
    def effects(self) -> dict[str, Effect]:
        """All effects that are known in this study."""
        return self.settings.known_effects()

    def seen(self, values: Mapping[str, float]) -> Observation | None:
        """Effects on the observation that a guess has."""
        everything = {**self.settings.fixed(self.effects), **self.own(values)}
        return Observation.of(self.effects.values(), everything, self.meshes[SEARCH].body, self.study.course)

    def mesh_of(self, asked: Asked) -> str:
        """Which of the meshes a guess is solved on."""
        return REFINED if self.mesh_names.get(REFINED) == asked.mesh else SEARCH

    def outcome(self, asked: Asked) -> Outcome:
        """Solution of a guess on the nodes of its mesh, since the first picture; nodes of tools come after them."""
        return self.seen_since(self.answer(asked.sim), asked)

    def answer(self, sim: str) -> Outcome:
        """What the solver answered to a simulation; of one that is lost, that there is no equilibrium in any step.

        Raises
        ------
        StateError
            When it is missing or damaged.
        """
        return self.lost.answer(sim, self.meshes[SEARCH].dim) or Outcome.load(self.sims / sim / "solution.npz")

    def seen_since(self, whole: Outcome, asked: Asked, steps: int = 0) -> Outcome:
        """The same of what a solver answers to the deck of a guess; of the first few steps where so many are known."""
        mesh = self.meshes[self.mesh_of(asked)]
        body = replace(whole, displacement=whole.displacement[:, : len(mesh.points)])
        counted, deck = steps or len(self.data.step), asked.deck
        return since_first_picture(body, counted, self.data.outline > 0, lift(mesh, deck), moved(mesh, deck))

    def synthesis(self, asked: Asked) -> Synthesis:
        """What should have been measured by a guess that must have a solution, and its maps."""
        made = self._synthesis(asked)
        if made is None:
            raise StateError(f"{self.sims / asked.sim}: no solution beside the best guess ({asked.role})")
        return made

    def _synthesis(self, asked: Asked) -> Synthesis | None:
        return self.predictor(self.mesh_of(asked)).predict(self.outcome(asked), self.seen(asked.values))

    def prediction(self, asked: Asked) -> Prediction:
        """The same without the maps; kept."""
        key = _key(asked)
        if key not in self._predictions:
            self._predictions[key], self._folded[key] = self.synthesis(asked).without_maps
        return self._predictions[key]

    def folds(self, asked: Asked) -> bool:
        """Whether the body goes through itself in the pictures of a guess that has a solution: no body does."""
        key = _key(asked)
        if key not in self._folded:
            self.prediction(asked)
        return self._folded[key]

    def predict_all(self, batch: Sequence[Asked], processes: int) -> None:
        """Keep the predictions of all guesses that have a solution, made beside each other, and no others.

        Those of an earlier round are not asked for again.
        """
        wanted = {_key(asked) for asked in batch}
        for key in self._predictions.keys() - wanted:
            del self._predictions[key]
        self.seen({})  # what is read here is not read again by each process
        self._read_kept(batch)
        new = list({_key(asked): asked for asked in batch if _key(asked) not in self._predictions}.values())
        made = predicted(self._synthesis, new, self.data.measured.shape, self.sims, processes)
        for asked, found in zip(new, made, strict=True):
            if found is not None:
                self._predictions[_key(asked)], self._folded[_key(asked)] = found

    def _read_kept(self, batch: Sequence[Asked]) -> None:
        for asked in batch:
            key = _key(asked)
            if self.kept is None or key in self._predictions or self.seen(asked.values) is not None:
                continue
            if (found := self.kept.load(key)) is not None:
                self._predictions[key], self._folded[key] = found

    def keep(self, batch: Sequence[Asked]) -> None:
        """Keep the predictions of guesses that were made for the jobs that follow, and no others."""
        if self.kept is None:
            return
        # the formulas of effects on the observation are no part of a name
        by_key = {_key(asked): asked for asked in batch if self.seen(asked.values) is None}
        self.kept.only(by_key)
        for key in by_key.keys() & self._predictions.keys():
            self.kept.save(key, self._predictions[key], self._folded[key])

    def score(self, prediction: Prediction, values: Mapping[str, float]) -> float:
        """Score of a guess and its prediction, priors included."""
        return self.fit_to_data(prediction) + self.penalty(values)

    def penalty(self, values: Mapping[str, float]) -> float:
        """What priors add to the score of a guess."""
        return self.unit * 0.5 * float(np.sum(self.priors.left(values) ** 2)) if self.priors else 0.0

    @cached_property
    def discrepancy(self) -> Discrepancy | None:
        """What the model is wrong by, where the score allows for it."""
        if self.counted or self.settings.fit.discrepancy == "none":
            return None
        return Discrepancy.of(self.data, self.meshes[SEARCH].body)

    def as_counted(self, prediction: Any) -> InverseProblem:
        """The fit with the noise that the data count with there: its likelihood has the slopes of the score."""
        if self.discrepancy is None:
            return self
        return replace(self, data=self.discrepancy.weighed(prediction, self.data), counted=True)

    def fit_to_data(self, prediction: Prediction) -> float:
        """Score of a prediction by the data alone."""
        if self.discrepancy:
            return self.discrepancy.score(chi_square(prediction, self.data))
        return score(self.settings.fit.score, prediction, self.data, self.settings.fit.bins)

    @cached_property
    def priors(self) -> Priors:
        """What was known of the parameters before."""
        return Priors.of(self.settings.parameters())

    @cached_property
    def unit(self) -> float:
        """What one unit of the log likelihood is in the score."""
        return unit(self.settings.fit.score, self.data, self.settings.fit.smooth, self.settings.fit.bins)

    @property
    def sure(self) -> float:
        """Curvature of the score of the data that is seen in any case: with a scale of its own, half a chi-square's."""
        return SURE if self.exact else np.inf

    def deviations(self, prediction: Prediction) -> np.ndarray:
        """Response and points less what was measured, in units of the noise, where both are known."""
        return deviations(prediction, self.data)

    def objective(self, model: LinearModel, known: bool = True) -> Objective:
        """Score of a linear model at a distance of shape (parameters,) from its base; `known`: priors included."""
        of_data, priors = self._objective(model), self.priors
        if not (known and priors):
            return of_data
        return Objective.total([of_data, Objective.squares(0.5 * self.unit, priors.left(model.values), priors.rows)])

    def _objective(self, model: LinearModel) -> Objective:
        if self.discrepancy:
            return self.discrepancy.objective(model.misfits(self.data))
        return model.objective(self.settings.fit.score, self.data, self.settings.fit.bins)


def _key(asked: Asked) -> str:
    """A simulation may be seen by several guesses whose effects are on the observation alone."""
    return asked.sim + json.dumps(asked.values, sort_keys=True)
