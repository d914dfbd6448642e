"""Virtual volumes: tissues where the mesh has them, partial volume, texture that moves along, drawn shapes, Rician noise."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.special import erf
from scipy.stats import rice
from seeds import seed_of

from fingerfit.core.errors import InputError, Problems
from fingerfit.core.files import write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.imaging.pictures import read_picture
from fingerfit.mesh.blocks import brick
from fingerfit.prepare.prepare import make_mesh
from fingerfit.settings.parts import MeshSettings
from fingerfit.study.reader import load_study
from fingerfit.virtual.experiment import FULL_SCALE, add_noise, run_experiment, solve, write_study
from fingerfit.virtual.file import read_truth
from fingerfit.virtual.scan import sample_places

SIZE = [12.0, 10.0, 8.0]
DESCRIPTION = {
    "title": "a block of two layers",
    "body": {
        "brick": SIZE,
        "layers": [
            {"name": "top", "height": 3, "mu": 0.0123, "intensity": 0.9},
            {"name": "bottom", "height": 5, "mu": 0.0456, "intensity": 0.5},
        ],
        "drawn": [
            {"shape": "capsule", "from": [3, 5, 2], "to": [9, 5, 2], "radius": 1.0, "intensity": 0.1},
            {"shape": "ellipsoid", "centre": [6, 5, 6.5], "radii": [1.5, 1, 1], "intensity": 0.2},
        ],
    },
    "material": {"alpha": 1.4, "poisson": 0.45},
    "mesh": {"element": "C3D4", "across": 4, "per_layer": 2, "grading": 1},
    "solver": "builtin",
    "displacement": [0.6, 1.2],
    "picture": {
        "pixels": [36, 34, 28],
        "spacing": [0.5, 0.5, 0.5],
        "texture": 0.0,
        "correlation": 2.0,
        "noise": 0.03,
        "pictured": [1, 2],
    },
    "noise": {"force": 0.01, "displacement": 0.02},
    "seed": seed_of(3),
    "study": {"pictures": {"gaussian": 0.8}},
}


def described(folder, **changes):
    data = yaml.safe_load(yaml.safe_dump(DESCRIPTION))
    for key, value in changes.items():
        *parents, last = key.split("__")
        at = data
        for parent in parents:
            at = at[parent]
        at[last] = value
    (folder / "experiment.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    return folder / "experiment.yaml"


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("solved")
    truth = read_truth(described(folder))
    return truth, solve(truth, folder)


def at(solved, *point):
    x, y, z = solved.frame.to_index(np.array([point])).round().astype(int)[0]
    return float(solved.pictures[0][z, y, x])


def test_tissues_and_drawn_shapes_are_where_they_are_described(solved):
    _, found = solved
    assert found.pictures.shape == (3, 28, 34, 36)
    assert found.pictures.dtype == np.float32
    assert at(found, 1, 1, 7) == pytest.approx(0.9)
    assert at(found, 1, 1, 1) == pytest.approx(0.5)
    assert at(found, 6, 5, 2) == pytest.approx(0.1)
    assert at(found, 6, 5, 6.5) == pytest.approx(0.2)
    assert at(found, -1.5, 5, 4) == 0.0
    # signal times volume: of the layers without the shapes drawn in them; half voxels count half
    capsule, ellipsoid = np.pi * (6 + 4 / 3), 4 / 3 * np.pi * 1.5
    expected = (12 * 10 * 3 - ellipsoid) * 0.9 + ellipsoid * 0.2 + (12 * 10 * 5 - capsule) * 0.5 + capsule * 0.1
    assert found.pictures[0].sum() * 0.5**3 == pytest.approx(expected, rel=0.01)


def test_border_voxels_are_partly_filled(solved):
    _, found = solved
    frame = found.frame
    assert frame.origin == pytest.approx([-2.75, -3.25, -2.75])
    moved = found.pictures[-1]
    x, y, z = frame.to_index(np.array([[1.0, 1.0, 6.75]])).round().astype(int)[0]
    # 1.2 mm down: the top is at 6.8 mm, within the voxel from 6.5 to 7 mm; 0.6 of it, of 32 heights 19
    assert moved[z, y, x] == pytest.approx(0.9 * 19 / 32, abs=1e-3)


@pytest.mark.parametrize("count", [8, 16, 27, 32])
def test_no_two_samples_of_a_voxel_are_crossed_together(count):
    places = sample_places(3, count)
    assert places.shape == (count, 3)
    assert places.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    for axis in range(3):
        assert np.diff(np.sort(places[:, axis])) == pytest.approx(np.full(count - 1, 1 / count))
    # and they keep away from each other, as in a regular grid of as many
    gaps = np.abs(places[:, None] - places[None])
    distance = np.linalg.norm(np.minimum(gaps, 1 - gaps), axis=2) + np.eye(count)
    assert distance.min() > 0.6 * count ** (-1 / 3)


def test_samples_in_the_plane_are_a_grid():
    places = sample_places(2, 16)
    assert sorted(set(places[:, 0])) == sorted(set(places[:, 1])) == [-0.375, -0.125, 0.125, 0.375]
    assert len({tuple(place) for place in places}) == 16


def test_a_body_keeps_its_volume_and_the_indenter_is_dark(solved):
    _, found = solved
    # Poisson's ratio 0.45: some volume is lost, most in the soft and bright layer; by the way alone it were 15 %
    ratio = found.pictures[-1].sum() / found.pictures[0].sum()
    assert 0.89 < ratio < 0.98
    top = found.frame.to_index(np.array([[0, 0, 7.3]])).round().astype(int)[0][2]
    assert (found.pictures[-1][top:] == 0).all()


def test_more_samples_change_borders_only(tmp_path):
    found = {}
    for samples in (1, 27):
        folder = tmp_path / str(samples)
        folder.mkdir()
        path = described(folder, picture__samples=samples, displacement=[0.6], picture__pictured=[1])
        found[samples] = solve(read_truth(path), folder).pictures
    one, many = found[1], found[27]
    assert one.shape == many.shape
    whole = np.isin(np.round(many, 5), np.round([0.0, 0.9], 5))  # 15 of 27 samples of 0.9 would be 0.5
    assert whole.mean() > 0.5
    assert one[whole] == pytest.approx(many[whole], abs=1e-5)
    # only one sample for each voxel makes borders hard
    assert len(np.unique(np.round(one, 4))) == 5
    assert len(np.unique(np.round(many, 4))) > 20


def averaged(length, correlation):
    """Variance of the mean over a length of a field of variance 1 whose values d apart correlate by exp(-(d / correlation)^2)."""
    q = np.asarray(length) / correlation
    return (np.sqrt(np.pi) * q * erf(q) + np.exp(-(q**2)) - 1) / q**2


def test_texture_moves_with_the_material(tmp_path):
    correlation = 0.8
    truth = read_truth(described(tmp_path, picture__texture=0.2, picture__correlation=correlation, body__drawn=[], body__layers=[
        {"name": "top", "height": 3, "mu": 0.02, "intensity": 0.5}, {"name": "bottom", "height": 5, "mu": 0.02, "intensity": 0.5},
    ]))  # fmt: skip
    found = solve(truth, tmp_path)
    places = found.frame.to_points(np.indices((28, 34, 36))[::-1].reshape(3, -1).T.astype(float))
    whole = ((places > 0.25 + 1e-9) & (places < np.array(SIZE) - 0.25 - 1e-9)).all(
        axis=1
    )  # voxels of 0.5 mm that lie inside
    size = np.sqrt(np.mean((found.pictures[0].reshape(-1)[whole] / 0.5 - 1) ** 2))
    # a voxel is a mean, which correlates a little farther; squares of a normal field have the variance 2 and the square
    # of its correlation: 5 standard errors of their mean over the block, half of it for the root (40 seeds: 2.7 %)
    expected = 0.2 * np.sqrt(averaged(0.5, correlation) ** 3)
    farther = np.sqrt(correlation**2 + 0.5**2 / 3)
    assert size == pytest.approx(expected, rel=5 / 2 * np.sqrt(2 * np.prod(averaged(SIZE, farther / np.sqrt(2)))))
    # near the base nothing moves, so nothing changes; near the top it does
    low = found.frame.to_index(np.array([[6.0, 5.0, 0.3]])).round().astype(int)[0]
    core = (slice(8, -8), slice(8, -8))
    base = [p[low[2]][core] for p in found.pictures]
    high = [p[low[2] + 10][core] for p in found.pictures]
    assert np.abs(base[2] - base[0]).mean() < 0.3 * np.abs(high[2] - high[0]).mean()
    again = solve(truth, tmp_path)
    assert np.array_equal(again.pictures, found.pictures)


def test_noise_is_rician_on_every_volume(solved):
    truth, found = solved
    _, _, pictures = add_noise(truth, found, seed_of(5))
    assert pictures.dtype == np.uint16
    for clean, noisy in zip(found.pictures, pictures, strict=True):
        values = noisy / FULL_SCALE
        dark, bright = values[clean == 0], (values - clean)[clean > 0.45]
        # 5 standard errors: Rayleigh's spread is sqrt(4 / pi - 1) of its mean; of n normal ones 1 / sqrt(2 n); and what
        # Rician noise lacks there, sigma^2 / 4 A^2 of a standard deviation
        assert dark.mean() == pytest.approx(0.03 * np.sqrt(np.pi / 2), rel=5 * np.sqrt((4 / np.pi - 1) / dark.size))
        lacks = (0.03 / 0.45) ** 2 / 4
        assert bright.std() == pytest.approx(0.03, rel=lacks + 5 / np.sqrt(2 * bright.size))
    assert (pictures[0] != pictures[1])[found.pictures[0] == 0].mean() > 0.9


def test_what_is_written_is_a_study(solved, tmp_path):
    truth, found = solved
    write_study(truth, found, tmp_path / "s")
    study = load_study(tmp_path / "s")
    assert study.body.brick == (12, 10, 8)
    assert [(layer.name, layer.height) for layer in study.body.layers] == [("top", 3), ("bottom", 5)]
    assert study.chain.gaussian == 0.8
    picture = read_picture(tmp_path / "s/pictures/before.nii.gz")
    assert picture.same_place(found.frame)
    mesh = make_mesh(study, MeshSettings(element="C3D8", across=2, per_layer=1))
    assert mesh.blocks[0].element == "C3D8"
    assert len(mesh.element_sets["TOP"]) == len(mesh.element_sets["BOTTOM"]) == 4
    for path in (tmp_path / "s").rglob("*"):
        if path.is_file() and "sealed" not in path.parts:
            assert b"0.0123" not in path.read_bytes()
    assert yaml.safe_load((tmp_path / "s/sealed/truth.yaml").read_text())["constants"]["mu_top"] == 0.0123


def test_a_mesh_with_tissues_that_are_no_layers(tmp_path):
    mesh = brick(SIZE, (4, 4, 2), element="C3D4", layers=[("skin", 3.0), ("fat", 3.0), ("bone", 2.0)])
    write_text(tmp_path / "true.inp", format_mesh(mesh))
    coarse = brick(SIZE, (2, 2, 1), element="C3D4", layers=[("skin", 3.0), ("fat", 5.0)])
    write_text(tmp_path / "reference.inp", format_mesh(coarse))
    (tmp_path / "block.inp.j2").write_text(
        (Path(__file__).resolve().parents[2] / "templates/block.inp.j2").read_text().replace(
            "** --- base", "*MATERIAL, NAME=BONE\n*ELASTIC\n10000., 0.3\n*SOLID SECTION, ELSET=BONE, MATERIAL=BONE\n** --- base"
        )
    )  # fmt: skip
    layers = [
        {"name": "skin", "mu": 0.03, "intensity": 0.6},
        {"name": "soft", "elements": "FAT", "mu": 0.01, "intensity": 0.9},
    ]
    path = described(
        tmp_path,
        body={"mesh": "true.inp", "layers": layers, "tissues": {"bone": 0.05}},
        study={
            "body": {"mesh": "reference.inp", "layers": [{"name": "skin"}, {"name": "soft", "elements": "FAT"}]},
            "control": "displacement",
        },
    )
    data = yaml.safe_load(path.read_text())
    del data["mesh"]
    path.write_text(yaml.safe_dump(data))
    run_experiment(path, tmp_path / "s")
    study = load_study(tmp_path / "s")
    assert study.control == "displacement"
    assert study.body.mesh == tmp_path / "s/reference.inp"
    assert len(make_mesh(study, None).points) == len(coarse.points)
    before = read_picture(tmp_path / "s/pictures/before.nii.gz")
    x, y, z = before.to_index(np.array([[6.0, 5.0, 1.0]])).round().astype(int)[0]
    around = before.values[z - 1 : z + 2, y - 3 : y + 4, x - 3 : x + 4] / FULL_SCALE
    seen = rice(0.05 / 0.03, scale=0.03)
    assert around.mean() == pytest.approx(seen.mean(), abs=5 * seen.std() / np.sqrt(around.size))


WRONG = {
    "body__drawn": (
        [{"shape": "ring", "intensity": 1}],
        "body.drawn.0.shape: found ring; expected 'capsule', 'ellipsoid' or 'box'",
    ),
    "body__brick": ([12.0, 10.0, 9.0], "body.brick: found [12.0, 10.0, 9.0] with layers of 8 mm in all"),
    "picture__pixels": ([36, 34], "picture.pixels: found [36, 34]; expected 3 numbers"),
    "picture__spacing": ([0.5, 0.5, 0], "picture.spacing.2: found 0; expected greater than 0"),
    "picture__pictured": ([1, 3], "picture.pictured: found 3; expected steps from 1 to 2"),
    "picture__samples": (0.5, "picture.samples: found 0.5; expected a whole number"),
    "body__tissues": ({"bone": "dark"}, "body.tissues.bone: found dark; expected a number"),
}


@pytest.mark.parametrize("key", WRONG)
def test_a_wrong_description_is_one_line(tmp_path, key):
    value, expected = WRONG[key]
    with pytest.raises(Problems) as raised:
        read_truth(described(tmp_path, **{key: value}))
    assert len(raised.value.problems) == 1, raised.value.problems
    assert expected in str(raised.value)


def test_a_wrong_mesh_is_one_line(tmp_path):
    path = described(tmp_path, mesh={"element": "C3D5", "across": 4, "per_layer": 2, "grading": 1})
    with pytest.raises(Problems, match=r"experiment.yaml: mesh.element: found C3D5; expected 'CPE3'"):
        read_truth(path)
    truth = read_truth(described(tmp_path, body__tissues={"bone": 0.1}))
    with pytest.raises(
        InputError, match=r"experiment.yaml: body.tissues.BONE: found no element set of this name; expected one of"
    ):
        solve(truth, tmp_path)
