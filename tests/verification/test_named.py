"""What is hidden in a small body is named by the first pass, among members of its own and of other families."""

import numpy as np
import pytest
from seeds import part_of
from small_body import DESCRIPTION, compared, config_of, fitted, written

from fingerfit.diagnosis.candidates import candidates
from fingerfit.diagnosis.evidence import LIKELY
from fingerfit.diagnosis.families import families
from fingerfit.diagnosis.ranking import best_places, rank_candidates
from fingerfit.diagnosis.series import cut
from fingerfit.diagnosis.trials import refit_all
from fingerfit.fit.minimum import finest
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.settings.config import load_settings

RIVALS = {"inclusion", "tilt", "compressibility", "base_slip", "wandering_pictures"}
PROBES = {
    "state": "state_probe",
    "material": "material_probe",
    "structure": "stiffness_field",
    "indenter": "indenter_probe",
    "loading": "loading_probe",
    "geometry": "geometry_probe",
    "observation": "observation_probe",
}
LAW = {"exponential", "yeoh", "stiffening", "material_probe"}
"""Laws that stiffen: which one does, the noise of these pictures does not tell."""
FURTHER = {"displacement": [0.75, 1.5, 2.25, 3.0]}
CASES = {
    "swelling": ("state", {"swelling": {"volume": 0.03}}, {"swelling"}, {}),
    "loads": ("loading", {"loading_probe": {"midway": 6.2, "reading": 0.2}}, {"loading_probe"}, {}),
}
MORE = {
    "wall": ("indenter", {"wall": {"share": 0.9, "gap": 0.3, "side": 1}}, {"wall"}, {}),
    "fibres": ("material", {"fibres": {"stiffness": 0.45, "angle": 35}}, {"fibres"}, {}),
    "ellipse": (
        "structure",
        {"ellipse": {"contrast": 1.0, "across": 0.4, "along": 0.6, "radius": 2.5, "flat": 0.5, "slant": 0.8}},
        {"ellipse"},
        {},
    ),
    "soft lump": (
        "structure",
        {"ellipse": {"contrast": -2.5, "across": 0.6, "along": 0.4, "radius": 2.0, "flat": 0.3, "slant": 0.8}},
        {"ellipse"},
        {},
    ),
    "other fibres": ("material", {"fibres": {"stiffness": 0.25, "angle": -30}}, {"fibres"}, {}),
    "band": ("structure", {"band": {"contrast": 1.0, "angle": 30, "above": 1.0, "wide": 2.0}}, {"band"}, {}),
    "prestretch": ("state", {"prestretch": {"stretch": 0.08}}, {"prestretch"}, {}),
    "uneven swelling": ("state", {"state_probe": {"lower": 0.08, "upper": -0.05}}, {"state_probe"}, {}),
    "yeoh": ("material", {"yeoh": {"c2": 0.4, "c3": 0.5}}, LAW, FURTHER),
    "exponential": ("material", {"exponential": {"b": 3.0}}, LAW, FURTHER),
    "inclined border": (
        "geometry",
        {"interface": {"down": 1.0, "incline": 3.0, "border": 1}},
        {"interface"},
        {},
    ),
    "lens": ("observation", {"lens": {"barrel": 0.02}}, {"lens"}, FURTHER),
    "pixels": ("observation", {"pixel_size": {"across": 0.06, "along": 0.05}}, {"pixel_size"}, {}),
    "borders": (
        "geometry",
        {"geometry_probe": {"upper": 1.0, "incline_upper": 2.0}},
        {"geometry_probe"},
        {},
    ),
}


def named(folder, family, hidden, known, own):
    """The likeliest effect, its refit, and the likeliest family."""
    problem, last, _, everything = fitted(written(folder, effects=hidden, **own), folder / "model")
    wanted = {*known, *hidden, PROBES[family], *RIVALS}
    found = [one for one in candidates(problem, finest(problem, last).values)[0] if one.effect.name in wanted]
    assert wanted - RIVALS <= {one.effect.name for one in found}
    comparison, _ = compared(problem, last, everything, found)
    everywhere = [cut(comparison.score_test, one) for one in rank_candidates(comparison, comparison.score_test, found)]
    ranking = best_places(everywhere)
    ranking, _ = refit_all(comparison, ranking)
    ((first, (best, _)), *_) = families(comparison.score_test, ranking).items()
    return first, best.candidate.effect, best.refitted


@pytest.mark.slow
@pytest.mark.parametrize("case", [*CASES, *part_of(list(MORE), 3)])
def test_it_is_named(case, tmp_path):
    family, hidden, names, own = {**CASES, **MORE}[case]
    first, effect, refit = named(tmp_path, family, hidden, names, own)
    assert first == family
    assert effect.name in names
    assert refit.share > (0.6 if case == "lens" else 0.9)  # the middle of a lens that is absent cannot move yet
    if (
        effect.name in hidden
    ):  # its first number says how much there is of it; the mesh is coarser than that of the data
        number, value = next(iter(hidden[effect.name].items()))
        # four standard errors: two numbers of one law can stand for each other
        scale = next(p.scale for p in effect.parameters if p.name == number)
        certain = refit.information.matrix + np.eye(len(refit.information.far))  # likely sizes are known, too
        chance = 4.0 * LIKELY * scale * np.linalg.inv(certain)[0, 0] ** 0.5
        found = refit.values[effect.key(number)]
        assert found == pytest.approx(value, abs=0.3 * abs(value) + chance)


@pytest.mark.slow
def test_a_poisson_ratio_that_was_stated_too_low_is_told(tmp_path):
    """It is compressibility of the other sign: the material loses less volume than the model's ratio allows."""
    true, stated = DESCRIPTION["material"]["poisson"], 0.42
    config = config_of(written(tmp_path, effects={}))
    config["model"]["material"] = {**config["model"]["material"], "poisson": stated}
    problem, everything = begin(load_settings(config), tmp_path / "model")
    last, _ = run_fit(problem, 1)
    found = [one for one in candidates(problem, finest(problem, last).values)[0] if one.effect.name in RIVALS]
    comparison, _ = compared(problem, last, everything, found)
    ranking = [cut(comparison.score_test, one) for one in rank_candidates(comparison, comparison.score_test, found)]
    ranking, _ = refit_all(comparison, best_places(ranking))
    best = ranking[0]
    assert best.candidate.effect.name == "compressibility"
    loss = best.refitted.values["compressibility.loss"]
    assert 0.5 - (0.5 - stated) * np.exp(loss / (0.5 - stated)) == pytest.approx(true, abs=0.01)
    assert best.refitted.share > 0.9
