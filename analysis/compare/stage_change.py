"""Comparison of a stage of two replays: corresponding rows, and columns that differ.

Rows correspond if their keys are equal: the time of a sample or window, the start of a manoeuvre,
the method of a mass. Frames are read a few columns at a time, so that the memory is bounded.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import polars as pl

from analysis.model.run_record import Provenance

#: Key columns of each frame; `t_ns` and similar times count from another start in each replay.
_KEYS: Final = {
    "aligned": ("t_ns",),
    "excitation": ("t_ns",),
    "gate": ("t_ns",),
    "estimates": ("t_ns", "axis"),
    "segments": ("start_t_ns",),
    "planar": ("kind", "start_t_ns"),
    "masses": ("method",),
    "loads": ("load_id",),
    "manoeuvres": ("start_t_ns",),
    "nuisances": ("term",),
    "responses": ("of", "number", "term"),
    "learnt_errors": ("term", "other"),
    "budget": ("load_id", "cause"),
    "verdict": ("check",),
    "calibration": ("method", "load_kg"),
}
_TIMES: Final = ("t_ns", "start_t_ns", "end_t_ns")
#: Number of values of a recording that are in memory at a time.
_VALUES: Final = 1 << 24


class Replay(Protocol):
    """A replay to compare: a run, or a recording read on demand."""

    @property
    def provenance(self) -> Provenance:
        """Provenance of its frames."""
        ...

    @property
    def stages(self) -> Mapping[str, Sequence[str]]:
        """Columns of each frame, in order."""
        ...

    def read(self, stage: str, columns: Sequence[str]) -> pl.DataFrame:
        """Read some columns of a frame."""
        ...


@dataclass(frozen=True, slots=True)
class ColumnChange:
    """A column that differs, in the rows that both replays have."""

    name: str
    rows: int
    """Rows that differ."""
    only_a: int
    """Rows among them with a value in A alone."""
    only_b: int
    largest: float | None
    """Largest difference of numbers, B less A."""
    largest_relative: float | None
    """Change divided by the larger of both values."""
    at_s: float | None
    """Time of the largest difference, in seconds from the start of A."""
    fault: str = ""
    """Why the column cannot be compared: it is in one replay alone, or has another dtype."""


@dataclass(frozen=True, slots=True)
class StageChange:
    """A stage of both replays that differs."""

    name: str
    rows_a: int
    rows_b: int
    common: int
    """Rows that both have."""
    columns: tuple[ColumnChange, ...]
    order: bool = False
    """Whether the order of its columns differs."""


def find_frame_of_stage(stage: str) -> str:
    """Name of the frame that declares the columns of a stage: `estimates` for `estimates/ls`."""
    return stage.partition("/")[0]


def compare_frames_of_stage(
    a: Replay, b: Replay, stage: str, relative_tolerance: float, offset_ns: int
) -> StageChange | None:
    """Compare a stage that both replays have.

    Args:
        a: baseline replay.
        b: replay to compare with it.
        stage: name of the stage.
        relative_tolerance: relative tolerance of numbers; 0 compares bit for bit.
        offset_ns: shift of B's times to A's.

    Returns:
        The differences; None without any.
    """
    has = a.stages[stage], b.stages[stage]
    key = [
        column
        for column in _KEYS.get(find_frame_of_stage(stage), ())
        if all(column in c for c in has)
    ]
    ids = [read_shifted_row_keys(a, stage, key, 0), read_shifted_row_keys(b, stage, key, offset_ns)]
    pairs = None if ids[0].equals(ids[1]) else match_rows_by_key(ids[0], ids[1], key)
    height = ids[0].height
    faults = [
        ColumnChange(column, 0, 0, 0, None, None, None, f"only in {'AB'[which]}")
        for which in (0, 1)
        for column in has[which]
        if column not in has[1 - which]
    ]
    seconds = compute_times_of_matched_rows_s(ids[0], pairs)
    changes: list[ColumnChange] = []
    for part in iter_column_batches([column for column in has[0] if column in has[1]], height):
        mine, theirs = a.read(stage, part), b.read(stage, part)
        for column in part:
            x, y = mine[column], theirs[column]
            if offset_ns and column in _TIMES:
                y = y + offset_ns
            if pairs is not None:
                x, y = x.gather(pairs["row_a"]), y.gather(pairs["row_b"])
            changes += compare_values_of_column(x, y, relative_tolerance, seconds)
    common = height if pairs is None else pairs.height
    order = list(has[0]) != list(has[1]) and not faults
    if not (faults or changes or order or common != height or ids[1].height != common):
        return None
    return StageChange(stage, height, ids[1].height, common, (*faults, *changes), order)


def read_shifted_row_keys(
    replay: Replay, frame_name: str, key_columns: Sequence[str], offset_ns: int
) -> pl.DataFrame:
    """Key of each row in A's time; the row number if the frame has no key."""
    columns = (
        list(key_columns) or [replay.stages[frame_name][0]] if replay.stages[frame_name] else []
    )
    frame = replay.read(frame_name, columns) if columns else pl.DataFrame()
    if not key_columns:
        return frame.select(pl.int_range(pl.len()).alias("row"))
    return frame.with_columns(
        pl.col(column) + offset_ns for column in key_columns if offset_ns and column in _TIMES
    ).with_columns(pl.col(pl.Enum).cast(pl.String))


def match_rows_by_key(a: pl.DataFrame, b: pl.DataFrame, key_columns: Sequence[str]) -> pl.DataFrame:
    """Pairs of rows of A and B with equal keys, as `row_a` and `row_b`."""
    on = list(key_columns) or ["row"]
    nth = pl.int_range(pl.len()).over(on).alias("_nth")  # of several rows with one key
    left = a.with_row_index("row_a").with_columns(nth)
    right = b.with_row_index("row_b").with_columns(nth)
    found = left.join(right, on=[*on, "_nth"], how="inner", nulls_equal=True)
    return found.select("row_a", "row_b").sort("row_a")


def compute_times_of_matched_rows_s(
    row_keys: pl.DataFrame, matched_rows: pl.DataFrame | None
) -> pl.Series | None:
    """Time in s of each common row; None without times."""
    column = next((name for name in _TIMES if name in row_keys.columns), None)
    if column is None:
        return None
    times = row_keys[column] / 1e9
    return times if matched_rows is None else times.gather(matched_rows["row_a"])


def iter_column_batches(columns: Sequence[str], height: int) -> Iterator[Sequence[str]]:
    """Yield the columns in batches that are read together."""
    size = max(1, _VALUES // max(height, 1))
    for start in range(0, len(columns), size):
        yield columns[start : start + size]


def compare_values_of_column(
    values_a: pl.Series,
    values_b: pl.Series,
    relative_tolerance: float,
    row_times_s: pl.Series | None,
) -> Iterator[ColumnChange]:
    """Yield the change of a column, if there is one."""
    if values_a.dtype != values_b.dtype:
        fault = f"{values_a.dtype} in A, {values_b.dtype} in B"
        yield ColumnChange(values_a.name, 0, 0, 0, None, None, None, fault)
        return
    differs = normalise_zero_and_nan_bits(values_a).ne_missing(
        normalise_zero_and_nan_bits(values_b)
    )
    if not differs.any():
        return
    size = change = pl.Series(dtype=pl.Float64)
    if values_a.dtype.is_numeric():
        both = pl.DataFrame(
            {"x": values_a.cast(pl.Float64), "y": values_b.cast(pl.Float64)}
        ).fill_nan(None)
        change = both["y"] - both["x"]
        size = change.abs() / both.select(pl.max_horizontal(pl.all().abs())).to_series()
        if values_a.dtype.is_float() and relative_tolerance:
            differs &= ~((size <= relative_tolerance) | (change == 0.0)).fill_null(value=False)
            if not differs.any():
                return
        change = pl.select(pl.when(differs).then(change)).to_series()
    where = change.abs().arg_max() if change.len() else None
    relative = size.filter(differs).fill_nan(None).max() if size.len() else None
    first = differs.arg_true()[0] if where is None else where
    yield ColumnChange(
        name=values_a.name,
        rows=int(differs.sum()),
        only_a=int((differs & values_a.is_not_null() & values_b.is_null()).sum()),
        only_b=int((differs & values_a.is_null() & values_b.is_not_null()).sum()),
        largest=None if where is None else float(change[where]),
        largest_relative=None if relative is None else float(relative),  # pyright: ignore
        at_s=None if row_times_s is None else float(row_times_s[first]),
    )


def normalise_zero_and_nan_bits(series: pl.Series) -> pl.Series:
    """Column of the values' bits, for comparison: 0.0 differs from -0.0, and all NaN are equal."""
    if isinstance(series.dtype, pl.Enum):
        return series.cast(pl.String)
    if not series.dtype.is_float():
        return series
    numbers = series.fill_null(0.0).to_numpy()
    bits = pl.Series(series.name, numbers.view(f"i{numbers.itemsize}"))
    return pl.select(pl.when(series.is_not_null()).then(bits)).to_series()
