"""The search at bounds: bounds that differ, starts and minima that lie on one, what is tied."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from seeds import generator

from fingerfit.model.parameters import Parameter, round_value
from fingerfit.search import Evaluation, Plan, Stage, propose
from fingerfit.search.stages import Space, Tie

TOL = 1e-3
INDEPENDENT = Stage("i", "independent", TOL, 1e-6, step=0.6)


def search(parameters, stages, score, limit=2000):
    history = []
    while not (proposal := propose(history, parameters, Plan(tuple(stages), 1, limit))).stop:
        history += [Evaluation(point, score(point)) for point in proposal.batch]
    return proposal, history


def layers(*bounds, starts=None):
    names = ("mu_top", "mu_middle", "mu_bottom")
    starts = starts or [np.sqrt(lower * upper) for lower, upper in bounds]
    return tuple(Parameter(n, "MPa", *b, float(s)) for n, b, s in zip(names, bounds, starts, strict=False))


def force(moduli):
    """Of layers on each other, under the same displacement."""
    return 1 / np.sum(1 / np.array(moduli))


def stack(truth):
    """Score of layers on each other: their force, and how the displacement is shared between them."""

    def score(point):
        shares = [force(mu) / np.array(mu) for mu in (point, truth)]
        return float(np.log(force(point) / force(truth)) ** 2 + np.sum((shares[0] - shares[1]) ** 2))

    return score


@pytest.mark.parametrize(
    ("parameters", "truth", "stages"),
    [
        # bounds that differ: all alike was not alike, and the simplex fell onto a bound (force 1.4 times too small)
        (layers((0.02, 0.15), (0.067, 28.0)), (0.043, 0.48), ["grid", "equal", "independent"]),
        # the last tied one starts at its bound: no vertex moved it (force 13 times too small)
        (layers((1e-3, 1.0), (1e-3, 1.0), (1e-3, 1.0), starts=(0.1, 0.1, 1e-3)), (0.03, 0.04, 0.05), ["independent"]),
        # the last one's step down ends at its bound
        (layers((1e-3, 1.0), (1e-3, 1.0), (0.099, 1.0), starts=(0.1, 0.1, 0.1)), (0.03, 0.04, 0.5), ["independent"]),
    ],
)
def test_unequal_bounds_and_starts_at_a_bound_do_not_hide_the_minimum(parameters, truth, stages):
    stages = [Stage(kind, kind, TOL, 1e-8) for kind in stages]
    proposal, _ = search(parameters, stages, stack(truth))
    assert proposal.stop == "tolerances met"
    # the score is flatter along the stiffer layers' moduli: ten times the tolerance (measured: four)
    assert np.log(proposal.best) == pytest.approx(np.log(truth), abs=10 * TOL)
    assert force(proposal.best) == pytest.approx(force(truth), rel=TOL)


def random_problem(rng):
    """Up to three parameters with random bounds and starts, and a quadratic score with its minimum within them."""
    parameters = []
    for n in range(rng.integers(1, 4)):
        log = rng.random() < 0.6
        lower = 10 ** rng.uniform(-4, -1) if log else rng.uniform(-5, 5)
        upper = lower * 10 ** rng.uniform(0.3, 3) if log else lower + 10 ** rng.uniform(-1, 1)
        start = np.exp(rng.uniform(np.log(lower), np.log(upper))) if log else rng.uniform(lower, upper)
        lower, upper = round_value(lower), round_value(upper)  # as people write them
        start = rng.choice([lower, min(max(start, lower), upper), upper], p=[0.25, 0.55, 0.2])
        parameters.append(Parameter(f"mu_{n}", "MPa", lower, upper, float(start), log))
    space, size = Space(tuple(parameters)), len(parameters)
    turn, _ = np.linalg.qr(rng.normal(size=(size, size)))
    # curvatures from 1 to 30 along any directions; the free minimum may lie beyond the bounds
    root = (turn * np.sqrt(30.0 ** rng.uniform(0, 1, size))) @ turn.T
    free = space.low + (space.high - space.low) * rng.uniform(-0.4, 1.4, size)
    minimum = lsq_linear(root, root @ free, (space.low, space.high), tol=1e-14).x
    return space, minimum, lambda point: float(np.sum((root @ (space.coordinates(point) - free)) ** 2))


@pytest.mark.parametrize("seed", [*range(8), *(pytest.param(n, marks=pytest.mark.slow) for n in range(8, 16))])
def test_the_end_is_the_minimum_wherever_bounds_starts_and_minima_lie(seed):
    space, minimum, score = random_problem(generator(seed))
    proposal, history = search(space.parameters, [INDEPENDENT], score)
    assert proposal.stop == "tolerances met"
    # of 250 seeds none was farther than three times the tolerance; before, 5 of these 16 were
    assert space.coordinates(proposal.best) == pytest.approx(minimum, abs=3 * TOL)
    assert all(p.lower <= x <= p.upper for e in history for p, x in zip(space.parameters, e.point, strict=True))


@pytest.mark.parametrize("seed", range(40))
def test_no_vertex_of_a_first_simplex_coincides_with_another(seed):
    rng = generator(seed)
    space, _, _ = random_problem(rng)
    names = [p.name for p in space.parameters if rng.random() < 0.6] or ["mu_0"]
    stage = Stage("i", "independent", step=10 ** rng.uniform(-2, 1), tied=tuple(names))
    first = propose([], space.parameters, Plan((stage,), 9)).batch
    vertices = np.array([space.coordinates(point) for point in first])[: len(space.parameters) + 1]
    edges = (vertices[1:] - vertices[0]) / np.minimum(stage.step, space.high - space.low)
    assert np.linalg.matrix_rank(edges, tol=1e-3) == len(space.parameters)


def test_tied_parameters_are_alike_within_the_bounds_that_they_share():
    log = layers((0.01, 0.5), (0.05, 2.0))
    linear = tuple(Parameter(p.name, "1", p.lower, p.upper, p.start, False) for p in log)
    for parameters in (log, linear):
        points = propose([], parameters, Plan((Stage("g", "grid", points=4),), 9)).batch
        assert all(a == b for a, b in points)
        gaps = np.diff(np.log(points) if parameters is log else points, axis=0)
        assert gaps == pytest.approx(np.full((3, 2), gaps[0, 0]))
        assert 0.05 < points[0][0] < points[-1][0] < 0.5
        _, history = search(parameters, [Stage("e", "equal", TOL, 1e-9)], lambda point: (point[0] - 0.3) ** 2)
        assert all(a == b for a, b in (e.point for e in history))
        assert min(history, key=lambda e: e.value).point[0] == pytest.approx(0.3, rel=0.01)


def test_all_alike_ends_at_a_shared_bound_where_the_score_falls_up_to_it():
    parameters = layers((0.01, 0.5), (0.05, 2.0))
    for score, end in ((sum, 0.05), (lambda point: -sum(point), 0.5)):
        assert search(parameters, [Stage("e", "equal", TOL, 1e-9)], score)[0].best == (end, end)


def test_only_what_a_stage_names_is_tied():
    parameters = (*layers((0.01, 0.5), (0.05, 2.0)), Parameter("alpha", "1", 1.0, 5.0, 2.5, False))
    stage = Stage("g", "grid", points=3, tied=("mu_middle", "mu_top"))
    points = propose([], parameters, Plan((stage,), 9)).batch
    assert {(a == b, alpha) for a, b, alpha in points} == {(True, 2.5)}
    assert Tie(Space(parameters), ("alpha",)).tied.tolist() == [False, False, True]


def test_a_tolerance_is_a_share_or_in_the_unit_of_the_parameters():
    def spread(tolx_in, scale):
        """Of the last simplex, which is near the end of the history, in the logarithm and in MPa."""
        parameters = tuple(Parameter(f"mu_{n}", "MPa", 1e-4 * scale, scale, 0.1 * scale) for n in range(2))
        stage = Stage("i", "independent", 0.02, 10.0, tolx_in=tolx_in)  # the score alone would never go on
        _, history = search(
            parameters, [stage], lambda p: np.sum((np.log(p) - np.log([0.02 * scale, 0.05 * scale])) ** 2)
        )
        return len(history)

    # a share does not depend on the size of a modulus, a difference in MPa does
    assert spread("share", 1.0) == spread("share", 100.0)
    assert spread("unit", 1.0) < spread("share", 1.0) < spread("unit", 100.0)


def test_where_no_guess_has_a_solution_the_search_ends_and_says_so():
    proposal, history = search(layers((0.01, 1.0), (0.01, 1.0)), [INDEPENDENT], lambda point: None, limit=50)
    assert proposal.stop == "no guess has a solution"
    assert len(history) == 3


def test_tolerances_below_the_digits_of_a_guess_end_the_search():
    stage = Stage("i", "independent", 1e-14, 1e-30)
    proposal, _ = search(layers((0.01, 1.0), (0.01, 1.0)), [stage], lambda p: float(np.sum(np.abs(np.log(p) + 2))))
    assert proposal.stop in ("guesses differ in their last digit only", "tolerances met")
    assert np.log(proposal.best) == pytest.approx([-2, -2], abs=1e-6)
