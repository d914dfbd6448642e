"""Smoothing and scaling of pictures before they are compared."""

from __future__ import annotations

import numpy as np


def smooth(values: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian of a standard deviation in pixels."""
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(values, sigma) if sigma > 0 else values


def scale_of(before: np.ndarray) -> tuple[float, float]:
    """Lowest intensity and range of the picture before compression: all pictures are scaled by these two."""
    low, high = float(before.min()), float(before.max())
    return low, (high - low) or 1.0
