"""A fitted model examined: compared with everything that was measured, suspects tested, the best refitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fingerfit.data import Data
from fingerfit.diagnose import Examination, Look, anchor_of, look, suspects
from fingerfit.extend import extended
from fingerfit.fit import Fit
from fingerfit.judge import Judge
from fingerfit.refine import finest, minimum
from fingerfit.rounds import Round
from fingerfit.simulate import run_fit, solve_missing
from fingerfit.verdict import Refit, Verdict, decide, to_refit


@dataclass(frozen=True)
class Examined:
    """All that was found out about a model.

    Parameters
    ----------
    examination : Examination
    judge : Judge
    looks : list of Look
        Tested effects, the best first.
    refits : dict
        Refits of the best ones, by effect.
    verdict : Verdict
    run : int
        Simulations that were not known before.
    measurements : list of (str, float)
        Changes of the measurement and by how much each would separate the first two effects better.
    """

    examination: Examination
    judge: Judge
    looks: list[Look]
    refits: dict[str, Refit]
    verdict: Verdict
    run: int
    measurements: list[tuple[str, float]]


def examine(fit: Fit, last: Round, everything: Data, threads: int = 1) -> Examined:
    """Examine a fitted model.

    Parameters
    ----------
    fit : Fit
    last : Round
        Its last round, all simulations solved.
    everything : Data
        Prepared with all pictures, fitted or not.
    threads : int
        Simulations beside each other.
    """
    found = suspects(fit, finest(fit, last).values)
    run = solve_missing(fit, [anchor_of(fit, last), *(asked for suspect in found for asked in suspect.asked)], threads)
    examination = Examination(fit, last, everything)
    judge, looks = look(examination, found)
    refits: dict[str, Refit] = {}
    for candidate in to_refit(judge, looks, len(found)):
        refit, more = _refit(fit, last, candidate, everything, threads)
        refits[candidate.suspect.effect.name] = refit
        run += more
    verdict = decide(judge, looks, refits, len(found))
    measurements = separating(examination, looks) if verdict.kind == "indistinguishable" else []
    return Examined(examination, judge, looks, refits, verdict, run, measurements)


def errors(examination: Examination) -> tuple[float, float | None]:
    """Error of fitted and of held-out pictures in units of the noise floor; 1 is the noise."""
    ratio = examination.residual.error / examination.floor
    fitted = fitted_pictures(examination.fit, examination.data)
    held = ratio[~fitted]
    return _root_mean_square(ratio[fitted]), _root_mean_square(held) if len(held) else None


def fitted_pictures(fit: Fit, data: Data) -> np.ndarray:
    """Which pictures the fit used, bool."""
    wanted = fit.settings.fit.steps
    return np.array([wanted is None or int(data.step[step]) in wanted for step in data.picture_step], dtype=bool)


def _refit(fit: Fit, last: Round, one: Look, everything: Data, threads: int) -> tuple[Refit, int]:
    wider = widened(fit, last, one)
    end, run = run_fit(wider, threads)
    run += solve_missing(wider, [anchor_of(wider, end)], threads)
    examination = Examination(wider, end, everything)
    judge = look(examination, [])[0]
    fitted, held_out = errors(examination)
    return Refit(judge.misfit, judge.freedom, fitted, held_out, minimum(wider, end).values), run


def widened(fit: Fit, last: Round, one: Look) -> Fit:
    """Fit of the model with a tested effect more, from where `fit` ended."""
    settings = extended(fit.settings, one.suspect.effect, one.suspect.place, one.size, minimum(fit, last).values)
    return Fit(settings, fit.data, fit.mesh_files, fit.sims)


def separating(examination: Examination, looks: list[Look]) -> list[tuple[str, float]]:
    """What would separate the first two effects: changes of the measurement and their gain, the best first.

    The gain is how much larger the signal of the first effect becomes, in units of the noise and after all that the
    second and the model's own constants can imitate is taken away.
    """
    residual = examination.residual
    noise, mesh = residual.covariance, examination.mesh_covariance()
    nuisance, own = examination.nuisance(), examination.own()
    pictures = np.flatnonzero(residual.kept) < residual.value.size
    finer = np.where(pictures[:, None] & pictures[None], 0.25, 1.0)
    sharper = np.where(pictures[:, None] & pictures[None], 1.0, 0.04)
    without_force = nuisance.copy()
    without_force[:, 0::2] *= 0.2
    designs = {
        "as measured": (noise, mesh, nuisance),
        "pictures with half the noise (four repetitions averaged)": (noise * finer, mesh, nuisance),
        "forces and displacements measured five times better": (noise * sharper, mesh, without_force),
        "a mesh of half the element size": (noise, mesh * 0.2, nuisance),
    }
    first, second = looks[0], looks[1]
    signal = {}
    for title, (covariance, error, unknown) in designs.items():
        judge = Judge(residual.vector, covariance + error, np.concatenate([own, second.columns], axis=1), unknown)
        signal[title] = float((judge.signature(first.columns @ first.finding.size[:, None]) ** 2).sum())
    base = max(signal.pop("as measured"), 1e-300)
    return sorted(((title, value / base) for title, value in signal.items()), key=lambda pair: -pair[1])


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
