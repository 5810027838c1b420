"""Lazy imports: names of a package that are only imported on first use."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def make_lazy_import_getattr(
    package: str, module_by_name: Mapping[str, str]
) -> Callable[[str], Any]:
    """Make the `__getattr__` of a package that imports names on first use (PEP 562).

    Args:
        package: name of the package.
        module_by_name: module of each public name.
    """

    def import_late(name: str) -> Any:
        if name not in module_by_name:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(import_module(module_by_name[name]), name)

    return import_late
