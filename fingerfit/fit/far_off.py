"""A force (or displacement) that a fit leaves far off: one measure and one sentence for table, verdict and page."""

from __future__ import annotations

import numpy as np

from fingerfit.fit.finer import as_on_finer_mesh, on_finer_mesh
from fingerfit.fit.minimum import left_over
from fingerfit.fit.problem import REFINED, SEARCH, InverseProblem
from fingerfit.fit.refine import ANCHOR
from fingerfit.fit.rounds import Asked, Round
from fingerfit.forward.predict import response_of
from fingerfit.study.data import Data

FAR_OFF = 10.0
"""Standard deviations from which a force that the fit leaves is said: no noise makes that. A choice."""
TWICE = 2.0
"""How often the diagnosis counts the variance of the mesh's error: as a field that is smooth over body and steps, and
as a signal of each step whose size is not known (`Comparison.covariance`, `Comparison.nuisance`)."""


def response_spread(data: Data, control: np.ndarray, mesh: np.ndarray) -> np.ndarray:
    """Standard deviations of what a fit leaves of the response, shape (responses,), N or mm.

    Of its noise, of a factor common to all forces (no fault of one of them), of what the noise of the prescribed
    quantity moves, and of the error of the mesh.

    Parameters
    ----------
    data : Data
    control : ndarray, shape (responses,)
        Slope by the relative size of the prescribed quantity.
    mesh : ndarray, shape (responses,)
        Expected error of the mesh.
    """
    measured, noise = data.response
    share = data.control_share[data.response_step]
    shared = data.response_gain * np.nan_to_num(measured)
    return np.sqrt(noise**2 + shared**2 + (share * control) ** 2 + TWICE * mesh**2)


def far_off(data: Data, modelled: np.ndarray, control: np.ndarray, mesh: np.ndarray, test: str = "") -> str:
    """A sentence on the force (or displacement) that is most standard deviations off; empty where none is far off.

    Beside thousands of pixels or points one of them weighs little, so that neither score nor misfit tells.

    Parameters
    ----------
    data : Data
    modelled : ndarray, shape (responses,)
        By the fitted model, as ``data.response``.
    control, mesh : ndarray, shape (responses,)
        As of `response_spread`.
    test : str
        Name of the test, of a study with several.
    """
    measured, noise = data.response
    known = np.flatnonzero(np.isfinite(measured) & (noise > 0))
    off = np.abs(modelled - measured)[known] / response_spread(data, control, mesh)[known]
    if not off.max(initial=0.0) >= FAR_OFF:
        return ""
    n = int(known[off.argmax()])
    (kind, unit), step = data.response_name(n), data.step[data.response_step[n]]
    return (
        f"{f'{test}: ' if test else ''}{kind} of step {step} is {off.max():.0f} standard deviations off:"
        f" {measured[n]:.4g} {unit} measured, {modelled[n]:.4g} {unit} by the model"
    )


def where_to_look(data: Data, score: str) -> str:
    """What to look at where one is far off."""
    if data.control == "displacement" and score != "likelihood":  # nothing tells it how stiff the body is
        return f"the score {score} does not contain the force: score: likelihood does"
    return f"look at noise.{data.response_name(0)[0]}, at its unit, and at what the model lacks"


def response_by_mesh(problem: InverseProblem, last: Round, base: Asked) -> list[np.ndarray]:
    """Expected error of the mesh in the response of each test, as the diagnosis has it; 0 without a finer mesh.

    Parameters
    ----------
    problem : InverseProblem
    last : Round
        Its last round, all simulations solved.
    base : Asked
        The simulation of the estimate.
    """
    on_finer = problem.mesh_of(base) == REFINED
    finer = base if on_finer else on_finer_mesh(problem, last)
    if finer is None:
        return [np.zeros(len(test.data.response[0])) for test in problem.every]

    def by(test: InverseProblem, own: Asked) -> np.ndarray:
        data, coarse = test.data, test.outcome(test.ask(own.values, ANCHOR))
        made = test.outcome(own) if on_finer else as_on_finer_mesh(test, own, data)
        if made is None or min(coarse.steps, made.steps) < len(data.step):
            return np.zeros(len(data.response[0]))
        return (response_of(made, data) - response_of(coarse, data)) * left_over(test, REFINED if on_finer else SEARCH)

    return [by(test, own) for test, own in zip(problem.every, finer.every, strict=True)]
