"""The equation of motion of one run, solved without noise.

    m dv/dt = F_drive - F_brake - b v - F_c sign(v) - m g sin(slope)

The x row of the paper's (4) with the friction of (7), Coulomb friction and slope beside it. Drive
and brakes follow their commands with the valve's first-order lag. The machine drives forward alone;
while it stands with the throttle closed, the brakes hold it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.scenario import Scenario

Floats: TypeAlias = NDArray[np.float64]

#: Far beyond any stop: a scenario keeps below 50 m/s and brakes with at least 0.1 m/s².
_LONGEST_STOP_S = 86_400.0


class Phase(NamedTuple):
    """A part of a run, times in s since the run began.

    `state` takes times (n,) and gives (3, n): speed in m/s, drive force and brake force in N.
    """

    name: str
    start_s: float
    end_s: float
    state: Callable[[Floats], Floats]


class Channels(NamedTuple):
    """The motion at n instants, each (n,): no noise, and nothing of the sensors in it."""

    phase: NDArray[np.str_]
    speed_x_m_s: Floats
    acc_x_m_s2: Floats
    #: All force along x but friction and gravity.
    force_x_N: Floats
    #: The part of it that torque sensors on all wheels would see.
    measured_force_x_N: Floats


@dataclass(frozen=True)
class Dynamics:
    """The forces on one machine with one load, and its motion under constant commands."""

    mass_kg: float
    friction_N_s_m: float
    coulomb_N: float
    #: What gravity pulls back with: m g sin(slope).
    slope_force_N: float
    valve_lag_s: float

    @property
    def resistance(self) -> float:
        """The drive force in N that only just keeps the machine creeping forward."""
        return self.coulomb_N + self.slope_force_N

    def acceleration(self, force_N: Floats, speed_m_s: Floats) -> Floats:
        """Acceleration in m/s² while moving forward under drive less brake force."""
        return (force_N - self.friction_N_s_m * speed_m_s - self.resistance) / self.mass_kg

    def breakaway_s(self, throttle_force_N: float) -> float:
        """How long after the throttle opens the drive force overcomes slope and friction."""
        return -self.valve_lag_s * math.log1p(-max(self.resistance / throttle_force_N, 0.0))

    def stalled(self, start_s: float, throttle_force_N: float) -> Callable[[Floats], Floats]:
        """The state before breakaway; the brakes let go as the drive takes over the slope."""

        def state(time_s: Floats) -> Floats:
            drive = throttle_force_N * -np.expm1(-(time_s - start_s) / self.valve_lag_s)
            brake = np.minimum(drive - self.slope_force_N, 0.0)
            return np.stack([np.zeros_like(time_s), drive, brake])

        return state

    def move(
        self,
        name: str,
        start_s: float,
        end_s: float | None,
        start: Floats,
        command_N: tuple[float, float],
    ) -> Phase:
        """Move from the state `start` (3,) until `end_s`, or without one until the machine stands.

        `command_N` are the drive and brake force that the operator asks for throughout.
        """
        from scipy.integrate import solve_ivp

        def rates(_time_s: float, state: Floats) -> Floats:
            acceleration = self.acceleration(state[1] - state[2], state[0])
            return np.array([acceleration, *(command_N - state[1:]) / self.valve_lag_s])

        solution = solve_ivp(
            rates,
            (start_s, start_s + _LONGEST_STOP_S if end_s is None else end_s),
            start,
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
            dense_output=True,
            events=_Stop() if end_s is None else None,
        )
        assert solution.sol is not None
        return Phase(name, start_s, float(solution.t[-1]), solution.sol)


class _Stop:
    """Ends an integration where the speed falls to zero, in the form that solve_ivp asks for."""

    terminal = True
    direction = -1.0

    def __call__(self, _time_s: float, state: Floats) -> float:
        return float(state[0])


@dataclass(frozen=True)
class Motion:
    """One run with one load; outside its phases the machine stands, held by the brakes."""

    dynamics: Dynamics
    brake_measured_share: float
    phases: tuple[Phase, ...]

    @property
    def duration_s(self) -> float:
        """From standstill to standstill."""
        return self.phases[-1].end_s

    def sample(self, time_s: Floats) -> Channels:
        """The channels at times (n,) in s since the run began; any time before or after stands."""
        name = np.full(time_s.shape, "standstill", dtype="<U12")
        state = np.zeros((3, *time_s.shape))
        state[2] = -self.dynamics.slope_force_N
        for phase in self.phases:
            inside = (time_s >= phase.start_s) & (time_s < phase.end_s)
            if inside.any():  # a short phase may fall between two samples
                name[inside] = phase.name
                state[:, inside] = phase.state(time_s[inside])
        speed, drive, brake = state[0], state[1], state[2]
        acceleration = self.dynamics.acceleration(drive - brake, speed)
        return Channels(
            phase=name,
            speed_x_m_s=speed,
            acc_x_m_s2=np.where(name == "standstill", 0.0, acceleration),
            force_x_N=drive - brake,
            measured_force_x_N=drive - self.brake_measured_share * brake,
        )


def solve_run(scenario: Scenario, load_kg: float) -> Motion:
    """Solve one run: stand, break away, full throttle, cruise, brake to a stop.

    Returns:
        The motion; its phases are standstill (with the throttle opening), accelerating, cruising
        and braking, in this order.
    """
    campaign, machine, terrain = scenario.campaign, scenario.machine, scenario.terrain
    mass_kg = machine.mass_kg + load_kg
    dynamics = Dynamics(
        mass_kg=mass_kg,
        friction_N_s_m=machine.friction_N_s_m,
        coulomb_N=machine.coulomb_N,
        slope_force_N=mass_kg * terrain.gravity_m_s2 * math.sin(terrain.slope_rad),
        valve_lag_s=campaign.valve_lag_s,
    )
    throttle_N = campaign.throttle_force_N
    throttle_s = campaign.standstill_s
    breakaway_s = throttle_s + dynamics.breakaway_s(throttle_N)
    cruise_s = throttle_s + campaign.start_s
    braking_s = cruise_s + campaign.cruise_s

    state = dynamics.stalled(throttle_s, throttle_N)
    stalled = Phase("standstill", throttle_s, breakaway_s, state)
    breakaway = _at(stalled, breakaway_s) * (1.0, 1.0, 0.0)  # the brakes have let go
    accelerating = dynamics.move(
        "accelerating", breakaway_s, cruise_s, breakaway, (throttle_N, 0.0)
    )
    top = _at(accelerating, cruise_s)
    keeping_N = dynamics.friction_N_s_m * float(top[0]) + dynamics.resistance
    cruising = dynamics.move("cruising", cruise_s, braking_s, top, (keeping_N, 0.0))
    braking = dynamics.move(
        "braking",
        braking_s,
        None,
        _at(cruising, braking_s),
        (0.0, mass_kg * campaign.braking_m_s2),
    )
    return Motion(
        dynamics, campaign.brake_measured_share, (stalled, accelerating, cruising, braking)
    )


def _at(phase: Phase, time_s: float) -> Floats:
    return phase.state(np.array([time_s]))[:, 0]
