"""What an effect explains of the residual, value by value: what the page draws beside it.

A model with the effect leaves less, because the effect acts and because the constants take other values beside it. What
it explains is the difference of what both models leave. Slopes of the effect alone, at the size that it was found to
have, are something else: the constants do not follow, and the effect is elsewhere or is not in proportion to its size.
"""

from __future__ import annotations

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.first_pass import FirstPass, Way, widened
from fingerfit.diagnosis.ranking import FIRST_PASS, REFIT, Ranked
from fingerfit.diagnosis.refit import Refit

SLOPES = "slopes"


def explained(comparison: Comparison, one: Ranked, refit: Refit | None = None) -> tuple[np.ndarray, str]:
    """What an effect explains of the residual of a model, and what says so.

    Parameters
    ----------
    comparison : Comparison
        Of the model without the effect.
    one : Ranked
    refit : Refit, optional
        Of the effect.

    Returns
    -------
    ndarray, shape (all,)
        In the units of the residual; NaN where it is not known, and by slopes for what the fit did not use.
    str
        ``refit``; ``first pass``; or ``slopes``, where there is neither.
    """
    left = refit.weighed.whole if refit is not None and refit.weighed is not None else None
    # a body of another shape has patches elsewhere
    if left is not None and left.shape == comparison.whole.shape:
        return comparison.whole - left, REFIT
    if one.refitted is not None:
        changed = _by_first_pass(comparison, one)
        if changed is not None:
            return np.where(np.isfinite(comparison.whole), changed, np.nan), FIRST_PASS
    signal = one.columns @ one.finding.size
    whole = np.full(len(comparison.kept), np.nan)
    whole[comparison.kept] = signal + comparison.own() @ comparison.score_test.follow(signal)
    return whole, SLOPES


def _by_first_pass(comparison: Comparison, one: Ranked) -> np.ndarray | None:
    """What the refit of the first pass changes, shape (all,); None where its solution is not there."""
    if one.refitted is None:
        return None
    wider = widened(comparison.problem, comparison.base.values, one)
    try:
        return Way(FirstPass(comparison), wider, one.refitted.values, {}).change(one.refitted.values)
    except StateError:
        return None
