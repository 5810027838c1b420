"""Loops that are interpreted for little work, and compiled otherwise.

Numba needs 0.6 s of processor time before the first compiled loop runs, even if it is cached: as
long as a million iterations of a loop in Python. So a process that reads a log first interprets
small work, up to a budget of seconds. A replay imports numba before it opens a log, and then
interprets no loop that is cached.

Where nothing is kept of a loop yet, compiling it takes half a second, and all that a run needs
45 s. Until `payscope warm-up` or a longer log has compiled it, a loop interprets a short log.

Both ways give the same bits: what is written for both uses integers of 64 bits, products and sums
in their order, and for all else (`in_order`) what calls the same library.
"""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cached_property, update_wrapper
from pathlib import Path
from time import thread_time
from types import FunctionType
from typing import Any, Final, TypeVar, cast

import numpy as np

from estimators.compile_cache import is_function_cached

F = TypeVar("F", bound=Callable[..., Any])

#: Number of iterations above which a call is compiled.
MOST_TURNS: Final = 8192
#: Processor seconds of interpreted work in a process: a third of numba's start-up time.
MOST_SECONDS: Final = 0.2
#: Rows above which a call is compiled although the loop is not cached: 330 s at 100 Hz.
MOST_COLD_ROWS: Final = 32_768
#: Iterations, likewise, for a loop that reads: a topic of 100 s with a dozen marks per message.
MOST_COLD_TURNS: Final = 131_072
#: Processor seconds for which a loop that is not cached is interpreted, twice its compilation time:
#: at worst a loop costs three times its compilation.
MOST_COLD_SECONDS: Final = 1.0
#: Names of the decorators in `estimators.compiled` that compile a function.
_COMPILED, _WITHOUT_REFCOUNTS, _INLINED = (
    "compiled",
    "compiled_without_refcounts",
    "compiled_inline",
)


def is_numba_imported() -> bool:
    """Whether this process has already paid for importing numba, as every replay has to."""
    return "numba" in sys.modules


class _InterpreterBudget:
    """Remaining seconds of interpreted work in this process."""

    seconds = MOST_SECONDS


class _ColdLoopRule:
    """Decides whether a loop without a compiled form may be interpreted in this process."""

    allowed = True


@contextmanager
def compile_even_short_loops() -> Generator[None]:
    """Context in which every called loop is compiled, even for little work."""
    before = _InterpreterBudget.seconds, _ColdLoopRule.allowed
    _InterpreterBudget.seconds, _ColdLoopRule.allowed = 0.0, False
    try:
        yield
    finally:
        _InterpreterBudget.seconds, _ColdLoopRule.allowed = before


class CompiledLoop:
    """A loop over arrays in two forms: interpreted and compiled, including all that it calls."""

    def __init__(
        self,
        function: Callable[..., Any],
        how: str,
        turns: Callable[..., int] | None = None,
        by_arrays: Callable[..., Any] | None = None,
        *,
        at_first: bool = True,
    ) -> None:
        """Prepare both forms.

        Args:
            function: the loop.
            how: name of the decorator that compiles it.
            turns: computes the number of iterations from the arguments.
            by_arrays: computes the same bits by whole-array operations, for the interpreter.
            at_first: whether to interpret little work even if a compiled form is cached.
        """
        self._function, self._how = cast("FunctionType", function), how
        self._turns = turns or longest_integer_array_length
        self._by_arrays, self._at_first = by_arrays, at_first
        self._most_cold = MOST_COLD_TURNS if at_first else MOST_COLD_ROWS
        self._cold_seconds = MOST_COLD_SECONDS
        update_wrapper(self, function)

    @cached_property
    def interpreted(self) -> Callable[..., Any]:
        """The function as run by the interpreter."""
        if self._by_arrays is not None:
            return self._by_arrays
        return self._copy_function_with_replaced_globals(
            {name: each.interpreted for name, each in self._find_called_loops().items()}
        )

    @cached_property
    def compiled(self) -> Any:
        """The function compiled by numba, which is imported on first use."""
        from estimators import compiled  # imports numba, which is slow

        calls = {name: each.compiled for name, each in self._find_called_loops().items()}
        return getattr(compiled, self._how)(self._copy_function_with_replaced_globals(calls))

    @cached_property
    def is_cached(self) -> bool:
        """Whether a compiled form is in the cache, so that it starts without compilation."""
        return is_function_cached(
            Path(self._function.__code__.co_filename), self._function.__qualname__
        )

    def __call__(self, *arguments: Any) -> Any:
        """Run the form that suits the amount of work."""
        if (
            self._at_first
            and _InterpreterBudget.seconds > 0
            and not is_numba_imported()
            and self._turns(*arguments) <= MOST_TURNS
        ):
            start = thread_time()
            try:
                return self._run_in_python(arguments)
            finally:
                _InterpreterBudget.seconds -= thread_time() - start
        if (
            _ColdLoopRule.allowed
            and self._is_interpreting_allowed_while_uncached
            and self._turns(*arguments) <= self._most_cold
        ):
            start = thread_time()
            try:
                return self._run_in_python(arguments)
            finally:
                self._cold_seconds -= thread_time() - start
        return self.compiled(*arguments)

    @property
    def _is_interpreting_allowed_while_uncached(self) -> bool:
        return self._cold_seconds > 0 and not self.is_cached

    def _run_in_python(self, arguments: tuple[Any, ...]) -> Any:
        # like compiled code, it lets integers overflow and divides by zero
        with np.errstate(all="ignore"):
            return convert_numpy_scalars_to_python(self.interpreted(*arguments))

    def _find_called_loops(self) -> "dict[str, CompiledLoop | Primitive]":
        names = self._function.__globals__
        used = {name: names.get(name) for name in self._function.__code__.co_names}
        return {
            name: each for name, each in used.items() if isinstance(each, CompiledLoop | Primitive)
        }

    def _copy_function_with_replaced_globals(
        self, replacements_by_name: dict[str, Any]
    ) -> Callable[..., Any]:
        """The function with some of its global names replaced."""
        mine = self._function
        made = FunctionType(
            mine.__code__,
            {**mine.__globals__, **replacements_by_name},
            mine.__name__,
            mine.__defaults__,
        )
        return update_wrapper(made, mine)


class Primitive:
    """A function with one implementation for Python and one for numba."""

    def __init__(self, interpreted: Callable[..., Any], load: Callable[[], Any]) -> None:
        """Prepare both implementations.

        Args:
            interpreted: implementation for the interpreter.
            load: returns numba's implementation.
        """
        self.interpreted, self._load = interpreted, load

    @cached_property
    def compiled(self) -> Any:
        """The implementation for numba, which is imported on first use."""
        return self._load()


def compiled(function: F) -> F:
    """Compile a function as `estimators.compiled.compiled` does, but interpret it at first."""
    return cast("F", CompiledLoop(function, _COMPILED))


def compiled_without_refcounts(function: F) -> F:
    """Compile a function without reference counts, but interpret it at first."""
    return cast("F", CompiledLoop(function, _WITHOUT_REFCOUNTS))


def compiled_inline(function: F) -> F:
    """Compile a function into each of its callers, but interpret it at first."""
    return cast("F", CompiledLoop(function, _INLINED))


def compiled_for_many_iterations(count_iterations: Callable[..., int]) -> Callable[[F], F]:
    """Compile a function as `compiled` does; `count_iterations` estimates the work of a call."""
    return lambda function: cast("F", CompiledLoop(function, _COMPILED, count_iterations))


def compiled_unless_short_log(function: F) -> F:
    """Compile a function, but interpret it for a short log if no compiled form is cached."""
    return cast(
        "F", CompiledLoop(function, _COMPILED, find_largest_array_dimension, at_first=False)
    )


def compiled_with_array_form(array_form: Callable[..., Any]) -> Callable[[F], F]:
    """Compile a function; the interpreter uses `array_form`, which operates on whole arrays."""
    return lambda function: cast(
        "F",
        CompiledLoop(function, _COMPILED, find_largest_array_dimension, array_form, at_first=False),
    )


def convert_numpy_scalars_to_python(result: Any) -> Any:
    """Convert numpy scalars of a result to Python numbers, as compiled code returns them."""
    if isinstance(result, np.generic):
        return result.item()
    if type(result) is tuple:
        return tuple(map(convert_numpy_scalars_to_python, cast("tuple[Any, ...]", result)))
    return result


def find_largest_array_dimension(*arguments: Any) -> int:
    """Largest dimension of any array among the arguments."""
    sizes = [0]
    for each in arguments:
        if isinstance(each, np.ndarray):
            sizes.append(max(each.shape, default=0))
        elif isinstance(each, tuple):
            sizes.append(find_largest_array_dimension(*each))
    return max(sizes)


def longest_integer_array_length(*arguments: Any) -> int:
    """Length of the longest integer array among the arguments, including those in tuples."""
    sizes = [0]
    for each in arguments:
        if isinstance(each, np.ndarray):
            if each.dtype == np.int64 and each.ndim:
                sizes.append(each.shape[-1])
        elif isinstance(each, tuple):
            sizes.append(longest_integer_array_length(*each))
    return max(sizes)
