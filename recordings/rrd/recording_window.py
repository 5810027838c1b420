"""Read the part of a recording in a time range, undecimated."""

import math
from pathlib import Path

import polars as pl

from analysis.model.physical_units import NS
from analysis.model.run_record import Run
from estimators.errors import RecordingError
from recordings.rrd.reader import add_losses_of_missing_frame_rows, open_recording, read_recording
from recordings.rrd.recording_limits import LIMITS


def read_run_of_time_range(
    path: str | Path, from_s: float | None, to_s: float | None, *, are_raw_frames_read: bool = True
) -> Run:
    """Read the rows of a time range, and whole frames without times.

    Manoeuvres, loads and cycles are included if they overlap the range.

    Args:
        path: the recording.
        from_s: first time, in seconds since the start; None for the start.
        to_s: last time, in seconds since the start; None for the end.
        are_raw_frames_read: whether to read the channels of the log as well.

    Raises:
        RecordingError: as from `read_recording`; also if the range is invalid or empty, or the
            recording has no frames.
    """
    whole_run = from_s is None and to_s is None
    if whole_run and are_raw_frames_read:
        return read_recording(path)
    refuse_invalid_time_range(path, from_s, to_s)
    stretch = _describe_ends_of_range(from_s, to_s)
    start, end = (
        None if each is None else round(min(max(each, -LIMITS.latest_s), LIMITS.latest_s) * NS)
        for each in (from_s, to_s)
    )
    frames: dict[str, pl.DataFrame] = {}
    heights: dict[str, int] = {}
    with open_recording(path) as held:
        held.refuse_recording_without_frames()
        for stored in held.manifest.frames:
            if not are_raw_frames_read and stored.name.startswith("raw/"):
                heights[stored.name] = stored.rows
                continue
            whole = held.read_frame(stored.name)
            heights[stored.name] = whole.height
            frames[stored.name] = _select_rows_of_time_range(
                whole, start, end, held.provenance.t0_unix_ns
            )
            if stored.name == "aligned" and frames["aligned"].is_empty() and not whole_run:
                raise RecordingError(
                    f"{path}: has no data {stretch}; it has {_describe_span_of_grid(whole)}"
                )
    about = add_losses_of_missing_frame_rows(path, held.manifest, held.provenance, heights)
    if whole_run:
        return Run(frames, about)
    note = f"a stretch of {Path(path).name}, {stretch}"
    return Run(frames, about.model_copy(update={"notes": (*about.notes, note)}))


def refuse_invalid_time_range(path: str | Path, from_s: float | None, to_s: float | None) -> None:
    """Raise an error for an invalid time range.

    Args:
        path: recording, for the error message.
        from_s: begin in seconds since the start; None for the begin.
        to_s: end in seconds since the start; None for the end.

    Raises:
        RecordingError: an end is not a number, or the first is after the last.
    """
    ends = [-math.inf if from_s is None else from_s, math.inf if to_s is None else to_s]
    if not all(map(math.isfinite, filter(None, (from_s, to_s)))) or ends[0] > ends[1]:
        raise RecordingError(
            f"{path}: {_describe_ends_of_range(from_s, to_s)} is not a time span; use seconds "
            "since the "
            "start, "
            "the earlier first"
        )


def _describe_span_of_grid(aligned_frame: pl.DataFrame) -> str:
    if aligned_frame.is_empty():
        return "no samples"
    first, last = (round(float(aligned_frame["t_ns"][place]) / NS, 1) for place in (0, -1))
    return f"{first:g} to {last:g} s"


def _select_rows_of_time_range(
    frame: pl.DataFrame, start: int | None, end: int | None, t0_ns: int
) -> pl.DataFrame:
    has = frame.columns
    # fields of a log may have any name
    if "log_time_ns" in has:
        first, last, shift = "log_time_ns", "log_time_ns", t0_ns
    elif "start_t_ns" in has:
        first, last, shift = "start_t_ns", "end_t_ns", 0
    elif "t_ns" in has:
        first, last, shift = "t_ns", "t_ns", 0
    else:
        return frame
    wanted = [pl.lit(value=True)]
    # a row without times is about the whole run
    if start is not None:
        wanted.append((pl.col(last) >= start + shift).fill_null(value=True))
    if end is not None:
        wanted.append((pl.col(first) <= end + shift).fill_null(value=True))
    return frame.filter(pl.all_horizontal(wanted))


def _describe_ends_of_range(from_s: float | None, to_s: float | None) -> str:
    start = "the start" if from_s is None else f"{from_s:g} s"
    return f"from {start} to {'the end' if to_s is None else f'{to_s:g} s'}"
