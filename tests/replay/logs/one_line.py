"""What bad input may do at most."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from estimators.errors import LogError


@contextmanager
def one_line_at_most() -> Iterator[None]:
    """Lets a LogError of one line pass, and nothing else."""
    try:
        yield
    except LogError as error:
        if "\n" in str(error):
            pytest.fail(f"more than a line: {error}")
