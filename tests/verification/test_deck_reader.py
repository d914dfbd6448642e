"""What the reader understands, seen in the answers; what it does not is an error with its line."""

import numpy as np
import pytest
from blocks import CUBE, RECTANGLE
from scipy.optimize import brentq, fsolve
from seeds import generator
from solving import solve_deck

from fingerfit.cli import main
from fingerfit.core.errors import InputError
from fingerfit.deck import mesh_keywords, model_keywords
from fingerfit.deck.cards import read_cards
from fingerfit.deck.content import Spring
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.reader import IGNORED, LATER, read_deck
from fingerfit.fem.forces import NonlinearSprings
from fingerfit.material.holzapfel import Holzapfel
from fingerfit.material.prony import Prony
from fingerfit.material.yeoh import Yeoh
from fingerfit.mesh.blocks import brick
from fingerfit.solvers.process import write_cards

SQUARE = f"""{RECTANGLE}*ELEMENT, TYPE=CPS4, ELSET=E
1, 1, 2, 3, 4
"""
ELASTIC = """*SOLID SECTION, ELSET=E, MATERIAL=M
0.5
*MATERIAL, NAME=M
*ELASTIC
10., 0.25
"""
HELD = """*BOUNDARY
1, 1, 2
4, 1
"""
PULL = """*STEP
*STATIC
*CLOAD
2, 1, 0.1
3, 1, 0.1
*END STEP
"""


@pytest.fixture
def run(tmp_path):
    def run(text):
        path = tmp_path / "deck.inp"
        path.write_text(text)
        return solve_deck(path)

    return run


def last(steps):
    assert steps[-1].arrived
    return steps[-1].displacement


def test_a_flat_deck(run):
    _, steps = run(SQUARE + ELASTIC + HELD + PULL)
    assert last(steps)[2] == pytest.approx([0.2 / 0.5 / 10 * 2, -0.25 * 0.04])


def test_parts_and_instances(run):
    """The same square as a part, turned by 90 degrees and moved, in any letter case."""
    part = "*Part, name=Sheet\n" + SQUARE + "*Nset, nset=left, generate\n1, 4, 3\n*Nset, nset=right\n2, 3\n"
    deck = (
        part
        + "*Solid Section, elset=E, material=m\n0.5,\n*End Part\n*Assembly, name=A\n"
        + "*Instance, name=Sheet-1, part=SHEET\n5., 0., 0.\n5., 0., 0., 5., 0., 1., 90.\n*End Instance\n"
        + "*Nset, nset=corner, instance=Sheet-1\n1,\n*End Assembly\n"
        + "*Material, name=M\n*Elastic\n10., 0.25\n"
        + "*Boundary\ncorner, 1\nSheet-1.left, 2\n"
        + "*Step, name=s, nlgeom=NO\n*Static\n*Cload\nSheet-1.right, 2, 0.1\n*End Step\n"
    )
    read, steps = run(deck)
    assert read.mesh.points[1] == pytest.approx([5.0, 2.0])
    assert last(steps)[2] == pytest.approx([0.25 * 0.04, 0.08])
    assert read.mesh.node_sets["SHEET-1.RIGHT"].tolist() == [1, 2]


def test_two_instances_of_a_part_keep_their_labels(run):
    part = "*PART, NAME=P\n" + SQUARE + "*SOLID SECTION, ELSET=E, MATERIAL=M\n*END PART\n*ASSEMBLY, NAME=A\n"
    places = "*INSTANCE, NAME=A, PART=P\n*END INSTANCE\n*INSTANCE, NAME=B, PART=P\n2., 0.\n*END INSTANCE\n"
    tie = "*SURFACE, NAME=LEFT\nA.E, S2\n*SURFACE, NAME=RIGHT\nB.E, S4\n*END ASSEMBLY\n*TIE, NAME=T\nRIGHT, LEFT\n"
    ends = "*MATERIAL, NAME=M\n*ELASTIC\n10., 0.25\n*BOUNDARY\nA.1, 1, 2\nA.4, 1\n"
    load = "*STEP\n*STATIC\n*CLOAD\nB.2, 1, 0.1\nB.3, 1, 0.1\n*END STEP\n"
    _, steps = run(part + places + tie + ends + load)
    u = last(steps)
    assert u[1] == pytest.approx(u[4])  # tied
    assert u[6, 0] == pytest.approx(0.2 / 10 * 4)


def test_ties_of_unlike_meshes_pass_the_patch_test(run):
    """Two elements on one: the middle node follows the master's edge."""
    deck = """*NODE
1, 0., 0.
2, 2., 0.
3, 2., 1.
4, 0., 1.
11, 0., 1.
12, 1., 1.
13, 2., 1.
14, 0., 2.
15, 1., 2.
16, 2., 2.
*ELEMENT, TYPE=CPE4, ELSET=E
1, 1, 2, 3, 4
2, 11, 12, 15, 14
3, 12, 13, 16, 15
*NSET, NSET=TOP
14, 15, 16
*NSET, NSET=BASE
1, 2
*SURFACE, NAME=MASTER
1, S3
*SURFACE, NAME=SLAVE
2, S1
3, S1
*TIE, NAME=T, POSITION TOLERANCE=0.01
SLAVE, MASTER
*SOLID SECTION, ELSET=E, MATERIAL=M
*MATERIAL, NAME=M
*ELASTIC
10., 0.25
*BOUNDARY
BASE, 2
1, 1
*STEP
*STATIC
*DSLOAD
PRESSED, P, 0.3
*END STEP
""".replace("*TIE", "*SURFACE, NAME=PRESSED\n2, S3\n3, S3\n*TIE")
    _, steps = run(deck)
    u = last(steps)
    modulus = 10 / (1 - 0.25**2)
    assert u[7:, 1] == pytest.approx(-0.3 / modulus * 2, rel=1e-10)
    assert u[5] == pytest.approx((u[4] + u[6]) / 2)


def test_equations_of_three_terms_and_chains(run):
    """u3 = (u2 + u4) / 2 along y, and u4 follows u2: all of them one."""
    equations = "*EQUATION\n3\n3, 2, 2., 2, 2, -1., 4,\n"
    with pytest.raises(InputError, match="3 terms of node"):
        run(SQUARE + ELASTIC + HELD + equations + PULL)
    equations = "*EQUATION\n3\n3, 2, 2., 2, 2, -1.\n4, 2, -1.\n2\n4, 2, 1., 2, 2, -1.\n"
    load = PULL.replace("*CLOAD\n", "*CLOAD\n2, 2, -0.2\n")
    _, steps = run(SQUARE + ELASTIC + "*BOUNDARY\n1, 1, 2\n4, 1\n" + equations + load)
    u = last(steps)
    assert u[3, 1] == pytest.approx(u[1, 1])
    assert u[2, 1] == pytest.approx(u[1, 1])
    assert abs(u[1, 1]) > 1e-3


def test_an_amplitude_with_a_peak_within_the_step(run):
    """At the end of the step half of the load is there; the next step goes on from it."""
    amplitude = "*AMPLITUDE, NAME=UP\n0., 0., 1., 1.\n2., 0.5\n"
    load = "*STEP, NLGEOM\n*STATIC\n2., 2.\n*BOUNDARY, AMPLITUDE=UP\n2, 1, 1, 0.1\n3, 1, 1, 0.1\n*END STEP\n"
    more = "*STEP, NLGEOM\n*STATIC\n*CLOAD\n4, 2, 1e-9\n*END STEP\n"
    _, steps = run(amplitude + SQUARE + ELASTIC + HELD + load + more)
    assert steps[0].displacement[1, 0] == pytest.approx(0.05)
    assert steps[1].displacement[1, 0] == pytest.approx(0.05)


def test_an_amplitude_of_a_pressure(run):
    amplitude = "*AMPLITUDE, NAME=UP\n0., 0., 1., 0.25\n"
    surface = "*SURFACE, NAME=RIGHT\nE, S2\n"
    load = "*STEP\n*STATIC\n*DSLOAD, AMPLITUDE=UP\nRIGHT, P, -0.8\n*END STEP\n*STEP\n*STATIC\n*END STEP\n"
    _, steps = run(amplitude + SQUARE + surface + ELASTIC + HELD + load)
    assert [step.displacement[2, 0] for step in steps] == pytest.approx([0.2 / 10 * 2] * 2)


def test_an_amplitude_of_a_force(run):
    """A quarter of one force at the end of the step and the whole of the other; without it, both go on from there."""
    amplitude = "*AMPLITUDE, NAME=UP\n0., 0., 0.5, 1., 1., 0.25\n"
    load = "*STEP\n*STATIC\n*CLOAD, AMPLITUDE=UP\n2, 1, 0.1\n3, 1, 0.1\n*CLOAD\n2, 2, 0.01\n3, 2, 0.01\n*END STEP\n"
    still = "*STEP\n*STATIC\n*END STEP\n"
    _, steps = run(amplitude + SQUARE + ELASTIC + HELD + load + still)
    _, plain = run(SQUARE + ELASTIC + HELD + load.replace(", AMPLITUDE=UP", "").replace("0.1\n", "0.025\n"))
    for found in steps:
        assert found.displacement == pytest.approx(plain[0].displacement, abs=1e-12)
    _, whole = run(SQUARE + ELASTIC + HELD + load.replace(", AMPLITUDE=UP", ""))
    assert whole[0].displacement[1, 0] - plain[0].displacement[1, 0] == pytest.approx(0.75 * 0.08)


def test_a_keyword_goes_on_in_the_next_line(run, tmp_path):
    """After a comma, over any number of lines, comments and empty lines between."""
    long = SQUARE.replace("*ELEMENT, TYPE=CPS4, ELSET=E", '*ELEMENT,\n  TYPE=CPS4,\n** a comment\n\n  ELSET="E"')
    long = (long + ELASTIC).replace("*SOLID SECTION, ELSET=E,", "*SOLID SECTION, ELSET=E,\n")
    assert last(run(long + HELD + PULL)[1])[2, 0] == pytest.approx(0.08)
    path = tmp_path / "wrong.inp"
    path.write_text(SQUARE + "*MATERIAL,\n NAME=M\n*ELASTIC,\n  TYPE=ISO,\n KIND=ODD\n1., 0.3\n")
    # where the keyword begins
    with pytest.raises(InputError, match=r"line 10, \*ELASTIC: found KIND"):
        read_deck(path)


def test_includes_within_includes(run, tmp_path):
    """Each is sought from the file that names it, and an error names the file that it is in."""
    inner = tmp_path / "parts" / "more"
    inner.mkdir(parents=True)
    nodes, elements = SQUARE.split("*ELEMENT")
    (tmp_path / "parts" / "mesh.inp").write_text("*INCLUDE, INPUT=more/nodes.inp\n*ELEMENT" + elements)
    (inner / "nodes.inp").write_text(nodes)
    (inner / "held.inp").write_text(HELD)
    deck = "*INCLUDE, INPUT=parts/mesh.inp\n" + ELASTIC + '*INCLUDE, INPUT="parts/more/held.inp"\n' + PULL
    assert last(run(deck)[1])[2] == pytest.approx([0.08, -0.01])
    (inner / "nodes.inp").write_text(nodes + "*WHATEVER\n")
    with pytest.raises(InputError, match=r"nodes.inp.*line 6, \*WHATEVER"):
        run(deck)
    (inner / "nodes.inp").write_text("*INCLUDE, INPUT=../mesh.inp\n")
    with pytest.raises(InputError, match=r"found \.\./mesh.inp, which is being read"):
        run(deck)
    (inner / "nodes.inp").unlink()
    with pytest.raises(InputError, match=r"nodes.inp.*a readable text file"):
        run(deck)


def test_an_included_mesh_is_read_once_and_stays_as_it_is(tmp_path, monkeypatch):
    """Whatever a deck adds to it, or someone does to the arrays; another content is read anew."""
    mesh, deck = tmp_path / "mesh.inp", tmp_path / "deck.inp"
    mesh.write_text(SQUARE + "*NSET, NSET=S\n1\n*NSET, NSET=T\nS, 2\n")
    rest = "*INCLUDE, INPUT=mesh.inp\n*NODE\n9, 5., 5.\n*NSET, NSET=S\n9\n*ELSET, ELSET=E\n1\n" + ELASTIC + HELD + PULL
    deck.write_text("*HEADING\n" + rest)
    asked = []
    handle = mesh_keywords.dispatch
    monkeypatch.setattr(mesh_keywords, "dispatch", lambda reading, card: (asked.append(card), handle(reading, card)))
    first = read_deck(deck).mesh
    count = len(asked)
    for changed in (first.points, first.node_sets["S"], first.blocks[0].nodes):
        changed[...] = 7
    again = read_deck(deck).mesh
    assert len(asked) - count == count - 4  # without the cards of the mesh: *NODE, *ELEMENT, two of *NSET
    assert again.node_sets["S"].tolist() == [0, 4] and again.node_sets["T"].tolist() == [0, 1]
    assert again.points[:, 0].tolist() == [0, 2, 2, 0, 5] and again.blocks[0].nodes.tolist() == [[0, 1, 2, 3]]
    mesh.write_text(mesh.read_text().replace("NSET=T\nS, 2", "NSET=T\nS, 3"))
    assert read_deck(deck).mesh.node_sets["T"].tolist() == [0, 2]


def test_an_included_mesh_after_other_nodes_is_read_as_it_comes(tmp_path):
    mesh, deck = tmp_path / "mesh.inp", tmp_path / "deck.inp"
    mesh.write_text("*ELEMENT, TYPE=CPS4, ELSET=E\n1, 1, 2, 3, 4\n")
    deck.write_text(RECTANGLE + "*INCLUDE, INPUT=mesh.inp\n" + ELASTIC + HELD + PULL)
    assert [len(read_deck(deck).mesh.points) for _ in range(2)] == [4, 4]
    deck.write_text("*INCLUDE, INPUT=mesh.inp\n" + ELASTIC + "*STEP\n*STATIC\n*END STEP\n")
    for folder in ("", "other"):
        (tmp_path / folder).mkdir(exist_ok=True)
        for path in (mesh, deck):
            (tmp_path / folder / path.name).write_text(path.read_text())
        with pytest.raises(InputError, match=f"{tmp_path / folder / 'mesh.inp'}.*line 2"):
            read_deck(tmp_path / folder / "deck.inp")


def test_a_sheet_pulled_by_pressures_only_comes_to_rest(run):
    """All forces balance in each node: residuals are measured by the parts' own forces."""
    surfaces = "*SURFACE, NAME=ENDS\nE, S2\nE, S4\n"
    load = "*STEP, NLGEOM\n*STATIC\n*DSLOAD\nENDS, P, -0.4\n*END STEP\n"
    _, steps = run(SQUARE + surfaces + ELASTIC + "*BOUNDARY\n1, 1, 2\n2, 2\n" + load)
    # St.Venant-Kirchhoff's stress along, against the pressure on a side that gets shorter by Poisson's ratio

    def unbalanced(stretch):
        return stretch * 10 * (stretch**2 - 1) / 2 - 0.4 * np.sqrt(1 - 0.25 * (stretch**2 - 1))

    # forces of 0.2 are balanced to 1e-7 of them
    assert last(steps)[2, 0] == pytest.approx(2 * (brentq(unbalanced, 1.0, 1.2, xtol=1e-14) - 1), rel=1e-7)


def test_the_list_of_keywords_that_load_later_is_complete():
    assert set(LATER) == set(model_keywords.KEYWORDS)


def test_keywords_without_blanks(run):
    deck = (SQUARE + ELASTIC + HELD + PULL).replace("*SOLID SECTION", "*SOLIDSECTION").replace("*END STEP", "*ENDSTEP")
    assert last(run(deck)[1])[2, 0] == pytest.approx(0.08)


def test_prescribed_in_a_later_step_only(run):
    first = "*STEP, NLGEOM\n*STATIC\n*CLOAD\n2, 1, 0.05\n3, 1, 0.05\n*END STEP\n"
    second = "*STEP, NLGEOM\n*STATIC\n*BOUNDARY\n2, 1, 1, 0.1\n*END STEP\n"
    _, steps = run(SQUARE + ELASTIC + HELD + first + second)
    assert 0.01 < steps[0].displacement[1, 0] < 0.05
    assert steps[1].displacement[1, 0] == pytest.approx(0.1)


def test_springs_to_ground_and_between_nodes(run):
    springs = "*ELEMENT, TYPE=SPRING1, ELSET=G\n10, 2\n11, 3\n*SPRING, ELSET=G\n1\n2.5\n"
    _, steps = run(SQUARE + ELASTIC + HELD + springs + PULL)
    stiffness = 10 * 0.5 * 1 / 2
    assert last(steps)[1, 0] == pytest.approx(0.2 / (stiffness + 5.0))
    between = "*ELEMENT, TYPE=SPRING2, ELSET=G\n10, 1, 2\n11, 4, 3\n*SPRING, ELSET=G\n1, 1\n2.5\n"
    _, steps = run(SQUARE + ELASTIC + HELD + between + PULL)
    assert last(steps)[1, 0] == pytest.approx(0.2 / (stiffness + 5.0))


TABLE = [(-0.3, -0.2), (-0.25, -0.01), (0.0, 0.0), (0.05, 0.01), (0.15, 0.1)]
"""Force and displacement of two springs at the ends of a bar of 2.5 N/mm; between the entries 5, 1.11, 25 and 0.26 N/mm."""


def test_nonlinear_springs_follow_their_table_and_hold_the_force_of_its_ends(run):
    """Closed form: 2.5 u + 2 F(u) is what pulls; within each stretch and beyond both ends, also back again."""
    rows = "".join(f"{force}, {at}\n" for force, at in TABLE)
    ground = "*ELEMENT, TYPE=SPRING1, ELSET=G\n10, 2\n11, 3\n*SPRING, ELSET=G, NONLINEAR\n1\n" + rows
    between = "*ELEMENT, TYPE=SPRING2, ELSET=G\n10, 2, 1\n11, 3, 4\n*SPRING, ELSET=G, NONLINEAR\n1, 1\n" + rows
    against = "*ELEMENT, TYPE=SPRING2, ELSET=G\n10, 1, 2\n11, 4, 3\n*SPRING, ELSET=G, NONLINEAR\n1, 1\n"
    against += "".join(f"{-force}, {-at}\n" for force, at in reversed(TABLE))
    wanted = [0.004, 0.05, 0.1, 0.4, 0.05, -0.005, -0.1, -0.5, 0.02]
    at = [2.5 * u + 2 * np.interp(u, [row[1] for row in TABLE], [row[0] for row in TABLE]) for u in wanted]
    pull = "".join(PULL.replace("0.1\n", f"{float(total) / 2}\n") for total in at)
    for springs in (ground, between, against):
        _, steps = run(SQUARE + ELASTIC + HELD + springs + pull)
        assert [step.arrived for step in steps] == [True] * len(wanted)
        assert [step.displacement[1, 0] for step in steps] == pytest.approx(wanted, rel=1e-9)


def test_forces_of_springs_are_slopes_of_their_energy_and_stiffnesses_those_of_the_forces():
    """Tables of unlike length; differences within a stretch are exact up to rounding, 1e-16 of 0.1 over 1e-6."""
    tables = [TABLE, [(1.0, -1.0), (3.0, 0.5)], [(0.1, 0.02), (0.0, 0.03), (0.4, 0.3)]]
    term = NonlinearSprings(np.array([0, 1, 2]), np.array([3, -1, 0]), tables)
    assert term.energy(np.zeros(4)) == 0
    step = 1e-6
    for u in generator(7).uniform(-0.4, 0.4, (40, 4)):
        moved = [u[0] - u[3], u[1], u[2] - u[0]]
        near = [abs(x - at) for x, table in zip(moved, tables, strict=True) for _, at in table]
        if min(near) < 3 * step:
            continue
        found = term.forces(u)
        own = [Spring((0, 0), None, 0.0, tuple(table)).force(x) for x, table in zip(moved, tables, strict=True)]
        assert found.force == pytest.approx([own[0] - own[2], own[1], own[2], -own[0]], abs=1e-14)
        matrix = np.zeros((4, 4))
        np.add.at(matrix, (found.rows, found.columns), found.values)
        moves = step * np.eye(4)
        slopes = [(term.energy(u + d) - term.energy(u - d)) / (2 * step) for d in moves]
        assert slopes == pytest.approx(found.force, abs=1e-8)
        changes = np.array([(term.forces(u + d).force - term.forces(u - d).force) / (2 * step) for d in moves])
        assert np.abs(changes.T - matrix).max() < 1e-8


def test_a_spring_without_table_has_the_force_of_its_stiffness():
    assert Spring((0, 0), None, 2.5).force(-0.1) == -0.25


RIGID = """*NODE
20, 2., 0.5
*RIGID BODY, REF NODE=20, NSET=END
"""


def test_a_rigid_body_that_may_not_turn(run):
    nodes = SQUARE + "*NSET, NSET=END\n2, 3\n"
    load = "*STEP, NLGEOM\n*STATIC\n*BOUNDARY\n20, 6\n*CLOAD\n20, 1, 0.2\n*END STEP\n"
    _, steps = run(nodes + RIGID + ELASTIC + "*BOUNDARY\n1, 1, 2\n4, 1\n20, 2, 2\n20, 6, 6\n" + load)
    u = last(steps)
    assert u[1] == pytest.approx(u[2])
    assert u[4, 0] == pytest.approx(u[1, 0])


def test_a_node_that_is_tied_twice_or_prescribed_is_named(run):
    nodes = SQUARE + "*NSET, NSET=END\n2, 3\n" + RIGID
    for more in ("*BOUNDARY\n3, 1\n", "*EQUATION\n2\n3, 1, 1., 4, 1, -1.\n"):
        with pytest.raises(InputError, match=r"RIGID BODY: found node 3 is tied twice or prescribed"):
            run(nodes + ELASTIC + more + "*BOUNDARY\n1, 1, 2\n4, 1\n20, 6\n*STEP, NLGEOM\n*STATIC\n*END STEP\n")


def test_a_rigid_body_turns_by_large_angles(run):
    """Turned by 90 degrees about its reference node: exact, and free of stress with the sheet turning along."""
    nodes = SQUARE + "*NSET, NSET=END\n1, 2, 3, 4\n"
    load = "*STEP, NLGEOM\n*STATIC\n0.2, 1.\n*BOUNDARY\n20, 6, 6, 1.5707963267948966\n*END STEP\n"
    _, steps = run(nodes + RIGID + ELASTIC + "*BOUNDARY\n20, 1, 2\n" + load)
    assert last(steps)[0] == pytest.approx([2.5, -1.5])  # from (-2, -0.5) to (0.5, -2) about the reference node
    assert np.abs(steps[-1].internal).max() < 1e-12


def test_a_moment_turns_a_rigid_body(run):
    """A free end plate under a moment: the reference node's rotation balances it, by a deck with equal forces."""
    nodes = SQUARE + "*NSET, NSET=END\n2, 3\n"
    held = "*BOUNDARY\n1, 1, 2\n4, 1\n"
    by_moment = "*STEP, NLGEOM\n*STATIC\n*CLOAD\n20, 6, 0.1\n*END STEP\n"
    _, steps = run(nodes + RIGID + ELASTIC + held + by_moment)
    u = last(steps)
    plate = np.array([2.0, 1.0]) + u[2] - np.array([2.0, 0.0]) - u[1]
    assert np.linalg.norm(plate) == pytest.approx(1.0, rel=1e-12)
    angle = np.arctan2(-plate[0], plate[1])
    assert 0.02 < angle < 0.2
    # a small moment turns it as a couple of forces at its ends does; larger ones differ with the square of the angle
    _, small = run(nodes + RIGID + ELASTIC + held + by_moment.replace("6, 0.1", "6, 1e-4"))
    _, couple = run(SQUARE + ELASTIC + held + "*STEP, NLGEOM\n*STATIC\n*CLOAD\n2, 1, 1e-4\n3, 1, -1e-4\n*END STEP\n")
    edge, pair = last(small), last(couple)
    assert edge[1, 0] - edge[2, 0] == pytest.approx(pair[1, 0] - pair[2, 0], rel=angle**2 * 1e-6 + 1e-7)
    assert angle == pytest.approx(1e3 * (edge[1, 0] - edge[2, 0]), rel=angle**2)


def test_initial_stress_is_released(run):
    """A free sheet with an initial stress shrinks by it; with its ends held it keeps it as a reaction."""
    initial = "*INITIAL CONDITIONS, TYPE=STRESS\nE, 0.2\n"
    still = "*STEP, NLGEOM\n*STATIC\n*END STEP\n"
    _, steps = run(SQUARE + ELASTIC + initial + HELD + still)
    strain = last(steps)[1, 0] / 2
    assert strain + strain**2 / 2 == pytest.approx(-0.2 / 10)  # Green's strain: St.Venant-Kirchhoff
    held = "*BOUNDARY\n1, 1, 2\n4, 1\n2, 1\n3, 1\n"
    _, steps = run(SQUARE + ELASTIC + initial + held + still)
    assert steps[0].internal[[1, 2], 0].sum() == pytest.approx(0.2 * 0.5, rel=1e-12)


@pytest.mark.parametrize("element", ["C3D8", "C3D8H", "C3D20R"])
def test_initial_stress_of_ogdens_material(run, element):
    """Free, a cube loses the stretch that the deviator comes from; held, it pulls and shears."""
    mu, alpha, d = np.array([0.02, 0.012]), np.array([1.4, -2.0]), 0.5
    mesh = brick((1.0, 1.0, 1.0), (1, 1, 1), element=element)
    material = f"*HYPERELASTIC, OGDEN, N=2\n{mu[0]}, {alpha[0]}, {mu[1]}, {alpha[1]}, {d}, 0.\n"
    deck = format_mesh(mesh) + "*SOLID SECTION, ELSET=BODY, MATERIAL=M\n*MATERIAL, NAME=M\n" + material
    initial = "*INITIAL CONDITIONS, TYPE=STRESS\nBODY, {}\n"
    still = "*STEP, NLGEOM\n*STATIC\n*END STEP\n"
    free = "*BOUNDARY\nX0, 1\nY0, 2\nBOTTOM, 3\n"
    pulled = np.array([0.02, -0.004, 0.0])
    _, steps = run(deck + initial.format("0.02, -0.004") + free + still)

    def unbalanced(stretch):
        """Principal Kirchhoff stresses in MPa, and the mean of the initial stress, which is a second Piola-Kirchhoff's."""
        volume = stretch.prod()
        power = (stretch * stretched)[:, None] ** alpha * volume ** (-alpha / 3)
        own = (2 * mu / alpha * (power - power.mean(axis=0))).sum(axis=1) + 2 / d * (volume - 1) * volume
        return own + pulled.mean() * stretch**2

    def deviator(logarithm):
        power = np.exp(np.append(logarithm, -logarithm.sum()))[:, None] ** alpha
        return ((2 * mu / alpha * (power - power.mean(axis=0))).sum(axis=1) - pulled + pulled.mean())[:2]

    ahead = fsolve(deviator, np.zeros(2), xtol=1e-12)
    stretched = np.exp(np.append(ahead, -ahead.sum()))
    stretch = fsolve(unbalanced, np.ones(3), xtol=1e-12)
    assert abs(stretch[0] - 1) > 0.1
    corner = (mesh.points == 1).all(axis=1)
    assert last(steps)[corner][0] == pytest.approx(stretch - 1, abs=1e-7)
    everywhere = f"*NSET, NSET=EVERY, GENERATE\n1, {len(mesh.points)}\n*BOUNDARY\nEVERY, 1, 3\n"
    _, steps = run(deck + everywhere + initial.format("0.02, -0.004, 0., 0.003, 0.001, -0.002") + still)
    right = steps[0].internal[mesh.points[:, 0] == 1].sum(axis=0)
    assert right == pytest.approx([0.02, 0.003, 0.001], abs=1e-12)


@pytest.mark.parametrize("nlgeom", [", NLGEOM", ""], ids=["finite", "small"])
def test_strain_without_stress(run, nlgeom):
    """A free sheet takes on its strain, as CalculiX's example inistrain does; a held one pushes."""
    rows = "".join(f"1, {point}, 0.01, 0., 0., 0., 0., 0.\n" for point in range(1, 5))
    still = f"*INITIAL CONDITIONS, TYPE=PLASTIC STRAIN\n{rows}*STEP{nlgeom}\n*STATIC\n*END STEP\n"
    _, steps = run(SQUARE + ELASTIC + HELD + "2, 2\n" + still)
    stretch = np.sqrt(1.02) if nlgeom else 1.01
    assert last(steps)[2] == pytest.approx([2 * (stretch - 1), 0.0], abs=1e-12)
    _, steps = run(SQUARE + ELASTIC + HELD + "2, 1, 2\n3, 1\n" + still)
    assert steps[0].internal[[1, 2], 0].sum() == pytest.approx(-10 * 0.01 * 0.5, rel=1e-12)
    with pytest.raises(InputError, match="the same at all points"):
        run(SQUARE + ELASTIC + HELD + still.replace("1, 2, 0.01", "1, 2, 0.02"))


@pytest.mark.parametrize("extra", ["", "*STATIC, LONG TERM"], ids=["held", "long term"])
def test_relaxation_in_steps(run, extra):
    """Stretched fast, then held: the reaction falls to 1 - g."""
    cube = f"""{CUBE}*ELEMENT, TYPE=C3D8H, ELSET=E
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=TOP, GENERATE
5, 8
*SOLID SECTION, ELSET=E, MATERIAL=M
*MATERIAL, NAME=M
*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS
0.05, 1e-4
*VISCOELASTIC, TIME=PRONY
0.4, 0., 2.
*BOUNDARY
1, XSYMM
4, XSYMM
5, XSYMM
8, XSYMM
1, YSYMM
2, YSYMM
5, YSYMM
6, YSYMM
1, ZSYMM
2, ZSYMM
3, ZSYMM
4, ZSYMM
*STEP, NLGEOM
*STATIC
*BOUNDARY
TOP, 3, 3, 0.5
*END STEP
*STEP, NLGEOM
"""
    hold = extra + "\n*END STEP\n" if extra else "*VISCO, DIRECT\n1., 4.\n*END STEP\n"
    _, steps = run(cube + hold)
    force = [step.internal[4:, 2].sum() for step in steps]
    left = 0.6 if extra else 0.6 + 0.4 * np.exp(-4 / 2)
    assert force[0] == pytest.approx(0.1 * (1.5 - 1.5**-2), rel=1e-3)
    assert force[1] == pytest.approx(left * force[0], rel=1e-4)


def test_materials(run):
    deck = (
        SQUARE.replace("CPS4", "CPE4")
        + """*ORIENTATION, NAME=O, LOCAL DIRECTIONS=1
0., 1., 0., -1., 0., 0.
1., 0., 0.
*SOLID SECTION, ELSET=E, MATERIAL=F, ORIENTATION=O
*MATERIAL, NAME=F
*ANISOTROPIC HYPERELASTIC, HOLZAPFEL, LOCAL DIRECTIONS=1
0.02, 0.1, 0.5, 0.9, 0.1
*VISCOELASTIC, TIME=PRONY
0.1, 0.2, 1.
*MATERIAL, NAME=Y
*HYPERELASTIC, YEOH
0.1, 0.01, 0.001, 0.5, 0., 0.
"""
        + HELD
        + "*STEP, NLGEOM\n*STATIC\n*CLOAD\n2, 1, 0.01\n3, 1, 0.01\n*END STEP\n"
    )
    read, steps = run(deck)
    assert read.materials["F"] == Holzapfel(
        0.02, 0.1, 0.5, 0.9, 0.1, ((1.0, 0.0, 0.0),), Prony((0.1,), (1.0,), k=(0.2,))
    )
    assert read.materials["Y"] == Yeoh((0.1, 0.01, 0.001), (0.5,))
    along_y = last(steps)[2, 0]
    _, steps = run(deck.replace("0., 1., 0., -1., 0., 0.", "1., 0., 0., 0., 1., 0."))
    assert last(steps)[2, 0] < 0.8 * along_y  # stiffer along the fibres


def test_pressure_follows_in_a_step_with_nlgeom(run):
    """Inflated ring in axisymmetry: pressure against the closed form of an incompressible neo-Hookean tube."""
    rows, inner, outer = 8, 1.0, 1.5
    radii = np.linspace(inner, outer, rows + 1)
    nodes = "".join(f"{2 * n + 1 + z}, {r}, {0.1 * z}\n" for n, r in enumerate(radii) for z in (0, 1))
    elements = "".join(f"{n + 1}, {2 * n + 1}, {2 * n + 3}, {2 * n + 4}, {2 * n + 2}\n" for n in range(rows))
    deck = (
        f"*NODE, NSET=ALL\n{nodes}*ELEMENT, TYPE=CAX4H, ELSET=E\n{elements}"
        "*SURFACE, NAME=IN\n1, S4\n*SOLID SECTION, ELSET=E, MATERIAL=M\n*MATERIAL, NAME=M\n"
        "*HYPERELASTIC, NEO HOOKE\n0.5, 1e-5\n*BOUNDARY\nALL, 2\n"
        "*STEP, NLGEOM\n*STATIC\n0.25, 1.\n*DSLOAD\nIN, P, 0.3\n*END STEP\n"
    )
    _, steps = run(deck)
    a = inner + last(steps)[0, 0]
    b = np.sqrt(outer**2 + a**2 - inner**2)
    # p = int 2 C10 (lt^2 - lr^2) dr / r from a to b, with lt = r / R
    r = np.linspace(a, b, 4001)
    big = np.sqrt(r**2 - a**2 + inner**2)
    integrand = 2 * 0.5 * ((r / big) ** 2 - (big / r) ** 2) / r
    pressure = np.trapezoid(integrand, r)
    assert pressure == pytest.approx(0.3, rel=5e-3)
    assert a > 1.1


ERRORS = {
    "*ELEMENT, TYPE=S4\n": "line 1, .ELEMENT: found S4",
    "*MATERIAL, NAME=M\n*PLASTIC\n1.\n": "line 2, .PLASTIC: found an unknown keyword",
    "*NODE\n1, 0., 0.\n1, 1., 0.\n": "line 3, .NODE: found node 1 twice",
    "*INSTANCE, NAME=A, PART=P\n": "a part defined before",
    "*MATERIAL, NAME=M\n*HYPERELASTIC, ARRUDA-BOYCE\n1., 1., 1.\n": "ARRUDA-BOYCE",
    "*MATERIAL, NAME=M\n*HYPERELASTIC, NEO HOOKE\n1., 0.\n": "D above 0",
    "*MATERIAL, NAME=M\n*VISCOELASTIC, TIME=PRONY\n0.5, 0., 1.\n": "no elastic constants",
    "*MATERIAL, NAME=M\n*ELASTIC\n1., 0.3\n*VISCOELASTIC, TIME=PRONY\n0.5, 1., 1.\n": "g and k whose sums are below 1",
    "*AMPLITUDE, NAME=A\n0., 0., 0., 1.\n": "times growing",
    "*SURFACE INTERACTION, NAME=I\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=EXPONENTIAL\n1., 1.\n": "found EXPONENTIAL",
    "*SURFACE, NAME=S\nX, S1\n": "an element or a set of them",
    "*CLOAD\n1, 1, 1.\n": "found no step",
    "*NODE, SYSTEM=C\n1, 0., 0.\n": "Cartesian",
    "*NODE\n,\n": "line 2, .NODE: found ,; expected 1 values or more",
    "*NSET, NSET=A, GENERATE\n1\n": "line 2, .NSET: .*first, last and step",
    "*NSET, NSET=A, GENERATE\n1, 4, 0\n": "line 2, .NSET: .*step above 0",
    "*ELSET, ELSET=A, GENERATE\n4, 1\n": "line 2, .ELSET: .*last not below first",
    "*SURFACE, NAME=S, TYPE=NODE\n,\n": "line 2, .SURFACE: found ,; expected 1 values",
    "*RESTART, READ, STEP=2\n": "line 1, .RESTART: found READ",
    "*HEADING\n*PLASTIC,\n": "line 2, .PLASTIC: found an unknown keyword",
    "*OUTPUT, FIELD,\n*PLASTIC\n": "line 2, .PLASTIC: found an unknown keyword",
    "*SECTION CONTROLS, NAME=C, DISTORTION CONTROL=YES\n1., 1.\n": "line 1, .SECTION CONTROLS: found DISTORTION",
    "*MATERIAL, NAME=M\n*HYPERELASTIC, OGDEN\n1., 0., 1.\n": "line 2, .HYPERELASTIC: .*expected alpha other than 0$",
    "*MATERIAL, NAME=M\n*HYPERELASTIC, OGDEN\n1., 2., 0.\n": "line 2, .HYPERELASTIC: found D = 0, incompressible",
    "*SURFACE, NAME=S, TYPE=SEGMENTS\nSTART, 0., 0.\nLINE, 1., 0.\nLINE, 1., 1.\n": "line 4, .*found a second segment",
    "*SURFACE, NAME=S, TYPE=SEGMENTS\nSTART, 0., 0.\nPARAB, 1., 0., 2., 1.\n": "line 3, .SURFACE: .*LINE or CIRCL",
    "*SURFACE, NAME=S, TYPE=CYLINDER\n0., 0., 0., 1., 0., 0.\nSTART, 0., 0.\nLINE, 1., 0.\n": "line 1, .*a third",
    "*ORIENTATION, NAME=O\n1., 0., 0., 0., 1., 0.\n4, 30.\n": "line 1, .ORIENTATION: .*an axis 1, 2 or 3",
    "*SURFACE INTERACTION, NAME=I\n*FRICTION, SLIP TOLERANCE=0.\n0.3\n": "line 2, .FRICTION: .*slip tolerance above 0",
    SQUARE + "*SURFACE, NAME=S\nE, S1\n*TIE, NAME=T, TYPE=OTHER\nS, S\n": "line 10, .TIE: found TYPE=OTHER",
    SQUARE + "*SURFACE, NAME=S\nE, S1\n*TIE, NAME=T, ADJUST=MAYBE\nS, S\n": "line 10, .TIE: found ADJUST=MAYBE",
    SQUARE + "*ELEMENT, TYPE=SPRING1\n1, 2\n": "line 9, .ELEMENT: found element 1 twice",
    "*ELEMENT, TYPE=SPRING1\n1, 2\n" + SQUARE: "line 9, .ELEMENT: found element 1 twice",
}


@pytest.mark.parametrize("text", ERRORS, ids=lambda t: t.split("\n")[-2][:20])
def test_errors_name_the_line(tmp_path, text):
    path = tmp_path / "deck.inp"
    path.write_text(text)
    with pytest.raises(InputError, match=ERRORS[text]):
        read_deck(path)


def test_a_last_keyword_line_that_ends_with_a_comma_counts(run):
    _, steps = run(SQUARE + ELASTIC + HELD + PULL.replace("*END STEP\n", "*END STEP,"))
    assert last(steps)[2, 0] == pytest.approx(0.08)


def test_names_in_quotes_may_have_commas(run):
    deck = (SQUARE + ELASTIC).replace("ELSET=E", 'ELSET="E, part 1"') + HELD
    surface = '*SURFACE, NAME="RIGHT, OUTER"\n"E, PART 1", S2\n'
    read, steps = run(deck + surface + '*STEP\n*STATIC\n*DSLOAD\n"right, outer", P, -0.4\n*END STEP\n')
    assert read.sections[0].elset == "E, PART 1"
    assert last(steps)[2, 0] == pytest.approx(0.08)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8", "utf-8-sig"])
def test_decks_of_other_encodings_are_read(tmp_path, encoding):
    text = "*HEADING\nPr\u00fcfung\n** Fl\u00e4che\n" + SQUARE + ELASTIC + HELD + PULL
    path = tmp_path / "deck.inp"
    path.write_bytes(text.encode(encoding))
    assert read_deck(path).mesh.element_count == 1
    write_cards(read_cards(path), tmp_path / "for.inp")
    assert read_deck(tmp_path / "for.inp").mesh.element_count == 1


def test_hourglass_controls_and_files_for_a_restart_change_nothing(run):
    deck = SQUARE + ELASTIC.replace("MATERIAL=M\n", "MATERIAL=M, CONTROLS=EC-1\n", 1) + HELD
    controls = "*SECTION CONTROLS, NAME=EC-1, HOURGLASS=ENHANCED\n1., 1., 1.\n*RESTART, WRITE, FREQUENCY=0\n"
    _, steps = run(deck + controls + PULL)
    assert last(steps)[2, 0] == pytest.approx(0.08)


@pytest.mark.parametrize("option", ["PIN NSET", "TIE NSET"])
def test_pinned_and_tied_nodes_of_a_rigid_body(run, option):
    """Nodes of solids have no rotation of their own: both are the same."""
    nodes = SQUARE + "*NSET, NSET=END\n2, 3\n"
    load = "*STEP, NLGEOM\n*STATIC\n*CLOAD\n20, 6, 0.1\n*END STEP\n"
    held = ELASTIC + "*BOUNDARY\n1, 1, 2\n4, 1\n"
    _, wanted = run(nodes + RIGID + held + load)
    _, found = run(nodes + RIGID.replace(" NSET", f" {option}") + held + load)
    assert last(found) == pytest.approx(last(wanted), abs=1e-12)
    assert np.abs(last(found)[2]).max() > 1e-3


def test_a_tie_that_ties_nothing_is_refused(run):
    apart = SQUARE + "*SURFACE, NAME=LOW\n1, S1\n*SURFACE, NAME=HIGH\n1, S3\n*TIE, NAME=T\nHIGH, LOW\n"
    with pytest.raises(InputError, match=r"\*TIE: found no node of HIGH at LOW"):
        run(apart + ELASTIC + HELD + PULL)


@pytest.mark.parametrize("options, stays", [("", False), (", ADJUST=YES", False), (", ADJUST=NO", True)])
def test_ties_put_the_slave_on_the_master(run, options, stays):
    """A gap of 0.02 mm is closed before anything else, and is kept with ADJUST=NO."""
    upper = "*NODE\n11, 0., {0}\n12, 2., {0}\n13, 2., 2.\n14, 0., 2.\n*ELEMENT, TYPE=CPS4, ELSET=E\n2, 11, 12, 13, 14\n"
    faces = "*SURFACE, NAME=LOW\n1, S3\n*SURFACE, NAME=HIGH\n2, S1\n"
    tie = "*TIE, NAME=T, TYPE=SURFACE TO SURFACE, POSITION TOLERANCE=0.05{}\nHIGH, LOW\n"
    load = "*BOUNDARY\n1, 1, 2\n2, 2\n*STEP\n*STATIC\n*CLOAD\n13, 2, 0.1\n14, 2, 0.1\n*END STEP\n"
    _, steps = run(SQUARE + upper.format(1.02) + faces + tie.format(options) + ELASTIC + load)
    stress = 0.2 / 2 / 0.5
    height = 1.98 if stays else 2.0
    assert last(steps)[6, 1] == pytest.approx(stress / 10 * height, rel=1e-9)


def test_a_material_of_finite_strain_needs_nlgeom(run):
    deck = (SQUARE + ELASTIC + HELD + PULL).replace("*ELASTIC\n10., 0.25", "*HYPERELASTIC, NEO HOOKE\n1., 1.")
    with pytest.raises(InputError, match="NLGEOM"):
        run(deck)


def test_output_requests_are_ignored(run):
    extra = "".join(f"*{name}, X=Y\n1, 2\n" for name in sorted(IGNORED))
    _, steps = run(SQUARE + ELASTIC + HELD + extra + PULL)
    assert last(steps)[2, 0] == pytest.approx(0.08)


def test_a_deck_is_shown_as_it_was_understood(tmp_path, capsys):
    path = tmp_path / "deck.inp"
    path.write_text(SQUARE + ELASTIC + HELD + PULL)
    assert main(["deck", "show", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "*ELASTIC\n10.0, 0.25\n" in shown
    assert "*BOUNDARY\n1, 1, 1, 0.0\n4, 1, 1, 0.0\n1, 2, 2, 0.0\n" in shown
    assert "*STATIC\n1.0, 1.0, , 1.0\n*CLOAD\n2, 1, 0.1\n3, 1, 0.1\n*END STEP\n" in shown
    path.write_text("*NODE\n1, 0.\n*WHATEVER\n")
    assert main(["deck", "show", str(path)]) == 1
    assert "line 3, *WHATEVER" in capsys.readouterr().err
