"""Whether a picture file is whole: what ITK reads over, and fills with zeros or with 1 mm, is refused here.

Files are read in blocks, whatever they hold. Damage that leaves the size alone is found where the format has a
checksum: gzip, zlib and PNG, not in pixels that are stored as they are.
"""

from __future__ import annotations

import gzip
import itertools
import math
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.imaging.nifti import NiftiHeader, read_header

BLOCK = 1 << 20
"""Bytes that are read at once, one MiB; a choice."""
WHOLE = "a whole file"


def refuse_damaged(path: Path) -> None:
    """Refuse a picture file that is cut, damaged, of a header that makes no sense, or of a format that is not known.

    Raises
    ------
    InputError
        With what was found.
    """
    import SimpleITK as sitk

    kind = sitk.ImageFileReader.GetImageIOFromFileName(str(path))
    if not kind:  # reading it says why, but for what is packed
        with path.open("rb") as file:
            packed = file.read(2) == b"\x1f\x8b"
        for _ in _blocks(path) if packed else ():
            pass
        return
    if kind not in _CHECKS:
        formats = ".nii .nii.gz .hdr/.img .mha .mhd .nrrd .nhdr .png .tif .bmp .jpg .mnc .dcm"
        raise InputError(path, "picture", f"a file for {kind}", f"a format in which damage can be told: {formats}")
    try:
        _CHECKS[kind](path)
    except OSError as error:
        raise InputError(path, "picture", error.strerror or error, "a readable file") from error
    except (struct.error, ValueError, IndexError, KeyError, OverflowError) as error:
        raise InputError(path, "picture", f"a header that cannot be read ({error})", WHOLE) from error


def _blocks(path: Path, start: int = 0) -> Iterator[bytes]:
    """Content of a file, of one by gzip what it unpacks to; its checksum and its size are compared at the end."""
    with path.open("rb") as plain:
        plain.seek(start)
        packed = plain.read(2) == b"\x1f\x8b"
        plain.seek(start)
        stream: IO[bytes] = gzip.GzipFile(fileobj=plain) if packed else plain  # type: ignore[assignment]
        try:
            while block := stream.read(BLOCK):
                yield block
        except EOFError:
            raise InputError(path, "picture", "gzip that ends in the middle", WHOLE) from None
        except (gzip.BadGzipFile, zlib.error) as error:
            raise InputError(path, "picture", f"damaged gzip ({error})", WHOLE) from None


def _nifti(path: Path) -> None:
    name = path.name.lower()
    twin = path.with_name(path.name[:-3])
    if name.endswith(".nii.gz") and twin.exists():
        found = f"{twin.name} beside it, whose pixels ITK would take"
        raise InputError(path, "picture", found, "one of the two")
    pair = {".hdr": ".img", ".img": ".hdr"}.get(path.suffix.lower())
    if pair is None:
        _check_nifti(path, None)
        return
    other = next((p for p in (path.with_suffix(pair), path.with_suffix(pair.upper())) if p.exists()), None)
    if other is None:
        raise InputError(path, "picture", f"no {path.with_suffix(pair).name}", "header and pixels beside each other")
    head, data = (path, other) if pair == ".img" else (other, path)
    _check_nifti(data, read_header(head, b"".join(_blocks(head))))


def _check_nifti(path: Path, head: NiftiHeader | None) -> None:
    """Compare the bytes that the header promises with those that are there, and look for NaN: ITK makes 0 of it."""
    blocks = _blocks(path)
    if head is None:
        first = b""
        while len(first) < NiftiHeader.LONGEST and (block := next(blocks, b"")):
            first += block
        head, blocks = read_header(path, first), itertools.chain([first], blocks)
    at, rest, odd = 0, b"", False
    end = head.offset + head.size
    for block in blocks:
        start, at = at, at + len(block)
        if at >= end + head.slice:
            found = f"{at} bytes or more"
            raise InputError(path, "picture", found, f"{end} bytes for {head.words}, as its header says")
        if head.real is not None and not odd:
            pixels = rest + block[max(0, head.offset - start) : max(0, end - start)]
            whole = len(pixels) // head.real.itemsize * head.real.itemsize
            odd, rest = not np.isfinite(np.frombuffer(pixels[:whole], head.real)).all(), pixels[whole:]
    if at < end:
        found, said = f"{at} bytes", f"{end} bytes for {head.words}, as its header says"
        raise InputError(path, "picture", found, said)
    if odd:
        raise InputError(path, "picture", "NaN or infinite intensities", "finite intensities")


def refuse_meta_header(path: Path) -> None:
    """Refuse a MetaImage whose header lacks what it needs: ITK would tell that on standard error, in lines of its own.

    Raises
    ------
    InputError
        With the key of the header.
    """
    if path.suffix.lower() not in (".mha", ".mhd"):
        return
    keys, _ = _meta_keys(path)
    if not keys.keys() & {"objecttype", "ndims", "dimsize"}:
        return  # no MetaImage, which is told as of any other file

    def wrong(key: str, expected: str) -> InputError:
        return InputError(path, f"header, {key}", keys.get(key.lower(), "nothing") or "nothing", expected)

    for key in ("NDims", "DimSize", "ElementType", "ElementDataFile"):
        if not keys.get(key.lower()):
            raise wrong(key, "a value, as in each MetaImage")
    if keys["ndims"] not in map(str, range(1, _DIMS + 1)):
        raise wrong("NDims", "2 or 3")
    count, sizes = int(keys["ndims"]), keys["dimsize"].split()
    if len(sizes) != count or not all(re.fullmatch(r"[0-9]+", size) and int(size) > 0 for size in sizes):
        raise wrong("DimSize", f"{count} whole numbers above 0, as NDims says")


_DIMS = 10
"""Dimensions that ITK's reader of MetaImage has room for; what is no 2 or 3 of them is told with the picture."""


def _meta_keys(path: Path) -> tuple[dict[str, str], int]:
    """Keys of a MetaImage's header, in small letters, and where it ends."""
    keys: dict[str, str] = {}
    with path.open("rb") as file:
        while line := file.readline(BLOCK):
            key, _, value = line.decode("latin-1").partition("=")
            keys[key.strip().lower()] = value.strip()
            if key.strip().lower() == "elementdatafile" or file.tell() > BLOCK:
                break
        return keys, file.tell()


def _meta(path: Path) -> None:
    """MetaImage: numbers of the header, and the checksum of compressed pixels, which ITK does not compare."""
    keys, start = _meta_keys(path)
    for key in ("elementspacing", "elementsize", "offset", "position", "origin", "transformmatrix", "rotation"):
        _numbers(path, key, keys.get(key, ""), above="element" in key)
    local = keys.get("elementdatafile", "").upper() == "LOCAL"
    data = path if local else path.with_name(keys.get("elementdatafile", ""))
    if keys.get("compresseddata", "").lower() != "true":
        form, channels = _META.get(keys.get("elementtype", "").upper()), int(keys.get("elementnumberofchannels", "1"))
        if form and data.is_file():
            need = math.prod(map(int, keys["dimsize"].split())) * struct.calcsize(form) * channels + (
                start if local else 0
            )
            if data.stat().st_size < need:
                raise InputError(data, "picture", f"{data.stat().st_size} bytes", f"{need} bytes, as its header says")
        return
    unpack = zlib.decompressobj()
    with data.open("rb") as file:
        file.seek(start if local else 0)
        try:
            while not unpack.eof and (block := unpack.unconsumed_tail or file.read(BLOCK)):
                unpack.decompress(block, BLOCK)
        except zlib.error as error:
            raise InputError(data, "picture", f"damaged zlib ({error})", WHOLE) from None
    if not unpack.eof:
        raise InputError(data, "picture", "zlib that ends in the middle", WHOLE)


def _nrrd(path: Path) -> None:
    """NRRD: numbers and units of the header; ITK takes what is no number for 1 and any unit for mm."""
    packed, data = False, path
    with path.open("rb") as file:
        for line in file:
            key, _, value = line.decode("latin-1").partition(":")
            if not line.strip():
                break
            key = key.strip().lower()
            packed |= key == "encoding" and value.strip().lower() in ("gz", "gzip")
            if key in ("data file", "datafile"):
                data = path.with_name(value.strip())
            if key in ("spacings", "space directions", "space origin"):
                _numbers(path, key, value.replace("(", " ").replace(")", " ").replace(",", " "), key == "spacings")
            units = {word.strip('"') for word in value.split()} - {"", "mm", "none"}
            if key in ("units", "space units") and units:
                raise InputError(path, key, value.strip(), "mm")
        start = file.tell() if data == path else 0
    for _ in _blocks(data, start) if packed and data.is_file() else ():
        pass


_META = {
    **dict.fromkeys(("MET_CHAR", "MET_UCHAR"), "=b"),
    **dict.fromkeys(("MET_SHORT", "MET_USHORT"), "=h"),
    **dict.fromkeys(("MET_INT", "MET_UINT", "MET_FLOAT"), "=i"),
    **dict.fromkeys(("MET_LONG_LONG", "MET_ULONG_LONG", "MET_DOUBLE"), "=q"),
}
"""Types whose size is the same everywhere."""


def _numbers(path: Path, key: str, text: str, above: bool) -> None:
    for word in text.split():
        if word.lower() == "none":
            continue
        value = float(word)
        if not math.isfinite(value) or (above and value <= 0):
            raise InputError(path, key, text.strip(), "numbers above 0" if above else "finite numbers")


def _tiff(path: Path) -> None:
    """TIFF: each page's entries and pixels must lie inside the file, as well as the next page."""
    size = path.stat().st_size
    with path.open("rb") as file:
        order = {b"II": "<", b"MM": ">"}[file.read(2)]
        big = _unpack(file, order + "H", 2) == 43
        wide, count_at, entry = ("Q", 8, 20) if big else ("I", 2, 12)
        at, pages = _unpack(file, order + wide, 8 if big else 4), 0
        seen = set()
        while at:
            if at >= size or at in seen:
                raise InputError(path, "picture", f"{size} bytes, {pages} pages and a part", WHOLE)
            seen.add(at)
            count = _unpack(file, order + ("Q" if big else "H"), at)
            where = {}
            for n in range(count):
                start = at + count_at + n * entry
                tag, kind = _unpack(file, order + "H", start), _unpack(file, order + "H", start + 2)
                many = _unpack(file, order + wide, start + 4)
                letter = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q"}.get(kind, "")
                each = {2: 1, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 17: 8, 18: 8}.get(kind, 0)
                room = many * (struct.calcsize(f"={letter}") if letter else each)
                inside = room <= (8 if big else 4)
                place = start + (12 if big else 8)
                place = place if inside else _unpack(file, order + wide, place)
                if place + room > size:
                    raise InputError(path, "picture", f"{size} bytes", f"{place + room} bytes at least")
                if tag in (273, 279, 324, 325) and letter:
                    where[tag] = _many(file, order + letter, place, many)
            for offsets, lengths in ((273, 279), (324, 325)):
                for start, length in zip(where.get(offsets, ()), where.get(lengths, ()), strict=False):
                    if start + length > size:
                        raise InputError(path, "picture", f"{size} bytes", f"{start + length} bytes at least")
            pages += 1
            at = _unpack(file, order + wide, at + count_at + count * entry)


def _unpack(file: IO[bytes], kind: str, at: int) -> int:
    return _many(file, kind, at, 1)[0]


def _many(file: IO[bytes], kind: str, at: int, count: int) -> tuple[int, ...]:
    file.seek(at)
    form = f"{kind[0]}{count}{kind[1:]}"
    return struct.unpack(form, file.read(struct.calcsize(form)))


def _jpeg(path: Path) -> None:
    """JPEG: its last marker; the reader fills what is missing with grey."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 4096))
        if not file.read().rstrip(b"\0").endswith(b"\xff\xd9"):
            raise InputError(path, "picture", "no end marker", WHOLE)


def _bmp(path: Path) -> None:
    size = path.stat().st_size
    with path.open("rb") as file:
        said = _unpack(file, "<I", 2)
    if size < said:
        raise InputError(path, "picture", f"{size} bytes", f"{said} bytes, as its header says")


def _nothing(path: Path) -> None:
    """ITK itself refuses such a file when it is cut: tests/bad_input."""


_CHECKS: dict[str, Callable[[Path], None]] = {
    "NiftiImageIO": _nifti,
    "MetaImageIO": _meta,
    "NrrdImageIO": _nrrd,
    "TIFFImageIO": _tiff,
    "JPEGImageIO": _jpeg,
    "BMPImageIO": _bmp,
    "PNGImageIO": _nothing,
    "GDCMImageIO": _nothing,
    "MINCImageIO": _nothing,
}
