"""Parameters of a model and the guesses the search makes for them."""

from __future__ import annotations

from dataclasses import dataclass

from fingerfit.core.errors import FingerfitError

DIGITS = 10
"""Significant digits of a guess: text and number of a guess are the same thing, so hashes agree."""


@dataclass(frozen=True)
class Parameter:
    """One constant to be identified.

    Parameters
    ----------
    name : str
        As in the deck's context, for example ``mu_top``.
    unit : str
        For example ``MPa``.
    lower, upper : float
        Bounds, in that unit.
    start : float
        Where the search starts.
    log : bool
        Whether the search walks in its logarithm.
    unity : float, optional
        What counts as 1 in the coordinate of a parameter without a logarithm; the distance of the bounds when left out.
    prior : (float, float), optional
        Value and standard deviation that were known before, in that unit.
    """

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    log: bool = True
    unity: float | None = None
    prior: tuple[float, float] | None = None

    @property
    def scale(self) -> float:
        """What counts as 1 in the coordinate of a parameter without a logarithm, in its unit."""
        return self.unity or self.upper - self.lower

    def __post_init__(self) -> None:
        if not self.lower <= self.start <= self.upper:
            raise FingerfitError(
                f"parameter {self.name}: start {self.start:g} {self.unit} lies outside its bounds "
                f"{self.lower:g} to {self.upper:g}"
            )
        if self.log and self.lower <= 0:
            raise FingerfitError(
                f"parameter {self.name}: a log scale needs a lower bound above 0, found {self.lower:g}"
            )


def round_value(value: float) -> float:
    """Round to the digits a guess is written with.

    >>> round_value(0.1 + 0.2)
    0.3
    """
    return float(f"{value:.{DIGITS}g}")
