"""Registration of a subject's volume to that of the reference: where each point of the reference is in the subject.

Multi-resolution in two stages, through SimpleITK: an affine map, then cubic B-splines on a grid that is refined on the
way (Rueckert et al. 1999).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.imaging.pictures import Picture

METRICS = ("correlation", "ssd", "mutual_information")


@dataclass(frozen=True)
class Registration:
    """How volumes are registered.

    Parameters
    ----------
    metric : str
        ``correlation`` (intensities in a straight line to each other), ``ssd`` (the same scale; labels), or
        ``mutual_information`` (other contrast).
    grid : float
        Distance of the B-splines' control points at the end, mm.
    levels : int
        Resolutions, each half of the next.
    iterations : int
        Of each stage and resolution, at most.
    sampling : float
        Share of the voxels that are compared.
    seed : int
        Of the choice of voxels.
    """

    metric: str = "correlation"
    grid: float = 4.0
    levels: int = 3
    iterations: int = 60
    sampling: float = 0.1
    seed: int = 1

    def __post_init__(self) -> None:
        if self.metric not in METRICS:
            raise InputError("registration", "metric", self.metric, "one of " + ", ".join(METRICS))
        for name in ("grid", "levels", "iterations", "sampling"):
            if not getattr(self, name) > 0:
                raise InputError("registration", name, getattr(self, name), "a positive number")


class Deformation:
    """A map from the reference to the subject.

    Parameters
    ----------
    transform : SimpleITK.Transform
        From points of the reference to points of the subject, mm.
    similarity : float
        Value of the metric at the end; less is better.
    """

    def __init__(self, transform: Any, similarity: float = np.nan) -> None:
        self.transform, self.similarity = transform, similarity

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points of the reference, shape (points, 3), in the subject, mm."""
        return np.array([self.transform.TransformPoint(point) for point in np.asarray(points, dtype=float).tolist()])


def register(
    reference: Picture,
    subject: Picture,
    settings: Registration | None = None,
    mask: np.ndarray | None = None,
    start: Callable[[Picture], np.ndarray] | None = None,
) -> Deformation:
    """Where the points of a reference volume are in a subject's.

    Parameters
    ----------
    reference, subject : Picture
        Volumes of any size and place that lie alike, within some 15 degrees.
    settings : Registration, optional
    mask : ndarray of bool, shape of the reference's values, optional
        Where they are compared; everywhere when left out.
    start : function of a picture, optional
        Point of each with which the affine stage begins, one on the other: `tip_of` a finger when left out.

    Raises
    ------
    InputError
        For pictures that are not volumes or have no contrast, or when nothing overlaps.
    """
    import SimpleITK as sitk

    settings = settings or Registration()
    for name, picture in (("reference", reference), ("subject", subject)):
        if picture.dim != 3:
            raise InputError(name, "picture", f"{picture.dim} dimensions", "a volume")
        if not np.ptp(picture.values) > 0:
            raise InputError(name, "picture", "one intensity everywhere", "a volume with contrast")
    fixed, moving = _image(reference), _image(subject)
    region = None
    if mask is not None:
        region = _image(Picture(mask.astype(np.uint8), reference.spacing, reference.origin, reference.direction))
    here, there = ((start or tip_of)(picture) for picture in (reference, subject))
    first = sitk.AffineTransform(3)
    first.SetCenter(here.tolist())
    first.SetTranslation((there - here).tolist())
    try:
        affine = _method(settings, region, settings.levels)
        affine.SetOptimizerAsRegularStepGradientDescent(1.0, 1e-3, 2 * settings.iterations, 0.6)
        affine.SetOptimizerScalesFromPhysicalShift()
        affine.SetInitialTransform(first, inPlace=False)
        linear = affine.Execute(fixed, moving)
        splines, similarity = _splines(settings, region, fixed, moving, linear)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise InputError("registration", "volumes", reason, "volumes of the same part of the body") from error
    both = sitk.CompositeTransform(3)
    both.AddTransform(linear)
    both.AddTransform(splines)
    return Deformation(both, similarity)


TIP = 15.0
"""How much of the finger tells where its tip is, mm."""


def tip_of(picture: Picture) -> np.ndarray:
    """The farthest point of a bright body along x, in the middle of the sections behind it, shape (3,), mm."""
    points = _bright(picture)
    end = points[:, 0].max()
    behind = points[points[:, 0] > end - TIP]
    return np.array([end, *((behind[:, 1:].min(axis=0) + behind[:, 1:].max(axis=0)) / 2)])


def middle_of(picture: Picture) -> np.ndarray:
    """The centre of a bright body, shape (3,), mm."""
    return np.asarray(_bright(picture).mean(axis=0))


def _bright(picture: Picture) -> np.ndarray:
    """Voxels of the largest bright body, shape (voxels, 3), mm."""
    import SimpleITK as sitk

    bright = sitk.OtsuThreshold(sitk.Median(_image(picture), (1, 1, 1)), 0, 1)
    largest = sitk.RelabelComponent(sitk.ConnectedComponent(bright)) == 1
    index = np.argwhere(sitk.GetArrayFromImage(largest) > 0)[:, ::-1]
    return picture.to_points(index.astype(float))


def _splines(settings: Registration, region: Any, fixed: Any, moving: Any, linear: Any) -> tuple[Any, float]:
    import SimpleITK as sitk

    finest = 2 ** (settings.levels - 1)
    size = np.array(fixed.GetSize()) * np.array(fixed.GetSpacing())
    coarse = np.maximum(1, np.round(size / (settings.grid * finest))).astype(int)
    transform = sitk.BSplineTransformInitializer(fixed, coarse.tolist(), order=3)
    method = _method(settings, region, settings.levels)
    method.SetMovingInitialTransform(linear)
    method.SetInitialTransformAsBSpline(transform, inPlace=False, scaleFactors=[2**n for n in range(settings.levels)])
    method.SetOptimizerAsLBFGS2(
        solutionAccuracy=1e-4, numberOfIterations=settings.iterations, deltaConvergenceTolerance=1e-5
    )
    found = method.Execute(fixed, moving)
    return found, float(method.GetMetricValue())


def _method(settings: Registration, region: Any, levels: int) -> Any:
    import SimpleITK as sitk

    method = sitk.ImageRegistrationMethod()
    # sums of several threads come in any order, and the result would differ from run to run
    method.SetNumberOfThreads(1)
    if settings.metric == "correlation":
        method.SetMetricAsCorrelation()
    elif settings.metric == "ssd":
        method.SetMetricAsMeanSquares()
    else:
        method.SetMetricAsMattesMutualInformation(40)
    if region is not None:
        method.SetMetricFixedMask(region)
    method.SetMetricSamplingStrategy(method.RANDOM if settings.sampling < 1 else method.NONE)
    method.SetMetricSamplingPercentage(settings.sampling, settings.seed)
    method.SetInterpolator(sitk.sitkLinear)
    method.SetShrinkFactorsPerLevel([2**n for n in reversed(range(levels))])
    method.SetSmoothingSigmasPerLevel([0.5 * 2**n if n else 0.0 for n in reversed(range(levels))])
    method.SmoothingSigmasAreSpecifiedInPhysicalUnitsOff()
    return method


def _image(picture: Picture) -> Any:
    import SimpleITK as sitk

    values = picture.values
    image = sitk.GetImageFromArray(values if values.dtype == np.uint8 else values.astype(np.float32))
    image.SetSpacing(picture.spacing.tolist())
    image.SetOrigin(picture.origin.tolist())
    image.SetDirection(picture.direction.ravel().tolist())
    return image
