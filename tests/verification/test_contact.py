"""Contact with rigid surfaces: consistency, patch test, Hertz, friction, glued, force and displacement control."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from solving import solve_deck

from fingerfit.core.errors import InputError
from fingerfit.deck.content import Surface
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.reader import read_deck
from fingerfit.deck.write import format_deck
from fingerfit.fem.contact import Interaction, RigidContact
from fingerfit.fem.surfaces import Plane, Round
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.faces import faces_of
from fingerfit.mesh.mesh import Mesh
from fingerfit.solvers.contacts import rigid_surface

AXIS = np.array([0.6, 0.0, 0.8])
SURFACES = {
    "plane": Plane(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.6, 0.8])),
    "sphere": Round(np.array([0.1, 0.2, -1.0]), 1.5),
    "inside a sphere": Round(np.array([0.1, 0.2, 0.3]), 1.0, -1),
    "cylinder": Round(np.array([0.1, 0.2, -1.0]), 1.5, 1, AXIS),
}


@pytest.mark.parametrize("name", SURFACES)
def test_normals_and_curvatures_are_derivatives(name, rng):
    surface, x, h = SURFACES[name], rng.normal(size=(5, 3)), 1e-6
    _, normal, slope = surface.gap(x)
    for axis in range(3):
        step = np.eye(3)[axis] * h
        assert normal[:, axis] == pytest.approx(
            (surface.gap(x + step)[0] - surface.gap(x - step)[0]) / (2 * h), abs=1e-8
        )
        change = (surface.gap(x + step)[1] - surface.gap(x - step)[1]) / (2 * h)
        assert slope[:, :, axis] == pytest.approx(change, abs=1e-7)


@pytest.mark.parametrize("law", [Interaction(5.0), Interaction(5.0, glued=True, stick=3.0)], ids=["free", "glued"])
@pytest.mark.parametrize("name", SURFACES)
def test_forces_are_derivatives_of_the_energy(name, law, rng):
    # three points within the round surfaces and three far out: some press in any case
    near, far = np.array([0.1, 0.2, -0.4]) + 0.3 * rng.normal(size=(3, 3)), 2.0 * rng.normal(size=(3, 3))
    points = np.vstack([near, far, [[0.0, 0.0, 0.0]]])
    sampling = csr_matrix((np.ones(6), (np.arange(6), np.arange(6))), shape=(6, 7))
    contact = RigidContact(sampling, np.full(6, 0.7), points, SURFACES[name], 6, law)
    u, h = 0.1 * rng.normal(size=21), 1e-6
    if law.glued:
        contact.commit(u, 0.0)
        u = u + 0.1 * rng.normal(size=21)
    found = contact.forces(u)
    stiffness = np.zeros((21, 21))
    np.add.at(stiffness, (found.rows, found.columns), found.values)
    places = set(zip(*(part.tolist() for part in contact.couples), strict=True))
    assert set(zip(found.rows.tolist(), found.columns.tolist(), strict=True)) <= places
    assert np.abs(found.force).max() > 0.1
    assert found.force.reshape(-1, 3).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-13)
    for dof in range(21):
        step = np.eye(21)[dof] * h
        slope = (contact.energy(u + step) - contact.energy(u - step)) / (2 * h)
        assert found.force[dof] == pytest.approx(slope, abs=1e-7)
        change = (contact.forces(u + step).force - contact.forces(u - step).force) / (2 * h)
        assert stiffness[:, dof] == pytest.approx(change, abs=1e-6)


@pytest.mark.parametrize("friction", [0.1, 10.0], ids=["slips", "sticks"])
def test_tangent_of_friction(friction, rng):
    points = np.vstack([rng.normal(size=(6, 3)), [[0.0, 0.0, 0.0]]])
    sampling = csr_matrix((np.ones(6), (np.arange(6), np.arange(6))), shape=(6, 7))
    law = Interaction(5.0, friction, 50.0 if friction < 1 else 0.5)
    contact = RigidContact(sampling, np.full(6, 0.7), points, SURFACES["plane"], 6, law)
    first = 0.05 * rng.normal(size=21)
    u, h = first + 0.05 * rng.normal(size=21), 1e-7
    # three points are just off the surface first, and meet it then
    for values, gap in ((first, 0.03), (u, -0.05)):
        off = (gap - contact._local(values).gap[:3, None]) * SURFACES["plane"].normal
        values[:9] += off.ravel()
    contact.commit(first, 0.0)
    found = contact.forces(u)
    stiffness = np.zeros((21, 21))
    np.add.at(stiffness, (found.rows, found.columns), found.values)
    for dof in range(21):
        step = np.eye(21)[dof] * h
        change = (contact.forces(u + step).force - contact.forces(u - step).force) / (2 * h)
        assert stiffness[:, dof] == pytest.approx(change, abs=2e-5)
    assert ((contact._open > 0.02) & contact._local(u).active).sum() == 3


BLOCK = """*INCLUDE, INPUT=mesh.inp
*NODE, NSET=REF
9000, {x}, {y}{z}
*SURFACE, NAME=SLAVE
{slave}
*SURFACE, NAME=RIGID, TYPE={kind}
{profile}
*RIGID BODY, ANALYTICAL SURFACE=RIGID, REF NODE=9000
*SURFACE INTERACTION, NAME=I
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
{stiffness}
{friction}
*CONTACT PAIR, INTERACTION=I, TYPE={pair}
SLAVE, RIGID
*SOLID SECTION, ELSET=ALL_ELEMENTS, MATERIAL=M
*MATERIAL, NAME=M
{material}
*BOUNDARY
{held}
{steps}
"""


@pytest.fixture
def run(tmp_path):
    def run(mesh, **values):
        everything = {**mesh.element_sets, "ALL_ELEMENTS": np.arange(mesh.element_count)}
        full = Mesh(mesh.points, mesh.blocks, mesh.node_sets, everything)
        (tmp_path / "mesh.inp").write_text(format_mesh(full))
        given = {"x": 0.0, "y": 0.0, "z": "", "friction": "", "stiffness": 1000.0, "kind": "SEGMENTS"}
        given |= {"pair": "NODE TO SURFACE", "slave": "ALL_ELEMENTS", "material": "*ELASTIC\n10., 0.3"}
        (tmp_path / "deck.inp").write_text(BLOCK.format(**{**given, **values}))
        deck, steps = solve_deck(tmp_path / "deck.inp")
        assert steps[-1].arrived
        return deck, steps

    return run


def upper_faces(mesh):
    """Data lines of the faces at the upper end of the last axis."""
    top = np.abs(mesh.points[:, -1] - mesh.points[:, -1].max()) < 1e-9
    block = mesh.blocks[0]
    return "\n".join(
        f"{number}, S{face}"
        for number, nodes in enumerate(block.nodes, 1)
        for face, local in enumerate(faces_of(block.element), 1)
        if top[nodes[list(local)]].all()
    )


def step(*lines, increment="0.25, 1."):
    return "\n".join(["*STEP, NLGEOM", "*STATIC", increment, *lines, "*END STEP"])


@pytest.mark.parametrize("pair", ["NODE TO SURFACE", "SURFACE TO SURFACE"])
@pytest.mark.parametrize("element", ["CPE3", "CPE4", "CPE6", "CPE8"])
def test_patch_of_contact_in_the_plane(run, element, pair):
    """A block on a flat punch: uniform pressure, its sides straight."""
    mesh = layered_block(2.0, [("a", 1.0)], 3, 2, element)
    _, steps = run(
        mesh,
        x=1.0,
        y=1.0,
        slave=upper_faces(mesh),
        profile="START, -5., 1.\nLINE, 5., 1.",
        pair=pair,
        held="BOTTOM, 2\nMIDDLE, 1\n9000, 1, 2",
        steps=step("*BOUNDARY", "9000, 2, 2, -0.1"),
    )
    u = steps[-1].displacement
    top = np.abs(mesh.points[:, 1] - 1) < 1e-9
    assert np.ptp(u[:-1][top, 1]) < 1e-9
    force = -steps[-1].internal[-1, 1]
    # the pressure is that of overclosure on the area before it was deformed; Newton's method converges to 1e-10
    assert force / 2.0 == pytest.approx(1000 * (0.1 + u[:-1][top, 1].mean()), rel=1e-9)
    bottom = steps[-1].internal[:-1][mesh.points[:, 1] == 0, 1].sum()
    assert bottom == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize(
    "element, pair",
    [
        *((element, "NODE TO SURFACE") for element in ("C3D4", "C3D8", "C3D10")),
        # the lumped areas of faces with 8 nodes do not pass at the nodes
        *((element, "SURFACE TO SURFACE") for element in ("C3D4", "C3D8", "C3D10", "C3D20")),
    ],
)
def test_patch_of_contact_in_space(run, element, pair):
    mesh = brick((2.0, 1.5, 1.0), (2, 2, 1), element=element)
    _, steps = run(
        mesh,
        x=1.0,
        y=1.0,
        z=", 1.",
        slave=upper_faces(mesh),
        kind="REVOLUTION",
        profile="1., 1., 1., 1., 1., 2.\nSTART, 0., 0.\nLINE, 9., 0.",
        pair=pair,
        held="BOTTOM, 3\nX0, 1\nY0, 2\n9000, 1, 3",
        steps=step("*BOUNDARY", "9000, 3, 3, -0.1"),
    )
    u = steps[-1].displacement[:-1]
    assert np.ptp(u[mesh.points[:, 2] == 1, 2]) < 1e-9
    assert np.ptp(u[mesh.points[:, 0] == 2, 0]) < 1e-9


def out(share, size, power=None):
    """Places from 0 to `size`, closer to each other near 0: by a power, or evenly at first."""
    return size * (share**power if power else np.sinh(6 * share) / np.sinh(6))


def hertz_mesh(size, cells, element, power=None):
    """Half of a block below y = 0 in the plane or in axisymmetry, graded to the contact at the origin."""
    mesh = layered_block(1.0, [("a", 1.0)], cells, cells, element)
    x, y = mesh.points.T
    points = np.column_stack([out(x, size, power), -out(1 - y, size, power)])
    for nodes in mesh.blocks[0].nodes:
        # mid-side nodes in the middle of their sides
        for k in range(len(nodes) - 4):
            points[nodes[4 + k]] = points[nodes[[k, (k + 1) % 4]]].mean(axis=0)
    return Mesh(points, mesh.blocks, mesh.node_sets, mesh.element_sets)


def spread_of_pressure(away, depth, around):
    """Mean squared distance of the pressure from the middle, mm^2, by trapezoids over nodes on a line or radius.

    Hertz's pressure p0 sqrt(1 - x^2 / b^2) on a strip has b^2 / 4, on a disc (`around`) 2 b^2 / 5: so b is found
    much finer than the nodes lie.
    """
    order = np.argsort(away)
    x, pressure = away[order], np.maximum(depth[order], 0.0) * (away[order] if around else 1.0)
    return np.trapezoid(pressure * x**2, x) / np.trapezoid(pressure, x)


@pytest.mark.parametrize("control", ["displacement", "force"])
def test_hertz(run, control):
    """Rigid sphere on an elastic half space: F = 4/3 E / (1 - nu^2) sqrt(R) d^1.5; the block is finite."""
    radius, depth, young, nu = 10.0, 0.02, 100.0, 0.3
    mesh = hertz_mesh(20.0, 14, "CAX8", power=2.5)
    top = np.flatnonzero(np.abs(mesh.points[:, 1]) < 1e-12)
    force = 4 / 3 * young / (1 - nu**2) * radius**0.5 * depth**1.5
    load = "*BOUNDARY\n9000, 2, 2, -0.02" if control == "displacement" else f"*CLOAD\n9000, 2, {-force}"
    _, steps = run(
        mesh,
        y=radius,
        slave="ALL_ELEMENTS",
        profile=f"START, 0., 0.\nCIRCL, {radius}, {radius}, 0., {radius}",
        pair="SURFACE TO SURFACE",
        stiffness=1e5,
        material=f"*ELASTIC\n{young}, {nu}",
        held="BOTTOM, 1, 2\n9000, 1" + ("\n9000, 2" if control == "displacement" else ""),
        steps=step(load),
    )
    last = steps[-1]
    moved = -last.displacement[-1, 1]
    if control == "displacement":
        # 14 elements: 1.9 % too stiff, 28: 0.3 %; to the power 2/3 less in depth
        assert -last.internal[-1, 1] == pytest.approx(force, rel=0.025)
    else:
        assert moved == pytest.approx(depth, rel=2 / 3 * 0.025)
    # radius of contact: sqrt(R d) lies between the last node that touches and the next one
    x = mesh.points[top] + last.displacement[top]
    inside = np.hypot(x[:, 0], x[:, 1] - radius + moved) < radius + 1e-6
    assert mesh.points[top][inside, 0].max() < np.sqrt(radius * moved) < mesh.points[top][~inside, 0].min()


@pytest.mark.parametrize("control", ["displacement", "force"])
def test_radius_of_hertz_contact(run, control):
    """On a finer mesh: a^3 = 3 F R (1 - nu^2) / (4 E), found from where the pressure is, at its nodes."""
    radius, young, nu, force = 10.0, 100.0, 0.3, 1.31
    mesh = hertz_mesh(40.0, 32, "CAX4")
    _, steps = run(
        mesh,
        y=radius,
        slave=upper_faces(mesh),
        profile=f"START, 0., 0.\nCIRCL, {radius}, {radius}, 0., {radius}",
        stiffness=1e5,
        material=f"*ELASTIC\n{young}, {nu}",
        held="BOTTOM, 1, 2\n9000, 1" + ("\n9000, 2" if control == "displacement" else ""),
        steps=step("*BOUNDARY\n9000, 2, 2, -0.02" if control == "displacement" else f"*CLOAD\n9000, 2, {-force}"),
    )
    last = steps[-1]
    moved = -last.displacement[-1, 1]
    pushed = -last.internal[-1, 1] if control == "displacement" else force
    # 16 elements: 5.1 % too stiff, 32: 2.3 %, 48: 1.7 %, 40 over twice the size 1.2 %
    assert pushed == pytest.approx(4 / 3 * young / (1 - nu**2) * radius**0.5 * moved**1.5, rel=0.03)
    top = mesh.points[:, 1] == 0
    x = mesh.points[top] + last.displacement[:-1][top]
    inside = radius - np.hypot(x[:, 0], x[:, 1] - radius + moved)
    found = np.sqrt(5 / 2 * spread_of_pressure(x[:, 0], inside, True))
    # 16 elements: 2.8 %, 32: 0.01 %, 48: -0.6 %, by where nodes happen to lie at the edge
    assert found == pytest.approx((3 * pushed * radius * (1 - nu**2) / (4 * young)) ** (1 / 3), rel=0.01)


@pytest.mark.parametrize("stiffness", [1e3, 1e5])
def test_a_fine_mesh_is_pushed_by_a_force(run, stiffness):
    """From rest: one Gauss point near the axis, of hardly any area, gives way by much more than there is to go."""
    radius, force = 10.0, 1.31
    mesh = hertz_mesh(20.0, 24, "CAX4")
    _, steps = run(
        mesh,
        y=radius,
        slave=upper_faces(mesh),
        profile=f"START, 0., 0.\nCIRCL, {radius}, {radius}, 0., {radius}",
        pair="SURFACE TO SURFACE",
        stiffness=stiffness,
        material="*ELASTIC\n100., 0.3",
        held="BOTTOM, 1, 2\n9000, 1",
        steps=step(f"*CLOAD\n9000, 2, {-force}"),
    )
    assert steps[-1].internal[:-1][mesh.points[:, 1] == mesh.points[:, 1].min(), 1].sum() == pytest.approx(force)
    hertz = (force * 0.91 / (4 / 3 * 100 * radius**0.5)) ** (2 / 3)
    # the mesh is stiffer, by 2.3 % (36 elements: 2.1 %); the layer of springs gives way by the mean of pressure squared
    # over stiffness and mean pressure, 3/4 of the largest pressure over it, or less as pressure spreads
    wide = (3 * force * radius * 0.91 / 400) ** (1 / 3)
    springs = 0.75 * 1.5 * force / (np.pi * wide**2) / stiffness
    assert 0.97 * hertz < -steps[-1].displacement[-1, 1] < hertz + springs


def hertz_block(size, cells, element, layers):
    """A quarter of a block below z = 0, graded to the contact at the origin; with one layer along y, a slice."""
    mesh = brick((1.0, 1.0, 1.0), (cells, layers, cells), element=element)
    x, y, z = mesh.points.T
    along = y if layers == 1 else out(y, size)
    sets = {**mesh.node_sets, "EVERY": np.arange(len(mesh.points))}
    return Mesh(np.column_stack([out(x, size), along, -out(1 - z, size)]), mesh.blocks, sets, mesh.element_sets)


@pytest.mark.slow
@pytest.mark.parametrize(
    "element, cells, pair",
    [("C3D8", 14, "NODE"), ("C3D20R", 8, "SURFACE")],
)
def test_hertz_in_space(run, element, cells, pair):
    """A quarter of a rigid sphere on a block: force, and with nodes in contact the radius and the largest pressure.

    Found with 10 and 14 linear elements a side: force 2.2 and 4.6 % too large, radius -15 and 4.3 %, pressure 4.4 and 1.3 %; with
    6 and 8 quadratic ones force 2.6 and -1.3 %.
    """
    radius, depth, young, nu, stiffness = 10.0, 0.08, 100.0, 0.3, 1e5
    mesh = hertz_block(40.0, cells, element, cells)
    _, steps = run(
        mesh,
        z=f", {radius}",
        kind="REVOLUTION",
        profile=f"0., 0., {radius}, 0., 0., {radius + 1}\nSTART, 0., {-radius}\nCIRCL, {radius}, 0., 0., 0.",
        slave=upper_faces(mesh),
        pair=f"{pair} TO SURFACE",
        stiffness=stiffness,
        material=f"*ELASTIC\n{young}, {nu}",
        held="BOTTOM, 1, 3\nX0, 1\nY0, 2\n9000, 1, 2",
        steps=step("*BOUNDARY", f"9000, 3, 3, {-depth}", increment="1., 1."),
    )
    last = steps[-1]
    force = -4 * last.internal[-1, 2]
    hertz = 4 / 3 * young / (1 - nu**2) * radius**0.5 * depth**1.5
    assert force == pytest.approx(hertz, rel=0.02 if element == "C3D20R" else 0.06)
    if pair == "SURFACE":
        # at nodes between Gauss points the overclosure goes up and down
        return
    wide = (3 * force * radius * (1 - nu**2) / (4 * young)) ** (1 / 3)
    for axis in (0, 1):
        line = (mesh.points[:, 2] == 0) & (mesh.points[:, 1 - axis] == 0)
        x = mesh.points[line] + last.displacement[:-1][line]
        inside = radius - np.linalg.norm(x - [0, 0, radius - depth], axis=1)
        assert np.sqrt(5 / 2 * spread_of_pressure(x[:, axis], inside, True)) == pytest.approx(wide, rel=0.06)
        assert stiffness * inside[0] == pytest.approx(1.5 * force / (np.pi * wide**2), rel=0.025)


CYLINDER = "0., 0., {r}, 1., 0., {r}\n0., -1., {r}\n"
"""Of TYPE=CYLINDER: its origin, a point on its local x axis, one on its local z axis, along it."""


def test_hertz_of_a_long_cylinder(run):
    """Half width b = sqrt(4 F R (1 - nu^2) / (pi E)) and pressure 2 F / (pi b) in the middle, F the force per length."""
    radius, young, nu, stiffness = 10.0, 100.0, 0.3, 1e5
    mesh = hertz_block(20.0, 24, "C3D8", 1)
    common = {"slave": upper_faces(mesh), "stiffness": stiffness, "material": f"*ELASTIC\n{young}, {nu}"}
    _, steps = run(
        mesh,
        z=f", {radius}",
        kind="CYLINDER",
        profile=CYLINDER.format(r=radius) + f"START, 0., {-radius}\nCIRCL, {radius}, 0., 0., 0.",
        held="BOTTOM, 1, 3\nX0, 1\nEVERY, 2\n9000, 1, 2",
        steps=step("*BOUNDARY", "9000, 3, 3, -0.08"),
        **common,
    )
    last = steps[-1]
    force = -2 * last.internal[-1, 2]
    wide = np.sqrt(4 * force * radius * (1 - nu**2) / (np.pi * young))
    line = (mesh.points[:, 2] == 0) & (mesh.points[:, 1] == 0)
    x = mesh.points[line] + last.displacement[:-1][line]
    inside = radius - np.hypot(x[:, 0], x[:, 2] - radius + 0.08)
    # 12, 24 and 36 elements: half width 2.5, -0.02 and -0.6 % off, pressure -0.2, -0.4 and -0.4 %
    assert 2 * np.sqrt(spread_of_pressure(x[:, 0], inside, False)) == pytest.approx(wide, rel=0.01)
    assert stiffness * inside[0] == pytest.approx(2 * force / (np.pi * wide), rel=0.01)
    # and the same as a circle in the plane
    flat = hertz_mesh(20.0, 24, "CPE4")
    _, plane = run(
        flat,
        y=radius,
        profile=f"START, 0., 0.\nCIRCL, {radius}, {radius}, 0., {radius}",
        held="BOTTOM, 1, 2\n" + "".join(f"{n + 1}, 1\n" for n in np.flatnonzero(flat.points[:, 0] == 0)) + "9000, 1",
        steps=step("*BOUNDARY", "9000, 2, 2, -0.08"),
        **{**common, "slave": upper_faces(flat)},
    )
    assert last.internal[-1, 2] == pytest.approx(plane[-1].internal[-1, 1], rel=1e-6)


def test_a_line_along_a_cylinder_is_a_plane(run):
    """TYPE=CYLINDER with a LINE, inclined by its axes: pressed on flat, the pressure is uniform."""
    mesh = brick((2.0, 1.5, 1.0), (2, 2, 1))
    _, steps = run(
        mesh,
        z=", 1.",
        slave=upper_faces(mesh),
        kind="CYLINDER",
        # local x along (3, 4, 0) / 5, local z across it in the plane: the profile is a line along local x
        profile="1., 1., 1., 1.6, 1.8, 1.\n1.8, 0.4, 1.\nSTART, -9., 0.\nLINE, 9., 0.",
        held="BOTTOM, 3\nX0, 1\nY0, 2\n9000, 1, 2",
        steps=step("*BOUNDARY", "9000, 3, 3, -0.1"),
    )
    u = steps[-1].displacement[:-1]
    top = mesh.points[:, 2] == 1
    assert np.ptp(u[top, 2]) < 1e-9
    assert -steps[-1].internal[-1, 2] == pytest.approx(1000 * 3.0 * (0.1 + u[top, 2].mean()), rel=1e-6)


def by_both(run, element, friction, deep):
    """Steps in which a round tool is pressed by five equal ways into a block that sticks and slips, far from where it
    first touches, and those in which the forces of that are prescribed."""
    mesh = layered_block(10.0, [("a", 5.0)], 20, 10, element)

    def press(lines, held=""):
        return run(
            mesh,
            x=5.0,
            y=5.0,
            slave=upper_faces(mesh),
            profile="START, 2.5, 7.5\nCIRCL, 7.5, 7.5, 5., 7.5",
            pair="SURFACE TO SURFACE",
            stiffness=20.0,
            friction=f"*FRICTION\n{friction}, 20.",
            material="*HYPERELASTIC, OGDEN, N=1\n0.02, 1.4, 5.",
            held=f"BOTTOM, 1, 2\n9000, 1{held}",
            steps="\n".join(step(line, increment="1., 1.") for line in lines),
        )[1]

    moved = press([f"*BOUNDARY\n9000, 2, 2, {-deep * n}" for n in range(1, 6)], "\n9000, 2")
    pushed = press([f"*CLOAD\n9000, 2, {one.internal[-1, 1]}" for one in moved])
    assert [one.displacement[-1, 1] for one in pushed] == pytest.approx([-deep * n for n in range(1, 6)], abs=1e-6)
    return moved, pushed


def test_a_force_with_friction_takes_about_as_many_iterations_as_a_displacement(run):
    moved, pushed = by_both(run, "CPE8", 0.5, 0.2)
    # 85 against 34 when each increment after the first failure was short (decision 33)
    assert sum(one.iterations for one in pushed) < 1.5 * sum(one.iterations for one in moved)


def test_a_round_tool_deep_in_a_coarse_block_takes_few_iterations(run):
    """With friction, 1.5 of 5 mm: 87 and 106 before contact was met within an iteration (decision 33)."""
    assert max(sum(one.iterations for one in steps) for steps in by_both(run, "CPE4", 0.3, 0.3)) <= 40


@pytest.mark.parametrize("pull, slips", [(0.59, False), (0.61, True)], ids=["sticks", "slips"])
def test_a_block_sticks_and_slips_at_the_right_force(run, pull, slips):
    """Pressed on a plane by 2 N with mu = 0.3, pulled by just less and just more than 0.6 N.

    A weak spring holds the slipping block, so that it finds a place to stop.
    """
    mesh = layered_block(2.0, [("a", 1.0)], 4, 2, "CPE4")
    count = mesh.points[:, 1].max()
    assert count == 1.0
    nodes = np.flatnonzero(mesh.points[:, 1] == 1.0) + 1
    share = np.full(len(nodes), 1.0)
    share[[0, -1]] = 0.5
    share /= share.sum()
    springs = (
        "*ELEMENT, TYPE=SPRING1, ELSET=WEAK\n"
        + "".join(f"{7000 + n}, {n}\n" for n in nodes)
        + "*SPRING, ELSET=WEAK\n1\n1e-3\n"
    )
    press = [f"{n}, 2, {-2.0 * s}" for n, s in zip(nodes, share, strict=True)]
    pulled = [f"{n}, 1, {pull * s}" for n, s in zip(nodes, share, strict=True)]
    _, steps = run(
        mesh,
        profile="START, -5., 0.\nLINE, 5., 0.",
        friction="*FRICTION\n0.3, 1e4\n" + springs.rstrip(),
        stiffness=1e4,
        material="*ELASTIC\n1e5, 0.3",
        held="9000, 1, 2",
        steps=step("*CLOAD", *press) + "\n" + step("*CLOAD", *pulled),
    )
    moved = steps[-1].displacement[:-1, 0]
    tangential = -steps[-1].internal[-1, 0]
    if slips:
        # the springs carry what friction does not
        assert moved.mean() == pytest.approx((pull - 0.6) / (len(nodes) * 1e-3), rel=0.02)
        assert abs(tangential) == pytest.approx(0.6, rel=1e-3)
    else:
        assert np.abs(moved).max() < 1e-3
        assert abs(tangential) == pytest.approx(pull, rel=1e-2)


def test_a_glued_block_is_pulled(run):
    """Glued to the plane below: neither slips nor lifts off; free of friction it would fly away."""
    mesh = layered_block(2.0, [("a", 1.0)], 2, 1, "CPE4")
    _, steps = run(
        mesh,
        profile="START, -5., 0.\nLINE, 5., 0.",
        friction="*SURFACE BEHAVIOR, NO SEPARATION\n*FRICTION, ROUGH",
        held="9000, 1, 2",
        steps=step("*CLOAD", "TOP, 2, 0.05", "TOP, 1, 0.02"),
    )
    count = len(mesh.node_sets["TOP"])
    assert steps[-1].internal[-1] == pytest.approx([-0.02 * count, -0.05 * count], rel=1e-6)


def test_a_glued_sphere_pulls_back(run):
    """Pressed in and pulled out again beyond the start: the body hangs on the sphere."""
    mesh = brick((4.0, 4.0, 2.0), (6, 6, 3), element="C3D8")
    _, steps = run(
        mesh,
        z=", 5.0",
        kind="REVOLUTION",
        profile="0., 0., 5., 0., 0., 6.\nSTART, 0., -3.\nCIRCL, 3., 0., 0., 0.",
        stiffness=20.0,
        slave=upper_faces(mesh),
        friction="*SURFACE BEHAVIOR, NO SEPARATION\n*FRICTION, ROUGH",
        material="*HYPERELASTIC, NEO HOOKE\n0.5, 0.1",
        held="BOTTOM, 1, 3\nX0, 1\nY0, 2\n9000, 1, 2",
        steps=step("*BOUNDARY", "9000, 3, 3, -0.4") + "\n" + step("*BOUNDARY", "9000, 3, 3, 0.2"),
    )
    force = [s.internal[-1, 2] for s in steps]
    assert force[0] < -0.2
    assert force[1] > 0.2
    assert steps[1].displacement[:-1, 2].max() > 0.15


def test_a_sphere_pushed_by_a_force_finds_its_place_from_a_distance(run):
    """Force and displacement control agree, though nothing touches at first."""
    mesh = brick((4.0, 4.0, 2.0), (4, 4, 2), element="C3D8")
    common = {
        "x": 0.0,
        "y": 0.0,
        "z": ", 5.05",
        "kind": "REVOLUTION",
        "profile": "0., 0., 5.05, 0., 0., 6.\nSTART, 0., -3.\nCIRCL, 3., 0., 0., 0.",
        "material": "*HYPERELASTIC, NEO HOOKE\n0.5, 0.1",
    }
    held = "BOTTOM, 1, 3\nX0, 1\nY0, 2\n9000, 1, 2"
    _, moved = run(mesh, **common, held=held + "\n9000, 3", steps=step("*BOUNDARY", "9000, 3, 3, -0.6"))
    force = moved[-1].internal[-1, 2]
    _, pushed = run(mesh, **common, held=held, steps=step("*CLOAD", f"9000, 3, {force}"))
    assert force < -0.5
    assert pushed[-1].displacement[-1, 2] == pytest.approx(-0.6, rel=1e-6)
    assert pushed[-1].displacement == pytest.approx(moved[-1].displacement, abs=1e-6)


def test_what_contact_lacks_is_refused(run):
    mesh = layered_block(2.0, [("a", 1.0)], 2, 1, "CPE4")
    common = {"held": "BOTTOM, 1, 2\n9000, 1, 2", "steps": step()}
    with pytest.raises(InputError, match="another profile"):
        run(mesh, profile="START, -5., 1.", **common)
    with pytest.raises(InputError, match="SLAVE without faces or nodes"):
        run(mesh, profile="START, -5., 1.\nLINE, 5., 1.", slave="**", **common)
    broken = "*SURFACE INTERACTION, NAME=J\n*CONTACT PAIR, INTERACTION=J\nSLAVE, RIGID"
    with pytest.raises(InputError, match="no stiffness"):
        run(mesh, profile="START, -5., 1.\nLINE, 5., 1.", friction=broken, **common)


HARD = "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD"


@pytest.mark.parametrize("pair", ["NODE TO SURFACE", "SURFACE TO SURFACE"])
@pytest.mark.parametrize(
    "element, material, young",
    [
        ("CPE4", "*ELASTIC\n10., 0.3", 10.0),
        ("CPE6", "*ELASTIC\n10., 0.3", 10.0),
        ("C3D8", "*HYPERELASTIC, NEO HOOKE\n0.5, 0.5", 9 * 4 * 1 / (3 * 4 + 1)),
        ("C3D10", "*HYPERELASTIC, OGDEN, N=1\n1., 3., 0.5", 9 * 4 * 1 / (3 * 4 + 1)),
    ],
)
def test_hard_contact_takes_its_stiffness_from_the_body(run, element, material, young, pair):
    """A hundred times Young's modulus over the depth of the elements, here half a millimetre, a third of it in tetrahedra."""
    if element.startswith("CPE"):
        mesh, profile, kind, z = layered_block(2.0, [("a", 1.0)], 3, 2, element), "START, -5., 1.\nLINE, 5., 1.", "", ""
        depth, held = 0.5 if element == "CPE4" else 0.25, "BOTTOM, 2\nMIDDLE, 1\n9000, 1"
    else:
        mesh, z = brick((2.0, 1.5, 1.0), (2, 2, 2), element=element), ", 1."
        profile, kind = "1., 1., 1., 1., 1., 2.\nSTART, 0., 0.\nLINE, 9., 0.", "REVOLUTION"
        depth, held = 0.5 if element == "C3D8" else 0.5 / 3, "BOTTOM, 3\nX0, 1\nY0, 2\n9000, 1, 2"
    axis = 2 if element.startswith("CPE") else 3
    given = {"slave": upper_faces(mesh), "profile": profile, "kind": kind or "SEGMENTS", "z": z, "material": material}
    given |= {"x": 1.0, "y": 1.0, "pair": pair, "held": held, "steps": step("*BOUNDARY", f"9000, {axis}, {axis}, -0.1")}
    deck, found = run(mesh, **given, friction=HARD)
    assert deck.laws["I"].hard
    _, wanted = run(mesh, **given, stiffness=100 * young / depth)
    assert found[-1].displacement == pytest.approx(wanted[-1].displacement, abs=1e-9)
    top = np.abs(mesh.points[:, -1] - 1) < 1e-9
    assert -0.1 < found[-1].displacement[:-1][top, -1].mean() < -0.098


def test_hard_contact_needs_faces(run):
    mesh = layered_block(2.0, [("a", 1.0)], 2, 1, "CPE4")
    nodes = "*SURFACE, NAME=SLAVE, TYPE=NODE\nTOP"
    with pytest.raises(InputError, match="HARD with SLAVE, which has no faces"):
        run(mesh, profile=FLAT, slave=upper_faces(mesh) + "\n" + nodes, friction=HARD, held=STANDS, steps=step())


FLAT, STANDS = "START, -5., 1.\nLINE, 5., 1.", "BOTTOM, 1, 2\n9000, 1, 2"


def test_a_slip_tolerance_leaves_the_sticks_slope_to_the_law(run):
    mesh = layered_block(2.0, [("a", 1.0)], 3, 2, "CPE4")
    given = {"profile": FLAT, "held": "BOTTOM, 1, 2", "slave": upper_faces(mesh)}
    given["steps"] = step("*BOUNDARY", "9000, 1, 1, 0.05", "9000, 2, 2, -0.1")
    _, wanted = run(mesh, **given, friction="*FRICTION\n0.3")
    _, found = run(mesh, **given, friction="*FRICTION, SLIP TOLERANCE=0.005\n0.3,")
    assert found[-1].displacement == pytest.approx(wanted[-1].displacement, abs=1e-12)
    assert found[-1].internal[-1, 0] > 0.01


TURNS = {
    "a prescribed rotation": ("", step("*BOUNDARY", "9000, 6, 6, 0.05")),
    "a prescribed rotation in the model": ("9000, 6, 6, 0.05", step()),
    "a moment": ("", step("*CLOAD", "9000, 6, 0.3")),
}


@pytest.mark.parametrize("name", TURNS)
def test_analytical_surfaces_that_turn_are_refused(run, name):
    held, steps = TURNS[name]
    mesh = layered_block(2.0, [("a", 1.0)], 2, 1, "CPE4")
    common = {"profile": FLAT, "slave": upper_faces(mesh)}
    with pytest.raises(InputError, match=f"found RIGID with {' '.join(name.split()[:3])}.*that does not turn"):
        run(mesh, **common, held=STANDS + "\n" + held, steps=steps)
    run(mesh, **common, held=STANDS + "\n9000, 6", steps=step("*BOUNDARY", "9000, 6, 6, 0."))


def test_an_analytical_surface_does_not_turn_with_nodes_of_its_body(run):
    mesh = layered_block(2.0, [("a", 1.0)], 2, 1, "CPE4")
    nodes = "*NODE\n9001, 1., 2.\n*NSET, NSET=MORE\n9001\n*RIGID BODY, REF NODE=9000, NSET=MORE"
    common = {"profile": FLAT, "slave": upper_faces(mesh), "friction": nodes, "steps": step()}
    with pytest.raises(InputError, match="found RIGID on a body that turns"):
        run(mesh, **common, held=STANDS)
    run(mesh, **common, held=STANDS + "\n9000, 6")


def test_the_bodys_side_is_where_most_of_it_lies():
    ring = Surface("SEGMENTS", profile=[("START", [-2.0, 0.0]), ("CIRCL", [2.0, 0.0, 0.0, 0.0])])
    inside = np.array([[0.0, -1.9], [1.0, -1.5], [-1.0, -1.5], [0.0, -2.1]])
    surface = rigid_surface(ring, inside)
    assert isinstance(surface, Round) and surface.side == -1
    assert surface.gap(inside)[0] == pytest.approx([0.1, 2 - np.sqrt(3.25), 2 - np.sqrt(3.25), -0.1])
    above = rigid_surface(ring, np.array([[0.0, 2.1], [1.0, 2.5], [0.0, 1.99]]))
    assert isinstance(above, Round) and above.side == 1


def test_local_axes_of_a_cylinder_are_abaqus_s(tmp_path):
    """A plate above, as a program writes it for ABAQUS: z is against the generator, so local y = -3 is z = 3."""
    mesh = brick((1.0, 1.0, 1.0), (1, 1, 1), "E")
    plate = "*SURFACE, TYPE=CYLINDER, NAME=PLATE\n0., 0., 0., 1., 0., 0.\n0., -1., 0.\nSTART, -1., -3.\nLINE, 1., -3.\n"
    rest = "*MATERIAL, NAME=M\n*ELASTIC\n1., 0.3\n*SOLID SECTION, ELSET=E, MATERIAL=M\n*STEP\n*STATIC\n*END STEP\n"
    (tmp_path / "deck.inp").write_text(format_mesh(mesh) + plate + rest)
    deck = read_deck(tmp_path / "deck.inp")
    (tmp_path / "again.inp").write_text(format_deck(deck))
    for path in ("deck.inp", "again.inp"):
        surface = rigid_surface(read_deck(tmp_path / path).surfaces["PLATE"], mesh.points)
        assert isinstance(surface, Plane)
        assert surface.gap(np.array([[5.0, 7.0, 0.0], [0.0, 0.0, 2.5]]))[0] == pytest.approx([3.0, 0.5])
