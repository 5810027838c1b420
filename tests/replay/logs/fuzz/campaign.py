"""One damaged log after another, each from its number alone, and what became of them."""

import resource
import signal
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from types import FrameType
from typing import Final

from tests.replay.logs.fuzz.damage import KINDS, Damage, Target, damaged, flip_covered
from tests.replay.logs.fuzz.sources import Guard, Source, copied

#: Of the logs that have checksums, so many kinds in eleven hit only what those cover.
_COVERED: Final = (flip_covered,) * 3


@dataclass(frozen=True)
class Case:
    """A damaged log."""

    container: str
    source: Source
    damage: Damage
    #: whose bytes were flipped, where only such were
    guard: Guard | None
    path: Path


def make_case(sources: Mapping[str, Source], name: str, number: int, folder: Path) -> Case:
    """Damage a copy of a log; the same number gives the same bytes."""
    rng = Random(f"{name} {number}")
    source = sources[name]
    kinds = (*_COVERED, *KINDS) if source.guards else KINDS
    damage = kinds[number % len(kinds)]
    guard = rng.choice(source.guards) if damage is flip_covered else None
    file = next((f for f in source.files if guard and f.name == guard.file), None)
    file = file or rng.choice(source.files)
    strange = rng.choice(rng.choice(list(sources.values())).files).read_bytes()
    target = Target(file.read_bytes(), strange, guard.stretches if guard else ())
    folder.mkdir()
    path = copied(source, folder)
    hit = path / file.name if path.is_dir() else path
    hit.write_bytes(damaged(target, damage, rng))
    return Case(name, source, damage, guard, path)


class Hang(BaseException):
    """A log took too long. It is no `Exception`, lest a reader takes it for a fault of the log."""


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Raises `Hang` in what takes longer."""

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise Hang(f"longer than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def peak_mb() -> float:
    """The most memory that this process had so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10


@dataclass
class Tally:
    """What became of the files of a campaign."""

    #: container, kind of damage, outcome
    files: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    commands: int = 0
    #: seconds, and the file
    slowest: tuple[float, str] = (0.0, "")
    began: float = field(default_factory=time.perf_counter)

    def table(self) -> Iterator[str]:
        """The campaign in lines."""
        for column, title in enumerate(("container", "damage")):
            yield f"{title:28}{'files':>7}{'whole':>7}{'losses':>8}{'refused':>8}"
            for name in dict.fromkeys(key[column] for key in self.files):
                yield self._row(name, {k: n for k, n in self.files.items() if k[column] == name})
            yield self._row("all", self.files)
        yield f"commands run on them: {self.commands:,}"
        yield f"the slowest took {self.slowest[0]:.2f} s: {self.slowest[1]}"
        yield f"peak memory of the process {peak_mb():,.0f} MB"
        yield f"{time.perf_counter() - self.began:,.0f} s in all"

    def _row(self, name: str, files: Mapping[tuple[str, str, str], int]) -> str:
        ends = [
            sum(n for (*_, end), n in files.items() if end == outcome)
            for outcome in ("whole", "losses", "refused")
        ]
        return f"{name:28}{sum(ends):7,}{ends[0]:7,}{ends[1]:8,}{ends[2]:8,}"
