"""The topics of a converted log: fields and elements of them, out of the columns of Parquet."""

import re
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Final

import polars as pl

from estimators.errors import nearest
from replay.logs.converted.description import LOG_TIME, ConvertedPart, ConvertedTopic
from replay.logs.messages.message_fields import OWN_COLUMNS
from replay.logs.messages.message_types import LeafField

_ELEMENT: Final = re.compile(r"\[([^\]]*)\]")
#: Digits of an index: lists count in 32 bits.
_MOST_DIGITS: Final = 9


class ConvertedFieldError(Exception):
    """Why a field cannot be read, with the choices, in a line."""


class ConvertedTopics:
    """The columns of one topic, read from the parts that hold a range of log times."""

    def __init__(self, folder: Path, topic: ConvertedTopic) -> None:
        self.topic = topic
        self._folder = folder

    @cached_property
    def schema(self) -> pl.Schema:
        """The columns, with the two times that every topic has."""
        return pl.Schema(pl.read_parquet_schema(self._folder / self.topic.parts[0].file))

    @cached_property
    def leaves(self) -> dict[str, LeafField]:
        """Every field, by its name."""
        return {
            field.name: LeafField(
                field.name,
                self.schema[field.name],
                field.lengths,
                field.value_names,
                field.is_stamp,
            )
            for field in self.topic.fields
        }

    def leaf(self, name: str) -> LeafField:
        """What a column of a field holds, an element of a list among them.

        Raises:
            ConvertedFieldError: there is no such field.
        """
        if name in self.leaves:
            return self.leaves[name]
        picked = pl.DataFrame(schema=self.schema).select(self._column(name))
        return LeafField(name, picked.dtypes[0])

    def read(
        self, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> Iterator[pl.DataFrame]:
        """Rows of a range of log times, part by part.

        Raises:
            ConvertedFieldError: no such field.
        """
        columns = [self._column(name) for name in dict.fromkeys(fields)]
        empty = pl.DataFrame(schema=self.schema).select(*OWN_COLUMNS, *columns)
        is_first = True
        for part in self.topic.parts:
            if not _may_hold(part, start_ns, end_ns):
                continue
            rows = pl.scan_parquet(self._folder / part.file)
            time = pl.col(LOG_TIME)
            if start_ns is not None:
                rows = rows.filter(time >= start_ns)
            if end_ns is not None:
                rows = rows.filter(time <= end_ns)
            is_first = False
            yield rows.select(*OWN_COLUMNS, *columns).collect()
        if is_first:
            yield empty

    def _column(self, name: str) -> pl.Expr:
        """A field as `Log.read` gives it."""
        if name in OWN_COLUMNS:
            raise ConvertedFieldError(
                f"'{name}' is a column of every topic; a field of that name is not read"
            )
        if name in self.leaves:
            return pl.col(name)
        whole = _ELEMENT.sub("[]", name)
        if whole not in self.leaves:
            raise ConvertedFieldError(f"no field {name!r}; {nearest(name, self.leaves)}")
        elements = _ELEMENT.findall(name)
        values, depth = pl.col(whole), 0
        for number, element in enumerate(elements):
            if not element:
                depth += 1
            elif depth:
                raise ConvertedFieldError(
                    f"'{name}' picks inside all of a list, which a converted log does not; read "
                    f"'{whole}', or the log itself"
                )
            else:
                values = values.list.get(self._index(name, elements, number), null_on_oob=True)
        if not depth:
            values = _widen(values, self.schema[whole])
        return values.alias(name)

    def _index(self, name: str, elements: Sequence[str], number: int) -> pl.Expr:
        """Where an element lies in its list: as the name says, or where the list `name` has it."""
        element = elements[number]
        if element.isascii() and element.isdigit():
            index = int(element) if len(element) <= _MOST_DIGITS else 10**_MOST_DIGITS
            length = self._length(name, number)
            if length is not None and index >= length:
                raise ConvertedFieldError(f"'{name}' is out of range; it has {length} elements")
            return pl.lit(index)
        before = name[: [m.start() for m in _ELEMENT.finditer(name)][number]]
        parent = before.rpartition(".")[0]
        names = f"{parent}.name[]".lstrip(".")
        whole = _ELEMENT.sub("[]", names)
        if whole not in self.leaves or not isinstance(self.schema[whole], pl.List):
            raise ConvertedFieldError(
                f"'{name}' picks by name, but there is no list '{names}'; use an index"
            )
        there = pl.col(whole)
        for outer in elements[:number]:
            there = there.list.get(int(outer), null_on_oob=True)
        first = there.list.eval(pl.element() == element).list
        return pl.when(first.any()).then(first.arg_max())

    def _length(self, name: str, number: int) -> int | None:
        lengths = self.leaves[_ELEMENT.sub("[]", name)].lengths
        return lengths[number] if number < len(lengths) else None


def _widen(values: pl.Expr, dtype: pl.DataType) -> pl.Expr:
    """A number that is no element of a list any more has 64 bits."""
    inner = dtype
    while isinstance(inner, pl.List):
        inner = inner.inner
    if inner == pl.Float32:
        return values.cast(pl.Float64)
    return values.cast(pl.Int64) if inner.is_integer() and inner != pl.UInt64 else values


def _may_hold(part: ConvertedPart, start_ns: int | None, end_ns: int | None) -> bool:
    if part.start_ns is None or part.end_ns is None:
        return False
    return not (
        (start_ns is not None and part.end_ns < start_ns)
        or (end_ns is not None and part.start_ns > end_ns)
    )
