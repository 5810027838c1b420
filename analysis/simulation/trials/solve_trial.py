"""Solve a trial exactly: its manoeuvres in order, each from standstill to standstill."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from analysis.simulation.motion.body import LongitudinalYawPair, RigidBody
from analysis.simulation.motion.solved_motion import (
    ManoeuvreTimes,
    MotionPhase,
    MotionState,
    SolvedMotion,
)
from analysis.simulation.scenario.manoeuvres import (
    Arc,
    Excite,
    Manoeuvre,
    Rest,
    Spin,
    Start,
    Travel,
)
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.scenario.simulation_limits import LIMITS
from analysis.simulation.scenario.waveforms import ForceWave, TorqueWave
from analysis.simulation.trials.arc import make_arc_phases_and_times
from analysis.simulation.trials.stiction import RATES, Commands, StictionMotion
from analysis.simulation.trials.switches import find_scenario_key_needing_integration
from analysis.simulation.trials.trial_limits import refuse_undrivable_scenario
from estimators.arrays import Floats
from estimators.errors import DataError, ScenarioError

_STILL = LongitudinalYawPair(0.0, 0.0)


def solve_motion(scenario: Scenario, load_kg: float) -> SolvedMotion:
    """Solve one trial with one load, without noise.

    Monte Carlo trials add noise to the same motion, so it is solved once and sampled often.

    Args:
        scenario: scenario with machine, ground and the manoeuvres of a trial (`campaign.trial`).
        load_kg: load in the bucket.

    Returns:
        The motion; `sample_channels(time_s)` gives its channels at any times.

    Raises:
        ScenarioError: the machine cannot be driven as requested.
    """
    refuse_undrivable_scenario(scenario, [load_kg])
    asked = find_scenario_key_needing_integration(scenario)
    if asked is not None:
        raise ScenarioError(f"{asked}: cannot be solved trial by trial; use simulate_campaign")
    trial = _TrialSolver(scenario, RigidBody.make_loaded_body(scenario, load_kg))
    phases = [trial.stand_at_heading(-math.inf, 0.0, heading_rad=0.0)]
    windows: list[ManoeuvreTimes] = []
    for manoeuvre in scenario.campaign.manoeuvres_of_trial:
        parts, window = trial.solve_manoeuvre(manoeuvre, phases[-1].end_s, _end_heading_rad(phases))
        phases.extend(parts)
        windows.append(window)
    phases.append(trial.stand_at_heading(phases[-1].end_s, math.inf, _end_heading_rad(phases)))
    seen = scenario.campaign.brake_measured_share
    return SolvedMotion(trial.body, seen, tuple(phases), tuple(windows))


def _end_heading_rad(phases: list[MotionPhase]) -> float:
    return float(phases[-1].state(np.array([phases[-1].end_s])).heading_rad[0])


@dataclass(frozen=True)
class _TrialSolver:
    scenario: Scenario
    body: RigidBody

    def solve_manoeuvre(
        self, manoeuvre: Manoeuvre, start_s: float, heading_rad: float
    ) -> tuple[list[MotionPhase], ManoeuvreTimes]:
        """Solve one manoeuvre from standstill at a heading: consecutive phases, and its times."""
        match manoeuvre:
            case Rest():
                end_s = start_s + manoeuvre.duration_s
                phases = [self.stand_at_heading(start_s, end_s, heading_rad)]
                return phases, ManoeuvreTimes("rest", start_s, None, None, None, end_s)
            case Start():
                sign = 1.0 if manoeuvre.direction == "forward" else -1.0
                return self._solve_straight_or_spin(manoeuvre, 0, sign, start_s, heading_rad)
            case Spin():
                sign = 1.0 if manoeuvre.direction == "left" else -1.0
                return self._solve_straight_or_spin(manoeuvre, 1, sign, start_s, heading_rad)
            case Arc():
                return make_arc_phases_and_times(self.body, manoeuvre, start_s, heading_rad)
            case Excite():
                return self._solve_excitation(manoeuvre, start_s, heading_rad)
            case Travel():
                raise AssertionError(
                    "a travel needs a whole log; `find_scenario_key_needing_integration` must "
                    "refuse it"
                )

    def stand_at_heading(self, start_s: float, end_s: float, heading_rad: float) -> MotionPhase:
        """Phase of standing at a heading, held by the brakes."""
        hold = self.body.compute_required_force_and_torque(_STILL, _STILL, heading_rad, _STILL)

        def standing_state(time_s: Floats) -> MotionState:
            zero = np.zeros_like(time_s)
            return MotionState(
                zero, zero, zero, zero - hold.x, zero, zero, zero, zero - hold.z, zero + heading_rad
            )

        return MotionPhase("standstill", start_s, end_s, standing_state)

    def _solve_straight_or_spin(
        self, manoeuvre: Start | Spin, axis: int, sign: float, start_s: float, heading_rad: float
    ) -> tuple[list[MotionPhase], ManoeuvreTimes]:
        """Solve a start or a spin: open throttle, constant speed or yaw rate, braking."""
        campaign = self.scenario.campaign
        full = self.scenario.full_throttle_force_and_torque[
            axis
        ] * campaign.drive_fraction_at_throttle(manoeuvre.throttle)
        lag_s = campaign.valve_lag_s
        steady_s = start_s + manoeuvre.start_s
        braking_s = steady_s + manoeuvre.cruise_s
        names = ("accelerating", "cruising", "braking") if axis == 0 else ("spinning",) * 3
        machine = DrivenMotion(self.body, lag_s, (axis == 0, axis == 1))

        stalled, state = self._solve_stall_until_breakaway(axis, sign, full, start_s, heading_rad)
        asked = Commands(_make_constant_drive_command(axis, sign * full))
        opened, state = machine.integrate_motion_until(
            names[0], stalled.end_s, steady_s, state, asked
        )
        signs = LongitudinalYawPair(sign, 0.0) if axis == 0 else LongitudinalYawPair(0.0, sign)
        rate = LongitudinalYawPair(float(state[0]), float(state[3]))
        keeping = self.body.compute_required_force_and_torque(rate, _STILL, float(state[6]), signs)[
            axis
        ]
        asked = Commands(_make_constant_drive_command(axis, float(keeping)))
        kept, state = machine.integrate_motion_until(names[1], steady_s, braking_s, state, asked)
        braked = machine.integrate_motion_until_rest(
            names[2], braking_s, state, self._brake_commands(state)
        )
        phases = [stalled, *opened, *kept, *braked]
        kind = manoeuvre.kind
        return phases, ManoeuvreTimes(kind, start_s, start_s, steady_s, braking_s, phases[-1].end_s)

    def _solve_stall_until_breakaway(
        self,
        axis: int,
        sign: float,
        full_force_or_torque: float,
        start_s: float,
        heading_rad: float,
    ) -> tuple[MotionPhase, Floats]:
        """Phase in which the throttle opens until the drive overcomes slope and friction.

        The brakes release as the drive takes over the slope.
        """
        hold = self.body.compute_required_force_and_torque(_STILL, _STILL, heading_rad, _STILL)
        against = sign * float(hold[axis])
        coulomb = self.body.max_holding_force_and_torque[axis]
        lag_s = self.scenario.campaign.valve_lag_s
        breakaway_s = start_s - lag_s * math.log1p(
            -max((coulomb + against) / full_force_or_torque, 0.0)
        )

        def opening_drive(time_s: Floats) -> Floats:
            return full_force_or_torque * -np.expm1(-(time_s - start_s) / lag_s)

        def stalled_state(time_s: Floats) -> MotionState:
            zero, opening = np.zeros_like(time_s), opening_drive(time_s)
            driven, braked = sign * opening, sign * np.minimum(opening - against, 0.0)
            held = zero - hold[1 - axis]
            x, z = (
                ((driven, braked), (zero, held)) if axis == 0 else ((zero, held), (driven, braked))
            )
            return MotionState(zero, zero, *x, zero, zero, *z, zero + heading_rad)

        start = np.zeros(7)
        start[1 + 3 * axis] = sign * opening_drive(np.array([breakaway_s]))[0]
        start[6] = heading_rad
        return MotionPhase("standstill", start_s, breakaway_s, stalled_state), start

    def _solve_excitation(
        self, manoeuvre: Excite, start_s: float, heading_rad: float
    ) -> tuple[list[MotionPhase], ManoeuvreTimes]:
        """Solve an excitation: waveforms through the valves of both sides, then braking."""
        force, torque = manoeuvre.force, manoeuvre.torque
        end_s = start_s + manoeuvre.duration_s
        waves: list[ForceWave | TorqueWave] = [wave for wave in (force, torque) if wave]

        def waveform_drive(time_s: float) -> tuple[float, float]:
            since = float(time_s - start_s)
            return self.scenario.limit_force_and_torque_to_valves(
                force(since) if force else 0.0, torque(since) if torque else 0.0
            )

        kinks = [
            start_s + kink for wave in waves for kink in wave.kink_times_s(manoeuvre.duration_s)
        ]
        hold = self.body.compute_required_force_and_torque(_STILL, _STILL, heading_rad, _STILL)
        state = np.array([0.0, 0.0, -hold.x, 0.0, 0.0, -hold.z, heading_rad])
        machine = DrivenMotion(
            self.body, self.scenario.campaign.valve_lag_s, (force is not None, torque is not None)
        )
        asked = Commands(waveform_drive, kinks_s=kinks)
        driven, state = machine.integrate_motion_until(None, start_s, end_s, state, asked)
        braked = machine.integrate_motion_until_rest(
            "braking", end_s, state, self._brake_commands(state)
        )
        phases = [*driven, *braked]
        return phases, ManoeuvreTimes("excite", start_s, start_s, None, end_s, phases[-1].end_s)

    def _brake_commands(self, state: Floats) -> Commands:
        """Commands without drive whose brakes slow all wheels equally on both axes."""
        braking = self.scenario.campaign.braking_m_s2
        spin = braking / (self.scenario.machine.track_width_m / 2.0)
        return Commands(
            _make_constant_drive_command(0, 0.0),
            brake=(
                float(np.sign(state[0])) * (self.body.mass_kg * braking),
                float(np.sign(state[3])) * (self.body.inertia_z_kg_m2 * spin),
            ),
        )


def _make_constant_drive_command(axis: int, value: float) -> Callable[[float], tuple[float, float]]:
    pair = (value, 0.0) if axis == 0 else (0.0, value)

    def commanded_drive(_time_s: float) -> tuple[float, float]:
        return pair

    return commanded_drive


@dataclass(frozen=True)
class DrivenMotion:
    """The machine under commands; the drive prevents motion on an axis that is not free."""

    body: RigidBody
    valve_lag_s: float
    free: tuple[bool, bool]

    def integrate_motion_until(
        self,
        phase_name: str | None,
        start_s: float,
        end_s: float,
        state: Floats,
        commands: Commands,
    ) -> tuple[list[MotionPhase], Floats]:
        """Integrate the motion under the commands from `start_s` to `end_s`.

        Args:
            phase_name: name of the phases.
            start_s: start of the integration, since the trial began.
            end_s: end of the integration, since the trial began.
            state: (7,) v, drive and brake force, ω, drive and brake torque, heading.
            commands: the commands.

        Returns:
            The phases and the last state.

        Raises:
            DataError: no state of Coulomb friction on both axes is consistent.
        """
        phases: list[MotionPhase] = []
        machine = self._find_consistent_stiction(state, self.free)
        for stage_s in [*(k for k in sorted(commands.kinks_s) if start_s < k < end_s), end_s]:
            while start_s < stage_s:
                phase, state, changed = machine.integrate_until_stiction_changes(
                    phase_name, start_s, stage_s, state, commands
                )
                phases.append(phase)
                start_s = phase.end_s
                if changed:
                    _refuse_endless_stick_slip(phases)
                    state[[RATES[axis] for axis in changed]] = 0.0
                    loose = [axis for axis in changed if machine.friction_signs[axis] is None]
                    machine = self._find_consistent_stiction(state, self.free, loose)
        return phases, state

    def integrate_motion_until_rest(
        self, phase_name: str | None, start_s: float, state: Floats, commands: Commands
    ) -> list[MotionPhase]:
        """Integrate the motion under the commands from `state` (7,) until both axes stand."""
        phases: list[MotionPhase] = []
        moving = [axis for axis in (0, 1) if self.free[axis] and state[RATES[axis]] != 0.0]
        while moving:
            machine = self._find_consistent_stiction(state, free_axes=(0 in moving, 1 in moving))
            last_s = start_s + LIMITS.trial_max_stop_s
            phase, state, stood = machine.integrate_until_stiction_changes(
                phase_name, start_s, last_s, state, commands, stops_at_rest=True
            )
            phases.append(phase)
            start_s = phase.end_s
            state[[RATES[axis] for axis in stood]] = 0.0
            moving = [axis for axis in moving if axis not in stood]
        return phases

    def _find_consistent_stiction(
        self, state: Floats, free_axes: tuple[bool, bool], released_axes: Sequence[int] = ()
    ) -> StictionMotion:
        """Consistent state of friction in `state`, just after it released `released_axes`."""
        choices: list[tuple[float | None, ...]] = []
        for axis in (0, 1):
            rate = float(state[RATES[axis]])
            if (
                not free_axes[axis]
                or rate != 0.0
                or self.body.max_holding_force_and_torque[axis] <= LIMITS.min_grip
            ):
                choices.append((float(np.sign(rate)),))
            else:
                choices.append((1.0, -1.0) if axis in released_axes else (None, 1.0, -1.0))
        grips = product(choices[0], choices[1])
        machines = [
            StictionMotion(self.body, self.valve_lag_s, free_axes, friction_signs)
            for friction_signs in grips
        ]
        return min(machines, key=lambda machine: machine.compute_friction_law_violation(state))


def _refuse_endless_stick_slip(phases: Sequence[MotionPhase]) -> None:
    """Raise an error if friction sticks and slips without advancing."""
    recent = phases[-LIMITS.max_changes_at_once :]
    if len(recent) == LIMITS.max_changes_at_once and recent[-1].end_s - recent[0].start_s < 1e-9:
        raise DataError(
            f"the direction of Coulomb friction cannot be solved for at {recent[-1].end_s:g} s of "
            "the run; change machine.coulomb_N or machine.coulomb_z_N_m slightly"
        )
