"""How the loops are compiled: one way for all of them.

With numpy's error model a division by zero is infinite, without which no loop that divides is
vectorised; the interpreter's lock is released, so that threads may share a log; what is compiled is
kept for the next process. Nothing may be reassociated or contracted: a loop gives the same bits for
one window as for many, and so on board as in replay.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a function of arrays when it is first called."""
    return cast("F", njit(cache=True, nogil=True, error_model="numpy")(function))
