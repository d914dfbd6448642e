"""The linear solvers agree, large systems are ordered well, and singular ones are told."""

import subprocess
import sys
import types

import numpy as np
import pytest
from conftest import phantom
from scipy.sparse import block_diag, diags_array, kron

from fingerfit.fem import factor
from fingerfit.fem.factor import LinearSolver, conjugate_gradients, dissect
from fingerfit.fem.levels import WIDEST, Levels
from fingerfit.fem.pattern import Pattern


def cube(n):
    """Matrix of n^3 points with three unknowns each, coupled as by linear bricks, and where the unknowns are."""
    line = diags_array([0.4, 1.0, 0.4], offsets=[-1, 0, 1], shape=(n, n))
    matrix = kron(kron(line, line), line)
    grid = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return kron(matrix, np.eye(3) + 0.1).tocsc(), np.repeat(grid.astype(float), 3, axis=0)


def rounding(matrix, solution):
    """Residual by rounding: eps of the largest sum of terms, and a factor for pivots of 0.001 of their column.

    The factor is five standard deviations above the mean: of 40 right sides, 380 with a standard deviation of 160 where the
    matrix is not symmetric and the order that of METIS; 0.7 where it is symmetric.
    """
    return 1180 * np.finfo(float).eps * float((abs(matrix) @ np.abs(solution)).max())


def test_nested_dissection_is_an_order_with_less_fill():
    from scipy.sparse.linalg import splu

    matrix, positions = cube(12)
    order = dissect(positions, matrix)
    assert np.array_equal(np.sort(order), np.arange(len(order)))
    options = {"diag_pivot_thresh": 0.001, "options": {"SymmetricMode": True}}
    ours = splu(matrix[order][:, order].tocsc(), permc_spec="NATURAL", **options).L.nnz
    assert ours < 0.6 * splu(matrix, permc_spec="NATURAL", **options).L.nnz
    assert ours < splu(matrix, permc_spec="MMD_AT_PLUS_A", **options).L.nnz


def test_a_pattern_keeps_what_was_added_once(rng):
    """Contact opens and closes: entries come and go, their places stay."""
    from scipy.sparse import coo_array

    first = coo_array(([1.0, 2.0, 3.0], ([0, 2, 1], [0, 1, 3])), shape=(4, 4))
    pattern = Pattern(np.sort(first.col.astype(np.int64) * 4 + first.row), 4)
    values = first.tocsc().data
    sizes = []
    for count in (0, 5, 3, 0, 9):
        rows, columns, added = rng.integers(0, 4, count), rng.integers(0, 4, count), rng.normal(size=count)
        whole = pattern.matrix(values, rows, columns, added)
        assert whole.toarray() == pytest.approx((first + coo_array((added, (rows, columns)), (4, 4))).toarray())
        assert whole.has_sorted_indices
        sizes.append(whole.nnz)
    assert sizes == sorted(sizes)
    before = whole.indices.copy()
    assert np.array_equal(pattern.matrix(values, rows[:2], columns[:2], added[:2]).indices, before)


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("n", [5, 11], ids=["small", "large"])
def test_solutions(rng, symmetric, n):
    matrix, positions = cube(n)
    assert (len(positions) >= factor.LARGE) == (n == 11)
    if not symmetric:
        matrix = (matrix + diags_array(np.linspace(0, 0.2, matrix.shape[0] - 1), offsets=1, shape=matrix.shape)).tocsc()
    solver = LinearSolver(positions, symmetric)
    for _ in range(2):
        right = rng.normal(size=matrix.shape[0])
        found = solver.solve(matrix, right)
        assert matrix @ found == pytest.approx(right, abs=rounding(matrix, found))
        matrix = 1.5 * matrix


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("n", [5, 11], ids=["small", "large"])
def test_the_same_matrix_is_factorised_once(rng, monkeypatch, symmetric, n):
    matrix, positions = cube(n)
    solver, seen = LinearSolver(positions, symmetric), []
    made = solver._factor
    monkeypatch.setattr(solver, "_factor", lambda matrix: seen.append(matrix) or made(matrix))
    for _ in range(3):
        right = rng.normal(size=matrix.shape[0])
        found = solver.solve(matrix, right)
        assert matrix @ found == pytest.approx(right, abs=rounding(matrix, found))
    assert len(seen) == 1


def test_superlu_alone_agrees(rng, monkeypatch):
    matrix, positions = cube(11)
    right = rng.normal(size=matrix.shape[0])
    first = LinearSolver(positions, True).solve(matrix, right)
    monkeypatch.setattr(factor._Pardiso, "load", classmethod(lambda cls, symmetric: None))
    assert LinearSolver(positions, True).solve(matrix, right) == pytest.approx(first, abs=1e-10)
    assert LinearSolver(None, True).solve(matrix, right) == pytest.approx(first, abs=1e-10)


@pytest.fixture
def taken(monkeypatch):
    """Which ways of factorising are gone, in order."""
    found = []

    def watch(owner, name, what):
        plain = getattr(owner, name)

        def watched(*values, **named):
            found.append(what)
            return plain(*values, **named)

        monkeypatch.setattr(owner, name, watched)

    watch(factor._Pardiso, "factor", "pardiso")
    watch(factor, "_superlu", "superlu")
    watch(factor, "dissect", "dissection")
    return found


@pytest.mark.parametrize("symmetric", [True, False])
def test_pardiso_is_taken_where_it_is_installed(rng, taken, symmetric):
    if factor._Pardiso.load(symmetric) is None:
        pytest.skip("pypardiso is not installed: make fast")
    for n, expected in ((5, ["superlu"]), (11, ["pardiso"])):
        matrix, positions = cube(n)
        assert (matrix.shape[0] >= factor.LARGE) == (n == 11)
        right = rng.normal(size=matrix.shape[0])
        found = LinearSolver(positions, symmetric).solve(matrix, right)
        assert matrix @ found == pytest.approx(right, abs=rounding(matrix, found))
        assert taken == expected
        taken.clear()


@pytest.mark.parametrize("missing", ["package", "library"])
def test_superlu_is_taken_where_pardiso_is_missing(rng, taken, monkeypatch, missing):
    """With nested dissection in space, with minimum degree in the plane and for small systems."""
    if missing == "package":
        monkeypatch.setitem(sys.modules, "pypardiso", None)
    else:

        class Broken(types.ModuleType):
            def PyPardisoSolver(self, mtype):
                raise OSError("libmkl_rt.so.2: cannot open shared object file")

        monkeypatch.setitem(sys.modules, "pypardiso", Broken("pypardiso"))
    large, positions = cube(11)
    small, _ = cube(5)
    cases = [(large, positions, ["dissection", "superlu"]), (large, positions[:, :2], ["superlu"])]
    for matrix, where, expected in [
        *cases,
        (large, None, ["superlu"]),
        (small, positions[: small.shape[0]], ["superlu"]),
    ]:
        right = rng.normal(size=matrix.shape[0])
        found = LinearSolver(where, True).solve(matrix, right)
        assert matrix @ found == pytest.approx(right, abs=rounding(matrix, found))
        assert taken == expected
        taken.clear()


def test_pardiso_is_not_even_loaded_for_small_systems(monkeypatch):
    asked = []
    monkeypatch.setattr(factor._Pardiso, "load", classmethod(lambda cls, symmetric: asked.append(symmetric)))
    for n, expected in ((5, []), (11, [False])):
        matrix, positions = cube(n)
        solver = LinearSolver(positions, False)
        for scale in (1.0, 3.0):
            assert solver.solve(scale * matrix, np.ones(matrix.shape[0])) is not None
        # once, though two systems were solved
        assert asked == expected


@pytest.mark.parametrize("n", [5, 11], ids=["small", "large"])
def test_a_singular_matrix_is_told(n):
    matrix, positions = cube(n)
    matrix = matrix.tolil()
    matrix[7, :] = 0.0
    matrix[:, 7] = 0.0
    assert LinearSolver(positions, True).solve(matrix.tocsc(), np.ones(matrix.shape[0])) is None


def test_an_old_factorisation_serves_as_long_as_it_is_near(rng):
    from scipy.sparse.linalg import splu

    matrix, _ = cube(8)
    right, old = rng.normal(size=matrix.shape[0]), splu(matrix).solve
    used = []

    def precondition(residual):
        used.append(0)
        return old(residual)

    contact = np.zeros(matrix.shape[0])
    contact[[10, 160, 310, 460]] = [0.3, 0.7, 1.4, 3.0]
    near = (1.1 * matrix + diags_array(contact)).tocsc()
    found = conjugate_gradients(near, right, precondition, 1e-8)
    # four changed unknowns and a scale are five eigenvalues: five steps are exact but for rounding, 1e-15 (40 seeds: 1e-14)
    assert near @ found == pytest.approx(right, abs=1e-10)
    assert len(used) == 1 + 5
    used.clear()
    rest = near @ conjugate_gradients(near, right, precondition, 0.3) - right
    # one or two steps are enough for 0.3, in the norm of the preconditioner, and far from exact (40 seeds: 0.035 to 0.29)
    assert 1e-3 < np.sqrt(rest @ old(rest) / (right @ old(right))) <= 0.3
    assert len(used) <= 3
    far = (matrix + diags_array(np.linspace(0, 1e4, matrix.shape[0]))).tocsc()
    assert conjugate_gradients(far, right, old) is None
    assert conjugate_gradients(-matrix, right, old) is None


def test_a_large_matrix_that_changed_much_is_factorised_anew(rng):
    matrix, positions = cube(11)
    solver, right = LinearSolver(positions, True), rng.normal(size=matrix.shape[0])
    for scale in (0.0, 1e4, 1e-3):
        changed = (matrix + diags_array(np.linspace(0, scale, matrix.shape[0]))).tocsc()
        assert changed @ solver.solve(changed, right) == pytest.approx(right, abs=1e-5)


def plate(n, rng):
    """Matrix of n x n points with two unknowns each and a loose pair, numbered at random, not symmetric in values."""
    line = diags_array([0.4, 1.0, 0.4], offsets=[-1, 0, 1], shape=(n, n))
    matrix = block_diag([kron(kron(line, line), np.ones((2, 2)) + np.eye(2)), np.eye(2)]).tocsc()
    matrix.data *= rng.uniform(0.8, 1.2, len(matrix.data))
    order = rng.permutation(matrix.shape[0])
    return matrix[order][:, order].tocsc()


def test_levels(rng):
    matrix = plate(9, rng)
    levels, right = Levels(matrix.indices, matrix.indptr), rng.normal(size=matrix.shape[0])
    assert np.array_equal(np.sort(np.concatenate(levels.parts)), np.arange(len(right)))
    assert len(levels.parts) >= 2 + 5 and max(map(len, levels.parts)) <= 2 * 17
    assert matrix @ levels.solve(matrix.data, right) == pytest.approx(right, abs=1e-10)
    singular = matrix.copy()
    singular.data[np.isin(singular.indices, [5])] = 0.0
    assert levels.solve(singular.data, right) is None


def test_levels_eliminate_a_matrix_once(rng, monkeypatch):
    matrix = plate(9, rng)
    levels, seen = Levels(matrix.indices, matrix.indptr), []
    inverse = np.linalg.inv
    monkeypatch.setattr(np.linalg, "inv", lambda block: seen.append(len(block)) or inverse(block))
    for values in (matrix.data, matrix.data, 1.5 * matrix.data):
        right = rng.normal(size=matrix.shape[0])
        matrix.data = values
        assert matrix @ levels.solve(values, right) == pytest.approx(right, abs=1e-10)
    assert len(seen) == 2 * len(levels.parts)


def test_levels_begin_at_a_side_where_that_is_narrower():
    """From a corner of a square they go round it."""
    line = diags_array([0.4, 1.0, 0.4], offsets=[-1, 0, 1], shape=(40, 40))
    matrix = kron(line, line).tocsc()
    positions = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0), indexing="ij"), axis=-1).reshape(-1, 2)
    assert Levels(matrix.indices, matrix.indptr).widest > WIDEST
    assert Levels(matrix.indices, matrix.indptr, positions).widest == 40


def test_small_systems_do_not_need_scipy(write_deck):
    """Its import takes longer than the solution of a guess."""
    deck, _ = write_deck(phantom("force", [7.0, 14.0]))
    program = (
        "import sys; from pathlib import Path; from fingerfit.solvers.builtin import BuiltinSolver\n"
        "deck = Path(sys.argv[1]); print(BuiltinSolver().solve(deck, deck.parent).status, 'scipy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program, deck], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["converged", "False"]
