"""Pictures of deformed blocks: where each pixel's material comes from, light, lens, noise, files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import nibabel
import numpy as np
from matplotlib.tri import Triangulation

Array = np.ndarray


@dataclass
class Camera:
    """Pixels of all pictures of a study.

    Attributes
    ----------
    origin
        Centre of the lower left pixel, in the coordinates of the block.
    pixel
        Size of a pixel, mm.
    shape
        Number of pixels along x and y.
    lens
        From true places (n, 2) to places in the picture, as a map from places in the picture to true places.
    light
        Factor of brightness at places (n, 2) at a step (0 before compression).
    """

    origin: tuple[float, float]
    pixel: float
    shape: tuple[int, int]
    lens: Callable[[Array], Array] | None = None
    light: Callable[[Array, int], Array] | None = None

    def places(self, fine: int = 1) -> Array:
        """Centres of pixels, or of `fine` x `fine` parts of each (pixels, parts, 2)."""
        offsets = (np.arange(fine) + 0.5) / fine - 0.5
        x = self.origin[0] + self.pixel * np.arange(self.shape[0])
        y = self.origin[1] + self.pixel * np.arange(self.shape[1])
        centre = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 1, 2)
        part = self.pixel * np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(1, -1, 2)
        return centre + part

    def picture(self, net: tuple[Array, Array, Array], texture: Callable[[Array], Array], step: int) -> Array:
        """Picture without noise of a net (X, x, triangles)."""
        fine = self.places(4)
        at = fine.reshape(-1, 2)
        true = at if self.lens is None else self.lens(at)
        material, inside = inverse(net, true)
        value = np.zeros(len(true))
        value[inside] = texture(material[inside])
        if self.light is not None:
            value *= self.light(true, step)
        return value.reshape(fine.shape[:2]).mean(axis=1).reshape(self.shape)


def inverse(net: tuple[Array, Array, Array], at: Array) -> tuple[Array, Array]:
    """Material points X of places `at` (n, 2), and which of them lie in the body."""
    before, after, triangles = net
    finder = Triangulation(after[:, 0], after[:, 1], triangles).get_trifinder()
    found = finder(at[:, 0], at[:, 1])
    inside = found >= 0
    corner = triangles[found[inside]]
    a, b, c = (after[corner[:, k]] for k in range(3))
    matrix = np.stack([b - a, c - a], axis=-1)
    share = np.linalg.solve(matrix, (at[inside] - a)[:, :, None])[:, :, 0]
    origin, one, two = (before[corner[:, k]] for k in range(3))
    result = np.full(at.shape, np.nan)
    result[inside] = origin + share[:, :1] * (one - origin) + share[:, 1:] * (two - origin)
    return result, inside


def with_noise(picture: Array, kind: str, size: float, full: float, rng: np.random.Generator) -> Array:
    """Noise of `size` of the full scale, Gaussian on a black level or Rician, as whole numbers."""
    value = picture * full
    noise = size * full
    if kind == "rician":
        value = np.hypot(value + rng.normal(0, noise, value.shape), rng.normal(0, noise, value.shape))
    else:
        value = value + max(0.06, 5 * size - 0.04) * full + rng.normal(0, noise, value.shape)
    return np.clip(np.round(value), 0, 65535).astype(np.uint16)


def write(path: Path, picture: Array, camera: Camera, shift: tuple[float, float]) -> None:
    """Write a NIfTI file; `shift` is the place of the block's corner in the coordinates of the pictures.

    NIfTI counts towards right and front, fingerfit towards left and back: both axes change sign.
    """
    affine = np.diag([-camera.pixel, -camera.pixel, 1.0, 1.0])
    affine[0, 3], affine[1, 3] = -(camera.origin[0] + shift[0]), -(camera.origin[1] + shift[1])
    image = nibabel.Nifti1Image(picture, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
