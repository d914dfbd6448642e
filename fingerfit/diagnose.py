"""Which physical effect is missing: every effect of the catalogue is tested against what the model leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.data import Data
from fingerfit.effects.contract import Effect
from fingerfit.effects.observe import Observation
from fingerfit.estimate import STEP
from fingerfit.fit import REFINED, SEARCH, Fit
from fingerfit.imaging.pictures import Picture
from fingerfit.judge import Finding, Judge, likeness
from fingerfit.predict import Predictor, positions
from fingerfit.refine import ANCHOR, finest, left_over, mesh_of
from fingerfit.residual import Patches, Reader, Residual, flat, residual_of
from fingerfit.rounds import Asked, Round
from fingerfit.solvers.contract import CONVERGED

SMOOTH = 3.0
"""Length over which the error of a mesh is alike, mm."""
ALIKE = 0.9
"""Correlation of that error between steps."""
OBSERVED = "observation"


@dataclass(frozen=True)
class Suspect:
    """An effect at one place, with the simulations that show it.

    Parameters
    ----------
    effect : Effect
    place : dict
        Its scanned numbers.
    asked : tuple of Asked
        One for each parameter; none for effects on the observation.
    """

    effect: Effect
    place: dict[str, float]
    asked: tuple[Asked, ...] = ()


@dataclass(frozen=True)
class Look:
    """A tested suspect: what it would explain, and its columns."""

    suspect: Suspect
    finding: Finding
    columns: np.ndarray


def suspects(fit: Fit, values: Mapping[str, float]) -> list[Suspect]:
    """Effects that make sense in this study and are not in the model, with their simulations at small sizes."""
    study, found = fit.study, []
    timed = all(step.time is not None for step in study.steps)
    for effect in fit.effects.values():
        if effect.name in fit.settings.model.effects or (effect.needs == "time" and not timed):
            continue
        if effect.control and effect.control != study.control:
            continue
        if fit.meshes[SEARCH].dim != 2 and effect.part:
            continue
        for place in effect.places():
            if "layer" in effect.scan and place[effect.key("layer")] > len(study.layer_names):
                continue
            asked = []
            for parameter in effect.parameters if effect.acts != OBSERVED and effect.name != "coarse_mesh" else ():
                trial = {**effect.null(), **place, effect.key(parameter.name): parameter.null + parameter.step}
                asked.append(fit.ask({**values, **trial}, f"{effect.name}.{parameter.name}"))
            found.append(Suspect(effect, place, tuple(asked)))
    return found


class Examination:
    """A fitted model against all pictures of its study.

    Parameters
    ----------
    fit : Fit
    last : Round
        Its last round.
    values : mapping
        The estimate.
    everything : Data
        Prepared with all pictures, fitted or not.
    """

    def __init__(self, fit: Fit, last: Round, values: Mapping[str, float], everything: Data) -> None:
        self.fit, self.last, self.values, self.data = fit, last, dict(values), everything
        spacing = everything.spacing if len(everything.picture_step) else None
        self.patches = Patches.over(fit.meshes[SEARCH], spacing=spacing)
        self.base = finest(fit, last)
        self.mesh = mesh_of(fit, self.base)
        predictor = Predictor(everything, fit.meshes[self.mesh])
        outcome, seen = fit.outcome(self.base), fit.seen(self.base.values)
        predicted = predictor.predict(outcome, seen)
        assert predicted is not None
        self.prediction, self.faults = predicted
        self.maps = predictor.maps(outcome, seen)
        self.residual: Residual = residual_of(everything, self.prediction, self.maps, self.patches)
        self._readers = {name: Reader(everything, mesh, self.patches) for name, mesh in fit.meshes.items()}

    def read(self, asked: Asked) -> np.ndarray | None:
        """Displacements and conjugate quantity of a simulation; None without a solution."""
        outcome = self.fit.outcome(asked)
        if outcome.status != CONVERGED or outcome.steps < len(self.data.step):
            return None
        return self._readers[mesh_of(self.fit, asked)].read(outcome)

    def own(self) -> np.ndarray:
        """Slopes of the model's own constants, shape (kept, parameters)."""
        by_role = {asked.role: asked for asked in self.last.batch}
        middle = self.read(self.fit.ask(self.searched()))
        columns = []
        for parameter in self.fit.settings.parameters():
            column = self._slope(by_role, parameter.name, middle)
            effect = self.fit.effects.get(parameter.name.split(".")[0])
            if effect is not None and effect.acts == OBSERVED:
                column = self._observed(effect, self.values, parameter.name.split(".")[1])
            columns.append(column)
        return np.stack(columns, axis=1)[self.residual.kept]

    def searched(self) -> dict[str, float]:
        """Where the slopes were taken."""
        best = self.last.best
        assert best is not None
        return dict(best["values"])

    def _slope(self, by_role: Mapping[str, Asked], name: str, middle: np.ndarray | None) -> np.ndarray:
        sides = [self.read(by_role[sign + name]) if sign + name in by_role else None for sign in "+-"]
        width = STEP * sum(side is not None for side in sides)
        ahead, behind = (middle if side is None else side for side in sides)
        if ahead is None or behind is None or width == 0:
            return np.zeros(len(self.residual.kept))
        return (ahead - behind) / width

    def nuisance(self, anchor: Asked) -> np.ndarray:
        """Signals of unknown size with standard deviation 1, shape (kept, nuisances)."""
        by_role = {asked.role: asked for asked in self.last.batch}
        data, columns = self.data, []
        control = self._slope(by_role, "control", self.read(self.fit.ask(self.searched())))
        size = np.abs(data.controlled)
        relative = np.divide(data.control_noise, size, out=np.zeros_like(size), where=size > 0)
        mesh = self.mesh_signal(anchor)
        for step in range(len(data.step)):
            only = self._at_step(step)
            columns.append(control * relative[step] * only)
            columns.append(mesh * only)
        return np.stack(columns, axis=1)[self.residual.kept]

    def mesh_signal(self, anchor: Asked) -> np.ndarray:
        """Expected error of the finest mesh: what it changed, continued with its order of convergence."""
        coarse = self.read(anchor)
        fine = self.read(self.base)
        if self.mesh != REFINED or coarse is None or fine is None:
            return np.zeros(len(self.residual.kept))
        return (fine - coarse) * left_over(self.fit)

    def mesh_covariance(self, anchor: Asked) -> np.ndarray:
        """Error of the mesh as a random field, shape (kept, kept).

        Its size is known, patch by patch and step by step, its pattern only roughly: it is taken to be smooth over
        `SMOOTH` mm and much alike at all steps.
        """
        value = self.residual.value
        signal = self.mesh_signal(anchor)
        dim = value.shape[2] - 1
        field = signal[: value.size].reshape(value.shape)[..., :dim]
        size = np.linalg.norm(field, axis=2) / np.sqrt(dim)
        apart = ((self.patches.centre[:, None] - self.patches.centre[None]) ** 2).sum(axis=2)
        near = np.exp(-apart / (2 * SMOOTH**2))
        steps = np.where(np.eye(len(size), dtype=bool), 1.0, ALIKE)
        total = np.zeros((*value.shape, *value.shape))
        for axis in range(dim):
            total[:, :, axis, :, :, axis] = np.einsum("np,pq,nm,mq->npmq", size, near, steps, size, optimize=True)
        count = len(self.residual.kept)
        whole = np.zeros((count, count))
        whole[: value.size, : value.size] = total.reshape(value.size, value.size)
        return np.nan_to_num(whole[np.ix_(self.residual.kept, self.residual.kept)])

    def _at_step(self, step: int) -> np.ndarray:
        value: np.ndarray = np.zeros(self.residual.value.shape)
        value[self.data.picture_step == step] = 1.0
        conjugate = np.zeros(len(self.data.step))
        conjugate[step] = 1.0
        return flat(value, conjugate)

    def columns(self, suspect: Suspect, anchor: Asked) -> np.ndarray | None:
        """Slopes of a suspect, shape (kept, its parameters); None where a simulation has no solution."""
        effect, columns = suspect.effect, []
        if effect.name == "coarse_mesh":
            return self.mesh_signal(anchor)[:, None][self.residual.kept]
        if effect.acts == OBSERVED:
            columns = [self._observed(effect, suspect.place, p.name) for p in effect.parameters]
        else:
            null = self.read(anchor)
            for parameter, asked in zip(effect.parameters, suspect.asked, strict=True):
                found = self.read(asked)
                if found is None or null is None:
                    return None
                columns.append((found - null) / parameter.step)
        return np.stack(columns, axis=1)[self.residual.kept]

    def _observed(self, effect: Effect, values: Mapping[str, float], name: str) -> np.ndarray:
        """Slope of an effect on the observation by one of its parameters."""
        parameter = next(p for p in effect.parameters if p.name == name)
        trial = {
            **effect.null(),
            **values,
            effect.key(name): values.get(effect.key(name), parameter.null) + parameter.step,
        }
        data, dim = self.data, self.fit.meshes[SEARCH].dim
        seen = Observation((effect,), trial, *self._corners(), len(data.step))
        x, y = positions(Picture(data.before, data.spacing, data.origin, data.direction))
        value: np.ndarray = np.zeros(self.residual.value.shape)
        for n, (step, picture, way) in enumerate(
            zip(data.picture_step, self.prediction.pictures, self.residual.fits, strict=True)
        ):
            value[n][:, :dim] = seen.shift(int(step) + 1)
            change = (seen.intensity(picture, int(step) + 1, x, y) - picture).ravel()[way.pixel]
            size = np.maximum(np.bincount(way.patch, minlength=value.shape[1]), 1)
            value[n][:, dim] = np.bincount(way.patch, change, minlength=value.shape[1]) / size
        conjugate = self.prediction.conjugate
        name = "displacement" if data.control == "force" else "force"
        changed = seen.conjugate(conjugate, name) - conjugate
        return flat(value, changed) / parameter.step

    def _corners(self) -> tuple[np.ndarray, np.ndarray]:
        points = self.fit.meshes[SEARCH].points
        return points.min(axis=0), points.max(axis=0)


def anchor_of(fit: Fit, values: Mapping[str, float]) -> Asked:
    """The estimate on the search mesh: what the suspects are compared with."""
    return fit.ask(values, ANCHOR)


def look(examination: Examination, found: Sequence[Suspect], anchor: Asked) -> tuple[Judge, list[Look]]:
    """Test all suspects; the best place of each effect only, by predicted fall."""
    kept = examination.residual
    covariance = kept.covariance + examination.mesh_covariance(anchor)
    judge = Judge(kept.vector, covariance, examination.own(), examination.nuisance(anchor))
    best: dict[str, Look] = {}
    for suspect in found:
        columns = examination.columns(suspect, anchor)
        if columns is None:
            continue
        parameters = suspect.effect.parameters
        low = np.array([p.lower - p.null for p in parameters])
        high = np.array([p.upper - p.null for p in parameters])
        tested = Look(suspect, judge.test(columns, low, high), columns)
        name = suspect.effect.name
        if name not in best or tested.finding.fall > best[name].finding.fall:
            best[name] = tested
    return judge, sorted(best.values(), key=lambda one: -one.finding.fall)


def alike(judge: Judge, a: Look, b: Look) -> float:
    """How much of one effect's signature the other can imitate."""
    return likeness(judge.signature(a.columns), judge.signature(b.columns))


def summary(judge: Judge, looks: Sequence[Look]) -> list[dict[str, Any]]:
    """Ranking as data."""
    excess = max(judge.misfit - judge.freedom, 1e-300)
    return [
        {
            "effect": one.suspect.effect.name,
            "place": one.suspect.place,
            "predicted_fall": one.finding.fall,
            "share_of_excess": float(min(1.0, one.finding.fall / excess)),
            "size": {
                p.name: float(p.null + s) for p, s in zip(one.suspect.effect.parameters, one.finding.size, strict=True)
            },
            "visible": one.finding.visible,
        }
        for one in looks
    ]
