"""Record a followed log second by second; each second is on disk before it is reported.

A second is appended in one write whose last chunk is the excitation: if that is present, the second
is complete. A recording that was cut off is continued after its last complete second.
"""

import math
import mmap
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import polars as pl

from analysis.model.methods import METHODS, FeedKind
from analysis.model.run_record import Provenance, Run
from analysis.model.settings import Settings
from analysis.online.follower import FollowedRow
from analysis.online.online_limits import LIMITS as ONLINE_LIMITS
from estimators.errors import RecordingError
from recordings.follow.growing_file import (
    HEAD_BYTES,
    append_recording_messages,
    iter_complete_messages,
)
from recordings.report.atomic_output import AppendOnlyFile
from recordings.rrd.blueprint import (
    Page,
    lay_out_pages_as_tabs,
    make_panels_of_tab,
    make_text_entity_path,
)
from recordings.rrd.display_frames import LANES, ROOT, make_display_frames
from recordings.rrd.drawn_rows import iter_record_batches_to_draw
from recordings.rrd.recording_table import TABS
from recordings.rrd.stored_names import SINCE_START, STATE, TIME
from recordings.rrd.writer import APPLICATION

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint
    from rerun.chunk import Chunk

#: Property that identifies the followed log.
PROPERTY: Final = "followed"
#: Periods of the grid without an estimate after which the line of a method is interrupted.
_BREAK_PERIODS: Final = 1.5
#: Columns that are written row by row; squares are variances.
EXCITATION: Final = ("force_x_N", "regressor_acc_x_m_s2", "speed_x_m_s", "speed_rate_x_m_s2")
GATE: Final = ("mi_x_nat", "corr_x_1", "noise_share_x_1", "predicted_std_x")
ESTIMATES: Final = (
    "mass_kg",
    "friction_x_N_s_m",
    "mass_std_kg_squared",
    "friction_x_std_N_s_m_squared",
)
#: Lanes of states: the gate's reason and the phase of motion.
STATES: Final = (f"{LANES}/gate", f"{LANES}/phase")
#: Name of the text beside the first page, which changes with every report.
ANSWER: Final = "answer"
#: Tabs that are useful while a log grows.
_TABS: Final = ("Overview", "Motion", "Gate", "Estimates")
#: Number of rows of placeholder frames, and their spacing: a line needs adjacent rows, a manoeuvre
#: is a single one.
_ROWS: Final = 3
_APART_NS: Final = 10**9
#: Number of first messages among which the description and the messages about the stores are.
_FIRST: Final = 16
#: Most messages of a second, counted back from the last: a chunk per frame and method, twice.
_SECOND: Final = 64
_LAST_OF_PART: Final = "/display/excitation"


@dataclass(frozen=True, slots=True)
class FollowedLog:
    """The log, machine file and noise that a growing recording belongs to.

    Attributes:
        identity: digest of log, machine file and noise; a recording with the same identity is
            continued.
        t0_unix_ns: Unix time of the first row.
        recording_id: id shared by all parts, so that viewers show one recording.
    """

    identity: str
    t0_unix_ns: int
    recording_id: str


@dataclass(slots=True)
class _RowsToSend:
    """Rows not sent yet, by frame: `t_ns` and numbers."""

    excitation: list[dict[str, Any]] = field(default_factory=list)
    gate: list[dict[str, Any]] = field(default_factory=list)
    estimates: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    states: dict[str, list[dict[str, Any]]] = field(default_factory=dict)


class GrowingRecording:
    """Recording of a followed log, in a file and in connected viewers."""

    def __init__(
        self,
        followed_log: FollowedLog,
        settings: Settings,
        name: str,
        *,
        file: AppendOnlyFile | None = None,
        server: str | None = None,
    ) -> None:
        """Begin a recording, or continue it at the end of a file.

        Args:
            followed_log: the followed log.
            settings: settings of the replay, with the grid rate.
            name: name shown in viewers.
            file: output file; None for none.
            server: address of a server for viewers; None for none.
        """
        import rerun as rr

        self._followed_log, self._file = followed_log, file
        self._period_ns = 1e9 / settings.align.rate_hz
        self._new = _RowsToSend()
        self._state: dict[str, str | None] = {}
        #: last `t_ns` of each method
        self._last: dict[str, int] = {}
        self._thresholds, layout = make_thresholds_and_blueprint(settings)
        self._streams: list[RecordingStream] = []
        starts: list[RecordingStream] = []
        if file is not None:
            stream = rr.RecordingStream(APPLICATION, recording_id=followed_log.recording_id)
            self._bytes = stream.binary_stream()
            self._streams.append(stream)
            starts += [stream] if file.size == 0 else []
        if server is not None:
            stream = rr.RecordingStream(APPLICATION, recording_id=followed_log.recording_id)
            stream.set_sinks(rr.GrpcSink(server))
            self._streams.append(stream)
            starts.append(stream)
        for stream in starts:
            described: dict[str, Any] = {
                "identity": followed_log.identity,
                "t0_unix_ns": followed_log.t0_unix_ns,
                "recording_id": followed_log.recording_id,
            }
            stream.send_property(PROPERTY, rr.AnyValues(**described))
            stream.flush()  # before the layout, where `read_end_of_recording` looks for it
            stream.send_blueprint(layout, make_active=True, make_default=True)
            stream.send_recording_name(name)
            stream.send_recording_start_time_nanos(followed_log.t0_unix_ns)
        self._append_new_rows_to_file()

    def add_rows_to_write(self, online_rows: Sequence[FollowedRow]) -> None:
        """Add the next rows, which `write_added_rows` writes."""
        for row in online_rows:
            if row.gate is not None:
                self._add_followed_row(row)
            for method, (t_ns, estimate) in row.estimates.items():
                found = self._new.estimates.setdefault(method, [])
                last = self._last.get(method)
                if last is not None and t_ns - last > _BREAK_PERIODS * self._period_ns:
                    found.append({"t_ns": last + 1})
                numbers = (*estimate.theta[:2], *estimate.std[:2] ** 2)
                if not estimate.std[0] <= ONLINE_LIMITS.certain_mass_u_1 * abs(estimate.theta[0]):
                    # an estimate that is wrong by tonnes would leave no room for the others
                    numbers = (math.nan,) * len(ESTIMATES)
                named = zip(ESTIMATES, map(float, numbers), strict=True)
                found.append({"t_ns": t_ns, **dict(named)})
                self._last[method] = t_ns

    def _add_followed_row(self, row: FollowedRow) -> None:
        assert row.gate is not None
        new, t_ns = self._new, row.t_ns
        new.excitation.append({"t_ns": t_ns, **{name: row.excitation[name] for name in EXCITATION}})
        numbers = row.gate.make_gate_columns()
        new.gate.append({"t_ns": t_ns, **{name: numbers[name] for name in GATE}})
        for lane, state in zip(STATES, (row.gate.reason, row.phase), strict=True):
            if lane not in self._state or self._state[lane] != state:
                new.states.setdefault(lane, []).append({"t_ns": t_ns, STATE: state})
                self._state[lane] = state

    def write_added_rows(self, answer_markdown: str) -> None:
        """Write the added rows, and the current answer in Markdown.

        Raises:
            OSError: they do not fit on the disk; the file ends with what was written before.
        """
        new, self._new = self._new, _RowsToSend()
        if not new.excitation:
            return
        for stream in self._streams:
            self._send_rows(stream, new, answer_markdown)
        self._append_new_rows_to_file()

    def stop_writing_file(self) -> None:
        """Stop writing to the file; viewers continue."""
        if self._file is not None:
            self._file.close()
            self._file = None
            self._streams.pop(0)

    def _append_new_rows_to_file(self) -> None:
        if self._file is not None and (part := self._bytes.read(flush=True)):
            append_recording_messages(self._file, part)

    def _send_rows(
        self, recording_stream: "RecordingStream", new_rows: _RowsToSend, answer_markdown: str
    ) -> None:
        """Send new rows, thresholds and the current answer to a stream."""
        import numpy as np
        import rerun as rr

        t_ns = new_rows.excitation[-1]["t_ns"]
        frames: dict[str, pl.DataFrame] = {
            lane: pl.DataFrame(rows, {"t_ns": pl.Int64, STATE: pl.String})
            for lane, rows in new_rows.states.items()
        }
        for name, level in self._thresholds.items():
            frames[name] = pl.DataFrame({"t_ns": [t_ns], "threshold": [level]})
        for method, rows in new_rows.estimates.items():
            frames[f"display/estimates/{method}"] = _make_numeric_frame(rows, ESTIMATES)
        frames["display/gate"] = _make_numeric_frame(new_rows.gate, GATE)
        now = np.array([t_ns])
        recording_stream.send_columns(
            make_text_entity_path(ANSWER),
            indexes=[
                rr.TimeColumn(TIME, timestamp=(now + self._followed_log.t0_unix_ns).view("M8[ns]")),
                rr.TimeColumn(SINCE_START, duration=now.view("m8[ns]")),
            ],
            columns=rr.TextDocument.columns(
                text=[answer_markdown], media_type=[rr.MediaType.MARKDOWN]
            ),
        )
        # the excitation last, which marks the second as complete
        frames["display/excitation"] = _make_numeric_frame(new_rows.excitation, EXCITATION)
        for name, frame in frames.items():
            for batch in iter_record_batches_to_draw(name, frame, self._followed_log.t0_unix_ns):
                recording_stream.send_record_batch(batch, index=[TIME, SINCE_START])

    def close_complete_file(self) -> None:
        """Close the file with all rows written; viewers keep their data."""
        for stream in self._streams:
            stream.disconnect()
        if self._file is not None:
            self._file.close()


def _make_numeric_frame(
    online_rows: Sequence[Mapping[str, Any]], columns: Sequence[str]
) -> pl.DataFrame:
    return pl.DataFrame(online_rows, {"t_ns": pl.Int64, **dict.fromkeys(columns, pl.Float64)})


class GrowingLayout(NamedTuple):
    """Values of the drawn thresholds by frame, and the blueprint of the views."""

    threshold_by_frame: dict[str, float]
    blueprint: "Blueprint"


def make_thresholds_and_blueprint(settings: Settings) -> GrowingLayout:
    """Make the layout of the views for rows to come.

    Args:
        settings: settings with methods and thresholds.

    Returns:
        Values of thresholds by the frame that draws them, and the blueprint.
    """
    run = make_placeholder_run(settings)
    shown = make_display_frames(run)
    pages = [
        Page(
            tab.name, make_panels_of_tab(tab, run, shown), (ANSWER,) if ANSWER in tab.texts else ()
        )
        for tab in TABS
        if tab.name in _TABS
    ]
    levels = {
        name: float(frame["threshold"][0])
        for name, frame in shown.items()
        if name.startswith(f"{ROOT}/threshold/")
    }
    return GrowingLayout(levels, lay_out_pages_as_tabs(pages, None, is_growing=True))


def make_placeholder_run(settings: Settings) -> Run:
    """Make a run of a few rows of NaN, which determines the columns of the views."""
    period_ns = round(1e9 / settings.align.rate_hz)
    frames = {
        "excitation": _make_rows_of_nan(EXCITATION, period_ns).with_columns(
            phase=pl.lit("standstill")
        ),
        "gate": _make_rows_of_nan(GATE, period_ns).with_columns(reason_x=pl.lit("accepted")),
    }
    for name in settings.trace.methods:
        alone = METHODS[name].feed is FeedKind.SEGMENTS
        columns = [each.removesuffix("_squared") for each in ESTIMATES]
        frames[f"estimates/{name}"] = _make_rows_of_nan(columns, _APART_NS if alone else period_ns)
    return Run(frames, Provenance(settings=settings))


def _make_rows_of_nan(columns: "tuple[str, ...] | list[str]", row_period_ns: int) -> pl.DataFrame:
    times = {"t_ns": [row * row_period_ns for row in range(_ROWS)]}
    return pl.DataFrame({**times, **{name: [float("nan")] * _ROWS for name in columns}})


@dataclass(frozen=True, slots=True)
class RecordingEnd:
    """End of a growing recording.

    Attributes:
        about: log that it belongs to.
        until_ns: `t_ns` of its last row.
        size: size in bytes up to that row.
    """

    about: FollowedLog
    until_ns: int
    size: int


def read_end_of_recording(path: Path) -> RecordingEnd | None:
    """Read the end of a recording; None if it has no rows yet.

    Raises:
        RecordingError: it was not written by `follow`.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        messages = list(iter_complete_messages(data))
        if not messages:
            return None
        head = data[: messages[:_FIRST][-1].end]
        found: dict[str, Any] = {}
        for chunk in _iter_chunks_of_messages(head):
            if chunk.entity_path == f"/__properties/{PROPERTY}":
                batch = chunk.to_record_batch()
                found |= {name: batch.column(name)[0].as_py()[0] for name in batch.schema.names[1:]}
        if not found:
            raise RecordingError(
                f"{path}: is unfinished, and not a recording of `payscope follow`; give another "
                "output, or --force to replace it"
            )
        followed_log = FollowedLog(
            found["identity"], int(found["t0_unix_ns"]), found["recording_id"]
        )
        parts = [data[start:end] for start, end, of_store in messages[:_FIRST] if of_store]
        store = b"".join([data[:HEAD_BYTES], *parts])
        for start, end, _ in reversed(messages[-_SECOND:]):
            for chunk in _iter_chunks_of_messages(store + data[start:end]):
                if chunk.entity_path == _LAST_OF_PART:
                    times = chunk.to_record_batch().column(SINCE_START)
                    return RecordingEnd(followed_log, max(t.value for t in times), end)
    return None


def _iter_chunks_of_messages(recording_bytes: bytes) -> "Iterator[Chunk]":
    """Yield the chunks in a recording of complete messages."""
    import rerun as rr
    from rerun.error_utils import RerunWarning

    with tempfile.NamedTemporaryFile(suffix=".rrd") as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)  # about the missing end
        part.write(recording_bytes)
        part.flush()
        yield from rr.chunk.RrdReader(part.name).stream()
