"""Formulas that people write in YAML: numbers and named values, nothing else is reachable from them."""

from __future__ import annotations

import ast
import functools
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

LENGTH = 2000
"""Characters of a formula with its names put in; the longest of ours has 900. Python's parser crashes on much longer
nested ones."""
DEEP = 100
"""Operations within operations; the deepest of ours has 20. Python takes four frames for each, of which it has 1000."""

_SHOWN = 100
"""Characters of a formula that errors repeat: their lines are cut after 200."""


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
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
}
_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


def evaluate(formula: str, values: Mapping[str, Any]) -> Any:
    """Value of a formula, in double precision.

    Parameters
    ----------
    formula : str
        Arithmetic, comparisons, ``and``, ``or``, ``not``, ``a if b else c`` and the `FUNCTIONS`.
    values : mapping
        Names and their numbers or arrays.

    Raises
    ------
    ValueError
        For what is no formula or too long a one, names something unknown, reaches for more than numbers, or comes to
        what is not finite. Where arrays that are given are not finite, as forces that were not measured, what comes of
        them need not be.

    >>> float(evaluate("exp(0 * x) + shift", {"x": 2.0, "shift": 0.5}))
    1.5
    """
    try:
        # whole numbers have any number of digits in Python
        given = {name: _double(value) for name, value in values.items()}
        with np.errstate(all="ignore"):  # what is not finite is told below
            found = _value(_parsed(formula), given)
        if not np.ndim(found) and (isinstance(found, complex) or not np.isfinite(found)):
            raise ValueError(f"comes to {found:.3g}")
        if not np.isfinite(found).all() and all(np.isfinite(value).all() for value in given.values()):
            raise ValueError("is not finite")
    except (ValueError, TypeError, ArithmeticError) as error:
        shown = formula if len(formula) <= _SHOWN else f"{formula[: _SHOWN - 3]}..."
        reason = "a number beyond double precision" if isinstance(error, OverflowError) else error
        raise ValueError(f"{shown!r}: {reason}") from error
    return found


def names_in(formula: str) -> set[str]:
    """Names that a formula needs values of; none where it is no formula.

    >>> sorted(names_in("force / (width * exp(1))"))
    ['force', 'width']
    """
    try:
        tree = _parsed(formula)
    except ValueError:
        return set()
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} - FUNCTIONS.keys()


def put_in(formula: str, named: Mapping[str, str]) -> str:
    """A formula, in brackets the formulas that its names stand for; what is too long for one stays as it is.

    >>> put_in("force / (1 + growth)", {"growth": "volume * now"})
    'force / (1 + (volume * now))'
    """
    if not named or len(formula) > LENGTH:
        return formula
    return re.sub(rf"(?<![\w.])(?:{'|'.join(named)})\b", lambda name: f"({named[name[0]]})", formula)


def named_by(let: Mapping[str, str]) -> dict[str, str]:
    """What names stand for, in each the names before it put in.

    Raises
    ------
    ValueError
        For what is no formula, or too long or deep a one once it is whole.

    >>> named_by({"rate": "settling + 1", "course": "exp(-rate * now)"})["course"]
    'exp(-(settling + 1) * now)'
    """
    whole: dict[str, str] = {}
    for name, formula in let.items():
        try:
            _parsed(formula)  # by itself: what closes a bracket that it has not opened is none
            whole[name] = put_in(formula, whole)
            _parsed(whole[name])
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    return whole


def _double(value: Any) -> Any:
    return np.asarray(value, dtype=float) if np.ndim(value) else float(value)


@functools.cache
def _parsed(formula: str) -> ast.expr:
    """Tree of a formula that has nothing in it but what `_value` knows."""
    if len(formula) > LENGTH:
        raise ValueError(f"{len(formula)} characters; at most {LENGTH}")
    try:
        tree = ast.parse(formula.strip(), mode="eval").body
    except (SyntaxError, RecursionError, MemoryError) as error:
        raise ValueError("not a formula") from error
    level = [tree]
    for _ in range(DEEP):
        level = [inner for node in level for inner in _operands(node)]
        if not level:
            return tree
    raise ValueError(f"operations more than {DEEP} deep")


def _operands(node: ast.expr) -> list[ast.expr]:
    """What an operation is done to.

    Raises
    ------
    ValueError
        For what formulas do not have.
    """
    match node:
        case ast.Constant(value=bool() | str() | bytes() | complex() | None):
            pass
        case ast.Constant(value=int() | float()) | ast.Name():
            return []
        case ast.BinOp() if type(node.op) in _BINARY:
            return [node.left, node.right]
        case ast.UnaryOp() if type(node.op) in _UNARY:
            return [node.operand]
        case ast.BoolOp():
            return node.values
        case ast.Compare() if all(type(op) in _COMPARE for op in node.ops):
            return [node.left, *node.comparators]
        case ast.IfExp():
            return [node.test, node.body, node.orelse]
        case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS and not node.keywords:
            return node.args
    raise ValueError(f"{ast.unparse(node)[:40]} is no number, operation or one of {', '.join(FUNCTIONS)}")


def _value(node: ast.expr, values: Mapping[str, Any]) -> Any:
    match node:
        case ast.Constant():
            return float(node.value)  # type: ignore[arg-type]
        case ast.Name():
            if node.id not in values:
                raise ValueError(f"{node.id} has no value; it may name {', '.join(sorted(values))}")
            return values[node.id]
        case ast.BinOp():
            return _BINARY[type(node.op)](_value(node.left, values), _value(node.right, values))
        case ast.UnaryOp():
            return _UNARY[type(node.op)](_value(node.operand, values))
        case ast.BoolOp():
            found = None
            for inner in node.values:
                found = _value(inner, values)
                if bool(found) == isinstance(node.op, ast.Or):
                    break
            return found
        case ast.Compare():
            left, found = _value(node.left, values), True
            for op, inner in zip(node.ops, node.comparators, strict=True):
                right = _value(inner, values)
                found = _COMPARE[type(op)](left, right)
                if len(node.ops) > 1 and not found:
                    break
                left = right
            return found
        case ast.IfExp():
            return _value(node.body if _value(node.test, values) else node.orelse, values)
        case ast.Call(func=ast.Name(id=name)):
            return FUNCTIONS[name](*[_value(inner, values) for inner in node.args])
    raise AssertionError(node)  # `_operands` has refused it
