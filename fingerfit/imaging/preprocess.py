"""Smoothing and scaling of pictures before they are compared."""

from __future__ import annotations

import numpy as np


def smooth(values: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian of a standard deviation in pixels, cut at 4, the picture mirrored at its borders.

    The same as scipy.ndimage.gaussian_filter, whose import costs more than all smoothing of a round in the plane.
    """
    if sigma <= 0:
        return values
    if values.ndim == 3:
        from scipy.ndimage import gaussian_filter

        return gaussian_filter(values, sigma)
    radius = reach_of(sigma)
    kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    for axis in range(values.ndim):
        widths = [(radius, radius) if axis == k else (0, 0) for k in range(values.ndim)]
        padded = np.moveaxis(np.pad(values, widths, mode="symmetric"), axis, 0)
        count = values.shape[axis]
        total = sum(weight * padded[tap : tap + count] for tap, weight in enumerate(kernel))
        values = np.moveaxis(np.asarray(total), 0, axis)
    return values


def reach_of(sigma: float) -> int:
    """Pixels at which a Gaussian is cut."""
    return int(4 * sigma + 0.5)


def scale_of(before: np.ndarray) -> tuple[float, float]:
    """Lowest intensity and range of the picture before compression: all pictures are scaled by these two."""
    low, high = float(before.min()), float(before.max())
    return low, (high - low) or 1.0
