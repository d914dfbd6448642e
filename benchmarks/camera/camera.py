"""Pictures of a deformed body, as a camera takes them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from block import Block, shape_functions
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from texture import Texture

PointMap = Callable[[np.ndarray], np.ndarray]
"""Function of points (n, 2) in mm."""
ASKEW = (0.7548776662, 0.6180339887)
"""Steps of the points' shifts, along x from row to row and along y from column to column."""


@dataclass(frozen=True)
class PixelGrid:
    """Pixels of a picture: centre of the lower left one and side, both in mm, and their numbers. Rows go upwards."""

    x: float
    y: float
    pixel: float
    columns: int
    rows: int


@dataclass
class Located:
    """Where points of a picture lie in the unloaded body.

    Parameters
    ----------
    inside : ndarray of bool (points,)
        Points that lie in the body.
    places : ndarray (points inside, 2)
        Where they lie in the unloaded body, mm.
    layers : ndarray (points inside,)
        Their layers.
    error : float
        Largest distance by which a point is missed, over the height of the body.
    """

    inside: np.ndarray
    places: np.ndarray
    layers: np.ndarray
    error: float


def locate(
    block: Block, displacements: np.ndarray, points: np.ndarray, samples: int = 5, candidates: int = 8
) -> Located:
    """Find points of the deformed body in the unloaded one.

    Each deformed element has a grid of samples. The elements of the samples nearest to a point are tried one after the
    other: Newton's method inverts the element's quadratic map.

    Parameters
    ----------
    block : Block
        The mesh.
    displacements : ndarray (nodes, 2)
        Displacements, mm.
    points : ndarray (points, 2)
        Points in the deformed body or beside it, mm.
    samples : int
        Samples along the side of an element.
    candidates : int
        Samples that are tried for each point.
    """
    centres = (np.arange(samples) + 0.5) / samples * 2 - 1
    xi, eta = (axis.ravel() for axis in np.meshgrid(centres, centres))
    values, _ = shape_functions(xi, eta)
    deformed = (block.nodes + displacements)[block.elements]
    cloud = np.einsum("qa,eai->eqi", values, deformed)
    spacing = np.linalg.norm(deformed[:, 8] - deformed[:, 0], axis=1).max() / samples
    tree = cKDTree(cloud.reshape(-1, 2))
    distance, nearest = tree.query(points, k=candidates, distance_upper_bound=1.5 * spacing)
    element = np.full(len(points), -1)
    local = np.zeros((len(points), 2))
    missing = np.isfinite(distance[:, 0])
    for rank in range(candidates):
        which = np.nonzero(missing & np.isfinite(distance[:, rank]))[0]
        if not len(which):
            break
        tried, sample = nearest[which, rank] // len(xi), nearest[which, rank] % len(xi)
        found, apart = _inverted(deformed[tried], points[which], np.stack([xi[sample], eta[sample]], -1))
        right = (np.abs(found).max(1) <= 1 + 1e-7) & (np.linalg.norm(apart, axis=1) < 1e-6 * block.height)
        element[which[right]] = tried[right]
        local[which[right]] = found[right]
        missing[which[right]] = False
    inside = element >= 0
    element = element[inside]
    values, _ = shape_functions(local[inside, 0], local[inside, 1])
    again = np.einsum("na,nai->ni", values, deformed[element])
    error = np.linalg.norm(again - points[inside], axis=1).max() / block.height
    places = np.einsum("na,nai->ni", values, block.nodes[block.elements[element]])
    return Located(inside, places, block.layer[element], error)


def _inverted(nodes: np.ndarray, points: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Local coordinates of points, each in an element with nodes (points, 9, 2), and what the last step began with."""
    local = start
    for _ in range(8):
        values, slopes = shape_functions(local[:, 0], local[:, 1])
        apart = points - np.einsum("na,nai->ni", values, nodes)
        jacobian = np.einsum("nai,naj->nij", nodes, slopes)
        det = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
        det = np.where(np.abs(det) < 1e-14, 1e-14, det)
        step = (
            np.stack(
                [
                    jacobian[:, 1, 1] * apart[:, 0] - jacobian[:, 0, 1] * apart[:, 1],
                    jacobian[:, 0, 0] * apart[:, 1] - jacobian[:, 1, 0] * apart[:, 0],
                ],
                -1,
            )
            / det[:, None]
        )
        local = np.clip(local + np.clip(step, -0.6, 0.6), -1.6, 1.6)
    return local, apart


def points_askew(grid: PixelGrid, within: int) -> np.ndarray:
    """Points (rows * within * columns * within, 2) in mm, `within` along each side of a pixel.

    Each row and each column of points is shifted a little, so that level edges do not move in thirds of a pixel.
    """
    offsets = (np.arange(within) + 0.5) / within - 0.5
    x = grid.x + grid.pixel * (np.arange(grid.columns)[:, None] + offsets).ravel()
    y = grid.y + grid.pixel * (np.arange(grid.rows)[:, None] + offsets).ravel()
    points = np.stack(np.meshgrid(x, y), -1)
    points[..., 1] += grid.pixel / within * ((np.arange(len(x)) * ASKEW[1]) % 1 - 0.5)[None, :]
    points[..., 0] += grid.pixel / within * ((np.arange(len(y)) * ASKEW[0]) % 1 - 0.5)[:, None]
    return points.reshape(-1, 2)


@dataclass
class Picture:
    """A picture without noise.

    Parameters
    ----------
    values : ndarray (rows, columns)
        Intensity.
    share : ndarray (rows, columns)
        Share of each pixel that lies in the body.
    error : float
        As in `Located`.
    """

    values: np.ndarray
    share: np.ndarray
    error: float


def take(
    block: Block,
    displacements: np.ndarray,
    texture: Texture,
    grid: PixelGrid,
    within: int = 3,
    lens: PointMap | None = None,
    light: PointMap | None = None,
    background: float = 0.0,
    mean: float = 1.0,
    blur: float = 0.0,
) -> Picture:
    """Take a picture of a deformed body: mean over the points of each pixel, then a blur in the picture.

    Parameters
    ----------
    block, displacements : Block, ndarray (nodes, 2)
        The deformed body; mm.
    texture : Texture
        What lies in the unloaded body.
    grid : PixelGrid
        The pixels.
    within : int
        Points along the side of a pixel.
    lens : callable or None
        Point of the body that is seen at a point of the picture.
    light : callable or None
        Factor of the intensity at a point of the picture.
    background, mean : float
        Intensity beside the body, and mean intensity of the body.
    blur : float
        Standard deviation of the Gaussian blur, pixels.
    """
    points = points_askew(grid, within)
    located = locate(block, displacements, lens(points) if lens else points)
    values = np.full(len(points), float(background))
    values[located.inside] = mean * texture.at(located.places, located.layers)
    if light is not None:
        values *= light(points)
    parts = (grid.rows, within, grid.columns, within)
    return Picture(
        gaussian_filter(values.reshape(parts).mean((1, 3)), blur),
        located.inside.reshape(parts).mean((1, 3)),
        located.error,
    )
