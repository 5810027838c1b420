"""Reader of a converted log: a folder of Parquet files per topic, written by `payscope convert`."""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Final

import polars as pl
from pydantic import ValidationError

from analysis.model.loss import Loss
from estimators.errors import LogError, join_first_names, suggest_choice
from estimators.file_digest import file_sha256
from replay.logs.converted import DESCRIPTION
from replay.logs.converted.description import (
    FORMAT,
    LOG_TIME,
    ConvertedDescription,
    ConvertedPart,
    ConvertedTopic,
)
from replay.logs.log import Log, LogCheck
from replay.logs.log_limits import LIMITS
from replay.logs.messages.message_fields import OWN_COLUMNS
from replay.logs.messages.message_types import LeafField
from replay.logs.storage import LossList

_ELEMENT: Final = re.compile(r"\[([^\]]*)\]")


class ConvertedFieldError(Exception):
    """Raised if a field cannot be read; one line with the reason and the choices."""


class ConvertedTopicColumns:
    """Columns of one topic, read from the parts that cover a time range."""

    def __init__(self, folder: Path, topic: ConvertedTopic) -> None:
        self.topic = topic
        self._folder = folder

    @cached_property
    def schema(self) -> pl.Schema:
        """Data types of all columns, including the two times of every topic."""
        return pl.Schema(pl.read_parquet_schema(self._folder / self.topic.parts[0].file))

    @cached_property
    def leaf_fields_by_name(self) -> dict[str, LeafField]:
        """Every leaf field, by name."""
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

    def leaf_field_of_column(self, name: str) -> LeafField:
        """Describe the leaf field of a column, which may be an element of a list.

        Raises:
            ConvertedFieldError: the field does not exist.
        """
        if name in self.leaf_fields_by_name:
            return self.leaf_fields_by_name[name]
        picked = pl.DataFrame(schema=self.schema).select(self._make_field_expression(name))
        return LeafField(name, picked.dtypes[0])

    def iter_frames_of_time_range(
        self, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> Iterator[pl.DataFrame]:
        """Yield the rows of a range of log times, part by part.

        Raises:
            ConvertedFieldError: a field does not exist.
        """
        columns = [self._make_field_expression(name) for name in dict.fromkeys(fields)]
        empty = pl.DataFrame(schema=self.schema).select(*OWN_COLUMNS, *columns)
        is_first = True
        for part in self.topic.parts:
            if not _can_part_overlap_time_span(part, start_ns, end_ns):
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

    def _make_field_expression(self, name: str) -> pl.Expr:
        """Expression that selects a field, in the format of `Log.read`."""
        if name in OWN_COLUMNS:
            raise ConvertedFieldError(
                f"'{name}' is a reserved column of every topic; a message field with this "
                "name cannot be read"
            )
        if name in self.leaf_fields_by_name:
            return pl.col(name)
        whole = _ELEMENT.sub("[]", name)
        if whole not in self.leaf_fields_by_name:
            raise ConvertedFieldError(
                f"no field {name!r}; {suggest_choice(name, self.leaf_fields_by_name)}"
            )
        elements = _ELEMENT.findall(name)
        values, depth = pl.col(whole), 0
        for number, element in enumerate(elements):
            if not element:
                depth += 1
            elif depth:
                raise ConvertedFieldError(
                    f"'{name}' selects a part of every list element, which is not supported in "
                    f"converted logs; read '{whole}', or use the original log"
                )
            else:
                values = values.list.get(
                    self._make_list_index_expression(name, elements, number), null_on_oob=True
                )
        if not depth:
            values = _cast_numbers_to_64_bits(values, self.schema[whole])
        return values.alias(name)

    def _make_list_index_expression(
        self, name: str, elements: Sequence[str], list_number: int
    ) -> pl.Expr:
        """Expression of the index of a list element, given as digits or by its entry in `name`."""
        element = elements[list_number]
        if element.isascii() and element.isdigit():
            index = int(element) if len(element) <= LIMITS.index_digits else 10**LIMITS.index_digits
            length = self._find_fixed_list_length(name, list_number)
            if length is not None and index >= length:
                raise ConvertedFieldError(
                    f"'{name}' is out of range; the list has {length} elements"
                )
            return pl.lit(index)
        before = name[: [m.start() for m in _ELEMENT.finditer(name)][list_number]]
        parent = before.rpartition(".")[0]
        names = f"{parent}.name[]".lstrip(".")
        whole = _ELEMENT.sub("[]", names)
        if whole not in self.leaf_fields_by_name or not isinstance(self.schema[whole], pl.List):
            raise ConvertedFieldError(
                f"'{name}' selects by name, but there is no list '{names}'; select by index"
            )
        there = pl.col(whole)
        for outer in elements[:list_number]:
            there = there.list.get(int(outer), null_on_oob=True)
        first = there.list.eval(pl.element() == element).list
        return pl.when(first.any()).then(first.arg_max())

    def _find_fixed_list_length(self, name: str, list_number: int) -> int | None:
        lengths = self.leaf_fields_by_name[_ELEMENT.sub("[]", name)].lengths
        return lengths[list_number] if list_number < len(lengths) else None


class ConvertedLog(Log):
    """A log written by `convert`, with topics, losses and notes of the original."""

    def __init__(self, path: Path) -> None:
        """Read the description of the converted log.

        Args:
            path: folder of the converted log.

        Raises:
            LogError: the folder was changed, or a part is missing.
        """
        self._about = _read_description_of_folder(path)
        super().__init__(path, f"converted {self._about.log_format}")
        self._losses = LossList()
        self._columns = {
            str(each.summary["topic"]): ConvertedTopicColumns(path, each)
            for each in self._about.topics
        }
        missing = [part for part in self._part_files if not (path / part).is_file()]
        if missing:
            named = join_first_names([f"'{part}'" for part in missing], 1)
            raise LogError(f"{path}: {named} is missing; convert the log again")

    @cached_property
    def _part_files(self) -> list[str]:
        return [part.file for topic in self._about.topics for part in topic.parts]

    @property
    def files(self) -> tuple[Path, ...]:
        """The description and every part."""
        return (self.path / DESCRIPTION, *(self.path / part for part in self._part_files))

    def topics(self) -> pl.DataFrame:
        """Topics of the original log; see `Log.topics`."""
        rows = [dict(topic.summary) for topic in self._about.topics]
        return pl.DataFrame(rows, schema=self.TOPICS_SCHEMA)

    def topic_names(self) -> list[str]:
        """The topics; see `Log.topic_names`."""
        return list(self._columns)

    def units(self, topic: str) -> Mapping[str, str]:
        """Units of the original log, by field."""
        found = self._columns.get(topic)
        return {f.name: f.unit for f in found.topic.fields if f.unit} if found else {}

    def notes(self) -> tuple[str, ...]:
        """Notes of the original log; see `Log.notes`."""
        return self._about.notes

    def leaf_fields(self, topic: str, fields: Sequence[str] | None = None) -> tuple[LeafField, ...]:
        """Describe the columns of fields; see `Log.leaf_fields`."""
        self._refuse_closed_log()
        columns = self._get_readable_topic(topic)
        if fields is None:
            return tuple(columns.leaf_fields_by_name.values())
        try:
            return tuple(columns.leaf_field_of_column(name) for name in dict.fromkeys(fields))
        except ConvertedFieldError as error:
            raise LogError(f"{self.path}: topic '{topic}': {error}") from None

    def _get_readable_topic(self, topic: str) -> ConvertedTopicColumns:
        found = self._columns.get(topic)
        if found is None:
            raise LogError(
                f"{self.path}: no topic '{topic}'; {suggest_choice(topic, self._columns)}"
            )
        fault = found.topic.fault or str(found.topic.summary["problem"] or "")
        if fault:
            raise LogError(f"{self.path}: topic '{topic}' cannot be read: {fault}")
        return found

    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        return {
            topic: pl.concat(self._iter_frames_of_topic(topic, names, start_ns, end_ns))
            for topic, names in fields.items()
        }

    def _iter_frames_of_topic(
        self, topic: str, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> Iterator[pl.DataFrame]:
        columns = self._get_readable_topic(topic)
        try:
            yield from columns.iter_frames_of_time_range(fields, start_ns, end_ns)
        except ConvertedFieldError as error:
            raise LogError(f"{self.path}: topic '{topic}': {error}") from None
        except (pl.exceptions.PolarsError, OSError) as error:
            said = str(error).strip().partition("\n")[0]
            raise LogError(
                f"{self.path}: topic '{topic}' cannot be read ({said}); convert the log again"
            ) from None

    def losses(self) -> tuple[Loss, ...]:
        """Losses of the original log, and faults that reading or a check found."""
        return (*self._about.losses, *self._losses)

    def check(self) -> LogCheck:
        """Read every part, and compare its digest."""
        self._refuse_closed_log()
        messages = message_bytes = 0
        for topic, columns in self._columns.items():
            for part in columns.topic.parts:
                if file_sha256(self.path / part.file) != part.sha256:
                    changed = f"'{part.file}' is not as it was converted: digests differ"
                    self._losses.add_loss(self.path, changed, topic)
            if not columns.topic.parts:
                continue
            try:
                for rows in self._iter_frames_of_topic(
                    topic, list(columns.leaf_fields_by_name), None, None
                ):
                    messages += rows.height
                    message_bytes += int(rows.estimated_size())
            except LogError as error:
                self._losses.add_loss(self.path, str(error).removeprefix(f"{self.path}: "), topic)
        return LogCheck(messages, message_bytes, crcs=0)


def _read_description_of_folder(path: Path) -> ConvertedDescription:
    try:
        about = ConvertedDescription.model_validate_json((path / DESCRIPTION).read_bytes())
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "it"
        raise LogError(
            f"{path / DESCRIPTION}: was changed after payscope wrote it ({where}: {first['msg']}); "
            "convert the log again"
        ) from None
    if about.format != FORMAT:
        raise LogError(
            f"{path}: converted in format {about.format}, this payscope reads {FORMAT}; convert "
            "the log again"
        )
    return about


def _cast_numbers_to_64_bits(values: pl.Expr, dtype: pl.DataType) -> pl.Expr:
    """Cast numbers taken from a list to 64 bits, as `Log.read` returns them."""
    inner = dtype
    while isinstance(inner, pl.List):
        inner = inner.inner
    if inner == pl.Float32:
        return values.cast(pl.Float64)
    return values.cast(pl.Int64) if inner.is_integer() and inner != pl.UInt64 else values


def _can_part_overlap_time_span(
    converted_part: ConvertedPart, start_ns: int | None, end_ns: int | None
) -> bool:
    if converted_part.start_ns is None or converted_part.end_ns is None:
        return False
    return not (
        (start_ns is not None and converted_part.end_ns < start_ns)
        or (end_ns is not None and converted_part.start_ns > end_ns)
    )
