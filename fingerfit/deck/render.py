"""From a template and a guess to a deck."""

from __future__ import annotations

import functools
import math
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING, Any

from fingerfit.core.errors import FingerfitError, InputError, LimitError
from fingerfit.core.files import DOCUMENT, TABLE, check_regular, megabytes, read_text
from fingerfit.core.folders import OURS
from fingerfit.core.processes import apart

if TYPE_CHECKING:
    from jinja2.sandbox import SandboxedEnvironment

SECONDS = 20
"""Of processor time for one deck of a study's own templates. The fingertip's 38 500 tetrahedra with a gradient take
0.5 s for 3 MB, so that a deck of `TABLE` bytes takes half of it."""
MEMORY = 2**31
"""Bytes that such a deck may take while it is made: thirty times `TABLE`, the longest text of it, which as Python's
numbers and pieces of text takes up to ten times as much."""


_COMPILED: dict[tuple[str, str], CodeType] = {}
_LOOKED_AT: set[Path] = set()
"""Templates that are as they were read: looked at once for each deck, which may include them for each layer."""
_BLOCK = re.compile(r"""\b(?:fills|replaced)\(\s*["'](\w+)["']""")


class _Foreign(Exception):
    """A template that is not ours: its author may have written anything."""


def render_deck(template: str, context: Mapping[str, Any], folders: Sequence[Path]) -> str:
    """Render a deck, strictly and in a sandbox.

    Parameters
    ----------
    template : str
        Name of the template.
    context : mapping
        Everything the template may name.
    folders : sequence of Path
        Where templates are looked up, in order.

    Raises
    ------
    InputError
        Naming the template and its line: missing name, syntax, missing part, forbidden access. A `LimitError` for a
        template that is too large or that makes too much, or for too long: templates that are not ours are rendered in
        a process of their own, which is ended then.
    """
    places = tuple(map(str, folders))
    try:
        return _rendered(template, context, places, ours=True)
    except _Foreign:
        pass
    try:
        return apart(lambda: _rendered(template, context, places, ours=False), SECONDS, MEMORY)
    except MemoryError:
        found, expected = "no end", f"a deck that takes less than {megabytes(MEMORY)} to make"
    except TimeoutError:
        found, expected = f"no end after {SECONDS} s", "a deck that is made in less"
    except InputError:
        raise
    except FingerfitError as error:
        found, expected = str(error), "a template that can be rendered"
    raise LimitError(template, "template", found, expected)


def _rendered(template: str, context: Mapping[str, Any], folders: tuple[str, ...], ours: bool) -> str:
    import jinja2

    environment = _environment(folders, ours)
    _LOOKED_AT.clear()
    try:
        pieces, size = [], 0
        for piece in environment.get_template(template).generate(context):
            pieces.append(piece)
            size += len(piece)
            if size > TABLE:
                found = f"a deck of more than {megabytes(TABLE)}"
                raise LimitError(template, "template", found, f"at most {megabytes(TABLE)}")
        text = "".join(pieces)
    except (_Foreign, LimitError, MemoryError):
        raise
    except jinja2.TemplateSyntaxError as error:
        raise InputError(error.filename or template, f"line {error.lineno}", error.message, "valid Jinja") from error
    except jinja2.TemplateNotFound as error:
        expected = "a template in " + " or ".join(map(str, folders))
        raise InputError(template, "template", f"no file {error.name}", expected) from error
    except RecursionError as error:
        # what is not in the circle comes once at most: by chance the limit may be met there
        where, line = Counter(_places(error, template)).most_common(1)[0][0]
        found = "parts, macros or expressions within each other without end"
        raise InputError(where, f"line {line}", found, "fewer of them") from error
    except Exception as error:  # whatever a user's template does wrong
        if isinstance(error, InputError) and error.field == "template":
            raise  # the file itself
        where, line = _places(error, template)[-1]
        raise InputError(where, f"line {line}", error, "names that a deck's context has") from error
    return "\n".join(line for line in text.splitlines() if line.strip()) + "\n"


def _places(error: Exception, template: str) -> list[tuple[str, int]]:
    """Files and lines of the templates in a traceback, the innermost last; the template itself if there is none."""
    found, trace = list[tuple[str, int]](), error.__traceback__
    while trace:
        name = trace.tb_frame.f_code.co_filename
        if name.endswith(".j2"):
            found.append((name, trace.tb_lineno))
        trace = trace.tb_next
    return found or [(template, 0)]


def blocks(folders: Sequence[Path]) -> list[str]:
    """Names of the blocks that templates in these folders have for effects: those that they ask for."""
    named = set()
    for folder in folders:
        for path in folder.rglob("*.j2"):
            check_regular(path, "template", DOCUMENT, "a template")
            named |= set(_BLOCK.findall(read_text(path, "template", DOCUMENT, "a template")))
    return sorted(named)


def is_template(name: str, folders: Sequence[Path]) -> bool:
    """Whether one of the folders has a template of this name."""
    import jinja2

    try:
        return bool(_find(name, folders))
    except jinja2.TemplateNotFound:
        return False


def _find(name: str, folders: Sequence[Path | str]) -> tuple[Path, Path]:
    """The first folder that has a template, and its path."""
    import jinja2
    from jinja2.loaders import split_template_path

    parts = split_template_path(name)
    for folder in map(Path, folders):
        path = folder.joinpath(*parts)
        if os.path.lexists(path):
            return folder, path
    raise jinja2.TemplateNotFound(name)


@functools.cache
def _environment(folders: tuple[str, ...], ours: bool) -> SandboxedEnvironment:
    """Where templates are found and rendered; with `ours` those of other folders are refused by `_Foreign`."""
    import jinja2
    from jinja2.sandbox import SandboxedEnvironment

    class Loader(jinja2.BaseLoader):
        """Templates in folders, in order; as jinja2's own, but it reads regular files up to a size only."""

        def get_source(self, environment: jinja2.Environment, name: str) -> tuple[str, str, Any]:
            folder, path = _find(name, folders)
            if ours and folder != OURS:
                raise _Foreign
            check_regular(path, "template", DOCUMENT, "a template")
            stamp = path.stat().st_mtime_ns
            text = read_text(path, "template", DOCUMENT, "a template")

            def current() -> bool:
                if path not in _LOOKED_AT and path.exists() and path.stat().st_mtime_ns == stamp:
                    _LOOKED_AT.add(path)
                return path in _LOOKED_AT

            return text, str(path), current

    class Compiled(jinja2.BytecodeCache):
        """What was compiled in this process, for both environments: a fork has what is ours, and compiles the rest."""

        def load_bytecode(self, bucket: Any) -> None:
            bucket.code = _COMPILED.get((bucket.key, bucket.checksum))

        def dump_bytecode(self, bucket: Any) -> None:
            _COMPILED[bucket.key, bucket.checksum] = bucket.code

    environment = SandboxedEnvironment(
        loader=Loader(), undefined=jinja2.StrictUndefined, autoescape=False, bytecode_cache=Compiled()
    )
    environment.filters |= {"number": _number, "cosd": _cosd, "sind": _sind}
    return environment


def _number(value: float) -> str:
    return f"{float(value):.12g}"


def _cosd(degrees: float) -> float:
    return math.cos(math.radians(degrees))


def _sind(degrees: float) -> float:
    return math.sin(math.radians(degrees))
