"""Logs that turn: machines, faults, what the instruments say, and what the machine file states."""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from benchmarks.independent.machine import GRAVITY_M_S2
from benchmarks.independent.sensors import EPOCH_NS, sample_times_s
from benchmarks.independent.turning_plant import (
    KEEP,
    PUSH,
    STAND,
    STEP_S,
    STOP,
    WAVE,
    Floats,
    Turner,
    TurnLeg,
    turn,
)


class TurnFault(NamedTuple):
    """What is wrong with a log; standard deviations, but for what says otherwise.

    Attributes:
        imu_m: place of the IMU, each direction; the machine file states it.
        gain_1: gain of each side's torque; likewise.
        track_1: track width; likewise.
        turning_N_m: dry friction of turning, up to this.
        grip_1: largest grip of the tyres sideways.
        gyro_rad_s: bias of the gyroscope.
        gyro_1: its gain.
        slip_1: largest slip of the wheels at the largest force.
        bias_m_s2: of the accelerometer, both directions.
        tilt_deg: of it, both ways.
        coulomb_1: dry friction along the machine over its weight, up to this,
        rolling_1: and rolling resistance.
        slope_deg: largest slope of the ground.
        kinematic: acceleration from the wheels.
    """

    imu_m: float = 0.005
    gain_1: float = 0.002
    track_1: float = 0.001
    turning_N_m: float = 0.0
    grip_1: float = 0.15
    gyro_rad_s: float = 0.0
    gyro_1: float = 0.0
    slip_1: float = 0.0
    bias_m_s2: float = 0.0
    tilt_deg: float = 0.0
    coulomb_1: float = 0.0
    rolling_1: float = 0.0
    slope_deg: float = 0.0
    kinematic: bool = False


FAULTS: Final[Mapping[str, TurnFault]] = {
    "clean": TurnFault(),
    "IMU 5 cm off": TurnFault(imu_m=0.05),
    "Coulomb friction of turning": TurnFault(turning_N_m=500.0),
    "gain 2 %": TurnFault(gain_1=0.02),
    "track 1 %": TurnFault(track_1=0.01),
    "gyroscope": TurnFault(gyro_rad_s=0.005, gyro_1=0.003),
    "slip": TurnFault(slip_1=0.07),
    "slip, wheels alone": TurnFault(slip_1=0.04, kinematic=True),
    "bias and tilt": TurnFault(bias_m_s2=0.05, tilt_deg=0.3),
    "rolling and Coulomb": TurnFault(coulomb_1=0.01, rolling_1=0.02),
    "slope": TurnFault(slope_deg=2.0),
    "slope, wheels alone": TurnFault(slope_deg=0.7, kinematic=True),
    "tyres that scrub": TurnFault(grip_1=0.4),
    "all": TurnFault(
        imu_m=0.05,
        gain_1=0.02,
        track_1=0.01,
        turning_N_m=500.0,
        gyro_rad_s=0.003,
        gyro_1=0.003,
        slip_1=0.05,
        bias_m_s2=0.03,
        tilt_deg=0.2,
        coulomb_1=0.01,
        rolling_1=0.01,
        slope_deg=1.0,
    ),
    "skid-steer": TurnFault(turning_N_m=1500.0, rolling_1=0.03),
}


class TurnTruth(NamedTuple):
    """What is true of a machine."""

    mass_kg: float
    inertia_z_kg_m2: float
    com_x_m: float
    com_y_m: float


class TurnLog(NamedTuple):
    """A log in memory: its topics as frames, the machine file as a table, and the truth."""

    topics: dict[str, pl.DataFrame]
    machine: dict[str, Any]
    truth: TurnTruth


def turn_log(fault: TurnFault, seed: int, *, stated: bool = True) -> TurnLog:
    """Draw a machine and its log.

    Args:
        fault: what is wrong.
        seed: of everything that is drawn.
        stated: whether the machine file states its uncertainties.
    """
    number = list(FAULTS.values()).index(fault)
    dice = np.random.default_rng([seed, number, 25_003])
    machine = _machine(dice, fault)
    force_N = machine.mass_kg * float(dice.uniform(1.3, 2.2))
    seen = turn(machine, _legs(dice, machine, force_N), float(dice.uniform(0.05, 0.2)))
    radius_m = round(float(dice.uniform(0.35, 0.6)), 3)
    place_m = np.round(dice.uniform([-0.6, -0.3], [0.6, 0.3]), 2)
    topics = _measured(dice, fault, machine, seen, force_N, radius_m, place_m)
    track_m = 2.0 * machine.half_track_m * (1.0 + dice.normal(0.0, fault.track_1))
    body: dict[str, Any] = {
        "name": "independent turner",
        "empty_mass_kg": machine.mass_kg * float(dice.normal(1.0, 0.01)),
        "wheel_radius_m": radius_m,
        "track_width_m": track_m,
        "imu": {"position_m": [*place_m.tolist(), 0.5]},
    }
    if stated:
        body |= {
            "wheel_radius_u_m": 0.0,
            "wheel_radius_by_load_u": 0.0,
            "track_width_u_m": fault.track_1 * track_m,
            "force_gain_u": fault.gain_1,
        }
        body["imu"]["position_u_m"] = fault.imu_m
    truth = TurnTruth(
        machine.mass_kg, machine.inertia_origin_kg_m2, machine.com_x_m, machine.com_y_m
    )
    return TurnLog(topics, _file(body, kinematic=fault.kinematic), truth)


def _machine(dice: np.random.Generator, fault: TurnFault) -> Turner:
    mass_kg = float(np.exp(dice.uniform(*np.log([1200.0, 8000.0]))))
    size_m = (mass_kg / 3600.0) ** (1.0 / 3.0)
    half_base_m, half_track_m = 0.55 * size_m, 0.75 * size_m
    com_x_m = float(dice.uniform(-0.3, 0.3)) * half_base_m
    # Coulomb friction of turning is stated for a machine of 3.6 t
    times = mass_kg / 3600.0 * size_m
    weight_N = mass_kg * GRAVITY_M_S2
    return Turner(
        mass_kg=mass_kg,
        com_x_m=com_x_m,
        com_y_m=float(dice.uniform(-0.06, 0.06)) * size_m,
        inertia_kg_m2=mass_kg * size_m**2 * float(dice.uniform(0.8, 1.3)),
        half_base_m=half_base_m,
        half_track_m=half_track_m,
        com_height_m=0.7 * size_m,
        viscous_N_s_m=mass_kg * float(dice.uniform(0.4, 1.0)),
        coulomb_N=fault.coulomb_1 * weight_N * float(dice.uniform()),
        rolling_1=fault.rolling_1 * float(dice.uniform()),
        turning_N_m=fault.turning_N_m * times * float(dice.uniform()),
        turning_N_m_s=mass_kg * size_m**2 * float(dice.uniform(0.2, 0.5)),
        grip_1=fault.grip_1 * float(dice.uniform(0.5, 1.0)),
        grip_m_s=float(dice.uniform(0.3, 1.0)),
        warming_1=float(dice.uniform(0.0, 0.05)),
        slope_rad=float(np.deg2rad(fault.slope_deg * dice.uniform())),
        slope_to_rad=float(dice.uniform(-np.pi, np.pi)),
    )


def _legs(dice: np.random.Generator, machine: Turner, force_N: float) -> list[TurnLeg]:
    """Starts both ways, spins both ways at two throttles, three arcs, and both at once."""
    # what the tyres hold a spin by comes on top
    grips = machine.grip_1 * machine.mass_kg * GRAVITY_M_S2 * machine.half_base_m
    inertia = machine.inertia_origin_kg_m2
    held_N = machine.coulomb_N + machine.rolling_1 * machine.mass_kg * GRAVITY_M_S2
    # the sides hold a spin by their dry friction, too
    holds = grips + machine.turning_N_m + held_N * machine.half_track_m
    torque_N_m = holds + inertia * float(dice.uniform(0.7, 1.1))
    legs = [TurnLeg(STAND, 3.0)]

    def then(*driven: TurnLeg) -> None:
        legs.extend((*driven, TurnLeg(STOP, 1.5), TurnLeg(STAND, 1.5)))

    for sign, throttle in ((1.0, 1.0), (-1.0, 0.8), (1.0, 0.6)):
        push_N = sign * (held_N + throttle * 0.7 * force_N)
        then(TurnLeg(PUSH, float(dice.uniform(4.0, 6.0)), force_N=push_N))
    for sign, throttle in ((1.0, 1.0), (-1.0, 1.0), (1.0, 0.7), (-1.0, 0.7)):
        push = sign * throttle * torque_N_m
        then(TurnLeg(PUSH, float(dice.uniform(3.5, 5.0)), torque_N_m=push))
    for speed, rate in ((1.0, 0.5), (-0.8, 0.6), (1.3, -0.4)):
        speed_m_s, rate_rad_s = speed * float(dice.uniform(0.8, 1.2)), rate
        then(TurnLeg(KEEP, 8.0, speed_m_s=speed_m_s, yaw_rate_rad_s=rate_rad_s))
    wave = TurnLeg(
        WAVE,
        40.0,
        force_N=held_N + 0.5 * force_N,
        torque_N_m=torque_N_m,
        mean_N=0.05 * force_N,
        force_period_s=float(dice.uniform(7.0, 11.0)),
        torque_period_s=float(dice.uniform(4.5, 6.5)),
    )
    then(wave)
    return legs


#: Noise of a sample: of each side's force over the weight, m/s², rad/s and m/s.
_FORCE_NOISE_1: Final = 0.0012
_ACC_NOISE_M_S2: Final = 0.012
_GYRO_NOISE_RAD_S: Final = 0.001
_SPEED_NOISE_M_S: Final = 0.005
_HZ: Final = (50.0, 100.0)


def _measured(
    dice: np.random.Generator,
    fault: TurnFault,
    machine: Turner,
    seen: dict[str, Floats],
    force_N: float,
    radius_m: float,
    place_m: Floats,
) -> dict[str, pl.DataFrame]:
    """Every topic: stamps and fields."""
    ends_s = seen["speed_m_s"].size * STEP_S
    jitter_s = float(dice.uniform(0.0, 0.0008))

    def times() -> Floats:
        return sample_times_s(dice, float(dice.choice(_HZ)), jitter_s, ends_s)

    def frame(t_s: Floats, **fields: Floats) -> pl.DataFrame:
        return pl.DataFrame({"unix_ns": np.round(t_s * 1e9).astype(np.int64) + EPOCH_NS, **fields})

    def at(name: str, t_s: Floats) -> Floats:
        return np.interp(t_s, np.arange(seen[name].size) * STEP_S, seen[name])

    t_s = times()
    noise_N = _FORCE_NOISE_1 * machine.mass_kg * GRAVITY_M_S2
    gains = dice.normal(1.0, fault.gain_1, 2)
    torques = {
        side: radius_m * gain * (at(f"force_{side}_N", t_s) + dice.normal(0.0, noise_N, t_s.size))
        for side, gain in zip(("left", "right"), gains, strict=True)
    }
    topics = {"torque": frame(t_s, **torques)}

    t_s = times()
    slips = fault.slip_1 * float(dice.uniform()) / force_N
    wheels: dict[str, Floats] = {}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        over = at("speed_m_s", t_s) + sign * machine.half_track_m * at("yaw_rate_rad_s", t_s)
        turning = over * (1.0 + slips * 2.0 * np.abs(at(f"force_{side}_N", t_s)))
        wheels[side] = turning + dice.normal(0.0, _SPEED_NOISE_M_S, t_s.size)
    topics["wheels"] = frame(t_s, **wheels)

    t_s = times()
    x_m, y_m = place_m + dice.normal(0.0, fault.imu_m, 2)
    rate, rising = at("yaw_rate_rad_s", t_s), at("yaw_acc_rad_s2", t_s)
    bias = dice.normal(0.0, fault.bias_m_s2, 2)
    bias = bias + GRAVITY_M_S2 * np.sin(np.deg2rad(dice.normal(0.0, fault.tilt_deg, 2)))
    x = at("acc_x_m_s2", t_s) - rate**2 * x_m - rising * y_m + bias[0]
    y = at("acc_y_m_s2", t_s) - rate**2 * y_m + rising * x_m + bias[1]
    turns = rate * dice.normal(1.0, fault.gyro_1) + dice.normal(0.0, fault.gyro_rad_s)
    topics["imu"] = frame(
        t_s,
        x=x + dice.normal(0.0, _ACC_NOISE_M_S2, t_s.size),
        y=y + dice.normal(0.0, _ACC_NOISE_M_S2, t_s.size),
        z=GRAVITY_M_S2 + dice.normal(0.0, _ACC_NOISE_M_S2, t_s.size),
        yaw_rate=turns + dice.normal(0.0, _GYRO_NOISE_RAD_S, t_s.size),
    )
    return topics


def _file(body: dict[str, Any], *, kinematic: bool) -> dict[str, Any]:
    """The machine file."""
    channels: dict[str, Any] = {}
    for side in ("left", "right"):
        channels[f"torque_{side}_N_m"] = {"topic": "torque", "field": side}
        channels[f"speed_{side}_m_s"] = {"topic": "wheels", "field": side}
    channels["speed_x_m_s"] = {"derive": "mean(speed_left_m_s, speed_right_m_s)"}
    channels["yaw_rate_rad_s"] = {"topic": "imu", "field": "yaw_rate"}
    channels["yaw_acc_rad_s2"] = {"derive": "d/dt yaw_rate_rad_s"}
    if kinematic:
        channels["acc_x_m_s2"] = {"derive": "d/dt speed_x_m_s"}
    else:
        for axis in "xyz":
            channels[f"specific_force_{axis}_m_s2"] = {"topic": "imu", "field": axis}
    acceleration = "kinematic" if kinematic else "specific_force"
    return {
        "machine": body,
        "channels": channels,
        "settings": {
            "forces": {"acceleration": acceleration},
            "trace": {"methods": ["pooled"]},
        },
    }
