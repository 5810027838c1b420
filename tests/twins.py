"""Small twins: of what a test says of many values, `make test` runs the first alone."""

from collections.abc import Iterable
from typing import Any

import pytest
from _pytest.mark import ParameterSet


def mark_slow_after(count: int, values: Iterable[Any]) -> list[ParameterSet]:
    """Values of `pytest.mark.parametrize`, those after the first `count` for `make slow` alone.

    Args:
        count: of those that `make test` runs.
        values: as `parametrize` takes them; a tuple has a value of each name.
    """
    return _mark_after(count, values, pytest.mark.slow)


def mark_heavy_after(count: int, values: Iterable[Any]) -> list[ParameterSet]:
    """The same, those after the first `count` for `make heavy` alone."""
    return _mark_after(count, values, pytest.mark.heavy)


def _mark_after(
    count: int, values: Iterable[Any], mark: pytest.MarkDecorator
) -> list[ParameterSet]:
    marked: list[ParameterSet] = []
    for place, value in enumerate(values):
        row = value if isinstance(value, ParameterSet) else _parameters(value)
        marks = [*row.marks, *([mark] if place >= count else [])]
        marked.append(pytest.param(*row.values, marks=marks, id=row.id))
    return marked


def _parameters(value: Any) -> ParameterSet:
    return pytest.param(*value) if isinstance(value, tuple) else pytest.param(value)
