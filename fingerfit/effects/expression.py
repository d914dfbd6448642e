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


SHOWN = 60
"""Characters of a formula in a message, which is one line."""


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
        For what is no formula, names something unknown, reaches for more than numbers, or has a value that is not
        finite where all that it was given is.

    >>> float(evaluate("exp(0 * x) + shift", {"x": 2.0, "shift": 0.5}))
    1.5
    """
    import jinja2

    shown = repr(formula if len(formula) <= SHOWN else formula[: SHOWN - 3] + "...")
    try:
        with np.errstate(all="ignore"):
            found = _compiled(formula)(**FUNCTIONS, **values)
    except RecursionError as error:
        raise ValueError(f"{shown} is nested too deeply") from error
    except Exception as error:  # whatever a formula raises, it is the formula's
        raise ValueError(f"{shown}: {error}") from error
    if found is None or isinstance(found, jinja2.Undefined):
        raise ValueError(f"{shown} has no value; it may name {', '.join(sorted(values))}")
    if not isinstance(found, int | float | np.generic | np.ndarray):
        raise ValueError(f"{shown} is no number")
    if not _finite(found) and all(map(_finite, values.values())):
        raise ValueError(f"{shown} is not finite")
    return found


def _finite(value: Any) -> bool:
    try:
        return bool(np.isfinite(np.asarray(value, dtype=float)).all())
    except OverflowError:  # whole numbers of hundreds of digits
        return False


@functools.cache
def _compiled(formula: str) -> Any:
    return _environment().compile_expression(formula, undefined_to_none=False)


@functools.cache
def _environment() -> SandboxedEnvironment:
    import jinja2
    from jinja2.sandbox import SandboxedEnvironment

    class Environment(SandboxedEnvironment):
        """Numbers only: no attribute of anything, no call but of the listed functions."""

        intercepted_binops = frozenset({"*", "**"})

        def call_binop(self, context: Any, operator: str, left: Any, right: Any) -> Any:
            if isinstance(left, str | list | tuple) or isinstance(right, str | list | tuple):
                raise TypeError("only numbers can be multiplied")
            # whole numbers to the power of others would grow without an end
            return left * right if operator == "*" else np.asarray(left, dtype=float)[()] ** right

        def is_safe_attribute(self, obj: Any, attr: str, value: Any) -> bool:
            return False

        def is_safe_callable(self, obj: Any) -> bool:
            return any(obj is function for function in FUNCTIONS.values())

    environment = Environment(undefined=jinja2.StrictUndefined)
    environment.filters.clear()
    environment.tests.clear()
    environment.globals.clear()
    return environment
