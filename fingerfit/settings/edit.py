"""Effects written into config.yaml and taken out again, and finer meshes, with every other character as it was.

PyYAML's nodes tell where keys and values stand; text is put in or cut out there. Libraries that write the whole file
again keep less of it (docs/decisions/0014-libraries.md).
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.files import DOCUMENT, read_bytes, write_text
from fingerfit.core.keys import read_yaml
from fingerfit.settings.config import load_settings
from fingerfit.settings.parts import MeshSettings


def write_effect(config: Path, name: str, numbers: Mapping[str, float]) -> None:
    """Write an effect behind those that the model has.

    Raises
    ------
    InputError
        Where that cannot be done and all else be kept; the file stays as it was.
    """
    numbers = {key: float(f"{value:.12g}") for key, value in numbers.items()}
    entry = f"{name}: {{{', '.join(f'{key}: {value:.12g}' for key, value in numbers.items())}}}"
    text = _text(config)
    model, inside = _model(text, config)
    column = inside.value[0][0].start_mark.column
    effects = _value(inside, "effects")
    if effects is None:
        text = _below(text, model, column * " " + "effects:", (2 * column - model.start_mark.column) * " " + entry)
    elif not effects.flow_style:
        text = _below(text, _last(effects), effects.value[0][0].start_mark.column * " " + entry)
    elif effects.value:
        end = effects.value[-1][1].end_mark.index
        text = f"{text[:end]}, {entry}{text[end:]}"
    else:
        end = effects.end_mark.index - 1
        text = text[:end] + entry + text[end:]
    model = load_settings(config).model
    _write(config, text, {"effects": {**model.effects, name: numbers}})


def remove_effect(config: Path, name: str) -> None:
    """Take an effect out, also of what each test has for itself; with the last one goes the key `effects`.

    Raises
    ------
    FingerfitError
        Where that cannot be done and all else be kept, or settings are wrong without it; the file stays as it was.
    """
    text, model = _text(config), load_settings(config).model
    left = {key: numbers for key, numbers in model.effects.items() if key != name}
    text = _without(text, config, "effects", name, not left)
    own = [entry for entry in model.per_test if entry.partition(".")[0] == name]
    others = [entry for entry in model.per_test if entry not in own]
    for number, entry in enumerate(own, 1):
        text = _without(text, config, "per_test", entry, number == len(own) and not others)
    _write(config, text, {"effects": left, "per_test": others})


def write_meshes(config: Path, meshes: Mapping[str, MeshSettings]) -> None:
    """Write what is other in the meshes of a model, `mesh` or `refined`.

    Raises
    ------
    InputError
        Where that cannot be done and all else be kept; the file stays as it was.
    """
    text, model = _text(config), load_settings(config).model.model_dump()
    for key, mesh in meshes.items():
        for name, value in mesh.model_dump().items():
            if value == model[key][name]:
                continue
            inside = _value(_model(text, config)[1], key)
            written = _value(inside, name) if inside else None
            if written is None:  # merged from elsewhere
                raise _refusal(config, key)
            text = f"{text[: written.start_mark.index]}{value}{text[written.end_mark.index :]}"
    _write(config, text, {key: mesh.model_dump() for key, mesh in meshes.items()})


def _without(text: str, config: Path, key: str, entry: str, last: bool) -> str:
    """Text without an entry of a mapping or of a list of the model; with the last one goes its key."""
    _, inside = _model(text, config)
    if not last:
        inside = _value(inside, key)
    entries = [one if isinstance(one, tuple) else (one, one) for one in inside.value] if inside else []
    names = [first.value for first, _ in entries]
    gone = key if last else entry
    if gone not in names:  # merged from elsewhere
        raise _refusal(config)
    number = names.index(gone)
    first, value = entries[number]
    if not inside.flow_style:
        start = _line_end(text, text.rfind("\n", 0, first.start_mark.index))
        end = _line_end(text, _last(value).end_mark.index)
    elif number:
        start, end = entries[number - 1][1].end_mark.index, value.end_mark.index
    else:
        start, end = first.start_mark.index, entries[1][0].start_mark.index
    return text[:start] + text[end:]


def _text(config: Path) -> str:
    """All of the file: its byte order mark and line ends, too."""
    return read_bytes(config, limit=DOCUMENT, expected="a readable YAML file").decode()


def _model(text: str, config: Path) -> tuple[Any, Any]:
    """Nodes of the key `model` and of its mapping."""
    import yaml

    root: Any = yaml.compose(text, yaml.SafeLoader)
    for key, value in root.value:
        if key.value == "model" and not value.flow_style:
            return key, value
    raise InputError(config, "model", "no line `model:` of its own", "one, so that effects can be written below it")


def _value(mapping: Any, name: str) -> Any:
    return next((value for key, value in mapping.value if key.value == name), None)


def _last(node: Any) -> Any:
    """The node that ends last in another one; a block itself ends where the next key begins, behind comments."""
    while node.value and not isinstance(node.value, str) and not node.flow_style:
        last = node.value[-1]
        node = last[1] if isinstance(last, tuple) else last
    return node


def _below(text: str, node: Any, *lines: str) -> str:
    """Text with lines below the one in which a node ends."""
    end, newline = _line_end(text, node.end_mark.index), "\r\n" if "\r\n" in text else "\n"
    return newline.join([text[:end], *lines]) + text[end:]


def _line_end(text: str, at: int) -> int:
    """Where a line ends, before its newline."""
    end = text.find("\n", at)
    return len(text) if end < 0 else end - (text[end - 1] == "\r")


def _write(config: Path, text: str, changes: Mapping[str, Any]) -> None:
    """Write a file of settings if they are those that it has, but for changes of the model."""
    wanted = load_settings(config).model_dump()
    wanted["model"] |= changes
    load_settings(wanted, config)  # what is wrong with them is not the layout
    key = next(iter(changes))
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as folder:
        file = Path(folder) / "config.yaml"
        write_text(file, text)
        try:
            found = load_settings(read_yaml(file), config)
        except FingerfitError as error:
            raise _refusal(config, key) from error
    if found.model_dump() != wanted or list(found.model.effects) != list(wanted["model"]["effects"]):
        raise _refusal(config, key)
    write_text(config, text)


def _refusal(config: Path, key: str = "effects") -> InputError:
    one = "effect" if key == "effects" else "mesh"
    found = f"anchors or a layout with which one {one} cannot be changed alone"
    return InputError(config, f"model.{key}", found, f"every {one} written out, on lines of its own")
