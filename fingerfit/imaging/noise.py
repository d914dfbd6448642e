"""Noise of pictures: magnitudes, and those of cameras, whose background has a level of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

_RAYLEIGH_MEDIAN = np.sqrt(2 * np.log(2))
"""Median of a Rayleigh distribution whose channels have standard deviation 1 (Gudbjartsson and Patz 1995)."""
_BINS, _MOST = 40, 0.95
"""Into how many bins the intensities of a background are counted, and up to which quantile: above it may be something
that is no background. Choices."""
_SURELY = 16.0
"""Twice the logarithm of the likelihood ratio from which a background has a level of its own: four standard
deviations, once in 30 000 pictures by chance. A level that is not there makes the noise a fifth too small."""
_NORMAL_MAD = 0.6744897501960817
"""Median of the absolute value of a standard normal: its quantile of 3/4."""
_HAAR = np.array([1.0, -1.0]) / np.sqrt(2)
"""Filter of the details where an axis has fewer than four pixels."""
_DAUBECHIES = np.array([1 - 3**0.5, 3**0.5 - 3, 3 + 3**0.5, -1 - 3**0.5]) / np.sqrt(32)
"""Filter of the details with two vanishing moments (Daubechies 1988): what the picture has of slopes does not count as
noise (docs/decisions/0014-libraries.md)."""
_EMPTY = 50
"""Pixels of empty background that give the noise; their median is then good to a tenth. A choice."""
_ROUNDINGS = 32
"""Details of so many roundings of the largest intensity are those of a picture without noise; a choice."""


def add_rician(values: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """Magnitude of a signal with Gaussian noise of standard deviation `sigma` in both channels."""
    real = values + rng.normal(0.0, sigma, values.shape)
    return np.hypot(real, rng.normal(0.0, sigma, values.shape))


def noise_of_repeats(pictures: Sequence[np.ndarray], where: np.ndarray) -> float:
    """Standard deviation between pictures of the same, root mean square over the chosen pixels.

    Parameters
    ----------
    pictures : sequence of ndarray
        Two or more, of one shape.
    where : ndarray of bool
        Pixels that count: those with signal, where Rician noise is nearly normal.
    """
    values = np.stack([picture[where] for picture in pictures])
    return float(np.sqrt(np.mean(values.var(axis=0, ddof=1))))


def estimate_noise(values: np.ndarray, background: np.ndarray | None = None) -> float:
    """Standard deviation of the noise in each channel.

    Parameters
    ----------
    values : ndarray
        Picture.
    background : ndarray of bool, optional
        Where there is surely no signal: there the magnitude is Rayleigh distributed, with the median
        sigma sqrt(2 ln 2) (Gudbjartsson and Patz 1995). A background with a level of its own, as that of a camera, is
        Rician, or normal and cut off at 0; the likelihoods of these three decide. Without it, or with fewer than
        `_EMPTY` pixels, the finest diagonal details of the picture are used (Donoho and Johnstone 1994), by the wavelet
        of Daubechies (1988) with four coefficients.
    """
    if background is not None and background.sum() >= _EMPTY and (values[background] > 0).mean() > 0.5:
        return _of_background(values[background])
    detail = values
    for axis, size in enumerate(values.shape):
        taps = _DAUBECHIES if size >= len(_DAUBECHIES) else _HAAR
        start = np.arange(0, size - len(taps) + 1, 2)
        detail = sum(tap * np.take(detail, start + n, axis) for n, tap in enumerate(taps))
    found = float(np.median(np.abs(detail)) / _NORMAL_MAD)
    return found if found > _ROUNDINGS * np.finfo(float).eps * np.abs(values).max() else 0.0


def _of_background(values: np.ndarray) -> float:
    """Standard deviation of the noise of pixels without signal, shape (pixels,)."""
    # imported here: pictures with a stated noise do not need it
    from scipy.special import ndtr, xlogy
    from scipy.stats import rice

    middle, above = np.quantile(values, [0.5, ndtr(1.0)])
    if above == middle:  # rounded to fewer values than the noise has
        return float(values.std())
    counts, edges = _counted(values)
    rayleigh = float(middle / _RAYLEIGH_MEDIAN)
    start = float(middle / (above - middle)), float(above - middle)
    # how many are 0 says nothing of a magnitude, where they may have been set so: outside of the field of view
    either = np.array([counts[0], counts[1:].sum()])
    any_zeros = float(xlogy(either, either / either.sum()).sum())
    of_none, _ = _likeliest(counts[1:], edges[1:], rice.cdf, (0.0, rayleigh), level=False)
    of_level, sigma = _likeliest(counts[1:], edges[1:], rice.cdf, start)
    of_normal, deviation = _likeliest(counts, edges, lambda where, level: ndtr(where - level), start)
    of_normal -= any_zeros
    if 2.0 * (max(of_level, of_normal) - of_none) <= _SURELY:
        return rayleigh
    return deviation if of_normal > of_level else sigma


def _counted(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How many values are not above 0, and in each of the bins above that; and the borders of these.

    Borders lie between values, also where they are whole numbers.
    """
    least, most = values[values > 0].min(), np.quantile(values, _MOST)
    known, counts = np.unique(values[(values > 0) & (values <= max(most, least))], return_counts=True)
    last = np.unique(np.searchsorted(np.cumsum(counts), np.linspace(0.0, counts.sum(), _BINS + 1)[1:]))
    after = np.append(known, min(values[values > known[-1]], default=known[-1]))
    edges = np.concatenate([[-np.inf, least / 2.0], (known[last] + after[last + 1]) / 2.0])
    return np.histogram(values, edges)[0], edges


def _likeliest(
    counts: np.ndarray,
    edges: np.ndarray,
    distribution: Callable[[np.ndarray, float], np.ndarray],
    start: tuple[float, float],
    level: bool = True,
) -> tuple[float, float]:
    """Logarithm of the likelihood of counts at its maximum, and the standard deviation of the noise there.

    Parameters
    ----------
    counts : ndarray, shape (bins,)
    edges : ndarray, shape (bins + 1,)
    distribution : callable
        Its function of (values, level), both in standard deviations; only what lies between the edges counts.
    start : (float, float)
        Level in standard deviations, and standard deviation.
    level : bool
        Whether there is a level.
    """
    from scipy.optimize import minimize

    def less(guess: np.ndarray) -> float:
        below = distribution(edges / np.exp(guess[0]), float(guess[1] ** 2) if level else 0.0)
        shares = np.diff(below) / max(below[-1] - below[0], np.finfo(float).tiny)
        return -float(counts @ np.log(np.maximum(shares, np.finfo(float).tiny)))

    begin = np.array([np.log(start[1]), np.sqrt(start[0])])[: 1 + level]
    found = minimize(less, begin, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-3})
    return -float(found.fun), float(np.exp(found.x[0]))
