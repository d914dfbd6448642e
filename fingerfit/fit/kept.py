"""Predictions of volumes that several jobs need: made once, kept on disk while the fit runs.

The last rounds of a fit and its estimate use the same slopes. To warp five volumes takes seconds for each guess; to
read them again takes a tenth of that.
"""

from __future__ import annotations

import shutil
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from fingerfit.core.checksums import told_of
from fingerfit.core.errors import StateError
from fingerfit.core.files import digest, read_npz, write_npz
from fingerfit.core.folders import PACKAGE
from fingerfit.forward.partial_volume import PartialVolume
from fingerfit.forward.score import Prediction
from fingerfit.study.data import Data

FOLDER = "kept"
"""In the folder of a model; nothing in it is a result."""
MANY = 4_000_000
"""Pixels of all pictures of a guess from which they are kept: these take a second to warp (benchmarks/warp.md)."""
_MAKERS = ("core", "forward", "imaging", "mesh", "study")
"""Packages whose sources make a prediction of a solution."""


@cache
def _sources() -> str:
    files = sorted(file for package in _MAKERS for file in (PACKAGE / package).rglob("*.py"))
    return digest(*(file.read_bytes() for file in files))


@dataclass(frozen=True)
class Kept:
    """Predictions on disk.

    Parameters
    ----------
    folder : Path
    data : Data
        Measurements.
    made_from : str
        What the predictions follow from beside the solution: measurements and sources.
    """

    folder: Path
    data: Data
    made_from: str

    @classmethod
    def beside(cls, file: Path, data: Data) -> Kept | None:
        """Predictions kept beside the file of the measurements; None where they are made as fast as read."""
        if data.measured.size < MANY:
            return None
        return cls(file.parent / FOLDER, data, digest(told_of(file), _sources()))

    def _file(self, key: str) -> Path:
        return self.folder / f"{self.made_from}-{digest(key)}.npz"

    def load(self, key: str) -> tuple[Prediction, bool] | None:
        """A prediction and whether the body goes through itself in it; None where it is not there, or damaged."""
        try:
            found = read_npz(self._file(key))
        except StateError:
            return None
        pictures = np.full(self.data.measured.shape, self.data.background, dtype=found["covered"].dtype)
        size = pictures.size
        pictures.ravel()[np.unpackbits(found["where"], count=size).view(bool)] = found["covered"]
        partial = PartialVolume(found["partial"], found["weight"]) if "partial" in found else None
        return Prediction(pictures, found["response"], found["points"], partial), bool(found["folded"])

    def save(self, key: str, prediction: Prediction, folded: bool) -> None:
        """Keep a prediction; of its pictures only what is not background."""
        pictures = prediction.pictures
        where = pictures != np.asarray(self.data.background, dtype=pictures.dtype)
        arrays = {
            "where": np.packbits(where),
            "covered": pictures[where],
            "response": prediction.response,
            "points": prediction.points,
            "folded": np.array(folded),
        }
        if prediction.partial:
            arrays |= {"partial": prediction.partial.pixel, "weight": prediction.partial.weight}
        if not self._file(key).exists():
            write_npz(self._file(key), arrays, compressed=False)

    def only(self, keys: Collection[str]) -> None:
        """Remove all others of these measurements."""
        wanted = {self._file(key) for key in keys}
        for file in self.folder.glob(f"{self.made_from}-*.npz"):
            if file not in wanted:
                file.unlink(missing_ok=True)


def forget(file: Path) -> None:
    """Remove what was kept beside a file of measurements: the fit is done."""
    shutil.rmtree(file.parent / FOLDER, ignore_errors=True)
