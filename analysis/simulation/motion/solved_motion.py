"""Solved motion of one trial with one load, without noise."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.motion.body import RigidBody
from estimators.arrays import Floats


class MotionState(NamedTuple):
    """State of the machine at n instants, (n,) each; drive and brakes in N and N·m."""

    speed_x_m_s: Floats
    acc_x_m_s2: Floats
    drive_x: Floats
    brake_x: Floats
    yaw_rate_rad_s: Floats
    yaw_acc_rad_s2: Floats
    drive_z: Floats
    brake_z: Floats
    heading_rad: Floats


class MotionPhase(NamedTuple):
    """A part of a trial; times in s since the trial began.

    `name` is a phase of motion, or None if the phase follows from the motion; `state` computes the
    state at times (n,).
    """

    name: str | None
    start_s: float
    end_s: float
    state: Callable[[Floats], MotionState]


class ManoeuvreTimes(NamedTuple):
    """Times of a manoeuvre in s since the trial began; None if it has no such part.

    At `drive_s` the drive begins; at `steady_s` a start begins to cruise, a spin to hold its rate
    and an arc its speed; at `braking_s` braking (or the ramp down of an arc) begins.
    """

    kind: str
    start_s: float
    drive_s: float | None
    steady_s: float | None
    braking_s: float | None
    end_s: float

    def subtract_start_time(self, start_s: float) -> "ManoeuvreTimes":
        """The times relative to `start_s`."""

        def subtract_start_s(time_s: float | None) -> float | None:
            return None if time_s is None else time_s - start_s

        return ManoeuvreTimes(
            self.kind,
            self.start_s - start_s,
            subtract_start_s(self.drive_s),
            subtract_start_s(self.steady_s),
            subtract_start_s(self.braking_s),
            self.end_s - start_s,
        )


class Channels(NamedTuple):
    """Motion at n instants, (n,) each, without noise and sensor effects."""

    phase: NDArray[np.str_]
    speed_x_m_s: Floats
    acc_x_m_s2: Floats
    #: Total force along x except friction and gravity.
    force_x_N: Floats
    #: The part of that force that torque sensors on all wheels would measure.
    measured_force_x_N: Floats
    yaw_rate_rad_s: Floats
    yaw_acc_rad_s2: Floats
    #: Total torque about the origin except friction and gravity, and the part that sensors measure.
    torque_z_N_m: Floats
    measured_torque_z_N_m: Floats
    #: Specific force of the origin, including the component of gravity by the slope.
    specific_force_x_m_s2: Floats
    specific_force_y_m_s2: Floats
    heading_rad: Floats
    #: Circumferential speed of the wheels without slip: that of the body if the driveline is rigid.
    wheel_speed_x_m_s: Floats
    #: Rate of change of the force, which the slip of tyres follows.
    force_rate_x_N_s: Floats
    #: Slope of the ground, positive if the machine faces uphill at heading 0.
    slope_rad: Floats
    #: Pitch of the body relative to the ground, positive nose-up.
    squat_rad: Floats
    #: Pitch rate of the body, by squat and ground.
    nose_up_rate_rad_s: Floats
    #: Mass of machine and load.
    mass_kg: Floats


@dataclass(frozen=True)
class SolvedMotion:
    """One trial with one load, from standstill to standstill, without noise.

    Attributes:
        body: machine with its load: the true values of the parameters to estimate.
        brake_measured_share: fraction of the brakes that the torque sensors measure.
        phases: consecutive phases over all times.
        manoeuvres: times of each manoeuvre, in order.
    """

    body: RigidBody
    brake_measured_share: float
    phases: tuple[MotionPhase, ...]
    manoeuvres: tuple[ManoeuvreTimes, ...]

    @property
    def duration_s(self) -> float:
        """End of the last manoeuvre, in s since the trial began."""
        return self.manoeuvres[-1].end_s

    def sample_channels(self, time_s: Floats) -> Channels:
        """Channels at times (n,) in s since the trial began, in any order."""
        name = np.full(time_s.shape, "standstill", dtype="<U12")
        rows = np.zeros((len(MotionState._fields), *time_s.shape))
        for phase in self.phases:
            inside = (time_s >= phase.start_s) & (time_s < phase.end_s)
            if inside.any():  # a short phase may lie between two samples
                state = phase.state(time_s[inside])
                name[inside] = _label_motion_phases(state) if phase.name is None else phase.name
                rows[:, inside] = np.stack(state)
        state = MotionState(*[rows[i] for i in range(len(rows))])
        gravity_x, gravity_y = self.body.slope_acceleration_along_and_across(state.heading_rad)
        seen = self.brake_measured_share
        return Channels(
            phase=name,
            speed_x_m_s=state.speed_x_m_s,
            acc_x_m_s2=state.acc_x_m_s2,
            force_x_N=state.drive_x - state.brake_x,
            measured_force_x_N=state.drive_x - seen * state.brake_x,
            yaw_rate_rad_s=state.yaw_rate_rad_s,
            yaw_acc_rad_s2=state.yaw_acc_rad_s2,
            torque_z_N_m=state.drive_z - state.brake_z,
            measured_torque_z_N_m=state.drive_z - seen * state.brake_z,
            specific_force_x_m_s2=state.acc_x_m_s2 + gravity_x,
            specific_force_y_m_s2=state.yaw_rate_rad_s * state.speed_x_m_s + gravity_y,
            heading_rad=state.heading_rad,
            wheel_speed_x_m_s=state.speed_x_m_s,
            force_rate_x_N_s=np.zeros_like(time_s),
            slope_rad=np.full_like(time_s, self.body.slope_rad),
            squat_rad=np.zeros_like(time_s),
            nose_up_rate_rad_s=np.zeros_like(time_s),
            mass_kg=np.full_like(time_s, self.body.mass_kg),
        )


def _label_motion_phases(state: MotionState) -> NDArray[np.str_]:
    """Names of the phases of motion (n,), derived from the state."""
    stands, turns = state.speed_x_m_s == 0.0, state.yaw_rate_rad_s != 0.0
    return np.select(
        [turns & stands, turns, stands, state.speed_x_m_s * state.acc_x_m_s2 >= 0.0],
        ["spinning", "turning", "standstill", "accelerating"],
        default="braking",
    )
