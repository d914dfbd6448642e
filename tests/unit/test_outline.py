"""Sides of a body found in the picture before compression, and what is said and done where they are not as stated."""

import numpy as np
import pytest
import yaml
from scipy.ndimage import gaussian_filter
from seeds import generator

from fingerfit.core.errors import InputError
from fingerfit.imaging.outline import measure_outline
from fingerfit.imaging.pictures import Picture, write_picture
from fingerfit.prepare.prepare import make_mesh, prepare
from fingerfit.settings.config import ModelSettings
from fingerfit.settings.parts import MeshSettings
from fingerfit.study.reader import load_study

LOW, HIGH, PIXEL = np.array([0.95, 0.45]), np.array([12.95, 10.45]), 0.1
NOISE = 0.03
TURNED = np.array([[0.0, -1.0], [1.0, 0.0]])


def sides(taper=0.0, bulge=0.0, lower=0.0):
    """How far out the sides are, mm, as functions of a place along them from -1 to 1."""
    return {
        "left": lambda v: taper * v, "right": lambda v: bulge * (1 - v**2) + 0 * v, "lower": lambda v: 0 * v,
        "upper": lambda v: -lower + 0 * v,
    }  # fmt: skip


def pictured(shape, noise=NOISE, around=0.1, direction=None, dark=0.2, seed=1, contrast=0.2, top=1.0):
    """A body with a texture of grains, blurred by a pixel, on an even ground; its uppermost 0.9 mm `top` times as bright."""
    rng = generator(seed)
    size = np.array([160, 130])
    frame = Picture(np.zeros(size[::-1]), np.full(2, PIXEL), np.array([-1.0, -1.0]), np.eye(2))
    if direction is not None:
        frame = Picture(np.zeros(size), np.full(2, PIXEL), np.array([15.0, -1.0]), direction)
    x, y = frame.to_points(np.indices(frame.values.shape)[::-1].reshape(2, -1).T.astype(float)).T
    v, u = 2 * (y - LOW[1]) / (HIGH - LOW)[1] - 1, 2 * (x - LOW[0]) / (HIGH - LOW)[0] - 1
    inside = (x > LOW[0] - shape["left"](v)) & (x < HIGH[0] + shape["right"](v))
    inside &= (y > LOW[1] - shape["lower"](u)) & (y < HIGH[1] + shape["upper"](u))
    grains = gaussian_filter(rng.normal(size=frame.values.shape), 2.0)
    grains = np.clip(0.6 + contrast * grains / grains.std(), dark, 1.0)
    grains *= np.where(y > HIGH[1] - 0.9, top, 1.0).reshape(grains.shape)
    seen = gaussian_filter(np.where(inside.reshape(grains.shape), grains, around), 1.0)
    return Picture(seen + noise * rng.normal(size=seen.shape), frame.spacing, frame.origin, frame.direction)


@pytest.mark.parametrize("direction", [None, TURNED], ids=["level", "turned"])
def test_sides_are_found_where_they_are(direction):
    shape = sides(taper=0.6, bulge=0.7, lower=0.5)
    # of one picture in eight a place is off by more than a pixel (24 seeds, both directions), so that five are looked at
    several = [measure_outline(pictured(shape, direction=direction, seed=seed), LOW, HIGH) for seed in range(1, 6)]
    found, along = several[0], np.linspace(-0.8, 0.8, 9)
    for outward, wanted in zip(np.median([one.outward for one in several], axis=0), shape.values(), strict=True):
        # where grains at an edge are nearly as dark as what is around them, a pixel is what remains unsure
        assert np.polynomial.legendre.legval(along, outward) == pytest.approx(wanted(along), abs=PIXEL)
    assert found.elsewhere().keys() == {"left", "right", "upper"}
    assert np.median([one.elsewhere()["upper"] for one in several]) == pytest.approx(-0.5, abs=PIXEL)
    corner = found.moved(np.array([[LOW[0], HIGH[1]], [HIGH[0], LOW[1]]]))
    assert corner == pytest.approx(np.array([[LOW[0] - 0.6, HIGH[1] - 0.5], [HIGH[0], LOW[1]]]), abs=3 * PIXEL)
    middle = found.moved(np.array([[HIGH[0], (LOW + HIGH)[1] / 2]]))
    assert middle[0, 0] == pytest.approx(HIGH[0] + 0.7, abs=PIXEL)


@pytest.mark.parametrize("away", [1.2, 1.6, 1.9], ids="{} mm".format)
def test_a_side_is_looked_for_again_where_it_was_found(away):
    """Further in than 1 mm, as far as it is looked for from where it is stated in this picture."""
    shape = sides() | {"right": lambda v: -away + 0 * v}
    several = [measure_outline(pictured(shape, seed=seed), LOW, HIGH) for seed in range(1, 6)]
    assert np.median([one.elsewhere()["right"] for one in several]) == pytest.approx(-away, abs=PIXEL)


@pytest.mark.parametrize("noise", [0.01, 0.1])
@pytest.mark.parametrize("dark", [0.0, 0.3])
def test_a_body_as_stated_is_nowhere_else(noise, dark):
    for seed in range(4):
        found = measure_outline(pictured(sides(), noise, dark=dark, seed=seed), LOW, HIGH)
        assert found.elsewhere() == {}


def test_an_upper_layer_that_is_darker_is_no_other_side():
    """Half way from the brighter layer further in to the ground is nearly as bright as the dark layer itself."""
    places = [
        measure_outline(pictured(sides(), seed=seed, noise=0.01, contrast=0.05, top=0.6), LOW, HIGH)
        for seed in range(4)
    ]
    assert np.nanmean([found.outward[3, 0] for found in places]) == pytest.approx(0.0, abs=PIXEL / 2)


def test_what_cannot_be_seen_is_not_said():
    """Grains all over the picture, and a picture that ends at the body."""
    for seed in range(10):
        grains = gaussian_filter(generator(seed).normal(size=(130, 160)), 2.0)
        whole = Picture(grains, np.full(2, PIXEL), np.array([-1.0, -1.0]), np.eye(2))
        assert measure_outline(whole, LOW, HIGH).elsewhere() == {}
    close = pictured(sides(lower=0.5)).crop(np.array([LOW, HIGH]), 0.0)
    found = measure_outline(close, LOW, HIGH)
    assert np.isnan(found.outward).all()
    assert found.elsewhere() == {}
    assert np.array_equal(found.moved(np.array([LOW, HIGH])), np.array([LOW, HIGH]))


def study_in(folder, picture):
    body = {"width": 12.0, "thickness": 30.0, "origin": LOW.tolist(), "layers": [{"name": "all", "height": 10.0}]}
    text = {
        "title": "outline", "units": {"length": "mm", "force": "N", "time": "s"}, "control": "force",
        "steps": "steps.csv",
        "pictures": {"before": "0.nii.gz", "noise": 100.0, "scale": "range"}, "noise": {"force": 0.1, "displacement": 0.01},
        "body": body, "boundary": {"base": "held", "indenter": "glued"},
    }  # fmt: skip
    folder.mkdir(exist_ok=True)
    (folder / "study.yaml").write_text(yaml.safe_dump(text))
    (folder / "steps.csv").write_text("step,displacement,force,picture\n1,0.5,1.0,1.nii.gz\n")
    for name, one in (("0", picture), ("1", pictured(sides(lower=1.0), seed=2))):
        write_picture(folder / f"{name}.nii.gz", Picture(1000 * one.values, one.spacing, one.origin, one.direction))
    return load_study(folder)


MESH = MeshSettings(element="CPE4", across=8, per_layer=8)
MU = {"unit": "MPa", "start": 0.05, "lower": 0.01, "upper": 0.2}
FOLLOWS = ModelSettings(mesh=MESH.model_dump(), parameters={"mu": MU}, effects={"outline": {}}).mesh


def test_it_is_said_and_the_mesh_can_follow_the_picture(tmp_path):
    picture = pictured(sides(lower=0.6))
    stated = study_in(tmp_path / "stated", picture)
    data = prepare(stated, make_mesh(stated, MESH), None, 1.0, 0.3)
    (remark,) = data.remarks.splitlines()
    assert "elsewhere than body says: the upper one 0." in remark
    assert "effect outline" in remark
    assert data.outline == pytest.approx(0.6, abs=PIXEL)
    mesh = make_mesh(stated, FOLLOWS)
    assert mesh.points[mesh.node_sets["TOP"], 1].mean() == pytest.approx(9.85, abs=PIXEL)
    assert mesh.points[mesh.node_sets["BOTTOM"], 1].mean() == pytest.approx(0.45, abs=PIXEL)
    again = prepare(stated, mesh, None, 1.0, 0.3)
    assert (again.remarks, again.outline) == ("", 0.0)


def test_a_picture_that_shows_no_side_is_refused(tmp_path):
    close = pictured(sides()).crop(np.array([LOW, HIGH]), 0.0)
    with pytest.raises(InputError, match=r"pictures.before: found no side of the body in 0.nii.gz; expected a picture"):
        make_mesh(study_in(tmp_path / "close", close), FOLLOWS)
