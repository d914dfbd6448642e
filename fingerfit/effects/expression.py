"""Formulas that people write in YAML: numbers and named values, nothing else is reachable from them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jinja2.sandbox import SandboxedEnvironment


def _plain(name: str) -> Callable[..., Any]:
    """A function of numpy that only takes its inputs: with `out` it would write into what the formula was given."""
    function = getattr(np, name)
    count = function.nin if isinstance(function, np.ufunc) else 3

    def call(*inputs: Any) -> Any:
        if len(inputs) != count:
            raise TypeError(f"{name} takes {count} value{'s' * (count > 1)}, not {len(inputs)}")
        return function(*inputs)

    return call


FUNCTIONS: dict[str, Callable[..., Any]] = {
    name: _plain(name) for name in ("exp", "log", "sqrt", "tanh", "sin", "cos", "abs", "minimum", "maximum", "where")
}
"""What a formula may call."""


def evaluate(formula: str, values: Mapping[str, Any]) -> Any:
    """Value of a formula.

    Parameters
    ----------
    formula : str
        Arithmetic, comparisons, ``a if b else c`` and the `FUNCTIONS`, as in a template.
    values : mapping
        Names and their numbers or arrays.

    Raises
    ------
    ValueError
        For what is no formula, names something unknown, or reaches for more than numbers.

    >>> float(evaluate("exp(0 * x) + shift", {"x": 2.0, "shift": 0.5}))
    1.5
    """
    import jinja2

    try:
        found = _compiled(formula)(**FUNCTIONS, **values)
    except (jinja2.TemplateError, TypeError, ArithmeticError) as error:
        raise ValueError(f"{formula!r}: {error}") from error
    if found is None or isinstance(found, jinja2.Undefined):
        raise ValueError(f"{formula!r} has no value; it may name {', '.join(sorted(values))}")
    if not isinstance(found, int | float | np.generic | np.ndarray):
        raise ValueError(f"{formula!r} is no number")
    return found


@functools.cache
def _compiled(formula: str) -> Any:
    return _environment().compile_expression(formula, undefined_to_none=False)


@functools.cache
def _environment() -> SandboxedEnvironment:
    import jinja2
    from jinja2.sandbox import SandboxedEnvironment

    class Environment(SandboxedEnvironment):
        """Numbers only: no attribute of anything, no call but of the listed functions."""

        def is_safe_attribute(self, obj: Any, attr: str, value: Any) -> bool:
            return False

        def is_safe_callable(self, obj: Any) -> bool:
            return any(obj is function for function in FUNCTIONS.values())

    environment = Environment(undefined=jinja2.StrictUndefined)
    environment.filters.clear()
    environment.tests.clear()
    environment.globals.clear()
    return environment
