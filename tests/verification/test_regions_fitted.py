"""A region that the study outlines: data of CalculiX on another mesh; the homogeneous model lacks it, and with it nothing is missing."""

import numpy as np
import pytest
import yaml
from small_body import DESCRIPTION, compared, config_of, written

from fingerfit.core.files import write_json
from fingerfit.diagnosis.candidates import candidates
from fingerfit.diagnosis.ranking import rank_candidates
from fingerfit.diagnosis.trials import refit_all
from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.minimum import finest
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.settings.config import load_settings

MU, CONTRAST = 0.03, 1.0
PATCH = """\
title: a stiffer patch
acts: structure
words: A patch that is stiffer, with sharp edges.
look: Material flows around it.
confirm: A cut.
parameters:
  contrast: {unit: log, absent: 0, lower: -2, upper: 2, step: 0.2}
changes:
  field: "contrast * where(abs((x - 4.5) * 0.8 + (up - 7) * 0.6) < 2.5, 1, 0) * where(abs((up - 7) * 0.8 - (x - 4.5) * 0.6) < 1.8, 1, 0)"
"""
OUTLINE = [[5.42, 9.94], [1.42, 6.94], [3.58, 4.06], [7.58, 7.06]]


@pytest.mark.slow
def test_the_region_is_what_is_missing_and_its_constants_are_right(tmp_path):
    (tmp_path / "own/effects").mkdir(parents=True)
    (tmp_path / "own/effects/patch.yaml").write_text(PATCH)
    body = {**DESCRIPTION["body"], "layers": [{"name": "gel", "height": 12, "mu": MU, "intensity": 0.7}]}
    mesh = {"element": "CPE8", "across": 18, "per_layer": 18, "grading": 1}
    hidden = {"effects": {"patch": {"contrast": CONTRAST}}, "own": "own"}
    study = written(tmp_path, body=body, mesh=mesh, solver="calculix", **hidden)
    described = yaml.safe_load((study / "study.yaml").read_text())
    described["body"]["regions"] = [{"name": "patch", "outline": OUTLINE}]
    write_json(study / "study.yaml", described)
    given = config_of(study)
    sizes = {"mesh": 12, "refined": 20}
    given["model"] |= {name: {"element": "CPE8", "across": n, "per_layer": n} for name, n in sizes.items()}
    given["model"]["parameters"] = {"mu": {"unit": "MPa", "start": 0.05, "lower": 0.01, "upper": 0.3}}
    given["fit"] |= {"score": "likelihood", "stages": [{"name": "fit", "kind": "least_squares", "tolx": 1e-3}]}

    # the homogeneous model: the region explains what it leaves
    problem, everything = begin(load_settings(given), tmp_path / "base")
    last, _ = run_fit(problem, 1)
    (tried,) = (
        one for one in candidates(problem, finest(problem, last).values)[0] if one.effect.name == "region_patch"
    )
    comparison, _ = compared(problem, last, everything, [tried])
    ((one,), _) = refit_all(comparison, rank_candidates(comparison, comparison.score_test, [tried]))
    left, count = comparison.score_test.misfit, len(comparison.score_test.rest)
    print(f"misfit {left:.0f} of {count} values, with the region {one.refitted.misfit:.0f}; {one.refitted.values}")
    chance = np.sqrt(2 * count)  # standard deviation of the misfit of noise alone
    assert left > count + 10 * chance
    assert one.refitted.misfit < count + 3 * chance

    # constants of its own
    given["model"]["parameters"]["mu_patch"] = given["model"]["parameters"]["mu"]
    problem, everything = begin(load_settings(given), tmp_path / "own-constants")
    assert "region_patch" not in [found.effect.name for found in candidates(problem, problem.settings.starts())[0]]
    last, _ = run_fit(problem, 1)
    found = estimate_of(problem, last, 1)["parameters"]
    print({name: (one["value"], one["interval95"]) for name, one in found.items()})
    for name, true in (("mu", MU), ("mu_patch", MU * np.exp(CONTRAST))):
        low, high = found[name]["interval95"]
        assert low < true < high
        assert high / low < 1.5  # an interval that says something: without the region mu is 17 % off, the patch 57 %
