"""Loads and constraints in a deck: which of them a step keeps, and the axes and nodes that they may name."""

import numpy as np
import pytest
from blocks import CUBE, RECTANGLE
from solving import solve_deck

from fingerfit.core.errors import InputError
from fingerfit.deck.reader import read_deck
from fingerfit.deck.write import format_deck

SQUARE = f"""{RECTANGLE}*ELEMENT, TYPE=CPE4, ELSET=E
1, 1, 2, 3, 4
*SURFACE, NAME=UP
E, S3
*SURFACE, NAME=RIGHT
E, S2
*SOLID SECTION, ELSET=E, MATERIAL=M
*MATERIAL, NAME=M
*ELASTIC
10., 0.25
*BOUNDARY
1, 1, 2
2, 2
"""
SOLID = f"""{CUBE}*ELEMENT, TYPE=C3D8, ELSET=E
1, 1, 2, 3, 4, 5, 6, 7, 8
*SOLID SECTION, ELSET=E, MATERIAL=M
*MATERIAL, NAME=M
*ELASTIC
10., 0.25
"""


def step(*lines):
    return "\n".join(["*STEP, NLGEOM", "*STATIC", *lines, "*END STEP", ""])


@pytest.fixture
def run(tmp_path):
    def run(text):
        (tmp_path / "deck.inp").write_text(text)
        deck, steps = solve_deck(tmp_path / "deck.inp")
        assert steps[-1].arrived
        return deck, steps[-1].displacement

    return run


TWICE = {
    "CLOAD": ("3, 1, 0.1", "4, 1, 0.1"),
    "DLOAD": ("E, P2, 0.2", "E, P3, 0.1"),
    "DSLOAD": ("RIGHT, P, 0.2", "UP, P, 0.1"),
    "BOUNDARY": ("3, 1, 1, 0.1", "4, 1, 1, 0.1"),
}


@pytest.mark.parametrize("keyword", TWICE)
def test_new_loads_replace_those_of_earlier_steps_only(run, keyword):
    """ABAQUS: OP=NEW lets go what earlier steps gave, not what the same step gave before it."""
    first, second = TWICE[keyword]
    kept = "*BOUNDARY, OP=NEW\n1, 1, 2\n2, 2" if keyword == "BOUNDARY" else f"*{keyword}, OP=NEW"
    together = step(kept, f"*{keyword}", first, second)
    _, wanted = run(SQUARE + together)
    for options in ((", OP=NEW", ", OP=NEW"), ("", ", OP=NEW"), (", OP=NEW", "")):
        given = step(kept, f"*{keyword}{options[0]}", first, f"*{keyword}{options[1]}", second)
        _, found = run(SQUARE + given)
        assert found == pytest.approx(wanted, rel=1e-12)
    assert np.abs(wanted).max() > 1e-3
    earlier = step(f"*{keyword}", first.replace("0.1", "0.3").replace("0.2", "0.3"))
    _, found = run(SQUARE + earlier + together)
    assert found == pytest.approx(wanted, abs=1e-8)
    _, alone = run(SQUARE + earlier + step(kept, f"*{keyword}, OP=NEW", second))
    _, only = run(SQUARE + step(kept, f"*{keyword}", second))
    assert alone == pytest.approx(only, abs=1e-8)


def test_what_is_fixed_stays_where_forces_have_left_it(run):
    """ABAQUS and CalculiX: *BOUNDARY, FIXED holds what there is when the step begins, until something else is said."""
    pushed = step("*CLOAD", "3, 1, 0.1")
    _, wanted = run(SQUARE + pushed)
    held = step("*BOUNDARY, FIXED", "3, 1, 1", "*CLOAD", "3, 1, 0.")
    _, found = run(SQUARE + pushed + held + step("*DLOAD", "E, P3, 0.01"))
    assert found[2, 0] == pytest.approx(wanted[2, 0], rel=1e-12)
    assert found[3, 1] != pytest.approx(wanted[3, 1], rel=1e-3)
    deck, found = run(SQUARE + pushed + held + step("*BOUNDARY", "3, 1, 1, 0.02"))
    assert found[2, 0] == pytest.approx(0.02, rel=1e-12)
    assert [one.kept for one in deck.steps] == [set(), {(2, 0)}, set()]
    free = step("*BOUNDARY, OP=NEW", "1, 1, 2", "2, 2", "*CLOAD", "3, 1, 0.1")
    _, found = run(SQUARE + pushed + held + step("*BOUNDARY", "3, 1, 1, 0.02") + free)
    assert found == pytest.approx(wanted, abs=1e-8)


def test_a_deck_with_what_is_fixed_is_written_and_read_again(run):
    text = SQUARE + step("*CLOAD", "3, 1, 0.1") + step("*BOUNDARY, FIXED", "3, 1, 1") + step("*CLOAD", "4, 1, 0.1")
    deck, wanted = run(text)
    again, found = run(format_deck(deck))
    assert [one.kept for one in again.steps] == [one.kept for one in deck.steps] == [set(), {(2, 0)}, {(2, 0)}]
    assert found == pytest.approx(wanted, abs=1e-12)


def test_pressures_on_elements_and_on_surfaces_are_let_go_one_by_one(run):
    both = step("*DLOAD", "E, P2, 0.2", "*DSLOAD", "UP, P, 0.1")
    deck, _ = run(SQUARE + both + step("*DLOAD, OP=NEW"))
    assert deck.steps[-1].pressure == {(0, 2): 0.1}
    deck, _ = run(SQUARE + both + step("*DSLOAD, OP=NEW"))
    assert deck.steps[-1].pressure == {(0, 1): 0.2}


NONLINEAR = "*ELEMENT, TYPE=SPRING1, ELSET=G\n9, 2\n10, 3\n*SPRING, ELSET=G, NONLINEAR\n1\n{}\n"
BETWEEN = "*ELEMENT, TYPE=SPRING2, ELSET=H\n11, 3, 2\n*SPRING, ELSET=H, NONLINEAR\n2, 1\n0., -1.\n0.2, 0.01\n0.3, 1.\n"


def test_a_deck_with_nonlinear_springs_is_written_and_read_again(run):
    linear = "*ELEMENT, TYPE=SPRING1, ELSET=L\n12, 4\n*SPRING, ELSET=L\n1\n0.3\n"
    text = SQUARE + NONLINEAR.format("-1., -0.1\n0., 0.\n0.05, 0.01\n0.06, 1.") + BETWEEN + linear
    deck, wanted = run(text + step("*CLOAD", "3, 1, 0.4"))
    again, found = run(format_deck(deck))
    assert again.springs == deck.springs
    assert [len(spring.table) for spring in again.springs] == [4, 4, 3, 0]
    assert again.springs[2].second == (1, 0)
    assert found == pytest.approx(wanted, abs=1e-12)


UNREADABLE = {
    "0., 0.": "line 22, .SPRING: found 1 lines of force and relative displacement; expected two or more",
    "": "line 22, .SPRING: found 0 lines",
    "0., 0.\n1., 0.1\n2., 0.1": "line 26, .SPRING: found displacement 0.1 after 0.1; expected displacements that ascend",
    "0., 0.\n-1., -0.1": "line 25, .SPRING: found displacement -0.1 after 0;",
    "0., 0.\n1., 0.1, 2.": "line 25, .SPRING: found 1., 0.1, 2.; expected force and relative displacement",
    "0., 0., 1.\n1., 0.1, 1.": "line 24, .SPRING: found 0., 0., 1.; expected force and relative displacement",
    "0., 0.\n1.": "line 25, .SPRING: found 1.; expected force and relative displacement",
    "0., 0.\n, 1.": "line 25, .SPRING: found , 1.; expected force and relative displacement",
    "0., 0.\n1., much": "line 25, .SPRING: found much; expected a number",
}


@pytest.mark.parametrize("rows", UNREADABLE, ids=lambda rows: rows.replace("\n", "|"))
def test_tables_of_springs_that_make_no_sense_are_refused_with_their_line(tmp_path, rows):
    (tmp_path / "deck.inp").write_text(SQUARE + NONLINEAR.format(rows).replace("\n\n", "\n") + step())
    with pytest.raises(InputError, match=UNREADABLE[rows]) as caught:
        read_deck(tmp_path / "deck.inp")
    assert "deck.inp" in str(caught.value) and "\n" not in str(caught.value)


AXES = {
    "CLOAD 0": (step("*CLOAD", "4, 0, 0.1"), "line 22, .CLOAD: found axis 0; expected an axis from 1 to 6"),
    "CLOAD 7": (step("*CLOAD", "4, 7, 0.1"), "line 22, .CLOAD: found axis 7"),
    "CLOAD 3 in the plane": (step("*CLOAD", "4, 3, 5."), "line 22, .CLOAD: found axis 3 of node 4; expected .* 1 to 2"),
    "CLOAD 6": (step("*CLOAD", "4, 6, 5."), "line 22, .CLOAD: found axis 6 of node 4"),
    "BOUNDARY 0": (step("*BOUNDARY", "4, 0, 0, 0.5"), "line 22, .BOUNDARY: found axis 0"),
    "BOUNDARY 7 to 9": (step("*BOUNDARY", "4, 7, 9"), "line 22, .BOUNDARY: found axis 7"),
    "BOUNDARY to 9": (step("*BOUNDARY", "4, 1, 9"), "line 22, .BOUNDARY: found axis 9"),
    "BOUNDARY backwards": (step("*BOUNDARY", "4, 2, 1"), "line 22, .BOUNDARY: .*not below the first"),
    "BOUNDARY FIXED": (step("*BOUNDARY, FIXED", "4, 1, 1, 0.5"), "line 22, .BOUNDARY: .*no value where FIXED keeps"),
    "BOUNDARY 6": (step("*BOUNDARY", "4, 6, 6, 0.1"), "line 22, .BOUNDARY: found axis 6 of node 4"),
    "EQUATION 0": ("*EQUATION\n2\n3, 0, 1., 4, 1, -1.\n" + step(), "line 21, .EQUATION: found axis 0"),
    "EQUATION 3": ("*EQUATION\n2\n3, 3, 1., 4, 3, -1.\n" + step(), "line 21, .EQUATION: found axis 3 of node 3"),
    "SPRING 0": ("*ELEMENT, TYPE=SPRING1, ELSET=G\n9, 2\n*SPRING, ELSET=G\n0\n2.\n" + step(), "line 22, .*axis 0"),
    "SPRING 3": (
        "*ELEMENT, TYPE=SPRING2, ELSET=G\n9, 2, 3\n*SPRING, ELSET=G\n1, 3\n2.\n" + step(),
        "line 21, .SPRING: found axis 3 of node 3",
    ),
}


@pytest.mark.parametrize("name", AXES)
def test_axes_that_a_node_has_not_are_refused(tmp_path, name):
    text, message = AXES[name]
    (tmp_path / "deck.inp").write_text(SQUARE + text)
    with pytest.raises(InputError, match=message):
        read_deck(tmp_path / "deck.inp")


@pytest.mark.parametrize("held", ["1, ENCASTRE", "1, PINNED", "1, 1, 6", "1, 1, 3", "1, 1, 2\n1, 6"])
def test_nodes_of_solids_may_be_held_at_axes_that_they_have_not(run, held):
    """As ABAQUS/CAE writes them; they are at rest there anyway."""
    pull = step("*CLOAD", "3, 1, 0.1")
    _, wanted = run(SQUARE + pull)
    _, found = run(SQUARE.replace("*BOUNDARY\n1, 1, 2", f"*BOUNDARY\n{held}") + pull)
    assert found == pytest.approx(wanted)
    text = SOLID + "*BOUNDARY\n1, 1, 6\n2, ENCASTRE\n3, 1, 6\n4, PINNED\n" + step("*CLOAD", "5, 3, 0.1")
    assert run(text)[1][4, 2] > 1e-3


def test_rotations_belong_to_reference_nodes(run):
    body = "*NODE\n20, 2., 0.5\n*NSET, NSET=END\n2, 3\n*RIGID BODY, REF NODE=20, {}NSET=END\n{}"
    text = SQUARE.replace("2, 2\n", "4, 1\n")
    _, by_reference = run(text + body.format("", "") + step("*CLOAD", "20, 6, 0.1"))
    node = "*NODE\n21, 0., 0.\n"
    _, by_node = run(text + node + body.format("ROT NODE=21, ", "") + step("*CLOAD", "21, 3, 0.1"))
    assert np.abs(by_reference[2]).max() > 1e-3
    assert by_node[:4] == pytest.approx(by_reference[:4])
    with pytest.raises(InputError, match="axis 6 of node 20"):
        run(text + node + body.format("ROT NODE=21, ", "") + step("*CLOAD", "20, 6, 0.1"))
    with pytest.raises(InputError, match="axis 4 of node 20"):
        run(text + body.format("", "") + step("*CLOAD", "20, 4, 0.1"))


UNDEFINED = {
    "*SOLID SECTION, ELSET=E, MATERIAL=M\n": "line 19, .SOLID SECTION: found elements of E in another section too",
    "*NSET, NSET=A\n1, 99\n": "line 20, .NSET: found node 99; expected nodes that are defined",
    "*NSET, NSET=A, GENERATE\n1, 5\n": "line 20, .NSET: found node 5",
    "*ELSET, ELSET=A\n1, 7\n": "line 20, .ELSET: found element 7; expected elements that are defined",
    "*ELEMENT, TYPE=CPE4\n2, 1, 2, 3, 9\n": "line 20, .ELEMENT: found node 9",
    "*ELEMENT, TYPE=SPRING1\n2, 9\n": "line 20, .ELEMENT: found node 9",
    "*INITIAL CONDITIONS, TYPE=STRESS\n7, 1.\n": "line 20, .INITIAL CONDITIONS: found element 7",
    "*SURFACE, NAME=S\n7, S1\n": "line 20, .SURFACE: found element 7",
    "*SURFACE, NAME=S\nE, S6\n": "line 20, .SURFACE: found face 6 of element 1; expected faces 1 to 4",
    "*SURFACE, NAME=S\nE, SPOS\n": "line 20, .SURFACE: found SPOS or SNEG of element 1",
    step("*DLOAD", "E, P7, 1."): "line 22, .DLOAD: found face 7 of element 1",
    step("*DLOAD", "7, P1, 1."): "line 22, .DLOAD: found element 7",
    "*SOLID SECTION, ELSET=NONE, MATERIAL=M\n": "line 19, .SOLID SECTION: found NONE; expected an element set",
    "*SOLID SECTION, ELSET=E, MATERIAL=N\n": "line 19, .SOLID SECTION: found N; expected a material",
    "*CONTACT PAIR, INTERACTION=I\nUP, RIGHT\n": "line 19, .CONTACT PAIR: found I; expected an interaction",
}


@pytest.mark.parametrize("text", UNDEFINED, ids=lambda t: t.split("\n")[-2] + t[:9])
def test_what_is_not_defined_is_refused_with_its_line(tmp_path, text):
    (tmp_path / "deck.inp").write_text(SQUARE + text + step())
    with pytest.raises(InputError, match=UNDEFINED[text]):
        read_deck(tmp_path / "deck.inp")


def test_numbers_may_be_left_out_between_the_first_and_the_last(run):
    sets = "*NSET, NSET=SOME, GENERATE\n3, 9\n*ELSET, ELSET=ANY, GENERATE\n1, 5, 2\n"
    more = "*NODE\n9, 0., 2.\n10, 2., 2.\n*ELEMENT, TYPE=CPE4, ELSET=E\n5, 4, 3, 10, 9\n"
    deck, found = run(SQUARE.replace("*SURFACE", more + "*SURFACE", 1) + sets + step("*CLOAD", "SOME, 1, 0.1"))
    assert deck.mesh.node_sets["SOME"].tolist() == [2, 3, 4]
    assert deck.mesh.element_sets["ANY"].tolist() == [0, 1]
    assert found[4, 0] > found[3, 0] > 1e-3


def test_sets_may_name_what_is_defined_later(run):
    sets = "*NSET, NSET=LATER\n3, 4\n*ELSET, ELSET=TOO\n1\n"
    deck, found = run(sets + SQUARE + step("*CLOAD", "LATER, 1, 0.1"))
    assert deck.mesh.node_sets["LATER"].tolist() == [2, 3]
    assert found[2, 0] > 1e-3
