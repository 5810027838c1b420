"""What a shift's recorder has besides: angles of boom and bucket, odometry, positions."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.motion.timeline import Hints, Timeline
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.sensors.random_streams import Streams
from estimators.arrays import Floats

#: Mean radius of the earth (IUGG).
_EARTH_M: Final = 6_371_008.8


def boom(
    scenario: Scenario, timeline: Timeline, at_ns: NDArray[np.int64], streams: Streams
) -> dict[str, Floats]:
    """Angles of boom and bucket, positive up, in rad."""
    hints, noise = _hints(timeline, at_ns), _shift_noise(scenario)
    return {
        "boom_rad": hints.boom_rad + streams.normal("boom_rad", noise),
        "bucket_rad": hints.bucket_rad + streams.normal("bucket_rad", noise),
    }


def odometry(
    scenario: Scenario, timeline: Timeline, at_ns: NDArray[np.int64], streams: Streams
) -> dict[str, Floats]:
    """Place along the way and heading as they are; speed and yaw rate with the sensors' noise."""
    motion, sensors = timeline.sample(at_ns), scenario.sensors
    speed = motion.wheel_speed_x_m_s + streams.normal("odometry_speed", sensors.speed_noise_m_s)
    rate = motion.yaw_rate_rad_s + streams.normal("odometry_yaw", sensors.gyro_noise_rad_s)
    return {
        "position_x_m": _hints(timeline, at_ns).position_m,
        "heading_rad": motion.heading_rad,
        "speed_x_m_s": speed,
        "yaw_rate_rad_s": rate,
    }


def gnss(
    scenario: Scenario, timeline: Timeline, at_ns: NDArray[np.int64], streams: Streams
) -> dict[str, Floats]:
    """Latitude and longitude in degrees, on a sphere."""
    shift = scenario.shift
    assert shift is not None
    bearing = math.radians(shift.bearing_deg)
    along = _hints(timeline, at_ns).position_m
    north = along * math.cos(bearing) + streams.normal("gnss_north", shift.gnss_noise_m)
    east = along * math.sin(bearing) + streams.normal("gnss_east", shift.gnss_noise_m)
    parallel_m = _EARTH_M * math.cos(math.radians(shift.latitude_deg))
    return {
        "latitude_deg": shift.latitude_deg + np.degrees(north / _EARTH_M),
        "longitude_deg": shift.longitude_deg + np.degrees(east / parallel_m),
    }


def _hints(timeline: Timeline, at_ns: NDArray[np.int64]) -> Hints:
    assert timeline.hints is not None
    return timeline.hints(at_ns)


def _shift_noise(scenario: Scenario) -> float:
    assert scenario.shift is not None
    return scenario.shift.boom_noise_rad
