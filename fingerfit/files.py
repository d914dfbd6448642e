"""Writing that is never half done (a temporary file beside the target, then a rename), and results with a checksum.

What is kept carries the SHA-256 of its own bytes: JSON as a last key, an .npz as the comment of its archive, a mesh as
a last comment line. So it stays one file, which Snakemake's cache can link, and no reader takes a damaged one.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from fingerfit.errors import FingerfitError, StateError


def write_atomic(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Call `write` on a temporary binary file and rename it to `path`.

    Raises
    ------
    FingerfitError
        When the disk is full or the folder cannot be written; nothing is left behind.
    """
    path = Path(path)
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as handle:
            temporary = handle.name
            write(handle)
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except OSError as error:
        raise FingerfitError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            with contextlib.suppress(FileNotFoundError):
                Path(temporary).unlink()


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically."""
    write_atomic(path, lambda handle: handle.write(text.encode()))


def write_json(path: Path, data: object) -> None:
    """Write indented JSON atomically, as people and other programs write it; NaN is refused."""
    write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def kept_json(data: Mapping[str, Any]) -> str:
    """JSON of a mapping that is not empty, with the checksum of its text as a last key; NaN is refused."""
    head = json.dumps(data, indent=1, allow_nan=False).removesuffix("\n}")
    return f"{head}{_KEY}{_sha(head)}{_END}"


def keep_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a result as JSON with a checksum, atomically; `read_json` reads it."""
    write_text(path, kept_json(data))


def keep_mesh(path: Path, text: str) -> None:
    """Write a mesh in ABAQUS keywords with a checksum, atomically; `check_kept` looks at it."""
    write_text(path, f"{text}{_LINE}{_sha(text)}\n")


def write_npz(path: Path, arrays: Mapping[str, np.ndarray], compressed: bool = True) -> None:
    """Write arrays atomically as an .npz without pickles, with a checksum; `read_npz` reads it."""
    write = np.savez_compressed if compressed else np.savez

    def save(handle: IO[bytes]) -> None:
        write(handle, allow_pickle=False, **arrays)
        seal(handle)

    write_atomic(path, save)


def seal(handle: IO[bytes]) -> None:
    """Put the checksum of an .npz that was just written behind it."""
    # an archive ends with the length of its comment, two bytes
    handle.seek(-2, os.SEEK_END)
    handle.write(_COMMENT.to_bytes(2, "little"))
    length = handle.tell()
    handle.seek(0)
    handle.write(_PREFIX + _sha_of(handle, length).encode())


def read_json(path: Path, kept: bool = True) -> Any:
    """Read a result that `keep_json` wrote; with `kept` false, JSON without a checksum.

    Raises
    ------
    StateError
        When it is missing or damaged.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        if kept and not _intact_json(text):
            raise _damaged(path)
        data = json.loads(text)
    except FileNotFoundError as error:
        raise _missing(path) from error
    except (OSError, ValueError) as error:
        raise _damaged(path) from error
    if kept:
        del data["checksum"]
    return data


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Read a result that `write_npz` wrote, pickles refused.

    Raises
    ------
    StateError
        When it is missing or damaged.
    """
    import zipfile

    check_kept(path)
    try:
        with np.load(path, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise StateError(f"{path}: cannot be read: {error}; run snakemake after: rm {path}") from error


def intact(path: Path) -> bool:
    """Whether a result has the content that was written: .json, .npz or a mesh (.inp).

    Raises
    ------
    FileNotFoundError
        When it is not there.
    """
    try:
        if path.suffix == ".npz":
            return _intact_npz(path)
        text = path.read_bytes().decode()
    except FileNotFoundError:
        raise
    except (OSError, ValueError):
        return False
    if path.suffix == ".json":
        return _intact_json(text)
    head, mark, found = text.rpartition(_LINE)
    return bool(mark) and found == f"{_sha(head)}\n"


def check_kept(path: Path) -> None:
    """Refuse a result that is not what was written.

    Raises
    ------
    StateError
        When it is missing or damaged; it says what to do.
    """
    try:
        if not intact(Path(path)):
            raise _damaged(path)
    except FileNotFoundError as error:
        raise _missing(path) from error


_KEY, _END = ',\n "checksum": "', '"\n}\n'
_LINE = "** sha256 of the lines above: "
_PREFIX = b"sha256 of the bytes before: "
_COMMENT = len(_PREFIX) + 64
"""Bytes of an archive's comment: 64 hexadecimal digits are a SHA-256."""


def _sha(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _intact_json(text: str) -> bool:
    head, mark, found = text.rpartition(_KEY)
    return bool(mark) and found == f"{_sha(head)}{_END}"


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


def _damaged(path: Path) -> StateError:
    # of a link into Snakemake's cache, what it leads to
    there = Path(path).resolve() if Path(path).is_symlink() else path
    return StateError(
        f"{path}: cannot be read: damaged, its checksum is not that of its content; run snakemake after: rm {there}"
    )


def _missing(path: Path) -> StateError:
    return StateError(f"{path}: cannot be read: no such file; run snakemake again")


def digest(*parts: str | bytes) -> str:
    """Hash text and bytes to 20 hexadecimal digits; the boundaries between the parts count."""
    total = hashlib.sha256()
    for part in parts:
        raw = part.encode() if isinstance(part, str) else part
        total.update(len(raw).to_bytes(8, "big"))
        total.update(raw)
    return total.hexdigest()[:20]
