"""Reject trials and shifts that cannot be driven: no start, no stop, too fast."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.simulation.motion.body import RigidBody
from analysis.simulation.scenario.manoeuvres import Arc, Excite, Manoeuvre, Spin, Start, Travel
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.scenario.shift_plan import SimulatedShift
from analysis.simulation.scenario.simulation_limits import LIMITS
from analysis.simulation.sensors.recorder import get_topic_rate_hz, list_recorded_topics
from analysis.simulation.trials.arc import make_arc_phases_and_times
from analysis.simulation.trials.switches import refuse_settings_without_plant_support
from estimators.errors import ScenarioError

#: What of `[starts]` holds for the starts of a shift too.
_HABITS: Final = {"throttle_least", "throttle_most", "coulomb_std_N", "stick_share", "stick_hz"}


def refuse_undrivable_scenario(scenario: Scenario, loads_kg: Sequence[float]) -> None:
    """Raise an error if the scenario cannot be driven with one of the loads.

    Args:
        scenario: scenario from a file or built in Python.
        loads_kg: the loads to simulate.

    Raises:
        ScenarioError: the scenario cannot be driven; the message names the key and the fault.
    """
    machine, full_N = scenario.machine, scenario.campaign.throttle_force_N
    refuse_settings_without_plant_support(scenario)
    if (
        scenario.log.latency_jitter_s
        * max(get_topic_rate_hz(scenario, topic) for topic in list_recorded_topics(scenario))
        >= 1
    ):
        raise ScenarioError(
            "log.latency_jitter_s: must be shorter than the period of every topic, "
            "so that messages are recorded in order"
        )
    if 0 < machine.slip_stiffness_N < full_N:
        raise ScenarioError(
            "machine.slip_stiffness_N: at full throttle the wheels would slip more than 100 %; "
            f"give more than {full_N:g}, or 0 for none"
        )
    loads_kg = [*loads_kg, *_list_changed_loads_kg(scenario, loads_kg)]
    bodies = [
        RigidBody.make_loaded_body(scenario, load_kg) for load_kg in (min(loads_kg), max(loads_kg))
    ]
    for body in bodies:
        square = body.first_moment_x_kg_m**2 + body.first_moment_y_kg_m**2
        if body.inertia_z_kg_m2 * body.mass_kg <= square:
            least = machine.inertia_z_kg_m2 + square / body.mass_kg - body.inertia_z_kg_m2
            raise ScenarioError(
                "machine.inertia_z_kg_m2: is about the origin, so that it is more than mass times "
                f"the square of the centre of mass's distance; give more than {least:.0f}"
            )
    trial = scenario.campaign.manoeuvres_of_trial
    limits = _TrialLimits(
        scenario, *bodies, turns=any(_does_manoeuvre_turn_machine(manoeuvre) for manoeuvre in trial)
    )
    for number, manoeuvre in enumerate(trial):
        key = f"campaign.manoeuvres.{number}" if scenario.campaign.manoeuvres else ""
        limits.refuse_undrivable_manoeuvre(manoeuvre, key)


def _list_changed_loads_kg(scenario: Scenario, first_loads_kg: Sequence[float]) -> list[float]:
    """Loads of starts that differ from the load at the beginning of the log."""
    loading = scenario.loading
    if not (loading.alternating or loading.change_before_start):
        return []
    changed = [load_kg + loading.change_kg for load_kg in first_loads_kg]
    if min(changed) < 0.0:
        raise ScenarioError(
            f"loading.change_kg: leaves {min(changed):g} kg in the bucket; "
            "take off no more than campaign.loads_kg"
        )
    return changed


def _does_manoeuvre_turn_machine(manoeuvre: Manoeuvre) -> bool:
    match manoeuvre:
        case Spin():
            return True
        case Arc():
            return manoeuvre.yaw_rate_rad_s != 0.0
        case Excite():
            return manoeuvre.torque is not None
        case _:
            return False


@dataclass(frozen=True)
class _TrialLimits:
    scenario: Scenario
    lightest: RigidBody
    heaviest: RigidBody
    #: Whether the trial turns, so that the slope may come from anywhere.
    turns: bool

    def refuse_undrivable_manoeuvre(self, manoeuvre: Manoeuvre, scenario_key: str) -> None:
        match manoeuvre:
            case Start():
                self._refuse_undrivable_start(manoeuvre, scenario_key)
            case Spin():
                self._refuse_undrivable_spin(manoeuvre, scenario_key)
            case Excite():
                self._refuse_undrivable_excitation(manoeuvre, scenario_key)
            case Arc():
                self._refuse_undrivable_arc(manoeuvre, scenario_key)
            case Travel():
                self._refuse_undrivable_travel(manoeuvre, scenario_key)
            case _:
                pass

    def _compute_largest_rolling_resistance_deceleration_m_s2(self) -> float:
        """Largest deceleration by rolling resistance of a slow machine."""
        terrain = self.scenario.terrain
        return (
            self.scenario.rolling.highest_coefficient
            * terrain.gravity_m_s2
            * math.cos(terrain.slope_rad)
        )

    def _compute_largest_uphill_deceleration_m_s2(self, sign: float) -> float:
        """Largest deceleration by gravity when driving along `sign`."""
        uphill = self.heaviest.uphill_m_s2
        return -abs(uphill) if self.turns else sign * uphill

    def _refuse_undrivable_start(self, start: Start, scenario_key: str) -> None:
        campaign = self.scenario.campaign
        sign = 1.0 if start.direction == "forward" else -1.0
        along = sign * self.heaviest.uphill_m_s2
        worst = abs(along) if self.turns else along
        full_N = campaign.throttle_force_N * campaign.drive_fraction_at_throttle(start.throttle)
        coulomb_N = self.heaviest.coulomb_x_N
        resistance_N = coulomb_N + self.heaviest.mass_kg * (
            worst + self._compute_largest_rolling_resistance_deceleration_m_s2()
        )
        reached_N = full_N * -math.expm1(-start.start_s / campaign.valve_lag_s)
        if reached_N <= resistance_N:
            where = f"in {scenario_key or 'campaign'}.start_s"
            raise ScenarioError(
                f"{scenario_key or 'campaign.throttle_force_N'}: "
                f"the driving force reaches {reached_N:.0f} N {where}, but "
                f"slope and friction resist {self.heaviest.mass_kg:g} kg with "
                f"{resistance_N:.0f} N; raise the force or reduce slope or friction"
            )
        light = self.lightest
        downhill = self._compute_largest_uphill_deceleration_m_s2(sign)
        push_N = full_N - coulomb_N - light.mass_kg * downhill
        if push_N > LIMITS.top_speed_m_s * max(
            light.friction_x_N_s_m, light.mass_kg / start.start_s
        ):
            raise ScenarioError(
                f"{scenario_key or 'campaign.throttle_force_N'}: drives the machine beyond "
                f"{LIMITS.top_speed_m_s:g} m/s in {scenario_key or 'campaign'}.start_s; "
                "lower one of them"
            )
        self._refuse_brakes_weaker_than_slope(downhill)

    def _refuse_undrivable_spin(self, spin: Spin, scenario_key: str) -> None:
        campaign = self.scenario.campaign
        full_N_m = self.scenario.full_throttle_force_and_torque[
            1
        ] * campaign.drive_fraction_at_throttle(spin.throttle)
        reached_N_m = full_N_m * -math.expm1(-spin.start_s / campaign.valve_lag_s)
        resistance_N_m = (
            self.heaviest.coulomb_z_N_m + self._compute_largest_slope_torque_newton_metres()
        )
        if reached_N_m <= resistance_N_m:
            raise ScenarioError(
                f"{scenario_key}: the driving torque reaches {reached_N_m:.0f} N·m in start_s, but "
                f"slope and Coulomb friction resist with {resistance_N_m:.0f} N·m; raise the "
                "torque or reduce slope or friction"
            )
        slowest = max(self.lightest.friction_z_N_m_s, self.lightest.inertia_z_kg_m2 / spin.start_s)
        if full_N_m > LIMITS.top_yaw_rate_rad_s * slowest:
            raise ScenarioError(
                f"{scenario_key}: turns the machine faster than "
                f"{LIMITS.top_yaw_rate_rad_s:g} rad/s in start_s; lower throttle or start_s"
            )
        self._refuse_brakes_weaker_than_slope(0.0)

    def _refuse_undrivable_excitation(self, excitation: Excite, scenario_key: str) -> None:
        light, force, torque = self.lightest, excitation.force, excitation.torque
        highest_N = max(map(abs, force.value_range)) if force else 0.0
        highest_N_m = max(map(abs, torque.value_range)) if torque else 0.0
        self._refuse_drive_beyond_full_throttle(highest_N, highest_N_m, scenario_key)
        push_N = highest_N + light.mass_kg * abs(light.uphill_m_s2)
        slow = max(light.friction_x_N_s_m, light.mass_kg / excitation.duration_s)
        if force and push_N > LIMITS.top_speed_m_s * slow:
            raise ScenarioError(
                f"{scenario_key}.force: drives the machine beyond {LIMITS.top_speed_m_s:g} m/s; "
                "lower it"
            )
        slow = max(light.friction_z_N_m_s, light.inertia_z_kg_m2 / excitation.duration_s)
        if highest_N_m > LIMITS.top_yaw_rate_rad_s * slow:
            raise ScenarioError(
                f"{scenario_key}.torque: turns the machine faster than "
                f"{LIMITS.top_yaw_rate_rad_s:g} rad/s; lower it"
            )
        self._refuse_brakes_weaker_than_slope(-abs(light.uphill_m_s2))

    def _refuse_undrivable_travel(self, travel: Travel, scenario_key: str) -> None:
        campaign = self.scenario.campaign
        if travel.in_motion and (
            len(campaign.manoeuvres_of_trial) > 1 or campaign.runs > 1 or campaign.rest_s
        ):
            raise ScenarioError(
                f"{scenario_key}.in_motion: "
                f"a log that begins and ends in motion holds one manoeuvre: "
                "remove the other [[campaign.trial]] entries and set campaign.runs = 1 and "
                "campaign.rest_s = 0"
            )
        self._refuse_brakes_weaker_than_slope(-abs(self.lightest.uphill_m_s2))

    def _refuse_undrivable_arc(self, arc: Arc, scenario_key: str) -> None:
        time_s = np.linspace(0.0, arc.ramp_s * 2.0 + arc.duration_s, 200)
        for body in (self.lightest, self.heaviest):
            state = make_arc_phases_and_times(body, arc, 0.0, 0.0)[0][0].state(time_s)
            sides = np.maximum(abs(state.drive_x) / 2, abs(state.brake_x) / 2)
            torque = np.maximum(abs(state.drive_z), abs(state.brake_z))
            worst = int(np.argmax(sides + torque / self.scenario.machine.track_width_m))
            self._refuse_drive_beyond_full_throttle(
                2.0 * float(sides[worst]), float(torque[worst]), scenario_key
            )

    def _refuse_drive_beyond_full_throttle(
        self, force_N: float, torque_N_m: float, scenario_key: str
    ) -> None:
        """Raise an error if a side exceeds full throttle with its part of force and torque."""
        side_N = force_N / 2.0 + torque_N_m / self.scenario.machine.track_width_m
        full_N = self.scenario.campaign.throttle_force_N / 2.0
        if side_N > full_N * (1.0 + 1e-9):
            raise ScenarioError(
                f"{scenario_key}: asks for {side_N:.0f} N on one side, more than full throttle "
                f"gives, {full_N:.0f} N; ask for less, or raise campaign.throttle_force_N"
            )

    def _refuse_brakes_weaker_than_slope(self, downhill_acceleration_m_s2: float) -> None:
        braking = self.scenario.campaign.braking_m_s2
        if braking + downhill_acceleration_m_s2 < LIMITS.min_braking_m_s2:
            raise ScenarioError(
                f"campaign.braking_m_s2: {braking:g} does not stop the machine on this slope; "
                f"give at least {LIMITS.min_braking_m_s2 - downhill_acceleration_m_s2:.2f}"
            )
        spin_N_m = (braking - LIMITS.min_braking_m_s2) * 2.0 / self.scenario.machine.track_width_m
        if (
            self.lightest.inertia_z_kg_m2 * spin_N_m
            < self._compute_largest_slope_torque_newton_metres()
        ):
            raise ScenarioError(
                f"campaign.braking_m_s2: {braking:g} does not stop a spin on this slope; "
                "give a larger value"
            )

    def _compute_largest_slope_torque_newton_metres(self) -> float:
        """Largest torque of the slope about the origin, in N·m."""
        if not self.turns:
            return 0.0
        moment = max(
            math.hypot(body.first_moment_x_kg_m, body.first_moment_y_kg_m)
            for body in (self.lightest, self.heaviest)
        )
        return moment * abs(self.heaviest.uphill_m_s2)


def refuse_undrivable_shift(scenario: Scenario, shift: SimulatedShift) -> None:
    """Raise an error if a shift cannot be driven.

    Raises:
        ScenarioError: the shift cannot be driven; the message names the key and the fault.
    """
    campaign, machine, rate = scenario.campaign, scenario.machine, shift.turn_rad_s
    changed = {f"loading.{key}" for key in scenario.loading.model_dump(exclude_defaults=True)}
    habits = set(scenario.starts.model_dump(exclude_defaults=True)) - _HABITS
    changed |= {f"starts.{key}" for key in habits}
    changed |= {"campaign.manoeuvres"} if campaign.manoeuvres else set()
    if changed:
        raise ScenarioError(
            f"{min(changed)}: applies to campaigns only; leave out either this key or the section "
            "'shift'"
        )
    if shift.fuel_tank_kg >= machine.mass_kg:
        raise ScenarioError("shift.fuel_tank_kg: is part of machine.mass_kg; give less")
    needed_N_m = (
        machine.friction_z_N_m_s * rate
        + machine.coulomb_z_N_m
        + machine.inertia_z_kg_m2 * rate**2 / 2.0
    )
    if needed_N_m > scenario.full_throttle_force_and_torque[1]:
        raise ScenarioError(
            f"shift.turn_rad_s: takes up to {needed_N_m:.0f} N·m, more than full throttle gives, "
            f"{scenario.full_throttle_force_and_torque[1]:.0f} N·m; turn slower"
        )
    both = tuple(
        Start(direction=direction, throttle=scenario.starts.throttle_least)
        for direction in ("forward", "reverse")
    )
    driven = scenario.model_copy(
        update={"campaign": campaign.model_copy(update={"manoeuvres": both}), "shift": None}
    )
    try:
        refuse_undrivable_scenario(driven, [0.0, shift.load_most_kg])
    except ScenarioError as fault:
        named = re.sub(
            r"campaign\.manoeuvres\.\d+(\.start_s)?", "starts.throttle_least", str(fault)
        )
        raise ScenarioError(named) from None
