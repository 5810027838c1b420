"""A conversion that is not finished: what it is of, and which spans of the log are done.

It lies beside the output, under another name. A span is done when its record is there, which is
written behind its parts; whatever else is there is of a span that was cut off.
"""

import fcntl
import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from estimators.errors import OutputError
from replay.logs.converted.description import ConvertedPart, SourceFile

_SUFFIX: Final = ".unfinished"
_PLAN: Final = "plan.json"
_LOCK: Final = ".lock"
_Model = TypeVar("_Model", bound=BaseModel)


class ConversionPlan(BaseModel):
    """What a conversion is of: another plan has other parts."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    payscope: str
    files: tuple[SourceFile, ...]
    topics: tuple[str, ...]
    #: log times at which spans begin; the first begins with the log, the last ends with it
    borders_ns: tuple[int, ...]


class DoneSpan(BaseModel):
    """The parts of a span, by topic."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    parts: dict[str, ConvertedPart]


class UnfinishedFolder:
    """The folder of an unfinished conversion.

    Attributes:
        path: of the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def take_up(self, plan: ConversionPlan) -> list[DoneSpan]:
        """Take up a conversion by the same plan; whatever else is there is removed.

        Returns:
            The spans that are done, from the first.
        """
        if _load_json(self.path / _PLAN, ConversionPlan) != plan:
            self.clear()
            write_whole(self.path / _PLAN, plan.model_dump_json(indent=1))
            return []
        done: list[DoneSpan] = []
        while span := _load_json(self.path / _record(len(done)), DoneSpan):
            if not all((self.path / part.file).is_file() for part in span.parts.values()):
                break
            done.append(span)
        return done

    def add(self, number: int, parts: dict[str, ConvertedPart]) -> DoneSpan:
        """Note that a span is done."""
        span = DoneSpan(parts=parts)
        write_whole(self.path / _record(number), span.model_dump_json(indent=1))
        return span

    def clear(self) -> None:
        """Remove everything in it."""
        for each in self.path.iterdir():
            if each.is_dir():
                shutil.rmtree(each)
            elif each.name != _LOCK:
                each.unlink()

    def drop_records(self, kept: set[str]) -> None:
        """Remove all but the parts of a conversion that is done.

        Args:
            kept: files below the folder.
        """
        for each in sorted(self.path.rglob("*"), reverse=True):
            if each.is_file() and each.relative_to(self.path).as_posix() not in kept:
                each.unlink()


@contextmanager
def unfinished_folder(target: Path) -> Generator[UnfinishedFolder]:
    """The folder in which a conversion to `target` is made; it is no other process's meanwhile.

    Raises:
        OutputError: another process converts to the same output.
    """
    path = target.with_name(f"{target.name}{_SUFFIX}")
    path.mkdir(exist_ok=True)
    with (path / _LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise OutputError(f"{target}: another process is converting to it") from None
        yield UnfinishedFolder(path)


def write_whole(path: Path, text: str) -> None:
    """Write a small file whole: after a power cut it is there as it should be, or not at all."""
    partial = path.with_suffix(".partial")
    with partial.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def _record(number: int) -> str:
    return f"span-{number:05}.json"


def _load_json(path: Path, model: type[_Model]) -> _Model | None:
    """What was written, or None where it is not there or of another version."""
    try:
        return model.model_validate_json(path.read_bytes())
    except (FileNotFoundError, ValidationError):
        return None
