"""What follows a search: the error that a finer mesh leaves, and which solution is the base."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from differences import by_differences

from fingerfit.core.errors import StateError
from fingerfit.fit.linear import LinearModel
from fingerfit.fit.minimum import ORDER, Minimum, finest, mesh_error, minimum
from fingerfit.fit.priors import Priors
from fingerfit.fit.problem import FINAL, REFINED, SEARCH, SENSITIVITY
from fingerfit.fit.refine import ADDED, around_best, refine_round, stopped_early
from fingerfit.fit.rounds import Asked, Round
from fingerfit.fit.slopes import STEP, coordinates, moved, neighbours, step_to
from fingerfit.forward.score import Prediction, score
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.model.parameters import Parameter
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Outcome
from fingerfit.study.data import Data

PARAMETERS = (Parameter("mu_top", "MPa", 1e-3, 1.0, 0.1), Parameter("poisson", "1", 0.3, 0.5, 0.4, log=False))
LAYERS = [("top", 6.0), ("bottom", 6.0)]


def fit_on(search, refined=None):
    meshes = {SEARCH: search} | ({REFINED: refined} if refined else {})
    problem = SimpleNamespace(
        settings=SimpleNamespace(parameters=lambda: PARAMETERS),
        meshes=meshes,
        mesh_of=lambda asked: asked.mesh,
    )
    problem.every = (problem,)
    return problem


def at(values, mesh):
    return Minimum(values, Asked(values, "sim", mesh, ""), None, 0.0, 0.0)


COARSE, FINE = {"mu_top": 0.020, "poisson": 0.40}, {"mu_top": 0.022, "poisson": 0.41}


@pytest.mark.parametrize(("across", "per_layer", "ratio"), [(8, 4, 2.0), (6, 3, 1.5), (4, 4, np.sqrt(2))])
def test_the_error_left_is_the_change_continued_with_the_order_of_a_glued_corner(across, per_layer, ratio):
    problem = fit_on(layered_block(12.0, LAYERS, 4, 2), layered_block(12.0, LAYERS, across, per_layer))
    left = mesh_error(problem, at(FINE, REFINED), at(COARSE, SEARCH))
    change = [np.log(1.1), 0.01 / 0.2]
    assert left == pytest.approx(np.array(change) / (ratio**1.2 - 1), rel=1e-12)


def test_a_sequence_of_that_order_is_continued_exactly():
    # log mu(h) = log mu(0) - c h^p, solved with h and h / 2
    exact, c, h = np.log(0.0211), 0.08, 0.5
    mu = {name: float(np.exp(exact - c * size**ORDER)) for name, size in ((SEARCH, h), (REFINED, h / 2))}
    problem = fit_on(layered_block(12.0, LAYERS, 4, 2), layered_block(12.0, LAYERS, 8, 4))
    minima = [at({"mu_top": mu[name], "poisson": 0.4}, name) for name in (REFINED, SEARCH)]
    left = mesh_error(problem, *minima)
    assert left[0] == pytest.approx(exact - np.log(mu[REFINED]), rel=1e-9)
    assert left[1] == 0.0


def test_sizes_of_a_brick_follow_the_cube_root():
    problem = fit_on(brick([1.0] * 3, [2, 2, 2]), brick([1.0] * 3, [4, 4, 4]))
    left = mesh_error(problem, at(FINE, REFINED), at(COARSE, SEARCH))
    assert left[0] == pytest.approx(np.log(1.1) / (2**1.2 - 1), rel=1e-12)


def test_the_sign_of_the_change_does_not_matter():
    problem = fit_on(layered_block(12.0, LAYERS, 4, 2), layered_block(12.0, LAYERS, 8, 4))
    there, back = (mesh_error(problem, at(a, REFINED), at(b, SEARCH)) for a, b in ((FINE, COARSE), (COARSE, FINE)))
    assert there == pytest.approx(back)
    assert (there > 0).all()


def test_moduli_have_the_root_mean_square_of_their_changes():
    """One whose changes cancel is as wrong as the others; a number on another scale has its own."""
    problem = fit_on(layered_block(12.0, LAYERS, 4, 2), layered_block(12.0, LAYERS, 8, 4))
    problem.settings.parameters = lambda: (*PARAMETERS, Parameter("mu_bottom", "MPa", 1e-3, 1.0, 0.1))
    fine, coarse = ({**values, "mu_bottom": 0.06} for values in (FINE, COARSE))
    left = mesh_error(problem, at(fine, REFINED), at(coarse, SEARCH)) * (2**1.2 - 1)
    assert left == pytest.approx([np.log(1.1) / np.sqrt(2), 0.01 / 0.2, np.log(1.1) / np.sqrt(2)], rel=1e-12)


def test_nearly_the_same_mesh_does_not_make_the_error_endless():
    mesh = layered_block(12.0, LAYERS, 4, 2)
    left = mesh_error(fit_on(mesh, mesh), at(FINE, REFINED), at(COARSE, SEARCH))
    assert left[0] == pytest.approx(10 * np.log(1.1))


def test_an_estimate_of_the_search_mesh_has_the_change_and_what_is_left_after_it():
    """Richardson's formula for the coarser of two meshes, where the finer one is known up to some step only."""
    problem = fit_on(layered_block(12.0, LAYERS, 4, 2), layered_block(12.0, LAYERS, 8, 4))
    found = at(COARSE, SEARCH)
    left = mesh_error(problem, found, found, at(FINE, SEARCH))
    assert left == pytest.approx(np.array([np.log(1.1), 0.01 / 0.2]) * 2**1.2 / (2**1.2 - 1), rel=1e-12)


def test_without_a_finer_solution_nothing_is_known():
    problem = fit_on(layered_block(12.0, LAYERS, 4, 2), layered_block(12.0, LAYERS, 8, 4))
    assert mesh_error(problem, at(COARSE, SEARCH), at(COARSE, SEARCH)) is None
    assert mesh_error(fit_on(problem.meshes[SEARCH]), at(COARSE, SEARCH), at(COARSE, SEARCH)) is None


def test_sensitivities_are_at_either_side():
    sides = neighbours(PARAMETERS, COARSE)
    assert set(sides) == {"+mu_top", "-mu_top", "+poisson", "-poisson"}
    assert sides["+mu_top"]["mu_top"] / sides["-mu_top"]["mu_top"] == pytest.approx(np.exp(0.06), rel=1e-8)
    assert sides["+poisson"]["poisson"] - sides["-poisson"]["poisson"] == pytest.approx(0.06 * 0.2, rel=1e-8)
    assert sides["+mu_top"]["poisson"] == sides["-mu_top"]["poisson"] == 0.40


def test_coordinates_and_values_are_inverse():
    delta = np.array([0.07, -0.3])
    there = moved(PARAMETERS, COARSE, delta)
    assert coordinates(PARAMETERS, there) - coordinates(PARAMETERS, COARSE) == pytest.approx(delta, abs=1e-9)


def test_a_linear_model_adds_slopes():
    def one(value):
        return Prediction(np.full((1, 2, 2), value), np.full(1, value), np.full((1, 2), value))

    model = LinearModel(one(1.0), (one(10.0), one(100.0)), one(7.0), COARSE)
    assert np.all(model.at(np.array([0.1, 0.02])).pictures == pytest.approx(1 + 1 + 2))
    assert model.at(np.array([0.0, 0.02])).response == pytest.approx([1 + 2])


@pytest.mark.parametrize("shape", [(4, 5), (2, 3, 4)])
@pytest.mark.parametrize("kind", ["ssd", "likelihood", "nmi"])
def test_a_score_near_its_base_is_that_of_the_linear_model(kind, shape, rng):
    dim = len(shape)

    def some(scale):
        return Prediction(*(rng.normal(0, scale, own) for own in ((2, *shape), (3,), (6, dim))))

    data = Data(
        step=np.array([1, 2, 3]),
        force=np.ones(3),
        displacement=np.array([0.1, np.nan, 0.3]),
        control="force",
        force_noise=0.0,
        displacement_noise=0.02,
        picture_noise=0.1,
        points_noise=0.03,
        before=np.zeros(shape),
        coefficients=np.zeros(shape),
        measured=rng.normal(0, 1, (2, *shape)),
        picture_step=np.array([0, 2]),
        spacing=np.ones(dim),
        origin=np.zeros(dim),
        direction=np.eye(dim),
        background=0.0,
        smooth=1.0,
        points=np.zeros((6, dim)),
        points_displacement=rng.normal(0, 0.1, (6, dim)),
        points_step=np.array([0, 0, 1, 1, 2, 2]),
    )
    model = LinearModel(some(1.0), (some(0.5), some(2.0)), some(1.0), COARSE)
    for offset in (None, some(0.2)):
        objective = model.objective(kind, data, 32, offset)
        for delta in (np.zeros(2), np.array([0.3, -0.2])):
            there = model.at(delta) if offset is None else model.at(delta) + offset
            assert objective(delta) == pytest.approx(score(kind, there, data, 32), rel=1e-10)
            # the similarity bends where a pixel comes to another bin: within so short a step none of 40 does
            width, exact = (1e-8, 1e-5) if kind == "nmi" else (1e-5, 1e-6)
            expected = by_differences(objective, width).gradient(delta)
            assert objective.gradient(delta) == pytest.approx(expected, abs=exact * np.abs(expected).max())


def test_numbers_of_an_effect_are_changed_by_a_tenth_of_it():
    """Much is there of the first effect, nothing of the third, and hardly anything of the fourth."""
    numbers = tuple(Parameter(f"e{n}.size", "1", -1.0, 1.0, 0.0, log=False) for n in range(4))
    best, absent = (
        {p.name: v for p, v in zip(numbers, (0.8, 0.01, 0.0, 1e-6), strict=True)},
        dict.fromkeys((p.name for p in numbers), 0.0),
    )
    sides = neighbours(numbers, best, absent)
    steps = [step_to(p, sides["+" + p.name], best) for p in numbers]
    usual = [step_to(p, neighbours(numbers, best)["+" + p.name], best) for p in numbers]
    assert usual == pytest.approx([STEP] * 4)
    assert steps == pytest.approx([STEP, 0.1 * 0.01 / numbers[1].scale, STEP, 0.01 * STEP], rel=1e-6)
    assert [step_to(p, sides["-" + p.name], best) for p in numbers] == pytest.approx(steps, rel=1e-6)


class Body:
    """A fit whose pictures are a known function of the constants; the finer mesh sees mu 5 % differently."""

    def __init__(self, sims, truth=0.030, lost=(), folded=()):
        self.sims, self.truth, self.lost, self.folded = sims, truth, lost, folded
        self.settings = SimpleNamespace(parameters=lambda: PARAMETERS[:1], effects=lambda known: ())
        self.effects, self.every = {}, (self,)
        self.mesh_names, self.exact, self.long = {SEARCH: SEARCH, REFINED: REFINED}, False, False
        self.beside = 1
        self.observed, self.priors = np.zeros(1, dtype=bool), Priors.of(PARAMETERS[:1])

    def as_counted(self, prediction):
        return self

    def ask(self, values, role=SEARCH, gain=1.0, nearby=None):
        mesh = REFINED if role == FINAL else SEARCH
        asked = Asked(dict(values), f"{mesh}_{values['mu_top']:.10g}_{gain:g}", mesh, "", role)
        status = DIVERGED if asked.sim in self.lost else CONVERGED
        empty = np.zeros((1, 1, 2))
        Outcome(status, empty, empty[0], empty[0]).save(self.sims / asked.sim / "solution.npz")
        return asked

    def answer(self, sim):
        return Outcome.load(self.sims / sim / "solution.npz")

    def mesh_of(self, asked):
        return asked.mesh

    def folds(self, asked):
        return asked.sim in self.folded

    def is_solved(self, asked):
        """Not for the question whether a side has snapped through a plate: there is no body."""
        return False

    def prediction(self, asked):
        stiffer = 1.05 if asked.mesh == REFINED else 1.0
        z = np.log(asked.values["mu_top"] * stiffer)
        return Prediction(np.array([[[z, z**2 / 10]]]), np.zeros(1), np.zeros((0, 2)))

    def score(self, prediction, values=None):
        z = np.log(self.truth)
        return float(((prediction.pictures - np.array([z, z**2 / 10])) ** 2).sum())

    def objective(self, model, known=True):
        return by_differences(lambda delta: self.score(model.at(delta)))

    def start(self, mu):
        best = {"mu_top": mu}
        batch = [self.ask(best, FINAL)]
        batch += [self.ask(values, role) for role, values in neighbours(PARAMETERS[:1], best).items()]
        batch += [self.ask(best, "+control", 1.03), self.ask(best, "-control", 0.97)]
        history = {"values": best, "sim": "s", "score": 0.0}
        return Round(9, "sensitivity", None, {}, {}, [], batch, history, "tolerances met")


def test_rounds_end_at_the_minimum_of_the_finer_mesh(tmp_path):
    problem = Body(tmp_path)
    last = problem.start(0.026)
    numbers = []
    while last.stop is None:
        last = refine_round(problem, last)
        numbers.append(last.number)
    assert last.stop == "tolerances met"
    assert numbers == list(range(10, 10 + len(numbers)))
    assert finest(problem, last).mesh == REFINED
    assert finest(problem, last).values["mu_top"] == pytest.approx(0.030 / 1.05, rel=1e-3)
    # a first move of 9 % is checked by another solution; from there it is no move to speak of
    assert sum(asked.role == FINAL for asked in last.batch) == 2


def test_a_short_move_is_not_solved_again_and_again(tmp_path):
    problem = Body(tmp_path)
    last = refine_round(problem, problem.start(0.0290))
    assert last.stop == "tolerances met"
    assert sum(asked.role == FINAL for asked in last.batch) == 2


def test_a_model_with_effects_is_followed_closer(tmp_path):
    problem = Body(tmp_path)
    searched = problem.start(0.0264)
    effects = replace(searched, reason=ADDED, slopes=2)
    # a move of 8 %: new slopes, where constants and an effect may compensate each other
    assert refine_round(problem, searched).stage == FINAL
    again = refine_round(problem, effects)
    assert (again.stage, again.slopes) == (SENSITIVITY, 3)
    # one of 3 %: another solution after the next one
    searched = problem.start(0.0277)
    assert refine_round(problem, searched).stop == "tolerances met"
    effects = refine_round(problem, replace(searched, reason=ADDED, slopes=2))
    assert (effects.stage, effects.stop) == (FINAL, None)
    assert refine_round(problem, effects).stop == ADDED


@pytest.mark.parametrize(("far", "stage"), [(0.20, SENSITIVITY), (0.02, FINAL)])
def test_a_move_that_raised_the_score_goes_back_unless_it_is_there(tmp_path, far, stage):
    """Halving a move again and again, for slopes that lead nowhere, would go on until the last turn."""
    problem, begun = Body(tmp_path), 0.030 / 1.05
    last = problem.start(begun * float(np.exp(far)))
    before = {"values": {"mu_top": begun}, "score": -1.0, "fall": 1e-3}
    last = replace(last, reason=ADDED, slopes=3, best={**last.best, "before": before, "trust": 0.1})
    found = refine_round(problem, last)
    assert found.stage == stage
    if stage == SENSITIVITY:
        assert np.log(found.best["values"]["mu_top"] / begun) == pytest.approx(0.4 * far, rel=1e-6)
        assert found.best["trust"] == pytest.approx(0.04)


@pytest.mark.parametrize(("came_true", "stage"), [(0.97, SENSITIVITY), (0.1, FINAL)])
def test_a_move_that_is_short_for_want_of_trust_is_no_end(tmp_path, came_true, stage):
    """The minimum is 5 % away, moves of 0.4 % are trusted: more after one that came true, else the end."""
    problem = Body(tmp_path)
    last = problem.start(0.030 / 1.05 * float(np.exp(0.05)))
    score = problem.score(problem.prediction(last.batch[0]))
    before = {"values": {"mu_top": 0.0301}, "score": score + came_true * 1e-4, "fall": 1e-4}
    found = refine_round(
        problem, replace(last, reason=ADDED, slopes=3, best={**last.best, "before": before, "trust": 0.004})
    )
    assert found.stage == stage
    if stage == SENSITIVITY:
        assert found.best["trust"] == pytest.approx(0.008)


@pytest.mark.parametrize(
    ("off", "reason", "unit", "early"),
    [
        (0.03, ADDED, 1e-6, True),
        (0.03, "tolerances met", 1e-6, False),
        (0.005, ADDED, 1e-6, False),
        (0.03, ADDED, 1.0, False),
    ],
    ids=["valley", "search", "near", "chance"],
)
def test_a_fit_that_ends_where_slopes_promise_a_better_score_says_so(tmp_path, off, reason, unit, early):
    """By more than chance, and farther than a move is left unchecked."""
    problem = Body(tmp_path)
    problem.unit = unit
    last = problem.start(0.030 / 1.05 * float(np.exp(off)))
    last = replace(last, stage=FINAL, stop=reason, reason=reason, batch=[*last.batch[1:], last.batch[0]])
    assert stopped_early(problem, last, minimum(problem, last)) is early
    # a finest solution that is no answer was not what moves came to
    lost = Asked({"mu_top": 0.02}, "lost", REFINED, "", FINAL)
    problem = Body(tmp_path, folded=["lost"])
    problem.unit = unit
    Outcome(CONVERGED, np.zeros((1, 1, 2)), np.zeros((1, 2)), np.zeros((1, 2))).save(tmp_path / "lost" / "solution.npz")
    last = replace(last, batch=[*last.batch, lost])
    assert not stopped_early(problem, last, minimum(problem, last))


def roles(asked):
    return sorted(one.role for one in asked.batch)


@pytest.mark.parametrize(("begun", "rough"), [(0.0200, True), (0.0260, False), (0.0286, False)])
def test_rough_slopes_are_followed_by_others(tmp_path, begun, rough):
    """Rough again after a long move only; the model at rest has both sides, wherever it began."""
    problem, best = Body(tmp_path), {"mu_top": begun}
    base = {"number": 0, "solver": {}, "meshes": {}, "best": {"values": best, "score": None}}
    first = around_best(problem, base, best, ADDED, rough=True)
    assert roles(first) == ["+mu_top", "anchor", "final"]
    second = refine_round(problem, first)
    assert (second.stage, second.slopes, second.rough) == (SENSITIVITY, 2, rough)
    assert ("-mu_top" in roles(second)) is not rough
    last = second
    while last.stop is None:
        last = refine_round(problem, last)
    assert {"+mu_top", "-mu_top"} <= set(roles(last))
    assert finest(problem, last).values["mu_top"] == pytest.approx(0.030 / 1.05, rel=2e-3)


def test_rough_slopes_at_an_upper_bound_are_those_below(tmp_path):
    best = {"mu_top": PARAMETERS[0].upper}
    base = {"number": 0, "solver": {}, "meshes": {}, "best": {"values": best, "score": None}}
    assert roles(around_best(Body(tmp_path), base, best, ADDED, rough=True)) == ["-mu_top", "anchor", "final"]


@pytest.mark.parametrize(("long", "sides"), [(False, "+-"), (True, "+")])
def test_slopes_by_the_control_are_asked_for_once_at_the_end(tmp_path, long, sides):
    problem, best = Body(tmp_path), {"mu_top": 0.026}
    problem.long = long
    base = {"number": 0, "solver": {}, "meshes": {}, "best": {"values": best, "score": None}}
    last, seen = around_best(problem, base, best, "tolerances met"), []
    while last.stop is None:
        seen.append("+control" in roles(last))
        last = refine_round(problem, last)
    assert not seen[0]
    assert [role for role in roles(last) if role.endswith("control")] == [sign + "control" for sign in sides]
    with pytest.raises(StateError, match="prescribed quantity"):
        LinearModel(*(None,) * 4).by_control(np.zeros(1), None)


def test_when_the_finer_mesh_has_no_solution_the_search_mesh_is_the_base(tmp_path):
    best = {"mu_top": 0.0310}
    problem = Body(tmp_path)
    problem.lost = (problem.ask(best, FINAL).sim,)
    last = problem.start(0.0310)
    assert finest(problem, last).mesh == SEARCH
    assert finest(problem, last).values == best


@pytest.mark.parametrize("wrong", ["lost", "folded"])
def test_a_minimum_without_solution_ends_with_the_one_before(tmp_path, wrong):
    """Or with one in which the body goes through itself."""
    problem = Body(tmp_path)
    first = problem.start(0.026)
    second = refine_round(problem, first)
    setattr(problem, wrong, (second.batch[-1].sim,))
    second = refine_round(problem, first)
    third = refine_round(problem, second)
    assert third.stop == "tolerances met"
    assert third.batch == second.batch
    assert finest(problem, third).sim == first.batch[0].sim


DRIFT = Parameter("intensity_drift.gain", "1", -0.5, 0.5, 0.0, log=False)


def one_picture(measured, noise):
    """Data of one step with a picture, and a response and points that tell nothing."""
    one = np.ones(1)
    return SimpleNamespace(
        measured=measured,
        picture_noise=noise,
        step=one,
        controlled=one,
        control_share=0 * one,
        picture_step=np.array([0]),
        response_step=np.array([0]),
        points_step=np.zeros(0, dtype=int),
        response=(np.zeros(1), np.zeros(1)),
        points=np.zeros((0, 2)),
    )


class Bright(Body):
    """The same with a brightness of the pictures that the score does not see."""

    def __init__(self, sims, gain):
        super().__init__(sims)
        self.settings = SimpleNamespace(parameters=lambda: (*PARAMETERS[:1], DRIFT))
        self.observed = np.array([False, True])
        z = np.log(self.truth)
        self.data = one_picture((1 + gain) * np.array([[[z, z**2 / 10]]]), 0.01)

    def prediction(self, asked):
        made = super().prediction(asked)
        return Prediction((1 + asked.values[DRIFT.name]) * made.pictures, made.response, made.points)

    def score(self, prediction, values=None):
        x, y = prediction.pictures.ravel()
        return float((y / x - np.log(self.truth) / 10) ** 2)


def test_a_brightness_that_the_score_does_not_see_is_that_of_the_least_squares(tmp_path):
    """The score alone would leave it where it started, or take it anywhere."""
    problem = Bright(tmp_path, 0.08)
    best = {"mu_top": 0.029, DRIFT.name: 0.02}
    batch = [problem.ask(best, FINAL)]
    values = neighbours((*PARAMETERS[:1], DRIFT), best)
    batch += [problem.ask(guess, role) for role, guess in values.items()]
    batch += [problem.ask(best, "+control", 1.03), problem.ask(best, "-control", 0.97)]
    found = minimum(problem, Round(9, FINAL, None, {}, {}, [], batch, {"values": best, "score": 0.0}, "stop"))
    assert found.values["mu_top"] == pytest.approx(0.030 / 1.05, rel=4e-3)
    assert found.values[DRIFT.name] == pytest.approx(0.08, abs=2e-3)


@pytest.mark.parametrize("last_gain", [0.02, DRIFT.upper], ids=["between bounds", "at a bound"])
def test_what_is_only_seen_has_its_slope_at_the_solution_that_the_model_is_built_on(tmp_path, last_gain):
    """On the finer mesh, and at the last values: the pictures there, by the brightness. Constants have the other mesh."""
    problem = Bright(tmp_path, 0.08)
    best = {"mu_top": 0.029, DRIFT.name: 0.02}
    finer = problem.ask({"mu_top": 0.027, DRIFT.name: last_gain}, FINAL)
    batch = [*(problem.ask(guess, role) for role, guess in neighbours((*PARAMETERS[:1], DRIFT), best).items()), finer]
    batch += [problem.ask(best, "+control", 1.03), problem.ask(best, "-control", 0.97)]
    found = minimum(problem, Round(9, FINAL, None, {}, {}, [], batch, {"values": best, "score": 0.0}, "stop"))
    assert found.base == finer
    dark = Body.prediction(problem, finer).pictures
    assert found.model.slopes[1].pictures == pytest.approx(dark)
    z = np.log(best["mu_top"])
    assert found.model.slopes[0].pictures == pytest.approx(1.02 * np.array([[[1.0, z / 5]]]), rel=1e-3)
