"""A converted log as a log: Parquet by topic, as `payscope convert` writes it."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import polars as pl
from pydantic import ValidationError

from analysis.model.loss import Loss
from estimators.errors import LogError, nearest
from estimators.file_digest import file_sha256
from replay.logs.converted import DESCRIPTION
from replay.logs.converted.converted_topics import ConvertedFieldError, ConvertedTopics
from replay.logs.converted.description import FORMAT, ConvertedDescription
from replay.logs.log import Log, LogCheck
from replay.logs.messages.message_types import LeafField
from replay.logs.storage import LossList


class ConvertedLog(Log):
    """What `convert` wrote: topics, losses and notes are those of the log itself."""

    def __init__(self, path: Path) -> None:
        """Read the description.

        Args:
            path: the folder.

        Raises:
            LogError: it is not as payscope wrote it, or a part is missing.
        """
        self._about = _describe_folder(path)
        super().__init__(path, f"converted {self._about.log_format}")
        self._losses = LossList()
        self._columns = {
            str(each.summary["topic"]): ConvertedTopics(path, each) for each in self._about.topics
        }
        missing = [part for part in self._parts if not (path / part).is_file()]
        if missing:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            raise LogError(f"{path}: '{missing[0]}'{more} is missing; convert the log again")

    @cached_property
    def _parts(self) -> list[str]:
        return [part.file for topic in self._about.topics for part in topic.parts]

    @property
    def files(self) -> tuple[Path, ...]:
        """The description and every part."""
        return (self.path / DESCRIPTION, *(self.path / part for part in self._parts))

    def topics(self) -> pl.DataFrame:
        """The topics of the log that was converted; see `Log.topics`."""
        rows = [dict(topic.summary) for topic in self._about.topics]
        return pl.DataFrame(rows, schema=self.TOPICS_SCHEMA)

    def topic_names(self) -> list[str]:
        """The topics; see `Log.topic_names`."""
        return list(self._columns)

    def units(self, topic: str) -> Mapping[str, str]:
        """The units that the log stated, by field."""
        found = self._columns.get(topic)
        return {f.name: f.unit for f in found.topic.fields if f.unit} if found else {}

    def notes(self) -> tuple[str, ...]:
        """What was recognised of how the log was written."""
        return self._about.notes

    def leaf_fields(self, topic: str, fields: Sequence[str] | None = None) -> tuple[LeafField, ...]:
        """What the columns of fields hold; see `Log.leaf_fields`."""
        self._check_open()
        columns = self._usable(topic)
        if fields is None:
            return tuple(columns.leaves.values())
        try:
            return tuple(columns.leaf(name) for name in dict.fromkeys(fields))
        except ConvertedFieldError as error:
            raise LogError(f"{self.path}: topic '{topic}': {error}") from None

    def _usable(self, topic: str) -> ConvertedTopics:
        found = self._columns.get(topic)
        if found is None:
            raise LogError(f"{self.path}: no topic '{topic}'; {nearest(topic, self._columns)}")
        fault = found.topic.fault or str(found.topic.summary["problem"] or "")
        if fault:
            raise LogError(f"{self.path}: topic '{topic}' cannot be read: {fault}")
        return found

    def _read_many(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        return {
            topic: pl.concat(self._scan(topic, names, start_ns, end_ns))
            for topic, names in fields.items()
        }

    def _scan(
        self, topic: str, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> Iterator[pl.DataFrame]:
        columns = self._usable(topic)
        try:
            yield from columns.read(fields, start_ns, end_ns)
        except ConvertedFieldError as error:
            raise LogError(f"{self.path}: topic '{topic}': {error}") from None
        except (pl.exceptions.PolarsError, OSError) as error:
            said = str(error).strip().partition("\n")[0]
            raise LogError(
                f"{self.path}: topic '{topic}' cannot be read ({said}); convert the log again"
            ) from None

    def losses(self) -> tuple[Loss, ...]:
        """Those of the log that was converted, and what a check found."""
        return (*self._about.losses, *self._losses)

    def check(self) -> LogCheck:
        """Read every part, and compare its digest."""
        self._check_open()
        messages = message_bytes = 0
        for topic, columns in self._columns.items():
            for part in columns.topic.parts:
                if file_sha256(self.path / part.file) != part.sha256:
                    changed = f"'{part.file}' is not as it was converted: digests differ"
                    self._losses.note(self.path, changed, topic)
            if not columns.topic.parts:
                continue
            try:
                for rows in self._scan(topic, list(columns.leaves), None, None):
                    messages += rows.height
                    message_bytes += int(rows.estimated_size())
            except LogError as error:
                self._losses.note(self.path, str(error).removeprefix(f"{self.path}: "), topic)
        return LogCheck(messages, message_bytes, crcs=0)


def _describe_folder(path: Path) -> ConvertedDescription:
    try:
        about = ConvertedDescription.model_validate_json((path / DESCRIPTION).read_bytes())
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "it"
        raise LogError(
            f"{path / DESCRIPTION}: is not as payscope wrote it ({where}: {first['msg']}); convert "
            "the log again"
        ) from None
    if about.format != FORMAT:
        raise LogError(
            f"{path}: converted in format {about.format}, this payscope reads {FORMAT}; convert "
            "the log again"
        )
    return about
