"""Scripts of examples/, which are no part of the package."""

import importlib.util
from pathlib import Path
from types import ModuleType

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def script_of(example: str, name: str = "make_study") -> ModuleType:
    """A script of an example, as a module."""
    spec = importlib.util.spec_from_file_location(f"{name}_of_{example}", EXAMPLES / example / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
