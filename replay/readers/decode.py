"""Messages to columns, one message at a time, in batches of bounded size."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import polars as pl
from polars.datatypes import DataTypeClass
from rosbags.serde import SerdeError
from rosbags.typesys.base import normalize_fieldname

from replay.readers.container import BROKEN_BYTES, RawMessage
from replay.readers.fields import Field, Step
from replay.readers.message_types import MessageType

BATCH_ROWS: Final = 8192
INT64_MAX: Final = 2**63 - 1
#: arrays hold NumPy scalars, which polars does not take for every dtype
_CONVERT: Final[dict[DataTypeClass, Callable[[Any], Any]]] = {
    pl.Float64: float,
    pl.Int64: int,
    pl.UInt64: int,
    pl.Boolean: bool,
    pl.String: str,
}


@dataclass(slots=True)
class Tally:
    """How many messages became rows, how many could not be decoded, and why the first not."""

    rows: int = 0
    undecodable: int = 0
    first_fault: str = ""


def schema_of(fields: Sequence[Field]) -> pl.Schema:
    """The columns that reading `fields` gives."""
    stamps = {"log_time_ns": pl.Int64, "header_stamp_ns": pl.Int64}
    return pl.Schema({**stamps, **{field.name: field.dtype for field in fields}})


def decode_batches(
    messages: Iterable[RawMessage], kind: MessageType, fields: Sequence[Field], tally: Tally
) -> Iterator[pl.DataFrame]:
    """Frames of at most `BATCH_ROWS` rows in the order of `messages`; `tally` is kept current."""
    schema = schema_of(fields)
    rows: list[tuple[Any, ...]] = []
    for raw in messages:
        try:
            rows.append(_row(raw, kind, fields))
        except (SerdeError, *BROKEN_BYTES) as error:
            tally.undecodable += 1
            tally.first_fault = tally.first_fault or " ".join(str(error).split())
            continue
        tally.rows += 1
        if len(rows) == BATCH_ROWS:
            yield pl.DataFrame(rows, schema=schema, orient="row")
            rows = []
    if rows:
        yield pl.DataFrame(rows, schema=schema, orient="row")


def _row(raw: RawMessage, kind: MessageType, fields: Sequence[Field]) -> tuple[Any, ...]:
    if raw.log_time_ns > INT64_MAX:
        raise ValueError(f"its log time, {raw.log_time_ns} ns, lies beyond the year 2262")
    message = kind.decode(raw.data)
    stamp = _nanoseconds(message.header.stamp) if kind.record.has_header else None
    return (raw.log_time_ns, stamp, *(_value(message, field) for field in fields))


def _value(message: Any, field: Field) -> Any:
    for step in field.steps:
        message = _follow(message, step)
        if message is None:
            return None
    if field.kind == "stamp":
        return _nanoseconds(message)
    return _CONVERT[field.dtype](message)


def _follow(message: Any, step: Step) -> Any:
    value = getattr(message, normalize_fieldname(step.name))
    if step.element is None:
        return value
    if isinstance(step.element, int):
        at = step.element
    elif step.element in message.name:
        at = message.name.index(step.element)
    else:
        return None
    return value[at] if at < len(value) else None


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
