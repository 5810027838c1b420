"""The phase of motion, from speed and yaw rate alone."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.model.schema import build_frame
from analysis.model.settings import Settings
from analysis.stages.motion.phases import (
    classify_motion_phases,
    compute_sign_of_yaw_rate_change,
    compute_trailing_speed_rate,
    mark_samples_held_downhill,
    mark_speed_falls_beyond_noise,
    mark_stopping_samples,
)


def classify(speed, settings=None, **columns):
    settings = settings or Settings()
    speed = np.asarray(speed, float)
    frame = build_frame(
        "aligned",
        {
            "t_ns": np.arange(speed.size) * 10_000_000,
            "speed_x_m_s": speed,
            **columns,
            "gap": np.zeros(speed.size, bool),
        },
    )
    return classify_motion_phases(
        frame, speed, compute_trailing_speed_rate(speed, settings), settings
    ).cast(pl.String)


def runs(found):
    return [name for name in found.rle().struct.unnest()["value"] if name is not None]


UP, CRUISE, DOWN = np.linspace(0, 2, 200), np.full(100, 2.0), np.linspace(2, 0, 200)
TRIP = np.concatenate([np.zeros(100), UP, CRUISE, DOWN, np.zeros(100)])


@pytest.mark.parametrize("direction", [1.0, -1.0], ids=["forward", "reverse"])
def test_a_trip_stands_accelerates_cruises_brakes_and_stands(direction):
    found = classify(direction * TRIP)
    # the rate looks back a tenth of a second, so each change shows within that
    assert found[20:100].unique().to_list() == ["standstill"]
    assert found[120:300].unique().to_list() == ["accelerating"]
    assert found[320:400].unique().to_list() == ["cruising"]
    assert found[420:600].unique().to_list() == ["braking"]
    assert found[620:].unique().to_list() == ["standstill"]


def test_a_reversal_passes_through_zero_without_a_standstill():
    reversal = classify(np.linspace(2.0, -2.0, 400))[20:]
    assert runs(reversal) == ["braking", "accelerating"]


@pytest.mark.parametrize("pitch", [-0.0873, 0.0873])
def test_a_slope_on_the_accelerometer_changes_no_phase(drive, excitation_of, pitch):
    flat, sloped = excitation_of(drive()), excitation_of(drive(pitch_rad=pitch))
    shift = sloped["specific_force_x_m_s2"] - flat["specific_force_x_m_s2"]
    assert abs(shift.mean()) == pytest.approx(0.855, abs=1e-3)
    assert sloped["phase"].equals(flat["phase"])


@pytest.mark.parametrize(
    ("speed", "yaw_rate", "expected"),
    [
        (np.zeros(100), np.full(100, 0.5), "spinning"),
        (np.ones(100), np.full(100, 0.5), "arc"),
        (np.ones(100), np.full(100, -0.5), "arc"),
        (np.linspace(0.5, 2, 100), np.full(100, 0.5), "turning"),
        (np.ones(100), np.linspace(0.1, 1.0, 100), "turning"),
        (np.ones(100), np.full(100, 0.01), "cruising"),
    ],
)
def test_turning_is_told_from_the_yaw_rate(speed, yaw_rate, expected):
    found = classify(speed, yaw_rate_rad_s=yaw_rate)[20:]
    assert runs(found) == [expected]


def test_a_yaw_acceleration_that_is_measured_is_used():
    found = classify(np.ones(100), yaw_rate_rad_s=np.full(100, 0.5), yaw_acc_rad_s2=np.ones(100))
    assert runs(found) == ["turning"]


def test_a_derived_yaw_acceleration_as_noisy_as_a_gyroscope_makes_it_leaves_an_arc_whole():
    generator = np.random.default_rng(1)
    noisy = 0.03 * generator.normal(size=600)
    found = classify(np.ones(600), yaw_rate_rad_s=np.full(600, 0.5), yaw_acc_rad_s2=noisy)[20:]
    assert runs(found) == ["arc"]


@pytest.mark.parametrize("direction", [1.0, -1.0], ids=["left", "right"])
def test_a_turn_speeds_up_keeps_its_rate_and_slows_down(direction):
    settings = Settings()
    yaw_rate = direction * np.interp(np.arange(600), [100, 300, 400, 600], [0.0, 1.0, 1.0, 0.0])
    changes = compute_sign_of_yaw_rate_change(yaw_rate, settings)
    assert set(changes[20:100]) == {0.0}
    assert set(changes[120:300]) == {1.0}
    assert set(changes[320:400]) == {0.0}
    assert set(changes[420:]) == {-1.0}


def test_without_speed_or_its_rate_there_is_no_phase():
    speed = TRIP.copy()
    speed[300] = np.nan
    found = classify(speed)
    assert found[:10].null_count() == 10
    assert found[300:311].null_count() == 11
    assert found[10:300].null_count() == found[311:].null_count() == 0


@given(st.floats(0.01, 2.0), st.integers(0, 80), st.integers(1, 5))
def test_the_rate_of_speed_never_reaches_over_a_missing_sample(span_s, at, lost):
    settings = Settings(phases={"speed_rate_span_s": span_s}, align={"rate_hz": 20})
    span = max(1, round(span_s * 20))
    speed = np.where(np.arange(120) < at, 0.0, 1000.0)
    speed[at : at + lost] = np.nan
    rate = compute_trailing_speed_rate(speed, settings)
    assert np.isnan(rate[:span]).all()
    assert np.isnan(rate[at : at + lost + span]).all()
    known = np.isfinite(rate)
    np.testing.assert_array_equal(rate[known], 0.0)


@given(st.floats(-5, 5), st.floats(-3, 3))
def test_the_rate_of_a_steady_change_is_that_change_and_looks_back_only(start, slope):
    speed = start + slope * np.arange(100) / 100.0
    settings = Settings()
    rate = compute_trailing_speed_rate(speed, settings)
    np.testing.assert_allclose(rate[10:], slope, atol=1e-9)
    later = speed.copy()
    later[60:] = 1e6
    np.testing.assert_array_equal(compute_trailing_speed_rate(later, settings)[:60], rate[:60])


def test_a_log_of_no_rows_has_no_phases():
    assert classify([]).len() == 0
    assert classify([1.0]).to_list() == [None]


class TestStopping:
    """Speeds at 100 Hz; cruise at 1 m/s, and standstill where the speed is 0."""

    STANDS, CRUISE = np.zeros(100), np.full(300, 1.0)
    GENTLE = np.arange(1.0, 0.0, -0.001)  # 0.1 m/s²
    HARSH = np.arange(1.0, 0.0, -0.02)

    def found(self, *parts, noise_m_s=0.01):
        speed = np.concatenate(parts)
        return mark_stopping_samples(speed, np.abs(speed) < 0.02, noise_m_s, Settings())

    @pytest.mark.parametrize("direction", [1.0, -1.0], ids=["forward", "reverse"])
    def test_a_gentle_stop_is_found_from_its_beginning(self, direction):
        start = direction * np.concatenate([self.STANDS, np.linspace(0, 1, 100), self.CRUISE])
        found = self.found(start, direction * self.GENTLE, self.STANDS)
        began = start.size
        # a fall of 0.015 m/s shows after 0.15 s
        assert not found[: began + 10].any()
        assert found[began + 20 : began + 970].all()

    def test_what_follows_braking_down_to_the_stand_is_found(self):
        tail = np.arange(0.3, 0.0, -0.0005)
        found = self.found(self.STANDS, self.CRUISE, np.arange(1.0, 0.3, -0.02), tail, self.STANDS)
        first = self.STANDS.size + self.CRUISE.size + 35
        assert found[first : first + tail.size - 40].all()

    def test_a_cruise_before_a_harsh_stop_is_not_found(self):
        found = self.found(self.STANDS, self.CRUISE, self.HARSH, self.STANDS)
        assert not found[: self.STANDS.size + self.CRUISE.size].any()

    def test_a_slower_cruise_between_two_stops_is_not_found(self):
        slower = np.full(300, 0.5)
        found = self.found(
            self.STANDS, self.CRUISE, self.HARSH[:25], slower, self.HARSH[25:], self.STANDS
        )
        before = self.STANDS.size + self.CRUISE.size + 25
        # a second after the braking it has been steady
        assert not found[: before + slower.size].any()

    def test_a_cruise_that_slows_down_without_a_stand_is_not_found(self):
        found = self.found(self.STANDS, self.CRUISE, self.GENTLE[:500], np.full(300, 0.5))
        assert not found.any()

    def test_acceleration_is_no_stop_however_slow(self):
        found = self.found(self.STANDS, np.linspace(0.02, 0.03, 200), self.STANDS)
        assert not found[: self.STANDS.size + 190].any()


class TestFallsBeyondNoise:
    """Speeds at 25 Hz, of which noise makes one in six rows of a cruise fall like braking."""

    SETTINGS = Settings.model_validate({"align": {"rate_hz": 25.0}, "smooth": {"samples": 2}})
    NOISE_M_S = 0.0085
    CRUISE = np.full(3000, 5.0)

    def found(self, *parts, noise_m_s=NOISE_M_S):
        speed = np.concatenate(parts)
        noisy = speed + np.random.default_rng(5).normal(0.0, noise_m_s, speed.size)
        return mark_speed_falls_beyond_noise(noisy, noise_m_s, self.SETTINGS)

    def test_a_cruise_hardly_ever_falls(self):
        assert self.found(self.CRUISE).mean() < 0.05

    @pytest.mark.parametrize("direction", [1.0, -1.0], ids=["forward", "reverse"])
    @pytest.mark.parametrize("brakes_m_s2", [0.25, 1.0])
    def test_braking_is_a_fall_from_its_first_row_to_its_last(self, direction, brakes_m_s2):
        fall = np.arange(5.0, 2.0, -brakes_m_s2 / 25.0)
        slower = np.full(300, 2.0)
        found = self.found(*(direction * part for part in (self.CRUISE, fall, slower)))
        assert found[3000 : 3000 + fall.size].all()
        assert not found[3020 + fall.size :].any()

    def test_without_noise_the_phase_has_the_last_word(self):
        assert self.found(self.CRUISE, noise_m_s=1e-4).all()

    def test_beside_a_hole_every_fall_may_be_braking(self):
        found = self.found(self.CRUISE, np.full(1, np.nan), self.CRUISE)
        assert found[3000:3006].all()


class TestDescents:
    """A drive of 12 s at a constant speed, of which gravity pulls along the way for 4 s."""

    def held(self, force_N: float, grade_m_s2: float = 0.6, pulls_s: float = 4.0, way: float = 1.0):
        rows = np.arange(1_200)
        pulls = (rows >= 400) & (rows < 400 + 100 * pulls_s)
        excitation = build_frame(
            "excitation",
            {
                "t_ns": rows * 10_000_000,
                "force_x_N": way * np.where(pulls, force_N, 3_000.0),
                "speed_x_m_s": np.full(rows.size, way * 3.0),
                "regressor_acc_x_m_s2": way * np.where(pulls, -grade_m_s2, 0.1),
            },
        )
        return mark_samples_held_downhill(excitation, Settings()), pulls

    @pytest.mark.parametrize("way", [1.0, -1.0])
    def test_one_with_an_idle_drive_may_be_held_by_brakes(self, way):
        found, pulls = self.held(0.0, way=way)
        assert found[pulls][20:].all()
        assert not found[~pulls][:400].any()

    def test_one_that_the_motor_holds_or_drives_is_left(self):
        assert not self.held(1_000.0)[0].any()

    def test_a_grade_that_rolling_resistance_takes_is_none(self):
        assert not self.held(0.0, grade_m_s2=0.2)[0].any()

    def test_a_moment_is_none(self):
        assert not self.held(0.0, pulls_s=0.8)[0].any()

    def test_of_a_log_of_no_force_nothing_is_marked(self):
        excitation = build_frame(
            "excitation", {"t_ns": np.arange(5), "force_x_N": np.full(5, np.nan)}
        )
        assert not mark_samples_held_downhill(excitation, Settings()).any()
