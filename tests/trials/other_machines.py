"""Machines that are no loaders, drawn at random: two cars, a bus, a cart, a test rack, an arm.

None digs or dumps. Each is a scenario of one travel (`Travel`), a log for each load.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from analysis.simulation.scenario.scenario import Scenario

#: Standard gravity, which a force in proportion to the weight is taken with, in m/s².
_G_M_S2: Final = 9.80665
#: Radius of the yaw inertia of all of them, in m: they drive straight.
_GYRATION_M: Final = 1.2


def car(seed: int, loads_kg: Sequence[float] = (0.0,)) -> Scenario:
    """On hills, with a gearbox in whose low gears more mass rotates, logged at 10 Hz.

    A sensor at the hubs sees the brakes.
    """
    dice = np.random.default_rng([seed, 20_281])
    mass_kg = dice.uniform(1300.0, 1900.0)
    shifts_m_s = np.array([6.0, 11.0, 17.0, 24.0]) * dice.uniform(0.8, 1.2)
    return _scenario(
        seed,
        10.0,
        (20.0, 0.02),
        loads_kg,
        machine={"mass_kg": mass_kg, "friction_N_s_m": 8.0, "air_N_s2_m2": 0.4},
        rolling={"coefficient": 180.0 / (mass_kg * _G_M_S2)},
        terrain={"hills_deg": dice.uniform(0.2, 1.0), "hills_length_m": dice.uniform(150.0, 600.0)},
        drivetrain={
            "gear_up_m_s": tuple(shifts_m_s),
            "gear_rotating_kg": tuple(mass_kg * np.array([0.25, 0.12, 0.06, 0.04, 0.03])),
        },
        campaign={"throttle_force_N": 3.0 * mass_kg, "braking_m_s2": 3.0, "valve_lag_s": 0.25},
        travel={
            "duration_s": 600.0,
            "speed_least_m_s": 8.0,
            "speed_most_m_s": 28.0,
            "hold_least_s": 5.0,
            "hold_most_s": 20.0,
            "stop_share": 0.5,
            "acceleration_m_s2": 1.8,
        },
    )


def electric_car(seed: int, loads_kg: Sequence[float] = (0.0,)) -> Scenario:
    """Whose motor brakes it, on hills, at 50 Hz."""
    dice = np.random.default_rng([seed, 20_282])
    mass_kg = dice.uniform(1600.0, 2200.0)
    return _scenario(
        seed,
        50.0,
        (60.0, 0.01),
        loads_kg,
        machine={"mass_kg": mass_kg, "friction_N_s_m": 10.0, "air_N_s2_m2": 0.45},
        rolling={"coefficient": 200.0 / (mass_kg * _G_M_S2)},
        terrain={"hills_deg": dice.uniform(0.2, 1.0), "hills_length_m": dice.uniform(100.0, 400.0)},
        campaign={"throttle_force_N": 4.0 * mass_kg, "braking_m_s2": 3.0, "valve_lag_s": 0.15},
        travel={
            "duration_s": 300.0,
            "speed_least_m_s": 6.0,
            "speed_most_m_s": 25.0,
            "stop_share": 0.4,
            "acceleration_m_s2": 2.5,
            "motor_brakes": True,
        },
    )


def bus(seed: int, loads_kg: Sequence[float] = (0.0,)) -> Scenario:
    """It never stands, its motor brakes it, and it is logged at 1 Hz."""
    dice = np.random.default_rng([seed, 20_283])
    mass_kg = dice.uniform(11e3, 16e3)
    return _scenario(
        seed,
        1.0,
        (200.0, 0.03),
        loads_kg,
        machine={"mass_kg": mass_kg, "friction_N_s_m": 50.0, "air_N_s2_m2": 3.0},
        rolling={"coefficient": dice.uniform(0.006, 0.01)},
        terrain={"hills_deg": dice.uniform(0.1, 0.6), "hills_length_m": dice.uniform(250.0, 900.0)},
        campaign={
            "throttle_force_N": 1.6 * mass_kg,
            "braking_m_s2": 2.0,
            "valve_lag_s": 0.5,
            "rest_s": 0.0,
        },
        travel={
            "duration_s": 1500.0,
            "speed_least_m_s": 5.0,
            "speed_most_m_s": 18.0,
            "hold_least_s": 8.0,
            "hold_most_s": 30.0,
            "stop_share": 0.0,
            "acceleration_m_s2": 0.9,
            "response_s": 1.0,
            "motor_brakes": True,
            "in_motion": True,
        },
    )


def cart(seed: int, loads_kg: Sequence[float] = (0.0,)) -> Scenario:
    """Pushed and held back by hand, at 50 Hz: who pushes sways it at each step."""
    dice = np.random.default_rng([seed, 20_284])
    mass_kg = dice.uniform(80.0, 200.0)
    sway_rad_s = 2.0 * np.pi * 1.8
    return _scenario(
        seed,
        50.0,
        (2.0, 0.005),
        loads_kg,
        machine={"mass_kg": mass_kg, "friction_N_s_m": 5.0, "coulomb_N": 15.0},
        terrain={"hills_deg": dice.uniform(0.0, 0.5), "hills_length_m": dice.uniform(4.0, 16.0)},
        # a body on the cart that moves to and fro pushes it with m ω² l / 2
        chassis={
            "boom_kg": 10.0,
            "boom_stroke_m": dice.uniform(0.02, 0.06) * mass_kg / 10.0 * 2.0 / sway_rad_s**2,
            "boom_period_s": 1.0 / 1.8,
        },
        campaign={"throttle_force_N": 2.0 * mass_kg, "braking_m_s2": 1.0, "valve_lag_s": 0.2},
        travel={
            "duration_s": 180.0,
            "speed_least_m_s": 0.4,
            "speed_most_m_s": 1.3,
            "hold_least_s": 2.0,
            "hold_most_s": 6.0,
            "acceleration_m_s2": 0.8,
            "response_s": 0.3,
            "motor_brakes": True,
        },
    )


def rack(seed: int, loads_kg: Sequence[float] = (0.0,)) -> Scenario:
    """Strokes to and fro against a spring, with a rest after each, at 100 Hz."""
    dice = np.random.default_rng([seed, 20_285])
    mass_kg = dice.uniform(60.0, 150.0)
    return _strokes(
        seed,
        (5.0, 0.001),
        loads_kg,
        machine={
            "mass_kg": mass_kg,
            "friction_N_s_m": dice.uniform(50.0, 250.0),
            "coulomb_N": 20.0,
            "spring_N_m": dice.uniform(50.0, 300.0),
        },
        speeds_m_s=(0.15, 0.5),
    )


def arm(seed: int, loads_kg: Sequence[float] = (0.0,)) -> Scenario:
    """Strokes to and fro whose share of the weight changes on the way, at 100 Hz."""
    dice = np.random.default_rng([seed, 20_286])
    mass_kg = dice.uniform(5.0, 20.0)
    return _strokes(
        seed,
        (0.5, 0.002),
        loads_kg,
        machine={
            "mass_kg": mass_kg,
            "friction_N_s_m": dice.uniform(2.0, 20.0),
            "coulomb_N": 3.0,
        },
        speeds_m_s=(0.3, 1.2),
        terrain={
            "hills_deg": np.degrees(np.arcsin(dice.uniform(0.1, 0.3))),
            "hills_length_m": 2.0 * np.pi / 1.5,
        },
    )


OTHER_MACHINES: Final[dict[str, Callable[..., Scenario]]] = {
    "a car with gears": car,
    "a car whose motor brakes": electric_car,
    "a bus that never stands": bus,
    "a cart": cart,
    "a rack": rack,
    "an arm": arm,
}


def _strokes(
    seed: int,
    noise: tuple[float, float],
    loads_kg: Sequence[float],
    *,
    machine: dict[str, Any],
    speeds_m_s: tuple[float, float],
    **sections: dict[str, Any],
) -> Scenario:
    mass_kg = machine["mass_kg"] + max(loads_kg)
    return _scenario(
        seed,
        100.0,
        noise,
        loads_kg,
        machine=machine,
        campaign={"throttle_force_N": 12.0 * mass_kg, "braking_m_s2": 4.0, "valve_lag_s": 0.03},
        travel={
            "duration_s": 120.0,
            "speed_least_m_s": speeds_m_s[0],
            "speed_most_m_s": speeds_m_s[1],
            "hold_least_s": 0.3,
            "hold_most_s": 2.0,
            "stop_share": 1.0,
            "stand_least_s": 0.5,
            "stand_most_s": 2.0,
            "acceleration_m_s2": 1.5,
            "response_s": 0.1,
            "to_and_fro": True,
            "motor_brakes": True,
        },
        **sections,
    )


def _scenario(
    seed: int,
    rate_hz: float,
    noise: tuple[float, float],
    loads_kg: Sequence[float],
    *,
    machine: dict[str, Any],
    campaign: dict[str, Any],
    travel: dict[str, Any],
    **sections: dict[str, Any],
) -> Scenario:
    """One travel, all of whose force is measured; noise of force in N and of speed in m/s."""
    return Scenario.model_validate(
        {
            "machine": {
                "force_share": 1.0,
                "inertia_z_kg_m2": machine["mass_kg"] * _GYRATION_M**2 + 3.0 * max(loads_kg),
                **machine,
            },
            "campaign": {
                "loads_kg": tuple(loads_kg),
                "runs": 1,
                "brake_measured_share": 1.0,
                "manoeuvres": [{"kind": "travel", **travel}],
                **campaign,
            },
            "sensors": {
                "rate_hz": rate_hz,
                "force_noise_N": noise[0],
                "speed_noise_m_s": noise[1],
                "seed": seed,
            },
            # one table: force and speed are read at the same instants
            "sampling": {"torque_phase_s": 0.5 / rate_hz, "speed_phase_s": 0.5 / rate_hz},
            **sections,
        }
    )
