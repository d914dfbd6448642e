"""Cook's membrane of a nearly incompressible solid: linear tetrahedra lock, and with averaged volumes do not."""

import numpy as np
import pytest
from solving import parts_of, solve

from fingerfit.material.neo_hooke import NeoHooke
from fingerfit.meshing import brick, layered_block

MATERIAL = NeoHooke(0.4, (2 / 400.0,))  # nu = 0.499


def tip(element, cells, depth=2.0):
    """Vertical displacement in mm of the upper corner of a tapered panel held at the left and sheared at the right.

    Plane strain: both faces are held in z. 48 mm long, 44 mm high on the left and 16 mm on the right.
    """
    mesh = brick((1.0, 1.0, depth), (cells, cells, 1), element=element)
    x, y, z = mesh.points.T
    points = np.column_stack([48 * x, 44 * x + y * (44 - 28 * x), z])
    body, terms = parts_of(element, points, mesh.blocks[0].nodes, MATERIAL)
    number = np.arange(points.size).reshape(points.shape)
    fixed = np.unique(np.concatenate([number[x == 0].ravel(), number[:, 2]]))
    force = np.zeros(points.size)
    right = np.flatnonzero(x == 1)
    force[number[right, 1]] = shares(mesh, right) * 0.1 * 16 * depth
    u = solve(body, terms, points.size, fixed, force).state.u.reshape(-1, 3)
    return u[(x == 1) & (y == 1), 1].mean()


def shares(mesh, nodes):
    """Share of each node in a uniform traction on its side, by the areas around it (linear elements)."""
    y, z = mesh.points[nodes, 1], mesh.points[nodes, 2]
    step = np.unique(y)[1]
    width = np.where((y == 0) | (y == 1), step / 2, step)
    weight = width * np.where((z == z.min()) | (z == z.max()), 1.0, 2.0)
    return weight / weight.sum()


def expanded(element, cells):
    """Radial force in N on the inner side of a tube, expanded from 1 to 1.3 mm and held along its axis."""
    mesh = layered_block(0.5, [("a", 0.25)], cells, cells // 2, element, origin=(1.0, 0.0))
    body, terms = parts_of(element, mesh.points, mesh.blocks[0].nodes, NeoHooke(0.5, (2e-4,)))
    number = np.arange(mesh.points.size).reshape(-1, 2)
    inside = np.abs(mesh.points[:, 0] - 1) < 1e-9
    given = np.zeros(mesh.points.size)
    given[number[inside, 0]] = 0.3
    fixed = np.unique(np.concatenate([number[:, 1], number[inside, 0]]))
    newton = solve(body, terms, mesh.points.size, fixed, given=given, steps=2)
    return newton.state.internal.reshape(-1, 2)[inside, 0].sum()


@pytest.mark.parametrize("element, close", [("CAX3H", 5e-4), ("CAX6H", 5e-4), ("CAX6", 5e-4), ("CAX3", None)])
def test_a_tube_that_hardly_changes_its_volume(element, close):
    """Against the closed form of an incompressible one. Found: CAX3 10 % too stiff, CAX3H and CAX6H within 0.02 %."""
    a, b = 1.3, np.sqrt(1.5**2 + 1.3**2 - 1)
    r = np.linspace(a, b, 20001)
    stretch = r / np.sqrt(r**2 - a**2 + 1)
    exact = np.trapezoid((stretch**2 - stretch**-2) / r, r) * 2 * np.pi * a * 0.25
    found = expanded(element, 8)
    if close is None:
        assert found > 1.05 * exact
    else:
        assert found == pytest.approx(exact, rel=close)


def test_six_node_hybrids_answer_as_their_siblings():
    """A linear pressure over three points is the pressure at them."""
    assert expanded("CAX6H", 4) == pytest.approx(expanded("CAX6", 4), rel=1e-9)


def test_cooks_membrane():
    """Found: 10.07 (converged), 3.66 and 4.15 (C3D4, 8 and 16 cells), 7.67 and 9.23 (C3D4H).

    With nu = 0.3 C3D4 has 83 and 95 % of the converged value: what C3D4H lacks is bending, not volume.
    """
    fine = tip("C3D8", 24)
    assert tip("C3D4", 16) < 0.45 * fine  # locks
    coarse, averaged = tip("C3D4H", 8), tip("C3D4H", 16)
    assert 0.9 * fine < averaged < fine
    assert fine - averaged < 0.4 * (fine - coarse)
