"""Driver of the integrated plant, manoeuvre by manoeuvre, from standstill to standstill."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from analysis.simulation.motion.body import RigidBody
from analysis.simulation.motion.solved_motion import ManoeuvreTimes
from analysis.simulation.plant import plant
from analysis.simulation.plant.integrated_motion import (
    BRAKING,
    FREE,
    OPEN,
    REST,
    STEADY,
    TURNING,
    RowBuffer,
)
from analysis.simulation.plant.plant_inputs import DriveStage, make_machine_and_ground_of_scenario
from analysis.simulation.plant.resistance import (
    compute_cold_friction_fraction,
    compute_rolling_resistance_newtons,
)
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.scenario.simulation_limits import LIMITS
from analysis.simulation.sensors.random_streams import make_random_generator
from estimators.arrays import Floats
from estimators.errors import ScenarioError


class DrivenStart(NamedTuple):
    """Times of a start, and the masses that were filled in and that fell off."""

    times: ManoeuvreTimes
    filled_kg: float
    spilled_kg: float


@dataclass(frozen=True)
class StartOrder:
    """Command to the operator for one start.

    Attributes:
        sign: 1 forwards, -1 in reverse.
        throttle: fraction of full throttle.
        start_s: duration of open throttle.
        cruise_s: time at constant speed after that.
        coast_s: time without throttle before braking.
        digging_N: resistance of the pile when the throttle is shut.
        digging_s: time before the throttle is shut in which the resistance grows.
        fill_kg_s: growth of the load until the throttle is shut.
        load_kg: load at the start.
        spill_1_s: fraction of the load that falls off per second.
        distance_m: distance after which the machine stands again; None to cruise for `cruise_s`.
    """

    sign: float
    throttle: float
    start_s: float
    cruise_s: float = 0.0
    coast_s: float = 0.0
    digging_N: float = 0.0
    digging_s: float = 1.0
    fill_kg_s: float = 0.0
    load_kg: float = 0.0
    spill_1_s: float = 0.0
    distance_m: float | None = None


class MachineDriver:
    """Drives manoeuvres one after the other, and records the motion.

    Args:
        scenario: scenario with machine and ground.
        load_kg: load in the bucket when the log begins.
        load_index: index of the log in the campaign, for the random numbers of its starts.
    """

    def __init__(self, scenario: Scenario, load_kg: float, load_index: int) -> None:
        self.time_s = 0.0
        self.kept = RowBuffer()
        self.scenario = scenario
        self.state = plant.make_state_at_rest()
        self.starts = 0
        #: 1 if the machine faces uphill where the ground slopes up, -1 if downhill.
        self.facing = 1.0
        self._machine = make_machine_and_ground_of_scenario(scenario)
        self._load_index = load_index
        if self._machine.resonance_rad_s:
            self.state[plant.STRETCH] = self._compute_driveline_stretch_at_start_m(
                scenario.machine.mass_kg + load_kg
            )
        if scenario.chassis.squat_hz:
            self.state[plant.PITCH] = self._machine.pitch_1_kg * load_kg
        fastest = max(
            scenario.drivetrain.resonance_hz, scenario.chassis.squat_hz, scenario.starts.stick_hz
        )
        lag_s = scenario.campaign.valve_lag_s
        #: Whether a machine at standstill still moves internally.
        drivetrain, chassis = scenario.drivetrain, scenario.chassis
        self._swings = bool(drivetrain.resonance_hz or chassis.squat_hz or chassis.boom_kg)
        self._step_s = min(
            LIMITS.step_s, 1.0 / (LIMITS.steps_per_swing * fastest), lag_s / LIMITS.steps_per_lag
        )

    @property
    def position_m(self) -> float:
        """Position of the machine along the way, in m."""
        return float(self.state[plant.POSITION])

    def reserve_rows(self, duration_s: float) -> None:
        """Reserve memory for a drive of this duration."""
        self.kept.reserve_rows(
            math.ceil((duration_s + 2.0 * LIMITS.driver_max_stop_s) / self._step_s)
        )

    def stand_still(self, duration_s: float, mass_kg: float) -> ManoeuvreTimes:
        """Stand with the brakes on."""
        start_s = self.time_s
        self.state[[plant.DRIVE, plant.BRAKE]] = 0.0
        stage = DriveStage(self.time_s, mass_kg, holds=1.0, facing=self.facing)
        self.integrate_stage(REST, stage, duration_s, step_count=None if self._swings else 1)
        return ManoeuvreTimes("rest", start_s, None, None, None, self.time_s)

    def turn_around(self, rate_rad_s: float, mass_kg: float) -> ManoeuvreTimes:
        """Turn by 180° on the spot, with a cosine-shaped yaw rate up to `rate_rad_s`."""
        start_s, duration_s = self.time_s, 2.0 * math.pi / abs(rate_rad_s)
        self.state[[plant.DRIVE, plant.BRAKE]] = 0.0
        stage = DriveStage(self.time_s, mass_kg, holds=1.0, facing=self.facing)
        steps = (
            max(LIMITS.half_turn_steps, math.ceil(duration_s / self._step_s))
            if self._swings
            else None
        )
        rows = self.integrate_stage(
            TURNING, stage, duration_s, step_count=steps or LIMITS.half_turn_steps
        )
        phase = (rows[:, plant.TIME] - start_s) / duration_s * 2.0 * math.pi
        turned = (phase - np.sin(phase)) / 2.0
        rows[:, plant.YAW_RATE] = rate_rad_s * (1.0 - np.cos(phase)) / 2.0
        # the part of the slope's force that the brakes hold
        rows[:, plant.BRAKED] *= np.cos(turned)
        rows[[0, -1], plant.YAW_RATE] = 0.0
        self.facing = -self.facing
        return ManoeuvreTimes("spin", start_s, start_s, None, None, self.time_s)

    def drive_one_start(self, start_order: StartOrder, body: RigidBody) -> DrivenStart:
        """Drive one start: throttle, cruise, coast if ordered, brake.

        Returns:
            Times of the start, mass filled in and mass fallen off, in kg.

        Raises:
            ScenarioError: the machine does not move, does not stop, or becomes too fast.
        """
        campaign, starts, brakes = (
            self.scenario.campaign,
            self.scenario.starts,
            self.scenario.brakes,
        )
        start_s, start_m = self.time_s, self.position_m
        steady_s = start_s + start_order.start_s
        shut_s = steady_s + start_order.cruise_s
        full_N = (
            start_order.sign
            * campaign.throttle_force_N
            * campaign.drive_fraction_at_throttle(start_order.throttle)
        )
        opened = DriveStage(
            start_s,
            body.mass_kg,
            drive_N=full_N,
            one_way=start_order.sign,
            fill_kg_s=start_order.fill_kg_s,
            load_kg=start_order.load_kg,
            spill_1_s=start_order.spill_1_s,
            coulomb_N=body.coulomb_x_N,
            release_N=brakes.release_N,
            release_from_s=start_s,
            release_s=brakes.release_s,
            digging_N=start_order.digging_N,
            digging_from_s=shut_s - start_order.digging_s,
            digging_s=start_order.digging_s,
            stick_share=starts.stick_share,
            stick_rad_s=2.0 * math.pi * starts.stick_hz,
            turn_rad_s=starts.turn_rad_s,
            scrub_N_s_rad=starts.scrub_N_s_rad,
            facing=self.facing,
        )
        self.state[plant.DRIVE] = 0.0
        self.integrate_stage(OPEN, opened, start_order.start_s)
        if not self._moved:
            raise ScenarioError(
                f"start {self.starts} does not move {body.mass_kg:g} kg with "
                f"{abs(full_N):.0f} N; raise campaign.throttle_force_N or starts.throttle_least"
            )
        filled_kg = start_order.fill_kg_s * start_order.start_s

        def compute_spilled_kg() -> float:
            return start_order.load_kg * -math.expm1(
                -start_order.spill_1_s * (self.time_s - start_s)
            )

        def stage_from_now(stage: DriveStage) -> DriveStage:
            lost_kg = compute_spilled_kg()
            return stage._replace(
                start_s=self.time_s,
                mass_kg=body.mass_kg + filled_kg - lost_kg,
                load_kg=start_order.load_kg - lost_kg,
            )

        steady = stage_from_now(opened)._replace(one_way=0.0, stick_share=0.0)
        cruise_s = start_order.cruise_s
        if start_order.distance_m is not None:
            cruise_s = self._compute_cruise_duration_s(
                abs(self.position_m - start_m), start_order.distance_m, body
            )
        lead_s = min(brakes.gentle_lead_s, cruise_s) if brakes.gentle_m_s2 else 0.0
        keeping = steady._replace(drive_N=self._compute_cruise_force_newtons(steady, full_N))
        self.integrate_stage(STEADY, keeping, cruise_s - lead_s)
        filled_kg += start_order.fill_kg_s * (cruise_s - lead_s)
        braking_s = self.time_s
        braked = stage_from_now(keeping)._replace(
            fill_kg_s=0.0, gentle_m_s2=brakes.gentle_m_s2, gentle_from_s=braking_s
        )
        if lead_s:
            self.integrate_stage(BRAKING, braked, lead_s)
        shut = stage_from_now(braked)._replace(drive_N=0.0)
        if start_order.coast_s:
            self.integrate_stage(FREE, shut, start_order.coast_s)
        if not brakes.gentle_m_s2:
            braking_s = self.time_s
        self.brake_to_stop(stage_from_now(shut))
        self.starts += 1
        times = ManoeuvreTimes("start", start_s, start_s, steady_s, braking_s, self.time_s)
        return DrivenStart(times, filled_kg, compute_spilled_kg())

    def brake_to_stop(self, stage: DriveStage) -> None:
        """Brake until the machine stands.

        Raises:
            ScenarioError: the machine does not stop.
        """
        speed = float(self.state[plant.WHEEL])
        if speed == 0.0:
            return
        gentle_m_s2 = self.scenario.brakes.gentle_m_s2
        if gentle_m_s2 and not stage.gentle_m_s2:
            stage = stage._replace(gentle_m_s2=gentle_m_s2, gentle_from_s=stage.start_s)
        braking_m_s2 = 0.0 if gentle_m_s2 else self.scenario.campaign.braking_m_s2
        brake_N = math.copysign(stage.mass_kg * braking_m_s2, speed)
        self.integrate_stage(
            BRAKING, stage._replace(brake_N=brake_N), LIMITS.driver_max_stop_s, ends_at_rest=True
        )
        if self.state[plant.WHEEL] != 0.0:
            raise ScenarioError(
                "campaign.braking_m_s2: does not stop the machine on this slope; give a larger "
                "value"
            )

    def integrate_stage(
        self,
        stage_kind: int,
        stage: DriveStage,
        duration_s: float,
        wave: Floats | None = None,
        *,
        ends_at_rest: bool = False,
        step_count: int | None = None,
    ) -> Floats:
        """Integrate a stage, and return its recorded rows (n, 16).

        Raises:
            ScenarioError: the machine becomes too fast.
        """
        step_count = step_count or max(math.ceil(duration_s / self._step_s - 1e-9), 1)
        rows = self.kept.provide_free_rows(2 * step_count + 4)
        self.time_s, kept, self._moved = plant.integrate_stage_until_end_or_standstill(
            stage.start_s + duration_s,
            step_count,
            ends_at_rest,
            self.state,
            self._machine,
            stage,
            np.empty(0) if wave is None else wave,
            LIMITS.wave_step_s,
            rows,
        )
        if np.abs(rows[:kept, 1 + plant.WHEEL]).max() > LIMITS.top_speed_m_s:
            raise ScenarioError(
                "campaign.throttle_force_N: drives the machine beyond "
                f"{LIMITS.top_speed_m_s:g} m/s; lower it"
            )
        self.kept.commit_rows(kept, stage_kind)
        return rows[:kept]

    def compute_uphill_gravity_m_s2(self) -> float:
        """Component of gravity against the machine's forward direction at its position, in m/s²."""
        slope_rad = self.scenario.terrain.compute_slope_rad(self.position_m)
        return self.facing * self._machine.gravity_m_s2 * math.sin(slope_rad)

    def make_body_with_cold_friction(self, body: RigidBody, time_s: float) -> RigidBody:
        """Copy of the body with the friction of a machine that is still warming up at this time."""
        viscous, coulomb = self._cold_viscous_and_coulomb_fractions(time_s)
        return replace(
            body,
            friction_x_N_s_m=body.friction_x_N_s_m * viscous,
            coulomb_x_N=body.coulomb_x_N * coulomb,
        )

    def _cold_viscous_and_coulomb_fractions(self, time_s: float) -> tuple[float, float]:
        """Remaining fractions of cold viscous and Coulomb friction at a time."""
        viscous, coulomb = self._machine.friction_warming, self._machine.coulomb_warming
        warming_s = self._machine.warming_s
        return compute_cold_friction_fraction(
            time_s, viscous, warming_s
        ), compute_cold_friction_fraction(time_s, coulomb, warming_s)

    def draw_coulomb_friction_newtons(self) -> float:
        """Draw the Coulomb friction of the next start in N, on a cold machine."""
        drawn = self._make_random_generator("start_coulomb").standard_normal()
        varied = self.scenario.starts.coulomb_std_N * float(drawn)
        return max(self.scenario.machine.coulomb_N + varied, 0.0)

    def draw_throttle_fraction(self) -> float:
        """Draw the throttle fraction of the next start."""
        starts = self.scenario.starts
        return float(
            self._make_random_generator("start_throttle").uniform(
                starts.throttle_least, starts.throttle_most
            )
        )

    def _make_random_generator(self, stream: str) -> np.random.Generator:
        return make_random_generator(
            self.scenario.sensors.seed, self._load_index, self.starts, stream
        )

    def _compute_cruise_duration_s(
        self, driven_m: float, distance_m: float, body: RigidBody
    ) -> float:
        """Cruise duration in s after which the machine stops at about the ordered distance."""
        speed = abs(float(self.state[plant.WHEEL]))
        campaign = self.scenario.campaign
        stop_m = speed * (campaign.valve_lag_s + 0.5 * speed / campaign.braking_m_s2)
        if self.scenario.brakes.gentle_m_s2:
            stop_m = self._compute_gentle_stopping_distance_m(speed, body)
        return max((distance_m - driven_m - stop_m) / max(speed, 0.05), LIMITS.min_cruise_s)

    def _compute_gentle_stopping_distance_m(self, speed_m_s: float, body: RigidBody) -> float:
        """Stopping distance under gentle brakes and friction, in m."""
        gripping = body.max_holding_force_and_torque[0] / body.mass_kg
        braking_m_s2 = self.scenario.brakes.gentle_m_s2 + gripping
        viscous_1_s = max(body.friction_x_N_s_m / body.mass_kg, 1e-3)
        slowed = braking_m_s2 / viscous_1_s
        stop_m = (speed_m_s - slowed * math.log1p(speed_m_s / slowed)) / viscous_1_s
        return stop_m + speed_m_s * self.scenario.campaign.valve_lag_s

    def _compute_driveline_stretch_at_start_m(self, mass_kg: float) -> float:
        """Elongation of the driveline's spring by the slope at the start of a log, in m."""
        wheel_kg = self._machine.wheel_share * mass_kg + self._machine.rotating_kg
        body_kg = mass_kg * (1.0 - self._machine.wheel_share)
        reduced_kg = wheel_kg * body_kg / (wheel_kg + body_kg)
        pull_N = body_kg * self.compute_uphill_gravity_m_s2()
        return pull_N / (reduced_kg * self._machine.resonance_rad_s**2)

    def compute_rolling_resistance_here_newtons(
        self, mass_kg: float, speed_m_s: float = 0.0, turn_rad_s: float = 0.0
    ) -> float:
        """Rolling resistance of a mass at the machine's position, in N."""
        slope_rad = float(self.scenario.terrain.compute_slope_rad(self.position_m))
        return compute_rolling_resistance_newtons(
            self.position_m, speed_m_s, turn_rad_s, mass_kg, slope_rad, self._machine
        )

    def _compute_cruise_force_newtons(self, stage: DriveStage, full_force_N: float) -> float:
        """Drive force in N that keeps the speed on the present slope, limited by the throttle."""
        speed, sign = float(self.state[plant.WHEEL]), math.copysign(1.0, full_force_N)
        turned = abs(stage.turn_rad_s) if speed else 0.0
        viscous, coulomb = self._cold_viscous_and_coulomb_fractions(self.time_s)
        resistance_N = stage.coulomb_N * coulomb + self._machine.drag_N
        resistance_N += stage.scrub_N_s_rad * turned
        resistance_N += self.compute_rolling_resistance_here_newtons(stage.mass_kg, speed, turned)
        needed_N = (
            self._machine.friction_N_s_m * viscous * speed
            + self._machine.air_N_s2_m2 * abs(speed) * speed
            + self.facing * self._machine.spring_N_m * self.position_m
            + stage.mass_kg * self.compute_uphill_gravity_m_s2()
            + stage.fill_kg_s * speed
            + sign * resistance_N
        )
        efficiency = self._machine.efficiency
        needed_N = needed_N / efficiency if needed_N * sign > 0.0 else needed_N * efficiency
        if self._machine.no_load_m_s:
            needed_N /= max(1.0 - abs(speed) / self._machine.no_load_m_s, 1e-3)
        most_N = self.scenario.campaign.throttle_force_N
        return min(max(needed_N, -most_N), most_N)
