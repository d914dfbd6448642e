"""Header of NIfTI-1, NIfTI-2 and Analyze 7.5 files: what ITK corrects without a word is refused.

Layout: nifti1.h and nifti2.h of the NIfTI Data Format Working Group.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from fingerfit.core.errors import InputError

_BITS = {2: 8, 4: 16, 8: 32, 16: 32, 64: 64, 256: 8, 512: 16, 768: 32, 1024: 64, 1280: 64}
"""Bits of the codes of scalar types that ITK reads (nifti1.h, as all codes here)."""
_REAL = {16: "f4", 64: "f8"}
"""Codes of floating-point numbers, which may be NaN."""
_COMPLEX = (32, 1792, 2048)
"""Codes of complex numbers of 64, 128 and 256 bits."""


@dataclass(frozen=True)
class NiftiHeader:
    """What a header promises.

    Parameters
    ----------
    offset, size, slice : int
        Bytes before the pixels, of the pixels, and of what one step along the last axis has.
    real : numpy.dtype or None
        Of floating-point pixels.
    words : str
        Size and type, for messages.
    """

    offset: int
    size: int
    slice: int
    real: np.dtype | None
    words: str
    LONGEST: ClassVar[int] = 540
    """Bytes of the longer of the two headers."""


def read_header(path: Path, first: bytes) -> NiftiHeader:
    """Header of a file from its first bytes.

    Raises
    ------
    InputError
        For a field that makes no sense, and for pixels that are no real numbers.
    """
    order, size = _order(path, first)
    if size == 540:
        magic = first[4:8]
        kind, bits = struct.unpack_from(order + "hh", first, 12)
        dim, pixdim = struct.unpack_from(order + "8q", first, 16), struct.unpack_from(order + "8d", first, 104)
        offset, slope, shift = struct.unpack_from(order + "qdd", first, 168)
    else:
        magic = first[344:348]
        kind, bits = struct.unpack_from(order + "hh", first, 70)
        dim, pixdim = struct.unpack_from(order + "8h", first, 40), struct.unpack_from(order + "8f", first, 76)
        offset, slope, shift = struct.unpack_from(order + "fff", first, 108)
    one = path.name.lower().endswith((".nii", ".nii.gz"))
    if one and magic[:3] not in (b"n+1", b"n+2"):
        raise InputError(path, "magic", repr(magic)[1:], "n+1 or n+2, as of a NIfTI file")
    axes = dim[0]
    if not 1 <= axes <= 7 or any(n < 1 for n in dim[1 : axes + 1]):
        raise InputError(path, "dim", " ".join(map(str, dim)), "the number of axes, and sizes above 0")
    if kind in _COMPLEX:
        raise InputError(path, "datatype", "complex intensities", "real ones: the magnitude, for example")
    if kind not in _BITS or bits != _BITS[kind]:
        expected = f"{_BITS[kind]} bits" if kind in _BITS else "the code of an integer or a floating-point number"
        raise InputError(path, "datatype", f"code {kind} with {bits} bits", expected)
    lengths = pixdim[1 : 1 + min(axes, 3)]
    if not all(math.isfinite(length) and length > 0 for length in lengths):
        raise InputError(path, "pixdim", " ".join(f"{x:g}" for x in lengths), "lengths of a pixel above 0")
    # a slope of 0 says that there is none
    if not math.isfinite(slope) or (slope and not math.isfinite(shift)):
        raise InputError(path, "scl_slope", f"{slope:g}, scl_inter {shift:g}", "finite numbers")
    least = size if one else 0
    if not ((math.isfinite(offset) and least <= offset <= 1 << 40) or (one and offset == 0)):
        raise InputError(path, "vox_offset", f"{offset:g}", f"{least} or more")
    _place(path, order, first, size)
    count = math.prod(dim[1 : axes + 1])
    each, last = bits // 8, max((n for n in range(1, axes + 1) if dim[n] > 1), default=1)
    words = f"{' x '.join(map(str, dim[1 : axes + 1]))} pixels of {bits} bits"
    real = np.dtype(order + _REAL[kind]) if kind in _REAL else None
    start = max(int(offset), 352 if size == 348 else 544) if one else int(offset)
    return NiftiHeader(start, count * each, count // dim[last] * each, real, words)


def _order(path: Path, first: bytes) -> tuple[str, int]:
    """Byte order and length of the header, which begins with its own length."""
    for order in "<>":
        if len(first) >= 4:
            (size,) = struct.unpack_from(order + "i", first)
            if size in (348, 540) and len(first) >= size:
                return order, size
    raise InputError(path, "picture", f"{len(first)} bytes without a header", "a header of NIfTI, 348 or 540 bytes")


def _place(path: Path, order: str, first: bytes, size: int) -> None:
    """Numbers of the two ways to say where the pixels are, those that are in use."""
    if size == 540:
        codes, quaternion, rows = struct.unpack_from(order + "ii", first, 344), (352, "6d"), (400, "12d")
    else:
        codes, quaternion, rows = struct.unpack_from(order + "hh", first, 252), (256, "6f"), (280, "12f")
    for name, code, (at, form) in (("qform", codes[0], quaternion), ("sform", codes[1], rows)):
        values = struct.unpack_from(order + form, first, at)
        if code > 0 and not all(map(math.isfinite, values)):
            raise InputError(path, name, " ".join(f"{x:g}" for x in values), "finite numbers")
