"""Machines and campaigns drawn at random, and situations brought to their size.

A situation states newtons and kilograms of the paper's loader; on a machine of another size the
same situation has newtons in proportion to the throttle, and kilograms in proportion to the mass.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

Sections = dict[str, dict[str, Any]]

#: Of the loader that situations are stated for.
LOADER_KG: Final = 3614.0
LOADER_N: Final = 6000.0
#: Keys of situations in proportion to the throttle,
_BY_FORCE: Final = frozenset(
    {
        *("coulomb_N", "coulomb_std_N", "slip_stiffness_N", "digging_N", "drag_N", "release_N"),
        *("force_bias_N", "force_clip_N", "power_limit_W", "scrub_N_s_rad"),
    }
)
#: to the mass,
_BY_MASS: Final = frozenset({"rotating_kg", "boom_kg", "change_kg", "fill_kg_s", "loads_kg"})
#: and to its inverse.
_OVER_MASS: Final = frozenset({"force_share_1_kg", "squat_deg_s2_m_kg", "pitch_deg_kg"})
#: Standard gravity, which newtons of a weight are taken with here.
_G_M_S2: Final = 9.80665
#: Of the least throttle so much may go into rolling, or a machine hardly starts.
_MOST_ROLLING: Final = 0.5
#: A bucket holds so much of the machine's mass: what springs do is drawn for a full one.
_FULL_BUCKET: Final = 0.25


def draw_design(seed: int) -> Sections:
    """A machine and a campaign: from 800 to 8000 kg, 4 to 15 starts, every rate and noise its own.

    Args:
        seed: what is drawn depends on it alone; it is the seed of the sensors' noise as well.
    """
    dice = np.random.default_rng([seed, 20_261])

    def between(low: float, high: float) -> float:
        return float(dice.uniform(low, high))

    def rate_hz() -> float:
        return float(dice.choice([50.0, 100.0, 200.0, between(50.0, 200.0)]))

    mass_kg = float(np.exp(between(np.log(800.0), np.log(8000.0))))
    size = mass_kg / LOADER_KG
    alternating = bool(dice.random() < 0.5)
    return {
        "machine": {
            "mass_kg": mass_kg,
            "friction_N_s_m": mass_kg * between(0.3, 1.2),
            "inertia_z_kg_m2": 4000.0 * size,
            "friction_z_N_m_s": 5000.0 * size,
            "force_share": float(dice.choice([0.5, 1.0])),
        },
        "campaign": {
            "loads_kg": [0.0],
            "runs": int(dice.integers(4, 16)),
            "standstill_s": between(3.0, 6.0),
            "start_s": between(2.0, 4.0),
            "cruise_s": between(1.0, 3.0),
            "throttle_force_N": mass_kg * between(1.1, 2.2),
            "valve_lag_s": between(0.05, 0.15),
        },
        "starts": {
            "throttle_least": between(0.4, 1.0),
            "directions": "alternating" if alternating else "as listed",
        },
        "sensors": {
            "force_noise_N": 60.0 * size * between(0.5, 2.0),
            "acc_noise_m_s2": 0.01 * between(0.5, 2.0),
            "speed_noise_m_s": 0.005 * between(0.5, 2.0),
            "seed": seed,
        },
        "sampling": {f"{topic}_rate_hz": rate_hz() for topic in ("imu", "torque", "speed")},
    }


def with_field_physics(design: Sections, seed: int) -> Sections:
    """A design on real ground, with instruments as they are mounted and brakes as they are used.

    Rolling resistance of 0.5 to 4 % of the weight on two grounds, a biased and tilted
    accelerometer, springs that give way under load, friction that warms, and every second time
    gentle brakes.

    Args:
        design: with its mass, its throttle and the least share of it.
        seed: what is drawn depends on it alone; not on what the design was drawn from.
    """
    dice = np.random.default_rng([seed, 20_271])

    def between(low: float, high: float) -> float:
        return float(dice.uniform(low, high))

    mass_kg = design["machine"]["mass_kg"]
    least_N = design["campaign"]["throttle_force_N"] * design["starts"]["throttle_least"]
    most = min(0.04, _MOST_ROLLING * least_N / (mass_kg * _G_M_S2))
    here, there = between(0.005, most), between(0.005, most)
    brakes = {"gentle_m_s2": between(0.05, 0.3), "gentle_lead_s": between(0.2, 1.0)}
    physics: Sections = {
        "rolling": {
            "coefficient": here,
            "second_ground_more": there - here if dice.random() < 0.5 else 0.0,
            "ground_length_m": between(8.0, 40.0),
            "growth_s_m": between(0.0, 0.05),
        },
        "machine": {"friction_warming": between(0.0, 0.25), "warming_s": between(20.0, 200.0)},
        "sensors": {"acc_bias_m_s2": between(-0.1, 0.1)},
        "defects": {"acc_tilt_deg": between(-1.0, 1.0)},
        "chassis": {
            "squat_deg_s2_m": between(0.0, 0.3),
            "squat_deg_s2_m_kg": between(0.0, 0.3) / (_FULL_BUCKET * mass_kg),
            "pitch_deg_kg": between(-0.7, 0.3) / (_FULL_BUCKET * mass_kg),
        },
        "brakes": brakes if dice.random() < 0.5 else {},
    }
    return join_designs(design, physics)


def join_designs(*parts: Mapping[str, Mapping[str, Any]]) -> Sections:
    """Sections under sections: a later part's keys win."""
    names = {name: None for part in parts for name in part}
    return {
        name: {key: value for part in parts for key, value in part.get(name, {}).items()}
        for name in names
    }


def brought_to_size(situation: Mapping[str, Mapping[str, Any]], design: Sections) -> Sections:
    """A situation of the loader on another machine.

    Args:
        situation: its sections.
        design: of the machine, with its mass and its throttle.
    """
    force = design["campaign"]["throttle_force_N"] / LOADER_N
    mass = design["machine"]["mass_kg"] / LOADER_KG
    return {name: _scale_to_size(keys, force, mass) for name, keys in situation.items()}


def _scale_to_size(keys: Mapping[str, Any], force: float, mass: float) -> dict[str, Any]:
    def sized(key: str, value: Any) -> Any:
        if key == "manoeuvres":
            return [_scale_to_size(each, force, mass) for each in value]
        if key == "loads_kg":
            return [load_kg * mass for load_kg in value]
        if key in _BY_FORCE:
            return value * force
        if key in _BY_MASS:
            return value * mass
        return value / mass if key in _OVER_MASS else value

    return {key: sized(key, value) for key, value in keys.items()}
