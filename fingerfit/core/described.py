"""Files that are described by pydantic models: strict, every mistake one line, and the table of their keys."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.keys import unknown_key

_KINDS = {
    "model_type": "keys and values",
    "dict_type": "keys and values",
    "list_type": "a list",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "string_type": "a text",
    "none_required": "no such key: it follows from others",
}
"""Kinds of values in the words of `fingerfit.core.keys`."""


class Described(BaseModel):
    """Keys and values of a file: no others, and only finite numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def problems_of(error: ValidationError, where: Path | str, root: type[BaseModel]) -> list[FingerfitError]:
    """One line for each mistake.

    Parameters
    ----------
    error : ValidationError
    where : Path or str
        The file.
    root : type
        Model of the whole file.
    """
    return [_explain(where, details, root) for details in error.errors()]


def _explain(where: Path | str, details: Any, root: type[BaseModel]) -> FingerfitError:
    kind, loc = details["type"], details["loc"]
    field = ".".join(str(key) for key in loc if key != "[key]") or "file"
    if kind == "extra_forbidden":
        *parents, key = loc
        return unknown_key(where, "".join(f"{p}." for p in parents), str(key), list(_fields(_model_at(root, parents))))
    if kind == "missing":
        described = _fields(_model_at(root, loc[:-1])).get(str(loc[-1]))
        return InputError(
            where, field, "nothing", "a value: " + ((described and described.description) or "it is needed")
        )
    if kind == "string_pattern_mismatch":
        signs = ". / _ + -" if "/" in details["ctx"]["pattern"] else "_ -"
        return InputError(where, field, repr(details["input"]), f"letters, digits and {signs} only, no spaces")
    found = "nothing" if details["input"] is None else details["input"]
    if kind == "too_short":
        return InputError(where, field, found, f"{details['ctx']['min_length']} or more of them")
    return InputError(where, field, found, _KINDS.get(kind) or details["msg"].replace("Input should be ", ""))


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields by the keys of the file."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _model_at(root: type[BaseModel], loc: Sequence[Any]) -> type[BaseModel]:
    model = root
    for key in loc:
        fields = _fields(model)
        for kind in models_in(fields[key].annotation if key in fields else None):
            model = kind
    return model


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """Models that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [kind for part in getattr(annotation, "__args__", ()) for kind in models_in(part)]


def rows(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Rows of a table of all keys, in Markdown."""
    for name, field in _fields(model).items():
        inner = models_in(field.annotation)
        text = str(field.annotation)
        suffix = ".*" if "dict" in text and inner else "[]" if "list" in text and inner else ""
        default = "needed" if field.is_required() else f"`{field.get_default(call_default_factory=True)}`"
        yield f"| `{prefix}{name}{suffix}` | {default} | {field.description} |"
        for kind in inner:
            yield from rows(kind, f"{prefix}{name}{suffix}.")


HEAD = ("| key | default | what it is |", "|---|---|---|")
"""Of such a table."""
