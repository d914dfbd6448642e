"""Predictions of many guesses, made beside each other; the pictures of volumes lie on disk.

A fit of volumes by tens of numbers predicts two guesses for each. In memory these alone were 10 GB of five volumes of a
fingertip; on disk they are read when a slope is taken, and the system takes the memory back when it needs it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from fingerfit.core.processes import side_by_side
from fingerfit.fit.linear import IN_SPACE
from fingerfit.fit.rounds import Asked
from fingerfit.forward.predict import Synthesis
from fingerfit.forward.score import Prediction


def predicted(
    make: Callable[[Asked], Synthesis | None],
    guesses: Sequence[Asked],
    shape: tuple[int, ...],
    folder: Path,
    processes: int,
) -> list[tuple[Prediction, bool] | None]:
    """Predictions without their maps, each with whether the body folds; None for a guess without a solution.

    Parameters
    ----------
    make : callable
    guesses : sequence of Asked
    shape : tuple of int
        Of the pictures of all steps.
    folder : Path
        On the disk where they lie, in files that have no name and end with this process.
    processes : int
    """
    volumes = len(shape) == IN_SPACE and min(shape) > 0
    # opened here, so that a process that helps writes into the file that this one reads
    files = [tempfile.TemporaryFile(buffering=0, dir=folder) if volumes else None for _ in guesses]  # noqa: SIM115

    def made(number: int) -> tuple[Prediction, bool] | None:
        synthesis = make(guesses[number])
        if synthesis is None:
            return None
        prediction, folds = synthesis.without_maps
        return _written(prediction, files[number]), folds

    found = side_by_side(made, range(len(guesses)), processes)
    return [one and (_read(one[0], file, shape), one[1]) for one, file in zip(found, files, strict=True)]


def _written(prediction: Prediction, file: IO[bytes] | None) -> Prediction:
    """The prediction without the pictures that are now in the file."""
    if file is None:
        return prediction
    prediction.pictures.tofile(file)
    return replace(prediction, pictures=prediction.pictures[:0].copy())


def _read(prediction: Prediction, file: IO[bytes] | None, shape: tuple[int, ...]) -> Prediction:
    if file is None:
        return prediction
    with file:
        pictures: Any = np.memmap(file, prediction.pictures.dtype, "r", shape=shape)
    return replace(prediction, pictures=np.asarray(pictures))
