"""What can be opened as a picture in a bounded time and held in memory: known from headers, before pixels are read."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fingerfit.core.errors import LimitError
from fingerfit.core.files import check_regular, free_memory, megabytes

_HEAD = 2**16
"""Bytes of a file in which a header of text is looked for; MetaImage's and NRRD's have some hundred. A choice."""
_DATA = re.compile(rb"^[ \t]*(?:ElementDataFile|data ?file)[ \t]*[=:](.*)$", re.IGNORECASE | re.MULTILINE)
"""Where headers of MetaImage and NRRD name the file with the pixels."""


def check_files(path: Path) -> None:
    """Refuse pipes, devices and the like where pixels are sought: reading them would not end.

    Raises
    ------
    InputError
        For the file of a picture, files that its header names, or an entry of a folder.
    """
    if path.is_dir():
        for entry in sorted(path.iterdir()):
            if entry.exists() and not entry.is_dir():
                check_regular(entry, "picture", expected="a file of a DICOM series")
        return
    check_regular(path, "picture", expected="a picture file or a folder with a DICOM series")
    for part in _parts(path):
        if part.exists():  # what is missing is told when it is read
            check_regular(part, "picture", expected=f"a file, as the header {path.name} names it")


def _parts(path: Path) -> Iterator[Path]:
    """Other files with pixels of a picture."""
    if path.suffix.lower() in (".hdr", ".img"):  # a header of NIfTI or Analyze beside its pixels
        yield from (path.with_suffix(suffix + packed) for suffix in (".hdr", ".img") for packed in ("", ".gz"))
    if path.suffix.lower() not in (".mhd", ".mha", ".nhdr", ".nrrd"):
        return
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    found = _DATA.search(head)
    if found is None:
        return
    name = found[1].decode("latin-1").strip()
    names = [name]
    if name.upper().startswith("LIST"):
        names = head[found.end() :].decode("latin-1").splitlines()
    elif "%" in name:  # a pattern, and numbers from, to and step
        pattern = re.sub(r"%0?\d*[du]", "*", name.split()[0])
        names = [str(part.relative_to(path.parent)) for part in path.parent.glob(pattern)] if "/" not in pattern else []
    yield from (path.parent / name.strip() for name in names if name.strip() and name.strip().isprintable())


def check_memory(path: Path, reader: Any, files: int = 1) -> None:
    """Refuse a picture that the memory cannot hold, from its header alone.

    Parameters
    ----------
    path : Path
    reader : SimpleITK.ImageFileReader
        After `ReadImageInformation`.
    files : int
        Slices of the same size.

    Raises
    ------
    LimitError
        With the size that the header claims.
    """
    size = reader.GetSize()
    values = math.prod(size) * reader.GetNumberOfComponents() * files
    # ITK's pixels, a copy of them for numpy, and the same in double precision
    needed = values * (2 * _bytes(reader.GetPixelID()) + 8)
    free = free_memory()
    if needed > free:
        shape = " x ".join(map(str, size if files == 1 else [*size[:2], files]))
        found = f"{shape} pixels, {megabytes(needed)} to read"
        raise LimitError(
            path, "picture", found, f"a picture that fits into the {megabytes(free)} of memory that are free"
        )


def _bytes(kind: int) -> int:
    """Bytes of a pixel's component."""
    import SimpleITK as sitk

    name = sitk.GetPixelIDValueAsString(kind)
    bits = re.search(r"\d+", name)
    return (int(bits[0]) if bits else 64) // 8 * (2 if "complex" in name else 1)
