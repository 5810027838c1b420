"""Description of a converted log, stored beside its Parquet files."""

from typing import Any, Final

from pydantic import BaseModel, ConfigDict

from analysis.model.loss import Loss

LOG_TIME: Final = "log_time_ns"
#: Raised whenever what is written changes its meaning.
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
    #: of the lists on the way, from the outside in; None where a length varies
    lengths: tuple[int | None, ...] = ()
    value_names: tuple[tuple[int, str], ...] = ()
    is_stamp: bool = False
    unit: str = ""


class ConvertedPart(_Record):
    """A Parquet file of one topic, in log-time order after the part before."""

    file: str
    rows: int
    size_bytes: int
    sha256: str
    #: log times of its first and last row; None where it has none
    start_ns: int | None
    end_ns: int | None


class ConvertedTopic(_Record):
    """A topic of a converted log: its summary, why it is unreadable, and its folder."""

    #: its row of `Log.topics()`
    summary: dict[str, Any]
    #: why nothing of it could be read; empty where something could
    fault: str = ""
    folder: str = ""
    fields: tuple[ConvertedField, ...] = ()
    parts: tuple[ConvertedPart, ...] = ()


class ConvertedDescription(_Record):
    """A converted log."""

    format: int = FORMAT
    payscope: str
    log: str
    log_format: str
    files: tuple[SourceFile, ...]
    topics: tuple[ConvertedTopic, ...]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]
