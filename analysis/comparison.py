"""Two replays side by side: settings, columns and estimates that differ.

Rows correspond by what they are about: the time of a sample or window, the start of a manoeuvre,
the method of a mass. Frames are read a few columns at a time, so that two recordings of a shift
fit in the memory that one column of each takes.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Protocol

import polars as pl

from analysis.run import Provenance, Run

#: What a row of a frame is about; `t_ns` and its like count from another start in each replay.
_KEYS: Final = {
    "aligned": ("t_ns",),
    "excitation": ("t_ns",),
    "gate": ("t_ns",),
    "estimates": ("t_ns", "axis"),
    "segments": ("start_t_ns",),
    "planar": ("kind", "start_t_ns"),
    "masses": ("method",),
    "verdict": ("check",),
    "calibration": ("method", "load_kg"),
}
_TIMES: Final = ("t_ns", "start_t_ns", "end_t_ns")
#: Values of a recording that are held in memory together.
_VALUES: Final = 1 << 24
#: Estimates and their standard deviations, by the frame that holds them.
_ESTIMATES: Final = {
    "mass_kg": "mass_std_kg",
    "friction_x_N_s_m": "friction_x_std_N_s_m",
    "coulomb_x_N": "coulomb_x_std_N",
    "inertia_z_kg_m2": "inertia_z_std_kg_m2",
}


class Replay(Protocol):
    """What is compared: a run, or a recording that is read when it is needed."""

    @property
    def provenance(self) -> Provenance:
        """Where its frames came from."""
        ...

    @property
    def stages(self) -> Mapping[str, Sequence[str]]:
        """The columns of each frame, in order."""
        ...

    def read(self, stage: str, columns: Sequence[str]) -> pl.DataFrame:
        """Some columns of a frame."""
        ...


@dataclass(frozen=True, slots=True)
class InMemory:
    """A run as a replay to compare."""

    run: Run

    @property
    def provenance(self) -> Provenance:
        """Where its frames came from."""
        return self.run.provenance

    @property
    def stages(self) -> Mapping[str, Sequence[str]]:
        """The columns of each frame, in order."""
        return {name: frame.columns for name, frame in self.run.frames.items()}

    def read(self, stage: str, columns: Sequence[str]) -> pl.DataFrame:
        """Some columns of a frame."""
        return self.run.frames[stage].select(columns)


@dataclass(frozen=True, slots=True)
class Changed:
    """A value by its name that one replay has otherwise than the other; None where it has none."""

    name: str
    a: Any
    b: Any


@dataclass(frozen=True, slots=True)
class ColumnChange:
    """A column that differs, over the rows that both replays have."""

    name: str
    rows: int
    """Rows that differ."""
    only_a: int
    """Rows among them with a value in A alone."""
    only_b: int
    largest: float | None
    """Largest difference of numbers, B less A."""
    largest_relative: float | None
    """The same over the larger of both values."""
    at_s: float | None
    """Seconds from the start of A where it is."""
    fault: str = ""
    """Why the column cannot be compared: it is in one replay alone, or has another dtype."""


@dataclass(frozen=True, slots=True)
class StageChange:
    """A stage that both replays have and that differs."""

    name: str
    rows_a: int
    rows_b: int
    common: int
    """Rows that both have."""
    columns: tuple[ColumnChange, ...]
    order: bool = False
    """Whether its columns come in another order."""


@dataclass(frozen=True, slots=True)
class EstimateChange:
    """An estimate of the whole log or of a manoeuvre that differs."""

    about: str
    """The method, or the seconds from and to of the manoeuvre."""
    quantity: str
    a: float | None
    a_std: float | None
    b: float | None
    b_std: float | None

    @property
    def change(self) -> float | None:
        """B less A, None where one of them has no estimate."""
        return None if self.a is None or self.b is None else self.b - self.a

    @property
    def stds(self) -> float | None:
        """The change in standard deviations, of the larger of both."""
        std = max(self.a_std or 0.0, self.b_std or 0.0)
        return None if self.change is None or not std else self.change / std


@dataclass(frozen=True, slots=True)
class Comparison:
    """What differs between replays A and B; everything else is equal."""

    settings: tuple[Changed, ...]
    """Settings and keys of the machine file."""
    inputs: tuple[Changed, ...]
    """Files by name, with their digests."""
    versions: tuple[Changed, ...]
    told: tuple[Changed, ...]
    """Stamps, losses and notes."""
    only_a: tuple[str, ...]
    """Stages that only A has."""
    only_b: tuple[str, ...]
    stages: tuple[StageChange, ...]
    columns: int
    """Columns that were compared."""
    estimates: tuple[EstimateChange, ...]
    """Estimates of the whole log, those that moved most first."""
    manoeuvres: tuple[EstimateChange, ...]
    """Estimates of manoeuvres, likewise."""
    checks: tuple[Changed, ...]
    """Checks of the verdict whose outcome differs."""

    @property
    def equal(self) -> bool:
        """Whether nothing differs but names of files and versions."""
        return not (
            self.settings or self.told or self.only_a or self.only_b or self.stages
        ) and not any(change.name == "contents" for change in self.inputs)

    def to_dict(self) -> dict[str, Any]:
        """The same as plain values, with the changes of estimates."""
        plain = asdict(self)
        for name in ("estimates", "manoeuvres"):
            changes: tuple[EstimateChange, ...] = getattr(self, name)
            plain[name] = [
                {**asdict(each), "change": each.change, "change_in_stds": each.stds}
                for each in changes
            ]
        return {"equal": self.equal, **plain}


def same_inputs(a: Provenance, b: Provenance) -> bool:
    """Whether two replays read the same bytes, whatever the files are called."""
    digests = [sorted(each.sha256 for each in about.inputs) for about in (a, b)]
    return digests[0] == digests[1]


def compare(a: Replay, b: Replay, *, rtol: float = 0.0, rows: bool = True) -> Comparison:
    """Compare two replays.

    Args:
        a: the one that changes are counted from.
        b: the other.
        rtol: numbers differ by so much of the larger of both before they count as different;
            0 compares bit for bit.
        rows: whether the rows of stages correspond; where the logs are others, only what is said
            of the whole log does.
    """
    mine, theirs = a.provenance, b.provenance
    common = [name for name in a.stages if name in b.stages]
    compared = [name for name in common if rows or _family(name) in ("masses", "verdict")]
    offset_ns = theirs.t0_unix_ns - mine.t0_unix_ns if rows else 0
    changes = [_stage(a, b, name, rtol, offset_ns) for name in compared]
    return Comparison(
        settings=tuple(_settings(mine, theirs)),
        inputs=tuple(_inputs(mine, theirs)),
        versions=tuple(_values(mine.versions, theirs.versions)),
        told=tuple(_told(mine, theirs)) if rows else (),
        only_a=tuple(name for name in a.stages if name not in b.stages),
        only_b=tuple(name for name in b.stages if name not in a.stages),
        stages=tuple(change for change in changes if change is not None),
        columns=sum(len(a.stages[name]) for name in compared),
        estimates=_estimates(a, b, rtol),
        manoeuvres=_manoeuvres(a, b, rtol, offset_ns) if rows else (),
        checks=tuple(_checks(a, b)),
    )


def _family(stage: str) -> str:
    return stage.partition("/")[0]


def _flat(section: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in section.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _values(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[Changed]:
    for name in dict.fromkeys((*a, *b)):
        if a.get(name) != b.get(name):
            yield Changed(name, a.get(name), b.get(name))


def _settings(a: Provenance, b: Provenance) -> Iterator[Changed]:
    flat = [
        {
            **dict(_flat(about.settings.model_dump(mode="json"), "settings.")),
            **dict(_flat(about.machine, "")),
        }
        for about in (a, b)
    ]
    yield from _values(flat[0], flat[1])


def _inputs(a: Provenance, b: Provenance) -> Iterator[Changed]:
    names = [", ".join(each.name for each in about.inputs) for about in (a, b)]
    if names[0] != names[1]:
        yield Changed("names", *names)
    if not same_inputs(a, b):
        digests = [", ".join(each.sha256 for each in about.inputs) for about in (a, b)]
        yield Changed("contents", *digests)


def _told(a: Provenance, b: Provenance) -> Iterator[Changed]:
    yield from _values(
        {f"stamps of {topic}": kind for topic, kind in a.stamps.items()},
        {f"stamps of {topic}": kind for topic, kind in b.stamps.items()},
    )
    if a.t0_unix_ns != b.t0_unix_ns:
        yield Changed("first aligned sample, unix ns", a.t0_unix_ns, b.t0_unix_ns)
    for name, mine, theirs in (
        ("lost", list(map(str, a.losses)), list(map(str, b.losses))),
        ("note", list(a.notes), list(b.notes)),
    ):
        yield from (Changed(name, text, None) for text in mine if text not in theirs)
        yield from (Changed(name, None, text) for text in theirs if text not in mine)


def _stage(a: Replay, b: Replay, name: str, rtol: float, offset_ns: int) -> StageChange | None:
    """Compare a stage that both have; None where it is equal."""
    has = a.stages[name], b.stages[name]
    key = [column for column in _KEYS.get(_family(name), ()) if all(column in c for c in has)]
    ids = [_ids(a, name, key, 0), _ids(b, name, key, offset_ns)]
    pairs = None if ids[0].equals(ids[1]) else _pairs(ids[0], ids[1], key)
    height = ids[0].height
    faults = [
        ColumnChange(column, 0, 0, 0, None, None, None, f"only in {'AB'[which]}")
        for which in (0, 1)
        for column in has[which]
        if column not in has[1 - which]
    ]
    seconds = _seconds(ids[0], pairs)
    changes: list[ColumnChange] = []
    for part in _parts([column for column in has[0] if column in has[1]], height):
        mine, theirs = a.read(name, part), b.read(name, part)
        for column in part:
            x, y = mine[column], theirs[column]
            if offset_ns and column in _TIMES:
                y = y + offset_ns
            if pairs is not None:
                x, y = x.gather(pairs["row_a"]), y.gather(pairs["row_b"])
            changes += _column(x, y, rtol, seconds)
    common = height if pairs is None else pairs.height
    order = list(has[0]) != list(has[1]) and not faults
    if not (faults or changes or order or common != height or ids[1].height != common):
        return None
    return StageChange(name, height, ids[1].height, common, (*faults, *changes), order)


def _ids(replay: Replay, name: str, key: Sequence[str], offset_ns: int) -> pl.DataFrame:
    """What each row is about, in A's time; its number where the frame has no key."""
    columns = list(key) or [replay.stages[name][0]] if replay.stages[name] else []
    frame = replay.read(name, columns) if columns else pl.DataFrame()
    if not key:
        return frame.select(pl.int_range(pl.len()).alias("row"))
    return frame.with_columns(
        pl.col(column) + offset_ns for column in key if offset_ns and column in _TIMES
    ).with_columns(pl.col(pl.Enum).cast(pl.String))


def _pairs(a: pl.DataFrame, b: pl.DataFrame, key: Sequence[str]) -> pl.DataFrame:
    """The rows of A and B that are about the same, as `row_a` and `row_b`."""
    on = list(key) or ["row"]
    nth = pl.int_range(pl.len()).over(on).alias("_nth")  # of several about the same
    left = a.with_row_index("row_a").with_columns(nth)
    right = b.with_row_index("row_b").with_columns(nth)
    found = left.join(right, on=[*on, "_nth"], how="inner", nulls_equal=True)
    return found.select("row_a", "row_b").sort("row_a")


def _seconds(ids: pl.DataFrame, pairs: pl.DataFrame | None) -> pl.Series | None:
    """The time of each common row."""
    column = next((name for name in _TIMES if name in ids.columns), None)
    if column is None:
        return None
    times = ids[column] / 1e9
    return times if pairs is None else times.gather(pairs["row_a"])


def _parts(columns: Sequence[str], height: int) -> Iterator[Sequence[str]]:
    """Columns that are read together."""
    size = max(1, _VALUES // max(height, 1))
    for begin in range(0, len(columns), size):
        yield columns[begin : begin + size]


def _column(
    x: pl.Series, y: pl.Series, rtol: float, seconds: pl.Series | None
) -> Iterator[ColumnChange]:
    """Yield the change of a column, if there is one."""
    if x.dtype != y.dtype:
        fault = f"{x.dtype} in A, {y.dtype} in B"
        yield ColumnChange(x.name, 0, 0, 0, None, None, None, fault)
        return
    differs = _bits(x).ne_missing(_bits(y))
    if not differs.any():
        return
    size = change = pl.Series(dtype=pl.Float64)
    if x.dtype.is_numeric():
        both = pl.DataFrame({"x": x.cast(pl.Float64), "y": y.cast(pl.Float64)}).fill_nan(None)
        change = both["y"] - both["x"]
        size = change.abs() / both.select(pl.max_horizontal(pl.all().abs())).to_series()
        if x.dtype.is_float() and rtol:
            differs &= ~((size <= rtol) | (change == 0.0)).fill_null(value=False)
            if not differs.any():
                return
        change = pl.select(pl.when(differs).then(change)).to_series()
    where = change.abs().arg_max() if change.len() else None
    relative = size.filter(differs).max() if size.len() else None
    first = differs.arg_true()[0] if where is None else where
    yield ColumnChange(
        name=x.name,
        rows=int(differs.sum()),
        only_a=int((differs & x.is_not_null() & y.is_null()).sum()),
        only_b=int((differs & x.is_null() & y.is_not_null()).sum()),
        largest=None if where is None else float(change[where]),
        largest_relative=None if relative is None else float(relative),  # pyright: ignore
        at_s=None if seconds is None else float(seconds[first]),
    )


def _bits(series: pl.Series) -> pl.Series:
    """A column whose equal values are equal bits: 0.0 is not -0.0, and a NaN is one."""
    if isinstance(series.dtype, pl.Enum):
        return series.cast(pl.String)
    if not series.dtype.is_float():
        return series
    numbers = series.fill_null(0.0).to_numpy()
    bits = pl.Series(series.name, numbers.view(f"i{numbers.itemsize}"))
    return pl.select(pl.when(series.is_not_null()).then(bits)).to_series()


def _rows(replay: Replay, stage: str) -> list[dict[str, Any]]:
    return replay.read(stage, replay.stages[stage]).to_dicts() if stage in replay.stages else []


def _estimates(a: Replay, b: Replay, rtol: float) -> tuple[EstimateChange, ...]:
    """The masses of the whole log, by method."""
    mine, theirs = ({row["method"]: row for row in _rows(each, "masses")} for each in (a, b))
    methods = dict.fromkeys((*mine, *theirs))
    return _moved(((name, mine.get(name, {}), theirs.get(name, {})) for name in methods), rtol)


def _manoeuvres(a: Replay, b: Replay, rtol: float, offset_ns: int) -> tuple[EstimateChange, ...]:
    """The manoeuvres of both, those of B under the ones of A that their middle lies in."""
    mine, theirs = (_rows(each, "segments") for each in (a, b))
    found: list[tuple[str, dict[str, Any], dict[str, Any]]] = []
    left = list(theirs)
    for row in mine:
        inside = [
            other
            for other in left
            if row["start_t_ns"]
            <= (other["start_t_ns"] + other["end_t_ns"]) // 2 + offset_ns
            <= row["end_t_ns"]
        ]
        left = [other for other in left if not any(other is each for each in inside)]
        found.append((_span(row, 0), row, inside[0] if inside else {}))
        found += [(_span(other, offset_ns), {}, other) for other in inside[1:]]
    found += [(_span(other, offset_ns), {}, other) for other in left]
    return _moved(found, rtol)


def _span(row: Mapping[str, Any], offset_ns: int) -> str:
    begin, end = ((row[name] + offset_ns) / 1e9 for name in ("start_t_ns", "end_t_ns"))
    return f"{begin:.2f} to {end:.2f} s"


def _moved(
    pairs: Iterable[tuple[str, Mapping[str, Any], Mapping[str, Any]]], rtol: float
) -> tuple[EstimateChange, ...]:
    """Estimates that differ: appeared or gone first, then by how far they moved."""
    changes = [
        EstimateChange(about, name, a.get(name), a.get(std), b.get(name), b.get(std))
        for about, a, b in pairs
        for name, std in _ESTIMATES.items()
        if not _alike(a.get(name), b.get(name), rtol)
    ]

    def moved(each: EstimateChange) -> float:
        if each.change is None:
            return float("inf")
        return abs(each.change if each.stds is None else each.stds)

    return tuple(sorted(changes, key=moved, reverse=True))


def _alike(a: float | None, b: float | None, rtol: float) -> bool:
    if a is None or b is None:
        return a is b
    return a == b or abs(a - b) <= rtol * max(abs(a), abs(b))


def _checks(a: Replay, b: Replay) -> Iterator[Changed]:
    """Checks that passed in one and not in the other."""
    passed = [{row["check"]: row["passed"] for row in _rows(each, "verdict")} for each in (a, b)]
    yield from _values(passed[0], passed[1])
