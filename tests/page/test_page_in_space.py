"""The report of a study in space: slices that lie where they should, a slider for them, and the mesh's borders in them."""

import html
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from seeds import generator

from fingerfit.core.files import keep_json, write_npz
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.sections import border_triangles
from fingerfit.mesh.blocks import brick
from fingerfit.report.page import write_page
from fingerfit.report.page.figures import stiffness_in_space
from fingerfit.report.page.inputs import read_compare
from fingerfit.report.page.regions import places as rows
from fingerfit.report.page.views import COUNTS, cuts_at, cuts_of, views_of

SIZE = np.array([10.0, 8.0, 6.0])
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def field(points, depth):
    """Brightness of a compressed block: a height of the material, so that slices can be told."""
    x, y, z = points.T
    z = z / (1 - depth)
    inside = ((points >= 0) & (points <= SIZE * [1, 1, 1 - depth])).all(axis=1)
    return np.where(inside, 0.2 + 0.05 * z + 0.02 * x + 0.01 * y, 0.0)


def arrays(turned=False, seed=1):
    """As `write_compare` writes them."""
    shape, spacing = ((12, 28, 20) if turned else (12, 20, 28)), np.array([0.5, 0.6, 0.7])
    spacing = spacing[[1, 0, 2]] if turned else spacing
    origin = np.array([12.0, -2.0, -1.0]) if turned else np.array([-2.0, -2.0, -1.0])
    frame = Picture(np.zeros(shape), spacing, origin, TURNED if turned else np.eye(3))
    where = frame.to_points(np.indices(shape)[::-1].reshape(3, -1).T.astype(float))
    rng = generator(seed)
    measured = np.array([field(where, depth).reshape(shape) for depth in (0.1, 0.2)])
    mesh = brick(SIZE, (3, 3, 1), element="C3D4", layers=[("top", 2.0), ("bottom", 4.0)])
    count = np.array([5, 4, 3])
    size = SIZE / count
    centre = (np.stack([i.ravel() for i in np.indices(tuple(count))], axis=1) + 0.5) * size
    faces, part = border_triangles(mesh)
    return {
        "measured": measured,
        "synthesized": measured + rng.normal(0, 0.01, measured.shape),
        "picture_step": np.array([0, 1]),
        "fitted": np.array([True, False]),
        "error": np.array([0.02, 0.03]),
        "floor": np.array([0.01, 0.01]),
        "spacing": spacing,
        "origin": origin,
        "direction": frame.direction,
        "residual_displacement": np.tile(centre * [0.01, 0.001, -0.02], (2, 1, 1)),
        "residual_displacement_noise": np.full((2, 60, 3), 0.02),
        "brightness": np.full((2, 60), 0.008),
        "patch_centre": centre,
        "patch_count": count,
        "patch_layer": np.where(centre[:, 2] > 4, 0, 1),
        "mesh_points": mesh.points,
        "mesh_moved": np.array([mesh.points * [1, 1, 1 - depth] for depth in (0.1, 0.2)]),
        "mesh_faces": faces,
        "mesh_face_part": part,
        "mesh_layer": np.zeros(mesh.element_count, int),
        "layer_names": np.array(["top", "bottom"]),
        "step": np.array([1, 2]),
        "force": np.array([1.0, 2.0]),
        "displacement": np.array([0.6, 1.2]),
        "force_model": np.array([1.0, 2.0]),
        "displacement_model": np.array([0.61, 1.18]),
        "force_noise": np.array(0.01),
        "displacement_noise": np.array(0.01),
    }  # fmt: skip


@pytest.fixture(params=[False, True], ids=["level", "turned"])
def compare(request, tmp_path):
    write_npz(tmp_path / "compare.npz", arrays(request.param))
    return read_compare(tmp_path / "compare.npz")


def test_slices_show_what_is_there(compare):
    views = views_of(compare, cuts_of(compare))
    assert [view.group for view in views] == ["axial"] * COUNTS[0] + ["sagittal"] * COUNTS[1]
    for cut, view in zip(cuts_of(compare), views, strict=True):
        flat = view.compare
        rows, columns = np.indices(flat.measured.shape[1:])
        right = flat.origin[0] + columns.ravel() * flat.spacing[0]
        up = flat.origin[1] + rows.ravel() * flat.spacing[1]
        place = np.full_like(right, cut.position)
        points = np.stack([place, right, up] if view.group == "axial" else [right, place, up], axis=1)
        for picture, depth in zip(flat.measured, (0.1, 0.2), strict=True):
            assert picture.ravel() == pytest.approx(field(points, depth), abs=1e-9)
        assert flat.axes == (("y in mm", "z in mm") if view.group == "axial" else ("x in mm", "z in mm"))


def test_patches_of_a_slice_move_in_its_plane(compare):
    for cut, view in zip(cuts_of(compare), views_of(compare, cuts_of(compare)), strict=True):
        mains = [1, 2] if view.group == "axial" else [0, 2]
        whole = compare.patch_centre[view.patches]
        assert view.mains == mains
        assert view.compare.patch_centre == pytest.approx(whole[:, mains])
        assert np.abs(whole[:, 3 - sum(mains)] - cut.position).max() <= (SIZE / [5, 4, 3])[3 - sum(mains)] / 2 + 1e-9
        assert view.compare.residual_displacement == pytest.approx(
            compare.residual_displacement[:, view.patches][..., mains]
        )
        # cells of a map: flat index along the right axis first, as in plane studies
        nx, ny = view.compare.patch_count
        right = view.compare.patch_centre.reshape(nx, ny, 2)
        assert (np.diff(right[:, 0, 0]) > 0).all() and (np.diff(right[0, :, 1]) > 0).all()


def test_borders_of_the_mesh_in_a_slice(compare):
    view = views_of(compare, cuts_of(compare))[2]
    lines = np.concatenate([np.array(group) for _, group in view.lines[1]])
    assert lines.min(axis=(0, 1)) == pytest.approx([0, 0], abs=0.011)
    assert lines.max(axis=(0, 1)) == pytest.approx([8, 6 * 0.8], abs=0.011)
    assert {number for number, _ in view.lines[1]} == {0, 1}


def test_regions_are_rows_of_layers(compare):
    found = rows(compare)
    assert {(p.layer, round(p.low, 3)) for p in found} == {("top", 4.0), ("bottom", 2.0), ("bottom", 0.0)}
    assert found[0].layer == "top"  # displacements grow with the height
    assert all(len(p.patches) == 20 for p in found)
    assert found[0].where == "on the right, downwards and to the right"


def page(folder, done=True):
    study = folder / "block"
    found = arrays()
    write_npz(study / "base/compare.npz", found)
    rng = generator(4)
    patterns = {
        "residual_displacement_tilt": found["residual_displacement"]
        + rng.normal(0, 0.01, found["residual_displacement"].shape)
    }
    patterns["brightness_drift"] = np.full((2, 60), 0.01)
    patterns["stiffness"] = np.array([[x, y, 4.0, 0.2 * y - 0.7, x - 4.0] for x in (2.0, 5.0) for y in (3.0, 6.0)])
    write_npz(study / "base/diagnosis.npz", patterns)
    ranking = [
        {
            "effect": "tilt",
            "title": "tilt",
            "predicted_fall": 3.0,
            "share_of_excess": 0.5,
            "size": {},
            "units": {},
            "shows": "residual_displacement",
        },
        {"effect": "drift", "title": "drift", "predicted_fall": 1.0, "share_of_excess": 0.1, "shows": "brightness"},
    ]
    diagnosis = {"model": "base", "verdict": "unexplained", "sentence": "s", "effects": [], "misfit": 9.0, "freedom": 3.0,
                 "ranking": ranking, "patterns": ["tilt", "drift"], "confusions": [], "measurements": [], "add": "", "simulations": 0}  # fmt: skip
    keep_json(study / "base/diagnosis.json", diagnosis)
    write_page(study, folder / "report.html")
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return page(tmp_path_factory.mktemp("page"))


def data_of(text):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1])


def test_every_slice_of_every_picture_is_there(whole):
    data = data_of(whole)
    count = sum(COUNTS.values())
    assert len(data["views"]) == len(data["frames"]) == len(data["maps"]) == count
    for panel in ("measured", "synthesized", "difference", "map"):
        assert all(f"{panel}|base|{n}@{v}" in data["panels"] for n in range(2) for v in range(count))
    for key in (
        "there|base|{}|residual_displacement",
        "pattern|base|{}|tilt",
        "there|base|{}|brightness",
        "pattern|base|{}|drift",
    ):
        assert all(key.format(f"{n}@{v}") in data["panels"] for n in range(2) for v in range(count))
    assert "z upwards" in whole
    assert set(data["meshes"]["base"]["lines"]) == {f"{n}@{v}" for n in range(2) for v in range(count)}


def test_stiffness_is_shown_in_a_section_for_each_x(compare, whole):
    places = np.array([[x, y, 4.0, 0.2 * y - 0.7, x - 4.0] for x in (2.0, 5.0) for y in (3.0, 6.0)])
    cuts = cuts_at(compare, places[:, 0])
    assert [cut.position for cut in cuts] == pytest.approx([2.0, 5.0], abs=0.5)
    assert {cut.name for cut in cuts} == {"axial"}
    figures = stiffness_in_space([view.compare for view in views_of(compare, cuts)], places)
    assert len(figures) == 2
    for figure, own in zip(figures, (places[:2], places[2:]), strict=True):
        axes = figure.axes[0]
        assert f"x = {own[0, 0]:.1f} mm" in axes.get_xlabel()
        assert np.asarray(axes.collections[0].get_offsets()) == pytest.approx(own[:, 1:3])
        assert [text.get_text() for text in axes.texts] == ["-10", "+65"]
        outline = np.concatenate([line.get_xydata() for line in axes.lines])
        assert outline.min(axis=0) == pytest.approx([0, 0], abs=0.011)
        assert outline.max(axis=0) == pytest.approx([8, 6], abs=0.011)
    assert {"stiffness|base|0", "stiffness|base|1"} <= set(data_of(whole)["panels"])
    assert "map of where stiffer or softer material would reduce the misfit" in whole


CLICKS = """
const say = {}, q = (s) => document.querySelector(s), shot = () => q('#viewer img[data-panel=measured]').src;
const first = shot();
say.start = q('#slice-name').textContent;
q('#mesh').click();
say.mesh = document.querySelectorAll('#viewer svg.over')[0].querySelectorAll('path').length;
q('#slice').value = 4; q('#slice').dispatchEvent(new Event('input'));
say.slid = q('#slice-name').textContent;
say.other = shot() !== first;
q('button[data-group=sagittal]').click();
say.turned = q('#slice-name').textContent;
say.again = shot() !== first;
q('tr[data-region]').click();
say.framed = q('svg.over-map').querySelectorAll('path').length;
say.hidden = q('#slices').hidden;
const pre = document.createElement('pre'); pre.id = 'result'; pre.textContent = JSON.stringify(say); document.body.append(pre);
"""


def test_in_a_browser(whole, tmp_path):
    binary = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chromium-browser"))), None)
    if binary is None:
        pytest.skip("no Chromium is installed: the page is not tried in a browser")
    text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", whole)
    path = tmp_path / "report.html"
    path.write_text(text.replace("</body>", f"<script>{{{CLICKS}}}</script></body>"), encoding="utf-8")
    run = subprocess.run(
        [binary, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}",
         "--virtual-time-budget=8000", "--dump-dom", path.as_uri()],
        capture_output=True, text=True, encoding="utf-8", timeout=120, check=True,
    )  # fmt: skip
    found = json.loads(html.unescape(re.search(r'<pre id="result">(.*?)</pre>', run.stdout, re.S)[1]))
    assert found == {
        "start": "axial, x = 5.0 mm", "mesh": 2, "slid": "axial, x = 9.0 mm", "other": True,
        "turned": "sagittal, y = 4.0 mm", "again": True, "framed": 5, "hidden": False,
    }  # fmt: skip
