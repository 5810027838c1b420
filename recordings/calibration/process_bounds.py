"""Bounds of a process that reads a stranger's file."""

from typing import Final

#: Bytes of memory: a long log's recording takes one.
_MOST_MEMORY: Final = 8 << 30
_MOST_CPU_S: Final = 600


def bound_process() -> None:
    """Bound memory and time, where the system can."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_DATA, (_MOST_MEMORY, _MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (_MOST_CPU_S, _MOST_CPU_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
