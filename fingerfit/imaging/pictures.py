"""Pictures with their place in space, read and written through SimpleITK."""

from __future__ import annotations

import contextlib
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError, LimitError
from fingerfit.imaging.limits import check_files, check_memory
from fingerfit.imaging.whole import refuse_damaged, refuse_meta_header
from fingerfit.study.data import Data

SAME = 0.01
"""Share of a pixel by which pictures of one study may lie apart, anywhere in them: what registration is sure of
(`registration.FLOOR`)."""


@dataclass(frozen=True)
class Picture:
    """A picture of two or three dimensions.

    Parameters
    ----------
    values : ndarray, shape (ny, nx) or (nz, ny, nx)
        Intensities.
    spacing, origin : ndarray, shape (dim,)
        mm, in the order x, y[, z]; the origin is the centre of the first pixel.
    direction : ndarray, shape (dim, dim)
        Columns are the directions of the axes.
    """

    values: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    direction: np.ndarray

    @classmethod
    def before(cls, data: Data) -> Picture:
        """The picture before compression of prepared data."""
        return cls(data.before, data.spacing, data.origin, data.direction)

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return len(self.spacing)

    def to_index(self, points: np.ndarray) -> np.ndarray:
        """Continuous pixel index (x, y[, z]) of points in mm, both of shape (points, dim)."""
        return (points - self.origin) @ self.direction / self.spacing

    def to_points(self, index: np.ndarray) -> np.ndarray:
        """Points in mm of pixel indices (x, y[, z]), both of shape (points, dim)."""
        return self.origin + (index * self.spacing) @ self.direction.T

    def crop(self, points: np.ndarray, share: float) -> Picture:
        """The part around points of shape (points, dim), by a share of their extent wider on each side."""
        index = self.to_index(points)
        low, high = index.min(axis=0), index.max(axis=0)
        size = np.array(self.values.shape[::-1])
        with np.errstate(over="ignore"):  # a share beyond all numbers is the whole picture
            wider = share * (high - low)
        first = np.clip(np.floor(low - wider), 0, size - 1).astype(int)
        last = np.clip(np.ceil(high + wider) + 1, first + 1, size).astype(int)
        window = tuple(slice(a, b) for a, b in zip(first[::-1], last[::-1], strict=True))
        origin = self.to_points(first[None].astype(float))[0]
        return Picture(self.values[window].copy(), self.spacing, origin, self.direction)

    def same_place(self, other: Picture) -> bool:
        """Whether the other picture has the same pixels in space."""
        return not self.difference(other)

    def difference(self, other: Picture) -> str:
        """What of the place in space is not that of another picture, in words; empty when nothing."""
        found = []
        if self.values.shape != other.values.shape:
            found.append("x".join(map(str, self.values.shape[::-1])) + " pixels")
        slope, pixel = SAME / max(self.values.shape), SAME * self.spacing.min()
        slacks = {"spacing": slope * self.spacing, "origin": pixel, "direction": slope}
        for name, slack in slacks.items():
            own, its = getattr(self, name), getattr(other, name)
            if own.shape != its.shape or not (np.abs(own - its) <= slack).all():
                found.append(f"{name} {_rounded(own.tolist())}")
        return ", ".join(found)


def _rounded(value: Any) -> Any:
    """Numbers in lists with six decimals, small ones with six digits; of whatever size, other than by `numpy.round`."""
    if isinstance(value, list):
        return [_rounded(inner) for inner in value]
    return round(value, 6) if abs(value) >= 1e-3 else float(f"{value:.6g}")


def read_picture(path: Path) -> Picture:
    """Read a picture file, or a folder with one DICOM series.

    Raises
    ------
    InputError
        When it is missing, cannot be read, is cut or damaged, or is not a picture of finite real scalars in 2 or 3
        dimensions.
    """
    import SimpleITK as sitk

    image = _read_image(path)
    if image.GetNumberOfComponentsPerPixel() != 1:
        raise InputError(path, "picture", f"{image.GetNumberOfComponentsPerPixel()} channels", "one channel")
    if "complex" in image.GetPixelIDTypeAsString():
        raise InputError(path, "picture", "complex intensities", "real ones: the magnitude, for example")
    with np.errstate(invalid="ignore"):  # NaN, which is refused below
        values = sitk.GetArrayFromImage(image).astype(float)
    dim = image.GetDimension()
    spacing, origin = np.array(image.GetSpacing()), np.array(image.GetOrigin())
    direction = np.array(image.GetDirection()).reshape(dim, dim)
    if dim == 3 and values.shape[0] == 1:
        # one slice: a plane picture, whatever its format says
        values, dim = values[0], 2
        spacing, origin, direction = spacing[:2], origin[:2], direction[:2, :2]
    if dim not in (2, 3):
        raise InputError(path, "picture", f"{dim} dimensions", "2 or 3")
    if not all(np.isfinite(part).all() for part in (spacing, origin, direction)) or not (spacing > 0).all():
        found = f"{spacing.tolist()}, origin {origin.tolist()}"
        raise InputError(path, "spacing", found, "finite numbers, a spacing above 0")
    if not np.isfinite(values).all():
        raise InputError(path, "picture", "NaN or infinite intensities", "finite intensities")
    # squares of all pixels are added up, in double precision
    largest, most = float(np.abs(values).max(initial=0.0)), math.sqrt(sys.float_info.max / max(values.size, 1))
    if largest > most:
        raise InputError(path, "picture", f"intensities up to {largest:.3g}", f"at most {most:.3g}, to be squared")
    if np.abs(direction.T @ direction - np.eye(dim)).max() > 1e-3:
        raise InputError(path, "direction", "axes that are not perpendicular", "an orthogonal direction matrix")
    if dim == 3 and np.linalg.det(direction) < 0:
        raise InputError(path, "direction", "a left-handed direction matrix (determinant -1)", "a right-handed one")
    return Picture(values, spacing, origin, direction)


def shape_of(path: Path) -> tuple[int, ...]:
    """Pixels along each axis of a picture, x first, from its header alone.

    Raises
    ------
    InputError
        When there is no such picture or no header in it.
    """
    import SimpleITK as sitk

    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    check_files(path)
    files = _series(path) if path.is_dir() else [str(path)]
    reader = sitk.ImageFileReader()
    reader.SetFileName(files[0])
    try:
        reader.ReadImageInformation()
    except RuntimeError as error:
        raise InputError(path, "picture", "no header", "a picture that SimpleITK reads") from error
    size: tuple[int, ...] = reader.GetSize()
    return (*size[:2], len(files)) if path.is_dir() else size


def _read_image(path: Path) -> Any:
    """What SimpleITK reads of a file or folder that is whole and fits into the memory."""
    import SimpleITK as sitk

    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    if not path.exists():
        raise InputError(path, "picture", "no such file", "a picture file or a folder with a DICOM series")
    check_files(path)
    if not path.is_dir():
        refuse_meta_header(path)
    try:
        files = _series(path) if path.is_dir() else [str(path)]
        reader = sitk.ImageFileReader()
        reader.SetFileName(files[0])
        with contextlib.suppress(RuntimeError):  # a header that ITK cannot read is told better below
            reader.ReadImageInformation()
            check_memory(path, reader, len(files))
        if not path.is_dir():
            refuse_damaged(path)
        image = sitk.ReadImage(files if path.is_dir() else files[0])
    except MemoryError as error:
        expected = "a picture that fits into the memory"
        raise LimitError(path, "picture", "more than the memory holds", expected) from error
    except RuntimeError as error:
        reason = [line for line in str(error).splitlines() if line.strip()][-1]
        raise InputError(path, "picture", reason, "a picture that SimpleITK reads") from error
    return image


def _series(path: Path) -> Sequence[str]:
    """Files of the one DICOM series in a folder, in the order of its slices."""
    import SimpleITK as sitk

    series = sitk.ImageSeriesReader.GetGDCMSeriesIDs(str(path))
    if len(series) != 1:
        found = f"{len(series)} DICOM series" if series else "a folder without a DICOM series"
        raise InputError(path, "picture", found, "one DICOM series")
    files = sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(path), series[0])
    known = {Path(file).name for file in files}
    endings = {Path(file).suffix for file in files}
    # GDCM leaves out what it cannot read: a slice at the end would be missing without a gap
    others = sorted(p.name for p in path.iterdir() if p.is_file() and p.name not in known and p.suffix in endings)
    others = [name for name in others if not name.startswith(".") and name != "DICOMDIR"]
    if others:
        raise InputError(path, "slices", f"{others[0]}, which is no slice of the series", "whole slices of one series")
    reader, places = sitk.ImageFileReader(), []
    for file in files:
        reader.SetFileName(file)
        reader.ReadImageInformation()
        places.append(np.array(reader.GetOrigin()))
    gaps = np.linalg.norm(np.diff(places, axis=0), axis=1) if len(places) > 1 else np.zeros(0)
    # ITK takes the mean distance and only warns
    if len(gaps) and np.abs(gaps - np.median(gaps)).max() > 0.01 * np.median(gaps):
        worst = int(np.argmax(np.abs(gaps - np.median(gaps))))
        names = f"{Path(files[worst]).name} and {Path(files[worst + 1]).name}"
        found = f"{gaps[worst]:.4g} mm between {names}"
        raise InputError(path, "slices", found, f"{np.median(gaps):.4g} mm, as between the others")
    return files


def write_picture(path: Path, picture: Picture, kind: Any = np.uint16) -> None:
    """Write a picture; the format follows from the name. Whole or not at all.

    Values with one axis more than the picture, the last one, are vectors. What `kind` does not reach is cut off.
    """
    import SimpleITK as sitk

    values = picture.values
    if np.issubdtype(kind, np.integer):
        values = np.clip(values, np.iinfo(kind).min, np.iinfo(kind).max)
    image = sitk.GetImageFromArray(values.astype(kind), isVector=picture.values.ndim > picture.dim)
    image.SetSpacing(picture.spacing.tolist())
    image.SetOrigin(picture.origin.tolist())
    image.SetDirection(picture.direction.ravel().tolist())
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        temporary = Path(folder) / path.name
        try:
            sitk.WriteImage(image, str(temporary), useCompression=True)
        except RuntimeError as error:
            raise FingerfitError(f"{path}: cannot be written") from error
        temporary.replace(path)
