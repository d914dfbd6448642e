"""DICOM series in a folder and the folders below it, in the order in which they were acquired."""

from __future__ import annotations

import contextlib
import os
import re
from dataclasses import dataclass
from pathlib import Path

_DEEPEST = 6
"""Folders below each other that are looked through; exports have patient, study and series. A choice."""
_TIMES = (("0008|0022", "0008|0032"), ("0008|0021", "0008|0031"))
"""Date and time of the acquisition, else of the series (DICOM PS3.6)."""
_NUMBER, _TEXT = "0020|0011", "0008|103e"


@dataclass(frozen=True)
class Series:
    """One series.

    Parameters
    ----------
    files : tuple of Path
    when : str
        Date and time, as DICOM writes them: they sort as texts; empty where they are not told.
    number : int
        As the scanner counts; 0 where it does not.
    text : str
        Description, of letters, digits, _ and - alone.
    """

    files: tuple[Path, ...]
    when: str
    number: int
    text: str


def find_series(folder: Path) -> list[Series]:
    """All series below a folder by time, where all have one, else by number."""
    import SimpleITK as sitk

    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    found = []
    for place, folders, names in os.walk(folder):
        deep = len(Path(place).relative_to(folder).parts)
        folders[:] = sorted(name for name in folders if not name.startswith(".")) if deep < _DEEPEST else []
        for name in sitk.ImageSeriesReader.GetGDCMSeriesIDs(place) if names else ():
            found.append(
                _described([Path(file) for file in sitk.ImageSeriesReader.GetGDCMSeriesFileNames(place, name)])
            )
    timed = all(series.when for series in found)
    return sorted(found, key=lambda series: (series.when if timed else "", series.number, str(series.files[0])))


def _described(files: list[Path]) -> Series:
    import SimpleITK as sitk

    reader = sitk.ImageFileReader()
    reader.SetFileName(str(files[0]))
    with contextlib.suppress(RuntimeError):  # who reads the picture is told what is wrong with it
        reader.ReadImageInformation()

    def tag(name: str) -> str:
        return reader.GetMetaData(name).strip() if reader.HasMetaDataKey(name) else ""

    when = next((f"{tag(day)} {tag(time)}" for day, time in _TIMES if tag(time)), "")
    number = tag(_NUMBER)
    return Series(tuple(files), when, int(number) if number.isdecimal() else 0, re.sub(r"[^\w-]+", "_", tag(_TEXT)))
