"""Segmentations: pictures of labels, and the names that 3D Slicer writes into them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.imaging.pictures import Picture, read_picture

BLUR = 0.7
"""Standard deviation of the Gaussian that takes the steps of pixels out of depths, pixels. A choice."""
PASSES = 20
"""Over cells that touch themselves: changing one may make another. A choice."""
ASIDE = -0.5
"""Depth from which a pad lies on a cell at the end of the body, cells: it may end within the cell. A choice."""
FLAT = 0.5
"""Least share of a section that the end of a flat side has; that of a ball has less. A choice."""
MOST = 10**7
"""Cells at most: about a gigabyte of depths. A choice."""


def read_labels(path: Path) -> Picture:
    """A picture of labels: whole numbers, 0 where nothing is.

    Raises
    ------
    InputError
        For what is no picture, or has other numbers.
    """
    labels = read_picture(path)
    wrong = labels.values[(labels.values != np.rint(labels.values)) | (labels.values < 0)]
    if len(wrong):
        raise InputError(path, "labels", f"{wrong[0]:g}", "whole numbers, 0 or more")
    return labels


def read_names(path: Path) -> dict[int, str]:
    """Names of labels that 3D Slicer wrote into a ``.seg.nrrd``, in capitals; none of another file.

    Raises
    ------
    InputError
        For segments that overlap, which Slicer keeps in several layers.
    """
    import SimpleITK as sitk

    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
    except RuntimeError:  # told better where it is read
        return {}
    given = {key: reader.GetMetaData(key) for key in reader.GetMetaDataKeys() if key.startswith("Segment")}
    if any(value != "0" for key, value in given.items() if key.endswith("_Layer")):
        raise InputError(path, "segments", "several layers", "segments that do not overlap")
    names = {}
    for key, value in given.items():
        if key.endswith("_LabelValue") and value.isdecimal():
            name = given.get(key.removesuffix("LabelValue") + "Name", "")
            names[int(value)] = "".join(letter if letter.isalnum() else "_" for letter in name).upper()
    return {label: name for label, name in names.items() if name}


@dataclass(frozen=True)
class Cells:
    """Labels on a grid of cells as large as elements, with what is needed to find their borders within a cell.

    Parameters
    ----------
    labels : ndarray of int, shape (nx, ny[, nz])
        Of each cell; nothing on the outermost ones.
    origin, spacing : ndarray, shape (dim,)
        Corner of the first cell and size of a cell, in pixels of the picture.
    depths : dict of int to ndarray
        Distance of pixels of the picture, x first, to the border of each label, in cells; below 0 outside.
    picture : Picture
    flat : ndarray of bool, shape (dim, 2)
        Whether the body is flat at the lower and the upper end of each axis.
    """

    labels: np.ndarray
    origin: np.ndarray
    spacing: np.ndarray
    depths: dict[int, np.ndarray]
    picture: Picture
    flat: np.ndarray

    def depth(self, label: int, places: np.ndarray) -> np.ndarray:
        """Depth in a label at places in cells from the origin, shape (places, dim)."""
        from scipy import ndimage  # here, as below: whoever reads a study without regions starts faster without it

        index = (self.origin + places * self.spacing).T
        return np.asarray(ndimage.map_coordinates(self.depths[label], index, order=1, mode="nearest"))

    def ahead(self, label: int, places: np.ndarray) -> np.ndarray:
        """How much deeper places are in a label than in any other one, shape (places,): 0 on its surface."""
        others = [self.depth(other, places) for other in self.depths if other != label]
        return np.asarray(self.depth(label, places) - np.max(others, axis=0))

    def to_places(self, points: np.ndarray) -> np.ndarray:
        """Places in cells of points in mm."""
        return np.asarray((self.picture.to_index(points) - self.origin) / self.spacing)

    def to_points(self, places: np.ndarray) -> np.ndarray:
        """Points in mm."""
        return self.picture.to_points(self.origin + places * self.spacing)


def cells_of(picture: Picture, size: float, left_out: tuple[int, ...], where: Path) -> Cells:
    """Labels on cells of about a size, mm, that divide the body along each axis.

    Parameters
    ----------
    picture : Picture
    size : float
    left_out : tuple of int
        Labels that are no part of the body: holes, pads.
    where : Path
        Named in errors.

    Raises
    ------
    InputError
        For an empty segmentation, and for a body of less than two elements along an axis.
    """
    values = np.rint(picture.values).astype(int).T  # x first
    body = (values > 0) & ~np.isin(values, left_out)
    if not body.any():
        raise InputError(where, "labels", "no pixel of a body", "labels above 0")
    ends = [np.flatnonzero(body.any(axis=tuple(k for k in range(body.ndim) if k != axis))) for axis in range(body.ndim)]
    low = np.array([one[0] for one in ends]) - 0.5
    extent = np.array([one[-1] - one[0] + 1.0 for one in ends])
    count = np.rint(extent * picture.spacing / size).astype(int)
    if count.min() < 2:
        found = f"{size:g} mm, for a body of {', '.join(f'{x:g}' for x in extent * picture.spacing)} mm"
        raise InputError(where, "size", found, "two elements or more along each axis")
    if count.prod() > MOST:
        raise InputError(where, "size", f"{size:g} mm, {count.prod()} cells", f"{MOST} cells at most")
    spacing = extent / count
    padded = np.pad(values, 2)
    flat = _continued(padded, np.pad(body, 2), np.pad(np.isin(values, left_out), 2), np.rint(spacing).astype(int))
    there = np.unique(values)
    depths = {int(label): depth_in(padded == label, 1 / spacing) for label in dict.fromkeys([0, *there])}
    cells = Cells(np.zeros(0), low + 2.0, spacing, depths, picture, flat)
    centres = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in count), indexing="ij"), axis=-1)
    known = list(depths)
    deep = np.array([cells.depth(label, centres.reshape(-1, len(count))) for label in known])
    best = unpinched(deep.argmax(axis=0).reshape(count), -deep.reshape(-1, *count))
    # around the box nothing of the body lies, but pads may: where the first pixel beyond is in one, or nearly so, since
    # the cells under it are those whose middle is in the body
    beyond = [np.clip(np.arange(-1, n + 1) + 0.5, -0.5 / k, n + 0.5 / k) for n, k in zip(count, spacing, strict=True)]
    around = np.stack(np.meshgrid(*beyond, indexing="ij"), axis=-1).reshape(-1, len(count))
    pads = [0, *left_out]
    deep = np.array([np.full(len(around), ASIDE), *(cells.depth(label, around) for label in left_out)])
    labels = np.array(pads)[deep.argmax(axis=0)].reshape(count + 2)
    labels[(slice(1, -1),) * len(count)] = np.array(known)[best]
    labels[np.isin(labels, left_out)] *= -1  # a border of the body, as what is outside
    # padded pixels lie two before those of the picture, and the first cell is one before the body
    moved = Picture(
        picture.values, picture.spacing, picture.to_points(np.full((1, len(count)), -2.0))[0], picture.direction
    )
    return Cells(labels, low + 2.0 - spacing, spacing, depths, moved, flat)


def _continued(labels: np.ndarray, body: np.ndarray, holes: np.ndarray, deeper: np.ndarray) -> np.ndarray:
    """Whether the body ends flat, shape (dim, 2); where it does, and no hole is beyond, its labels go on beyond it.

    Depths of what is beside it then have no rounded rim. A side is flat where holes lie on half of it, or it is half as
    large as the section that is `deeper` by an element.
    """
    flat = np.zeros((labels.ndim, 2), dtype=bool)
    for axis in range(labels.ndim):
        for upper in (0, 1):
            held, cut, own = (
                np.flip(np.moveaxis(one, axis, 0), 0) if upper else np.moveaxis(one, axis, 0)
                for one in (body, holes, labels)
            )
            end = int(np.flatnonzero(held.any(axis=tuple(range(1, labels.ndim))))[0])
            covered = (cut[end - 1] & held[end]).sum() / held[end].sum()
            flat[axis, upper] = max(covered, held[end].sum() / held[end + deeper[axis]].sum()) >= FLAT
            if flat[axis, upper] and not cut[:end].any():
                own[:end] = own[end]
    return flat


def depth_in(inside: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Distance of pixels to the border of what is inside, smooth: above 0 in it, below 0 outside.

    Parameters
    ----------
    inside : ndarray of bool, shape (nx, ny[, nz])
    spacing : ndarray, shape (dim,)
        Size of a pixel, in the unit of the distance.
    """
    from scipy import ndimage

    if inside.all() or not inside.any():
        return np.full(inside.shape, np.linalg.norm(inside.shape * spacing) * (1 if inside.all() else -1))
    ways = [ndimage.distance_transform_edt(part, sampling=spacing) for part in (inside, ~inside)]
    return np.asarray(ndimage.gaussian_filter(ways[0] - ways[1], BLUR))


def unpinched(labels: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Labels without cells that touch those of their kind over an edge alone: surfaces would touch themselves there.

    Parameters
    ----------
    labels : ndarray of int, shape (nx, ny[, nz])
        From 0.
    cost : ndarray, shape (labels, nx, ny[, nz])
        Of each label in a cell: how far its border is.
    """
    found = np.pad(labels, 1)
    cost = np.pad(cost, [(0, 0), *[(1, 1)] * labels.ndim], constant_values=np.inf)
    for _ in range(PASSES):
        pinched = [
            spot for a in range(labels.ndim) for b in range(a + 1, labels.ndim) for spot in _pinched(found, a, b)
        ]
        for four in pinched:
            kinds = [int(found[cell]) for cell in four]
            if _touches(kinds):  # not mended by one before it
                ways = [
                    (float(cost[new][cell]), n, new) for n, cell in enumerate(four) for new in set(kinds) - {kinds[n]}
                ]
                _, n, new = min(way for way in ways if not _touches([*kinds[: way[1]], way[2], *kinds[way[1] + 1 :]]))
                found[four[n]] = new
        if not pinched:
            break
    return found[(slice(1, -1),) * labels.ndim]


def _touches(kinds: list[int]) -> bool:
    """Whether of four cells around an edge (in rows) two of a diagonal are alike, and no neighbours of theirs."""
    one, third, last, other = kinds
    return (one == other and one not in (third, last)) or (third == last and third not in (one, other))


def _pinched(labels: np.ndarray, a: int, b: int) -> list[list[tuple[int, ...]]]:
    """The four cells around each edge across two axes at which labels touch themselves."""
    view = np.moveaxis(labels, (a, b), (0, 1))
    one, other, third, last = view[:-1, :-1], view[1:, 1:], view[:-1, 1:], view[1:, :-1]
    wrong = ((one == other) & (third != one) & (last != one)) | ((third == last) & (one != third) & (other != third))
    found = []
    for i, j, *rest in np.argwhere(wrong).tolist():
        four = []
        for x, y in ((0, 0), (0, 1), (1, 0), (1, 1)):
            cell = list(rest)
            for axis, index in sorted(((a, i + x), (b, j + y))):
                cell.insert(axis, index)
            four.append(tuple(cell))
        found.append(four)
    return found
