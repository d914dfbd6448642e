"""Stiffness as a field: what its modes are, how many the data tell, and a hidden band that is found on its map."""

from types import SimpleNamespace

import numpy as np
import pytest
from seeds import generator as seeded
from small_body import DESCRIPTION, compared, config_of, written

from fingerfit.core.errors import InputError
from fingerfit.deck.modes import modes_of
from fingerfit.diagnosis.candidates import candidates
from fingerfit.diagnosis.field import field_of
from fingerfit.diagnosis.first_pass import widened
from fingerfit.diagnosis.ranking import rank_candidates
from fingerfit.diagnosis.series import cut, evidences
from fingerfit.diagnosis.trials import refit_all
from fingerfit.fit.minimum import finest
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.mesh.blocks import layered_block
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.inside import sizes
from fingerfit.model.catalogue import catalogue
from fingerfit.model.modes import modes
from fingerfit.model.parameters import Parameter
from fingerfit.settings.config import load_settings

EFFECT = catalogue()["stiffness_field"]
STRIPE = """\
title: a sharp stripe
acts: structure
words: An oblique stripe that is stiffer, with sharp edges.
look: Material flows around it.
confirm: A cut.
parameters:
  contrast: {unit: log, absent: 0, lower: -2, upper: 2, step: 0.2}
changes:
  field: "contrast * where(abs((x - 6.5) * 0.8192 + (up - 6) * 0.5736) < 1.5, 1, 0)"
"""
CONTRAST = 1.0


def across(places):
    """Distance from the middle line of the stripe, mm."""
    return (places[:, 0] - 6.5) * 0.8192 + (places[:, 1] - 6) * 0.5736


def with_field(study, numbers):
    given = config_of(study)
    given["model"]["effects"] = {"stiffness_field": numbers}
    return given


def test_the_longest_waves_come_first_and_slope_nowhere_at_the_sides():
    corner, size = np.array([1.0, 2.0]), np.array([12.0, 8.0])
    ends = corner + np.array([[0.0, 0.3], [1e-4, 0.3], [1.0, 0.7], [1.0 - 1e-4, 0.7]]) * size
    found = modes(ends, corner, corner + size, 12)
    assert found[0, :2] == pytest.approx([1.0, np.cos(0.3 * np.pi)])
    assert np.abs(found[0] - found[1]).max() < 1e-6  # of waves of slope 0; others differ by 1e-4 and more
    assert np.abs(found[2] - found[3]).max() < 1e-6


def test_a_layer_with_a_modulus_of_its_own_has_modes_without_a_mean():
    mesh = layered_block(12.0, [("top", 3.0), ("middle", 4.0), ("bottom", 5.0)], 5, 2, "CPE8H", 3.0)
    area, members = sizes(mesh), [mesh.element_sets[name] for name in ("TOP", "MIDDLE", "BOTTOM")]

    def means(*constants):
        values = np.array([points.mean(axis=0) for points in modes_of(mesh, constants, 6)])
        return np.array([np.average(values[own], axis=0, weights=area[own]) for own in members])

    assert means("mu_top", "mu_middle", "mu_bottom") == pytest.approx(0.0, abs=1e-12)
    one = means("mu_top", "mu")
    assert one[0] == pytest.approx(0.0, abs=1e-12)
    # the other two have one modulus: they differ by waves along the height, and together have no mean
    assert pytest.approx(0.0, abs=1e-12) == one[1:].T @ [4.0, 5.0]
    assert np.abs(one[1] - one[2]).max() > 0.5
    # waves over a whole block have none from the beginning, but for the points that stand for it
    assert np.abs(np.array([3.0, 4.0, 5.0]) @ means("mu")).max() < 1e-12


@pytest.mark.parametrize("test", ["left", "right"])
def test_a_field_that_each_test_has_for_itself_is_mapped_as_its_own(test):
    """As the field of a study with this test alone: numbers of the other test change nothing in it."""
    generator, mesh = seeded(1), layered_block(12.0, [("gel", 12.0)], 4, 4)
    constant, effect = Parameter("mu", "MPa", 0.01, 1.0, 0.1, True, 1.0), EFFECT.first(2)
    slopes = generator.normal(size=(60, 3))
    sizes = {"mu": 0.1, "stiffness_field.m1": 0.2, "stiffness_field.m2": -0.1}

    def mapped(columns, ends):
        names = [f"{effect.key(p.name)}{end}" for p in effect.parameters for end in ends]
        parameters = [constant] + [Parameter(name, "log", -3.0, 3.0, 0.0, False, 0.3) for name in names]
        values = {p.name: sizes[p.name.partition("@")[0]] for p in parameters}
        settings = SimpleNamespace(parameters=lambda: tuple(parameters), effects=lambda: (effect,))
        problem = SimpleNamespace(
            settings=settings, effects={effect.name: EFFECT}, meshes={"s": mesh}, test=test * (len(ends) > 1)
        )
        left = SimpleNamespace(own=columns, left=np.sin(np.arange(60)), misfit=60.0, freedom=60)
        return field_of(
            SimpleNamespace(problem=problem, score_test=left, mesh="s", base=SimpleNamespace(values=values))
        )

    wide = np.zeros((60, 5))
    own = [0, 1, 3] if test == "left" else [0, 2, 4]
    wide[:, own] = slopes
    found, alone = mapped(wide, ["@left", "@right"]), mapped(slopes, [""])
    assert found.value == pytest.approx(alone.value)
    assert found.spread == pytest.approx(alone.spread)


def test_the_evidence_stops_where_only_noise_is_left():
    generator = seeded(1)
    columns = np.linalg.qr(generator.normal(size=(200, 20)))[0] * 30
    rest = columns[:, :7] @ np.full(7, 0.5) + generator.normal(size=200)
    assert evidences(columns, rest, np.full(20, 0.5)).argmax() + 1 == 7
    # of noise alone: not even one
    assert evidences(columns, generator.normal(size=200), np.full(20, 0.5)).max() < 0


def test_a_model_has_as_many_modes_as_it_says(tmp_path):
    names = [p.name for p in load_settings(with_field(tmp_path, {"modes": 3, "m2": 0.1})).parameters()]
    assert names[2:] == ["stiffness_field.m1", "stiffness_field.m2", "stiffness_field.m3"]


@pytest.mark.parametrize("given", [{"modes": 0}, {"modes": 2.5}, {"modes": len(EFFECT.parameters) + 1}])
def test_a_wrong_number_of_modes_is_one_line(given, tmp_path):
    with pytest.raises(InputError, match=r"model.effects.stiffness_field.modes: .* a whole number from 1 to 32"):
        load_settings(with_field(tmp_path, given))


def test_a_number_beyond_the_last_mode_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"model.effects.stiffness_field.m4"):
        load_settings(with_field(tmp_path, {"modes": 3, "m4": 0.1}))


@pytest.mark.slow
def test_a_hidden_stripe_is_found_where_it_is(tmp_path):
    """Data of CalculiX on another mesh, a stripe with sharp edges in a homogeneous body; as many modes as the evidence is for."""
    (tmp_path / "own/effects").mkdir(parents=True)
    (tmp_path / "own/effects/stripe.yaml").write_text(STRIPE)
    body = {**DESCRIPTION["body"], "layers": [{"name": "gel", "height": 12, "mu": 0.03, "intensity": 0.7}]}
    mesh = {"element": "CPE8", "across": 18, "per_layer": 18, "grading": 1}
    hidden = {"effects": {"stripe": {"contrast": CONTRAST}}, "own": "own"}
    given = config_of(written(tmp_path, body=body, mesh=mesh, solver="calculix", **hidden))
    sizes = {"mesh": 8, "refined": 12}
    given["model"] |= {
        name: {"element": "CPE8", "across": count, "per_layer": count, "grading": 1.5} for name, count in sizes.items()
    }
    given["model"]["parameters"] = {"mu": given["model"]["parameters"]["mu_top"]}
    given["fit"]["score"] = "likelihood"
    problem, everything = begin(load_settings(given), tmp_path / "model")
    last, _ = run_fit(problem, 1)
    (tried,) = (one for one in candidates(problem, finest(problem, last).values)[0] if one.effect.name == EFFECT.name)
    comparison, _ = compared(problem, last, everything, [tried])
    assert field_of(comparison) is None
    (one,) = rank_candidates(comparison, comparison.score_test, [tried])
    ((one,), _) = refit_all(comparison, [cut(comparison.score_test, one)])
    problem = widened(problem, comparison.base.values, one)
    last, _ = run_fit(problem, 1)
    comparison, _ = compared(problem, last, everything, [])
    found, fine = field_of(comparison), problem.meshes[comparison.mesh]
    (block,) = fine.blocks
    far = across(fine.points[block.nodes[:, : ELEMENTS[block.element].corners]].mean(axis=1))
    # the place: the stripe that the map is most alike lies within an element of the search mesh from the true one
    ways = np.linspace(-4, 4, 81)
    alike = [np.corrcoef(found.value, np.abs(far - way) < 1.5)[0, 1] for way in ways]
    assert abs(ways[np.argmax(alike)]) < 12 / sizes["mesh"]
    assert max(alike) > 0.6
    # the contrast of the inside to the outside, an edge of half a millimetre on either side left out
    inside, outside = np.abs(far) < 1.0, np.abs(far) > 2.0
    weight = (inside / inside.sum() - outside / outside.sum()) @ found.basis
    contrast, error = weight @ found.size, np.sqrt(weight @ found.covariance @ weight)
    print(f"contrast {contrast:.2f} +- {error:.2f}; moved by {ways[np.argmax(alike)]:.1f} mm; {len(one.size)} modes")
    assert error < 0.2  # an interval that says something: 0 is five of its standard errors away
    assert abs(np.expm1(contrast - CONTRAST)) < 0.2 or abs(contrast - CONTRAST) < 1.96 * error
    # the true field lies in its own interval: of normal errors in 95 % of the elements, of sharp edges in fewer
    true = np.where(np.abs(far) < 1.5, CONTRAST, 0.0)
    left = (found.value - found.value.mean()) - (true - true.mean())
    assert np.mean(np.abs(left) < 1.96 * found.spread) > 0.75
