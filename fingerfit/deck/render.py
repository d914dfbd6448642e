"""From a template and a guess to a deck."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fingerfit.errors import InputError

if TYPE_CHECKING:
    from jinja2.sandbox import SandboxedEnvironment


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
        Naming the template and its line: missing name, syntax, missing part, forbidden access.
    """
    import jinja2

    environment = _environment(tuple(map(str, folders)))
    try:
        text = environment.get_template(template).render(context)
    except jinja2.TemplateSyntaxError as error:
        raise InputError(error.filename or template, f"line {error.lineno}", error.message, "valid Jinja") from error
    except jinja2.TemplateNotFound as error:
        expected = "a template in " + " or ".join(map(str, folders))
        raise InputError(template, "template", f"no file {error.name}", expected) from error
    except Exception as error:  # whatever a user's template does wrong
        where, line = _place(error, template)
        raise InputError(where, f"line {line}", error, "names that a deck's context has") from error
    return "\n".join(line for line in text.splitlines() if line.strip()) + "\n"


def _place(error: Exception, template: str) -> tuple[str, int]:
    """File and line of the innermost template in a traceback."""
    where, line = template, 0
    trace = error.__traceback__
    while trace:
        name = trace.tb_frame.f_code.co_filename
        if name.endswith(".j2"):
            where, line = name, trace.tb_lineno
        trace = trace.tb_next
    return where, line


@functools.cache
def _environment(folders: tuple[str, ...]) -> SandboxedEnvironment:
    import jinja2
    from jinja2.sandbox import SandboxedEnvironment

    environment = SandboxedEnvironment(
        loader=jinja2.FileSystemLoader(folders), undefined=jinja2.StrictUndefined, autoescape=False
    )
    environment.filters["number"] = _number
    return environment


def _number(value: float) -> str:
    return f"{float(value):.12g}"
