"""Verdicts of reviewers on a shift and its cycles: a small file beside the ledger.

```toml
[[shift]]                            # of all cycles that do not say otherwise
operator = "A. Kim"
product = "gravel"

[[shift]]                            # of those that are dumped in this time
begin = 2023-11-14T23:00:00Z
end = 2023-11-15T01:00:00Z
product = "sand"

[[cycle]]
id = "2023-11-14T22:14:58Z"          # as ledger and page have it: when it was dumped
reject = true                        # not counted
product = "sand"
note = "bucket caught the wall"
author = "R. Meier"
time = 2023-11-15T08:00:00Z
```

It is written by a person, by the page, or by `payscope review DIR --reject …`, which appends to it.
"""

import datetime as dt
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Final

import polars as pl
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from estimators.errors import ReviewError, format_count
from recordings.review.review_limits import LIMITS

VERDICTS: Final = "verdicts.toml"
#: Labels that a load can have; totals are made by each of them.
LABELS: Final = ("product", "operator", "truck", "customer", "stockpile")
#: Keys of a verdict in the file, in the order in which they are written.
_KEYS: Final = ("id", "begin", "end", "reject", *LABELS, "note", "author", "time")
_Text = Annotated[str, Field(max_length=500)]
_Author = Annotated[str, Field(min_length=1, max_length=200)]


class Labels(BaseModel):
    """Product, operator, customer and place of a load; empty if not stated."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    product: _Text = ""
    operator: _Text = ""
    truck: _Text = ""
    customer: _Text = ""
    stockpile: _Text = ""


class CycleVerdict(Labels):
    """Verdict of a reviewer on a cycle, with its time."""

    id: str
    author: _Author
    time: dt.datetime
    reject: bool = False
    note: _Text = ""


class ShiftVerdict(Labels):
    """Verdict of a reviewer on all cycles; the later one counts, label by label.

    Attributes:
        begin: start of the time in which the cycles are dumped; None for no bound.
        end: end of that time; None for no bound.
        author: name of the reviewer.
        time: time of the verdict.
    """

    begin: AwareDatetime | None = None
    end: AwareDatetime | None = None
    author: _Author | None = None
    time: dt.datetime | None = None

    def applies_to_dump_at(self, dump_unix_s: float) -> bool:
        """Whether the verdict applies to a cycle dumped at a Unix time in s."""
        first, last = (
            limit if each is None else each.timestamp()
            for each, limit in ((self.begin, float("-inf")), (self.end, float("inf")))
        )
        return first <= dump_unix_s < last


class VerdictFile(BaseModel):
    """Contents of a file of verdicts."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    shift: tuple[ShiftVerdict, ...] = ()
    cycle: tuple[CycleVerdict, ...] = ()

    @property
    def labels_of_whole_shift(self) -> Labels:
        """Labels of the whole shift: those given without start and end."""
        return merge_labels_of_verdicts(
            each for each in self.shift if each.begin is None and each.end is None
        )

    def find_labels_at_dump(self, dump_unix_s: float) -> Labels:
        """Find the labels that apply to a cycle dumped at a Unix time in s."""
        return merge_labels_of_verdicts(
            each for each in self.shift if each.applies_to_dump_at(dump_unix_s)
        )


def merge_labels_of_verdicts(verdicts: Iterable[ShiftVerdict]) -> Labels:
    """Merge the labels of verdicts; the later verdict counts, label by label."""
    said: dict[str, str] = {}
    for verdict in verdicts:
        said |= {name: text for name in LABELS if (text := getattr(verdict, name))}
    return Labels.model_validate(said)


def read_verdict_file(folder: Path) -> VerdictFile:
    """Read the verdicts in a review's folder; none if it has no file of verdicts.

    Raises:
        ReviewError: the file cannot be read, or is not a file of verdicts.
    """
    return parse_verdicts(read_verdict_text(folder), folder)


def read_verdict_text(folder: Path) -> str:
    """Read the text of a review's file of verdicts, unchanged; empty if there is none.

    Raises:
        ReviewError: the file cannot be read.
    """
    path = folder / VERDICTS
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return ""
    except (OSError, UnicodeDecodeError) as error:
        raise ReviewError(f"{path}: cannot be read ({error})") from None


def parse_verdicts(text: str, folder: Path) -> VerdictFile:
    """Parse the verdicts in a text.

    Args:
        text: text of the file.
        folder: folder of the review, for error messages.

    Raises:
        ReviewError: the text is not that of a file of verdicts.
    """
    path = folder / VERDICTS
    try:
        return VerdictFile.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ReviewError(f"{path}: is not TOML ({error})") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise ReviewError(
            f"{path}: {where}: {first['msg']}; a [[cycle]] has id, author, time, and any of "
            f"reject, note, {', '.join(LABELS)}; a [[shift]] any of {', '.join(LABELS)}, "
            "begin, end, author, time"
        ) from None


def format_verdicts_as_toml(verdicts: Iterable[CycleVerdict | ShiftVerdict]) -> str:
    """Format verdicts as TOML, without empty values."""
    blocks: list[str] = []
    for verdict in verdicts:
        name = "cycle" if isinstance(verdict, CycleVerdict) else "shift"
        lines = [f"[[{name}]]"]
        said = verdict.model_dump(exclude_defaults=True)
        lines += [
            f"{key} = {_format_verdict_value_as_toml(said[key])}" for key in _KEYS if key in said
        ]
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def list_verdict_file_lines(text: str) -> list[str]:
    """List the lines of a file of verdicts, with invisible characters as their code points."""
    return [
        "".join(_escape_unprintable_character(c) for c in line.replace("\t", " "))
        for line in text.splitlines()
    ]


def assign_verdicts_to_rows(
    verdicts: VerdictFile, cycle_ids: pl.Series, verdict_path: Path
) -> dict[int, CycleVerdict]:
    """Assign verdicts to rows of cycles by index; the later of two verdicts on a cycle counts.

    Args:
        verdicts: verdicts from the file.
        cycle_ids: ids of the cycles in row order.
        verdict_path: folder of the review, for error messages.

    Raises:
        ReviewError: a verdict has an id that no cycle has.
    """
    times = [parse_cycle_id_s(each) for each in cycle_ids]
    found: dict[int, CycleVerdict] = {}
    for verdict in sorted(verdicts.cycle, key=lambda v: v.time.astimezone(dt.UTC)):
        at = parse_cycle_id_s(verdict.id)
        away = {} if at is None else {k: abs(t - at) for k, t in enumerate(times) if t is not None}
        best = min(away, key=away.__getitem__, default=None)
        if best is None or away[best] > LIMITS.same_dump_s:
            raise ReviewError(
                f"{verdict_path / VERDICTS}: no cycle '{verdict.id}' among "
                f"{format_count(cycle_ids.len(), 'cycle')}; "
                "take the id from ledger.csv"
            )
        found[best] = verdict
    return found


def parse_cycle_id_s(cycle_id: str) -> float | None:
    """Parse the time in s that an id of a cycle denotes; None if it is not a time."""
    try:
        if cycle_id.endswith("s"):
            return float(cycle_id[:-1])
        return dt.datetime.fromisoformat(cycle_id).timestamp()
    except ValueError:
        return None


def _format_verdict_value_as_toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dt.datetime):
        return f"{value.astimezone(dt.UTC):%Y-%m-%dT%H:%M:%SZ}"
    return '"' + "".join(_escape_toml_character(c) for c in str(value)) + '"'


def _escape_toml_character(character: str) -> str:
    """Escape a character for a TOML basic string, if necessary or invisible."""
    return f"\\{character}" if character in '\\"' else _escape_unprintable_character(character)


def _escape_unprintable_character(character: str) -> str:
    return character if character.isprintable() else f"\\U{ord(character):08x}"
