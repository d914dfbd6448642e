"""What pictures of a test must show: a body, each step its own, and less likeness to the first one under more load."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from itertools import combinations
from statistics import NormalDist

import numpy as np

FALSE_REMARKS = 0.01
"""Share of studies without any fault for which noise alone may cause a remark; a choice. `surely` divides it by the
number of comparisons (Bonferroni)."""


def surely(comparisons: int) -> float:
    """Standard deviations that noise exceeds in one of so many comparisons, on one side, with that probability."""
    return NormalDist().inv_cdf(1 - FALSE_REMARKS / max(1, comparisons))


def constant(values: np.ndarray) -> str:
    """What a picture without any contrast shows, in words; nothing when it has some."""
    low, high = float(values.min()), float(values.max())
    if low < high:
        return ""
    return "all pixels 0" if low == 0 else f"all pixels {low:g}"


def pixels(values: np.ndarray) -> bytes:
    """What tells pictures with other pixels apart, where not all of them can be kept."""
    return hashlib.sha256(np.ascontiguousarray(values).data).digest()


def repeated(pictures: Sequence[np.ndarray]) -> tuple[int, int] | None:
    """The first two pictures, as places in the list, with the same pixels: noise makes that impossible."""
    known: dict[bytes, int] = {}
    for n, values in enumerate(pictures):
        key = pixels(values)
        if key in known:
            return known[key], n
        known[key] = n
    return None


def unlike(picture: np.ndarray, before: np.ndarray) -> float:
    """Mean squared difference of a picture from the one before compression."""
    return float(np.mean((picture - before) ** 2))


def out_of_order(
    before: np.ndarray,
    away: Sequence[float],
    load: np.ndarray,
    noise: float,
    load_noise: float,
    picture: Callable[[int], np.ndarray],
) -> tuple[int, int] | None:
    """The two pictures that are most surely in the wrong order; None where noise may explain all.

    Under more load the mean squared difference from the picture before compression should be larger. For pictures P_i
    and P_j it falls by the mean of (P_i - P_j)(P_i + P_j - 2 P_0). Independent noise of standard deviation s in the
    three changes each product by (P_i + P_j - 2 P_0)(n_i - n_j) + (P_i - P_j)(n_i + n_j - 2 n_0), of variance
    s^2 [2 (P_i + P_j - 2 P_0)^2 + 6 (P_i - P_j)^2]: the two brackets are uncorrelated.

    Parameters
    ----------
    before : ndarray
    away : sequence of float
        How `unlike` each picture is.
    load : ndarray, shape (pictures,)
        Prescribed quantity, N or mm.
    noise : float
        Standard deviation of the pictures, in their intensity.
    load_noise : float
        That of `load`: steps that do not differ by more have no order.
    picture : callable
        A picture, by its place in `away`, like `before`; asked only for pairs in the wrong order, so that no study has
        to keep its pictures for this.

    Returns
    -------
    (int, int) or None
        The picture under less load, and the one under more load that is more like the first.
    """
    pairs = list(combinations(range(len(away)), 2))
    sure = surely(len(pairs))
    worst, found = sure, None
    for pair in pairs:
        less, more = sorted(pair, key=lambda n: load[n])
        if load[more] - load[less] <= sure * np.sqrt(2) * load_noise or away[more] >= away[less]:
            continue
        one, other = picture(less), picture(more)
        apart, both = one - other, one + other - 2 * before
        spread = noise / apart.size * float(np.sqrt((2 * both**2 + 6 * apart**2).sum()))
        excess = (away[less] - away[more]) / spread if spread else np.inf
        if excess > worst:
            worst, found = excess, (less, more)
    return found
