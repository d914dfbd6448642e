"""Preparation of pictures before they are compared: resizing, smoothing, scaling."""

from __future__ import annotations

import numpy as np

from fingerfit.imaging.pictures import Picture

_HALF_WIDTH = 2 * np.sqrt(2 * np.log(2))
"""Full width at half maximum of a Gaussian of standard deviation 1."""


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


def resize(picture: Picture, size: tuple[int, ...]) -> Picture:
    """The same part of space with other pixels: cubic splines, after a Gaussian along axes with fewer pixels.

    The Gaussian makes the resolution that of the new pixels (Cardoso et al., MICCAI 2015): its width and that of the
    old pixels, in squares, add up to that of the new ones.

    Parameters
    ----------
    picture : Picture
    size : tuple of int
        Pixels along x, y[, z].
    """
    import SimpleITK as sitk

    old, new = np.array(picture.values.shape[::-1]), np.array(size)
    ratio = old / new
    spacing = picture.spacing * ratio
    # the outer borders of the pixels stay where they are
    origin = picture.to_points(((ratio - 1) / 2)[None])[0]
    image = sitk.GetImageFromArray(picture.values)
    image.SetSpacing(picture.spacing.tolist())
    image.SetOrigin(picture.origin.tolist())
    image.SetDirection(picture.direction.ravel().tolist())
    width = np.sqrt(np.maximum(ratio**2 - 1, 0)) / _HALF_WIDTH
    if (width > 0).any():
        variance = ((width * picture.spacing) ** 2).tolist()
        image = sitk.DiscreteGaussian(image, variance, 64, 0.001)
    target = sitk.Resample(
        image, new.tolist(), sitk.Transform(), sitk.sitkBSpline, origin.tolist(), spacing.tolist(),
        picture.direction.ravel().tolist(),
    )  # fmt: skip
    values = sitk.GetArrayFromImage(target)
    return Picture(_filled(values, picture, origin, spacing), spacing, origin, picture.direction)


def _filled(values: np.ndarray, picture: Picture, origin: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Values with those outside the centres of the old border pixels, where there is no spline, from the next ones."""
    index = [np.arange(n) for n in values.shape[::-1]]
    for axis, numbers in enumerate(index):
        first = picture.to_index(origin[None])[0, axis]
        at = first + numbers * spacing[axis] / picture.spacing[axis]
        known = np.flatnonzero((at >= -1e-6) & (at <= picture.values.shape[::-1][axis] - 1 + 1e-6))
        values = np.take(values, np.clip(numbers, known[0], known[-1]), axis=values.ndim - 1 - axis)
    return values


def noise_after_resizing(picture: Picture, size: tuple[int, ...]) -> float:
    """Standard deviation of white noise of 1 after `resize`, by resizing some."""
    old = np.array(picture.values.shape[::-1])
    some = np.maximum(8, np.minimum(old, 48))
    part = np.maximum(2, np.rint(some * np.array(size) / old)).astype(int)
    noise = np.random.default_rng(0).normal(size=some[::-1])
    flat = Picture(noise, np.ones(len(old)), np.zeros(len(old)), np.eye(len(old)))
    return float(resize(flat, tuple(int(n) for n in part)).values.std())
