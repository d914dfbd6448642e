"""What the form of a model's own effects may leave: nature has others than a catalogue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.joint import diagonal
from fingerfit.diagnosis.likelihood import fall
from fingerfit.diagnosis.refit import Refit, explains
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.model.effect import Effect
from fingerfit.study.several import AT

FORM = 0.1
"""Share of a member's signal by which its form may be off from what is there in a model that is adequate: a choice
(decision 48)."""
MOST = (1.0 - ENOUGH) ** 0.5
"""The same at most: an effect is an answer where it explains three quarters of a misfit. A probe, which has no form of
its own, may always be off by so much; what is named beside an effect must explain what that cannot."""


@dataclass(frozen=True)
class Form:
    """A model whose own effects may have another form than what is there.

    Parameters
    ----------
    beside : bool
        Whether it has any.
    explains : bool
        Whether what it leaves is no more than noise and their form.
    falls : mapping
        By how much refits lower the misfit that is neither, by name of the effect; a refit without an entry keeps its
        own.
    """

    beside: bool = False
    explains: bool = False
    falls: Mapping[str, float] = field(default_factory=dict)

    def limited(self, refits: Mapping[str, Refit]) -> dict[str, Refit]:
        """Refits that explain no more than what the form of the model's effects does not."""
        return {name: replace(one, fall=min(one.fall, self.falls.get(name, one.fall))) for name, one in refits.items()}


NO_FORM = Form()


def form_of(comparison: Comparison, named: Sequence[Effect], refits: Mapping[str, Refit]) -> Form:
    """That of a model, where other effects are `named` beside its own; with their refits.

    The form of an effect is an error like that of a mesh: it is as large as a share of what the effect changes there,
    and its pattern is known roughly.

    A shift or a brightness that has another form leaves shifts and brightness: where all that is `named` acts on the
    body or the loading, effects on the pictures do not count.
    """
    problem = comparison.problem
    bodily = bool(named) and not any(map(_of_pictures, named))
    known = [effect for effect in map(problem.effects.get, problem.settings.model.effects) if effect is not None]
    own = [effect for effect in known if not (bodily and _of_pictures(effect))]
    if not own:
        return replace(NO_FORM, beside=bool(known))
    members, probes = (
        _covariance(comparison, [effect for effect in own if effect.probe == probe]) for probe in (False, True)
    )
    without = comparison.weighed
    in_form = without.covariance + FORM**2 * members + MOST**2 * probes
    residual = (without.vector, in_form, without.own, without.nuisance, comparison.common(), without.known)
    beside = replace(without, covariance=without.covariance + MOST**2 * (members + probes))
    left = {effect.name: refits[effect.name].weighed for effect in named if effect.name in refits}
    falls = {name: fall(beside, one) for name, one in left.items() if one is not None}
    return Form(True, explains(ScoreTest(*residual)), falls)


def _of_pictures(effect: Effect) -> bool:
    return effect.observes_alone and not effect.on_loading


def _covariance(comparison: Comparison, effects: Sequence[Effect]) -> np.ndarray:
    """Covariance of errors that are as large as the signals of these effects, shape (kept, kept)."""
    tests, own = comparison.every, comparison.weighed.own
    ends = np.cumsum([len(test.vector) for test in tests])
    whole = np.zeros((len(own), len(own)))
    for effect in effects:
        parts = np.split(_signal(comparison, effect, own), ends[:-1])
        fields = [_everywhere(test, part) for test, part in zip(tests, parts, strict=True)]
        whole += diagonal([test.rough_covariance(field) for test, field in zip(tests, fields, strict=True)])
    return whole


def _signal(comparison: Comparison, effect: Effect, own: np.ndarray) -> np.ndarray:
    """What an effect changes in displacements and response, by slopes, shape (kept,)."""
    values, signal = comparison.base.values, np.zeros(len(own))
    absent = effect.null()
    for n, parameter in enumerate(comparison.problem.settings.parameters()):
        name = parameter.name.partition(AT)[0]
        if name in absent and not parameter.log:
            signal += own[:, n] * (values[parameter.name] - absent[name]) / parameter.scale
    return signal


def _everywhere(test: Comparison, part: np.ndarray) -> np.ndarray:
    """Values of a test that choose, among all of them; 0 elsewhere."""
    whole = np.zeros(len(test.kept))
    whole[test.kept] = part
    return whole
