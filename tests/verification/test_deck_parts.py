"""Parts that are moved and turned: their analytical surfaces and orientations go with their nodes."""

import numpy as np
import pytest
from solving import solve_deck

from fingerfit.core.errors import InputError
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.faces import faces_of

DECK = """*PART, NAME=BODY
*NODE, NSET=ALL
{nodes}
*ELEMENT, TYPE={element}, ELSET=E
{elements}
*SURFACE, NAME=SLAVE
{slave}
*SOLID SECTION, ELSET=E, MATERIAL=M
*END PART
*PART, NAME=TOOL
*END PART
*ASSEMBLY, NAME=A
*INSTANCE, NAME=BODY-1, PART=BODY
*END INSTANCE
*INSTANCE, NAME=TOOL-1, PART=TOOL
{placed}
*NODE
1, {reference}
*SURFACE, NAME=S, TYPE={kind}
{profile}
*RIGID BODY, REF NODE=1, ANALYTICAL SURFACE=S
*END INSTANCE
*END ASSEMBLY
*MATERIAL, NAME=M
*HYPERELASTIC, NEO HOOKE
0.5, 0.1
*SURFACE INTERACTION, NAME=I
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
100.
*CONTACT PAIR, INTERACTION=I
BODY-1.SLAVE, TOOL-1.S
*BOUNDARY
{base}
TOOL-1.1, 1, {dim}
*STEP, NLGEOM
*STATIC
0.5, 1.
*BOUNDARY
TOOL-1.1, {dim}, {dim}, -0.3
*END STEP
"""


@pytest.fixture
def press(tmp_path):
    """Displacements after a tool came down by 0.3 mm on the middle of a block whose top is at 1 mm."""

    def press(dim, kind, profile, placed="", reference="0., 0., 0."):
        mesh = brick((2.0, 2.0, 1.0), (4, 4, 2), element="C3D8")
        if dim == 2:
            mesh = layered_block(2.0, [("a", 1.0)], 8, 3, "CPE4")
        block = mesh.blocks[0]
        x = mesh.points - [mesh.points[:, 0].mean(), *[1.0] * (dim - 2), 0.0]
        slave = [
            f"{n}, S{f}"
            for n, nodes in enumerate(block.nodes, 1)
            for f, local in enumerate(faces_of(block.element), 1)
            if (np.abs(x[nodes[list(local)], -1] - 1.0) < 1e-9).all()
        ]
        given = {
            "nodes": "\n".join(f"{n}, " + ", ".join(map(repr, p)) for n, p in enumerate(x.tolist(), 1)),
            "element": block.element,
            "elements": "\n".join(f"{n}, " + ", ".join(map(str, e + 1)) for n, e in enumerate(block.nodes, 1)),
            "slave": "\n".join(slave),
            "base": "\n".join(f"BODY-1.{n + 1}, 1, {dim}" for n in np.flatnonzero(x[:, -1] < 1e-9)),
        }
        values = {"dim": dim, "kind": kind, "profile": profile, "placed": placed, "reference": reference}
        (tmp_path / "deck.inp").write_text(DECK.format(**given, **values))
        _, steps = solve_deck(tmp_path / "deck.inp")
        assert steps[-1].arrived
        assert steps[-1].internal[-1, -1] < -0.01
        return steps[-1].displacement

    return press


LINE, ARC = "START, -5., 1.\nLINE, 5., 1.", "START, -2., 3.\nCIRCL, 2., 3., 0., 3."
PROFILES = {
    "a line moved": (LINE, "START, -5., 0.\nLINE, 5., 0.", "0., 1."),
    "a slanted line turned": (
        "START, 0., 0.95\nLINE, 3., 1.45",
        "START, -0.05, 0.\nLINE, 0.45, -3.",
        "0., 1.\n0., 1., 0., 0., 1., 1., 90.",
    ),
    "a line moved, then turned elsewhere": (
        LINE,
        "START, 0., -5.\nLINE, 0., 5.",
        "1., 0.5\n1., 1., 0., 1., 1., 1., 90.",
    ),
    "an arc moved": (ARC, "START, -2., 0.\nCIRCL, 2., 0., 0., 0.", "0., 3., 0."),
    "an arc turned about its end": (
        ARC,
        "START, 0., 0.\nCIRCL, 0., 4., 0., 2.",
        "-2., 3.\n-2., 3., 0., -2., 3., 1., -90.",
    ),
}


@pytest.mark.parametrize("name", PROFILES)
def test_profiles_in_the_plane_go_with_their_instance(press, name):
    there, before, placed = PROFILES[name]
    wanted = press(2, "SEGMENTS", there)
    assert press(2, "SEGMENTS", before, placed, "0., 0., 0.") == pytest.approx(wanted, abs=1e-9)


SPACE = {
    "a cylinder along x": (
        "CYLINDER",
        "0., 0., 2., 0., 1., 2.\n1., 0., 2.\nSTART, -1., 0.\nCIRCL, 1., 0., 0., 0.",
        "START, -1., 0.\nCIRCL, 1., 0., 0., 0.",
        "0., 0., 2.\n0., 0., 2., 0., 1., 2., 90.",
    ),
    "a sphere about y": (
        "REVOLUTION",
        "0., 0., 3., 0., 0., 4.\nSTART, 0., -2.\nCIRCL, 2., 0., 0., 0.",
        "START, 0., -2.\nCIRCL, 2., 0., 0., 0.",
        "0.1, 0., 3.\n0., 0., 3., 1., 0., 3., 90.",
    ),
    "a plane across its axis": (
        "REVOLUTION",
        "0., 0., 1., 0., 0., 2.\nSTART, 0., 0.\nLINE, 9., 0.",
        "START, 0., 0.\nLINE, 9., 0.",
        "0., 0., 1.\n0., 0., 1., 1., 0., 1., 90.",
    ),
    "a plane along its generator": (
        "CYLINDER",
        "0., 0., 1., 1., 0., 1.\n0., 1., 1.\nSTART, -5., 0.\nLINE, 5., 0.",
        "START, -5., 0.\nLINE, 5., 0.",
        "0., 0., 1.\n0., 0., 1., 1., 0., 1., 90.",
    ),
}


CAE = """*Heading
** Job name: press Model name: pr\u00fcfung
*Preprint, echo=NO, model=NO, history=NO, contact=NO
*Part, name=Body
*Node
      1,           0.,           0.
      2,           2.,           0.
      3,           2.,           1.
      4,           0.,           1.
*Element, type=CPE4H
1, 1, 2, 3, 4
*Nset, nset=Set-1, generate
 1,  4,  1
*Elset, elset=Set-1
 1,
** Section: Section-1
*Solid Section, elset=Set-1, controls=EC-1, material="Silicone, soft"
,
*End Part
*Part, name=Tool
*End Part
*Assembly, name=Assembly
*Instance, name=Body-1, part=Body
*End Instance
*Instance, name=Tool-1, part=Tool
          0.,           1.,           0.
*Node
      1,           0.,           0.,           0.
*Nset, nset=Tool-1-RefPt_, internal
1,
*Surface, type=SEGMENTS, name=RigidSurface_, internal
START,          -5.,           0.
 LINE,           5.,           0.
*Rigid Body, ref node=Tool-1-RefPt_, analytical surface=RigidSurface_
*End Instance
*Nset, nset=Ref, instance=Tool-1
 1,
*Nset, nset=Bottom, instance=Body-1
 1, 2
*Elset, elset=_S_S3, internal, instance=Body-1
 1,
*Surface, type=ELEMENT, name=S
_S_S3, S3
*End Assembly
*Section Controls, name=EC-1, hourglass=ENHANCED
1., 1., 1.
*Material, name="Silicone, soft"
*Hyperelastic, neo hooke
0.5, 0.01
*Surface Interaction, name=IntProp-1
1.,
*Friction, slip tolerance=0.005
 0.3,
*Surface Behavior, pressure-overclosure=HARD
*Contact Pair, interaction=IntProp-1, type=SURFACE TO SURFACE
S, Tool-1.RigidSurface_
*Boundary
Bottom, ENCASTRE
*Step, name=Step-1, nlgeom=YES, inc=1000
*Static
0.5, 1., 1e-05, 1.
*Boundary
Ref, 1, 1
Ref, 2, 2, -0.1
Ref, 6, 6
*Restart, write, frequency=0
*Output, field, variable=PRESELECT
*Output, history, variable=PRESELECT
*End Step
"""


def test_a_deck_as_cae_writes_it(tmp_path):
    (tmp_path / "deck.inp").write_bytes(CAE.encode("latin-1"))
    _, steps = solve_deck(tmp_path / "deck.inp")
    assert steps[-1].arrived
    shear, bulk = 1.0, 200.0
    stiffness = 100 * 9 * bulk * shear / (3 * bulk + shear)
    top = steps[-1].displacement[[2, 3], 1]
    # overclosure times stiffness is the pressure
    assert steps[-1].internal[-1, 1] == pytest.approx(-2 * stiffness * (0.1 + top.mean()), rel=1e-9)
    assert -0.1 < top.max() < -0.096


@pytest.mark.parametrize("name", SPACE)
def test_surfaces_in_space_go_with_their_instance(press, name):
    """A part has its profile in x and y, swept along z or turned about y, as ABAQUS/CAE writes it."""
    kind, there, before, placed = SPACE[name]
    if name.startswith("a sphere"):
        there = there.replace("0., 0., 3., 0., 0., 4.", "0.1, 0., 3., 0.1, 0., 4.")
    wanted = press(3, kind, there)
    assert press(3, kind, before, placed) == pytest.approx(wanted, abs=1e-9)


def test_a_rotation_out_of_the_plane_is_refused(press):
    with pytest.raises(InputError, match=r"line \d+, \*INSTANCE: found a rotation out of the plane"):
        press(2, "SEGMENTS", LINE, "0., 0.\n0., 0., 0., 1., 0., 0., 180.")


@pytest.mark.parametrize(
    "left_out, message",
    [
        ("*END INSTANCE\n*INSTANCE", r"line \d+, \*INSTANCE: found an instance within another"),
        ("*END INSTANCE\n*END ASSEMBLY", r"line \d+, \*INSTANCE: found no end of it"),
        ("*END PART\n*ASSEMBLY", r"\*PART: found no end of it"),
    ],
)
def test_parts_and_instances_have_an_end(press, monkeypatch, left_out, message):
    monkeypatch.setitem(globals(), "DECK", DECK.replace(left_out, left_out.split("\n")[1]))
    with pytest.raises(InputError, match=message):
        press(2, "SEGMENTS", LINE)


@pytest.mark.parametrize("row", ["0., 0., 0., 0., 0., 0., 90.", "1., 2.", "0., 0., 0., 0., 0., 1., 90., 1."])
def test_an_axis_that_is_none_is_refused(press, row):
    with pytest.raises(InputError, match=r"line \d+, \*INSTANCE: .*two points on the axis"):
        press(2, "SEGMENTS", LINE, f"0., 0.\n{row}")


SHEET = """*PART, NAME=SHEET
*NODE
1, 0., 0.
2, 2., 0.
3, 2., 1.
4, 0., 1.
*ELEMENT, TYPE=CPE4, ELSET=E
1, 1, 2, 3, 4
*ORIENTATION, NAME=O
{axes}
*SOLID SECTION, ELSET=E, MATERIAL=F, ORIENTATION=O
{more}*END PART
*ASSEMBLY, NAME=A
*INSTANCE, NAME=I, PART=SHEET
{placed}
*END INSTANCE
*END ASSEMBLY
*MATERIAL, NAME=F
*ANISOTROPIC HYPERELASTIC, HOLZAPFEL, LOCAL DIRECTIONS=1
0.02, 0.1, 0.5, 0.9, 0.1
*BOUNDARY
I.1, 1, 2
I.4, {across}
*STEP, NLGEOM
*STATIC
*CLOAD
I.2, {across}, 0.01
I.3, {across}, 0.01
*END STEP
"""


def test_fibres_turn_with_their_part(tmp_path):
    """Turned by 90 degrees and pulled along the turned sheet, it answers as the sheet at rest."""
    given = {"axes": "1., 0.5, 0., 0., 1., 0.", "more": ""}
    found = []
    for placed, across in (("0., 0.", 1), ("5., 1.\n5., 1., 0., 5., 1., 1., 90.", 2)):
        (tmp_path / "deck.inp").write_text(SHEET.format(**given, placed=placed, across=across))
        found.append(solve_deck(tmp_path / "deck.inp")[1][-1].displacement)
    assert np.abs(found[0][2, 1]) > 1e-3  # the fibres are slanted: it shears
    turned = found[0] @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert found[1] == pytest.approx(turned, abs=1e-7)


def test_springs_of_a_part_that_turns_are_refused(tmp_path):
    spring = "*ELEMENT, TYPE=SPRING1, ELSET=G\n9, 2\n*SPRING, ELSET=G\n1\n2.\n"
    given = {"axes": "1., 0., 0., 0., 1., 0.", "across": 2, "more": spring}
    turned = SHEET.format(**given, placed="0., 0.\n0., 0., 0., 0., 0., 1., 90.")
    (tmp_path / "deck.inp").write_text(turned)
    with pytest.raises(InputError, match=r"line 19, \*INSTANCE: found a rotation of \*SPRING"):
        solve_deck(tmp_path / "deck.inp")
