"""Trials of a campaign, kept as they come: a line of JSON each, and none is made again."""

import json
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


def keep(path: Path | None, result: object) -> None:
    """Append a result, a dataclass or a dictionary, to a file; nothing where there is none."""
    if path is None:
        return
    row = asdict(result) if is_dataclass(result) and not isinstance(result, type) else result
    with path.open("a", encoding="utf-8") as lines:
        lines.write(f"{json.dumps(row, ensure_ascii=False)}\n")


def read_rows(*paths: Path) -> list[dict[str, Any]]:
    """Read the rows that earlier runs kept."""
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return [json.loads(line) for text in texts for line in text.splitlines()]


def run_trials(
    tasks: Iterable[Task],
    trial: Callable[[Task], Result],
    kept: Path | None,
    result: Callable[..., Result],
    *,
    task_key: Callable[[Task], Hashable],
    result_key: Callable[[Result], Hashable],
) -> Iterator[Result]:
    """Try each task, or take its result from the file, in the order of the tasks.

    Args:
        tasks: what is to be done.
        trial: does it.
        kept: where results are kept as they come; None: nowhere.
        result: makes one of what a row holds.
        task_key: what tells a task from the others.
        result_key: the same of its result.
    """
    rows = [] if kept is None or not kept.exists() else read_rows(kept)
    before = {result_key(each): each for each in (result(**row) for row in rows)}
    for task in tasks:
        key = task_key(task)
        if key not in before:
            before[key] = trial(task)
            keep(kept, before[key])
        yield before[key]


def run_seeds(
    seeds: Iterable[int],
    trial: Callable[[int], Result],
    kept: Path | None,
    result: Callable[..., Result],
) -> Iterator[Result]:
    """Try each seed, as `run_trials` does; a result has its `seed`."""
    return run_trials(
        seeds,
        trial,
        kept,
        result,
        task_key=lambda seed: seed,
        result_key=lambda each: each.seed,  # pyright: ignore[reportAttributeAccessIssue]
    )
