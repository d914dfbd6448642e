"""Which of our sources a function can reach: what its imports name, those inside of functions included, and so on."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from fingerfit.core.folders import PACKAGE

_IMPORT = re.compile(r"from\s+[\w.]+\s+import\b|import\s+[\w.]+(\s+as\s+\w+)?\s*(,|#|$)")
"""The beginning of an import statement."""


@dataclass(frozen=True)
class Reached:
    """What a function can reach.

    Parameters
    ----------
    modules : dict
        Name of each module to its file; the packages that it is in are among them, for they are run on import.
    text : str
        The function itself and what it uses beside it in its module.
    """

    modules: dict[str, Path]
    text: str


def reached(module: str, function: str) -> Reached:
    """What a function of a module can reach.

    Of its own module only what it names counts, of all others everything. Imports for type checkers alone are left out;
    what other packages register as entry points cannot be seen here, and has an identity of its own.

    Parameters
    ----------
    module, function : str
        As ``fingerfit.commands`` and ``prepare``, or ``fingerfit.solvers.builtin`` and ``BuiltinSolver.solve``.
    """
    known = _modules()
    text = known[module].read_text(encoding="utf-8")
    nodes, names = _used(_tree(known[module]), function)
    waiting = {found for node in nodes for found in _imported(node, module, None)}
    waiting |= set(_imported(_tree(known[module]), module, names, inside=False))
    found: set[str] = set()
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting |= _imports_of(name) - found
    parts = [ast.get_source_segment(text, node) or "" for node in nodes]
    return Reached({name: known[name] for name in sorted(found)}, "\n".join(parts))


@cache
def _modules() -> dict[str, Path]:
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _used(tree: ast.Module, function: str) -> tuple[list[ast.stmt], set[str]]:
    """A function and all of its module's top level that it names, directly or not; and every name in them."""
    top: dict[str, ast.stmt] = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            top[node.name] = node
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            top |= {name: node for target in targets for name in _names(target)}
    owner, _, method = function.partition(".")
    start = top[owner]
    if method and isinstance(start, ast.ClassDef):
        start = next(node for node in start.body if isinstance(node, ast.FunctionDef) and node.name == method)
    nodes: list[ast.stmt] = [start]
    names: set[str] = set()
    for node in nodes:
        used = _names(node) - (_bound(node) if isinstance(node, ast.FunctionDef) else set())
        nodes += [top[name] for name in sorted(used & top.keys()) if top[name] not in nodes and name != owner]
        names |= used
    return nodes, names


def _bound(function: ast.FunctionDef) -> set[str]:
    """Names that a function binds itself: others of its module with the same name are not meant."""
    found = {argument.arg for argument in ast.walk(function.args) if isinstance(argument, ast.arg)}
    for node in ast.walk(function):
        if isinstance(node, ast.Import | ast.ImportFrom):
            found |= {alias.asname or alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
    return found


def _names(node: ast.AST) -> set[str]:
    return {inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name)}


@cache
def _imports_of(module: str) -> set[str]:
    path = _modules()[module]
    text = path.read_text(encoding="utf-8")
    try:
        tree = ast.parse("\n".join(_import_statements(text)))
    except SyntaxError:  # a way of writing one that is not known there
        tree = ast.parse(text)
    return set(_imported(tree, module if path.name != "__init__.py" else f"{module}.", None))


def _import_statements(text: str) -> Iterator[str]:
    """The import statements of a module, by its lines: trees of all modules take a second.

    Lines of a text that read like one are among them, which errs on the safe side.
    """
    checkers: int | None = None  # indentation of a block for type checkers
    lines = iter(text.splitlines())
    for line in lines:
        code = line.lstrip()
        if not code:
            continue
        indent = len(line) - len(code)
        if checkers is not None and indent > checkers:
            continue
        checkers = indent if code.startswith("if ") and "TYPE_CHECKING" in code else None
        if _IMPORT.match(code):
            while "(" in code and ")" not in code:
                code += next(lines, ")")
            yield code


def _imported(node: ast.AST, module: str, names: set[str] | None, inside: bool = True) -> Iterator[str]:
    """Our modules that the imports below a node name, with the packages they are in.

    With `names`, only imports that bind one of them; `inside` functions and classes, or beside them only.
    """
    known = _modules()
    for child in _statements(node) if not isinstance(node, ast.Import | ast.ImportFrom) else [node]:
        if isinstance(child, ast.If) and "TYPE_CHECKING" in _names(child.test):
            for other in child.orelse:
                yield from _imported(other, module, names, inside)
        elif isinstance(child, ast.Import | ast.ImportFrom):
            for alias in child.names:
                bound = alias.asname or alias.name.partition(".")[0]
                if names is not None and bound not in names:
                    continue
                whole = alias.name if isinstance(child, ast.Import) else f"{_source(child, module)}.{alias.name}"
                parts = whole.split(".")
                prefixes = (".".join(parts[:n]) for n in range(1, len(parts) + 1))
                yield from (name for name in prefixes if name in known)
        elif inside or not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield from _imported(child, module, names, inside)


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """What is in the blocks of a statement. Imports are never in expressions, which are most of a tree."""
    for block in ("body", "orelse", "handlers", "finalbody", "cases"):
        yield from getattr(node, block, ())


def _source(node: ast.ImportFrom, module: str) -> str:
    """The module that names are imported from; dots count from the module's package."""
    if not node.level:
        return node.module or ""
    return ".".join([*module.split(".")[: -node.level], *([node.module] if node.module else [])])
