"""Material constants of soft layered bodies from pictures before and during compression.

For notebooks and scripts (docs/python.md):

    import fingerfit

    result = fingerfit.fit("tilt/config.yaml")
    result.constants
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"
_NOTEBOOK = ("Found", "Result", "add", "diagnose", "load_result", "load_study")


class _Fit(ModuleType):
    """The package `fingerfit.fit`, which can be called as the verb."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return import_module("fingerfit.notebook").fit(*arguments, **options)


class _Package(ModuleType):
    """The package: what notebooks use is imported when it is asked for, since the workflow starts many processes."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "fit" and isinstance(value, ModuleType):
            value.__class__ = _Fit
        super().__setattr__(name, value)

    def __getattr__(self, name: str) -> Any:
        if name == "fit":
            return import_module("fingerfit.fit")
        if name in _NOTEBOOK:
            return getattr(import_module("fingerfit.notebook"), name)
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *_NOTEBOOK, "fit"})


sys.modules[__name__].__class__ = _Package
