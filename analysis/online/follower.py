"""Follow a log: samples in; decisions, estimates and reports out, in bounded memory."""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import polars as pl
from numpy.typing import NDArray

from analysis.model.axes import X
from analysis.model.machine import Machine
from analysis.model.schema import FRAMES
from analysis.online.answer_progress import AnswerProgress, choose_target_uncertainty_kg
from analysis.online.gate_state import GateRow, convert_cell_to_float
from analysis.online.growing_log import GrowingLog, copy_machine_with_causal_filters
from analysis.online.on_board import (
    OnlineState,
    OnlineStep,
    TimedEstimate,
    finish,
    start,
    step_rows,
)
from analysis.online.online_limits import LIMITS
from analysis.online.online_report import (
    Event,
    OnlineReport,
    PooledEstimate,
    judge_mass_validity,
    judge_spin_validity,
)
from estimators.estimate import Estimate


class FollowedRow(NamedTuple):
    """A row of the grid, with its decisions, estimates and reports.

    Attributes:
        t_ns: time of the row.
        phase: phase of motion; None if unknown.
        gate: decision on the window that ends at this row; None after the end of the log.
        estimates: estimates by method, each with the `t_ns` of its row.
        reports: reports made at this row.
        excitation: row of `excitation`; empty after the end of the log.
        spin_gate: decision on the window of the yaw axis; None without a yaw axis.
        spin_estimates: estimates of inertia and turning friction, by method.
    """

    t_ns: int
    phase: str | None
    gate: GateRow | None
    estimates: Mapping[str, tuple[int, Estimate]]
    reports: tuple[OnlineReport, ...]
    excitation: Mapping[str, Any] = MappingProxyType({})
    spin_gate: GateRow | None = None
    spin_estimates: Mapping[str, tuple[int, Estimate]] = MappingProxyType({})


@dataclass(slots=True)
class _RowTimeline:
    """`t_ns` by row number: uniform steps, with jumps at gaps of the grid.

    Attributes:
        step_ns: step of the grid.
        breaks: row number and grid position at each jump.
    """

    step_ns: float
    breaks: list[tuple[int, int]] = field(default_factory=list)
    rows: int = 0

    def append_row_time(self, t_ns: int) -> None:
        place = round(t_ns / self.step_ns)
        row, last = self.breaks[-1] if self.breaks else (0, -1)
        if not self.breaks or place - last != self.rows - row:
            self.breaks.append((self.rows, place))
        self.rows += 1

    def find_row_time_ns(self, row: int) -> int:
        begin, place = next(each for each in reversed(self.breaks) if each[0] <= row)
        return round((place + row - begin) * self.step_ns)


class Follower:
    """Follows the log of one machine.

    From `excitation` on, its decisions and estimates equal those of the causal replay bit for bit;
    its standard uncertainties do not (see `on_board`).
    """

    def __init__(
        self,
        machine: Machine,
        noise: pl.DataFrame | None = None,
        *,
        valid_s: float = LIMITS.valid_s,
        until_u_kg: float | None = None,
    ) -> None:
        """Initialise before the first sample.

        Args:
            machine: channels and settings (`load_machine`). All filters are causal here.
            noise: frame `noise` of an earlier recording of the machine; None uses
                `[settings.noise]` if complete, otherwise no window is rejected for noise.
            valid_s: age in s up to which a mass counts as current.
            until_u_kg: target standard uncertainty of a load's mass; None for 2 % of the empty
                mass, if known.
        """
        self.log = GrowingLog(copy_machine_with_causal_filters(machine))
        self.last_gate: GateRow | None = None
        self.last_mass: PooledEstimate | None = None
        #: inertia and friction of turning of the last spin
        self.last_inertia: PooledEstimate | None = None
        #: the newest estimate of each method, with the `t_ns` of its row
        self.newest: dict[str, tuple[int, Estimate]] = {}
        self.manoeuvres = 0
        self.spins = 0
        #: progress for the load that the machine carries now
        self.progress = AnswerProgress(choose_target_uncertainty_kg(machine.machine, until_u_kg))
        #: times of the latest changes of direction, with the new speed in m/s, the newest last
        self._directions: deque[tuple[int, float]] = deque(maxlen=LIMITS.max_directions)
        self._noise, self._valid_s = noise, valid_s
        self._state: OnlineState | None = None
        self._times: _RowTimeline | None = None
        self._now: tuple[int, str | None] = (0, None)
        self._second = -1

    @property
    def topics(self) -> list[str]:
        """Topics to feed; a table has the one topic `table`."""
        return self.log.topics

    @property
    def rows_stepped(self) -> int:
        """Number of grid rows so far."""
        return self._times.rows if self._times else 0

    def append_samples(self, topic: str, samples: pl.DataFrame) -> None:
        """Append the next samples of a topic.

        Args:
            topic: name in the machine file.
            samples: frame with `log_time_ns` (Int64, time of recording), `header_stamp_ns` (Int64,
                time of measurement, null if unknown) and a column per field of the channels.
        """
        self.log.append_topic_samples(topic, samples)

    def advance(self, *, is_log_complete: bool = False) -> list[OnlineReport]:
        """Process all rows that the samples so far determine, and return the reports.

        Args:
            is_log_complete: whether no further samples will come.

        Raises:
            DataError: the log is complete, and its channels do not overlap in time.
        """
        return [
            report
            for row in self.collect_complete_rows(is_log_complete=is_log_complete)
            for report in row.reports
        ]

    def collect_complete_rows(self, *, is_log_complete: bool = False) -> list[FollowedRow]:
        """Process and collect the complete rows, each with its decisions and estimates."""
        return [*self.iter_complete_rows(is_log_complete=is_log_complete)]

    def iter_complete_rows(self, *, is_log_complete: bool = False) -> Iterator[FollowedRow]:
        """Yield the complete rows, each as soon as it is processed; rows not consumed are lost."""
        columns = self.log.compute_new_excitation_columns(is_log_complete=is_log_complete)
        for rows in iter_excitation_rows(columns, LIMITS.rows_stepped_at_once):
            state, _ = self._start_online_state_and_timeline()
            yield from map(self._note_step, rows, step_rows(state, rows))
        if is_log_complete and self._state is not None:
            yield from self._finish_rows(self._state)

    def _note_step(self, row: Mapping[str, Any], stepped: OnlineStep) -> FollowedRow:
        _, times = self._start_online_state_and_timeline()
        t_ns = int(row["t_ns"])
        times.append_row_time(t_ns)
        self._state, self.last_gate = stepped.state, stepped.gate
        self._now = t_ns, row["phase"]
        self._note_change_of_driving_direction(t_ns, row)
        estimates = self._replace_rows_by_times_ns_in_estimates(stepped.estimates)
        self.newest |= estimates
        spun = (
            self._replace_rows_by_times_ns_in_estimates(stepped.spin.estimates)
            if stepped.spin
            else {}
        )
        second = t_ns // 1_000_000_000
        reports = [self._make_report("manoeuvre")] if self._update_last_mass(estimates) else []
        reports += [self._make_report("spin")] if self._update_last_inertia(spun) else []
        if second > self._second and not reports:
            reports.append(self._make_report("second"))
        self._second = second
        spin_gate = stepped.spin.gate if stepped.spin else None
        return FollowedRow(
            t_ns, row["phase"], stepped.gate, estimates, tuple(reports), row, spin_gate, spun
        )

    def _finish_rows(self, state: OnlineState) -> Iterator[FollowedRow]:
        t_ns, phase = self._now
        for axis, late in finish(state):
            found = self._replace_rows_by_times_ns_in_estimates(late)
            if axis is X:
                self.newest |= found
                reports = (self._make_report("manoeuvre"),) if self._update_last_mass(found) else ()
                yield FollowedRow(t_ns, phase, None, found, reports)
            else:
                reports = (self._make_report("spin"),) if self._update_last_inertia(found) else ()
                yield FollowedRow(t_ns, phase, None, {}, reports, spin_estimates=found)
        yield FollowedRow(t_ns, phase, None, {}, (self._make_report("end"),))

    def _start_online_state_and_timeline(self) -> tuple[OnlineState, _RowTimeline]:
        if self._state is None or self._times is None:
            basis = self.log.basis
            assert basis is not None, "there are rows"
            self._state = start(basis.machine.settings, self._noise)
            self._times = _RowTimeline(1e9 / basis.machine.settings.align.rate_hz)
        return self._state, self._times

    def _replace_rows_by_times_ns_in_estimates(
        self, estimates: Mapping[str, TimedEstimate]
    ) -> dict[str, tuple[int, Estimate]]:
        assert self._times is not None
        return {
            name: (self._times.find_row_time_ns(row), each)
            for name, (row, each) in estimates.items()
        }

    def _update_last_mass(self, estimates: Mapping[str, tuple[int, Estimate]]) -> bool:
        if "pooled" not in estimates:
            return False
        self.last_mass = last = PooledEstimate(*estimates["pooled"])
        self.manoeuvres += 1
        assert self.log.basis is not None, "there are rows"
        if (
            judge_mass_validity(last, last.t_ns, self.log.basis.machine.machine, math.inf)
            == "valid"
        ):
            speeds = [speed for since, speed in self._directions if since <= last.t_ns]
            mass_kg, u_kg = float(last.estimate.theta[0]), float(last.estimate.std[0])
            self.progress = self.progress.add_manoeuvre(
                mass_kg, u_kg, speeds[-1] if speeds else 0.0
            )
        return True

    def _update_last_inertia(self, estimates: Mapping[str, tuple[int, Estimate]]) -> bool:
        if "pooled" not in estimates:
            return False
        self.last_inertia = PooledEstimate(*estimates["pooled"])
        self.spins += 1
        return True

    def _note_change_of_driving_direction(self, t_ns: int, row: Mapping[str, Any]) -> None:
        """Note when the driving direction changes."""
        speed = convert_cell_to_float(row["speed_x_m_s"])
        if row["phase"] in (None, "standstill") or not speed:
            return
        if not self._directions or (speed < 0.0) != (self._directions[-1][1] < 0.0):
            self._directions.append((t_ns, speed))

    def _make_report(self, event: Event) -> OnlineReport:
        basis, gate, last = self.log.basis, self.last_gate, self.last_mass
        assert basis is not None
        t_ns, phase = self._now
        validity = judge_mass_validity(last, t_ns, basis.machine.machine, self._valid_s)
        given = last.estimate if last is not None and validity in ("valid", "old") else None
        spun, spin_validity = (
            self.last_inertia,
            judge_spin_validity(self.last_inertia, t_ns, self._valid_s),
        )
        turning = spun.estimate if spun and spin_validity in ("valid", "old") else None
        index = gate.mi_nat if gate else math.nan
        progress = self.progress
        return OnlineReport(
            event=event,
            unix_ns=basis.t0_unix_ns + t_ns,
            t_s=t_ns / 1e9,
            phase=phase,
            gate=gate.reason if gate else "warming_up",
            index_nat=index if math.isfinite(index) else None,
            validity=validity,
            mass_kg=None if given is None else float(given.theta[0]),
            mass_u_kg=None if given is None else float(given.std[0]),
            friction_x_N_s_m=None if given is None else float(given.theta[1]),
            friction_u_N_s_m=None if given is None else float(given.std[1]),
            age_s=None if last is None else (t_ns - last.t_ns) / 1e9,
            manoeuvres=self.manoeuvres,
            load_mass_kg=progress.mean_kg if progress.manoeuvre_count else None,
            load_u_kg=progress.u_kg,
            load_manoeuvres=progress.manoeuvre_count,
            until_u_kg=progress.until_u_kg,
            percent=progress.information_percent,
            starts_missing=progress.missing_manoeuvre_count,
            reverse_missing=progress.missing_reverse_count,
            spin_validity=spin_validity,
            inertia_z_kg_m2=None if turning is None else float(turning.theta[0]),
            inertia_u_kg_m2=None if turning is None else float(turning.std[0]),
            friction_z_N_m_s=None if turning is None else float(turning.theta[1]),
            friction_z_u_N_m_s=None if turning is None else float(turning.std[1]),
            spin_age_s=None if spun is None else (t_ns - spun.t_ns) / 1e9,
            spins=self.spins,
        )


def iter_excitation_rows(
    columns: Mapping[str, NDArray[Any] | pl.Series], most_rows: int
) -> Iterator[list[dict[str, Any]]]:
    """Yield the rows of the frame `excitation` with these columns, at most `most_rows` at once."""
    names = [each.name for each in FRAMES["excitation"].columns]
    chosen = {name: columns[name] for name in names if name in columns}
    row_count = len(next(iter(chosen.values()), ()))
    for first in range(0, row_count, most_rows):
        cells = (_list_cells(column[first : first + most_rows]) for column in chosen.values())
        yield [dict(zip(chosen, row, strict=True)) for row in zip(*cells, strict=True)]


def _list_cells(column: NDArray[Any] | pl.Series) -> list[Any]:
    """Cells of a column (rows,), None for NaN."""
    if isinstance(column, pl.Series):
        return column.to_list()
    return [None if cell != cell else cell for cell in column.tolist()]
