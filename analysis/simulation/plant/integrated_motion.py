"""Motion of a whole log from the integrated plant, at any instant."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.motion.solved_motion import Channels
from analysis.simulation.motion.timeline import DrivenManoeuvre
from analysis.simulation.plant import plant
from analysis.simulation.scenario.scenario import Scenario
from estimators.arrays import Floats
from estimators.compiled import compiled_inline, compiled_without_refcounts

#: Rows of rates of change: of ground force, yaw rate, acceleration, mass.
FORCE_RATE, TURN, JERK, FILLING = range(4)
#: Number of these rows.
SLOPES: Final = 4
#: Number of rows that are tried one by one before a binary search.
_NEAR: Final = 16
#: Kinds of stages; the phase of a free stage follows from its motion.
REST, OPEN, STEADY, BRAKING, FREE, TURNING = range(6)


class RowBuffer:
    """Growing memory for the rows of a log, with the kind of stage of each row."""

    def __init__(self) -> None:
        self._rows = np.empty((1024, plant.COLUMNS))
        self._size = 0
        self._kinds: list[int] = []
        self._counts: list[int] = []

    @property
    def filled_rows(self) -> Floats:
        """(n, 16) all rows, as a view of the memory."""
        return self._rows[: self._size]

    @property
    def stage_kinds_of_rows(self) -> NDArray[np.int8]:
        """(n,) the kind of stage of each row."""
        return np.repeat(np.array(self._kinds, np.int8), self._counts)

    def provide_free_rows(self, count: int) -> Floats:
        """Free memory for `count` rows after the filled ones, (count, 16), to fill and commit."""
        if self._size + count > len(self._rows):
            self.reserve_rows(self._size + 2 * count)
        return self._rows[self._size : self._size + count]

    def reserve_rows(self, count: int) -> None:
        """Reserve memory for more rows; unused memory costs nothing."""
        grown = np.empty((self._size + count, plant.COLUMNS))
        grown[: self._size] = self.filled_rows
        self._rows = grown

    def drop_rows_before(self, before_s: float) -> float:
        """Drop rows before a time except the last, and return the heading change in them.

        At least two rows are kept. Arrays returned before keep their memory.
        """
        time_s = self.filled_rows[:, plant.TIME]
        first = int(np.searchsorted(time_s, before_s, side="right")) - 1
        first = max(min(first, self._size - 2), 0)
        gone = self.filled_rows[: first + 1]
        rate = gone[:, plant.YAW_RATE]
        turned = np.diff(gone[:, plant.TIME]) * (rate[1:] + rate[:-1]) / 2.0
        ends = np.cumsum(self._counts)
        stage = int(np.searchsorted(ends, first, side="right"))
        if first:
            self._rows = self.filled_rows[first:].copy()
            self._size -= first
            self._kinds = self._kinds[stage:]
            self._counts = [int(ends[stage]) - first, *self._counts[stage + 1 :]]
        return float(turned.sum())

    def commit_rows(self, count: int, stage_kind: int) -> None:
        """Commit `count` filled rows, all of one kind of stage."""
        self._size += count
        self._kinds.append(stage_kind)
        self._counts.append(count)


@dataclass(frozen=True, eq=False)
class IntegratedLog:
    """Integrated motion of a whole log.

    Attributes:
        scenario: driven scenario.
        trial_s: (trials + 1,) start of each trial, and end of the last, since the log began.
        driven: manoeuvres in order.
        rows: (n, 16) rows from `plant`, times ascending; a repeated time marks a discontinuity.
        stage: (n,) kind of stage of each row.
        heading_rad: heading at the first row.
    """

    scenario: Scenario
    trial_s: Floats
    driven: tuple[DrivenManoeuvre, ...]
    rows: Floats
    stage: NDArray[np.int8]
    heading_rad: float = 0.0

    def sample_channels(self, time_s: Floats) -> Channels:
        """Channels at times (n,) in s since the log began, in any order."""
        machine, terrain = self.scenario.machine, self.scenario.terrain
        now, rate = np.empty((plant.COLUMNS, time_s.size)), np.empty((SLOPES, time_s.size))
        last = np.empty(time_s.size, np.int64)
        interpolate_rows_into(self.rows, np.ascontiguousarray(time_s, np.float64), now, rate, last)
        wheel, body, acc = now[1 + plant.WHEEL], now[1 + plant.BODY], now[plant.ACCELERATION]
        position = now[1 + plant.POSITION]
        slope = terrain.compute_slope_rad(position)
        omega, turn = now[plant.YAW_RATE], rate[TURN]
        force = now[plant.GROUND] - now[plant.BRAKED]
        squat, squat_rate = now[1 + plant.PITCH], now[1 + plant.PITCH_RATE]
        if not self.scenario.chassis.squat_hz:
            squat, squat_rate = self._pitch_and_rate_of_fast_springs(now[plant.MASS], acc, rate)
        torque = self._inertia_z(now[plant.MASS]) * turn + machine.friction_z_N_m_s * omega
        torque = torque + machine.coulomb_z_N_m * np.sign(omega)
        seen = self.scenario.campaign.brake_measured_share
        gravity = terrain.gravity_m_s2 * np.sin(slope)
        heading = np.interp(time_s, self.rows[:, plant.TIME], self._heading_rad)
        return Channels(
            phase=self._label_motion_phases(last, wheel, acc, omega),
            speed_x_m_s=body,
            acc_x_m_s2=acc,
            force_x_N=force,
            measured_force_x_N=now[plant.FORCE] - seen * now[plant.BRAKED],
            yaw_rate_rad_s=omega,
            yaw_acc_rad_s2=turn,
            torque_z_N_m=torque,
            measured_torque_z_N_m=torque,
            specific_force_x_m_s2=acc + gravity * np.cos(heading),
            specific_force_y_m_s2=omega * body - gravity * np.sin(heading),
            heading_rad=heading,
            wheel_speed_x_m_s=wheel,
            force_rate_x_N_s=rate[FORCE_RATE],
            slope_rad=slope,
            squat_rad=squat,
            nose_up_rate_rad_s=squat_rate + terrain.slope_gradient_rad_m(position) * wheel,
            mass_kg=now[plant.MASS],
        )

    def _pitch_and_rate_of_fast_springs(
        self, mass_kg: Floats, acceleration: Floats, acceleration_rate: Floats
    ) -> tuple[Floats, Floats]:
        """Pitch in rad, and its rate in rad/s, (n,) each, on springs without dynamics."""
        chassis = self.scenario.chassis
        by_load = math.radians(chassis.squat_deg_s2_m_kg)
        standing = math.radians(chassis.pitch_deg_kg)
        load_kg = mass_kg - self.scenario.machine.mass_kg
        gain = math.radians(chassis.squat_deg_s2_m) + by_load * load_kg
        filling = (by_load * acceleration + standing) * acceleration_rate[FILLING]
        return gain * acceleration + standing * load_kg, gain * acceleration_rate[JERK] + filling

    def _inertia_z(self, mass_kg: Floats) -> Floats:
        machine = self.scenario.machine
        square = machine.load_x_m**2 + machine.load_y_m**2
        return machine.inertia_z_kg_m2 + (mass_kg - machine.mass_kg) * square

    @cached_property
    def _heading_rad(self) -> Floats:
        time, rate = self.rows[:, plant.TIME], self.rows[:, plant.YAW_RATE]
        turned = np.diff(time) * (rate[1:] + rate[:-1]) / 2.0
        return self.heading_rad + np.concatenate([[0.0], np.cumsum(turned)])

    def _label_motion_phases(
        self, row_before: NDArray[np.int64], speed: Floats, acceleration: Floats, yaw_rate: Floats
    ) -> NDArray[np.str_]:
        stage = self.stage[row_before]
        standing = (self.rows[row_before, plant.STANDS] > 0.0) | (speed == 0.0)
        return np.select(
            [
                (stage == TURNING) & (yaw_rate != 0.0),
                standing,
                stage == OPEN,
                stage == STEADY,
                stage == BRAKING,
                speed * acceleration >= 0.0,
            ],
            ["spinning", "standstill", "accelerating", "cruising", "braking", "accelerating"],
            default="braking",
        )


@compiled_inline
def _find_row_before(rows: Floats, time_s: float, first_candidate: int) -> int:
    """Last row at or before a time, between the first and the last row."""
    most = rows.shape[0] - 2
    least = 0
    if rows[first_candidate, plant.TIME] <= time_s:
        least = first_candidate
        for _ in range(_NEAR):
            if least >= most or rows[least + 1, plant.TIME] > time_s:
                return least
            least += 1
    while least < most:
        middle = (least + most + 1) // 2
        if rows[middle, plant.TIME] <= time_s:
            least = middle
        else:
            most = middle - 1
    return least


@compiled_inline
def _select_value_to_differentiate(row: Floats, column: int) -> float:
    """Value at a row whose derivative is the given kind of rate."""
    if column == FORCE_RATE:
        return row[plant.GROUND] - row[plant.BRAKED]
    if column == FILLING:
        return row[plant.MASS]
    return row[plant.YAW_RATE if column == TURN else plant.ACCELERATION]


@compiled_inline
def differentiate_column_at_row(rows: Floats, row_index: int, column: int) -> float:
    """Derivative of a value at a row: mean of both sides, except across discontinuities."""
    total, known = 0.0, 0.0
    for first in (row_index - 1, row_index):
        if first >= 0 and first + 1 < rows.shape[0]:
            span = rows[first + 1, plant.TIME] - rows[first, plant.TIME]
            if span > 0.0:
                total += (
                    _select_value_to_differentiate(rows[first + 1], column)
                    - _select_value_to_differentiate(rows[first], column)
                ) / span
                known += 1.0
    return total / max(known, 1.0)


@compiled_without_refcounts
def interpolate_rows_into(
    rows: Floats, time_s: Floats, out: Floats, slopes: Floats, last: NDArray[np.int64]
) -> None:
    """Interpolate rows at times; constant before the first and after the last row.

    Args:
        rows: (n, 16) at least two rows from `plant`, times ascending.
        time_s: (m,) times, fastest if ascending.
        out: (16, m) output: values at each time.
        slopes: (4, m) output: at each time, rates of yaw rate, acceleration, ground force without
            brakes, and mass, as numbered for `_select_value_to_differentiate`.
        last: (m,) output: row before each time.
    """
    known = 0
    for number in range(time_s.size):
        known = _find_row_before(rows, time_s[number], known)
        last[number] = known
        start = rows[known, plant.TIME]
        span = rows[known + 1, plant.TIME] - start
        part = (time_s[number] - start) / (span if span > 0.0 else 1.0)
        part = min(max(part, 0.0), 1.0)
        for column in range(plant.COLUMNS):
            low = rows[known, column]
            out[column, number] = low + (rows[known + 1, column] - low) * part
        for which in range(SLOPES):
            low = differentiate_column_at_row(rows, known, which)
            slopes[which, number] = (
                low + (differentiate_column_at_row(rows, known + 1, which) - low) * part
            )
