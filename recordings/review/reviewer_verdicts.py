"""What a reviewer says of cycles: a small file beside the ledger, read and never written.

```toml
[[cycle]]
id = "2023-11-14T22:14:58Z"          # as ledger and page have it: when it was dumped
reject = true                        # not counted
product = "gravel"
note = "bucket caught the wall"
author = "R. Meier"
time = 2023-11-15T08:00:00Z
```
"""

import datetime as dt
import tomllib
from pathlib import Path
from typing import Annotated, Final

import polars as pl
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from estimators.errors import ReviewError, counted

VERDICTS: Final = "verdicts.toml"
#: A dump that another replay finds so much later is the same.
_SAME_S: Final = 5.0
_Text = Annotated[str, Field(max_length=500)]


class CycleVerdict(BaseModel):
    """What somebody says of a cycle, and when."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    id: str
    author: Annotated[str, Field(min_length=1, max_length=200)]
    time: dt.datetime
    reject: bool = False
    product: _Text = ""
    note: _Text = ""


class _VerdictFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    cycle: tuple[CycleVerdict, ...] = ()


def read_verdicts(folder: Path) -> tuple[CycleVerdict, ...]:
    """Read the verdicts of a review's folder, none where there is no file.

    Raises:
        ReviewError: the file cannot be read or says something else.
    """
    path = folder / VERDICTS
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return ()
    except (OSError, UnicodeDecodeError) as error:
        raise ReviewError(f"{path}: cannot be read ({error})") from None
    try:
        return _VerdictFile.model_validate(tomllib.loads(text)).cycle
    except tomllib.TOMLDecodeError as error:
        raise ReviewError(f"{path}: is no TOML ({error})") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise ReviewError(
            f"{path}: {where}: {first['msg']}; a [[cycle]] has id, author, time, and any of "
            "reject, product, note"
        ) from None


def matched(
    verdicts: tuple[CycleVerdict, ...], ids: pl.Series, path: Path
) -> dict[int, CycleVerdict]:
    """The verdict of each row that has one; of two about one cycle the later counts.

    Args:
        verdicts: as read.
        ids: of the cycles, in rows' order.
        path: the folder, for what is said.

    Raises:
        ReviewError: an id that no cycle has.
    """
    times = [_seconds(each) for each in ids]
    found: dict[int, CycleVerdict] = {}
    for verdict in sorted(verdicts, key=lambda v: v.time.astimezone(dt.UTC)):
        at = _seconds(verdict.id)
        away = {} if at is None else {k: abs(t - at) for k, t in enumerate(times) if t is not None}
        best = min(away, key=away.__getitem__, default=None)
        if best is None or away[best] > _SAME_S:
            raise ReviewError(
                f"{path / VERDICTS}: no cycle '{verdict.id}' among {counted(ids.len(), 'cycle')}; "
                "take the id from ledger.csv"
            )
        found[best] = verdict
    return found


def _seconds(identity: str) -> float | None:
    """An id as seconds, None where it is none."""
    try:
        if identity.endswith("s"):
            return float(identity[:-1])
        return dt.datetime.fromisoformat(identity).timestamp()
    except ValueError:
        return None
