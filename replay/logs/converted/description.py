"""Description of a converted log, stored beside its Parquet files."""

from typing import Any, Final

from pydantic import BaseModel, ConfigDict

from analysis.model.loss import Loss

LOG_TIME: Final = "log_time_ns"
#: Version of the description, raised whenever the meaning of its content changes.
FORMAT: Final = 1


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SourceFile(_Record):
    """A file of the original log."""

    name: str
    size_bytes: int
    sha256: str


class ConvertedField(_Record):
    """Metadata of a column in addition to its Parquet type."""

    name: str
    #: lengths of the nested lists, from the outside in; None if a length varies
    lengths: tuple[int | None, ...] = ()
    value_names: tuple[tuple[int, str], ...] = ()
    is_stamp: bool = False
    unit: str = ""


class ConvertedPart(_Record):
    """A Parquet file with rows of one topic, whose log times follow those of the previous part."""

    file: str
    rows: int
    size_bytes: int
    sha256: str
    #: log times of its first and last row in ns; None without rows
    start_ns: int | None
    end_ns: int | None


class ConvertedTopic(_Record):
    """A topic of a converted log: its summary, why it is unreadable, and its folder."""

    #: its row of `Log.topics()`
    summary: dict[str, Any]
    #: why no message of it could be read; empty if at least one was
    fault: str = ""
    folder: str = ""
    fields: tuple[ConvertedField, ...] = ()
    parts: tuple[ConvertedPart, ...] = ()


class ConvertedDescription(_Record):
    """Description of a converted log."""

    format: int = FORMAT
    payscope: str
    log: str
    log_format: str
    files: tuple[SourceFile, ...]
    topics: tuple[ConvertedTopic, ...]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]
