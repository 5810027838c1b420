"""Loops that are interpreted while there is little to do, and compiled for all else.

Numba takes 0.6 s of the processor before the first compiled loop runs, though it was compiled
before: as long as a million turns of a loop in Python. So a process begins by interpreting small
work, of which it has so many seconds, and is then done with it. Both ways give the same bits: what
is written for both uses integers of 64 bits and no more than numpy's scalars know.
"""

import sys
from collections.abc import Callable
from functools import cached_property, update_wrapper
from time import thread_time
from types import FunctionType
from typing import Any, Final, TypeVar, cast

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])

#: Work of one call above which it is compiled, in turns of its loop.
MOST_TURNS: Final = 8192
#: Processor seconds that a process interprets, a third of what numba takes to begin.
MOST_SECONDS: Final = 0.2
#: How a function is compiled, by the name of the decorator in `estimators.compiled`.
_COMPILED, _UNCOUNTED, _INLINED = "compiled", "uncounted", "inlined"


def is_compiler_loaded() -> bool:
    """Whether this process has loaded numba, so that compiled loops begin at once."""
    return "estimators.compiled" in sys.modules


class _Budget:
    """What is left of the seconds."""

    seconds = MOST_SECONDS


class Loop:
    """A loop over arrays: `interpreted` calls what it calls interpreted, `compiled` compiled."""

    def __init__(
        self, function: Callable[..., Any], how: str, turns: Callable[..., int] | None
    ) -> None:
        self._function, self._how = cast("FunctionType", function), how
        self._turns = turns or _longest
        update_wrapper(self, function)

    @cached_property
    def interpreted(self) -> Callable[..., Any]:
        """For the interpreter."""
        return self._with_names({name: each.interpreted for name, each in self._twofold().items()})

    @cached_property
    def compiled(self) -> Any:
        """For numba, which is imported when this is asked for."""
        from estimators import compiled  # imports numba, which is slow

        calls = {name: each.compiled for name, each in self._twofold().items()}
        return getattr(compiled, self._how)(self._with_names(calls))

    def __call__(self, *arguments: Any) -> Any:
        """Call it in the way that its work asks for."""
        if _Budget.seconds <= 0 or self._turns(*arguments) > MOST_TURNS:
            return self.compiled(*arguments)
        begin = thread_time()
        try:
            # as compiled code, it lets integers run over
            with np.errstate(over="ignore"):
                return self.interpreted(*arguments)
        finally:
            _Budget.seconds -= thread_time() - begin

    def _twofold(self) -> "dict[str, Loop | Primitive]":
        names = self._function.__globals__
        used = {name: names.get(name) for name in self._function.__code__.co_names}
        return {name: each for name, each in used.items() if isinstance(each, Loop | Primitive)}

    def _with_names(self, names: dict[str, Any]) -> Callable[..., Any]:
        """The function, with other things under some of its global names."""
        mine = self._function
        made = FunctionType(
            mine.__code__, {**mine.__globals__, **names}, mine.__name__, mine.__defaults__
        )
        return update_wrapper(made, mine)


class Primitive:
    """What numba has another word for than Python."""

    def __init__(self, interpreted: Callable[..., Any], load: Callable[[], Any]) -> None:
        """Have both.

        Args:
            interpreted: for the interpreter.
            load: gives what numba takes in its place.
        """
        self.interpreted, self._load = interpreted, load

    @cached_property
    def compiled(self) -> Any:
        """For numba, which is imported when this is asked for."""
        return self._load()


def compiled(function: F) -> F:
    """As `estimators.compiled.compiled`, interpreted at first."""
    return cast("F", Loop(function, _COMPILED, None))


def uncounted(function: F) -> F:
    """As `estimators.compiled.uncounted`, interpreted at first."""
    return cast("F", Loop(function, _UNCOUNTED, None))


def inlined(function: F) -> F:
    """As `estimators.compiled.inlined`, interpreted at first."""
    return cast("F", Loop(function, _INLINED, None))


def compiled_for(turns: Callable[..., int]) -> Callable[[F], F]:
    """As `compiled`, with what tells the turns of the loop from its arguments."""
    return lambda function: cast("F", Loop(function, _COMPILED, turns))


def _longest(*arguments: Any) -> int:
    """The longest row of integers among the arguments, one that is in a tuple among them."""
    sizes = [0]
    for each in arguments:
        if isinstance(each, np.ndarray):
            if each.dtype == np.int64 and each.ndim:
                sizes.append(each.shape[-1])
        elif isinstance(each, tuple):
            sizes.append(_longest(*each))
    return max(sizes)
