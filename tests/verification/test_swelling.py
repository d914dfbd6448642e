"""Swelling, F = F_e s: closed forms, tangents by finite differences, and CalculiX where both must agree."""

import re

import numpy as np
import pytest
from scipy.optimize import brentq
from solving import MATERIALS, solve_deck
from test_materials import single

from fingerfit.core.errors import InputError
from fingerfit.deck.reader import read_deck
from fingerfit.fem.volume import AveragedVolume
from fingerfit.material.prony import Prony
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.report.fields import fields
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.contract import CONVERGED
from fingerfit.testing.block import DEPTH, MATERIAL, SIZE, write_block

SOLVER = BuiltinSolver()


def swelling_block(folder, element, stretches, glued=False, pressed=(), rows="ALL, {}", averaged=True):
    """A block that swells by a stretch less 1 in each step; without `pressed`, displacements in mm, its upper side is free."""
    deck = write_block(folder, "displacement", list(pressed) or [1.0] * len(stretches), element, glued, cells=2)
    text = deck.read_text(encoding="utf-8").replace("*SOLID", "*EXPANSION, ZERO=0.\n1.\n*SOLID", 1)
    text = text.replace("*STEP", "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 20.\n*STEP", 1)
    given = iter(f"*TEMPERATURE\n{rows.format(20 + e)}\n*NODE PRINT, NSET=ALL" for e in stretches)
    text = re.sub(r"\*NODE PRINT, NSET=ALL", lambda _: next(given), text)
    if element.startswith("CAX"):
        text = text.replace("MIDDLE, 1, 1", "")
    if not pressed:
        text = re.sub(r"\*BOUNDARY\nINDENTER.*\n", "", text)
    deck.write_text(text, encoding="utf-8")
    return deck


@pytest.mark.parametrize("element", ["C3D8", "C3D8H", "C3D4H", "C3D10", "C3D20R", "C3D20H", "CAX8", "CAX4", "CAX3H"])
@pytest.mark.parametrize("swells", [0.2, -0.1])
def test_what_is_free_swells_without_stress(element, swells, tmp_path):
    """Every place moves by the same share of its distance from the corner that is held; nothing pushes back."""
    outcome = SOLVER.solve(swelling_block(tmp_path, element, [swells / 2, swells]), tmp_path)
    assert outcome.status == CONVERGED
    points = read_deck(tmp_path / "deck.inp").mesh.points
    held = points[np.abs(outcome.displacement[-1]).sum(axis=1).argmin()]
    for step, stretch in enumerate((swells / 2, swells)):
        assert outcome.displacement[step] == pytest.approx(stretch * (points - held), abs=1e-6 * SIZE)
        # equilibrium is found to 1e-8 of the force that would keep it from swelling, 1e3 N at most
        assert outcome.reaction[step] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("element", ["C3D8", "C3D4H", "C3D20H"])
def test_what_is_free_is_exported_without_stress(element, tmp_path):
    deck = swelling_block(tmp_path, element, [0.2])
    moved, mesh = SOLVER.solve(deck, tmp_path).displacement[-1], read_deck(deck).mesh
    held = MATERIAL.derivatives(np.full(3, 1.2))[0][0]
    # found to 1e-8 of what would keep it from swelling
    assert fields(mesh, deck, moved, 0).stress == pytest.approx(0.0, abs=1e-6 * held)


@pytest.mark.parametrize("element", ["CPE8H", "CPE4", "CPE3H", "CPE6", "CPS8"])
def test_in_the_plane_it_swells_as_the_third_direction_lets_it(element, tmp_path):
    """Plane strain: no stress in the plane, the stretch 1 / s out of it; plane stress: freely in all directions."""
    s = 1.1
    outcome = SOLVER.solve(swelling_block(tmp_path, element, [s - 1]), tmp_path)
    if element == "CPS8":
        wide = s
    else:
        wide = s * brentq(lambda x: MATERIAL.derivatives(np.array([x, x, 1 / s]))[0][0], 0.5, 2.0, xtol=1e-14)
    assert np.ptp(outcome.displacement[-1], axis=0) == pytest.approx([(wide - 1) * SIZE] * 2, rel=1e-6)


@pytest.mark.parametrize("element", ["CPE8H", "CPE4", "C3D8", "C3D4H", "C3D20R"])
def test_what_is_held_on_all_sides_pushes(element, tmp_path):
    """F = 1, so that F_e = 1 / s: the force is that of a stress of the energy's derivative by its own stretch over s."""
    s, dim = 1.05, ELEMENTS[element].dim
    deck = swelling_block(tmp_path, element, [s - 1], True, [1e-9])
    text = deck.read_text(encoding="utf-8")
    deck.write_text(text.replace("*EQUATION", f"*BOUNDARY\nALL, 1, {dim - 1}\n*EQUATION", 1))
    outcome = SOLVER.solve(deck, tmp_path)
    first, _ = MATERIAL.derivatives(np.full(3, 1 / s))
    area = SIZE * (SIZE if dim == 3 else DEPTH)
    assert outcome.reaction[-1, -1] == pytest.approx(first[0] * area, rel=1e-6)
    assert first[0] < 0


@pytest.mark.parametrize("relaxing", [False, True], ids=["elastic", "relaxing"])
@pytest.mark.parametrize("element", ["C3D8", "C3D8full", "C3D4H"])
@pytest.mark.parametrize("name", MATERIALS)
def test_forces_and_tangents_of_what_swells(name, element, relaxing, rng):
    """Central differences, errors as of `test_materials`; each point swells by another stretch."""
    material, h = MATERIALS[name], 1e-6
    if relaxing:
        material = type(material)(**{**vars(material), "prony": Prony((0.3, 0.2), (1.0, 10.0))})
    body, terms = made(material, element)
    points = len(body.weight.ravel())
    size = body.dofs.max() + 1
    body.swell(1 + 0.2 * rng.uniform(-1, 1, points))
    for term in terms:
        term.swell(1 + 0.2 * rng.uniform(-1, 1, len(body.connectivity)))
    if relaxing:
        body.begin(0.5)
        body.commit(0.05 * rng.normal(size=size), 0.5)
        body.begin(0.7)
    u = 0.08 * rng.normal(size=size)

    def total(at):
        force = np.bincount(body.dofs.ravel(), body.forces(at)[0].ravel(), size)
        return force + sum((term.forces(at).force for term in terms), np.zeros(size))

    stiffness = np.zeros((size, size))
    for dofs, block in zip(body.dofs, body.forces(u)[1], strict=True):
        stiffness[np.ix_(dofs, dofs)] += block
    for term in terms:
        found = term.forces(u)
        np.add.at(stiffness, (found.rows, found.columns), found.values)
    for dof in range(0, size, 5):
        step = np.eye(size)[dof] * h
        parts = (body, *terms)
        slope = sum(part.energy(u + step) - part.energy(u - step) for part in parts) / (2 * h)
        assert total(u)[dof] == pytest.approx(slope, abs=2e-9)
        assert stiffness[:, dof] == pytest.approx((total(u + step) - total(u - step)) / (2 * h), abs=2e-7)


def made(material, element):
    from solving import parts_of

    if element == "C3D8":
        return single(material)[0], []
    if element == "C3D8full":
        corners = single(material)[1]
        from fingerfit.fem.assembly import Body
        from fingerfit.material.spread import spread

        return Body("C3D8", corners, np.arange(8)[None], spread([material], [8]), np.ones(1), averaged=False), []
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    body, terms = parts_of("C3D4H", corners, np.array([[0, 1, 2, 3], [1, 2, 3, 4]]), material)
    assert isinstance(terms[0], AveragedVolume)
    return body, terms


@pytest.mark.parametrize("element", ["CPE4", "CPE8", "C3D10", "C3D20R"])
def test_calculix_agrees(element, tmp_path, needs_ccx):
    """A glued block that swells by e, without load and pressed by 1 %.

    CalculiX subtracts the strain of swelling, ((1 + e)^2 - 1) / 2, from Green's strain E; here C is divided by (1 + e)^2, so
    that both differ by a share of 2 e of E, and places by 2 e E L: E is e where swelling alone strains the body, and
    some times 1 % (here twice) where it is pressed.
    """
    e = 1e-3
    for pressed, strain in (((), e), ((0.01 * SIZE,), 0.02)):
        deck = swelling_block(tmp_path, element, [e], True, pressed)
        ours, theirs = BuiltinSolver(averaged=False).solve(deck, tmp_path), CalculixSolver().solve(deck, tmp_path)
        assert ours.status == theirs.status == CONVERGED
        assert np.abs(ours.displacement - theirs.displacement).max() < 2 * e * strain * SIZE
        if not pressed:
            assert np.abs(ours.displacement).max() > 0.5 * e * SIZE
            continue
        without = swelling_block(tmp_path, element, [0.0], True, pressed)
        plain = BuiltinSolver(averaged=False).solve(without, tmp_path).reaction[-1, -1]
        change = [each.reaction[-1, -1] - plain for each in (ours, theirs)]
        assert change[0] == pytest.approx(change[1], rel=2 * strain)
        assert change[0] < 0.05 * plain


@pytest.mark.parametrize("element", ["CPE8", "C3D20R"])
def test_temperatures_go_from_corners_to_points_as_calculix_has_them(element, tmp_path, needs_ccx):
    """A field that is linear along x: quadratic elements take it as it is. The margin is that of `test_calculix_agrees`."""
    deck = swelling_block(tmp_path, element, [0.0], True)
    points = read_deck(deck).mesh.points
    rows = "\n".join(f"{n}, {20 + 1e-3 * x / SIZE:.12g}" for n, (x, *_) in enumerate(points.tolist(), 1))
    deck = swelling_block(tmp_path, element, [0.0], True, rows=rows)
    ours, theirs = BuiltinSolver(averaged=False).solve(deck, tmp_path), CalculixSolver().solve(deck, tmp_path)
    assert np.abs(ours.displacement).max() > 2e-3
    assert np.abs(ours.displacement - theirs.displacement).max() < 2 * 1e-3**2 * SIZE


def test_amplitudes_and_steps_are_read_and_written(tmp_path):
    """Up at once, half of it back: OP=NEW goes back to the initial temperature, an amplitude to what it says."""
    deck = swelling_block(tmp_path, "CPE8", [0.1, 0.05, 0.02, 0.03])
    text = deck.read_text(encoding="utf-8")
    text = text.replace("*STEP", "*AMPLITUDE, NAME=HALF\n0., 1., 1., 0.5\n*STEP", 1)
    text = text.replace("*TEMPERATURE\nALL, 20.02\n", "*TEMPERATURE, OP=NEW\n")
    deck.write_text(text.replace("*TEMPERATURE\nALL, 20.03\n", "*TEMPERATURE, AMPLITUDE=HALF\nALL, 40.1\n"))
    _, steps = solve_deck(deck)
    wide = [np.ptp(step.displacement[:, 0]) / SIZE for step in steps]
    assert wide[2] == pytest.approx(0.0, abs=1e-7)
    assert wide[3] == pytest.approx(wide[1], rel=1e-5)
    assert wide[0] > 1.9 * wide[1] > 0.1


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("*EXPANSION, ZERO=0.", "*EXPANSION, TYPE=ORTHO", r"\*EXPANSION: found ORTHO; expected ISO"),
        ("*TEMPERATURE\nALL, 20.1", "*TEMPERATURE\nALL, warm", r"\*TEMPERATURE: found warm; expected a number"),
        (
            "*TEMPERATURE\nALL, 20.1",
            "*TEMPERATURE\nALL",
            r"\*TEMPERATURE: found \['ALL'\]; expected a node and a number",
        ),
        ("*TEMPERATURE\nALL, 20.1", "*TEMPERATURE\nALL, 18.", "shrinks to nothing"),
        (", NLGEOM", "", "NLGEOM: materials with .EXPANSION need it|only .ELASTIC is for small strain"),
    ],
)
def test_what_is_wrong_is_said(old, new, told, tmp_path):
    deck = swelling_block(tmp_path, "CPE8", [0.1])
    text = deck.read_text(encoding="utf-8")
    assert old in text
    deck.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=told) as caught:
        SOLVER.solve(deck, tmp_path)
    assert "\n" not in str(caught.value)
