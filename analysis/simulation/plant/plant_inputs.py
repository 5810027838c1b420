"""Inputs of the compiled machine model: constants of machine and ground, and a stage of a drive."""

import math
from typing import NamedTuple

import numpy as np

from analysis.simulation.scenario.scenario import Scenario
from estimators.arrays import Floats


class MachineAndGround(NamedTuple):
    """Constants of machine and ground in a log."""

    friction_N_s_m: float
    air_N_s2_m2: float
    spring_N_m: float
    friction_warming: float
    coulomb_warming: float
    warming_s: float
    lag_s: float
    power_W: float
    no_load_m_s: float
    efficiency: float
    rotating_kg: float
    #: (n, 2) highest speed of each gear in m/s, and its equivalent rotating mass in kg.
    gears: Floats
    wheel_share: float
    resonance_rad_s: float
    damping: float
    squat_s2_m: float
    squat_s2_m_kg: float
    pitch_1_kg: float
    empty_kg: float
    squat_rad_s: float
    squat_damping: float
    boom_N: float
    boom_rad_s: float
    gravity_m_s2: float
    slope_rad: float
    hills_rad: float
    hills_wavenumber_rad_m: float
    hills_phase_rad: float
    drag_N: float
    rolling: float
    second_ground_more: float
    ground_length_m: float
    rolling_growth_s_m: float
    rolling_growth_s_rad: float


class DriveStage(NamedTuple):
    """A stage of a manoeuvre: commands and resistances; times since the log began."""

    start_s: float
    mass_kg: float
    drive_N: float = 0.0
    brake_N: float = 0.0
    #: 1: the brakes hold the machine against any force.
    holds: float = 0.0
    #: Direction in which a standing machine may start; brakes hold it against the other direction.
    one_way: float = 0.0
    fill_kg_s: float = 0.0
    #: Load of which the fraction `spill_1_s` falls off per second, with its momentum.
    load_kg: float = 0.0
    spill_1_s: float = 0.0
    coulomb_N: float = 0.0
    release_N: float = 0.0
    release_from_s: float = 0.0
    release_s: float = 0.0
    digging_N: float = 0.0
    digging_from_s: float = 0.0
    digging_s: float = 1.0
    stick_share: float = 0.0
    stick_rad_s: float = 0.0
    turn_rad_s: float = 0.0
    scrub_N_s_rad: float = 0.0
    #: Deceleration by unmeasured brakes, which also hold the machine on its slope.
    gentle_m_s2: float = 0.0
    gentle_from_s: float = 0.0
    #: Gain of a pedal that follows target speeds, in N per m/s of speed error, and its limits.
    pedal_N_s_m: float = 0.0
    most_drive_N: float = 0.0
    most_brake_N: float = 0.0
    #: Direction of the target speed: 1 forwards, -1 in reverse; braking by motor (1) or brakes (0).
    way: float = 1.0
    motor_brakes: float = 0.0
    #: 1 if the machine faces along the way, -1 against it.
    facing: float = 1.0


def make_machine_and_ground_of_scenario(scenario: Scenario) -> MachineAndGround:
    """Constants of machine and ground of a scenario."""
    drivetrain, chassis, terrain = scenario.drivetrain, scenario.chassis, scenario.terrain
    rolling = scenario.rolling
    boom_rad_s = 2.0 * math.pi / chassis.boom_period_s
    return MachineAndGround(
        friction_N_s_m=scenario.machine.friction_N_s_m,
        air_N_s2_m2=scenario.machine.air_N_s2_m2,
        spring_N_m=scenario.machine.spring_N_m,
        friction_warming=scenario.machine.friction_warming,
        coulomb_warming=scenario.machine.coulomb_warming,
        warming_s=scenario.machine.warming_s,
        lag_s=scenario.campaign.valve_lag_s,
        power_W=drivetrain.power_limit_W,
        no_load_m_s=drivetrain.no_load_speed_m_s,
        efficiency=drivetrain.efficiency,
        rotating_kg=drivetrain.rotating_kg,
        gears=np.array(
            list(
                zip((*drivetrain.gear_up_m_s, math.inf), drivetrain.gear_rotating_kg, strict=False)
            ),
            np.float64,
        ).reshape(-1, 2),
        wheel_share=drivetrain.wheel_mass_share,
        resonance_rad_s=2.0 * math.pi * drivetrain.resonance_hz,
        damping=drivetrain.resonance_damping,
        squat_s2_m=math.radians(chassis.squat_deg_s2_m),
        squat_s2_m_kg=math.radians(chassis.squat_deg_s2_m_kg),
        pitch_1_kg=math.radians(chassis.pitch_deg_kg),
        empty_kg=scenario.machine.mass_kg,
        squat_rad_s=2.0 * math.pi * chassis.squat_hz,
        squat_damping=chassis.squat_damping,
        boom_N=chassis.boom_kg * chassis.boom_stroke_m / 2.0 * boom_rad_s**2,
        boom_rad_s=boom_rad_s,
        gravity_m_s2=terrain.gravity_m_s2,
        slope_rad=terrain.slope_rad,
        hills_rad=math.radians(terrain.hills_deg),
        hills_wavenumber_rad_m=terrain.hill_wavenumber_rad_m,
        hills_phase_rad=math.radians(terrain.hills_phase_deg),
        drag_N=scenario.brakes.drag_N,
        rolling=rolling.coefficient,
        second_ground_more=rolling.second_ground_more,
        ground_length_m=rolling.ground_length_m,
        rolling_growth_s_m=rolling.growth_s_m,
        rolling_growth_s_rad=rolling.growth_s_rad,
    )
