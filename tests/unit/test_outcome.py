"""A solution is finite, of shapes that belong together, and converged or diverged; else there is none."""

import numpy as np
import pytest

from fingerfit.core.errors import SolverError, StateError
from fingerfit.core.files import write_npz
from fingerfit.solvers.answer import ended
from fingerfit.solvers.calculix_output import diverged, finished, read_dat
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Outcome

WHOLE = {"displacement": np.zeros((2, 5, 2)), "reaction": np.zeros((2, 2)), "indenter": np.zeros((2, 2))}


def put(name, value):
    """An array with another number in it."""
    array = WHOLE[name].copy()
    array.flat[-1] = value
    return {name: array}


DAMAGED = {
    "NaN": (put("displacement", np.nan), "whose displacement is not finite"),
    "infinite force": (put("reaction", -np.inf), "whose reaction is not finite"),
    "NaN of the indenter": (put("indenter", np.nan), "whose indenter is not finite"),
    "a step too few": (
        {"reaction": np.zeros((1, 2))},
        r"of shapes \(2, 5, 2\), \(1, 2\), \(2, 2\), which do not belong",
    ),
    "an axis too many": ({"indenter": np.zeros((2, 3))}, "which do not belong together"),
    "flat": ({"displacement": np.zeros((2, 10))}, "which do not belong together"),
    "another status": ({"status": "ok"}, "of status ok, which is neither converged nor diverged"),
    "no step": ({name: array[:0] for name, array in WHOLE.items()}, "a converged solution without steps"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_what_is_no_solution_is_not_made_and_not_read(tmp_path, name):
    changes, told = DAMAGED[name]
    content = {"status": CONVERGED, **WHOLE, **changes}
    with pytest.raises(StateError, match=told):
        Outcome(**content)
    path = tmp_path / "solution.npz"
    arrays = {key: np.asarray(value) for key, value in content.items()}
    write_npz(path, {**arrays, "message": np.array(""), "iterations": np.zeros(0, int)})
    with pytest.raises(StateError, match=rf"solution\.npz: is .*{told}"):
        Outcome.load(path)


def test_a_diverged_guess_may_have_no_step():
    assert Outcome(DIVERGED, **{name: array[:0] for name, array in WHOLE.items()}).steps == 0


# as CalculiX 2.20 prints them
CUT_BACK = """ STEP            1

 divergence; the increment size is decreased to 3.906250e-03
 the increment is reattempted

 STEP            2
"""


@pytest.mark.parametrize(
    ("end", "step"),
    [
        (" *ERROR: too many cutbacks\n best solution and residuals are in the frd file\n", 2),
        (" *ERROR: increment size smaller than minimum\n best solution and residuals are in the frd file\n", 2),
        (" *ERROR in nonlingeo: max. # of increments reached\n", 2),
        ("\n Job finished\n", None),
        # it was stopped after a smaller increment for divergence: that is no word of the end
        ("", None),
        (" *ERROR in u_calloc: error allocating memory\n", None),
    ],
)
def test_only_its_last_word_is_no_equilibrium(end, step):
    assert diverged(CUT_BACK + end) == step
    assert finished(CUT_BACK + end) == ("Job finished" in end)


HEAD = " displacements (vx,vy,vz) for set ALL and time  {}\n\n"
ROW = "         {} -2.130415E-01 -4.505401E-02  {}\n"
TABLE = HEAD.format("0.1000000E+01") + ROW.format(1, "0.000000E+00") + ROW.format(2, "1.234567-101")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (TABLE[:-1], "ends within a line"),
        (TABLE + "         3 -2.130415E-01\n", "found '3 -2.130415E-01'; expected a node and three numbers"),
        (TABLE + "         x -2.130415E-01 0. 0.\n", "expected a node and three numbers"),
        (TABLE + TABLE.replace("2.13", "2.14"), "two tables at 1 s with other numbers"),
    ],
)
def test_rows_of_a_dat_file(text, told):
    with pytest.raises(SolverError, match=told):
        read_dat(text, [1.0], ["U ALL"], "calculix: deck.inp")


def test_numbers_of_a_dat_file():
    (tables,) = read_dat(TABLE + "\n" + TABLE, [1.0], ["U ALL"], "calculix: deck.inp")
    assert tables["U ALL"][1].tolist() == [2.0, -0.2130415, -0.04505401, 1.234567e-101]
    (tables,) = read_dat(TABLE.replace("1.234567-101", "************"), [1.0], ["U ALL"], "calculix: deck.inp")
    assert np.isnan(tables["U ALL"][1, 3])


def test_how_a_program_ended_is_said_in_words():
    assert [ended(code) for code in (3, -9, -11, -77)] == [
        "exit code 3", "ended by SIGKILL, perhaps out of memory", "ended by SIGSEGV", "ended by signal 77",
    ]  # fmt: skip
