"""Faults of one size, put into a simulated log by name: what a diagnosis is measured with.

A fault changes the scenario, or the topics that the scenario gave. Its size is a number without a
unit, 1 a typical one; what it does to a mass grows with it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.simulation.logs.simulated_campaign import SimulatedLog
from estimators.arrays import Floats
from tests.trials.drawn_designs import LOADER_KG, LOADER_N, Sections, join_designs

Frames = dict[str, pl.DataFrame]
_TORQUES: Final = ("torque_left_N_m", "torque_right_N_m")
_SPEEDS: Final = ("speed_left_m_s", "speed_right_m_s")
_X: Final = "specific_force_x_m_s2"
_Y: Final = "specific_force_y_m_s2"


def _keep_unchanged(_: Sections, __: float) -> Sections:
    return {}


def _leave_unchanged(frames: Frames, _: float, __: np.random.Generator) -> Frames:
    return frames


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        name: in tables.
        causes: keys of findings that name it.
        sections: of the scenario, by the design and the size.
        topics: what it makes of the topics, by the size and dice.
        needs: sections of the scenario that it is seen in.
        ground: sections by the size that a log without the fault has as well.
        last_runs: how many runs have it; 0: all.
        overrides: of the machine file, likewise.
        largest: no size beyond this is a fault that still drives; None where size bends no mass,
            and the sizes 1, 3 and 10 of it are as they are said.
        said: what the size 1 is.
        has_size: whether its size changes anything.
    """

    name: str
    causes: tuple[str, ...]
    said: str
    sections: Callable[[Sections, float], Sections] = _keep_unchanged
    topics: Callable[[Frames, float, np.random.Generator], Frames] = _leave_unchanged
    needs: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    ground: Callable[[Sections, float], Sections] | None = None
    last_runs: int = 0
    overrides: tuple[str, ...] = ()
    largest: float | None = None
    has_size: bool = True


def with_fault(log: SimulatedLog, fault: Fault, size: float, seed: int) -> SimulatedLog:
    """The log with what a fault makes of its topics."""
    dice = np.random.default_rng([seed, 20_265])
    topics = fault.topics(dict(log.topics), size, dice)
    return replace(log, topics=topics)


def _keys(section: str, **keys: float) -> Callable[[Sections, float], Sections]:
    """Keys in proportion to the size."""
    return lambda _, size: {section: {key: value * size for key, value in keys.items()}}


def _of_force(section: str, **keys: float) -> Callable[[Sections, float], Sections]:
    """Keys in proportion to the size and to the machine's throttle."""

    def sections(design: Sections, size: float) -> Sections:
        times = size * design["campaign"]["throttle_force_N"] / LOADER_N
        return {section: {key: value * times for key, value in keys.items()}}

    return sections


def _slip(design: Sections, size: float) -> Sections:
    stiffness_N = 80_000.0 * design["campaign"]["throttle_force_N"] / LOADER_N
    return {"machine": {"slip_stiffness_N": stiffness_N / max(size, 1e-3)}}


def _clip(design: Sections, size: float) -> Sections:
    share = max(1.0 - 0.1 * size, 0.3)
    return {"defects": {"force_clip_N": share * design["campaign"]["throttle_force_N"]}}


def _set_start(design: Sections, **keys: float) -> Sections:
    campaign = design["campaign"]
    names = ("start_s", "cruise_s")
    start = {"kind": "start", **{name: campaign[name] for name in names}, **keys}
    rest = {"kind": "rest", "duration_s": campaign["standstill_s"]}
    return {"campaign": {"manoeuvres": [rest, start]}}


def _little(design: Sections, size: float) -> Sections:
    throttle = max(0.05 / max(size, 0.3), 0.01)
    return join_designs(_set_start(design, throttle=throttle), {"starts": {"throttle_least": 1.0}})


def _pile(design: Sections, size: float) -> Sections:
    force_N = design["campaign"]["throttle_force_N"]
    start_s = design["campaign"]["start_s"]
    return _set_start(design, digging_N=(0.25 + 0.03 * size) * force_N, digging_s=start_s)


def _fills(design: Sections, size: float) -> Sections:
    mass_kg = design["machine"]["mass_kg"]
    return {"loading": {"fill_kg_s": 50.0 * size * mass_kg / LOADER_KG}}


def _brakes(_: Sections, size: float) -> Sections:
    return {"campaign": {"brake_measured_share": max(1.0 - 0.1 * size, 0.0)}}


def _uphill(_: Sections, size: float) -> Sections:
    return {"terrain": {"slope_deg": 0.5 * size}}


def _times(topic: str, names: tuple[str, ...], of: Callable[[float], float]) -> Any:
    def topics(frames: Frames, size: float, _: np.random.Generator) -> Frames:
        changed = [pl.col(name) * of(size) for name in names]
        return {**frames, topic: frames[topic].with_columns(changed)}

    return topics


def _yaw_imu(frames: Frames, size: float, _: np.random.Generator) -> Frames:
    angle = np.deg2rad(min(8.0 * size, 60.0))
    imu = frames["imu"]
    x, y = pl.col(_X), pl.col(_Y)
    turned = [
        (x * np.cos(angle) + y * np.sin(angle)).alias(_X),
        (y * np.cos(angle) - x * np.sin(angle)).alias(_Y),
    ]
    return {**frames, "imu": imu.with_columns(turned)}


def _add_spikes(frames: Frames, size: float, dice: np.random.Generator) -> Frames:
    torque = frames["torque"]
    rows = dice.choice(torque.height, 40, replace=False)
    signs = dice.choice([-1.0, 1.0], 40)
    left = torque[_TORQUES[0]].to_numpy().copy()
    noise = float(np.median(np.abs(np.diff(left)))) / 0.6745 / np.sqrt(2.0)
    left[rows] += signs * 10.0 * noise * (1.0 + size)
    return {**frames, "torque": torque.with_columns(pl.Series(_TORQUES[0], left))}


def _uneven(frames: Frames, size: float, dice: np.random.Generator) -> Frames:
    return {
        topic: frame.with_columns(_add_jitter(frame, size, dice)) for topic, frame in frames.items()
    }


def _add_jitter(frame: pl.DataFrame, size: float, dice: np.random.Generator) -> pl.Series:
    stamps = frame["header_stamp_ns"].to_numpy()
    period = float(np.median(np.diff(stamps)))
    off = dice.uniform(-0.5, 0.5, stamps.size) * min(0.3 * size, 3.0) * period
    return pl.Series("header_stamp_ns", stamps + np.rint(off).astype(np.int64))


def _holes(frames: Frames, size: float, dice: np.random.Generator) -> Frames:
    torque = frames["torque"]
    log = torque["log_time_ns"].to_numpy()
    kept = np.ones(log.size, np.bool_)
    for begin in dice.uniform(log[0], log[-1], 4):
        kept &= ~((log >= begin) & (log < begin + 0.2e9 * size))
    return {**frames, "torque": torque.filter(pl.Series(kept))}


def _repeat_rows(frames: Frames, size: float, dice: np.random.Generator) -> Frames:
    """Torques of a stretch that the logger writes again, at later times."""
    torque = frames["torque"]
    log = torque["log_time_ns"].to_numpy()
    begin = int(log.size * dice.uniform(0.1, 0.3))
    rows = int(np.searchsorted(log, log[begin] + int(2.5e9 * size))) - begin
    again = min(begin + int(log.size * dice.uniform(0.3, 0.5)), log.size - rows)
    changed: list[pl.Series] = []
    for name in _TORQUES:
        x = torque[name].to_numpy().copy()
        x[again : again + rows] = x[begin : begin + rows]
        changed.append(pl.Series(name, x))
    return {**frames, "torque": torque.with_columns(changed)}


def _add_clock_jump(frames: Frames, size: float, dice: np.random.Generator) -> Frames:
    torque = frames["torque"]
    stamps = torque["header_stamp_ns"].to_numpy().copy()
    at = int(stamps.size * dice.uniform(0.3, 0.7))
    stamps[at:] += round(20e6 * size)
    return {**frames, "torque": torque.with_columns(pl.Series("header_stamp_ns", stamps))}


def _noisier(frames: Frames, size: float, dice: np.random.Generator) -> Frames:
    """Noise in proportion to the torque."""
    torque = frames["torque"]
    changed: list[pl.Series] = []
    for name in _TORQUES:
        x: Floats = torque[name].to_numpy()
        about = np.convolve(np.abs(x), np.ones(9) / 9.0, "same")
        changed.append(pl.Series(name, x + dice.normal(0.0, 1.0, x.size) * 0.05 * size * about))
    return {**frames, "torque": torque.with_columns(changed)}


def _rectify_speed(frames: Frames, _: float, __: np.random.Generator) -> Frames:
    """Wheel speeds of pulses that are counted whichever way the wheel turns."""
    return {**frames, "speed": frames["speed"].with_columns(pl.col(_SPEEDS).abs())}


def _rectify_force(frames: Frames, _: float, __: np.random.Generator) -> Frames:
    return {
        **frames,
        "torque": frames["torque"].with_columns([pl.col(name).abs() for name in _TORQUES]),
    }


def _lower_in_reverse(frames: Frames, size: float, _: np.random.Generator) -> Frames:
    """Torques that read 3 % less where the machine drives in reverse."""
    torque, speed = frames["torque"], frames["speed"]
    mean = speed.select(pl.mean_horizontal(_SPEEDS)).to_series().to_numpy()
    at, known = (frame["header_stamp_ns"].to_numpy() for frame in (torque, speed))
    gain = np.where(np.interp(at, known, mean) < 0.0, 1.0 - 0.03 * size, 1.0)
    changed = [pl.col(name) * pl.Series(gain) for name in _TORQUES]
    return {**frames, "torque": torque.with_columns(changed)}


def _lost_at_low_speed(frames: Frames, size: float, _: np.random.Generator) -> Frames:
    """Torques before a low gear that loses 4 %; it shifts up at 44 %, down at 36 % of the speed."""
    torque, speed = frames["torque"], frames["speed"]
    mean = speed.select(pl.mean_horizontal(_SPEEDS).abs()).to_series().to_numpy()
    at, known = (frame["header_stamp_ns"].to_numpy() for frame in (torque, speed))
    drives = np.interp(at, known, mean) / np.quantile(mean, 0.995)
    # without hysteresis noise of the speed would shift within a sample, which is a spike
    shifts = pl.Series(np.select([drives < 0.36, drives > 0.44], [1.0, 0.0], np.nan))
    low = shifts.fill_nan(None).forward_fill().fill_null(1.0)
    changed = [pl.col(name) * (1.0 + 0.04 * size * low) for name in _TORQUES]
    return {**frames, "torque": torque.with_columns(changed)}


_BOTH_WAYS: Final = {"starts": {"directions": "alternating"}}
_THROTTLES: Final = {"starts": {"throttle_least": 0.4}}
_TURNS: Final = {"starts": {"turn_rad_s": 0.04, "scrub_N_s_rad": 0.0}}
_BRAKES_SEEN: Final = {"campaign": {"brake_measured_share": 1.0}}
_UNGATED: Final = (
    "settings.gate.threshold_nat=-100.0",
    "settings.gate.condition_max=1e12",
    "settings.gate.noise_share_max=1e9",
    'settings.trace.methods=["pooled", "rls"]',
)
_INCLUDED: Final = ("settings.gate.exclude_braking=false",)

FAULTS: Final = (
    Fault("force late", ("delay",), "10 ms", _keys("sensors", force_delay_s=0.01), largest=15.0),
    Fault("speed late", ("delay",), "10 ms", _keys("sensors", speed_delay_s=0.01), largest=12.0),
    Fault(
        "force of the wrong sign",
        ("sign_flipped",),
        "times -1",
        topics=_times("torque", _TORQUES, lambda _: -1.0),
        has_size=False,
    ),
    Fault(
        "left torque of the wrong sign",
        ("sign_flipped",),
        "times -1",
        topics=_times("torque", _TORQUES[:1], lambda _: -1.0),
        has_size=False,
    ),
    Fault(
        "accelerometer of the wrong sign",
        ("sign_flipped",),
        "times -1",
        topics=_times("imu", (_X,), lambda _: -1.0),
        has_size=False,
    ),
    Fault(
        "force without its sign",
        ("unsigned",),
        "its size alone",
        topics=_rectify_force,
        needs=_BOTH_WAYS,
        has_size=False,
    ),
    Fault(
        "speed without its sign",
        ("unsigned",),
        "its size alone",
        topics=_rectify_speed,
        needs=_BOTH_WAYS,
        has_size=False,
    ),
    Fault(
        "sides swapped",
        ("swapped_sides",),
        "left is right",
        lambda _, __: {"defects": {"sides_swapped": True}},
        needs=_TURNS,
        has_size=False,
    ),
    Fault(
        "wheels larger",
        ("wheel_radius",),
        "1 %",
        _keys("machine", wheel_radius_excess=0.01),
        largest=40.0,
    ),
    Fault(
        "force frozen",
        ("frozen",),
        "1 s every 15 s",
        lambda _, size: {
            "defects": {
                "frozen_topic": "torque",
                "frozen_every_s": 15.0,
                "frozen_s": 0.7 + 0.3 * size,
            }
        },
    ),
    Fault("force clipped", ("saturated",), "at 90 % of the throttle", _clip, largest=7.0),
    Fault(
        "speed coarse",
        ("quantised",),
        "0.02 m/s",
        lambda _, size: {"sensors": {"speed_lsb_m_s": 0.02 * size}},
    ),
    Fault("torque with spikes", ("spikes",), "40 of 20 deviations", topics=_add_spikes),
    Fault(
        "speed in km/h",
        ("wrong_unit",),
        "times 3.6",
        topics=_times("speed", _SPEEDS, lambda _: 3.6),
        has_size=False,
    ),
    Fault(
        "acceleration in g",
        ("wrong_unit",),
        "over 9.80665",
        topics=_times("imu", (_X, _Y, "specific_force_z_m_s2"), lambda _: 1.0 / 9.80665),
        has_size=False,
    ),
    Fault("force clock jumps", ("clock_jump",), "20 ms", topics=_add_clock_jump),
    Fault(
        "force clock fast",
        ("clock_drift",),
        "100 ppm",
        _keys("sampling", torque_clock_ppm=100.0),
        largest=100.0,
    ),
    Fault("gaps in the force", ("gaps",), "4 of 0.2 s", topics=_holes),
    Fault("a stretch written twice", ("repeated_rows",), "2.5 s of force", topics=_repeat_rows),
    Fault(
        "uneven stamps", ("irregular_sampling",), "uniform over 30 % of a period", topics=_uneven
    ),
    Fault(
        "IMU tilted", ("imu_misaligned",), "0.2°", _keys("defects", acc_tilt_deg=0.2), largest=100.0
    ),
    Fault("IMU turned", ("imu_misaligned",), "8°", topics=_yaw_imu, largest=7.0),
    Fault(
        "IMU biased", ("imu_bias",), "0.04 m/s²", _keys("sensors", acc_bias_m_s2=0.04), largest=60.0
    ),
    Fault(
        "IMU low-passed",
        ("imu_low_passed",),
        "20 ms",
        _keys("defects", imu_lag_s=0.02),
        largest=25.0,
    ),
    Fault(
        "slope, no gravity",
        ("slope",),
        "0.5°",
        lambda _, __: {"defects": {"acc_without_gravity": True}},
        ground=_uphill,
    ),
    Fault("slip", ("slip",), "80 kN at 6 kN", _slip, needs=_THROTTLES, largest=2.5),
    Fault(
        "load transfer",
        ("driveline",),
        "0.02 a m/s²",
        _keys("defects", force_share_s2_m=0.02),
        needs={"machine": {"force_share": 0.5}, **_THROTTLES},
        largest=8.0,
    ),
    Fault(
        "Coulomb friction",
        ("coulomb",),
        "60 N of 6 kN",
        _of_force("machine", coulomb_N=60.0),
        needs=_THROTTLES,
        largest=25.0,
    ),
    Fault(
        "force offset",
        ("offset",),
        "60 N of 6 kN",
        _of_force("sensors", force_bias_N=60.0),
        largest=25.0,
    ),
    Fault(
        "force low in reverse",
        ("gain_by_direction",),
        "3 %",
        topics=_lower_in_reverse,
        needs=_BOTH_WAYS,
        largest=7.0,
    ),
    Fault(
        "a low gear that loses force",
        ("gain_by_speed",),
        "4 %",
        topics=_lost_at_low_speed,
        needs={"starts": {"throttle_least": 0.4, "directions": "alternating"}},
    ),
    Fault(
        "braking included",
        ("braking_inside",),
        "seen to 90 %",
        _brakes,
        needs=_BRAKES_SEEN,
        overrides=_INCLUDED,
        largest=10.0,
    ),
    Fault(
        "braking left out",
        ("braking_left_out",),
        "starts of a second that end in it",
        lambda _, __: {"campaign": {"start_s": 1.0, "cruise_s": 0.1, "standstill_s": 0.5}},
        needs={"campaign": {"brake_measured_share": 1.0, "braking_m_s2": 1.0}},
        has_size=False,
    ),
    Fault(
        "a pile",
        ("external_force",),
        "28 % of the throttle",
        _pile,
        # a pile lies before the bucket
        needs={"campaign": {"start_s": 3.5}, "starts": {"directions": "as listed"}},
    ),
    Fault(
        "a bucket that fills",
        ("load_changed_inside",),
        "50 kg/s in two starts",
        _fills,
        last_runs=2,
        needs={"campaign": {"start_s": 3.0}},
    ),
    Fault(
        "slow noise",
        ("coloured_residuals",),
        "60 N of 6 kN over 1 s",
        _of_force("sensors", force_drift_N=60.0),
    ),
    Fault("noise that grows with the force", ("heteroscedastic",), "5 %", topics=_noisier),
    Fault(
        "a frame that swings",
        ("resonance",),
        "0.05 m/s² at 8 Hz",
        lambda _, size: {
            "defects": {
                "vibration_m_s2": 0.05 * size,
                "vibration_hz": 8.0,
                "vibration_bandwidth_hz": 1.0,
            }
        },
    ),
    Fault(
        "a recursion ungated",
        ("wind_up",),
        "60 s at steady speed",
        lambda _, __: {"campaign": {"cruise_s": 60.0, "runs": 5}},
        overrides=_UNGATED,
        has_size=False,
    ),
    Fault("weak starts", ("too_little_excitation",), "5 % of the throttle", _little),
)
