"""Reading YAML that people write, without running anything in it, and in bounded time and memory."""

from __future__ import annotations

import difflib
import functools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fingerfit.core.errors import InputError, LimitError
from fingerfit.core.files import DOCUMENT, read_text

_DEEP = 50
"""Collections within collections. The deepest value of ours is in five; PyYAML takes eight frames for each, of which
Python has 1000, and libyaml's loader overflows the stack instead of stopping."""
_VALUES = DOCUMENT // 2
"""Values of a document with those that aliases repeat: as many as fit into the largest one without aliases, in which
each takes two characters or more."""
_DIGITS = 400
"""Characters of a number; the largest of double precision has 309 digits. In base 60, which YAML has, the time to read
more would grow with their square."""


class _Excess(Exception):
    """What a document has too much of: its line, what was found and what is expected."""

    def __init__(self, mark: Any, found: str, expected: str) -> None:
        self.line, self.found, self.expected = f"line {mark.line + 1}" if mark else "file", found, expected
        super().__init__(found)


@functools.cache
def _loader(quick: bool) -> Any:
    """PyYAML's safe loader that refuses a key given twice and takes 1e-3 for a number, as YAML 1.2 does.

    The quick one is libyaml's, where PyYAML has it; its messages are worse.
    """
    import yaml

    base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader) if quick else yaml.SafeLoader

    class Loader(base):
        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            seen = set()
            for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(None, None, f"key {key.value} twice", key.start_mark)
                seen.add(key.value)
            return super().construct_mapping(node, deep)  # type: ignore[no-any-return]

        def get_single_node(self) -> Any:
            node = super().get_single_node()
            if node is not None:
                _count(node, {}, ())
            return node

    number = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", number, list("-+.0123456789"))
    return Loader


def _check_depth(text: str) -> None:
    """Refuse collections within collections before anything that calls itself reads them."""
    import yaml

    depth = 0
    for event in yaml.parse(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEP:
            raise _Excess(event.start_mark, "lists and mappings too deep", f"at most {_DEEP} within each other")


def _count(node: Any, known: dict[int, tuple[int, int]], above: tuple[int, ...]) -> tuple[int, int]:
    """Values in a node with those that aliases repeat, and how deep they are; what is repeated is counted once."""
    import yaml

    if isinstance(node, yaml.ScalarNode):
        if node.tag.rpartition(":")[2] in ("int", "float") and len(node.value) > _DIGITS:
            found = f"a number of {len(node.value)} characters"
            raise _Excess(node.start_mark, found, f"at most {_DIGITS} characters")
        return 1, 0
    if id(node) in above:
        raise _Excess(node.start_mark, "an alias of what it is in", "aliases of other values")
    if id(node) not in known:
        count, depth = 1, 0
        for entry in node.value:
            for inner in entry if isinstance(entry, tuple) else (entry,):
                values, levels = _count(inner, known, (*above, id(node)))
                count, depth = count + values, max(depth, levels)
        known[id(node)] = (count, depth + 1)
    count, depth = known[id(node)]
    if count > _VALUES:
        raise _Excess(node.start_mark, f"aliases that repeat {count:.3g} values", f"at most {_VALUES} values")
    if len(above) + depth > _DEEP:
        raise _Excess(node.start_mark, "lists and mappings too deep", f"at most {_DEEP} within each other")
    return count, depth


def read_yaml(path: Path) -> Any:
    """Read YAML without running anything in it.

    Raises
    ------
    InputError
        When it is missing or not valid, with the line; a `LimitError` for what is too large or too deep, or becomes so
        by aliases.
    """
    import yaml

    try:
        text = read_text(path, limit=DOCUMENT, expected="a readable YAML file")
        try:
            _check_depth(text)
            return yaml.load(text, _loader(quick=True))
        except yaml.YAMLError:
            return yaml.load(text, _loader(quick=False))
    except _Excess as error:
        raise LimitError(path, error.line, error.found, error.expected) from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}" if mark else "file"
        raise InputError(path, line, getattr(error, "problem", None) or error, "valid YAML") from error
    except (ValueError, RecursionError) as error:
        raise InputError(path, "file", error, "valid YAML") from error


SHOWN = 20
"""Names that an error lists; a line with all effects would be too long to read."""


def listed(names: Sequence[str], most: int, between: str = ", ", last: str = " and ") -> str:
    """Names for a sentence: of many the first ones, and how many more there are.

    >>> listed(["tilt", "onset"], 2), listed(["tilt", "onset", "wall"], 2)
    ('tilt, onset', 'tilt, onset and 1 more')
    >>> listed(["tilt", "onset", "wall"], 2, " or ", " or ")
    'tilt or onset or 1 more'
    """
    return between.join(names[:most]) + (f"{last}{len(names) - most} more" if len(names) > most else "")


def nearest(key: str, known: Sequence[str]) -> str:
    """The known key that a misspelt one is like; empty where it is like none."""
    return next(iter(difflib.get_close_matches(str(key), known, 1)), "")


def unknown_key(where: Path | str, prefix: str, key: str, known: Sequence[str]) -> InputError:
    """Error for a key that is not known, with the nearest one that is."""
    near = nearest(key, known)
    hint = f"{near} (did you mean that?)" if near else "one of " + listed(known, SHOWN)
    return InputError(where, f"{prefix}{key}", "an unknown key", hint)
