"""Dataclasses as JSON that says what they are, and back: nothing but the classes that are asked for is made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

_KIND = ""
"""Key of the class; no field is named so, nor any key of a mapping in one."""


def to_plain(value: Any) -> Any:
    """Dataclasses, paths, mappings, lists and tuples as what JSON has."""
    if is_dataclass(value):
        inner = {field.name: to_plain(getattr(value, field.name)) for field in fields(value)}
        return {_KIND: type(value).__name__, **inner}
    if isinstance(value, Path):
        return {_KIND: "Path", "path": str(value)}
    if isinstance(value, Mapping):
        return {key: to_plain(inner) for key, inner in value.items()}
    return [to_plain(inner) for inner in value] if isinstance(value, list | tuple) else value


def from_plain(value: Any, *kinds: type) -> Any:
    """What `to_plain` was given, with tuples for lists.

    Parameters
    ----------
    value : object
        As JSON has it.
    kinds : type
        Dataclasses that may be in it.

    Raises
    ------
    KeyError, TypeError
        For another class, or other fields than it has.

    >>> from_plain(to_plain((Path("a"), {"b": 1})))
    (PosixPath('a'), {'b': 1})
    """
    makers: dict[str, Callable[..., Any]] = {"Path": lambda path: Path(path), **{kind.__name__: kind for kind in kinds}}

    def made(value: Any) -> Any:
        if isinstance(value, list):
            return tuple(map(made, value))
        if not isinstance(value, dict):
            return value
        inner = {key: made(part) for key, part in value.items() if key != _KIND}
        return makers[value[_KIND]](**inner) if _KIND in value else inner

    return made(value)
