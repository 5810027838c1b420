"""A stretch of a recording: what a long one shows decimated is drawn whole in it."""

from pathlib import Path
from typing import Final

import polars as pl

from analysis.run import Run
from estimators.errors import RecordingError
from recordings.reader import opened, read_recording

_NS: Final = 1_000_000_000


def read_window(path: str | Path, from_s: float | None, to_s: float | None) -> Run:
    """Read the rows of a recording that lie in a stretch of time, and frames that have none whole.

    Of manoeuvres, loads and cycles those that reach into it.

    Args:
        path: the recording.
        from_s: seconds since the start; None from the beginning.
        to_s: likewise; None to the end.

    Raises:
        RecordingError: as `read_recording`; and nothing of the recording lies there.
    """
    if from_s is None and to_s is None:
        return read_recording(path)
    with opened(path) as held:
        t0_ns = held.provenance.t0_unix_ns
        begin = None if from_s is None else round(from_s * _NS)
        end = None if to_s is None else round(to_s * _NS)
        names = [frame.name for frame in held.manifest.frames]
        frames = {name: _inside(held.read(name), begin, end, t0_ns) for name in names}
        span = held.read("aligned", ["t_ns"])["t_ns"] if "aligned" in names else pl.Series([0])
    about = held.provenance
    if "aligned" in frames and frames["aligned"].is_empty():
        first, last = (round(float(each) / _NS, 1) for each in (span[0], span[-1]))
        raise RecordingError(
            f"{path}: nothing from {_text(from_s, first)} to {_text(to_s, last)} s; it has "
            f"{first:g} to {last:g} s"
        )
    stretch = f"from {_text(from_s, 'the start')} to {_text(to_s, 'the end')} s"
    note = f"a stretch of {Path(path).name}, {stretch}"
    return Run(frames, about.model_copy(update={"notes": (*about.notes, note)}))


def _inside(frame: pl.DataFrame, begin: int | None, end: int | None, t0_ns: int) -> pl.DataFrame:
    has = frame.columns
    if "start_t_ns" in has:
        first, last, shift = "start_t_ns", "end_t_ns", 0
    elif "t_ns" in has:
        first, last, shift = "t_ns", "t_ns", 0
    elif "log_time_ns" in has:
        first, last, shift = "log_time_ns", "log_time_ns", t0_ns
    else:
        return frame
    wanted = [pl.lit(value=True)]
    if begin is not None:
        wanted.append(pl.col(last) >= begin + shift)
    if end is not None:
        wanted.append(pl.col(first) <= end + shift)
    return frame.filter(pl.all_horizontal(wanted))


def _text(seconds: float | None, otherwise: object) -> str:
    return f"{otherwise}" if seconds is None else f"{seconds:g}"
