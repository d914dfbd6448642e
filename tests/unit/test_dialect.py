"""What ABAQUS gets: its own words, and the same deck to a reader that knows both."""

import numpy as np
import pytest
from blocks import CUBE

from fingerfit.cli import main
from fingerfit.core.errors import InputError
from fingerfit.deck.cards import read_cards
from fingerfit.deck.dialect import to_abaqus
from fingerfit.deck.reader import read_deck
from fingerfit.deck.write import format_deck
from fingerfit.solvers.builtin import BuiltinSolver

BLOCK = f"""\
{CUBE}9, .5, .5, 1.
10, .5, .5, 1.
*NSET, NSET=TOP
5, 6, 7, 8
*NSET, NSET=BOTTOM
1, 2, 3, 4
*NSET, NSET=INDENTER
9
*NSET, NSET=TURN
10
*ELEMENT, TYPE=C3D8, ELSET=ALL
1, 1, 2, 3, 4, 5, 6, 7, 8
*MATERIAL, NAME=M
*ELASTIC
1., 0.3
*SOLID SECTION, ELSET=ALL, MATERIAL=M
*RIGIDBODY, NSET=TOP, REFNODE=9, ROTNODE=10
*BOUNDARY
BOTTOM, 1, 3
10, 1, 2
*STEP, NLGEOM
*STATIC, SOLVER=SPOOLES
1., 1.
*BOUNDARY
INDENTER, 1, 2
INDENTER, 3, 3, -0.1
TURN, 3, 3, 0.2
*NODE PRINT, NSET=ALL, TOTALS=ONLY
RF
*ENDSTEP
"""


def text_of(path):
    return "\n".join(line for card in to_abaqus(read_cards(path), read_deck(path)) for line in card.lines()) + "\n"


@pytest.fixture
def translate(tmp_path):
    def make(text):
        path = tmp_path / "deck.inp"
        path.write_text(text)
        (tmp_path / "abaqus.inp").write_text(text_of(path))
        return (tmp_path / "abaqus.inp").read_text(), path, tmp_path / "abaqus.inp"

    return make


def test_a_rigid_body(translate, tmp_path):
    text, before, after = translate(BLOCK)
    assert "*RIGID BODY, TIE NSET=TOP, REF NODE=9\n" in text
    assert "ROT" not in text
    assert "\n9, 4, 5\n" in text
    assert "\n9, 6, 6, 0.2\n" in text
    assert "TURN," not in text
    assert "*STATIC\n" in text
    assert "*END STEP\n" in text
    assert "PRINT" not in text
    first, second = (BuiltinSolver().solve(path, tmp_path) for path in (before, after))
    # ROT NODE itself is the only one that moves otherwise
    assert np.abs(first.displacement[0, :9] - second.displacement[0, :9]).max() < 1e-12
    assert np.abs(first.displacement[0, 4:8]).max() > 0.1


def test_in_the_plane_only_the_third_axis_turns(translate):
    flat = BLOCK.replace("C3D8", "CPE4").replace("1, 1, 2, 3, 4, 5, 6, 7, 8", "1, 1, 2, 3, 4")
    flat = flat.replace("NSET=TOP\n5, 6, 7, 8", "NSET=TOP\n3, 4").replace(
        "NSET=BOTTOM\n1, 2, 3, 4", "NSET=BOTTOM\n1, 2"
    )
    flat = flat.replace("BOTTOM, 1, 3", "BOTTOM, 1, 2").replace("INDENTER, 3, 3, -0.1\n", "")
    text, _, _ = translate(flat)
    # the displacements of a ROT NODE along 1 and 2 mean nothing there
    assert "\n9, 6, 6, 0.2\n" in text
    assert "\n9, 4" not in text
    assert "\n10, 1, 2\n" not in text


def test_moments(translate):
    text, _, _ = translate(BLOCK.replace("TURN, 3, 3, 0.2", "*CLOAD\nTURN, 3, 0.01"))
    assert "*CLOAD\n9, 6, 0.01\n" in text


def test_a_set_of_both_kinds_is_refused(translate):
    with pytest.raises(InputError, match=r"deck\.inp: line 30, \*BOUNDARY: found MIXED; expected .* ROT NODE"):
        translate(BLOCK.replace("*BOUNDARY\nBOTTOM, 1, 3", "*NSET, NSET=MIXED\n1, 10\n*BOUNDARY\nMIXED, 1, 3"))


def test_numbers_that_mean_something_else(translate):
    contact = (
        "*SURFACE, NAME=F, TYPE=NODE\nBOTTOM\n*SURFACE, NAME=G\nALL, S2\n*SURFACE INTERACTION, NAME=I\n"
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n5., 1e-4\n*FRICTION\n0.3, 5.\n"
        "*TIE, POSITION TOLERANCE=0.1\nF, G\n*INITIAL CONDITIONS, TYPE=STRESS\n"
        + "".join(f"1, {point}, 1., 2., 3., 4., 5., 6.\n" for point in (1, 2))
    )
    text, _, _ = translate(BLOCK.replace("*BOUNDARY", contact + "*BOUNDARY", 1))
    assert "LINEAR\n5.\n" in text
    assert "*FRICTION\n0.3\n" in text
    assert "*TIE, NAME=TIE-1, POSITION TOLERANCE=0.1\n" in text
    assert "TYPE=STRESS\n1, 1., 2., 3., 4., 5., 6.\n*BOUNDARY" in text


def test_shown_decks_are_read_back(translate, tmp_path):
    _, before, _ = translate(BLOCK)
    (tmp_path / "shown.inp").write_text(format_deck(read_deck(before)))
    assert "*RIGID BODY, TIE NSET=RIGID-1, REF NODE=9\n" in text_of(tmp_path / "shown.inp").replace(
        "REF NODE=9, TIE NSET=RIGID-1", "TIE NSET=RIGID-1, REF NODE=9"
    )


def test_cards_are_what_they_were(tmp_path):
    path = tmp_path / "deck.inp"
    many = "".join(f", A{n}=12345" for n in range(20))
    path.write_text(
        '*FIRST, NAME="with blank", TYPE=NODE TO SURFACE, THREE\n1, 2\n*SECOND,\n  FOUR=4\n' + "*LONG" + many + "\n"
    )
    cards = list(read_cards(path))
    (tmp_path / "again.inp").write_text("\n".join(line for card in cards for line in card.lines()))
    again = list(read_cards(tmp_path / "again.inp"))
    assert [(c.name, c.options, [t for _, t in c.data]) for c in again] == [
        (c.name, c.options, [t for _, t in c.data]) for c in cards
    ]
    assert '*FIRST, NAME="with blank", TYPE=NODE TO SURFACE, THREE' in (tmp_path / "again.inp").read_text()
    assert max(map(len, (tmp_path / "again.inp").read_text().splitlines())) < 132


def test_it_is_shown(tmp_path, capsys):
    (tmp_path / "deck.inp").write_text(BLOCK)
    assert main(["deck", "show", "--abaqus", str(tmp_path / "deck.inp")]) == 0
    assert capsys.readouterr().out == text_of(tmp_path / "deck.inp")
