"""Checksums inside of results, so that each stays one file: how they are written and looked at."""

from __future__ import annotations

import hashlib
import os
import zlib
from pathlib import Path
from typing import IO

KEY, END = ',\n "checksum": "', '"\n}\n'
LINES = {".inp": ("** sha256 of the lines above: ", "\n"), ".html": ("<!-- sha256 of the lines above: ", " -->\n")}
_PREFIX = b"sha256 of the bytes before: "
_COMMENT = len(_PREFIX) + 64
"""Bytes of an archive's comment: 64 hexadecimal digits are a SHA-256."""


def seal(handle: IO[bytes]) -> None:
    """Put the checksum of an .npz that was just written behind it."""
    # an archive ends with the length of its comment, two bytes
    handle.seek(-2, os.SEEK_END)
    handle.write(_COMMENT.to_bytes(2, "little"))
    length = handle.tell()
    handle.seek(0)
    handle.write(_PREFIX + _sha_of(handle, length).encode())


def told_of(path: Path) -> str:
    """The checksum that an .npz carries; nothing where it has none."""
    with path.open("rb") as handle:
        handle.seek(max(0, path.stat().st_size - _COMMENT))
        prefix, found = handle.read(len(_PREFIX)), handle.read()
    return found.decode() if prefix == _PREFIX else ""


def intact(path: Path) -> bool:
    """Whether a result has the content that was written: .json, .npz, .png, a mesh (.inp) or a page (.html).

    Raises
    ------
    FileNotFoundError
        When it is not there.
    """
    try:
        if path.suffix == ".npz":
            return _intact_npz(path)
        if path.suffix == ".png":
            return _intact_png(path.read_bytes())
        text = path.read_bytes().decode()
    except FileNotFoundError:
        raise
    except (OSError, ValueError):
        return False
    if path.suffix == ".json":
        return intact_json(text)
    line, end = LINES[path.suffix]
    head, mark, found = text.rpartition(line)
    return bool(mark) and found == sha(head) + end


def sha(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def intact_json(text: str) -> bool:
    head, mark, found = text.rpartition(KEY)
    return bool(mark) and found == f"{sha(head)}{END}"


def _sha_of(handle: IO[bytes], left: int) -> str:
    """SHA-256 of the next bytes of a file."""
    total = hashlib.sha256()
    while left and (part := handle.read(min(left, 1 << 20))):  # 1 MiB at a time: data may be as large as the memory
        total.update(part)
        left -= len(part)
    return total.hexdigest()


def _intact_npz(path: Path) -> bool:
    length = path.stat().st_size - _COMMENT
    if length <= 0:
        return False
    with path.open("rb") as handle:
        found = _sha_of(handle, length)
        return handle.read() == _PREFIX + found.encode()


def _intact_png(data: bytes) -> bool:
    """Whether all parts of a PNG are there, each with its own checksum (CRC-32)."""
    at = 8  # behind the signature
    while at + 12 <= len(data):
        end = at + 12 + int.from_bytes(data[at : at + 4], "big")
        part = data[at + 4 : end - 4]
        if zlib.crc32(part) != int.from_bytes(data[end - 4 : end], "big"):
            return False
        if part[:4] == b"IEND":
            return end == len(data) and data.startswith(b"\x89PNG\r\n\x1a\n")
        at = end
    return False
