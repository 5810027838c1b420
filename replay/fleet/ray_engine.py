"""Engine of a fleet, which runs a function over many tasks on nodes: interface, and Ray's version.

An engine places tasks on nodes by the memory that each declares, gives each one thread, restarts
tasks of a lost node or worker, and reports the tasks that it gave up, with the reason. The engine
on Ray is the only one, and no other file imports Ray; another engine needs the same two methods.
"""

import importlib
import importlib.util
import logging
import os
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from typing import Any, Final, Generic, Protocol, TypeVar

from estimators.errors import FleetError
from replay.fleet.engine_limits import LIMITS

Task = TypeVar("Task")
Result = TypeVar("Result")
#: Bytes of a GiB.
_GIB: Final = 2**30
#: Libraries that are limited to one thread, as a task is.
_LIBRARIES: Final = ("OPENBLAS", "OMP", "MKL", "NUMBA", "RAYON")
_ONE_THREAD: Final = {
    **{f"{library}_NUM_THREADS": "1" for library in _LIBRARIES},
    "POLARS_MAX_THREADS": "1",
}
#: Settings before Ray is imported: no usage is reported, and a Ray that is started for this command
#: listens only on the loopback address.
_QUIET: Final = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_DEDUP_LOGS": "0"}
_LOOPBACK: Final = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}


@dataclass(frozen=True, slots=True)
class TaskWithMemory(Generic[Task]):
    """A task, and the memory in bytes that it declares for its placement."""

    task: Task
    memory_bytes: int


@dataclass(frozen=True, slots=True)
class LostTask:
    """A task that the engine gave up, and why."""

    reason: str


class TaskEngine(Protocol):
    """Interface of an engine, which runs a function over tasks."""

    def count_parallel_slots(self) -> int:
        """Number of tasks that run in parallel, as far as the engine knows."""
        ...

    def run_tasks(
        self, function: Callable[[Task], Result], tasks_with_memory: Sequence[TaskWithMemory[Task]]
    ) -> Iterator[tuple[Task, Result | LostTask]]:
        """Yield each task exactly once with its result, in the order in which they finish."""
        ...


@contextmanager
def start_ray_engine(address: str | None, workers: int | None) -> Generator["RayEngine"]:
    """Context with an engine on a cluster, or on this machine.

    Args:
        address: address of the cluster's head (`host:port`, `ray://host:port`); None starts Ray
            here.
        workers: parallel tasks on this machine; None uses every processor.

    Raises:
        FleetError: no cluster answers at the address.
    """
    if address:
        refuse_address_without_listener(address)
    here = {} if address else _LOOPBACK
    for name, value in {**_QUIET, **here}.items():
        os.environ.setdefault(name, value)
    import ray

    logging.getLogger("ray").setLevel(logging.ERROR)
    started: dict[str, Any] = (
        {"address": address}
        if address
        else {
            "address": "local",
            "num_cpus": workers,
            "include_dashboard": False,
            "object_store_memory": LIMITS.ray_storage_bytes,
        }
    )
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        ray.init(
            **started,
            log_to_driver=False,
            configure_logging=False,
            runtime_env={"env_vars": _ONE_THREAD},
        )
    except (ConnectionError, RuntimeError, ValueError) as error:
        first = str(error).strip().partition("\n")[0]
        raise FleetError(
            f"--address {address}: no cluster answers ({first}); start it, or correct the address"
        ) from None
    for number, handler in handlers.items():
        # Ray's handler would exit without the command's cleaning up
        with suppress(ValueError):
            signal.signal(number, handler)
    # lost tasks are in the results; Ray would print them to stdout, among data
    with redirect_stdout(_StreamWithoutRay(sys.stdout)):  # pyright: ignore[reportArgumentType]
        try:
            yield RayEngine(ray)
        finally:
            ray.shutdown()


def refuse_address_without_listener(address: str) -> None:
    """Raise an error if nothing listens at an address; Ray would retry for minutes."""
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not host or not port.isdigit():
        raise FleetError(f"--address {address}: give the cluster's head as host:port")
    try:
        socket.create_connection((host, int(port)), timeout=LIMITS.answer_s).close()
    except (OSError, OverflowError) as error:
        raise FleetError(
            f"--address {address}: no cluster answers ({error}); start it, or correct the address"
        ) from None


class _StreamWithoutRay:
    """A stream that drops text written by Ray's own threads."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write the text, unless Ray wrote it."""
        mine = not threading.current_thread().name.startswith("ray_")
        return self._stream.write(text) if mine else len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class RayEngine:
    """Engine on Ray."""

    def __init__(self, ray: Any) -> None:
        self._ray = ray

    def count_parallel_slots(self) -> int:
        """Number of processors of the cluster."""
        return max(int(self._ray.cluster_resources().get("CPU", 1)), 1)

    def run_tasks(
        self, function: Callable[[Task], Result], tasks_with_memory: Sequence[TaskWithMemory[Task]]
    ) -> Iterator[tuple[Task, Result | LostTask]]:
        """Yield each task with its result as it finishes; nodes import the function."""
        remote = self._ray.remote(
            num_cpus=1, max_retries=LIMITS.max_retries, max_calls=LIMITS.tasks_per_worker
        )(function)
        waiting = deque(tasks_with_memory)
        running: dict[Any, TaskWithMemory[Task]] = {}
        try:
            while waiting or running:
                most = (1 + LIMITS.tasks_ahead) * self.count_parallel_slots()
                while waiting and len(running) < most:
                    each = waiting.popleft()
                    too_large = self._describe_unsatisfiable_memory(each.memory_bytes)
                    if too_large:
                        yield each.task, too_large
                        continue
                    placed = remote.options(memory=each.memory_bytes)
                    running[placed.remote(each.task)] = each
                if running:
                    ready, _ = self._ray.wait(list(running), timeout=LIMITS.wait_s)
                    for reference in ready:
                        yield running.pop(reference).task, self._fetch_result_of_task(reference)
        finally:
            for reference in running:
                self._ray.cancel(reference, force=True)

    def _describe_unsatisfiable_memory(self, memory_bytes: int) -> LostTask | None:
        """Say why a task fits on no node, where it would wait forever; None if it fits."""
        nodes = [node for node in self._ray.nodes() if node["Alive"]]
        largest = max((node["Resources"].get("memory", 0.0) for node in nodes), default=0.0)
        if memory_bytes <= largest:
            return None
        return LostTask(
            f"declares {memory_bytes / _GIB:.1f} GiB of memory, and the largest node has "
            f"{largest / _GIB:.1f} GiB; lower the memory in [limits] of the fleet file"
        )

    def _fetch_result_of_task(self, result_reference: Any) -> Any:
        """Fetch the result of a task, or the reason why Ray lost it."""
        from ray import exceptions

        try:
            return self._ray.get(result_reference)
        except exceptions.OutOfMemoryError:
            return LostTask("its node ran out of memory, and Ray ended it")
        except (exceptions.WorkerCrashedError, exceptions.NodeDiedError):
            return LostTask(
                f"its worker ended {LIMITS.max_retries + 1} times without a message: it crashed, "
                "was killed, or hung"
            )
        except exceptions.RayTaskError as error:
            cause = getattr(error, "cause", None) or error
            said = str(cause).strip().rpartition("\n")[2]
            return LostTask(f"{type(cause).__name__}: {said}")
        except exceptions.RayError as error:
            return LostTask(f"Ray: {str(error).strip().partition(chr(10))[0]}")


def find_missing_fleet_library() -> str | None:
    """Name of a library of the extra `fleet` that is missing; None if all are installed."""
    return next(
        (name for name in ("ray", "obstore") if importlib.util.find_spec(name) is None), None
    )
