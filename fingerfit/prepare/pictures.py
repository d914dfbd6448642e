"""From the pictures of a study to arrays that can be compared: reading, and the chain of preparation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.imaging.content import constant, out_of_order, pixels, repeated, unlike
from fingerfit.imaging.noise import estimate_noise, noise_of_repeats
from fingerfit.imaging.outline import Outline, measure_outline
from fingerfit.imaging.pictures import Picture, read_picture
from fingerfit.imaging.preprocess import noise_after_resizing, resize, scale_of, smooth
from fingerfit.imaging.warp import backward_map, spline_coefficients
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import OUTLINE
from fingerfit.settings.choices import CONFIG
from fingerfit.study.study import Study

_PIXELS = 2
"""Across the body, along each axis: in fewer no difference of pixels inside it could show a deformation."""
_LEAST = 0.5
"""Share of a mesh that must lie in the pictures."""


@dataclass(frozen=True)
class Prepared:
    """Pictures of a study after the chain.

    Parameters
    ----------
    before : Picture
        Before compression, scaled and smoothed.
    coefficients : ndarray
        Cubic B-spline coefficients of the same, scaled only.
    measured : ndarray, shape (pictures, ny, nx) or (pictures, nz, ny, nx)
        During compression, scaled and smoothed.
    noise : float
        Standard deviation before smoothing, in scaled intensity.
    background : float
        Scaled intensity where there is no body.
    smooth : float
        Standard deviation of the Gaussian, pixels.
    history : str
        What was done, in words, one step a line.
    remarks : list of str
        What looks wrong in them, in words.
    outline : Outline, optional
        Sides of the body in the one before compression; None where they are not measured, or the mesh follows them.
    """

    before: Picture
    coefficients: np.ndarray
    measured: np.ndarray
    noise: float
    background: float
    smooth: float
    history: str
    remarks: list[str]
    outline: Outline | None


def prepare_pictures(study: Study, mesh: Mesh, used: list[int], sigma: float, crop: float) -> Prepared | None:
    """Read and prepare the pictures of steps; None when there are none.

    Parameters
    ----------
    study : Study
        Its chain says what is done.
    mesh : Mesh
        To see where the body is.
    used : list of int
        Indices of the steps.
    sigma : float
        Gaussian, pixels, where the chain leaves it open.
    crop : float
        How far around the body pictures are kept, as a share of its extent.

    Raises
    ------
    Problems
        With one line for everything that is wrong with the files.
    InputError
        For a chain that does not fit them, or a mesh that does not lie in them.
    """
    chain, said = study.chain, []

    def trimmed(picture: Picture) -> Picture:
        box = chain.trim
        if isinstance(box, str):
            return picture if box == "off" else picture.crop(mesh.body, crop)
        return picture.crop(_corners(box), 0.0)

    if not used or study.before is None:
        return None
    before = _read_before(study, study.before, mesh)
    _check_place(study, mesh, before)
    part = trimmed(before)
    said.append(_words_of_trim(study, before, part, crop))
    pictures, away = _of_steps(study, study.before, used, before, part, trimmed)
    own = chain.gaussian is not None
    sigma = float(chain.gaussian) if chain.gaussian is not None else sigma
    low, size = scale_of(before.values) if chain.scale else (0.0, 1.0)
    if not chain.scale and not -0.5 <= before.values.min() <= before.values.max() <= 1.5:
        spread = f"off, with intensities from {before.values.min():.4g} to {before.values.max():.4g}"
        raise InputError(study.path, "pictures.scale", spread, "range, or pictures with intensities from 0 to 1")
    noise = _noise(study, mesh, before)
    remarks = _order_remarks(study, part, away, noise, lambda path: trimmed(read_picture(path)).values)

    def prepared(part: Picture) -> Picture:
        picture = part if chain.resize is None else resize(part, chain.resize)
        # noise makes more than single precision of volumes, of which there are many, worthless
        values = ((picture.values - low) / size).astype(np.float32 if picture.dim == 3 else np.float64)
        return Picture(values, picture.spacing, picture.origin, picture.direction)

    if chain.resize is not None:
        noise *= noise_after_resizing(part, chain.resize)
    raw = prepared(part)
    if sigma > min(raw.values.shape):  # such a Gaussian, at mirrored borders, leaves no difference along that axis
        where, field = (study.path, "pictures.gaussian") if own else (CONFIG, "fit.smooth")
        raise InputError(where, field, f"{sigma:g} pixels", f"at most the extent of the pictures: {_pixels(raw)}")
    said.append(f"resize: to {_pixels(raw)}" if chain.resize else "resize: off")
    values = smooth(raw.values, sigma)
    said.append(f"Gaussian: standard deviation of {sigma:g} pixels" if sigma else "Gaussian: off")
    said.append(f"scale: intensity {low:.5g} to 0, {low + size:.5g} to 1" if chain.scale else "scale: off")
    measured = np.empty((len(pictures), *values.shape), values.dtype)
    for n, picture in enumerate(pictures):
        measured[n] = smooth(prepared(picture).values, sigma)
    empty = _empty(raw, mesh)
    outline = outline_of(study, raw)
    # a mesh that follows the picture is no rectangle
    follows = outline is not None and not np.allclose(
        [mesh.points.min(axis=0), mesh.points.max(axis=0)], _rectangle(study)
    )
    outline = None if follows else outline
    elsewhere = outline.elsewhere() if outline is not None else {}
    return Prepared(
        before=Picture(values, raw.spacing, raw.origin, raw.direction),
        coefficients=spline_coefficients(raw.values).astype(values.dtype),
        measured=measured,
        noise=noise / size,
        background=float(np.median(values[empty])) if empty.any() else float(values.min()),
        smooth=sigma,
        history="\n".join(said),
        remarks=remarks + _outline_remarks(study, elsewhere),
        outline=outline,
    )


def outline_of(study: Study, picture: Picture) -> Outline | None:
    """Where a picture before compression shows the sides of a block; None for other bodies and in space."""
    if study.body.width is None or picture.dim != 2:
        return None
    return measure_outline(picture, *_rectangle(study))


def _rectangle(study: Study) -> np.ndarray:
    """Lower left and upper right corner of a block as the study states it, shape (2, 2), mm."""
    low, height = np.array(study.body.origin), sum(layer.height or 0.0 for layer in study.body.layers)
    return np.stack([low, low + np.array([study.body.width or 0.0, height])])


def covers(mesh: Mesh, picture: Picture) -> np.ndarray:
    """Pixels on the undeformed body, shape of the picture, bool."""
    covered = np.zeros(picture.values.size, dtype=bool)
    covered[backward_map(mesh, np.zeros(mesh.points.shape), picture).pixel] = True
    return covered.reshape(picture.values.shape)


def _read_before(study: Study, path: Path, mesh: Mesh) -> Picture:
    """The whole picture before compression."""
    before = read_picture(path)
    if before.dim != mesh.dim:
        raise InputError(path, "picture", f"{before.dim} dimensions", f"{mesh.dim}, as the mesh")
    chain, expected = study.chain, f"{before.dim}, as the pictures"
    if chain.resize is not None and len(chain.resize) != before.dim:
        raise InputError(study.path, "pictures.resize", f"{len(chain.resize)} numbers", expected)
    if not isinstance(chain.trim, str) and len(chain.trim[0]) != before.dim:
        raise InputError(study.path, "pictures.trim", f"corners of {len(chain.trim[0])} numbers", expected)
    return before


def _of_steps(
    study: Study, first: Path, used: list[int], before: Picture, part: Picture, trimmed: Callable[[Picture], Picture]
) -> tuple[list[Picture], dict[int, float]]:
    """What is left after trimming of the pictures of fitted steps; those of all steps are checked.

    Pictures of steps that are held out, which the diagnosis compares, are read one at a time and not kept: how unlike
    the one before compression each is, by the index of its step, is.
    """
    problems: list[FingerfitError] = []
    fitted, away = list[Picture](), dict[int, float]()
    paths: dict[Path, int] = {}
    known = {pixels(part.values): first}
    if found := constant(part.values):
        problems.append(InputError(first, "picture", found, "a picture that shows the body"))
    for index, step in enumerate(study.steps):
        path = step.picture
        if path is None:
            continue
        if (earlier := paths.setdefault(path, step.number)) != step.number:
            found = f"{path.name} at steps {earlier} and {step.number}"
            where = study.table or study.path
            problems.append(InputError(where, "picture", found, "a picture of its own for each step"))
            continue
        try:
            picture = trimmed(_like(before, first.name, path))
        except InputError as error:
            problems.append(error)
            continue
        if found := constant(picture.values):
            problems.append(InputError(path, "picture", found, "a picture that shows the body"))
        elif (same := known.setdefault(pixels(picture.values), path)) != path:
            found = f"the pixels of {same.name}"
            problems.append(InputError(path, "picture", found, "a picture of its own for each step"))
        away[index] = unlike(picture.values, part.values)
        if index in used:
            fitted.append(picture)
    if problems:
        raise Problems(problems)
    return fitted, away


def _like(before: Picture, name: str, path: Path) -> Picture:
    """A picture in the same place as the one before compression."""
    picture = read_picture(path)
    if not picture.same_place(before):
        raise InputError(path, "geometry", picture.difference(before), f"that of {name}")
    return picture


def _noise(study: Study, mesh: Mesh, before: Picture) -> float:
    """Standard deviation in the intensity of the files."""
    given = study.noise.picture
    if isinstance(given, float):
        extent = float(np.ptp(before.values))
        if given > extent > 0:
            expected = f"at most {extent:.4g}, the range of the picture before compression"
            raise InputError(study.path, "pictures.noise", f"{given:g}", expected)
        return given
    if isinstance(given, tuple) and study.before is not None:
        again = _repetitions(before, study.before.name, given)
        same = repeated([before.values, *(one.values for one in again)])
        if same is not None:
            first, second = ([study.before, *given][n] for n in same)
            raise InputError(
                second, "picture", f"the pixels of {first.name}", "a repetition, which has noise of its own"
            )
        return noise_of_repeats([one.values for one in (before, *again)], covers(mesh, before))
    return estimate_noise(before.values, _empty(before, mesh))


def _repetitions(before: Picture, name: str, paths: Iterable[Path]) -> list[Picture]:
    """Further pictures before compression; all problems at once."""
    problems: list[FingerfitError] = []
    pictures = []
    for path in paths:
        try:
            pictures.append(_like(before, name, path))
        except InputError as error:
            problems.append(error)
    if problems:
        raise Problems(problems)
    return pictures


def _order_remarks(
    study: Study, before: Picture, away: Mapping[int, float], noise: float, read: Callable[[Path], np.ndarray]
) -> list[str]:
    """Whether pictures become less like the one before compression as the prescribed quantity grows.

    Those of held-out steps count as well: the diagnosis compares them. `away` is how unlike each is, by the index of
    its step; `read` gives the picture of a file.
    """
    steps = [(study.steps[index], path) for index in away if (path := study.steps[index].picture) is not None]
    load = np.array([getattr(step, study.control) for step, _ in steps], dtype=float)
    given = getattr(study.noise, study.control)
    spread = given if isinstance(given, float) else 0.0
    found = out_of_order(before.values, list(away.values()), load, noise, spread, lambda n: read(steps[n][1]))
    if found is None or study.before is None:
        return []
    less, more = (steps[n][0] for n in found)
    unit = {"force": "N", "displacement": "mm"}[study.control]
    sizes = [f"{getattr(step, study.control):.4g} {unit}" for step in (more, less)]
    names = [f"{step.picture.name} (step {step.number})" for step in (more, less) if step.picture]
    return [
        f"{names[0]} at {sizes[0]} is more like {study.before.name} than {names[1]} at {sizes[1]}, by more than noise"
        " explains: are pictures swapped?"
    ]


def _outline_remarks(study: Study, elsewhere: Mapping[str, float]) -> list[str]:
    if not elsewhere or study.before is None:
        return []
    words = ", ".join(
        f"the {name} one {abs(out):.2g} mm further {'out' if out > 0 else 'in'}" for name, out in elsewhere.items()
    )
    return [
        f"{study.before.name} shows sides of the body elsewhere than body says: {words}; correct width, origin and"
        f" heights, or take the effect {OUTLINE}"
    ]


def _check_place(study: Study, mesh: Mesh, before: Picture) -> None:
    """Refuse a mesh that lies beside the pictures, or for the most part, or in so few pixels that they show nothing."""
    index, size = before.to_index(mesh.body), np.array(before.values.shape[::-1])
    across = np.ptp(index, axis=0)
    if across.min() < _PIXELS:
        found = " x ".join(f"{n:.3g}" for n in across) + " pixels for the whole body"
        raise InputError(
            study.before or "", "picture", found, f"{_PIXELS} or more along each axis; look at units.length"
        )
    inside = ((index > -0.5) & (index < size - 0.5)).all(axis=1).mean()
    if inside >= _LEAST and covers(mesh, before).any():
        return
    corners = before.to_points(np.stack([np.full(before.dim, -0.5), size - 0.5]))
    where = [", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(p.min(axis=0), p.max(axis=0), strict=True))
             for p in (mesh.body, corners)]  # fmt: skip
    found = f"{100 * inside:.0f} % of the mesh in it (mesh {where[0]} mm; picture {where[1]} mm)"
    raise InputError(study.before or "", "picture", found, "a picture that overlaps the body")


def _corners(box: tuple[tuple[float, ...], tuple[float, ...]]) -> np.ndarray:
    low, high = np.array(box)
    index = np.indices((2,) * len(low)).reshape(len(low), -1).T
    return np.where(index, high, low)


def _words_of_trim(study: Study, before: Picture, part: Picture, crop: float) -> str:
    trim = study.chain.trim
    if trim == "off":
        return f"trim: off, {_pixels(before)}"
    if min(part.values.shape) < 2:
        raise InputError(study.path, "pictures.trim", f"a box that leaves {_pixels(part)}", "a box in the pictures")
    what = f"the body and {100 * crop:.0f} % of its extent around it" if trim == "body" else "the box"
    return f"trim: to {what}, {_pixels(part)} of {'x'.join(map(str, before.values.shape[::-1]))}"


def _pixels(picture: Picture) -> str:
    size = " x ".join(map(str, picture.values.shape[::-1]))
    return f"{size} pixels of {' x '.join(f'{s:.4g}' for s in picture.spacing)} mm"


def _empty(picture: Picture, mesh: Mesh) -> np.ndarray:
    """Pixels far from the body: outside its bounding box by more than a fifth of its size."""
    low, high = mesh.body.min(axis=0), mesh.body.max(axis=0)
    margin = 0.2 * (high - low)
    found = np.empty(picture.values.shape, dtype=bool)
    plane = np.indices(picture.values.shape[1:])[::-1].reshape(picture.dim - 1, -1).T.astype(float)
    for slab in range(len(found)):  # one slice at a time: the places of a volume would be many times its size
        where = picture.to_points(np.column_stack([plane, np.full(len(plane), float(slab))]))
        outside = ((where < low - margin) | (where > high + margin)).any(axis=1)
        found[slab] = outside.reshape(found.shape[1:])
    return found
