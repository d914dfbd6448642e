"""Effects of a brick of layers: its base and indenter give way along both axes of their plates, or it is tilted."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import LAYERS as PLANE
from conftest import ROOT, phantom
from scipy.spatial.transform import Rotation

from fingerfit.core.files import write_text
from fingerfit.deck.context import deck_context
from fingerfit.deck.loading import under_indenter
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.questions import areas, strips
from fingerfit.deck.render import render_deck
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.model.applicable import unmet
from fingerfit.model.catalogue import catalogue
from fingerfit.model.observation import Observation
from fingerfit.model.scales import bound
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.contract import CONVERGED, Capabilities
from fingerfit.solvers.first_order import answers
from fingerfit.solvers.needs import FEATURES
from fingerfit.solvers.registry import get_solver
from fingerfit.study.study import Body, Layer

WIDTH, FORCE, MU = 10.0, 1.0, 0.03
SIZES = {"width": WIDTH, "height": 6.0, "force": FORCE}
LAYERS = [("top", 3.0), ("bottom", 3.0)]
MESH = brick((WIDTH, WIDTH, 6.0), (3, 3, 2), element="C3D20H", layers=LAYERS)


def study(control="force", value=FORCE):
    body = Body(tuple(Layer(*layer) for layer in LAYERS), brick=(WIDTH, WIDTH, 6.0))
    return replace(phantom(control, [value]), body=body)


def two_steps():
    """Half the way and the whole of it."""
    return replace(phantom("displacement", [0.2, 0.4]), body=study().body)


def deck(values=(), of=None, mesh=MESH):
    constants = {"mu_top": MU, "mu_bottom": MU} | dict(values)
    context = deck_context(of or study(), mesh, "mesh.inp", constants, {"alpha": 2.0, "poisson": 0.45})
    return render_deck("block.inp.j2", context, [ROOT / "templates"])


def solve(values, folder, solver="builtin", of=None, mesh=MESH, step=-1):
    write_text(folder / "mesh.inp", format_mesh(mesh))
    # ccx takes a hundred times as long where elements have numbers in the millions
    write_text(folder / "deck.inp", re.sub(r"\b([1289])00(\d{4}), ", r"\1\2, ", deck(values, of, mesh)))
    found = get_solver(solver).solve(folder / "deck.inp", folder)
    assert found.status == CONVERGED, found
    return found.displacement[step]


def solve_text(text, folder):
    write_text(folder / "deck.inp", text)
    return get_solver("builtin").solve(folder / "deck.inp", folder)


def side(name):
    """Nodes of a side and the area that each stands for."""
    pairs = areas(MESH, MESH.node_sets[name], 1.0)
    return np.array([node - 1 for node, _ in pairs]), np.array([area for _, area in pairs])


@pytest.mark.parametrize("element", ["C3D8", "C3D20H"])
def test_nodes_of_a_side_share_its_area(element):
    mesh = brick((6.0, 4.0, 5.0), (3, 2, 2), element=element)
    found = areas(mesh, mesh.node_sets["BOTTOM"], 1.0)
    assert sorted(node - 1 for node, _ in found) == sorted(mesh.node_sets["BOTTOM"])
    assert sum(area for _, area in found) == pytest.approx(24.0)
    assert min(area for _, area in found) > 0
    assert sum(mesh.points[node - 1, 0] * area for node, area in found) == pytest.approx(24.0 * 3.0)
    assert sum(mesh.points[node - 1, 1] * area for node, area in found) == pytest.approx(24.0 * 2.0)


@pytest.mark.parametrize("element", ["C3D8", "C3D20H"])
def test_nodes_of_the_same_x_stand_for_one_strip(element):
    mesh = brick((6.0, 4.0, 5.0), (3, 2, 2), element=element)
    nodes = mesh.node_sets["BOTTOM"]
    found = strips(mesh, nodes, 1.0)
    assert [pair[:2] for pair in found] == areas(mesh, nodes, 1.0)
    x = mesh.points[[node - 1 for node, *_ in found], 0] / 6.0
    ends = {round(at, 6): (begin, end) for at, (*_, begin, end) in zip(x, found, strict=True)}
    assert all(ends[round(at, 6)] == (begin, end) for at, (*_, begin, end) in zip(x, found, strict=True))
    in_order = [ends[at] for at in sorted(ends)]
    assert in_order[0][0] == 0.0 and in_order[-1][1] == pytest.approx(1.0)
    assert [end for _, end in in_order[:-1]] == [begin for begin, _ in in_order[1:]]
    assert all(begin - 1e-9 <= at <= end + 1e-9 for at, (begin, end) in ends.items())


@pytest.mark.parametrize(("name", "edge"), [("base_slip", "BOTTOM"), ("indenter_slip", "TOP"), ("debonding", "BOTTOM")])
def test_a_plate_lets_go_along_both_of_its_axes(name, edge, tmp_path):
    own = {"debonding.left": 0.5, "debonding.right": 0.5, "debonding.extent": 0.5}
    moved = solve(own if name == "debonding" else {f"{name}.share": 0.5}, tmp_path)[MESH.node_sets[edge]]
    at = MESH.points[MESH.node_sets[edge]][:, :2] - WIDTH / 2
    assert (np.abs(moved[:, :2]).max(axis=0) > 0.01).all()
    # outwards on either side
    assert ((moved[:, :2] * at).sum(axis=0) > 0).all()
    if name != "debonding":  # which begins at the left and the right edge
        mirrored = [np.abs(at - place[::-1]).max(axis=1).argmin() for place in at]
        assert moved[:, 0] == pytest.approx(moved[mirrored, 1], abs=1e-6)


def test_a_soft_bed_gives_way_as_far_as_it_says(tmp_path):
    """Equilibrium: the force is that of all springs, so that their mean way weighed by area is known."""
    nodes, area = side("BOTTOM")
    down = -solve({"soft_bed.share": 0.2, "soft_bed.side": 0.0}, tmp_path)[nodes, 2]
    assert down @ area / area.sum() == pytest.approx(FORCE / WIDTH**2 / MU * 0.1 * WIDTH * 0.2 / 0.8, rel=1e-6)


def test_the_probe_of_the_base_can_be_its_members(tmp_path):
    everywhere = {f"base_probe.{place}": 0.4 for place in ("left", "left_half", "middle", "right_half", "right")}
    down = {f"base_probe.down_{place}": 0.1 for place in ("left", "middle", "right")}
    assert solve(everywhere, tmp_path) == pytest.approx(solve({"base_slip.share": 0.4}, tmp_path), abs=1e-7)
    bed = {"soft_bed.share": 0.1, "soft_bed.side": 0.0}
    assert solve(down, tmp_path) == pytest.approx(solve(bed, tmp_path), abs=1e-7)


TOP = MESH.node_sets["TOP"]
ASIDE, BESIDE = (MESH.points[TOP] - MESH.points[MESH.node_sets["INDENTER"][0]])[:, :2].T


@pytest.mark.parametrize("name", ["tilt_in_space", "indenter_probe_in_space"])
def test_a_tilted_indenter_is_a_plane(name, tmp_path):
    values = {f"{name}.slope_x": 0.02, f"{name}.slope_y": -0.03}
    moved = solve(values, tmp_path, of=study("displacement", 0.5))[TOP]
    assert moved[:, 2] == pytest.approx(-0.5 - 0.02 * ASIDE + 0.03 * BESIDE, abs=1e-9)


@pytest.mark.parametrize(
    ("values", "larger"),
    [
        ({"tilt_in_space.early_x": 0.02, "tilt_in_space.early_y": -0.01, "tilt_in_space.power": 2.0}, 0.25),
        ({"indenter_probe_in_space.turned_x": 0.02, "indenter_probe_in_space.turned_y": -0.01}, 1.0),
    ],
    ids=["tilt", "probe"],
)
def test_a_tilt_of_its_own_course_is_gone_at_the_largest_load(values, larger, tmp_path):
    deeper = -solve(values, tmp_path, of=two_steps(), step=slice(None))[:, TOP, 2] - [[0.2], [0.4]]
    assert deeper == pytest.approx(np.outer([larger, 0.0], 0.02 * ASIDE - 0.01 * BESIDE), abs=1e-6)


def test_a_curved_indenter_is_round(tmp_path):
    values = {"indenter_probe_in_space.curve": 0.004, "indenter_probe_in_space.lowered": 0.1}
    moved = solve(values, tmp_path, of=study("displacement", 0.5))[TOP]
    assert moved[:, 2] == pytest.approx(-(0.6 + 0.004 * (ASIDE**2 + BESIDE**2)), abs=1e-9)


@pytest.mark.parametrize(
    ("values", "halfway"),
    [
        ({"sideways_in_space.early_x": 0.04, "sideways_in_space.early_y": -0.02, "sideways_in_space.power": 2.0}, 0.25),
        ({"indenter_probe_in_space.midway_x": 0.04, "indenter_probe_in_space.midway_y": -0.02}, 1.0),
    ],
    ids=["member", "probe"],
)
def test_an_indenter_moves_along_both_axes(values, halfway, tmp_path):
    name = next(iter(values)).partition(".")[0]
    moved = {f"{name}.moved_x": 0.1, f"{name}.moved_y": -0.06}
    found = solve(values | moved, tmp_path, of=two_steps(), step=slice(None))[:, TOP, :2]
    wanted = np.array([[0.05 + 0.04 * halfway, -0.03 - 0.02 * halfway], [0.1, -0.06]])
    assert found == pytest.approx(np.broadcast_to(wanted[:, None], found.shape), abs=1e-6)


@pytest.mark.parametrize("name", ["indenter_slip.share", "indenter_probe_in_space.slips"])
def test_springs_under_an_indenter_go_aside_with_it_along_both_axes(name, tmp_path):
    """Hardly slipping it is glued; slipping it takes the body along as it does where it goes straight down."""
    aside = {"sideways_in_space.moved_x": 0.1, "sideways_in_space.moved_y": -0.06}
    where = study("displacement", 0.3)
    glued, firm = (solve(values, tmp_path, of=where) for values in (aside, aside | {name: 1e-6}))
    assert np.abs(firm - glued).max() < 2e-4
    loose, plain = (solve(values | {name: 0.5}, tmp_path, of=where) for values in (aside, {}))
    dragged = (loose - plain)[TOP, :2].mean(axis=0)
    assert (dragged / [0.1, -0.06] > 0.2).all() and (dragged / [0.1, -0.06] < 0.9).all()
    assert dragged[0] / 0.1 == pytest.approx(dragged[1] / -0.06, rel=0.02)


def test_the_probe_of_the_indenter_can_be_its_members(tmp_path):
    where = study("displacement", 0.3)
    for probed, member in (
        ({"slips": 0.5}, {"indenter_slip.share": 0.5}),
        ({"slope_y": 0.02, "moved_y": 0.1}, {"tilt_in_space.slope_y": 0.02, "sideways_in_space.moved_y": 0.1}),
    ):
        found = solve({f"indenter_probe_in_space.{name}": value for name, value in probed.items()}, tmp_path, of=where)
        assert found == pytest.approx(solve(member, tmp_path, of=where), abs=1e-9)


def test_in_the_plane_nothing_is_beside_and_no_indenter_goes_that_way():
    plane = layered_block(12.0, PLANE, 4, 2, "CPE8H")
    assert not under_indenter(plane, plane.node_sets["TOP"])["beside"].any()
    constants = dict.fromkeys(("mu_top", "mu_middle", "mu_bottom"), MU)
    tilted, moved = (
        deck_context(phantom("force", [10.0]), plane, "mesh.inp", constants | values, {"alpha": 2.0, "poisson": 0.45})
        for values in ({"tilt_in_space.slope_y": 0.02}, {"sideways_in_space.moved_y": 0.1})
    )
    assert {way for _, way in tilted["steps"][0]["deeper"]} == {0.0}
    assert [step["aside"] for step in moved["steps"]] == [[(1, 0.0)]]


SLOPES = {
    "tilt_in_space.slope_y": 0.02,
    "sideways_in_space.moved_y": 0.1,
    "indenter_probe_in_space.slips": 0.3,
    "prestretch_in_space.along_y": 0.02,
}
"""One number of each kind, and where it is."""


@pytest.mark.parametrize("name", SLOPES)
def test_slopes_to_first_order_are_those_of_whole_simulations(name, tmp_path):
    here, *sides = (deck({name: part * SLOPES[name]}, study("force", 0.5)) for part in (1.0, 1.02, 0.98))
    write_text(tmp_path / "mesh.inp", format_mesh(MESH))
    known, ahead, behind = (solve_text(text, tmp_path) for text in (here, *sides))
    first, second = answers(tmp_path, here, known, sides)
    whole, near = (ahead.displacement - behind.displacement), first.displacement - second.displacement
    assert np.abs(whole).max() > 1e-5
    assert np.abs(near - whole).max() < 2e-3 * np.abs(whole).max()


EFFECTS = bound(catalogue(), {**SIZES, "breadth": WIDTH}, "force")


def is_of_a_brick(effect):
    """Whether it is for bodies in space whose sides or layers are flat."""
    return "space" in effect.needs and bool({"block", "layers", "base", "indenter"} & set(effect.needs))


OF_BRICKS = [name for name, effect in EFFECTS.items() if effect.simulated and is_of_a_brick(effect)]


@pytest.mark.parametrize("name", OF_BRICKS)
def test_absent_it_leaves_the_deck_and_each_of_its_numbers_changes_it(name):
    effect = EFFECTS[name]
    for place in effect.places():
        assert deck({**effect.null(), **place}) == deck()
    for p in effect.parameters:
        assert deck({effect.key(p.name): p.null + p.step}, two_steps()) != deck((), two_steps())


@pytest.mark.parametrize("name", OF_BRICKS)
def test_at_its_step_it_has_a_solution(name, tmp_path):
    effect = EFFECTS[name]
    values = {effect.key(p.name): p.null + p.step for p in effect.parameters}
    change = np.abs(solve(values, tmp_path) - solve({}, tmp_path)).max()
    assert 1e-4 < change < 1.0


def shifts(values, k, points=MESH.points):
    """How far the volume at step k of 4 shows nodes from where they are, mm."""
    course = tuple({"k": float(k), "n": 4.0, "now": k / 4, "loaded": k / 4} for k in range(1, 5))
    return Observation.of(bound(catalogue(), SIZES).values(), values, MESH.points, course).shift(k, points)


OBSERVED = {
    "misregistration_in_space": ({"x": "moved_x", "y": "moved_y", "z": "moved_z"}, "growing"),
    "turned_in_space": ({"about_x": "about_x", "about_y": "about_y", "about_z": "about_z"}, "turning"),
    "stretched_in_space": ({"wide": "wide", "broad": "broad", "high": "high"}, "growing"),
}
"""Numbers of the probe for those of a member, and what those that grow are called."""


@pytest.mark.parametrize("k", [1, 4])
@pytest.mark.parametrize("growing", [0.0, 1.0])
@pytest.mark.parametrize("name", OBSERVED)
def test_the_probe_of_the_observation_can_be_its_members(name, growing, k):
    alike, called = OBSERVED[name]
    for own, its in alike.items():
        if growing:
            its = f"{called}_{its}" if name == "stretched_in_space" else f"{called}_{its[-1]}"
        member = shifts({f"{name}.{own}": 0.01, f"{name}.growing": growing}, k)
        assert np.abs(member).max() > 0.002
        # a turn is to first order in the probe: half its square times half the diagonal is left
        left = 0.5 * 0.01**2 * np.linalg.norm([WIDTH, WIDTH, 6.0]) / 2 if name == "turned_in_space" else 1e-12
        assert shifts({f"observation_probe_in_space.{its}": 0.01}, k) == pytest.approx(member, abs=left)


def test_volumes_turn_as_a_rigid_body_does():
    vector, middle = np.array([0.08, -0.06, 0.1]), np.array([WIDTH, WIDTH, 6.0]) / 2
    values = dict(zip(("about_x", "about_y", "about_z"), vector, strict=True))
    for growing, share in ((0.0, 1.0), (1.0, 0.5)):
        named = {f"turned_in_space.{own}": value for own, value in (values | {"growing": growing}).items()}
        turned = Rotation.from_rotvec(share * vector).apply(MESH.points - middle) + middle
        # the series ends at the fourth power of the angle, 0.14
        assert shifts(named, 2) == pytest.approx(turned - MESH.points, abs=1e-5)


def test_volumes_are_distorted_about_their_middle():
    middle = np.array([WIDTH, WIDTH, 6.0]) / 2
    beside = np.array([[5.0, 0.0, 0.0], [0.0, -5.0, 0.0], [0.0, 0.0, 2.5], [3.0, 4.0, 0.0]])
    wanted = -0.05 * beside * [[1.0], [1.0], [0.25], [1.0]]
    found = shifts({"distorted_in_space.barrel": 0.05, "distorted_in_space.growing": 0.0}, 1, middle + beside)
    assert found == pytest.approx(wanted, abs=1e-12)
    grown = shifts({"distorted_in_space.barrel": 0.05, "distorted_in_space.growing": 1.0}, 1, middle + beside)
    assert grown == pytest.approx(wanted / 4, abs=1e-12)
    probed = shifts({"observation_probe_in_space.barrel": 0.05}, 1, middle + beside)
    assert probed == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize(("axes", "plane"), [("xy", (0, 1)), ("xz", (0, 2)), ("yz", (1, 2))])
def test_the_probe_of_the_observation_shears_without_a_turn(axes, plane):
    beside = MESH.points - np.array([WIDTH, WIDTH, 6.0]) / 2
    wanted = np.zeros_like(beside)
    wanted[:, plane] = 0.01 * beside[:, plane[::-1]]
    for name, share in (("shear", 1.0), ("shearing", 0.25)):
        found = shifts({f"observation_probe_in_space.{name}_{axes}": 0.01}, 1)
        assert found == pytest.approx(share * wanted, abs=1e-12)


@pytest.mark.parametrize("name", ["prestretch_in_space", "state_probe_in_space"])
@pytest.mark.parametrize("along", [(0.3, 0.0), (0.0, 0.3), (0.2, -0.1)])
def test_a_body_between_plates_that_slide_loses_its_stretch(name, along, tmp_path):
    """Each axis by its stretch, and by the root of the other one, as z by both."""
    x, y = 1 + np.array(along)
    free = replace(study(), base="slides", indenter="slides")
    values = {f"{name}.along_x": along[0], f"{name}.along_y": along[1]}
    moved = solve(values, tmp_path, of=free, step=0)
    assert moved == pytest.approx(
        MESH.points * ([np.sqrt(y) / x, np.sqrt(x) / y, np.sqrt(x * y)] - np.ones(3)), abs=1e-6
    )


def rows_of(card, values):
    """Lines of numbers below each card of a keyword, without their first entry."""
    found = re.findall(rf"^\*{card}\n((?:[^*].*\n)*)", deck(values), re.MULTILINE)
    return [[[float(x) for x in row.split(",")[1:]] for row in rows.splitlines()] for rows in found]


STRESS = "INITIAL CONDITIONS, TYPE=STRESS"


def test_one_layer_alone_may_have_been_stretched_along_y():
    layer = {"prestretch_in_space.along_y": 0.1, "prestretch_in_space.layer": 2.0}
    # the deviatoric stress of neo-Hooke's law, mu (lambda^2 - I1 / 3)
    squares = np.array([1 / 1.1, 1.1**2, 1 / 1.1])
    assert rows_of(STRESS, layer) == [[pytest.approx([*MU * (squares - squares.mean()), 0, 0, 0])]]
    assert f"{STRESS}\nBOTTOM, " in deck(layer)


def test_the_probe_of_the_state_can_be_its_members():
    for own in ("along_x", "along_y"):
        (both,) = rows_of(STRESS, {f"state_probe_in_space.{own}": 0.05})
        assert len(both) == len(LAYERS)
        assert [both] == rows_of(STRESS, {f"prestretch_in_space.{own}": 0.05, "prestretch_in_space.layer": 0.0})
    warm, swelled = (
        rows_of("TEMPERATURE", {f"{name}": 0.05}) for name in ("swollen.volume", "state_probe_in_space.swollen")
    )
    assert warm == swelled
    pushed, pressed = (
        rows_of("CLOAD", values) for values in ({"preload.force": 0.1 * FORCE}, {"state_probe_in_space.load": 0.1})
    )
    assert pushed == pressed
    assert len(pushed) == 2


class Careless(CalculixSolver):
    """Takes an initial stress, which decks of CalculiX have by integration point."""

    capabilities = Capabilities(CalculixSolver.capabilities.elements, features=FEATURES)


def by_point(text, mesh):
    """The deck with its initial stress at the 27 points of each element."""

    def rows(found):
        given = [line.split(", ", 1) for line in found[1].splitlines()]
        return "*INITIAL CONDITIONS, TYPE=STRESS\n" + "".join(
            f"{int(element) + 1}, {point}, {stress}\n"
            for name, stress in given
            for element in mesh.element_sets[name]
            for point in range(1, 28)
        )

    return re.sub(r"\*INITIAL CONDITIONS, TYPE=STRESS\n((?:[^*].*\n)*)", rows, text)


def test_calculix_reads_the_initial_stress_in_the_same_order(tmp_path, needs_ccx):
    """In an elastic body at small strain; it goes on without it in one that is hyperelastic."""
    mesh = brick((WIDTH, WIDTH, 6.0), (2, 2, 1), element="C3D20", layers=LAYERS)
    values = {"prestretch_in_space.along_x": 0.04, "prestretch_in_space.along_y": -0.02}
    elastic = f"*ELASTIC\n{2 * MU * 1.45}, 0.45\n"
    text = re.sub(r"\*HYPERELASTIC, OGDEN.*\n.*\n", elastic, deck(values, study("displacement", 0.3), mesh))
    text = re.sub(r"\b([1289])00(\d{4}), ", r"\1\2, ", text).replace(", NLGEOM", "")
    write_text(tmp_path / "mesh.inp", format_mesh(mesh))
    found = []
    for solver, shown in ((get_solver("builtin"), text), (Careless(), by_point(text, mesh))):
        write_text(tmp_path / "deck.inp", shown)
        found.append(solver.solve(tmp_path / "deck.inp", tmp_path).displacement)
    assert np.abs(found[0][0]).max() > 0.1
    assert np.abs(found[0] - found[1]).max() < 5e-7


@pytest.mark.parametrize(
    "values",
    [
        {"base_slip.share": 0.5},
        {"indenter_slip.share": 0.5},
        {"tilt_in_space.slope_x": 0.02, "tilt_in_space.slope_y": -0.03, "sideways_in_space.moved_y": 0.1},
        {"indenter_probe_in_space.slips": 0.5, "indenter_probe_in_space.moved_y": 0.1},
    ],
    ids=["base", "indenter", "tilt", "probe"],
)
def test_calculix_agrees(values, tmp_path, needs_ccx):
    mesh = brick((WIDTH, WIDTH, 6.0), (2, 2, 1), element="C3D20", layers=LAYERS)
    ours, theirs = (
        solve(values, tmp_path, solver, study("displacement", 0.3), mesh) for solver in ("builtin", "calculix")
    )
    assert np.abs(ours - theirs).max() < 5e-6


def test_what_a_brick_may_have():
    measured = study()
    measured = replace(measured, steps=tuple(replace(step, points=Path("points.csv")) for step in measured.steps))
    brick_has = {name for name, effect in EFFECTS.items() if not unmet(effect, measured, MESH, True)}
    assert {"base_slip", "base_probe", "soft_bed", "debonding", "body_gradient", "interface", "skin"} <= brick_has
    assert {name for name, effect in EFFECTS.items() if "space" in effect.needs} <= brick_has
    assert not brick_has & {"outline", "base_friction", "inclusion", "misregistration", "tilt", "sideways"}
