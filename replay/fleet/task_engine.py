"""Interface of a fleet's engine, which runs one function over many tasks anywhere.

An engine places tasks on nodes by the memory that each declares, gives each one thread, restarts
tasks of a lost node or worker, and reports the tasks that it gave up, with the reason. `ray_engine`
is the only one so far; another one needs these two methods.
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

    def count_parallel_slots(self) -> int:
        """Number of tasks that run in parallel, as far as the engine knows."""
        ...

    def run_tasks(
        self, function: Callable[[Task], Result], task_work: Sequence[TaskWork[Task]]
    ) -> Iterator[tuple[Task, Result | LostTask]]:
        """Yield each task with its result as it comes, in any order; each exactly once."""
        ...
