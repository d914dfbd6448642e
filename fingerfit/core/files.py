"""Reading regular files up to a size; writing that is never half done, beside the target and then renamed; checksums.

What is kept carries the SHA-256 of its own bytes: JSON as a last key, an .npz as the comment of its archive, a mesh or
a page as a last comment line. So it stays one file, which Snakemake's cache can link, and no reader takes damage.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import stat
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from fingerfit.core.checksums import END, KEY, LINES, intact, intact_json, seal, sha
from fingerfit.core.errors import FingerfitError, InputError, LimitError, StateError

DOCUMENT = 2**20
"""Bytes of what a person writes: YAML, templates, tables of steps. The largest of ours has 5 kB. The densest YAML of
1 MiB takes 7 s and 200 MB to read, and a table of 1 MiB has more steps than can be solved."""
TABLE = 64 * 2**20
"""Bytes of measured tables: a million points of six numbers with nine characters each. As Python's numbers they take
ten times as much memory."""
MESH = 256 * 2**20
"""Bytes of meshes and decks: a million nodes of 50 characters and two million elements of 100. The factor of such a
system takes more than 100 GB, so that none of our solvers gets through a larger one."""
_STRANGE = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def megabytes(size: float) -> str:
    """A size in words, in MB of 2^20 bytes or GB of 2^30.

    >>> megabytes(64 * 2**20), megabytes(3.5 * 2**30)
    ('64 MB', '3.5 GB')
    """
    count, unit = (size / 2**20, "MB") if size < 2**30 else (size / 2**30, "GB")
    return f"{count:.3g} {unit}" if count < 1000 else f"{count:.0f} {unit}"


def check_regular(path: Path, field: str = "file", limit: float | None = None, expected: str = "a file") -> None:
    """Refuse what cannot be read in a bounded time: pipes, devices, sockets, folders, and files above a size in bytes.

    Nothing is opened: to open a pipe waits for its other end, to open a device may do anything.

    Raises
    ------
    InputError
        When it is missing or cannot be looked at, and a `LimitError` for what is no regular file or too large.
    """
    try:
        found = Path(path).stat()
    except (OSError, ValueError) as error:  # ValueError: a name with a zero in it
        raise InputError(path, field, getattr(error, "strerror", None) or error, expected) from error
    for is_it, name in _STRANGE:
        if is_it(found.st_mode):
            raise LimitError(path, field, name, expected)
    if limit is not None and found.st_size > limit:
        raise LimitError(path, field, megabytes(found.st_size), f"at most {megabytes(limit)}")


def read_bytes(path: Path, field: str = "file", limit: int = TABLE, expected: str = "a readable file") -> bytes:
    """Content of a regular file of at most `limit` bytes; every file that a user names is read by this.

    Parameters
    ----------
    path : Path
    field : str
        Named in errors: the key or what the file is for.
    limit : int
        Bytes.
    expected : str
        What would be right, for errors.

    Raises
    ------
    InputError
        When it is missing or cannot be read, and a `LimitError` for what is no regular file or too large.
    """
    check_regular(path, field, limit, expected)
    try:
        # it may have become a pipe by now: without blocking
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        with os.fdopen(handle, "rb") as stream:
            # files of /proc and growing ones have more than their size says
            content = stream.read(limit + 1)
    except OSError as error:
        raise InputError(path, field, error.strerror or error, expected) from error
    if len(content) > limit:
        raise LimitError(path, field, f"more than {megabytes(limit)}", f"at most {megabytes(limit)}")
    return content


def read_text(path: Path, field: str = "file", limit: int = TABLE, expected: str = "a readable text file") -> str:
    """The same as text in UTF-8, with or without a byte order mark; line ends become plain ones.

    Raises
    ------
    InputError
        As `read_bytes`, and for what is not UTF-8, with its line.
    """
    content = read_bytes(path, field, limit, expected)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte {content[error.start]:#04x} in line {line}, which is not UTF-8"
        raise InputError(path, field, found, f"{expected} in UTF-8") from error
    return io.IncrementalNewlineDecoder(None, translate=True).decode(text, final=True)


def free_memory() -> int:
    """Bytes of memory that this process can still take: what the machine has free, within the limit of the process."""
    import resource

    pages = os.sysconf("SC_PHYS_PAGES")
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        free = next(int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError):
        free = pages * os.sysconf("SC_PAGE_SIZE")
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return free
    return max(0, min(free, limit - address_space()))


def address_space() -> int:
    """Bytes of addresses that this process has taken; 0 where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return 0


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
    """Write indented JSON atomically, as people and other programs write it.

    Raises
    ------
    StateError
        For numbers that are not finite: JSON has none.
    """
    write_text(path, _json(path, data) + "\n")


def _json(path: Path, data: object) -> str:
    try:
        return json.dumps(data, indent=1, allow_nan=False)
    except ValueError as error:
        raise StateError(f"{path}: a number in it is not finite: look at the measurements and their noise") from error


def kept_json(path: Path, data: Mapping[str, Any]) -> str:
    """JSON of a mapping that is not empty, with the checksum of its text as a last key; errors name `path`."""
    head = _json(path, data).removesuffix("\n}")
    return f"{head}{KEY}{sha(head)}{END}"


def keep_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a result as JSON with a checksum, atomically; `read_json` reads it."""
    write_text(path, kept_json(path, data))


def keep_text(path: Path, text: str) -> None:
    """Write a mesh in ABAQUS keywords or a page with a checksum, atomically; `check_kept` looks at it."""
    write_text(path, sha(text).join((text + LINES[path.suffix][0], LINES[path.suffix][1])))


def write_npz(path: Path, arrays: Mapping[str, np.ndarray], compressed: bool = True) -> None:
    """Write arrays atomically as an .npz without pickles, with a checksum; `read_npz` reads it."""
    write = np.savez_compressed if compressed else np.savez

    def save(handle: IO[bytes]) -> None:
        write(handle, allow_pickle=False, **arrays)
        seal(handle)

    write_atomic(path, save)


def read_json(path: Path, kept: bool = True) -> Any:
    """Read a result that `keep_json` wrote; with `kept` false, JSON without a checksum.

    Raises
    ------
    StateError
        When it is missing or damaged.
    """
    try:
        check_regular(path)
        text = Path(path).read_text(encoding="utf-8")
        if kept and not intact_json(text):
            raise _damaged(path)
        data = json.loads(text)
    except InputError as error:
        if not Path(path).exists():
            raise _missing(path) from error
        raise StateError(f"{path}: cannot be read: {error.found}") from error
    except (OSError, ValueError, RecursionError) as error:
        raise _damaged(path) from error
    if kept:
        del data["checksum"]
    return data


def read_record(path: Path, *keys: str, kept: bool = True) -> dict[str, Any]:
    """Read a JSON object that fingerfit wrote.

    Raises
    ------
    StateError
        When it is missing or damaged, no object, or lacks one of the keys.
    """
    found = read_json(path, kept)
    if not isinstance(found, dict):
        raise StateError(f"{path}: cannot be read: it is no JSON object")
    lacking = [key for key in keys if key not in found]
    if lacking:
        raise StateError(f"{path}: cannot be read: {', '.join(lacking)} is missing")
    return found


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Read a result that `write_npz` wrote, pickles refused.

    Raises
    ------
    StateError
        When it is missing or damaged.
    """
    check_kept(path)
    try:
        check_regular(path)
        with np.load(path, allow_pickle=False) as data:
            found = {name: data[name] for name in data.files}
    except MemoryError:
        raise
    except Exception as error:  # zipfile, zlib, struct and NumPy each raise their own for damaged bytes
        raise StateError(f"{path}: cannot be read: {error}; run snakemake after: rm {path}") from error
    if not all(isinstance(value, np.ndarray) for value in found.values()):
        raise StateError(f"{path}: cannot be read: it holds something else than arrays")
    return found


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
