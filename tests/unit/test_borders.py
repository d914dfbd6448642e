"""Borders of layers that lie elsewhere, and one within a layer: the nodes of the mesh follow."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import LAYERS, MU, deck_text, phantom

from fingerfit.core.errors import InputError
from fingerfit.core.files import write_text
from fingerfit.deck.borders import LEAST, followed, rows_of
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.forward.bodies import deck_of_body, lift, moved, without_load
from fingerfit.forward.predict import in_first_picture, since_first_picture
from fingerfit.imaging.warp import Probe
from fingerfit.mesh.blocks import layered_block
from fingerfit.model.catalogue import catalogue
from fingerfit.solvers.contract import CONVERGED
from fingerfit.solvers.registry import get_solver
from fingerfit.study.study import Layer

MESH = layered_block(12.0, LAYERS, 4, 2, "CPE8H")
NAMES = [name.upper() for name, _ in LAYERS]
KNOWN = catalogue()
STUDY = phantom("force", [20.0, 40.0])
X, Y = MESH.points.T
TOP, FIRST, SECOND = 12.0, 8.0, 4.0


def heights(values, mesh=MESH):
    present = [effect for effect in KNOWN.values() if effect.present(values)]
    return followed(mesh, NAMES, present, values).points[:, 1]


def deck(values, mesh=MESH, study=STUDY, mu=MU):
    return deck_text(study, mesh, mu | values, {"alpha": 1.4, "poisson": 0.49})


def solved(text, folder, mesh, solver="builtin"):
    folder.mkdir(exist_ok=True)
    write_text(folder / "mesh.inp", format_mesh(mesh))
    write_text(folder / "deck.inp", text)
    outcome = get_solver(solver).solve(folder / "deck.inp", folder)
    assert outcome.status == CONVERGED
    return outcome


def test_only_the_nodes_beside_a_border_move_and_evenly():
    now = heights({"interface.down": 1.0, "interface.border": 1})
    assert now[Y == FIRST] == pytest.approx(FIRST - 1.0)
    assert now[Y == 10.0] == pytest.approx(9.5)
    assert now[Y == 6.0] == pytest.approx(5.5)
    beyond = (Y <= SECOND) | (Y == TOP)
    assert np.array_equal(now[beyond], Y[beyond])


def test_a_border_is_inclined_and_bent_in_the_middle_of_sides_too():
    values = {"interface.incline": 1.2, "interface.bend": 0.3, "interface.border": 2}
    right = X / 12.0 - 0.5
    expected = SECOND - 1.2 * right - 0.3 * (4 * right**2 - 0.333333)
    at = Y == SECOND
    assert heights(values)[at] == pytest.approx(expected[at])
    assert len(np.unique(X[at])) == 9


@pytest.mark.parametrize(
    ("degree", "form"), list(enumerate(("down", "incline", "bend", "third", "fourth", "fifth", "sixth")))
)
def test_the_forms_of_a_border_are_polynomials_of_legendre(degree, form):
    """Of the place from -1 on the left to 1 on the right; those up to the parabola in units of their leading terms."""
    now = heights({f"interface.{form}": 0.3, "interface.border": 2})
    at = Y == SECOND
    form_of = np.polynomial.Legendre.basis(degree)(2.0 * X[at] / 12.0 - 1.0)
    assert now[at] == pytest.approx(SECOND - 0.3 * {1: 0.5, 2: 2 / 3}.get(degree, 1.0) * form_of, abs=1e-5)


@pytest.mark.parametrize(
    ("form", "probed"), [("down", ""), ("incline", "incline_"), ("bend", "bend_"), ("third", "third_")]
)
def test_the_probe_has_the_same_as_the_interface_for_either_border(form, probed):
    for border, name in ((1, "upper"), (2, "lower")):
        for value in (0.5, -0.5):
            one = heights({f"interface.{form}": value, "interface.border": border})
            assert heights({f"geometry_probe.{probed}{name}": value}) == pytest.approx(one)


def test_borders_do_not_come_nearer_than_a_share_of_a_layer():
    thin = layered_block(12.0, [("top", 1.0), ("middle", 10.0), ("bottom", 1.0)], 2, 2)
    for value in (1.5, -1.5):
        now = heights({"interface.down": value, "interface.border": 1}, thin)
        border = now[np.isclose(thin.points[:, 1], 11.0)]
        assert border == pytest.approx(9.5 if value > 0 else 12.0 - LEAST)
    both = heights({"geometry_probe.upper": 1.9, "geometry_probe.lower": -1.9})
    assert both[Y == FIRST] - both[Y == SECOND] == pytest.approx(LEAST * 4.0)


def test_a_row_ends_where_a_layer_is_split():
    """The nearest row of nodes moves there, the others of the layer evenly with it."""
    mesh = layered_block(12.0, LAYERS, 2, 3)
    assert rows_of(mesh, mesh.element_sets["MIDDLE"]) == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0], abs=1e-6)
    values = {"split_layer.contrast": 0.4, "split_layer.layer": 2, "split_layer.share": 0.45}
    now, stated = heights(values, mesh), mesh.points[:, 1]
    rows = np.unique(np.round(now[(stated < FIRST + 1e-6) & (stated > SECOND - 1e-6)], 6))
    # corners and middles of sides
    assert rows == pytest.approx([4.0, 4.55, 5.1, 5.65, 6.2, 7.1, 8.0])
    outside = (stated > FIRST + 1e-6) | (stated < SECOND - 1e-6)
    assert np.array_equal(now[outside], stated[outside])
    # an effect that is absent moves nothing, and neither does one row alone
    assert np.array_equal(heights(values | {"split_layer.contrast": 0.0}, mesh), stated)
    single = layered_block(12.0, LAYERS, 2, 1)
    assert np.array_equal(heights(values, single), single.points[:, 1])


def test_elements_that_do_not_lie_in_rows_have_none():
    mesh = layered_block(12.0, LAYERS, 4, 2)
    points = mesh.points.copy()
    points[np.isclose(points[:, 1], 6.0) & (points[:, 0] > 6.0), 1] = 6.3
    uneven = type(mesh)(points, mesh.blocks, mesh.node_sets, mesh.element_sets)
    assert not len(rows_of(uneven, mesh.element_sets["MIDDLE"]))
    assert len(rows_of(uneven, mesh.element_sets["TOP"])) == 3


def test_layers_that_reach_into_each_other_are_refused():
    points = MESH.points.copy()
    points[:, 1] += 0.3 * np.sin(points[:, 0])
    waved = type(MESH)(points, MESH.blocks, MESH.node_sets, MESH.element_sets)
    with pytest.raises(InputError, match="effect interface: changes: found layers that reach into each other"):
        heights({"interface.down": 1.0, "interface.border": 1}, waved)


def test_the_deck_has_the_mesh_and_its_body_is_the_one_of_the_first_picture(tmp_path):
    """As a body whose layers are stated there: the same answer, read at the same places."""
    text = deck({"interface.down": 1.0, "interface.border": 1})
    assert "*INCLUDE" not in text
    other = layered_block(12.0, [("top", 5.0), ("middle", 3.0), ("bottom", 4.0)], 4, 2, "CPE8H")
    assert without_load(MESH, text).points == pytest.approx(other.points)
    outcome = solved(text, tmp_path / "one", MESH)
    plain = solved(deck({}, other), tmp_path / "two", other)
    assert outcome.displacement == pytest.approx(plain.displacement, abs=1e-7)
    since = since_first_picture(outcome, 2, False, lift(MESH, text), moved(MESH, text))
    assert in_first_picture(MESH, since).points == pytest.approx(other.points)


def test_a_split_layer_is_one_of_two_materials(tmp_path):
    """As good as a mesh with both materials in layers of their own; with rows that stay a third of the change was missed."""
    values = {"split_layer.contrast": 2.0, "split_layer.layer": 2, "split_layer.share": 0.35}
    own_mesh = layered_block(12.0, LAYERS, 8, 4, "CPE8H")
    ours = solved(deck(values, own_mesh), tmp_path / "one", own_mesh)
    layers = [("top", 4.0), ("upper", 1.4), ("lower", 2.6), ("bottom", 4.0)]
    mesh = layered_block(12.0, layers, 8, 4, "CPE8H")
    half = np.exp(1.0)
    mu = {"mu_top": MU["mu_top"], "mu_upper": MU["mu_middle"] * half, "mu_lower": MU["mu_middle"] / half}
    study = replace(STUDY, body=replace(STUDY.body, layers=tuple(Layer(*layer) for layer in layers)))
    fine = solved(deck({}, mesh, study, mu | {"mu_bottom": MU["mu_bottom"]}), tmp_path / "two", mesh)
    whole = solved(deck({}, own_mesh), tmp_path / "three", own_mesh)
    beside = moved(own_mesh, deck(values, own_mesh))
    there = in_first_picture(own_mesh, since_first_picture(ours, 2, moved=beside))
    places = np.stack(np.meshgrid(np.linspace(0.5, 11.5, 12), np.linspace(0.5, 11.5, 12)), axis=-1).reshape(-1, 2)
    one, two, none = (
        Probe(body, places).read(own.displacement[-1]) for body, own in ((there, ours), (mesh, fine), (own_mesh, whole))
    )
    change, off = (np.sqrt(np.mean((two - other) ** 2)) for other in (none, one))
    assert off < 0.03 * change


def test_calculix_takes_it(tmp_path, needs_ccx):
    mesh = layered_block(12.0, LAYERS, 4, 2, "CPE8")
    text = deck({"interface.incline": 1.0, "interface.bend": 0.3, "interface.border": 1}, mesh)
    ours, theirs = (solved(text, tmp_path / solver, mesh, solver) for solver in ("builtin", "calculix"))
    assert theirs.displacement == pytest.approx(ours.displacement, abs=1e-4)


@pytest.mark.parametrize("line", ["*INCLUDE, INPUT=mesh.inp", "*Include,input = mesh.inp"])
def test_a_template_may_write_its_line_in_any_way_that_abaqus_reads(line):
    values = MU | {"interface.down": 1.0, "interface.border": 1}
    text = deck_of_body(STUDY, MESH, "mesh.inp", KNOWN, values, lambda body: f"*HEADING\n{line}\n*STEP\n")
    assert text.startswith("*HEADING\n** ---")
    assert text.endswith("\n*STEP\n")
    assert "mesh.inp" not in text


def test_a_template_that_includes_no_mesh_is_refused():
    with pytest.raises(InputError, match="no line"):
        values = MU | {"interface.down": 1.0, "interface.border": 1}
        deck_of_body(STUDY, MESH, "mesh.inp", KNOWN, values, lambda body: "*INCLUDE, INPUT=other.inp\n")
