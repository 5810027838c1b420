"""A squat without a pitch channel: wheels of a known radius show it, others leave it in the ±."""

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
import polars as pl
import pytest

from tests.analysis.weighing.weighed import RICH, Weighed, merged, weighed

SQUAT_DEG_S2_M = 0.3
#: What the accelerometer sees of gravity, over the acceleration.
SQUAT_1 = float(np.deg2rad(SQUAT_DEG_S2_M)) * 9.80665
KNOWN_RADIUS = {"wheel_radius_m": 0.42, "wheel_radius_u_m": 0.001}


@cache
def squatting(*, radius_known: bool, deg_s2_m: float = SQUAT_DEG_S2_M) -> Weighed:
    scenario = merged(RICH, {"chassis": {"squat_deg_s2_m": deg_s2_m}})
    return weighed(scenario, body=KNOWN_RADIUS if radius_known else {"wheel_radius_u_m": None})


def squat_of(log: Weighed) -> tuple[float, float]:
    wheels = log.weighing.fit.kinematics
    assert wheels is not None
    return wheels.squat


@pytest.mark.heavy
def test_wheels_of_a_known_radius_show_the_squat() -> None:
    share, std = squat_of(squatting(radius_known=True))
    assert share == pytest.approx(SQUAT_1, abs=0.006)
    assert abs(share - SQUAT_1) < 2.0 * std


@pytest.mark.heavy
def test_taken_off_it_leaves_the_mass_right_and_surer() -> None:
    known, unknown = squatting(radius_known=True), squatting(radius_known=False)
    assert not known.load["withheld"]
    assert abs(known.error_u) < 2.0
    assert abs(known.load["mass_kg"] / known.true_kg - 1.0) < SQUAT_1 / 3.0
    assert known.load["u_kg"] < 0.7 * unknown.load["u_kg"]


def test_wheels_of_an_unknown_radius_may_be_wrong_themselves() -> None:
    unknown = squatting(radius_known=False)
    assert squat_of(unknown) == (0.0, 0.0)
    assert "wheel_imu_gain_error" in unknown.fired
    assert abs(unknown.error_u) < 3.0


@pytest.mark.heavy
def test_wheels_that_are_wrong_by_less_than_their_uncertainty_are_no_squat() -> None:
    """Wheels 5 % larger than stated, known to 2 %."""
    larger = {"wheel_radius_m": 0.42, "wheel_radius_u_m": 0.02 * 0.42}
    log = weighed(merged(RICH, {"chassis": {"squat_deg_s2_m": SQUAT_DEG_S2_M}}), body=larger)
    assert squat_of(log) == (0.0, 0.0)
    assert "wheel_imu_gain_error" in log.fired


@pytest.mark.heavy
def test_a_stiff_body_has_no_squat() -> None:
    log = squatting(radius_known=True, deg_s2_m=0.0)
    assert squat_of(log) == (0.0, 0.0)


def hide_squat(topics: Mapping[str, pl.DataFrame]) -> dict[str, pl.DataFrame]:
    """Topics whose pitch is that of a map: the ground's, which is level."""
    noise = np.random.default_rng(5).normal(0.0, 0.0005, topics["imu"].height)
    return {**topics, "imu": topics["imu"].with_columns(pitch_rad=noise)}


def show_squat(topics: Mapping[str, pl.DataFrame]) -> dict[str, pl.DataFrame]:
    """Topics as they are."""
    return dict(topics)


@cache
def with_pitch(changed: Callable[..., dict[str, pl.DataFrame]]) -> Weighed:
    scenario = merged(RICH, {"chassis": {"squat_deg_s2_m": SQUAT_DEG_S2_M}})
    channel = 'channels.pitch_rad={topic="imu", field="pitch_rad"}'
    return weighed(scenario, channel, body=KNOWN_RADIUS, changed=changed)


@pytest.mark.heavy
def test_a_pitch_that_shows_the_squat_is_believed() -> None:
    kinematics = with_pitch(show_squat).weighing.fit.kinematics
    assert kinematics is not None
    assert kinematics.pitch_shows_squat
    assert kinematics.squat[0] == pytest.approx(SQUAT_1, abs=0.006)


@pytest.mark.heavy
def test_a_pitch_that_hides_the_squat_is_outvoted_by_wheels_of_a_known_radius() -> None:
    log = with_pitch(hide_squat)
    kinematics = log.weighing.fit.kinematics
    assert kinematics is not None
    assert not kinematics.pitch_shows_squat
    assert kinematics.squat[0] == pytest.approx(SQUAT_1, abs=0.006)
    assert abs(log.error_u) < 2.0
    assert abs(log.load["mass_kg"] / log.true_kg - 1.0) < SQUAT_1 / 3.0
