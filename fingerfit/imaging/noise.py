"""Noise of pictures: magnitudes, and those of cameras, whose background has a level of its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_RAYLEIGH_MEDIAN = np.sqrt(2 * np.log(2))
"""Median of a Rayleigh distribution whose channels have standard deviation 1 (Gudbjartsson and Patz 1995)."""
_CLEAR, _CLEAR_SPREAD = 2.0, 0.56396
"""Level of a background, in standard deviations of the noise, from which on it is told from noise by the shape of its
distribution, and the distance of the quartiles over the median there (Rice). Below, the shape hardly differs from that
of a magnitude without any signal. A choice (docs/decisions/0043-blur-of-the-camera.md)."""
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
        sigma sqrt(2 ln 2) (Gudbjartsson and Patz 1995); or Rician, where the background has a level of its own, as that
        of a camera has. Without it, or with fewer than `_EMPTY` pixels, the finest diagonal details of the picture are
        used (Donoho and Johnstone 1994), by the wavelet of Daubechies (1988) with four coefficients.
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
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    spread = (high - low) / middle
    if spread > _CLEAR_SPREAD:
        return float(middle / _RAYLEIGH_MEDIAN)
    # imported here: pictures of magnitudes do not need it
    from scipy.stats import norm, rice

    levels = np.geomspace(_CLEAR, 20.0, 40)
    quartiles = np.array([rice.ppf([0.25, 0.5, 0.75], level) for level in levels])
    distance = quartiles[:, 2] - quartiles[:, 0]
    known = (distance / quartiles[:, 1])[::-1], distance[::-1]
    return float((high - low) / np.interp(spread, [0.0, *known[0]], [2 * norm.ppf(0.75), *known[1]]))
