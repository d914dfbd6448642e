"""Exports: files that other programs read, with the right numbers, names and places."""

import csv
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from seeds import generator

from fingerfit.cli import main
from fingerfit.core.files import keep_json, keep_text, write_npz, write_text
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh, read_mesh
from fingerfit.deck.render import render_deck
from fingerfit.imaging.pictures import read_picture
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.report.fields import fields, strains
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.study.data import Data
from fingerfit.study.study import Body, Layer, Noise, Step, Study

ROOT = Path(__file__).resolve().parents[2]
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SIZE = (4.0, 3.0, 2.0)
LAYERS = [("top", 0.8), ("bottom", 1.2)]


def solve(folder, mesh, body, values, poisson=0.45):
    """Uniaxial compression by 10 and 20 %, without friction."""
    steps = tuple(Step(n, displacement=0.2 * n) for n in (1, 2))
    study = Study(folder, "t", "displacement", steps, None, Noise(), body, "slides", "slides")
    write_text(folder / "mesh.inp", format_mesh(mesh))
    context = deck_context(study, mesh, "mesh.inp", values, {"alpha": 1.4, "poisson": poisson})
    write_text(folder / "deck.inp", render_deck("block.inp.j2", context, [ROOT / "templates"]))
    return BuiltinSolver().solve(folder / "deck.inp", folder)


def in_space(folder, element="C3D8", values=None):
    mesh = brick(SIZE, (2, 2, 1), element=element, layers=LAYERS)
    body = Body(tuple(Layer(*layer) for layer in LAYERS), brick=SIZE)
    return mesh, solve(folder, mesh, body, values or {"mu_top": 0.05, "mu_bottom": 0.05})


@pytest.mark.parametrize("element", ["C3D8", "C3D10", "C3D4H", "C3D20", "C3D20H", "C3D10H"])
def test_stress_and_strain_of_uniaxial_compression(tmp_path, element):
    mesh, outcome = in_space(tmp_path, element)
    u, force = outcome.displacement[-1], outcome.reaction[-1, 2]
    found = fields(mesh, tmp_path / "deck.inp", u)
    wide = 1 + np.ptp(u[:, 0]) / SIZE[0]
    axial = -force / (SIZE[0] * SIZE[1] * wide**2)
    assert found.stress is not None
    expected = np.zeros((3, 3))
    expected[2, 2] = -axial
    assert found.stress == pytest.approx(np.tile(expected, (mesh.element_count, 1, 1)), abs=1e-4 * axial)
    assert found.von_mises == pytest.approx(axial, rel=1e-4)
    assert found.volume == pytest.approx(0.8 * wide**2, rel=1e-6)
    green = np.diag([(wide**2 - 1) / 2, (wide**2 - 1) / 2, (0.8**2 - 1) / 2])
    assert found.strain == pytest.approx(np.tile(green, (mesh.element_count, 1, 1)), abs=1e-6)


@pytest.mark.parametrize("element", ["CPE8", "CPE8H", "CPE4", "CPE3H", "CPS4", "CPS8"])
def test_stress_in_the_plane(tmp_path, element):
    mesh = layered_block(4.0, [("top", 1.0), ("bottom", 1.0)], 2, 1, element)
    body = Body((Layer("top", 1.0), Layer("bottom", 1.0)), width=4.0, thickness=5.0)
    outcome = solve(tmp_path, mesh, body, {"mu_top": 0.05, "mu_bottom": 0.05})
    u, force = outcome.displacement[-1], outcome.reaction[-1, 1]
    found = fields(mesh, tmp_path / "deck.inp", u)
    wide = 1 + np.ptp(u[:, 0]) / 4.0
    assert found.stress is not None
    across = found.stress[:, 1, 1]
    if element.startswith("CPE"):
        assert across == pytest.approx(force / (4.0 * 5.0 * wide), rel=1e-4)
        assert (found.stress[:, 2, 2] < 0.3 * across).all()  # held out of the plane: pressed there too
    else:
        # in plane stress the body is thicker than it was
        assert (across > force / (4.0 * 5.0 * wide)).all()
        assert found.stress[:, 2, 2] == pytest.approx(0.0, abs=1e-6)
    assert found.stress[:, 0, 0] == pytest.approx(0.0, abs=2e-3 * abs(across[0]))


def test_inverted_elements_have_no_fields():
    mesh = brick(SIZE, (1, 1, 1), element="C3D4")
    u = np.zeros(mesh.points.shape)
    corner = int(np.argmin(mesh.points.sum(axis=1)))
    u[corner] = [6.0, 6.0, 6.0]
    strain, volume = strains(mesh, u)
    touched = (mesh.blocks[0].nodes == corner).any(axis=1)
    assert np.isnan(volume[touched]).all() and np.isnan(strain[touched]).all()
    assert volume[~touched] == pytest.approx(1.0)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Results of a model in space, as the workflow leaves them, in a turned grid, and their export."""
    model = tmp_path_factory.mktemp("results") / "study/base"
    sim = model.parent / "sims/0123"
    sim.mkdir(parents=True)
    mesh, outcome = in_space(sim, values={"mu_top": 0.02, "mu_bottom": 0.05})
    outcome.save(sim / "solution.npz")
    model.mkdir()
    keep_text(model / "mesh.inp", (sim / "mesh.inp").read_text(encoding="utf-8"))
    keep_json(model / "estimate.json", {"sim": "0123", "sim_mesh": "search", "parameters": {}})
    data = data_of(outcome)
    data.save(model / "prepared.npz")
    rng = generator(1)
    centre = np.array([[x, y, z] for x in (1.0, 3.0) for y in (0.75, 2.25) for z in (0.5, 1.5)])
    displacement = rng.normal(0, 0.05, (2, 8, 3))
    displacement[1, 3] = np.nan
    compare = {
        "measured": data.measured,
        "synthesized": 0.5 * data.measured,
        "picture_step": data.picture_step,
        "step_fitted": np.array([True, False]),
        "response": np.array([0.03, np.nan]),
        "response_noise": np.array([0.01, np.nan]),
        "error": np.array([0.02, 0.03]),
        "floor": np.array([0.01, 0.01]),
        "spacing": data.spacing,
        "origin": data.origin,
        "direction": data.direction,
        "residual_displacement": displacement,
        "residual_displacement_noise": np.full_like(displacement, 0.02),
        "patch_centre": centre,
        "patch_count": np.array([2, 2, 2]),
        "mesh_points": mesh.points,
        "step": data.step,
        "force": data.force,
        "displacement": data.displacement,
        "force_model": -outcome.reaction[:, 2],
        "displacement_model": data.displacement,
        "force_noise": np.array(0.01),
        "displacement_noise": np.array(0.01),
    }
    write_npz(model / "compare.npz", compare)
    write_npz(model / "diagnosis.npz", {"stiffness": STIFFNESS})
    keep_json(model / "diagnosis.json", {"ranking": RANKING})
    assert main(["export", str(model)]) == 0
    return model / "export", mesh, outcome, compare


STIFFNESS = np.array([[1.0, 2.0, 1.5, -0.2, -7.5], [3.0, 1.0, 0.5, 0.1, 2.0]])
ERROR = {"fitted": 1.01, "held_out": 1.04}
RANKING = [
    {"name": "friction", "predicted_fall": 300.0, "share_of_excess": 0.9, "refit": {"misfit": 205.0, "error": ERROR}},
    {"name": "dermis", "predicted_fall": 20.0, "share_of_excess": 0.1, "refit": None},
]


def data_of(outcome):
    rng = generator(2)
    shape = (6, 12, 9)
    nothing = np.zeros((0, 3))
    return Data(
        step=np.array([1, 4]), force=-outcome.reaction[:, 2], displacement=np.array([0.2, np.nan]), control="displacement",
        force_noise=0.01, displacement_noise=0.01, picture_noise=0.01, points_noise=0.0,
        before=rng.uniform(size=shape).astype(np.float32), coefficients=np.zeros(shape, np.float32),
        measured=rng.uniform(size=(2, *shape)).astype(np.float32), picture_step=np.array([0, 1]),
        spacing=np.array([0.5, 0.6, 0.7]), origin=np.array([5.0, -1.0, -1.0]), direction=TURNED, background=0.0,
        smooth=0.8, points=nothing, points_displacement=nothing, points_step=np.zeros(0, int),
    )  # fmt: skip


def test_the_series_names_its_files(made):
    folder, *_ = made
    tree = ElementTree.parse(folder / "fields/model.pvd")
    entries = [(float(e.get("timestep")), e.get("file")) for e in tree.iter("DataSet")]
    assert entries == [(0, "before.vtu"), (1, "step_1.vtu"), (4, "step_4.vtu")]
    assert sorted(p.name for p in (folder / "fields").iterdir()) == [
        "before.vtu",
        "model.pvd",
        "residual_step_1.vtu",
        "residual_step_4.vtu",
        "step_1.vtu",
        "step_4.vtu",
        "stiffness.vtu",
    ]


def test_fields_are_read_back(made):
    folder, mesh, outcome, _ = made
    grid = meshio.read(folder / "fields/step_4.vtu")
    assert grid.points == pytest.approx(mesh.points)
    assert np.array_equal(grid.cells_dict["hexahedron"], mesh.blocks[0].nodes)
    assert grid.point_data["displacement_mm"] == pytest.approx(outcome.displacement[1])
    data = {name: values[0] for name, values in grid.cell_data.items()}
    assert set(data) == {
        "layer", "green_lagrange_strain", "volume_ratio", "cauchy_stress_MPa", "von_mises_stress_MPa",
    }  # fmt: skip
    names = [row["name"] for row in rows(folder / "layers.csv")]
    top = data["layer"] == names.index("top")
    heights = mesh.points[mesh.blocks[0].nodes].mean(axis=1)[:, 2]
    assert (heights[top] > 1.2).all() and (heights[~top] < 1.2).all()
    # the soft layer is strained more
    strain = data["green_lagrange_strain"].reshape(-1, 3, 3)[:, 2, 2]
    assert strain[top].mean() < 1.3 * strain[~top].mean() < 0
    still = meshio.read(folder / "fields/before.vtu")
    assert np.abs(still.point_data["displacement_mm"]).max() == 0
    assert np.abs(still.cell_data["cauchy_stress_MPa"][0]).max() < 1e-12


def test_pictures_lie_where_they_were_measured(made):
    folder, _, _, compare = made
    for n, step in enumerate((1, 4)):
        measured = read_picture(folder / f"pictures/measured_step_{step}.nii.gz")
        assert measured.values == pytest.approx(compare["measured"][n], abs=1e-6)
        for name in ("spacing", "origin", "direction"):
            assert getattr(measured, name) == pytest.approx(compare[name], abs=1e-5)
        difference = read_picture(folder / f"pictures/difference_step_{step}.nii.gz")
        assert difference.values == pytest.approx(0.5 * compare["measured"][n], abs=1e-6)


def test_residual_displacements_are_vectors_in_space(made):
    import SimpleITK as sitk

    folder, _, _, compare = made
    image = sitk.ReadImage(str(folder / "pictures/residual_displacement_mm_step_4.nii.gz"))
    assert image.GetNumberOfComponentsPerPixel() == 3
    for patch, centre in enumerate(compare["patch_centre"]):
        index = image.TransformPhysicalPointToIndex(centre.tolist())
        expected = np.nan_to_num(compare["residual_displacement"][1, patch])
        assert image.GetPixel(index) == pytest.approx(expected, abs=1e-6)
    outside = image.TransformPhysicalPointToIndex((-1.2, 2.0, 1.0))
    assert image.GetPixel(outside) == (0, 0, 0)


def test_residual_displacements_are_vectors_at_points(made):
    folder, _, _, compare = made
    points = meshio.read(folder / "fields/residual_step_4.vtu")
    known = np.isfinite(compare["residual_displacement"][1, :, 0])
    assert points.points == pytest.approx(compare["patch_centre"][known])
    assert points.point_data["residual_displacement_mm"] == pytest.approx(compare["residual_displacement"][1, known])
    assert (points.point_data["noise_mm"] == 0.02).all()


def test_a_study_of_forces_alone_has_its_errors_by_step(made):
    from fingerfit.report.export import read_results, write_tables

    folder = made[0]
    found = read_results(folder.parent)
    nothing = {
        "picture_step": np.zeros(0, int),
        "residual_displacement": np.zeros((0, 8, 3)),
        "residual_displacement_noise": np.zeros((0, 8, 3)),
    }
    write_tables(replace(found, compare=found.compare | nothing), folder.parent)
    errors = rows(folder.parent / "error_by_step.csv")
    assert [(row["step"], row["fitted"], row["times_the_noise"]) for row in errors] == [
        ("1", "yes", ""),
        ("4", "no", ""),
    ]
    assert errors[0]["response_times_the_noise"] == "3"


def rows(path):
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_tables(made):
    folder, _, outcome, compare = made
    forces = rows(folder / "forces.csv")
    assert [row["step"] for row in forces] == ["1", "4"]
    assert float(forces[1]["force_model_N"]) == pytest.approx(-outcome.reaction[1, 2], rel=1e-5)
    assert forces[1]["displacement_measured_mm"] == ""
    assert float(forces[0]["force_residual_N"]) == pytest.approx(
        compare["force"][0] - compare["force_model"][0], abs=1e-9
    )
    assert [row["force_noise_N"] for row in forces] == ["0.01", "0.01"]
    errors = rows(folder / "error_by_step.csv")
    assert [(row["fitted"], float(row["times_the_noise"])) for row in errors] == [("yes", 2.0), ("no", 3.0)]
    assert [row["response_times_the_noise"] for row in errors] == ["3", ""]
    patches = rows(folder / "residual_by_patch.csv")
    assert len(patches) == 15  # one is not known
    row = next(r for r in patches if r["step"] == "4" and (r["x_mm"], r["y_mm"], r["z_mm"]) == ("3", "2.25", "1.5"))
    assert row["layer"] == "top"
    assert float(row["residual_z_mm"]) == pytest.approx(compare["residual_displacement"][1, 7, 2], rel=1e-4)
    layers = rows(folder / "residual_by_layer.csv")
    lower = next(r for r in layers if r["step"] == "1" and r["layer"] == "bottom")
    own = np.linalg.norm(compare["residual_displacement"][0, ::2], axis=1)
    assert float(lower["rms_mm"]) == pytest.approx(np.sqrt(np.mean(own**2)), rel=1e-4)
    assert float(lower["largest_mm"]) == pytest.approx(own.max(), rel=1e-4)
    assert lower["patches"] == "4"


def test_the_map_of_stiffness_and_the_candidates(made):
    folder = made[0]
    places = rows(folder / "stiffness.csv")
    assert [(float(p["x_mm"]), float(p["change_of_log_mu"]), float(p["standard_deviations"])) for p in places] == [
        (1.0, -0.2, -7.5),
        (3.0, 0.1, 2.0),
    ]
    points = meshio.read(folder / "fields/stiffness.vtu")
    assert points.points == pytest.approx(STIFFNESS[:, :3])
    assert points.point_data["standard_deviations"] == pytest.approx(STIFFNESS[:, 4])
    first, second = rows(folder / "candidates.csv")
    assert (first["effect"], first["misfit_refitted"], first["error_held_out"]) == ("friction", "205", "1.04")
    assert (second["effect"], second["misfit_refitted"]) == ("dermis", "")


def test_before_the_diagnosis_there_is_nothing_to_export(tmp_path, capsys):
    assert main(["export", str(tmp_path)]) == 1
    assert "estimate.json: is not there; `fingerfit run` makes it" in capsys.readouterr().err
    assert not (tmp_path / "export").exists()


def test_a_state_before_the_first_picture_counts_for_stress_only(tmp_path, made):
    from fingerfit.report.export import read_results, write_fields

    folder, _, outcome, _ = made
    found = read_results(folder.parent)
    later = replace(found.data, step=np.array([4]))
    written = write_fields(replace(found, data=later), tmp_path)
    assert [path.name for path in written[:3]] == ["model.pvd", "before.vtu", "step_4.vtu"]
    first, last = (meshio.read(path) for path in written[1:3])
    assert np.abs(first.point_data["displacement_mm"]).max() == 0
    assert np.abs(first.cell_data["cauchy_stress_MPa"][0]).max() > 1e-3
    moved = outcome.displacement[1] - outcome.displacement[0]
    assert last.point_data["displacement_mm"] == pytest.approx(moved)
    assert read_mesh(folder.parent / "mesh.inp").dim == 3
