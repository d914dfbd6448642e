"""A small body of two layers with something hidden in it, fitted in this process by a model that does not have it."""

import numpy as np
from seeds import seed_of

from fingerfit.core.files import write_json
from fingerfit.diagnosis.comparison import Comparison, anchor_of
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.settings.config import load_settings
from fingerfit.virtual.experiment import solve, write_study
from fingerfit.virtual.file import read_truth

PLACE = (0.32, 0.42)
DESCRIPTION = {
    "title": "a stiff lump",
    "body": {
        "width": 12,
        "thickness": 70,
        "layers": [
            {"name": "top", "height": 6, "mu": 0.03, "intensity": 0.5},
            {"name": "bottom", "height": 6, "mu": 0.06, "intensity": 0.9},
        ],
    },
    "material": {"alpha": 1.4, "poisson": 0.49},
    "mesh": {"element": "CPE8", "across": 12, "per_layer": 6, "grading": 2},
    "solver": "builtin",
    "displacement": [0.5, 1.0, 1.5, 2.0],
    "time": [10, 20, 30, 40],
    "picture": {
        "pixels": 96, "side": 19, "texture": 0.15, "correlation": 0.6, "noise": 0.02, "pictured": [1, 2, 3, 4]
    },
    "noise": {"force": 0.003, "displacement": 0.01},
    "seed": seed_of(5),
    "effects": {"inclusion": {"contrast": 1.0, "across": PLACE[0], "along": PLACE[1]}},
}  # fmt: skip
MESHES = {
    "mesh": {"element": "CPE8", "across": 8, "per_layer": 4, "grading": 2},
    "refined": {"element": "CPE8", "across": 10, "per_layer": 5, "grading": 2},
}
SMALL = {
    "mesh": {"element": "CPE8", "across": 5, "per_layer": 3, "grading": 2},
    "refined": {"element": "CPE8", "across": 8, "per_layer": 4, "grading": 2},
}
"""Coarser meshes, where no place has to be found."""


def written(folder, **own):
    """The study of the virtual experiment in a folder, with some of the description its own; returns where it is."""
    write_json(folder / "experiment.yaml", {**DESCRIPTION, **own})
    truth = read_truth(folder / "experiment.yaml")
    write_study(truth, solve(truth, folder / "body", 1), folder / "study")
    return folder / "study"


def config_of(study, meshes=MESHES):
    """What config.yaml says for a study of `written`."""
    mu = {"unit": "MPa", "start": 0.05, "lower": 0.01, "upper": 0.2}
    model = {"material": DESCRIPTION["material"], **meshes, "parameters": {"mu_top": mu, "mu_bottom": mu}}
    stages = [{"name": "grid", "kind": "grid", "points": 3}]
    stages += [{"name": "independent", "kind": "independent", "tolx": 0.2, "tolf": 2e-2}]
    fitting = {"score": "nmi", "bins": 16, "steps": [2, 4], "stages": stages}
    return {"study": str(study), "model": model, "fit": fitting}


def fitted(study, folder, meshes=MESHES):
    """The problem, its last round, how many simulations were run, and the data with all pictures."""
    problem, everything = begin(load_settings(config_of(study, meshes)), folder)
    return problem, *run_fit(problem, 1), everything


def compared(problem, last, everything, found):
    """The comparison of the fitted model, with candidates and what they are compared with solved; and their number."""
    run = solve_missing(problem, [anchor_of(problem, last), *(asked for one in found for asked in one.asked)], 1)
    return Comparison(problem, last, everything), run


def to_first_order(comparison, candidates):
    """Signatures of candidates by simulations and to first order, by effect, and the names of those that have both."""
    again = Comparison(comparison.problem, comparison.last, comparison.data)
    left = {one.sim for one in again.read_beside([asked for one in candidates for asked in one.asked])}
    read = {one.effect.name for one in candidates if not left & {asked.sim for asked in one.asked}}
    test = comparison.score_test
    exact, first = (
        {one.effect.name: test.signature(c.columns(one)) for one in candidates if one.effect.name in read}
        for c in (comparison, again)
    )
    return exact, first, read


def alike_to(a, b):
    """Cosine between two signatures of one column."""
    return float(np.ravel(a) @ np.ravel(b) / np.linalg.norm(a) / np.linalg.norm(b))
