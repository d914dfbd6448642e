"""Files that people write, described by pydantic models: one line for each mistake, and a table of their keys."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, WrapValidator, create_model
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.keys import nearest, unknown_key

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
}
"""Kinds of values in plain words."""
_UNKNOWN = ("extra_forbidden", "invalid_key")
"""Of a key that is not known."""


class Described(BaseModel):
    """Keys and values of a file: no others, and only finite numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Strict(Described):
    """No texts and no true or false for numbers."""

    model_config = ConfigDict(strict=True)


def wanted(words: str) -> Any:
    """What is expected, in these words, of a value that a validator or type beside this does not take."""

    def check(value: Any, inner: Any) -> Any:
        try:
            return inner(value)
        except ValidationError as error:
            raise PydanticCustomError("wanted", "{words}", {"words": words}) from error

    return WrapValidator(check)


def one_of(names: Collection[str]) -> Any:
    """A validator of one of several texts."""

    def check(value: Any) -> Any:
        if not isinstance(value, str) or value not in names:
            raise PydanticCustomError("one_of", "{words}", {"words": "one of " + ", ".join(names)})
        return value

    return BeforeValidator(check)


def _line(value: Any) -> Any:
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise PydanticCustomError("line", "a text of one line")
    return value


Line = Annotated[str, BeforeValidator(_line)]
"""A text of one line that is not empty."""
Positive = Annotated[float, Field(gt=0)]


def described(
    kind: type[BaseModel], data: Any, where: Path | str, without: Collection[str] = ()
) -> tuple[Any, list[FingerfitError]]:
    """What was read, as a model describes it.

    Parameters
    ----------
    kind : type
        Model of the whole file.
    data : object
        What was read.
    where : Path or str
        The file.
    without : collection of str
        Keys at the top that are wrong, as is known already.

    Returns
    -------
    model, list of FingerfitError
        One line for each mistake. Where there is one, the model has only those keys at the top in which there is none:
        they can be compared with each other nevertheless.
    """
    problems: list[FingerfitError] = []
    wrong = set(without)
    try:
        given = kind.model_validate(data)
        if not wrong:
            return given, problems
    except ValidationError as error:
        found = [details for details in error.errors() if not details["loc"] or details["loc"][0] not in without]
        found.sort(key=lambda details: details["type"] != "extra_forbidden")  # they may explain what is missing
        meant = {_meant(details["loc"], kind) for details in found if details["type"] in _UNKNOWN}
        told = [details for details in found if details["type"] != "missing" or details["loc"] not in meant]
        problems = [_explain(where, details, kind) for details in told]
        wrong |= {str(details["loc"][0]) for details in found if details["loc"]}
    known = kind.model_fields.items() if isinstance(data, dict) else ()
    right: dict[str, Any] = {name: (field.annotation, field) for name, field in known if name not in wrong}
    partly = create_model("Partly", __config__=kind.model_config, **right)
    return partly.model_validate({key: data[key] for key in right if key in data}), problems


def _explain(where: Path | str, details: Any, root: type[BaseModel]) -> FingerfitError:
    kind, loc = details["type"], details["loc"]
    field = ".".join(str(key) for key in loc if key != "[key]") or "file"
    if kind in _UNKNOWN:
        *parents, key = loc
        if str(key).isdecimal() and parents:  # of {start: 0,02} YAML makes the keys start and 02
            expected = "names of values; a number has a decimal point, no comma"
            return InputError(where, ".".join(map(str, parents)), f"the number {key} for a key", expected)
        return unknown_key(where, "".join(f"{p}." for p in parents), str(key), _names(root, parents))
    beside = _fields(_model_at(root, loc[:-1])) if loc else {}
    about = beside[str(loc[-1])].description if loc and str(loc[-1]) in beside else None
    if kind == "missing":
        return InputError(where, field, "nothing", f"a value: {about or 'it is needed'}")
    if kind == "string_pattern_mismatch":
        signs = ". / _ + -" if "/" in details["ctx"]["pattern"] else "_ -"
        return InputError(where, field, repr(details["input"]), f"letters, digits and {signs} only, no spaces")
    found = details.get("ctx", {}).get("found") or _shown(details["input"])
    if kind == "too_short":
        words = f"{details['ctx']['min_length']} or more of them"
        return InputError(where, field, found, f"{words}: {about}" if about else words)
    if kind == "none_required" and about:
        return InputError(where, field, found, f"no such key: {about[0].lower()}{about[1:].rstrip('.')}")
    return InputError(where, field, found, _KINDS.get(kind) or details["msg"].replace("Input should be ", ""))


def _names(root: type[BaseModel], parents: Sequence[Any]) -> list[str]:
    """Keys that may stand at a place of the file."""
    fields = _fields(_model_at(root, parents))
    return [name for name, field in fields.items() if field.annotation is not type(None)]


def _meant(loc: Sequence[Any], root: type[BaseModel]) -> tuple[Any, ...]:
    """Place of the key that stands at this place, misspelt: that it is missing there is no mistake of its own."""
    *parents, key = loc
    return (*parents, nearest(str(key), _names(root, parents)))


def _shown(value: Any) -> Any:
    """What was found, for a line: of a text that is none to read, how Python writes it."""
    if value is None or value == "":
        return "nothing" if value is None else "an empty text"
    return value if not isinstance(value, str) or (value.isprintable() and value.strip()) else repr(value)


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
        value = field.get_default(call_default_factory=True)
        # keys that all have defaults: those stand in their own rows
        default = "needed" if field.is_required() else f"`{ {} if isinstance(value, BaseModel) else value }`"
        default = "no such key" if field.annotation is type(None) else default
        yield f"| `{prefix}{name}{suffix}` | {default} | {field.description} |"
        for kind in inner:
            yield from rows(kind, f"{prefix}{name}{suffix}.")


HEAD = ("| key | default | what it is |", "|---|---|---|")
"""Of such a table."""
