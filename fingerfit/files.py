"""Writing that is never half done: a temporary file beside the target, then a rename."""

from __future__ import annotations

import contextlib
import hashlib
import json
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
    """Write indented JSON atomically.

    Raises
    ------
    StateError
        For numbers that are not finite: JSON has none.
    """
    try:
        text = json.dumps(data, indent=1, allow_nan=False)
    except ValueError as error:
        raise StateError(f"{path}: a number in it is not finite: look at the measurements and their noise") from error
    write_text(path, text + "\n")


def write_npz(path: Path, arrays: Mapping[str, np.ndarray], compressed: bool = True) -> None:
    """Write arrays atomically as an .npz without pickles."""
    write = np.savez_compressed if compressed else np.savez
    write_atomic(path, lambda handle: write(handle, allow_pickle=False, **arrays))


def read_json(path: Path) -> Any:
    """Read JSON that fingerfit wrote.

    Raises
    ------
    StateError
        When it is missing or damaged.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise StateError(f"{path}: cannot be read: {error}") from error


def read_record(path: Path, *keys: str) -> dict[str, Any]:
    """Read a JSON object that fingerfit wrote.

    Raises
    ------
    StateError
        When it is missing or damaged, no object, or lacks one of the keys.
    """
    found = read_json(path)
    if not isinstance(found, dict):
        raise StateError(f"{path}: cannot be read: it is no JSON object")
    lacking = [key for key in keys if key not in found]
    if lacking:
        raise StateError(f"{path}: cannot be read: {', '.join(lacking)} is missing")
    return found


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Read a .npz that fingerfit wrote, pickles refused.

    Raises
    ------
    StateError
        When it is missing or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            found = {name: data[name] for name in data.files}
    except MemoryError:
        raise
    except Exception as error:  # zipfile, zlib, struct and NumPy each raise their own for damaged bytes
        raise StateError(f"{path}: cannot be read: {error}") from error
    if not all(isinstance(value, np.ndarray) for value in found.values()):
        raise StateError(f"{path}: cannot be read: it holds something else than arrays")
    return found


def digest(*parts: str | bytes) -> str:
    """Hash text and bytes to 20 hexadecimal digits; the boundaries between the parts count."""
    total = hashlib.sha256()
    for part in parts:
        raw = part.encode() if isinstance(part, str) else part
        total.update(len(raw).to_bytes(8, "big"))
        total.update(raw)
    return total.hexdigest()[:20]
