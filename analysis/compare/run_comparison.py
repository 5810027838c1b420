"""Comparison of two replays: settings, columns, estimates and manoeuvres that differ."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from analysis.compare.stage_change import (
    Replay,
    StageChange,
    compare_frames_of_stage,
    find_frame_of_stage,
)
from analysis.model.axes import X, Z
from analysis.model.machine import Machine
from analysis.model.run_record import Provenance
from analysis.model.settings import Settings

#: Estimates and their standard deviations, by the frame that holds them.
_ESTIMATES: Final = {**dict((*X.parameters, *Z.parameters)), "calibrated_kg": "calibrated_u_kg"}


@dataclass(frozen=True, slots=True)
class ValueChange:
    """A named value that differs between two replays; None if absent."""

    name: str
    a: Any
    b: Any


@dataclass(frozen=True, slots=True)
class EstimateChange:
    """An estimate that differs, of the whole log or of a manoeuvre."""

    about: str
    """The method, or the seconds from and to of the manoeuvre."""
    quantity: str
    a: float | None
    a_std: float | None
    b: float | None
    b_std: float | None

    @property
    def value_change(self) -> float | None:
        """B minus A; None if one lacks the estimate."""
        return None if self.a is None or self.b is None else self.b - self.a

    @property
    def change_in_stds(self) -> float | None:
        """The change over the larger of both standard deviations; None if either is unknown."""
        std = max(self.a_std or 0.0, self.b_std or 0.0)
        return None if self.value_change is None or not std else self.value_change / std


@dataclass(frozen=True, slots=True)
class Comparison:
    """Differences between replays A and B; everything else is equal."""

    settings: tuple[ValueChange, ...]
    """Settings and keys of the machine file."""
    inputs: tuple[ValueChange, ...]
    """Files by name, with their digests."""
    versions: tuple[ValueChange, ...]
    provenance: tuple[ValueChange, ...]
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
    """Changes of the estimates of manoeuvres."""
    checks: tuple[ValueChange, ...]
    """Checks of the verdict whose outcome differs."""

    @property
    def is_equal(self) -> bool:
        """Whether nothing differs except file names and versions."""
        return not (
            self.settings or self.provenance or self.only_a or self.only_b or self.stages
        ) and not any(change.name == "contents" for change in self.inputs)

    def to_dict(self) -> dict[str, Any]:
        """The comparison as JSON-compatible values, including the change of each estimate."""
        plain = asdict(self)
        for name in ("estimates", "manoeuvres"):
            changes: tuple[EstimateChange, ...] = getattr(self, name)
            plain[name] = [
                {**asdict(each), "change": each.value_change, "change_in_stds": each.change_in_stds}
                for each in changes
            ]
        return {"equal": self.is_equal, **plain}


def do_runs_read_same_bytes(a: Provenance, b: Provenance) -> bool:
    """Whether two replays read the same bytes, under any file names."""
    digests = [sorted(each.sha256 for each in about.inputs) for about in (a, b)]
    return digests[0] == digests[1]


def compare_runs(
    a: Replay, b: Replay, *, relative_tolerance: float = 0.0, do_rows_correspond: bool = True
) -> Comparison:
    """Compare two replays.

    Args:
        a: baseline replay.
        b: replay to compare with it.
        relative_tolerance: relative tolerance of numbers; 0 compares bit for bit.
        do_rows_correspond: whether the rows of stages correspond; for different logs only results
            of the whole log are compared.
    """
    mine, theirs = a.provenance, b.provenance
    common = [name for name in a.stages if name in b.stages]
    compared = [
        name
        for name in common
        if do_rows_correspond or find_frame_of_stage(name) in ("masses", "verdict")
    ]
    offset_ns = theirs.t0_unix_ns - mine.t0_unix_ns if do_rows_correspond else 0
    changes = [
        compare_frames_of_stage(a, b, name, relative_tolerance, offset_ns) for name in compared
    ]
    return Comparison(
        settings=tuple(_iter_setting_changes(mine, theirs)),
        inputs=tuple(_iter_input_changes(mine, theirs)),
        versions=tuple(_iter_changed_values(mine.versions, theirs.versions)),
        provenance=tuple(_iter_provenance_changes(mine, theirs)) if do_rows_correspond else (),
        only_a=tuple(name for name in a.stages if name not in b.stages),
        only_b=tuple(name for name in b.stages if name not in a.stages),
        stages=tuple(change for change in changes if change is not None),
        columns=sum(len({*a.stages[name], *b.stages[name]}) for name in compared),
        estimates=list_estimate_changes(a, b, relative_tolerance),
        manoeuvres=list_manoeuvre_changes(a, b, relative_tolerance, offset_ns)
        if do_rows_correspond
        else (),
        checks=tuple(iter_changed_checks(a, b)),
    )


def _flatten_to_dotted_names(section: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in section.items():
        if isinstance(value, dict):
            yield from _flatten_to_dotted_names(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _iter_changed_values(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[ValueChange]:
    for name in dict.fromkeys((*a, *b)):
        if a.get(name) != b.get(name):
            yield ValueChange(name, a.get(name), b.get(name))


def list_changed_settings_and_keys(a: Machine, b: Machine) -> list[ValueChange]:
    """Settings and keys of two machine files that differ."""
    flat: list[dict[str, Any]] = []
    for machine in (a, b):
        plain = machine.model_dump(mode="json")
        del plain["settings"]
        flat.append(_flatten_settings_and_machine_keys(machine.settings, plain))
    return list(_iter_changed_values(flat[0], flat[1]))


def _flatten_settings_and_machine_keys(
    settings: Settings, machine: Mapping[str, Any]
) -> dict[str, Any]:
    by_stage = {f"settings.{name}": value for name, value in settings.to_flat_dict().items()}
    return {**by_stage, **dict(_flatten_to_dotted_names(machine, ""))}


def _iter_setting_changes(a: Provenance, b: Provenance) -> Iterator[ValueChange]:
    yield from _iter_changed_values(
        _flatten_settings_and_machine_keys(a.settings, a.machine),
        _flatten_settings_and_machine_keys(b.settings, b.machine),
    )


def _iter_input_changes(a: Provenance, b: Provenance) -> Iterator[ValueChange]:
    names = [", ".join(each.name for each in about.inputs) for about in (a, b)]
    if names[0] != names[1]:
        yield ValueChange("names", *names)
    if not do_runs_read_same_bytes(a, b):
        digests = [", ".join(each.sha256 for each in about.inputs) for about in (a, b)]
        yield ValueChange("contents", *digests)


def _iter_provenance_changes(a: Provenance, b: Provenance) -> Iterator[ValueChange]:
    yield from _iter_changed_values(
        {f"stamps of {topic}": kind for topic, kind in a.stamps.items()},
        {f"stamps of {topic}": kind for topic, kind in b.stamps.items()},
    )
    if a.t0_unix_ns != b.t0_unix_ns:
        yield ValueChange("first aligned sample, unix ns", a.t0_unix_ns, b.t0_unix_ns)
    for name, mine, theirs in (
        ("lost", list(map(str, a.losses)), list(map(str, b.losses))),
        ("note", list(a.notes), list(b.notes)),
    ):
        yield from (ValueChange(name, text, None) for text in mine if text not in theirs)
        yield from (ValueChange(name, None, text) for text in theirs if text not in mine)


def _read_stage_rows(replay: Replay, stage: str) -> list[dict[str, Any]]:
    return replay.read(stage, replay.stages[stage]).to_dicts() if stage in replay.stages else []


def list_estimate_changes(
    a: Replay, b: Replay, relative_tolerance: float
) -> tuple[EstimateChange, ...]:
    """Changes of the masses of the whole log, by method, and of the masses of its loads."""
    mine, theirs = (
        {row["method"]: row for row in _read_stage_rows(each, "masses")} for each in (a, b)
    )
    for replay, rows in ((a, mine), (b, theirs)):
        loads = _read_stage_rows(replay, "loads")
        for load in loads:
            name = "joint" if len(loads) == 1 else f"joint, load {load['load_id']}"
            rows[name] = {**load, "mass_std_kg": load["u_kg"]}
    methods = dict.fromkeys((*mine, *theirs))
    return select_differing_estimates(
        ((name, mine.get(name, {}), theirs.get(name, {})) for name in methods), relative_tolerance
    )


def list_manoeuvre_changes(
    a: Replay, b: Replay, relative_tolerance: float, offset_ns: int
) -> tuple[EstimateChange, ...]:
    """Changes of the manoeuvres' masses; a manoeuvre of B is paired with A's at its middle."""
    mine, theirs = (_read_stage_rows(each, "segments") for each in (a, b))
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
        found.append((_format_time_span_of_row(row, 0), row, inside[0] if inside else {}))
        found += [(_format_time_span_of_row(other, offset_ns), {}, other) for other in inside[1:]]
    found += [(_format_time_span_of_row(other, offset_ns), {}, other) for other in left]
    return select_differing_estimates(found, relative_tolerance)


def _format_time_span_of_row(spanned_row: Mapping[str, Any], offset_ns: int) -> str:
    start, end = ((spanned_row[name] + offset_ns) / 1e9 for name in ("start_t_ns", "end_t_ns"))
    return f"{start:.2f} to {end:.2f} s"


def select_differing_estimates(
    pairs: Iterable[tuple[str, Mapping[str, Any], Mapping[str, Any]]], relative_tolerance: float
) -> tuple[EstimateChange, ...]:
    """Estimates that differ: first those that only one run has, then by size of the change."""
    changes = [
        EstimateChange(about, name, a.get(name), a.get(std), b.get(name), b.get(std))
        for about, a, b in pairs
        for name, std in _ESTIMATES.items()
        if not is_equal_within_tolerance(a.get(name), b.get(name), relative_tolerance)
    ]

    def compute_size_of_change(estimate_change: EstimateChange) -> float:
        if estimate_change.value_change is None:
            return float("inf")
        return abs(
            estimate_change.value_change
            if estimate_change.change_in_stds is None
            else estimate_change.change_in_stds
        )

    return tuple(sorted(changes, key=compute_size_of_change, reverse=True))


def is_equal_within_tolerance(a: float | None, b: float | None, relative_tolerance: float) -> bool:
    """Whether two values agree within a relative tolerance, or are both missing."""
    if a is None or b is None:
        return a is b
    return a == b or abs(a - b) <= relative_tolerance * max(abs(a), abs(b))


def iter_changed_checks(a: Replay, b: Replay) -> Iterator[ValueChange]:
    """Yield the checks whose outcome differs between the two replays."""
    passed = [
        {row["check"]: row["passed"] for row in _read_stage_rows(each, "verdict")}
        for each in (a, b)
    ]
    yield from _iter_changed_values(passed[0], passed[1])
