"""Effects written into config.yaml and taken out again, with every other character of the file as it was.

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

Effects = dict[str, dict[str, float]]


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
    _write(config, text, {**load_settings(config).model.effects, name: numbers})


def remove_effect(config: Path, name: str) -> None:
    """Take an effect out; with the last one goes the key `effects`.

    Raises
    ------
    InputError
        Where that cannot be done and all else be kept; the file stays as it was.
    """
    text = _text(config)
    left = {key: numbers for key, numbers in load_settings(config).model.effects.items() if key != name}
    _, inside = _model(text, config)
    if left:
        inside = _value(inside, "effects")
    names = [key.value for key, _ in inside.value] if inside else []
    gone = name if left else "effects"
    if gone not in names:  # merged from elsewhere
        raise _refusal(config)
    number = names.index(gone)
    key, value = inside.value[number]
    if not inside.flow_style:
        start = _line_end(text, text.rfind("\n", 0, key.start_mark.index))
        end = _line_end(text, _last(value).end_mark.index)
    elif number:
        start, end = inside.value[number - 1][1].end_mark.index, value.end_mark.index
    else:
        start, end = key.start_mark.index, inside.value[1][0].start_mark.index
    _write(config, text[:start] + text[end:], left)


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


def _write(config: Path, text: str, effects: Effects) -> None:
    """Write a file of settings if they are those that it has, but for the effects."""
    wanted = load_settings(config).model_dump()
    wanted["model"]["effects"] = effects
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as folder:
        file = Path(folder) / "config.yaml"
        write_text(file, text)
        try:
            found = load_settings(read_yaml(file), config)
        except FingerfitError as error:
            raise _refusal(config) from error
    if found.model_dump() != wanted or list(found.model.effects) != list(effects):
        raise _refusal(config)
    write_text(config, text)


def _refusal(config: Path) -> InputError:
    found = "anchors or a layout with which one effect cannot be changed alone"
    return InputError(config, "model.effects", found, "every effect written out, on lines of its own")
