"""The chain of preparation: every step where it says, the place in space kept, and what was done told."""

import numpy as np
import pytest
import yaml
from seeds import generator

from fingerfit.core.errors import InputError, Problems
from fingerfit.imaging.pictures import Picture, read_picture, write_picture
from fingerfit.imaging.preprocess import noise_after_resizing, resize, smooth
from fingerfit.mesh.blocks import brick
from fingerfit.prepare.pictures import prepare_pictures
from fingerfit.study.reader import load_study

TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SIZE = (8.0, 6.0, 5.0)


def blob(points):
    """A smooth field of space, as it would be seen by any grid."""
    x, y, z = points.T
    return 2 + np.sin(x / 3) * np.cos(y / 4) + 0.5 * np.sin(z / 3 + 0.3)


def volume(shape=(20, 24, 32), spacing=(0.5, 0.5, 0.5), origin=(-4.0, -3.0, -2.5), direction=None):
    frame = Picture(np.zeros(shape), np.array(spacing), np.array(origin), np.eye(3) if direction is None else direction)
    places = frame.to_points(np.indices(shape)[::-1].reshape(3, -1).T.astype(float))
    return Picture(blob(places).reshape(shape), frame.spacing, frame.origin, frame.direction)


def places(picture):
    return picture.to_points(np.indices(picture.values.shape)[::-1].reshape(picture.dim, -1).T.astype(float))


@pytest.mark.parametrize("direction", [None, TURNED], ids=["level", "turned"])
@pytest.mark.parametrize("size", [(48, 30, 31), (20, 20, 14), (64, 12, 20)])
def test_resized_volumes_show_the_same_in_space(direction, size):
    origin = (-4.0, -3.0, -2.5) if direction is None else (4.0, -3.0, -2.5)
    whole = volume(origin=origin, direction=direction)
    found = resize(whole, size)
    assert found.values.shape == size[::-1]
    assert found.spacing * size == pytest.approx(whole.spacing * [32, 24, 20])
    assert found.to_points(np.full((1, 3), -0.5)) == pytest.approx(whole.to_points(np.full((1, 3), -0.5)))
    assert np.array_equal(found.direction, whole.direction)
    expected = blob(places(found)).reshape(found.values.shape)
    inner = (slice(3, -3),) * 3  # at the border the picture is carried on
    assert np.abs(found.values - expected)[inner].max() < 0.03


def test_the_same_pixels_are_left_as_they_are(rng):
    whole = Picture(rng.uniform(size=(9, 10, 11)), np.full(3, 0.4), np.zeros(3), np.eye(3))
    assert resize(whole, (11, 10, 9)).values == pytest.approx(whole.values, abs=1e-6)


def test_fewer_pixels_do_not_alias(rng):
    """A pattern finer than the new pixels must vanish, not come back as a coarse one."""
    x = np.arange(96)
    stripes = np.broadcast_to(np.cos(0.9 * np.pi * x), (12, 12, 96)).copy()
    found = resize(Picture(stripes, np.ones(3), np.zeros(3), np.eye(3)), (24, 12, 12)).values
    assert np.abs(found[3:-3, 3:-3, 3:-3]).max() < 0.05


@pytest.mark.parametrize("size", [(40, 40, 40), (20, 40, 40), (20, 20, 20), (80, 40, 40)])
def test_noise_is_followed_through_resizing(size):
    noise = generator(5).normal(size=(40, 40, 40))
    found = resize(Picture(noise, np.ones(3), np.zeros(3), np.eye(3)), size).values.std()
    # 5 standard errors of two standard deviations, each of as many independent values as there are old or new pixels
    count = min(noise.size, np.prod(size))
    assert noise_after_resizing(Picture(noise, np.ones(3), np.zeros(3), np.eye(3)), size) == pytest.approx(
        found, rel=5 / np.sqrt(count)
    )
    assert found < 1 + 5 / np.sqrt(2 * noise.size)


@pytest.fixture
def study(tmp_path, rng):
    """A study of volumes in 3D, of format and geometry that a scanner might give."""

    def make(name="nii.gz", noise=0.0, **chain):
        whole = volume((40, 36, 44), origin=(-7.0, -6.0, -7.5))
        for step in ("before", "step_1"):
            # no picture of a step is that before compression: it is brighter by a thousandth
            values = 1000 * whole.values + 300 + (step != "before") + 1000 * noise * rng.normal(size=whole.values.shape)
            write_picture(
                tmp_path / f"{step}.{name}", Picture(values, whole.spacing, whole.origin, whole.direction), np.float32
            )
        (tmp_path / "steps.csv").write_text(f"step,force,displacement,picture\n1,1.0,0.5,step_1.{name}\n")
        data = {
            "title": "t",
            "units": {"length": "mm", "force": "N", "time": "s"},
            "control": "force",
            "steps": "steps.csv",
            "pictures": {"before": f"before.{name}", "noise": 30.0, **chain},
            "body": {"brick": list(SIZE), "layers": [{"name": "body"}]},
            "boundary": {"base": "held", "indenter": "glued"},
        }
        (tmp_path / "study.yaml").write_text(yaml.safe_dump(data))
        return tmp_path

    return make


MESH = brick(SIZE, (2, 2, 2), element="C3D4")


def prepared(folder, sigma=1.0, crop=0.3):
    return prepare_pictures(load_study(folder), MESH, [0], sigma, crop)


@pytest.mark.parametrize("name", ["nii.gz", "nrrd", "mha"])
def test_the_whole_chain(study, name):
    found = prepared(study(name, trim="body", resize=[40, 24, 24], gaussian=0.8, scale="range"))
    assert found.before.values.shape == found.coefficients.shape == found.measured[0].shape == (24, 24, 40)
    assert found.before.values.dtype == found.measured.dtype == found.coefficients.dtype == np.float32
    lines = found.history.splitlines()
    assert [line.split(":")[0] for line in lines] == ["trim", "resize", "Gaussian", "scale"]
    assert "30 % of its extent around it, 27 x 21 x 17 pixels" in lines[0]
    assert "40 x 24 x 24 pixels of 0.3375 x 0.4375 x 0.3542 mm" in lines[1]
    assert "0.8 pixels" in lines[2]
    whole = 1000 * volume((40, 36, 44), origin=(-7.0, -6.0, -7.5)).values + 300
    low, size = whole.min(), np.ptp(whole)
    assert f"intensity {low:.5g} to 0, {whole.max():.5g} to 1" in lines[3]
    expected = (1000 * blob(places(found.before)) + 300 - low) / size
    inner = (slice(4, -4),) * 3
    assert np.abs(found.before.values - expected.reshape(24, 24, 40))[inner].max() < 0.02
    assert found.smooth == 0.8
    assert found.noise == pytest.approx(
        30.0
        / size
        * noise_after_resizing(Picture(np.zeros((17, 21, 27)), np.ones(3), np.zeros(3), np.eye(3)), (40, 24, 24))
    )


def test_noise_from_further_pictures_before_compression(study, rng):
    folder = study(noise=0.02)
    whole = read_picture(folder / "before.nii.gz")
    clean = 1000 * volume((40, 36, 44), origin=(-7.0, -6.0, -7.5)).values + 300
    for name in ("again", "third"):
        values = clean + rng.normal(0.0, 20.0, clean.shape)
        write_picture(
            folder / f"{name}.nii.gz", Picture(values, whole.spacing, whole.origin, whole.direction), np.float32
        )
    data = yaml.safe_load((folder / "study.yaml").read_text())
    data["pictures"] |= {"noise": ["again.nii.gz", "third.nii.gz"], "scale": "range"}
    (folder / "study.yaml").write_text(yaml.safe_dump(data))
    # 5 standard errors of a standard deviation with 2 degrees of freedom at each voxel, of 0.5 mm, in the body
    close = 5 / np.sqrt(2 * 2 * np.prod(SIZE) / 0.5**3)
    assert prepared(folder).noise == pytest.approx(20.0 / np.ptp(whole.values), rel=close)


def test_every_step_can_be_switched_off(study):
    found = prepared(study(trim=False, resize="off", gaussian="off"), sigma=2.0)
    assert found.history.splitlines()[:3] == [
        "trim: off, 44 x 36 x 40 pixels of 0.5 x 0.5 x 0.5 mm",
        "resize: off",
        "Gaussian: off",
    ]
    assert found.smooth == 0.0
    assert found.before.values.max() == pytest.approx(1.0)
    left_open = prepared(study(), sigma=2.0)
    assert left_open.smooth == 2.0
    assert left_open.before.values.shape == (17, 21, 27)


def test_a_box_in_the_units_of_the_study(study):
    folder = study(trim=[[0.0, 0.0, 0.0], [4.0, 3.0, 2.0]])
    found = prepared(folder).before
    # centres at -7 + 0.5 k mm: from 0 to 4
    assert found.origin == pytest.approx([0.0, 0.0, 0.0])
    assert found.values.shape == (5, 7, 9)


def test_smoothing_is_of_what_was_resized(study):
    found = prepared(study(resize=[30, 20, 20], gaussian=1.2))
    plain = prepared(study(resize=[30, 20, 20], gaussian=0))
    assert found.before.values == pytest.approx(smooth(plain.before.values, 1.2), abs=1e-6)
    assert np.array_equal(found.coefficients, plain.coefficients)


WRONG = {
    "trim": (
        [[0, 0, 0], [4, -3, 2]],
        "pictures.trim: found [[0, 0, 0], [4, -3, 2]]; expected body, off, or [[x, y, z]",
    ),
    "resize": ([256, 128, 1.5], "pictures.resize: found [256, 128, 1.5]; expected off, or pixels along each axis"),
    "gaussian": (-1, "pictures.gaussian: found -1; expected off, or a standard deviation"),
    "scale": ("log", "pictures.scale: found log; expected range or off"),
}


@pytest.mark.parametrize("key", WRONG)
def test_a_wrong_step_is_one_line(study, key):
    value, expected = WRONG[key]
    with pytest.raises(Problems) as raised:
        load_study(study(**{key: value}))
    assert len(raised.value.problems) == 1
    assert expected in str(raised.value)


def test_steps_that_do_not_fit_the_pictures(study):
    with pytest.raises(InputError, match=r"pictures.resize: found 2 numbers; expected 3, as the pictures"):
        prepared(study(resize=[40, 20]))
    with pytest.raises(InputError, match=r"pictures.trim: found corners of 2 numbers; expected 3, as the pictures"):
        prepared(study(trim=[[0, 0], [4, 4]]))
    with pytest.raises(InputError, match=r"pictures.scale: found off, with intensities from .* to .*; expected range"):
        prepared(study(scale="off"))
    with pytest.raises(InputError, match=r"pictures.trim: found a box that leaves .* expected a box in the pictures"):
        prepared(study(trim=[[50, 50, 50], [60, 60, 60]]))
