"""The decorators that compile loops, with the same options for all of them.

With numpy's error model a division by zero gives infinity, without which no loop with a division is
vectorised. The interpreter's lock is released, so that threads may share a log. Compiled code is
cached for the next process (`estimators.compile_cache`). No operations may be reassociated or
contracted: a loop gives the same bits for one window as for many, and so on board as in replay.

Several processes may compile into one folder at a time. Numba numbers the files of a function's
compiled forms, so two processes with the same number would exchange their code; here a file is
named after its content.
"""

import hashlib
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any, Final, TypeVar, cast

from numba import njit
from numba.core import config
from numba.core.caching import IndexDataCacheFile

from estimators.compile_cache import known_folder_of

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: Final[dict[str, Any]] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    # these functions are not used as C pointers
    "no_cfunc_wrapper": True,
}
_SETTINGS: Final[Any] = config
_ONE_AT_A_TIME: Final = Lock()


def compiled(function: F) -> F:
    """Compile a function of arrays on its first call."""
    return _compile_on_first_call(function, _OPTIONS)


def compiled_without_refcounts(function: F) -> F:
    """Compile a function that allocates nothing, without reference counts for its arrays.

    In a loop of millions of iterations that passes arrays between functions, counting costs more
    than the work. The functions that it calls are compiled in the same way.
    """
    return _compile_on_first_call(function, {**_OPTIONS, "_nrt": False})


def compiled_inline(function: F) -> F:
    """Compile a function into each of its callers."""
    return _compile_on_first_call(function, {**_OPTIONS, "_nrt": False, "forceinline": True})


def _compile_on_first_call(function: F, options: Mapping[str, Any]) -> F:
    with _cache_decorated_functions_in_folder(known_folder_of(Path(function.__code__.co_filename))):
        dispatcher = cast("Any", njit)(**options)(function)
    dispatcher._cache._cache_file.__class__ = _ContentNamedIndex  # noqa: SLF001 - numba has no other way
    return cast("F", dispatcher)


class _ContentNamedIndex(cast("Any", IndexDataCacheFile)):
    """Index of compiled forms that names each form's file after its content.

    If two processes add to the index at once, one entry may be lost and is compiled again.
    """

    def save(self, key: Any, data: Any) -> None:
        name = self._data_name(int(hashlib.sha256(repr(key).encode()).hexdigest()[:12], 16))
        # save the code before its name, so that the index names no missing file
        self._save_data(name, data)
        self._save_index({**self._load_index(), key: name})


@contextmanager
def _cache_decorated_functions_in_folder(folder: Path) -> Generator[None]:
    """Context in which decorated functions are cached in a folder; others are not."""
    with _ONE_AT_A_TIME:
        usual = _SETTINGS.CACHE_DIR
        _SETTINGS.CACHE_DIR = str(folder)
        try:
            yield
        finally:
            _SETTINGS.CACHE_DIR = usual
