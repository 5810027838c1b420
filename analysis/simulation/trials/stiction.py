"""Equations of motion with Coulomb friction that slides or sticks, integrated between changes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from analysis.simulation.motion.body import LongitudinalYawPair, RigidBody
from analysis.simulation.motion.solved_motion import MotionPhase, MotionState
from analysis.simulation.scenario.simulation_limits import LIMITS
from estimators.arrays import Floats

#: Parts of the state for x (v, drive, brake) and for z (ω, drive, brake, heading).
_ROWS: Final = (slice(0, 3), slice(3, 7))
#: Indices of v and ω in the state.
RATES: Final = (0, 3)


class Commands(NamedTuple):
    """Commands of the operator.

    `drive` gives force and torque at a time in s since the trial began, with kinks at `kinks_s`;
    `brake` is constant.
    """

    drive: Callable[[float], tuple[float, float]]
    brake: tuple[float, float] = (0.0, 0.0)
    kinks_s: Sequence[float] = ()


@dataclass(frozen=True)
class StictionMotion:
    """The machine under commands, with a fixed state of friction.

    Attributes:
        body: machine with its load.
        valve_lag_s: time constant of drive and brakes.
        free: whether x and z follow the commands; the drive keeps other axes still.
        friction_signs: sign of Coulomb friction on x and z; None if it holds the axis.
    """

    body: RigidBody
    valve_lag_s: float
    free: tuple[bool, bool]
    friction_signs: tuple[float | None, float | None]

    def compute_net_force_and_torque(
        self, state: Floats | tuple[float, ...]
    ) -> LongitudinalYawPair:
        """Net force and torque for the state, (7,) or (7, n), including sliding friction."""
        v, drive_x, brake_x, omega, drive_z, brake_z, heading = state
        applied = LongitudinalYawPair(drive_x - brake_x, drive_z - brake_z)
        body, friction_signs = self.body, self.friction_signs
        net_x, net_z = body.subtract_friction_and_gravity(
            applied, LongitudinalYawPair(v, omega), heading
        )
        return LongitudinalYawPair(
            net_x - body.max_holding_force_and_torque[0] * (friction_signs[0] or 0.0),
            net_z - body.max_holding_force_and_torque[1] * (friction_signs[1] or 0.0),
        )

    def compute_accelerations(
        self, net_force_and_torque: LongitudinalYawPair
    ) -> LongitudinalYawPair:
        """dv/dt and ω̇ of the axes that are free and not held."""
        return self.body.compute_accelerations(net_force_and_torque, self._are_axes_free)

    @property
    def _are_axes_free(self) -> tuple[bool, bool]:
        x, z = (self.free[axis] and self.friction_signs[axis] is not None for axis in (0, 1))
        return x, z

    def compute_required_holding_force_and_torque(self, state: Floats) -> tuple[float, float]:
        """Force and torque that sticking friction must balance in the state (7,)."""
        net = self.compute_net_force_and_torque(state)
        acceleration = self.compute_accelerations(net)
        mc_y = self.body.first_moment_y_kg_m
        return float(net.x + mc_y * acceleration.z), float(net.z + mc_y * acceleration.x)

    def compute_friction_law_violation(self, state: Floats) -> float:
        """Violation of the friction law by the friction signs, for axes at rest in the state (7,).

        It is 0 if sticking friction does not exceed its limit, and sliding friction opposes the
        motion that begins. As the inertia is positive definite, exactly one pair of signs is
        consistent.
        """
        pull, acceleration = (
            self.compute_required_holding_force_and_torque(state),
            self.compute_accelerations(self.compute_net_force_and_torque(state)),
        )
        inertia = (self.body.mass_kg, self.body.inertia_z_kg_m2)
        wrong = 0.0
        for axis in (0, 1):
            sign = self.friction_signs[axis]
            if sign is None:
                wrong += max(abs(pull[axis]) - self.body.max_holding_force_and_torque[axis], 0.0)
            elif state[RATES[axis]] == 0.0:
                wrong += max(-sign * float(acceleration[axis]) * inertia[axis], 0.0)
        return wrong

    def integrate_until_stiction_changes(
        self,
        name: str | None,
        start_s: float,
        end_s: float,
        state: Floats,
        commands: Commands,
        *,
        stops_at_rest: bool = False,
    ) -> tuple[MotionPhase, Floats, list[int]]:
        """Integrate from `state` (7,) to `end_s` or the first change of a friction sign.

        Returns:
            The phase, the last state, and the axes (0, 1) on which friction releases or the motion
            ends (with Coulomb friction, or if `stops_at_rest`).
        """
        from scipy.integrate import solve_ivp

        rows = np.r_[tuple(_ROWS[axis] for axis in (0, 1) if self.free[axis])]

        def expand_to_full_state(part: Floats) -> Floats:
            whole = np.empty((7, *part.shape[1:]))
            whole.T[...] = state
            whole[rows] = part
            return whole

        changes = [
            axis
            for axis in (0, 1)
            if self.free[axis]
            and (stops_at_rest or self.body.max_holding_force_and_torque[axis] > LIMITS.min_grip)
        ]
        solution = solve_ivp(
            self._make_state_rates(state, commands),
            (start_s, end_s),
            state[rows],
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
            dense_output=True,
            events=[_StictionChange(self, axis, expand_to_full_state) for axis in changes] or None,
        )
        assert solution.sol is not None
        last_s = float(solution.t[-1])
        phase = MotionPhase(
            name,
            start_s,
            last_s,
            self._make_state_function(expand_to_full_state, solution.sol),
        )
        found: Sequence[Floats] = solution.t_events or ()
        changed = [axis for axis, at in zip(changes, found, strict=True) if at.size]
        return phase, expand_to_full_state(solution.sol(np.array([last_s])))[:, 0], changed

    def _make_state_rates(
        self, state: Floats, commands: Commands
    ) -> Callable[[float, Floats], list[float]]:
        still: list[float] = state.tolist()
        lag_s, (brake_x, brake_z) = self.valve_lag_s, commands.brake
        free_x, free_z = self.free
        moves = self._are_axes_free
        net_of, accelerations, drive = (
            self.compute_net_force_and_torque,
            self.body.compute_accelerations,
            commands.drive,
        )

        def state_rates(time_s: float, part: Floats) -> list[float]:
            # plain numbers, since it is called tens of thousands of times
            moving: list[float] = part.tolist()
            x = moving[:3] if free_x else still[:3]
            z = moving[-4:] if free_z else still[3:]
            dv, turn = accelerations(net_of((*x, *z)), moves)
            force, torque = drive(time_s)
            rate: list[float] = []
            if free_x:
                rate += [float(dv), (force - x[1]) / lag_s, (brake_x - x[2]) / lag_s]
            if free_z:
                rate += [float(turn), (torque - z[1]) / lag_s, (brake_z - z[2]) / lag_s, z[0]]
            return rate

        return state_rates

    def _make_state_function(
        self, full_state: Callable[[Floats], Floats], solution: Callable[[Floats], Floats]
    ) -> Callable[[Floats], MotionState]:
        def states_at(time_s: Floats) -> MotionState:
            v, drive_x, brake_x, omega, drive_z, brake_z, heading = whole = full_state(
                solution(time_s)
            )
            acceleration = self.compute_accelerations(self.compute_net_force_and_torque(whole))
            kept = self.body.compute_required_force_and_torque(
                LongitudinalYawPair(v, omega), acceleration, heading, LongitudinalYawPair(0.0, 0.0)
            )
            if not self.free[0]:
                v, drive_x, brake_x = 0.0 * v, np.asarray(kept.x), 0.0 * v
            if not self.free[1]:
                omega, drive_z, brake_z = 0.0 * v, np.asarray(kept.z), 0.0 * v
            dv, turn = np.broadcast_arrays(*acceleration, v)[:2]
            return MotionState(v, dv, drive_x, brake_x, omega, turn, drive_z, brake_z, heading)

        return states_at


class _StictionChange:
    """Event for solve_ivp: friction releases, or an axis stops."""

    terminal = True

    def __init__(
        self, machine: StictionMotion, axis: int, full: Callable[[Floats], Floats]
    ) -> None:
        sign = machine.friction_signs[axis]
        self.direction = 1.0 if sign is None else -sign
        self._machine, self._axis, self._full = machine, axis, full

    def __call__(self, _time_s: float, part: Floats) -> float:
        machine, axis, state = self._machine, self._axis, self._full(part)
        if machine.friction_signs[axis] is None:
            return (
                abs(machine.compute_required_holding_force_and_torque(state)[axis])
                - machine.body.max_holding_force_and_torque[axis]
            )
        return float(state[RATES[axis]])
