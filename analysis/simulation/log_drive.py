"""Drive the trials of a log one after the other: what the operator asks for, integrated."""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from analysis.simulation import plant
from analysis.simulation.body import RigidBody
from analysis.simulation.integrated import BRAKING, FREE, OPEN, REST, STEADY, IntegratedLog
from analysis.simulation.kept_rows import KeptRows
from analysis.simulation.manoeuvres import Excite, Manoeuvre, Rest, Start
from analysis.simulation.motion import ManoeuvreTimes
from analysis.simulation.plant import DriveStage, Plant
from analysis.simulation.scenario import Scenario
from analysis.simulation.streams import generator
from analysis.simulation.timeline import DrivenManoeuvre
from analysis.simulation.waveforms import Floats
from estimators.errors import ScenarioError

#: One step: a hundredth of the lag of the paper's machine; forces interpolated in it are 0.2 N off.
_STEP_S: Final = 0.001
#: Steps in a period of the fastest thing that swings, and in the lag of the valves.
_STEPS_A_SWING: Final = 40
_STEPS_A_LAG: Final = 4
_LONGEST_STOP_S: Final = 120.0
_TOP_SPEED_M_S: Final = 50.0
_WAVE_STEP_S: Final = 0.001


def integrate_log(scenario: Scenario, load_kg: float, load_index: int) -> IntegratedLog:
    """Drive all trials of one log, without noise.

    Args:
        scenario: the machine, the ground and the manoeuvres of a trial; straight ones.
        load_kg: in the bucket when the log begins.
        load_index: index of the log in the campaign, which starts that differ are drawn from.

    Raises:
        ScenarioError: a machine does not start, does not stop, or goes too fast.
    """
    driver = _Driver(scenario, load_kg, load_index)
    trial_s = [0.0]
    for trial in range(scenario.campaign.runs):
        for number, manoeuvre in enumerate(scenario.campaign.trial):
            driver.drive(trial, number, manoeuvre, trial_s[-1])
        trial_s.append(driver.time_s)
    driver.rest(scenario.campaign.rest_s + _STEP_S)
    return IntegratedLog(
        scenario,
        np.array(trial_s),
        tuple(driver.driven),
        driver.kept.rows,
        driver.kept.stages,
    )


def plant_of(scenario: Scenario) -> Plant:
    """The constants of a log."""
    drivetrain, chassis, terrain = scenario.drivetrain, scenario.chassis, scenario.terrain
    boom_rad_s = 2.0 * math.pi / chassis.boom_period_s
    return Plant(
        friction_N_s_m=scenario.machine.friction_N_s_m,
        lag_s=scenario.campaign.valve_lag_s,
        power_W=drivetrain.power_limit_W,
        no_load_m_s=drivetrain.no_load_speed_m_s,
        efficiency=drivetrain.efficiency,
        rotating_kg=drivetrain.rotating_kg,
        wheel_share=drivetrain.wheel_mass_share,
        resonance_rad_s=2.0 * math.pi * drivetrain.resonance_hz,
        damping=drivetrain.resonance_damping,
        squat_s2_m=math.radians(chassis.squat_deg_s2_m),
        squat_rad_s=2.0 * math.pi * chassis.squat_hz,
        squat_damping=chassis.squat_damping,
        boom_N=chassis.boom_kg * chassis.boom_stroke_m / 2.0 * boom_rad_s**2,
        boom_rad_s=boom_rad_s,
        gravity_m_s2=terrain.gravity_m_s2,
        slope_rad=terrain.slope_rad,
        hills_rad=math.radians(terrain.hills_deg),
        hills_rad_m=terrain.hills_rad_m,
        hills_phase_rad=math.radians(terrain.hills_phase_deg),
        drag_N=scenario.brakes.drag_N,
    )


class _Driver:
    """Drives one manoeuvre after the other, and keeps what happens."""

    def __init__(self, scenario: Scenario, load_kg: float, load_index: int) -> None:
        self.time_s = 0.0
        self.kept = KeptRows()
        self.driven: list[DrivenManoeuvre] = []
        self._scenario, self._load_kg, self._load_index = scenario, load_kg, load_index
        self._plant = plant_of(scenario)
        self._state = plant.still()
        self._starts = 0
        if self._plant.resonance_rad_s:
            self._state[plant.STRETCH] = self._sag_m()
        fastest = max(
            scenario.drivetrain.resonance_hz, scenario.chassis.squat_hz, scenario.starts.stick_hz
        )
        lag_s = scenario.campaign.valve_lag_s
        #: Whether anything goes on in a machine that stands.
        drivetrain, chassis = scenario.drivetrain, scenario.chassis
        self._swings = bool(drivetrain.resonance_hz or chassis.squat_hz or chassis.boom_kg)
        self._step_s = min(_STEP_S, 1.0 / (_STEPS_A_SWING * fastest), lag_s / _STEPS_A_LAG)

    def drive(self, trial: int, number: int, manoeuvre: Manoeuvre, trial_begin_s: float) -> None:
        """One manoeuvre, from standing to standing."""
        load_kg = self._load_kg + self._scenario.loading.added_kg(self._starts)
        body = RigidBody.loaded(self._scenario, load_kg)
        load_end_kg, direction, throttle = load_kg, None, None
        match manoeuvre:
            case Rest():
                begin_s = self.time_s
                self.rest(manoeuvre.duration_s)
                times = ManoeuvreTimes("rest", begin_s, None, None, None, self.time_s)
            case Start():
                body = replace(body, coulomb_x_N=self._coulomb())
                sign = self._sign(manoeuvre)
                direction = "forward" if sign > 0.0 else "reverse"
                throttle = manoeuvre.throttle * self._throttle()
                times, filled_kg = self._start(manoeuvre, body, sign, throttle)
                load_end_kg += filled_kg
                self._starts += 1
            case Excite():
                times = self._excite(manoeuvre, body)
            case _:
                raise ScenarioError(
                    f"campaign.manoeuvres.{number}: a {manoeuvre.kind} cannot be integrated"
                )
        since = times._replace(
            **{
                name: value - trial_begin_s
                for name, value in times._asdict().items()
                if isinstance(value, float)
            }
        )
        self.driven.append(
            DrivenManoeuvre(trial, number, since, body, load_kg, load_end_kg, direction, throttle)
        )

    def rest(self, duration_s: float) -> None:
        """Stand, held by the brakes."""
        self._state[[plant.DRIVE, plant.BRAKE]] = 0.0
        body = RigidBody.loaded(self._scenario, self._load_kg)
        stage = DriveStage(self.time_s, body.mass_kg, holds=1.0)
        self._advance(REST, stage, duration_s, steps=None if self._swings else 1)

    def _start(
        self, start: Start, body: RigidBody, sign: float, throttle: float
    ) -> tuple[ManoeuvreTimes, float]:
        """Throttle, cruise, perhaps coast, brake; the times, and what has been filled in."""
        campaign, starts = self._scenario.campaign, self._scenario.starts
        brakes, fill_kg_s = self._scenario.brakes, self._scenario.loading.fill_kg_s
        begin_s = self.time_s
        steady_s = begin_s + start.start_s
        shut_s = steady_s + start.cruise_s
        full_N = sign * campaign.throttle_force_N * campaign.valve(throttle)
        opened = DriveStage(
            begin_s,
            body.mass_kg,
            drive_N=full_N,
            one_way=sign,
            fill_kg_s=fill_kg_s,
            coulomb_N=body.coulomb_x_N,
            release_N=brakes.release_N,
            release_from_s=begin_s,
            release_s=brakes.release_s,
            digging_N=start.digging_N,
            digging_from_s=shut_s - start.digging_s,
            digging_s=start.digging_s,
            stick_share=starts.stick_share,
            stick_rad_s=2.0 * math.pi * starts.stick_hz,
            turn_rad_s=starts.turn_rad_s,
            scrub_N_s_rad=starts.scrub_N_s_rad,
        )
        self._state[plant.DRIVE] = 0.0
        self._advance(OPEN, opened, start.start_s)
        if not self._moved:
            raise ScenarioError(
                f"start {self._starts} does not move {body.mass_kg:g} kg with "
                f"{abs(full_N):.0f} N; raise campaign.throttle_force_N or starts.throttle_least"
            )
        filled_kg = fill_kg_s * start.start_s
        steady = opened._replace(
            begin_s=self.time_s, mass_kg=body.mass_kg + filled_kg, one_way=0.0, stick_share=0.0
        )
        self._advance(
            STEADY, steady._replace(drive_N=self._keeping(steady, full_N)), start.cruise_s
        )
        filled_kg += fill_kg_s * start.cruise_s
        shut = steady._replace(
            begin_s=self.time_s, mass_kg=body.mass_kg + filled_kg, drive_N=0.0, fill_kg_s=0.0
        )
        if start.coast_s:
            self._advance(FREE, shut, start.coast_s)
        braking_s = self.time_s
        self._brake(shut._replace(begin_s=self.time_s))
        times = ManoeuvreTimes("start", begin_s, begin_s, steady_s, braking_s, self.time_s)
        return times, filled_kg

    def _excite(self, excite: Excite, body: RigidBody) -> ManoeuvreTimes:
        """A waveform of the drive force, then brakes."""
        begin_s, force = self.time_s, excite.force
        assert force is not None
        since_s = np.arange(0.0, excite.duration_s + 2.0 * _WAVE_STEP_S, _WAVE_STEP_S)
        wave = np.array([self._scenario.driven(float(value), 0.0)[0] for value in force(since_s)])
        stage = DriveStage(begin_s, body.mass_kg, coulomb_N=body.coulomb_x_N)
        uphill = self._plant.gravity_m_s2 * math.sin(self._slope_rad())
        self._state[plant.BRAKE] = -body.mass_kg * uphill
        self._advance(FREE, stage, excite.duration_s, wave)
        braking_s = self.time_s
        self._brake(stage._replace(begin_s=braking_s))
        return ManoeuvreTimes("excite", begin_s, begin_s, None, braking_s, self.time_s)

    def _brake(self, stage: DriveStage) -> None:
        speed = float(self._state[plant.WHEEL])
        if speed == 0.0:
            return
        brake_N = math.copysign(stage.mass_kg * self._scenario.campaign.braking_m_s2, speed)
        self._advance(BRAKING, stage._replace(brake_N=brake_N), _LONGEST_STOP_S, stops=True)
        if self._state[plant.WHEEL] != 0.0:
            raise ScenarioError("campaign.braking_m_s2: does not stop the machine on this ground")

    def _advance(
        self,
        kind: int,
        stage: DriveStage,
        duration_s: float,
        wave: Floats | None = None,
        *,
        stops: bool = False,
        steps: int | None = None,
    ) -> None:
        steps = steps or max(math.ceil(duration_s / self._step_s - 1e-9), 1)
        rows = self.kept.room(2 * steps + 4)
        self.time_s, kept, self._moved = plant.advance(
            stage.begin_s + duration_s,
            steps,
            stops,
            self._state,
            self._plant,
            stage,
            np.empty(0) if wave is None else wave,
            _WAVE_STEP_S,
            rows,
        )
        if np.abs(rows[:kept, 1 + plant.WHEEL]).max() > _TOP_SPEED_M_S:
            raise ScenarioError(
                f"campaign.throttle_force_N: drives the machine beyond {_TOP_SPEED_M_S:g} m/s"
            )
        self.kept.keep(kept, kind)

    def _slope_rad(self) -> float:
        return self._scenario.terrain.slope_at_rad(float(self._state[plant.POSITION]))

    def _sag_m(self) -> float:
        """How far the spring of the driveline is stretched by the slope where a log begins."""
        mass_kg = self._scenario.machine.mass_kg + self._load_kg
        wheel_kg = self._plant.wheel_share * mass_kg + self._plant.rotating_kg
        body_kg = mass_kg * (1.0 - self._plant.wheel_share)
        reduced_kg = wheel_kg * body_kg / (wheel_kg + body_kg)
        pull_N = body_kg * self._plant.gravity_m_s2 * math.sin(self._slope_rad())
        return pull_N / (reduced_kg * self._plant.resonance_rad_s**2)

    def _keeping(self, stage: DriveStage, full_N: float) -> float:
        """The drive force that keeps the speed on this slope, within that of the throttle."""
        speed, sign = float(self._state[plant.WHEEL]), math.copysign(1.0, full_N)
        turned = abs(stage.turn_rad_s) if speed else 0.0
        resistance_N = stage.coulomb_N + self._plant.drag_N + stage.scrub_N_s_rad * turned
        needed_N = (
            self._plant.friction_N_s_m * speed
            + stage.mass_kg * self._plant.gravity_m_s2 * math.sin(self._slope_rad())
            + stage.fill_kg_s * speed
            + sign * resistance_N
        )
        efficiency = self._plant.efficiency
        needed_N = needed_N / efficiency if needed_N * sign > 0.0 else needed_N * efficiency
        if self._plant.no_load_m_s:
            needed_N /= max(1.0 - abs(speed) / self._plant.no_load_m_s, 1e-3)
        most_N = self._scenario.campaign.throttle_force_N
        return min(max(needed_N, -most_N), most_N)

    def _sign(self, start: Start) -> float:
        sign = 1.0 if start.direction == "forward" else -1.0
        turned = self._scenario.starts.directions == "alternating" and self._starts % 2 == 1
        return -sign if turned else sign

    def _throttle(self) -> float:
        starts = self._scenario.starts
        return float(
            self._random("start_throttle").uniform(starts.throttle_least, starts.throttle_most)
        )

    def _coulomb(self) -> float:
        drawn = self._random("start_coulomb").standard_normal()
        varied = self._scenario.starts.coulomb_std_N * float(drawn)
        return max(self._scenario.machine.coulomb_N + varied, 0.0)

    def _random(self, stream: str) -> np.random.Generator:
        seed = self._scenario.sensors.seed
        return generator(seed, self._load_index, self._starts, stream)
