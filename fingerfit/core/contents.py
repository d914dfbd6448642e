"""What is in files, by hash: known from the last time where neither size nor times have changed since."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from fingerfit.core.checksums import intact
from fingerfit.core.errors import FingerfitError
from fingerfit.core.files import digest, read_json, write_json

SETTLED = 2.0
"""Seconds from which on a file's times tell its changes apart: the coarsest clock of a file system, that of FAT."""


class Contents:
    """What was found in files, kept in a file of its own; when that is lost, everything is read once more.

    Parameters
    ----------
    kept : Path or None
        Where it is kept between runs; None for nowhere.
    """

    def __init__(self, kept: Path | None = None) -> None:
        self._kept, self._known, self._changed = kept, _read(kept), False

    def digest(self, path: Path) -> str:
        """Hash of a file's bytes; empty where there is no such file."""
        return self._find(path, "digest", lambda: digest(path.read_bytes()), "")

    def intact(self, path: Path) -> bool:
        """Whether a result is what was written, see `fingerfit.core.checksums.intact`; a missing one is."""
        return self._find(path, "intact", lambda: intact(path), True)

    def of(self, paths: Iterable[Path]) -> str:
        """Hash of the names and contents of files, in this order; their folders do not count."""
        return digest(*(part for path in paths for part in (path.name, self.digest(path))))

    def remember(self, name: str, key: str, find: Callable[[], Any]) -> Any:
        """What was found for a key, found anew where the key is another one than the last time."""
        if self._known.get(name, {}).get("key") != key:
            self._known[name], self._changed = {"key": key, "found": find()}, True
        return self._known[name]["found"]

    def save(self) -> None:
        """Keep what is known, where that can be written."""
        if self._kept is not None and self._changed:
            with contextlib.suppress(FingerfitError):
                write_json(self._kept, self._known)

    def _find(self, path: Path, what: str, find: Callable[[], Any], missing: Any) -> Any:
        try:
            status = path.stat()
            stamp = [status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
            name = f"{what} {path}"
            entry = self._known.get(name)
            if entry is not None and entry.get("stamp") == stamp:
                return entry["found"]
            found = find()
        except FileNotFoundError:
            return missing
        except OSError as error:
            raise FingerfitError(f"{path}: cannot be read: {error.strerror or error}") from error
        if time.time() - max(status.st_mtime, status.st_ctime) > SETTLED:
            self._known[name], self._changed = {"stamp": stamp, "found": found}, True
        return found


def _read(kept: Path | None) -> dict[str, Any]:
    known: Any = None
    if kept is not None and kept.exists():
        with contextlib.suppress(FingerfitError):
            known = read_json(kept, kept=False)
    return known if isinstance(known, dict) and all(isinstance(v, dict) for v in known.values()) else {}
