"""What instruments say of a motion: each topic at its own rate and phase, with its own faults."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.independent.machine import GRAVITY_M_S2
from benchmarks.independent.plant import STEP_S, Motion

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Unix time of the first log, ns: nothing depends on it.
EPOCH_NS: Final = 1_790_000_000 * 10**9
#: A message is recorded so long after its stamp, at least, and on average longer by the second.
_LATENCY_S: Final = 0.002
_LATENCY_MORE_S: Final = 0.0007


class Instruments(NamedTuple):
    """Errors of the sensors, and how often they speak.

    Attributes:
        two_sides: torques left and right, or one force.
        share: of the drive force that the measured wheels carry.
        share_per_load: change of that share, relative, for a load as heavy as the machine.
        share_s2_m: and per m/s².
        radius_m: of the wheels.
        force_gain: what the force is multiplied with in the middle of the log.
        gain_drift: change of that from the first second to the last, relative.
        force_offset_N: of the whole force.
        force_noise_N: of a sample, white,
        force_wander_N: and slow, over `wander_s`.
        wander_s: correlation time of what is slow.
        acc_bias_m_s2: of the accelerometer,
        acc_gain: its gain,
        acc_noise_m_s2: white noise of a sample,
        acc_wander_m_s2: and slow.
        vibration_m_s2: amplitude at `vibration_hz` while the engine works.
        vibration_hz: of that.
        tilt_rad: of the accelerometer on the machine, nose up, unknown to the machine file.
        imu_height_m: above the axis that the body pitches about.
        speed_noise_m_s: white noise of a sample.
        speed_step_m_s: of the encoder, 0 where there is none.
        slip_1_N: share of its speed that a newton makes the wheels slip.
        pitch_noise_rad: of the pitch channel.
        force_hz, imu_hz, speed_hz, pitch_hz, boom_hz: rates; pitch and boom may be 0, not recorded.
        jitter_s: standard deviation of the time between two samples.
    """

    two_sides: bool = True
    share: float = 0.5
    share_per_load: float = 0.0
    share_s2_m: float = 0.0
    radius_m: float = 0.42
    force_gain: float = 1.0
    gain_drift: float = 0.0
    force_offset_N: float = 0.0
    force_noise_N: float = 0.0
    force_wander_N: float = 0.0
    wander_s: float = 8.0
    acc_bias_m_s2: float = 0.0
    acc_gain: float = 1.0
    acc_noise_m_s2: float = 0.0
    acc_wander_m_s2: float = 0.0
    vibration_m_s2: float = 0.0
    vibration_hz: float = 31.0
    tilt_rad: float = 0.0
    imu_height_m: float = 0.0
    speed_noise_m_s: float = 0.0
    speed_step_m_s: float = 0.0
    slip_1_N: float = 0.0
    pitch_noise_rad: float = 0.0
    force_hz: float = 100.0
    imu_hz: float = 100.0
    speed_hz: float = 100.0
    pitch_hz: float = 0.0
    boom_hz: float = 0.0
    jitter_s: float = 0.0


class Readings(NamedTuple):
    """The samples of one topic: (n,) stamps and times of recording in ns, (n,) values by name."""

    stamp_ns: Ints
    log_ns: Ints
    values: dict[str, Floats]


class _Sampled:
    """The motion at some times, between the two steps beside each."""

    def __init__(self, motion: Motion, t_s: Floats) -> None:
        place = t_s / STEP_S
        self._motion = motion
        self._row = place.astype(np.int64)
        self._after = place - self._row

    def __getitem__(self, name: str) -> Floats:
        rows = self._motion.channels[name]
        low = rows[self._row].astype(np.float64)
        return low + self._after * (rows[self._row + 1] - low)


def _wander(dice: np.random.Generator, count: int, std: float, keep_1: float) -> Floats:
    """Noise whose correlation from sample to sample is keep_1."""
    steps = dice.normal(0.0, std * np.sqrt(1.0 - keep_1**2), count)
    before = dice.normal(0.0, std) * keep_1 ** np.arange(count)
    return np.asarray(lfilter([1.0], [1.0, -keep_1], steps)) + before


def _noise(
    dice: np.random.Generator, t_s: Floats, white: float, slow: tuple[float, float]
) -> Floats:
    """White noise and what wanders: slow is its standard deviation and correlation time."""
    keep_1 = float(np.exp(-np.mean(np.diff(t_s)) / slow[1]))
    return dice.normal(0.0, white, t_s.size) + _wander(dice, t_s.size, slow[0], keep_1)


def sample_times_s(
    dice: np.random.Generator, rate_hz: float, jitter_s: float, ends_s: float
) -> Floats:
    """When a topic samples: its own phase, and jitter of a third of a period at most."""
    period_s = 1.0 / rate_hz
    count = int((ends_s - 2.0 * period_s) * rate_hz)
    jitter = dice.normal(0.0, jitter_s, count).clip(-period_s / 3.0, period_s / 3.0)
    return np.asarray((np.arange(count) + dice.uniform(0.4, 1.4)) * period_s + jitter, np.float64)


def _readings(dice: np.random.Generator, t_s: Floats, values: dict[str, Floats]) -> Readings:
    late_s = _LATENCY_S + dice.exponential(_LATENCY_MORE_S, t_s.size)
    log_s = np.maximum.accumulate(t_s + late_s)
    as_ns = [np.round(each * 1e9).astype(np.int64) + EPOCH_NS for each in (t_s, log_s)]
    return Readings(as_ns[0], as_ns[1], values)


def _forces(
    dice: np.random.Generator, seen: Instruments, motion: Motion, empty_kg: float
) -> Readings:
    t_s = sample_times_s(dice, seen.force_hz, seen.jitter_s, motion.duration_s)
    at = _Sampled(motion, t_s)
    shift_1 = 1.0 + seen.share_per_load * at["load_kg"] / empty_kg
    shift_1 += seen.share_s2_m * at["acceleration_m_s2"]
    gain_1 = seen.force_gain * (1.0 + seen.gain_drift * (t_s / motion.duration_s - 0.5))
    force_N = at["force_N"] * shift_1 * gain_1 + seen.force_offset_N
    slow = (seen.force_wander_N, seen.wander_s)
    if not seen.two_sides:
        measured_N = seen.share * (force_N + _noise(dice, t_s, seen.force_noise_N, slow))
        return _readings(dice, t_s, {"force": measured_N})
    # two sensors share the noise that is stated for their sum
    halves = (seen.force_noise_N / np.sqrt(2.0), (slow[0] / np.sqrt(2.0), slow[1]))
    sides = [force_N / 2.0 + _noise(dice, t_s, *halves) for _ in range(2)]
    torques = [seen.share * seen.radius_m * side for side in sides]
    return _readings(dice, t_s, dict(zip(("left", "right"), torques, strict=True)))


def _inertial(dice: np.random.Generator, seen: Instruments, motion: Motion) -> Readings:
    t_s = sample_times_s(dice, seen.imu_hz, seen.jitter_s, motion.duration_s)
    at = _Sampled(motion, t_s)
    pitch, squat, along = at["pitch_rad"], at["squat_rad"], at["acceleration_m_s2"]
    x = along * np.cos(squat) + GRAVITY_M_S2 * np.sin(pitch)
    x += seen.imu_height_m * at["squat_acc_rad_s2"]
    z = GRAVITY_M_S2 * np.cos(pitch) - along * np.sin(squat)
    turned_x = x * np.cos(seen.tilt_rad) + z * np.sin(seen.tilt_rad)
    turned_z = z * np.cos(seen.tilt_rad) - x * np.sin(seen.tilt_rad)
    slow = (seen.acc_wander_m_s2, seen.wander_s)
    shake = seen.vibration_m_s2 * np.sin(2.0 * np.pi * seen.vibration_hz * t_s)
    values = {
        "x": seen.acc_gain * turned_x
        + seen.acc_bias_m_s2
        + shake
        + _noise(dice, t_s, seen.acc_noise_m_s2, slow),
        "z": turned_z + 1.7 * shake + dice.normal(0.0, seen.acc_noise_m_s2, t_s.size),
        "yaw_rate": dice.normal(0.0, 0.002, t_s.size),
    }
    return _readings(dice, t_s, values)


def _wheels(dice: np.random.Generator, seen: Instruments, motion: Motion) -> Readings:
    t_s = sample_times_s(dice, seen.speed_hz, seen.jitter_s, motion.duration_s)
    at = _Sampled(motion, t_s)
    turning = at["speed_m_s"] * (1.0 + seen.slip_1_N * np.abs(at["force_N"]))

    def wheel() -> Floats:
        said = turning + dice.normal(0.0, seen.speed_noise_m_s, t_s.size)
        step = seen.speed_step_m_s
        return np.round(said / step) * step if step else said

    if not seen.two_sides:
        return _readings(dice, t_s, {"speed": wheel()})
    return _readings(dice, t_s, {side: wheel() / seen.radius_m for side in ("left", "right")})


def _slow_topic(
    dice: np.random.Generator,
    rate_hz: float,
    seen: Instruments,
    motion: Motion,
    channel: tuple[str, float],
) -> Readings:
    name, noise = channel
    t_s = sample_times_s(dice, rate_hz, seen.jitter_s, motion.duration_s)
    said = _Sampled(motion, t_s)[name] + dice.normal(0.0, noise, t_s.size)
    return _readings(dice, t_s, {"angle": said})


#: Noise of the boom's angle sensor, rad.
_BOOM_NOISE_RAD: Final = 0.002


def measured(
    dice: np.random.Generator, seen: Instruments, motion: Motion, empty_kg: float
) -> dict[str, Readings]:
    """Every topic of a log: `force`, `imu`, `speed`, and `pitch` and `boom` where recorded.

    Args:
        dice: of the noise.
        seen: the instruments.
        motion: what happened.
        empty_kg: mass of the empty machine.
    """
    topics = {
        "force": _forces(dice, seen, motion, empty_kg),
        "imu": _inertial(dice, seen, motion),
        "speed": _wheels(dice, seen, motion),
    }
    if seen.pitch_hz:
        pitch = ("pitch_rad", seen.pitch_noise_rad)
        topics["pitch"] = _slow_topic(dice, seen.pitch_hz, seen, motion, pitch)
    if seen.boom_hz:
        boom = ("boom_rad", _BOOM_NOISE_RAD)
        topics["boom"] = _slow_topic(dice, seen.boom_hz, seen, motion, boom)
    return topics
