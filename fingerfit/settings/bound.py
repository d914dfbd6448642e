"""Effects as a study has them: what is a share of its body, its load or its duration becomes a number, and what its
control does not let them do falls away."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from fingerfit.core.errors import FingerfitError
from fingerfit.deck.mesh_file import read_mesh
from fingerfit.model.catalogue import catalogue, effect_files
from fingerfit.model.effect import Effect
from fingerfit.model.regions import region_effects
from fingerfit.model.scales import bound, scales
from fingerfit.study.reader import load_study, study_path
from fingerfit.study.study import Study

_KEPT = 8
"""Studies whose effects are kept: each model of a diagnosis asks for them several times. A choice."""


def effects_of(folder: Path, whole: bool = False) -> dict[str, Effect]:
    """All effects that are known in a study; with their shares as they are where there is no study to be read.

    Parameters
    ----------
    folder : Path
    whole : bool
        Whether they keep what the control of the study leaves without meaning.

    Raises
    ------
    FingerfitError
        For effects that cannot be read, and shares of what is not above 0.
    """
    file = study_path(folder)
    if not file.is_file():
        return catalogue(folder)
    return dict(_bound(folder, effect_files(folder), file, _stamps(file.parent), whole))


@functools.lru_cache(maxsize=_KEPT)
def _bound(
    folder: Path, effects: tuple[tuple[Path, int], ...], file: Path, stamps: tuple[tuple[str, int], ...], whole: bool
) -> dict[str, Effect]:
    """The effects of a study, as long as neither its files nor those of effects change."""
    sizes, regions, control = _of_study(file, stamps)
    return {**region_effects(regions), **bound(catalogue(folder), dict(sizes), "" if whole else control)}


@functools.cache
def _of_study(
    file: Path, stamps: tuple[tuple[str, int], ...]
) -> tuple[tuple[tuple[str, float], ...], tuple[str, ...], str]:
    """What numbers can be shares of, names of regions, and what all tests prescribe, force or displacement.

    Nothing where the study is wrong, which is told where it is read to be used.
    """
    try:
        # shares of what the first test does not have are of the next one that does
        whole = load_study(file)
        tests = [scales(study, extent_of(study)) for study in whole.every]
        sizes = {name: size for own in reversed(tests) for name, size in own.items()}
        controls = {study.control for study in whole.every}
        return tuple(sizes.items()), tuple(whole.region_names), controls.pop() if len(controls) == 1 else ""
    except FingerfitError:
        return (), (), ""


def _stamps(folder: Path) -> tuple[tuple[str, int], ...]:
    files = (path for path in sorted(folder.iterdir()) if path.is_file())
    return tuple((path.name, path.stat().st_mtime_ns) for path in files)


def extent_of(study: Study) -> list[float]:
    """Extent of a study's body along each axis, mm; no mesh is made of a block or a brick.

    Raises
    ------
    FingerfitError
        For a mesh that cannot be read.
    """
    body = study.body
    if body.width is not None:
        return [body.width, sum(layer.height or 0.0 for layer in body.layers)]
    if body.brick is not None:
        return list(body.brick)
    if body.mesh is None:
        raise FingerfitError(f"{study.path}: body: no shape")
    size: list[float] = (np.ptp(read_mesh(body.mesh).body, axis=0) * study.length).tolist()
    return size
