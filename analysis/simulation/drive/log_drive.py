"""Drive the trials of a log one after the other, by integration."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from analysis.simulation.drive.machine_driver import MachineDriver, StartOrder
from analysis.simulation.motion.body import RigidBody
from analysis.simulation.motion.solved_motion import ManoeuvreTimes
from analysis.simulation.motion.timeline import DrivenManoeuvre
from analysis.simulation.plant import plant
from analysis.simulation.plant.integrated_motion import FREE, IntegratedLog
from analysis.simulation.plant.plant import DriveStage
from analysis.simulation.scenario.manoeuvres import Excite, Manoeuvre, Rest, Start, Travel
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.scenario.simulation_limits import LIMITS
from estimators.arrays import Floats
from estimators.errors import ScenarioError


def drive_trials_of_log(scenario: Scenario, load_kg: float, load_index: int) -> IntegratedLog:
    """Drive all trials of one log, without noise.

    Args:
        scenario: scenario with machine, ground and the straight manoeuvres of a trial.
        load_kg: load in the bucket when the log begins.
        load_index: index of the log in the campaign, for the random numbers of its starts.

    Raises:
        ScenarioError: the machine does not start, does not stop, or becomes too fast.
    """
    driver = TrialDriver(scenario, load_kg, load_index)
    asked_s = sum(
        estimate_manoeuvre_duration_s(each) for each in scenario.campaign.manoeuvres_of_trial
    )
    driver.reserve_rows(scenario.campaign.runs * asked_s)
    trial_s = [0.0]
    for trial in range(scenario.campaign.runs):
        for number, manoeuvre in enumerate(scenario.campaign.manoeuvres_of_trial):
            driver.drive_manoeuvre(trial, number, manoeuvre, trial_s[-1])
        trial_s.append(driver.time_s)
    driver.end_log()
    return IntegratedLog(
        scenario,
        np.array(trial_s),
        tuple(driver.driven),
        driver.kept.filled_rows,
        driver.kept.stage_kinds_of_rows,
    )


def estimate_manoeuvre_duration_s(manoeuvre: Manoeuvre) -> float:
    """Approximate duration of a manoeuvre in s, including its stop."""
    match manoeuvre:
        case Rest():
            return 0.0  # a rest has two rows
        case Start():
            return manoeuvre.start_s + manoeuvre.cruise_s + manoeuvre.coast_s + 2.0
        case _:
            return manoeuvre.duration_s + 2.0 if isinstance(manoeuvre, Excite | Travel) else 0.0


class TrialDriver(MachineDriver):
    """Drives the manoeuvres of a trial."""

    def __init__(self, scenario: Scenario, load_kg: float, load_index: int) -> None:
        super().__init__(scenario, load_kg, load_index)
        self.driven: list[DrivenManoeuvre] = []
        self._load_kg = load_kg
        self.mass_kg = RigidBody.make_loaded_body(scenario, load_kg).mass_kg
        #: Whether a standstill has the load of the next start; otherwise, as in earlier versions,
        #: it has the load with which the log began.
        self._stands_loaded = bool(scenario.chassis.pitch_deg_kg or scenario.loading.spill_1_s)
        self._added_kg, self._lost_kg = 0.0, 0.0

    def drive_manoeuvre(
        self, trial: int, manoeuvre_number: int, manoeuvre: Manoeuvre, trial_start_s: float
    ) -> None:
        """Drive one manoeuvre, from standstill to standstill."""
        loading = self.scenario.loading
        added_kg = loading.added_load_kg(self.starts)
        if added_kg != self._added_kg:
            self._added_kg, self._lost_kg = added_kg, 0.0
        load_kg = self._load_kg + added_kg - self._lost_kg
        body = RigidBody.make_loaded_body(self.scenario, load_kg)
        body = replace(body, rolling_x_N=self.compute_rolling_resistance_here_newtons(body.mass_kg))
        if self._stands_loaded:
            self.mass_kg = body.mass_kg
        load_end_kg, direction, throttle = load_kg, None, None
        match manoeuvre:
            case Rest():
                times = self.stand_still(manoeuvre.duration_s, self.mass_kg)
            case Start():
                body = replace(body, coulomb_x_N=self.draw_coulomb_friction_newtons())
                sign = self._choose_start_direction(manoeuvre)
                direction = "forward" if sign > 0.0 else "reverse"
                throttle = manoeuvre.throttle * self.draw_throttle_fraction()
                order = StartOrder(
                    sign,
                    throttle,
                    manoeuvre.start_s,
                    manoeuvre.cruise_s,
                    manoeuvre.coast_s,
                    manoeuvre.digging_N,
                    manoeuvre.digging_s,
                    loading.fill_kg_s,
                    load_kg,
                    loading.spill_1_s,
                )
                times, filled_kg, spilled_kg = self.drive_one_start(order, body)
                load_end_kg += filled_kg - spilled_kg
                self._lost_kg += spilled_kg
                if self._stands_loaded:
                    self.mass_kg = body.mass_kg - spilled_kg
            case Excite():
                times = self._drive_waveform(manoeuvre, body)
            case Travel():
                times = self._follow_target_speeds_by_pedal(manoeuvre, body)
            case _:
                raise ScenarioError(
                    f"campaign.manoeuvres.{manoeuvre_number}: this scenario cannot simulate the "
                    f"manoeuvre '{manoeuvre.kind}'; replace it"
                )
        since = times.subtract_start_time(trial_start_s)
        body = self.make_body_with_cold_friction(body, times.start_s)
        self.driven.append(
            DrivenManoeuvre(
                trial, manoeuvre_number, since, body, load_kg, load_end_kg, direction, throttle
            )
        )

    def _drive_waveform(self, excitation: Excite, body: RigidBody) -> ManoeuvreTimes:
        """Drive with a waveform of the force, then brake."""
        start_s, force = self.time_s, excitation.force
        assert force is not None
        since_s = np.arange(
            0.0, excitation.duration_s + 2.0 * LIMITS.wave_step_s, LIMITS.wave_step_s
        )
        wave = np.array(
            [
                self.scenario.limit_force_and_torque_to_valves(float(value), 0.0)[0]
                for value in force(since_s)
            ]
        )
        stage = DriveStage(start_s, body.mass_kg, coulomb_N=body.coulomb_x_N)
        self.state[plant.BRAKE] = -body.mass_kg * self.compute_uphill_gravity_m_s2()
        self.integrate_stage(FREE, stage, excitation.duration_s, wave)
        braking_s = self.time_s
        self.brake_to_stop(stage._replace(start_s=braking_s))
        return ManoeuvreTimes("excite", start_s, start_s, None, braking_s, self.time_s)

    def _follow_target_speeds_by_pedal(self, travel: Travel, body: RigidBody) -> ManoeuvreTimes:
        """Follow target speeds by a pedal, with brakes and a rest at each stop.

        Raises:
            ScenarioError: the machine does not move.
        """
        start_s, start_m, way = self.time_s, self.position_m, 1.0
        full_N = self.scenario.campaign.throttle_force_N
        stopping_N = body.mass_kg * self.scenario.campaign.braking_m_s2
        self.state[[plant.DRIVE, plant.BRAKE]] = 0.0
        for leg in draw_travel_legs(
            travel, self._make_random_generator("travel"), LIMITS.wave_step_s
        ):
            stage = DriveStage(
                self.time_s,
                body.mass_kg,
                one_way=way,
                coulomb_N=body.coulomb_x_N,
                pedal_N_s_m=body.mass_kg / travel.response_s,
                most_drive_N=full_N,
                most_brake_N=min(stopping_N, full_N) if travel.motor_brakes else stopping_N,
                way=way,
                motor_brakes=float(travel.motor_brakes),
                facing=self.facing,
            )
            if travel.in_motion and self.time_s == start_s:
                self.state[[plant.WHEEL, plant.BODY]] = leg.wanted_m_s[0]
                self.state[plant.DRIVE] = self._compute_cruise_force_newtons(stage, full_N)
            duration_s = (leg.wanted_m_s.size - 1) * LIMITS.wave_step_s
            self.integrate_stage(
                FREE,
                stage,
                duration_s,
                way * leg.wanted_m_s,
                step_count=self._count_pedal_steps(duration_s),
            )
            if not self._moved:
                raise ScenarioError(
                    f"campaign.throttle_force_N: {full_N:.0f} N do not move {body.mass_kg:g} kg; "
                    "raise it"
                )
            if leg.stand_s is not None:
                shut = stage._replace(start_s=self.time_s, pedal_N_s_m=0.0, one_way=0.0)
                self.brake_to_stop(shut)
                self.stand_still(leg.stand_s, body.mass_kg)
                if travel.to_and_fro:
                    way = -1.0 if self.position_m > start_m else 1.0
        self.starts += 1
        return ManoeuvreTimes("travel", start_s, start_s, None, None, self.time_s)

    def _count_pedal_steps(self, duration_s: float) -> int | None:
        """Number of integration steps of a travel; slow driving allows longer ones."""
        slow_s = self.scenario.campaign.valve_lag_s / LIMITS.pedal_steps_per_lag
        return None if self._swings or slow_s <= self._step_s else math.ceil(duration_s / slow_s)

    def end_log(self) -> None:
        """End the log with a rest or, if it ends in motion, just after its last sample."""
        rest_s = self.scenario.campaign.rest_s
        if self.state[plant.WHEEL] == 0.0:
            self.stand_still(rest_s + LIMITS.step_s, self.mass_kg)
        else:
            drive_N = float(self.state[plant.DRIVE])
            stage = DriveStage(self.time_s, self.mass_kg, drive_N=drive_N, facing=self.facing)
            self.integrate_stage(FREE, stage, LIMITS.step_s)

    def _choose_start_direction(self, manoeuvre: Start) -> float:
        sign = 1.0 if manoeuvre.direction == "forward" else -1.0
        turned = self.scenario.starts.directions == "alternating" and self.starts % 2 == 1
        return -sign if turned else sign


class TravelLeg(NamedTuple):
    """Part of a travel from one stop, or the start of the log, to the next stop, or its end.

    Attributes:
        wanted_m_s: (n,) target speed at each step.
        stand_s: duration of the following standstill; None to drive on.
    """

    wanted_m_s: Floats
    stand_s: float | None


def draw_travel_legs(
    travel: Travel, generator: np.random.Generator, step_s: float
) -> Iterator[TravelLeg]:
    """Yield the legs of a travel, with about its duration in total."""
    left_s = travel.duration_s
    speed = 0.0
    parts: list[Floats] = []
    first = travel.in_motion
    while left_s > 0.0:
        target = float(generator.uniform(travel.speed_least_m_s, travel.speed_most_m_s))
        hold_s = float(generator.uniform(travel.hold_least_s, travel.hold_most_s))
        stands = bool(generator.random() < travel.stop_share)
        stand_s = float(generator.uniform(travel.stand_least_s, travel.stand_most_s))
        if first:
            speed, first = target, False
        parts += [
            make_ramp_speeds_m_s(speed, target, travel, step_s),
            np.full(round(hold_s / step_s), target),
        ]
        left_s -= (parts[-2].size + parts[-1].size) * step_s
        speed = target
        ends = left_s <= 0.0
        if stands or (ends and not travel.in_motion):
            parts.append(make_ramp_speeds_m_s(speed, 0.0, travel, step_s))
            yield TravelLeg(np.concatenate(parts), 0.0 if ends else stand_s)
            left_s -= parts[-1].size * step_s + stand_s
            parts, speed = [], 0.0
    if parts:
        yield TravelLeg(np.concatenate(parts), None)


def make_ramp_speeds_m_s(start_m_s: float, end_m_s: float, travel: Travel, step_s: float) -> Floats:
    """Target speeds of a ramp in m/s, one per integration step."""
    steps = round(abs(end_m_s - start_m_s) / travel.acceleration_m_s2 / step_s)
    return np.linspace(start_m_s, end_m_s, steps, endpoint=False)
