"""A model with one effect more, fitted; and whether a model explains the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fingerfit.diagnosis.likelihood import Weighed
from fingerfit.diagnosis.score_tests import ScoreTest, beyond_noise
from fingerfit.diagnosis.sides import Sides

LEVEL = 0.01
"""Probability of a false alarm in all tests together."""
GOOD = 1.25
"""Misfit per degree of freedom up to which a model is adequate, unless chance alone allows more."""
EXPLAINED = 1.25
"""Error in units of the noise floor up to which every pixel counts as explained, beside the patches; beyond it no model
is adequate, unless chance alone allows more. A choice (decision 49)."""


@dataclass(frozen=True)
class Refit:
    """A model with one effect more, fitted.

    Parameters
    ----------
    misfit : float
    freedom : int
    fitted : float
    held_out : float or None
        Errors on the fitted and on the held-out steps, in units of the noise floor; None without any of these.
    values : mapping
        Constants and numbers of the effect.
    intervals : mapping
        Their 95 % intervals, as from `evidence.interval95`.
    common_misfit : float
    common_freedom : int
        Of what all values of a step have in common.
    share : float
        Of the predicted size, from which the refit went out.
    start : mapping
        Numbers of the effect that it went out from: with these in the settings its simulations are asked for again.
    simulations : int
        How many it asked for.
    fall : float
        Of the misfit, where both models are weighed by the covariance of the one without the effect.
    absent : bool
        Whether it ended at the absent values of the effect: as the model without it, found at another place.
    lower : float
        By how much refits that ended so found the model without the effect to leave less, weighed as `fall`.
    missed : bool
        Whether its error is larger than that of the model without the effect: it has missed its minimum, and does not
        count, whatever its own covariance says of its misfit.
    constants : mapping
        Where the numbers of the model without the effect went out from.
    weighed : Weighed, optional
        What it leaves.
    compared, before : float, optional
        Misfits with the effect and without it, by one likelihood: that of this refit, or the one that all refits of a
        model have in common.
    numbers : int
        How many numbers of the effect were fitted.
    worth : float
        Misfit that they must explain to be worth it: as from `Information.worth`.
    sides : Sides
        Where the picture before compression has the sides of the body, against the model.
    but_mesh : (float, float or None), optional
        The errors without what the mesh is expected to make of the pictures: as from `errors_but_mesh`.
    """

    misfit: float
    freedom: int
    fitted: float
    held_out: float | None
    values: Mapping[str, float]
    common_misfit: float = 0.0
    common_freedom: int = 0
    share: float = 1.0
    start: Mapping[str, float] = field(default_factory=dict)
    simulations: int = 0
    fall: float = 0.0
    constants: Mapping[str, float] = field(default_factory=dict)
    weighed: Weighed | None = field(default=None, repr=False, compare=False)
    compared: float | None = None
    before: float | None = None
    numbers: int = 0
    worth: float = 0.0
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sides: Sides = field(default_factory=Sides)
    but_mesh: tuple[float, float | None] | None = None
    absent: bool = False
    missed: bool = False
    lower: float = 0.0

    @property
    def earned(self) -> float:
        """Fall of the misfit against the model without the effect, at the best place that was found of that."""
        return self.fall - self.lower

    @property
    def at_least(self) -> float:
        """Error on the fitted steps without what the mesh is expected to make of it, but no less than the noise."""
        return self.fitted if self.but_mesh is None else self.but_mesh[0]

    @property
    def held_at_least(self) -> float | None:
        """The same on the held-out steps; None without any."""
        return self.held_out if self.but_mesh is None else self.but_mesh[1]

    @property
    def level(self) -> float:
        """The misfit by which refits are compared with each other, and what their numbers are worth."""
        return self._misfit + self.worth

    @property
    def _misfit(self) -> float:
        return self.misfit if self.compared is None else self.compared

    def gain(self, before: float) -> float:
        """By how much the effect lowers the misfit, by one likelihood.

        Parameters
        ----------
        before : float
            Misfit of the model without the effect by its own likelihood, which does where there is no other one.
        """
        return self._without(before) - self._misfit

    def explained(self, before: float) -> float:
        """Share of the misfit beyond the noise that the effect explains, by one likelihood; `before` as for `gain`."""
        return self.gain(before) / beyond_noise(self._without(before), self.freedom)

    def _without(self, before: float) -> float:
        return before if self.before is None else self.before


def good(freedom: int) -> float:
    """Misfit per degree of freedom up to which a model is adequate: with few values chance alone goes beyond `GOOD`.

    >>> good(1000), round(good(19), 2)
    (1.25, 1.9)
    """
    return max(GOOD, chance(freedom) / max(freedom, 1))


def loud(error: float, freedom: int) -> bool:
    """Whether an error, in units of the noise floor, is more than an adequate model may have; few values scatter more.

    >>> loud(1.3, 1000), loud(1.3, 5)
    (True, False)
    """
    return error > max(EXPLAINED, (chance(freedom) / max(freedom, 1)) ** 0.5)


def error_explained(before: float, after: float) -> float:
    """Share of the squared error beyond the noise that an effect explains.

    Errors in units of the noise floor; the one before is above 1.

    >>> error_explained(2.0, 1.0), error_explained(2.0, 2.0)
    (1.0, 0.0)
    """
    return (before**2 - after**2) / (before**2 - 1.0)


def chance(freedom: int) -> float:
    """Misfit that noise alone goes beyond but once in a hundred times (`LEVEL`)."""
    from scipy.special import chdtri

    return float(chdtri(max(freedom, 1), LEVEL))


def explains(one: ScoreTest | Refit, level: float = LEVEL) -> bool:
    """Whether a model explains the data: all values together, and those few that all of a step have in common.

    Of these chance alone leaves more with a probability of `level`.
    """
    whole = one.misfit <= good(one.freedom) * max(one.freedom, 1)
    return whole and one.common_misfit <= _common_limit(one, level)


def excess(one: ScoreTest | Refit) -> float:
    """Misfit beyond what noise leaves on average: of all values, or of those that all of a step have in common."""
    return max(one.misfit - one.freedom, one.common_misfit - one.common_freedom)


def _common_limit(one: ScoreTest | Refit, level: float) -> float:
    """Of chance; where all other values differ by more than their noise, which `good` allows, of as much more."""
    from scipy.special import chdtri

    if not one.common_freedom:
        return 0.0
    spread = (one.misfit - one.common_misfit) / max(one.freedom - one.common_freedom, 1)
    return float(chdtri(one.common_freedom, level)) * max(1.0, spread)
