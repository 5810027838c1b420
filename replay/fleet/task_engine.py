"""Interface of a fleet's engine, which runs one function over many tasks anywhere.

An engine places tasks on nodes by the memory that each declares, gives each one thread, starts
those of a lost node or worker anew, and says which it gave up and why. `ray_engine` is the one
there is; another needs these two methods.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class TaskWork(Generic[Task]):
    """A task, and the memory in bytes that it is placed by."""

    task: Task
    memory_bytes: int


@dataclass(frozen=True, slots=True)
class LostTask:
    """A task that the engine gave up, and why."""

    reason: str


class TaskEngine(Protocol):
    """Runs a function over tasks."""

    def slots(self) -> int:
        """Number of tasks that run in parallel, as far as the engine knows."""
        ...

    def run(
        self, function: Callable[[Task], Result], work: Sequence[TaskWork[Task]]
    ) -> Iterator[tuple[Task, Result | LostTask]]:
        """Yield each task with its result as it comes, in any order; each exactly once."""
        ...
