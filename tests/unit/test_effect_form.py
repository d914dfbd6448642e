"""What the form of a model's own effects may leave, on twenty patches in a row at three steps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fingerfit.diagnosis.effect_form import FORM, MOST, form_of
from fingerfit.diagnosis.likelihood import Weighed
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.rough import ALIKE, SMOOTH, rough_covariance
from fingerfit.model.catalogue import catalogue
from fingerfit.model.parameters import Parameter
from fingerfit.model.scales import bound

EFFECTS = bound(catalogue(), {"width": 20.0, "height": 4.0, "force": 40.0}, "force")
STEPS, PATCHES, NOISE = 3, 20, 0.01
SHAPE = (STEPS, PATCHES, 3)  # two displacements and the brightness
COUNT = STEPS * PATCHES * 3 + STEPS


def world(signal, names=("tilt",), left=None, effects=EFFECTS):
    """A model with effects that change `signal` each, and what it leaves."""
    constant = np.append(np.zeros(np.prod(SHAPE)), np.ones(STEPS))  # it changes the response alone
    own = np.stack([constant, *[signal] * len(names)], axis=1)
    parameters = [Parameter("mu", "MPa", 0.01, 1.0, 0.1, True, 1.0)]
    parameters += [Parameter(effects[n].key(effects[n].parameters[0].name), "1", -9.0, 9.0, 0.0, False) for n in names]
    settings = SimpleNamespace(
        parameters=lambda: parameters, model=SimpleNamespace(effects=dict.fromkeys(names), parameters={"mu": None})
    )
    vector = np.zeros(COUNT) if left is None else left
    kept = np.ones(COUNT, dtype=bool)
    weighed = Weighed(kept, vector, own, NOISE**2 * np.eye(COUNT), np.zeros((COUNT, 0)))
    found = SimpleNamespace(
        problem=SimpleNamespace(
            settings=settings,
            effects=effects,
        ),
        base=SimpleNamespace(values={p.name: p.scale for p in parameters}),
        patches=SimpleNamespace(centre=np.stack([np.arange(PATCHES) + 0.5, np.full(PATCHES, 2.0)], axis=1)),
        kept=kept,
        vector=vector,
        weighed=weighed,
        common=lambda: np.ones((COUNT, 1)),
    )
    found.every = (found,)
    found.rough_covariance = lambda signal: rough_covariance(SHAPE, found.patches.centre, 4.0, signal, kept)
    return found


def field(first, last):
    """Upward displacements of a tenth of a millimetre of some patches, at all steps."""
    value = np.zeros(SHAPE)
    value[:, first:last, 1] = 0.1
    return np.append(value.ravel(), np.zeros(STEPS))


def turned(first, last):
    """The same upwards on the right and downwards on the left: the effect itself cannot make up for it."""
    value = field(first, last)
    rows = value[: np.prod(SHAPE)].reshape(SHAPE)
    rows[:, first:last, 1] *= np.sqrt(3.0) * np.linspace(-1.0, 1.0, last - first)
    return value


def explained_beside(comparison, name="wall"):
    """By how much the misfit falls, beyond the form, with an effect that explains all that is left."""
    refit = Refit(0.0, COUNT, 1.0, 1.0, {}, weighed=replace(comparison.weighed, vector=np.zeros(COUNT)))
    found = form_of(comparison, [EFFECTS[name]], {name: refit})
    return found.falls[name]


def test_an_error_is_as_large_as_its_signal_smooth_and_alike_at_all_steps():
    signal = field(0, 10)
    signal[-STEPS:] = [1.0, 2.0, 3.0]
    signal[: np.prod(SHAPE)].reshape(SHAPE)[:, 5, 2] = -0.2  # darker
    covariance = world(signal).rough_covariance(signal)
    whole = covariance[: np.prod(SHAPE), : np.prod(SHAPE)].reshape(SHAPE + SHAPE)
    assert whole[0, 3, 1, 0, 3, 1] == pytest.approx(0.1**2 / 2) == whole[0, 3, 0, 0, 3, 0]
    assert whole[0, 3, 1, 2, 3, 1] == pytest.approx(ALIKE * 0.1**2 / 2)
    assert whole[0, 3, 1, 0, 4, 1] == pytest.approx(0.1**2 / 2 * np.exp(-0.5 / SMOOTH**2 / 4.0**2))
    assert whole[0, 5, 2, 1, 5, 2] == pytest.approx(ALIKE * 0.2**2)
    assert not whole[0, 3, 2].any() and not whole[0, 12].any() and not whole[0, 3, 1, 0, 3, 0]
    assert covariance[-STEPS, -1] == pytest.approx(ALIKE * 3.0) and covariance[-1, -1] == pytest.approx(9.0)
    assert np.linalg.eigvalsh(covariance)[0] > -1e-9


def test_what_lies_where_the_models_effect_acts_is_its_form_and_what_lies_elsewhere_is_not():
    """A fifth of the effect's signal is left, where it acts, and the same elsewhere."""
    there = explained_beside(world(field(0, 10), left=0.2 * turned(0, 10)))
    left = 0.2 * turned(10, 20)
    elsewhere = explained_beside(world(field(0, 10), left=left))
    noise = float(left @ left) / NOISE**2
    assert elsewhere == pytest.approx(noise) and there < 0.1 * noise
    assert explained_beside(world(field(0, 10), left=2 * MOST * turned(0, 10))) > 2 * there


@pytest.mark.parametrize(("share", "explains"), [(FORM, True), (10 * FORM, False)])
def test_a_model_explains_the_data_where_it_leaves_no_more_than_noise_and_form(share, explains):
    assert form_of(world(field(0, 10), left=share * turned(0, 10)), [], {}).explains == explains


def test_without_effects_there_is_no_form():
    found = form_of(world(field(0, 10), names=(), left=field(0, 10)), [EFFECTS["wall"]], {})
    assert (found.beside, found.explains, dict(found.falls)) == (False, False, {})
    refits = {"wall": Refit(0.0, 1, 1.0, 1.0, {}, fall=30.0)}
    assert found.limited(refits) == refits


@pytest.mark.parametrize("name", ["wall", "onset"])  # of the onset, under a force, only a reading is left
def test_a_shift_is_no_excuse_for_what_acts_on_the_body_or_the_loading(name):
    left = 0.2 * turned(0, 10)
    beside = world(field(0, 10), names=("misregistration",), left=left)
    refits = {name: Refit(0.0, COUNT, 1.0, 1.0, {}, weighed=replace(beside.weighed, vector=np.zeros(COUNT)))}
    assert form_of(beside, [EFFECTS[name]], refits).falls == {}
    assert form_of(beside, [EFFECTS[name]], refits).beside
    assert explained_beside(beside, "turned_pictures") < 0.1 * float(left @ left) / NOISE**2


def test_a_probe_has_no_form_and_may_be_off_by_more():
    left = 10 * FORM * turned(0, 10)
    assert not form_of(world(field(0, 10), left=left), [], {}).explains
    known = {**EFFECTS, "tilt": replace(EFFECTS["tilt"], probe=True)}
    assert form_of(world(field(0, 10), left=left, effects=known), [], {}).explains
