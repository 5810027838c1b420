"""Simulated instruments: readings of a motion with noise, delay, bias and defects.

Every channel of every trial draws from its own stream of random numbers, so that an additional
trial, load or channel does not change the others.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.simulation.motion.solved_motion import Channels
from analysis.simulation.motion.timeline import PositionBoomAndBucket, Timeline
from analysis.simulation.scenario.instruments import TopicName
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.scenario.simulation_limits import LIMITS
from analysis.simulation.sensors.random_streams import RandomStreams
from analysis.simulation.sensors.recorder import (
    compute_topic_phase_s,
    get_topic_rate_hz,
    list_recorded_topics,
    make_sample_times_ns,
    record_topic,
)
from estimators.arrays import Floats
from estimators.numerics.play import apply_play_hysteresis

_SIDES: Final = (("left", -1.0), ("right", 1.0))
#: Mean radius of the earth (IUGG).
_EARTH_M: Final = 6_371_008.8


def simulate_topics_of_log(
    scenario: Scenario, timeline: Timeline, load_index: int
) -> dict[str, pl.DataFrame]:
    """Simulate the instruments' readings of a motion, by topic.

    Args:
        scenario: scenario with noise, bias, wheels, slope and defects.
        timeline: time line of the log.
        load_index: index of the log in the campaign, for its random numbers.

    Returns:
        Frames `imu`, `torque`, `speed`, and those of a shift, with `header_stamp_ns`,
        `log_time_ns`, and columns named like channels (pitch positive nose-up). Each topic has its
        own instants. Lost messages have no row; rows are in the order of recording.
    """
    frames: dict[str, pl.DataFrame] = {}
    for topic in list_recorded_topics(scenario):
        phase = compute_topic_phase_s(scenario, topic, load_index)
        at_ns = make_sample_times_ns(timeline, get_topic_rate_hz(scenario, topic), phase)
        streams = RandomStreams(
            scenario.sensors.seed, load_index, timeline.assign_trial_numbers(at_ns)
        )
        readings = _READERS[topic](scenario, timeline, at_ns, streams)
        if scenario.defects.frozen_topic == topic:
            held = find_repeated_sample_indices(scenario, at_ns - timeline.start_ns)
            readings = {name: values[held] for name, values in readings.items()}
        frames[topic] = record_topic(scenario, topic, at_ns, streams, timeline, readings)
    return frames


class WhiteNoise(NamedTuple):
    """Standard deviation of a channel's white noise, and its resolution."""

    std: float
    lsb: float


def _add_sensor_errors(
    value: Floats, random_streams: RandomStreams, name: str, white_noise: WhiteNoise
) -> Floats:
    reading = value + random_streams.draw_white_noise(name, white_noise.std)
    return np.rint(reading / white_noise.lsb) * white_noise.lsb if white_noise.lsb else reading


def delay_and_filter_signals(
    timeline: Timeline,
    at_ns: NDArray[np.int64],
    delay_and_lag_s: tuple[float, float],
    motion_signals: Callable[[Channels, Floats], Mapping[str, Floats]],
) -> Mapping[str, Floats]:
    """Signals (n,) of a motion after a delay and a low-pass (`delay_and_lag_s`).

    `motion_signals` takes the motion and the position in the log, from 0 to 1.
    """
    delay_s, lag_s = delay_and_lag_s
    length_ns = timeline.end_ns - timeline.start_ns

    def true_signals_at(time_ns: NDArray[np.int64]) -> Mapping[str, Floats]:
        return motion_signals(timeline.sample(time_ns), (time_ns - timeline.start_ns) / length_ns)

    return low_pass_signals(true_signals_at, at_ns - round(delay_s * 1e9), lag_s)


def _simulate_imu_readings(
    scenario: Scenario, timeline: Timeline, at_ns: NDArray[np.int64], random_streams: RandomStreams
) -> dict[str, Floats]:
    sensors, defects = scenario.sensors, scenario.defects
    times_s = (sensors.imu_delay_s, defects.imu_lag_s)
    made = dict(
        delay_and_filter_signals(
            timeline, at_ns, times_s, lambda motion, _: _compute_true_imu_signals(scenario, motion)
        )
    )
    if defects.vibration_m_s2:
        moving = timeline.sample(at_ns).wheel_speed_x_m_s != 0.0
        seconds = (at_ns - timeline.start_ns) * np.float64(1e-9)
        made["specific_force_x_m_s2"] = made["specific_force_x_m_s2"] + np.where(
            moving, draw_vibration(scenario, seconds, random_streams), 0.0
        )
    acc = WhiteNoise(sensors.acc_noise_m_s2, sensors.acc_lsb_m_s2)
    gyro = WhiteNoise(sensors.gyro_noise_rad_s, sensors.gyro_lsb_rad_s)
    white = {
        "pitch_rad": WhiteNoise(sensors.pitch_noise_rad, sensors.angle_lsb_rad),
        "roll_rad": WhiteNoise(sensors.roll_noise_rad, sensors.angle_lsb_rad),
    }
    return {
        name: _add_sensor_errors(
            value, random_streams, name, white.get(name, acc if "force" in name else gyro)
        )
        for name, value in made.items()
    }


def _compute_true_imu_signals(scenario: Scenario, motion: Channels) -> dict[str, Floats]:
    sensors, terrain, defects = scenario.sensors, scenario.terrain, scenario.defects
    x, y = sensors.imu_x_m, sensors.imu_y_m
    omega, turn = motion.yaw_rate_rad_s, motion.yaw_acc_rad_s2
    zero = np.zeros_like(omega)
    slope = motion.slope_rad if terrain.hills_deg else np.float64(terrain.slope_rad)
    ahead, left = motion.specific_force_x_m_s2, motion.specific_force_y_m_s2
    force_z = zero + terrain.gravity_m_s2 * np.cos(slope)
    if defects.acc_without_gravity:
        ahead, left, force_z = motion.acc_x_m_s2, omega * motion.speed_x_m_s, zero
    # at the position of the IMU on the turning machine, with gravity tilted by the slope
    force_x = ahead - omega * omega * x - turn * y
    force_y = left - omega * omega * y + turn * x
    nose_up = motion.squat_rad + defects.accelerometer_tilt_rad
    if nose_up.any():
        sine, cosine = np.sin(nose_up), np.cos(nose_up)
        force_x, force_z = force_x * cosine + force_z * sine, force_z * cosine - force_x * sine
    uphill = np.sin(slope)
    pitch = np.arcsin(uphill * np.cos(motion.heading_rad)) + motion.squat_rad
    # on level ground 0, not -0
    roll = np.arctan2(0.0 - uphill * np.sin(motion.heading_rad), np.cos(slope))
    bias = sensors.gyro_bias_rad_s
    return {
        "specific_force_x_m_s2": force_x + sensors.acc_bias_m_s2,
        "specific_force_y_m_s2": force_y,
        "specific_force_z_m_s2": force_z,
        "roll_rate_rad_s": zero + bias,
        # the y axis points left, so that nose up is a negative rotation
        "pitch_rate_rad_s": zero - motion.nose_up_rate_rad_s + bias,
        "yaw_rate_rad_s": omega + bias,
        "pitch_rad": pitch,
        "roll_rad": roll,
    }


def draw_vibration(scenario: Scenario, seconds: Floats, random_streams: RandomStreams) -> Floats:
    """Draw narrow-band noise (n,): a carrier with two Gauss-Markov amplitudes, in m/s²."""
    defects = scenario.defects
    samples = get_topic_rate_hz(scenario, "imu") / (math.pi * defects.vibration_bandwidth_hz)
    turn = 2.0 * math.pi * defects.vibration_hz * seconds
    in_phase, in_quadrature = (
        random_streams.draw_gauss_markov_drift(f"vibration_{name}", defects.vibration_m_s2, samples)
        for name in ("in_phase", "in_quadrature")
    )
    return in_phase * np.cos(turn) + in_quadrature * np.sin(turn)


def _simulate_torque_readings(
    scenario: Scenario, timeline: Timeline, at_ns: NDArray[np.int64], random_streams: RandomStreams
) -> dict[str, Floats]:
    """Readings of the torques of both sides; their noises add up to that of the force."""
    sensors, machine, defects = scenario.sensors, scenario.machine, scenario.defects
    lever_m = machine.force_share * machine.wheel_radius_m
    times_s = (sensors.force_delay_s, defects.force_lag_s)
    signals = delay_and_filter_signals(
        timeline, at_ns, times_s, lambda motion, part: compute_true_torques(scenario, motion, part)
    )
    noise = sensors.force_noise_N * lever_m / math.sqrt(2)
    most_N_m, play_N_m = (
        force_N * lever_m / 2 for force_N in (defects.force_clip_N, defects.force_play_N)
    )
    readings: dict[str, Floats] = {}
    for side, _ in _SIDES:
        name = f"torque_{side}_N_m"
        drift = random_streams.draw_gauss_markov_drift(
            f"torque_{side}_drift",
            sensors.force_drift_N * lever_m / math.sqrt(2),
            sensors.force_drift_s * get_topic_rate_hz(scenario, "torque"),
        )
        follows = apply_play_hysteresis(signals[name], play_N_m) if play_N_m else signals[name]
        reading = _add_sensor_errors(
            follows + drift, random_streams, name, WhiteNoise(noise, sensors.torque_lsb_N_m)
        )
        readings[name] = np.clip(reading, -most_N_m, most_N_m) if most_N_m else reading
    readings["torque_left_N_m"] = readings["torque_left_N_m"] * defects.left_torque_gain
    return _swap_sides_if_defective(scenario, "torque_{}_N_m", readings)


def compute_true_torques(
    scenario: Scenario, motion: Channels, log_fraction: Floats
) -> dict[str, Floats]:
    """Torques (n,) in N·m by (17) and (18) inverted, from force fraction and true radius."""
    sensors, machine, defects = scenario.sensors, scenario.machine, scenario.defects
    lever_m = machine.force_share * machine.wheel_radius_m
    force = motion.measured_force_x_N * lever_m / 2
    turning = motion.measured_torque_z_N_m * lever_m / machine.track_width_m
    load_kg = motion.mass_kg - machine.mass_kg
    lever = (1.0 + machine.wheel_radius_excess) * (1.0 + defects.force_share_1_kg * load_kg)
    lever = lever * (1.0 - defects.force_share_s2_m * motion.acc_x_m_s2)
    gain = sensors.force_gain * (1.0 + defects.force_gain_drift * log_fraction) * lever
    return {
        f"torque_{side}_N_m": gain * (force + sign * turning) + sensors.force_bias_N * lever_m / 2
        for side, sign in _SIDES
    }


def _simulate_speed_readings(
    scenario: Scenario, timeline: Timeline, at_ns: NDArray[np.int64], random_streams: RandomStreams
) -> dict[str, Floats]:
    sensors = scenario.sensors
    times_s = (sensors.speed_delay_s, scenario.defects.speed_lag_s)
    signals = delay_and_filter_signals(
        timeline, at_ns, times_s, lambda motion, _: compute_true_wheel_speeds(scenario, motion)
    )
    # the mean of both sides has the scenario's noise
    white = WhiteNoise(sensors.speed_noise_m_s * math.sqrt(2), sensors.speed_lsb_m_s)
    readings = {
        name: _add_sensor_errors(value, random_streams, name, white)
        for name, value in signals.items()
    }
    return _swap_sides_if_defective(scenario, "speed_{}_m_s", readings)


def compute_true_wheel_speeds(scenario: Scenario, motion: Channels) -> dict[str, Floats]:
    """Wheel speed of each side: ground speed plus the slip of its force.

    Slip κ = (v_wheel - v) / |v| = F / C with the longitudinal slip stiffness C: the linear range of
    a tyre (Pacejka, Tire and Vehicle Dynamics, chapter 1). With the relaxation length σ the slip
    follows: C κ |v| = |v| F + σ dF/dt (chapter 7).
    """
    machine = scenario.machine
    relaxing = scenario.drivetrain.relaxation_length_m
    signals: dict[str, Floats] = {}
    for side, sign in _SIDES:
        speed = motion.wheel_speed_x_m_s + sign * motion.yaw_rate_rad_s * machine.track_width_m / 2
        if machine.slip_stiffness_N:
            force = motion.force_x_N / 2 + sign * motion.torque_z_N_m / machine.track_width_m
            speed = speed + np.abs(speed) * force / (machine.slip_stiffness_N / 2)
            if relaxing:
                speed = speed + relaxing * motion.force_rate_x_N_s / machine.slip_stiffness_N
        # the speed is the wheel rate times the radius of the machine file, which is wrong
        signals[f"speed_{side}_m_s"] = speed / (1.0 + machine.wheel_radius_excess)
    return signals


def _swap_sides_if_defective(
    scenario: Scenario, name: str, readings: dict[str, Floats]
) -> dict[str, Floats]:
    """Swap left and right if the scenario has this defect."""
    left, right = name.format("left"), name.format("right")
    if scenario.defects.sides_swapped:
        return {left: readings[right], right: readings[left]}
    return readings


def find_repeated_sample_indices(
    scenario: Scenario, times_since_start_ns: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Index (n,) of the sample that each message repeats: its own, unless frozen."""
    defects = scenario.defects
    every_ns = round(defects.frozen_every_s * 1e9)
    number = times_since_start_ns // every_ns
    starts_ns = number * every_ns
    stuck = (number > 0) & (times_since_start_ns - starts_ns < round(defects.frozen_s * 1e9))
    before = np.searchsorted(times_since_start_ns, starts_ns) - 1
    return np.where(stuck, before, np.arange(times_since_start_ns.size))


def low_pass_signals(
    signals: Callable[[NDArray[np.int64]], Mapping[str, Floats]],
    at_ns: NDArray[np.int64],
    lag_s: float,
) -> Mapping[str, Floats]:
    """Signals after a first-order low-pass, at rest before the first time.

    Args:
        signals: computes columns (m,) at m times in ns.
        at_ns: (n,) times, ascending.
        lag_s: time constant; 0 for no filter.
    """
    if not lag_s or not at_ns.size:
        return signals(at_ns)
    from scipy.signal import lfilter

    step_ns = max(round(min(LIMITS.filter_step_s, lag_s / LIMITS.filter_steps_per_lag) * 1e9), 1)
    grid_ns = np.arange(at_ns[0], at_ns[-1] + 2 * step_ns, step_ns)
    keeps = math.exp(-step_ns * 1e-9 / lag_s)
    # exact for a signal that is linear within each step
    mean = (1.0 - keeps) * lag_s / (step_ns * 1e-9)
    taken = [1.0 - mean, mean - keeps]
    since_s, grid_s = (at_ns - grid_ns[0]) * 1e-9, (grid_ns - grid_ns[0]) * 1e-9
    made: dict[str, Floats] = {}
    for name, values in signals(grid_ns).items():
        first = float(values[0])
        filtered = lfilter(taken, [1.0, -keeps], values, zi=[(1.0 - taken[0]) * first])[0]
        made[name] = np.interp(since_s, grid_s, filtered)
    return made


def simulate_boom_readings(
    scenario: Scenario, timeline: Timeline, at_ns: NDArray[np.int64], random_streams: RandomStreams
) -> dict[str, Floats]:
    """Angles of boom and bucket, positive up, in rad."""
    sample_position_boom_and_bucket, noise = (
        _interpolate_position_boom_and_bucket(timeline, at_ns),
        _boom_angle_noise_std_rad(scenario),
    )
    return {
        "boom_rad": sample_position_boom_and_bucket.boom_rad
        + random_streams.draw_white_noise("boom_rad", noise),
        "bucket_rad": sample_position_boom_and_bucket.bucket_rad
        + random_streams.draw_white_noise("bucket_rad", noise),
    }


def simulate_odometry_readings(
    scenario: Scenario, timeline: Timeline, at_ns: NDArray[np.int64], random_streams: RandomStreams
) -> dict[str, Floats]:
    """True position and heading along the way; speed and yaw rate with sensor noise."""
    motion, sensors = timeline.sample(at_ns), scenario.sensors
    speed = motion.wheel_speed_x_m_s + random_streams.draw_white_noise(
        "odometry_speed", sensors.speed_noise_m_s
    )
    rate = motion.yaw_rate_rad_s + random_streams.draw_white_noise(
        "odometry_yaw", sensors.gyro_noise_rad_s
    )
    return {
        "position_x_m": _interpolate_position_boom_and_bucket(timeline, at_ns).position_m,
        "heading_rad": motion.heading_rad,
        "speed_x_m_s": speed,
        "yaw_rate_rad_s": rate,
    }


def simulate_gnss_readings(
    scenario: Scenario, timeline: Timeline, at_ns: NDArray[np.int64], random_streams: RandomStreams
) -> dict[str, Floats]:
    """Latitude and longitude in degrees, on a sphere."""
    shift = scenario.shift
    assert shift is not None
    bearing = math.radians(shift.bearing_deg)
    along = _interpolate_position_boom_and_bucket(timeline, at_ns).position_m
    north = along * math.cos(bearing) + random_streams.draw_white_noise(
        "gnss_north", shift.gnss_noise_m
    )
    east = along * math.sin(bearing) + random_streams.draw_white_noise(
        "gnss_east", shift.gnss_noise_m
    )
    parallel_m = _EARTH_M * math.cos(math.radians(shift.latitude_deg))
    return {
        "latitude_deg": shift.latitude_deg + np.degrees(north / _EARTH_M),
        "longitude_deg": shift.longitude_deg + np.degrees(east / parallel_m),
    }


def _interpolate_position_boom_and_bucket(
    timeline: Timeline, at_ns: NDArray[np.int64]
) -> PositionBoomAndBucket:
    assert timeline.sample_position_boom_and_bucket is not None
    return timeline.sample_position_boom_and_bucket(at_ns)


def _boom_angle_noise_std_rad(scenario: Scenario) -> float:
    assert scenario.shift is not None
    return scenario.shift.boom_noise_rad


_Reader = Callable[[Scenario, Timeline, NDArray[np.int64], RandomStreams], dict[str, Floats]]
_READERS: Final[Mapping[TopicName, _Reader]] = {
    "imu": _simulate_imu_readings,
    "torque": _simulate_torque_readings,
    "speed": _simulate_speed_readings,
    "boom": simulate_boom_readings,
    "odometry": simulate_odometry_readings,
    "gnss": simulate_gnss_readings,
}
