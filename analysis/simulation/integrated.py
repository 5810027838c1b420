"""The motion of a whole log, as the integrated plant keeps it: what it is at any instant."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.simulation import plant
from analysis.simulation.motion import Channels
from analysis.simulation.scenario import Scenario
from analysis.simulation.timeline import DrivenManoeuvre
from analysis.simulation.waveforms import Floats

#: Numbers of stages; the phase of one that is free follows from its motion.
REST, OPEN, STEADY, BRAKING, FREE = range(5)
#: Columns of what changes how fast.
_FORCE_RATE, _TURN, _JERK = range(3)


@dataclass(frozen=True, eq=False)
class IntegratedLog:
    """The motion of a whole log.

    Attributes:
        scenario: that was driven.
        trial_s: (trials + 1,) when each trial begins, and the last ends, since the log began.
        driven: the manoeuvres, in order.
        rows: (n, 16) what `plant` keeps, times ascending; at a time that is there twice something
            changes at once.
        stage: (n,) the kind of stage that each row belongs to.
    """

    scenario: Scenario
    trial_s: Floats
    driven: tuple[DrivenManoeuvre, ...]
    rows: Floats
    stage: NDArray[np.int64]

    def sample(self, time_s: Floats) -> Channels:
        """The channels at times (n,) in s since the log began: any times, in any order."""
        machine, terrain, rows = self.scenario.machine, self.scenario.terrain, self.rows
        time = rows[:, plant.TIME]
        last = np.clip(np.searchsorted(time, time_s, side="right") - 1, 0, len(time) - 2)
        span = time[last + 1] - time[last]
        part = np.clip((time_s - time[last]) / np.where(span > 0.0, span, 1.0), 0.0, 1.0)
        low, high = rows[last], rows[last + 1]
        now = (low + (high - low) * part[:, None]).T
        slopes = self._slopes
        rate = (slopes[last] + (slopes[last + 1] - slopes[last]) * part[:, None]).T
        wheel, body, acc = now[1 + plant.WHEEL], now[1 + plant.BODY], now[plant.ACCELERATION]
        position = now[1 + plant.POSITION]
        slope = terrain.slope_at_rad(position)
        omega, turn = now[plant.YAW_RATE], rate[_TURN]
        force = now[plant.GROUND] - now[plant.BRAKED]
        squat, squat_rate = now[1 + plant.PITCH], now[1 + plant.PITCH_RATE]
        if not self.scenario.chassis.squat_hz:
            gain = math.radians(self.scenario.chassis.squat_deg_s2_m)
            squat, squat_rate = gain * acc, gain * rate[_JERK]
        torque = self._inertia_z(now[plant.MASS]) * turn + machine.friction_z_N_m_s * omega
        torque = torque + machine.coulomb_z_N_m * np.sign(omega)
        seen = self.scenario.campaign.brake_measured_share
        gravity = terrain.gravity_m_s2 * np.sin(slope)
        return Channels(
            phase=self._phase(last, wheel, acc),
            speed_x_m_s=body,
            acc_x_m_s2=acc,
            force_x_N=force,
            measured_force_x_N=now[plant.FORCE] - seen * now[plant.BRAKED],
            yaw_rate_rad_s=omega,
            yaw_acc_rad_s2=turn,
            torque_z_N_m=torque,
            measured_torque_z_N_m=torque,
            specific_force_x_m_s2=acc + gravity,
            specific_force_y_m_s2=omega * body,
            heading_rad=np.interp(time_s, time, self._heading_rad()),
            wheel_speed_x_m_s=wheel,
            force_rate_x_N_s=rate[_FORCE_RATE],
            slope_rad=slope,
            squat_rad=squat,
            nose_up_rate_rad_s=squat_rate + terrain.slope_change_rad_m(position) * wheel,
            mass_kg=now[plant.MASS],
        )

    @cached_property
    def _slopes(self) -> Floats:
        """(n, 3) how fast force, yaw rate and acceleration change; not across a sudden change."""
        rows, time = self.rows, self.rows[:, plant.TIME]
        force = rows[:, plant.GROUND] - rows[:, plant.BRAKED]
        values = np.column_stack([force, rows[:, plant.YAW_RATE], rows[:, plant.ACCELERATION]])
        span = np.diff(time)[:, None]
        between = np.diff(values, axis=0) / np.where(span > 0.0, span, np.inf)
        none = np.zeros((1, values.shape[1]))
        sides = np.concatenate([none, between]), np.concatenate([between, none])
        known = [np.concatenate(each) > 0.0 for each in ((none[:, :1], span), (span, none[:, :1]))]
        return (sides[0] + sides[1]) / np.maximum(known[0].astype(float) + known[1], 1.0)

    def _inertia_z(self, mass_kg: Floats) -> Floats:
        machine = self.scenario.machine
        square = machine.load_x_m**2 + machine.load_y_m**2
        return machine.inertia_z_kg_m2 + (mass_kg - machine.mass_kg) * square

    def _heading_rad(self) -> Floats:
        time, rate = self.rows[:, plant.TIME], self.rows[:, plant.YAW_RATE]
        turned = np.diff(time) * (rate[1:] + rate[:-1]) / 2.0
        return np.concatenate([[0.0], np.cumsum(turned)])

    def _phase(self, row: NDArray[np.intp], speed: Floats, acc: Floats) -> NDArray[np.str_]:
        stage = self.stage[row]
        standing = (self.rows[row, plant.STANDS] > 0.0) | (speed == 0.0)
        return np.select(
            [standing, stage == OPEN, stage == STEADY, stage == BRAKING, speed * acc >= 0.0],
            ["standstill", "accelerating", "cruising", "braking", "accelerating"],
            default="braking",
        )
