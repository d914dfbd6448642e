"""How alike two pictures are."""

from __future__ import annotations

import numpy as np

LIMITS = (0.0, 1.0)
"""Intensities of a picture after preprocessing."""
_EMPTY = 1e-15
"""A share of a histogram that is as good as none: what rounding leaves."""


def joint_histogram(
    a: np.ndarray,
    b: np.ndarray,
    bins: int,
    smooth: bool = True,
    limits: tuple[float, float] | None = None,
) -> np.ndarray:
    """Joint histogram of two pictures of the same shape.

    Parameters
    ----------
    a, b : ndarray
        Pictures.
    bins : int
        Bins of each axis.
    smooth : bool
        Share each pair between the neighbouring bins in proportion (linear Parzen window), so that the
        histogram follows the intensities without jumps; otherwise each pair counts for one bin, as in numpy.
    limits : (float, float), optional
        Lowest and highest intensity; what is beyond counts as if it were there. Left out: each its own range.

    Returns
    -------
    ndarray, shape (bins, bins)
        Sums to 1.
    """
    if not smooth:
        places = [_places(picture.ravel(), bins, smooth, limits) for picture in (a, b)]
        low = places[0] * bins + places[1]
        return np.bincount(low, minlength=bins * bins).reshape(bins, bins) / a.size
    return _sums(_between(a, bins, limits), _between(b, bins, limits), bins) / a.size


_Between = tuple[np.ndarray, np.ndarray]
"""The bin below each pixel and how far it is to the next one, from 0 to 1, each of shape (pixels,)."""


def _sums(one: _Between, other: _Between, bins: int) -> np.ndarray:
    """Joint histogram, in pixels, of two pictures whose values lie between bins."""
    (ia, fa), (ib, fb) = one, other
    # the lower corner of each pair's four bins; what goes to the others is moved there bin by bin, not pair by pair
    corner = ia * bins + ib
    many = bins * bins
    both = np.bincount(corner, weights=fa * fb, minlength=many)
    first = np.bincount(corner, weights=fa, minlength=many) - both
    second = np.bincount(corner, weights=fb, minlength=many) - both
    total = np.bincount(corner, minlength=many) - first - second - both
    for offset, shares in ((1, second), (bins, first), (bins + 1, both)):
        total[offset:] += shares[:-offset]
    return total.reshape(bins, bins)


def _between(picture: np.ndarray, bins: int, limits: tuple[float, float] | None) -> _Between:
    place = _places(picture.ravel(), bins, True, limits)
    below = np.minimum(place.astype(np.int64), bins - 2)
    return below, place - below


def _places(values: np.ndarray, bins: int, smooth: bool, limits: tuple[float, float] | None) -> np.ndarray:
    low, high = limits or (values.min(), values.max())
    if limits:
        values = np.clip(values, low, high)
    width = (high - low) or 1.0
    if smooth:
        return (values - low) / width * (bins - 1)
    return np.minimum(((values - low) / width * bins).astype(np.int64), bins - 1)


def nmi(
    a: np.ndarray,
    b: np.ndarray,
    bins: int = 64,
    smooth: bool = True,
    limits: tuple[float, float] | None = None,
) -> float:
    """Normalized mutual information (H(a) + H(b)) / H(a, b), from 1 to 2 (Studholme et al. 1999).

    Parameters
    ----------
    a, b : ndarray
        Pictures of the same shape.
    bins, smooth, limits
        As for `joint_histogram`; with ``smooth=False`` and no limits the value is scikit-image's.

    >>> picture = np.arange(16.0).reshape(4, 4)
    >>> round(nmi(picture, picture, bins=4, smooth=False), 12)
    2.0
    """
    return _of(joint_histogram(a, b, bins, smooth, limits))


def _of(joint: np.ndarray) -> float:
    return (_entropy(joint.sum(axis=0)) + _entropy(joint.sum(axis=1))) / _entropy(joint.ravel())


class Similar:
    """The smooth `nmi` of a picture with others, which differ from each other at some pixels only.

    All other pixels are counted once: half of a picture of a body and its background need not be counted again each
    time.

    Parameters
    ----------
    a : ndarray
    b : ndarray
        One of the others.
    moving : ndarray of bool
        Where they differ, of the same shape.
    bins, limits
        As for `nmi`.
    sure : ndarray, optional
        Share of its difference from `a` that each pixel of the others has here, of the same shape.
    """

    def __init__(
        self,
        a: np.ndarray,
        b: np.ndarray,
        moving: np.ndarray,
        bins: int,
        limits: tuple[float, float],
        sure: np.ndarray | None = None,
    ) -> None:
        self._bins, self._limits, self._size, still = bins, limits, a.size, ~moving
        self._beside = (a[moving], sure[moving]) if sure is not None else None
        b = b if sure is None else a + sure * (b - a)
        self._a = _between(a[moving], bins, limits)
        self._still = _sums(_between(a[still], bins, limits), _between(b[still], bins, limits), bins)

    def value(self, moving: np.ndarray) -> float:
        """The similarity with one of the others, of which the pixels are given that differ, shape (pixels,)."""
        return _of(self._joint(_between(self._nearer(moving), self._bins, self._limits)))

    def _nearer(self, moving: np.ndarray) -> np.ndarray:
        if self._beside is None:
            return moving
        own, sure = self._beside
        return np.asarray(own + sure * (moving - own))

    def _joint(self, b: _Between) -> np.ndarray:
        return np.asarray((self._still + _sums(self._a, b, self._bins)) / self._size)

    def gradient(self, moving: np.ndarray) -> np.ndarray:
        """Its derivative by each of these pixels, shape (pixels,).

        By the chain rule through the joint histogram, which a pixel's intensity moves from one bin towards the next
        (Thevenaz and Unser 2000, with a linear window). Pixels beyond the limits have none.
        """
        bins, (low, high) = self._bins, self._limits
        moving = self._nearer(moving)
        (ia, fa), b = self._a, _between(moving, bins, self._limits)
        joint, ib = self._joint(b), b[0]
        own, both = joint.sum(axis=0), _entropy(joint.ravel())
        alone = _entropy(joint.sum(axis=1)) + _entropy(own)
        # what the entropies lose when a share moves to the next bin of b
        moved, single = (np.diff(np.log(np.maximum(share, _EMPTY))) for share in (joint, own))
        corner = ia * (bins - 1) + ib
        pairs = moved.ravel()[corner]
        pairs += fa * (moved.ravel()[corner + bins - 1] - pairs)
        slope = alone / both**2 * pairs - single[ib] / both
        slope *= (bins - 1) / ((high - low) * self._size)
        slope[(moving < low) | (moving > high)] = 0.0
        return np.asarray(slope if self._beside is None else slope * self._beside[1])


def nmi_noise(pictures: np.ndarray, smooth: float, bins: int = 64) -> float:
    """What one unit of the log likelihood of pictures is in their mean normalized mutual information.

    The mutual information of n independent pixels is a log likelihood per pixel (Roche et al. 2000). Of smoothed pixels
    as few are independent as a Gaussian leaves of the variance. Pictures that agree have an NMI of about 1.5: a joint
    entropy of 4/3 of each of them.

    Parameters
    ----------
    pictures : ndarray, shape (pictures, ...)
        As measured.
    smooth : float
        Standard deviation of the smoothing, in pixels.
    bins : int
        As for `nmi`.
    """
    entropies = [_entropy(joint_histogram(one, one, bins, limits=LIMITS).sum(axis=0)) for one in pictures]
    alone = share_alone(smooth, pictures.ndim - 1)
    return 1.0 / (pictures[0].size * alone * 4.0 / 3.0 * sum(entropies))


def share_alone(smooth: float, dim: int) -> float:
    """Share of pixels that are independent after a Gaussian of `smooth` pixels in `dim` dimensions, at most 1.

    >>> round(share_alone(1.0, 2), 3)
    0.08
    """
    return min(1.0, (4.0 * np.pi * smooth**2) ** (-dim / 2)) if smooth > 0 else 1.0


def _entropy(share: np.ndarray) -> float:
    present = share[share > _EMPTY]
    return float(-(present * np.log(present)).sum()) or 1e-300
