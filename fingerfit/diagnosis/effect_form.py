"""What the form of a model's own effects may leave: nature has others than a catalogue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.model.effect import OBSERVATION, Effect
from fingerfit.study.several import AT

FORM, QUIET = 0.1, 0.25
"""Shares of an effect's signal by which its form may be off from what is there: where data are left unexplained, and
where none are as a whole. Choices (decision 19)."""


@dataclass(frozen=True)
class Form:
    """Misfit that a model would have without its own effects, the constants following.

    Parameters
    ----------
    members, probes : float
        Without the numbers of its members, and of its probes.
    """

    members: float = 0.0
    probes: float = 0.0

    @property
    def left(self) -> float:
        """What the form of these effects may leave of it.

        A probe has no form of its own; what it stands for may differ from it by as much as an answer need not explain.
        """
        return FORM**2 * self.members + (1.0 - ENOUGH) * self.probes

    @property
    def quiet(self) -> float:
        """The same of a model that explains all data as a whole, for what hardly lowers the error of pictures."""
        return QUIET**2 * self.members + (1.0 - ENOUGH) * self.probes


NO_FORM = Form()


def form_of(comparison: Comparison, named: Sequence[Effect] = ()) -> Form:
    """That of a model's own effects, where others are `named` beside them."""
    return Form(*(_signal_of(comparison, named, probes) for probes in (False, True)))


def _signal_of(comparison: Comparison, named: Sequence[Effect], probes: bool) -> float:
    """Misfit that a model would have without the numbers of its probes, or of its members, the constants following.

    By slopes.

    A shift or a brightness that has another form leaves shifts and brightness: where all that is `named` acts on the
    body, effects on the observation do not count.
    """
    bodily = bool(named) and all(effect.acts != OBSERVATION for effect in named)
    problem, score_test = comparison.problem, comparison.score_test
    parameters, values = problem.settings.parameters(), comparison.base.values
    amounts = {
        effect.key(number.name): number.null
        for effect in map(problem.effects.get, problem.settings.model.effects)
        if effect is not None and not (bodily and effect.acts == OBSERVATION)
        if effect.probe == probes
        for number in effect.parameters
    }
    names = [p.name.partition(AT)[0] for p in parameters]
    free = [n for n, name in enumerate(names) if name in problem.settings.model.parameters]
    signal = np.zeros(len(score_test.left))
    for n, (parameter, name) in enumerate(zip(parameters, names, strict=True)):
        if name in amounts and not parameter.log:
            signal += score_test.own[:, n] * (values[parameter.name] - amounts[name]) / parameter.scale
    constants = score_test.own[:, free]
    left = signal - constants @ np.linalg.lstsq(constants, signal, rcond=1e-6)[0]
    return float(left @ left)
