"""Channels in SI units at their own rates."""

import numpy as np
import polars as pl
import pytest

from analysis.stages.signals import filters
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.filters import count_lost_readings
from analysis.stages.signals.timestamps import assign_timestamps
from estimators.errors import DataError

MS = 1_000_000
T = np.arange(500) * 10 * MS + 1_700_000_000_000_000_000


def derived(raw, machine):
    read, losses = read_measured_channels(assign_timestamps(raw)[0], machine)
    channels, notes = derive_channels_in_si(read, machine)
    frames = {
        name: pl.DataFrame(
            {"unix_ns": t, name: x, **({} if known is None else {"known_ns": known})}
        )
        for name, (t, x, known) in channels.items()
    }
    return frames, losses, notes


def loader(raw_topic, **replaced):
    fields = {
        "force": np.linspace(0, 1000, 500),
        "speed": np.sin(np.arange(500) / 80),
        "x": np.cos(np.arange(500) / 80),
        **replaced,
    }
    return {
        "/can": raw_topic(T, force=fields["force"], speed=fields["speed"]),
        "/imu": raw_topic(T, x=fields["x"]),
    }


def test_without_a_derivative_nothing_is_filtered(raw_topic, machine):
    raw = loader(raw_topic)
    channels, losses, notes = derived(raw, machine())
    assert losses == notes == []
    assert set(channels) == {"force_x_N", "speed_x_m_s", "specific_force_x_m_s2", "direction_x_1"}
    np.testing.assert_array_equal(channels["force_x_N"]["force_x_N"], raw["/can"]["force"])
    np.testing.assert_array_equal(channels["force_x_N"]["unix_ns"], T)


def test_scale_offset_unit_and_delay_apply_in_that_order(raw_topic, machine):
    force = {
        "topic": "/can",
        "field": "force",
        "scale": -2.0,
        "offset": 1.0,
        "unit": "kN",
        "delay_s": 0.08,
    }
    raw = loader(raw_topic)
    channels, _, _ = derived(raw, machine(force_x_N=force))
    expected = 1000.0 * (1.0 - 2.0 * raw["/can"]["force"].to_numpy())
    np.testing.assert_allclose(channels["force_x_N"]["force_x_N"], expected)
    np.testing.assert_array_equal(channels["force_x_N"]["unix_ns"], T - 80 * MS)


def test_samples_that_are_no_number_are_left_out_and_counted(raw_topic, machine):
    force = np.ones(500)
    force[[3, 4, 77]] = [np.nan, np.inf, -np.inf]
    raw = loader(raw_topic, force=force)
    channels, losses, _ = derived(raw, machine())
    assert channels["force_x_N"].height == 497
    assert [loss.what for loss in losses] == [
        "3 of 500 samples of force are missing or not finite; they were excluded"
    ]


def test_error_codes_outside_the_valid_range_are_no_readings(raw_topic, machine):
    force = np.full(T.size, 50.0)
    force[[20, 21]], force[90] = -32_768.0, 32_767.0
    raw = loader(raw_topic, force=force)
    codes = {"topic": "/can", "field": "force", "scale": 2.0, "valid_range": (-32_000, 32_000)}
    made = machine(force_x_N=codes)
    read, losses = read_measured_channels(assign_timestamps(raw)[0], made)
    t, x = read["force_x_N"]
    assert (t.size, set(x)) == (T.size - 3, {100.0})
    assert [loss.what for loss in losses] == [
        "3 of 500 samples of force are outside valid_range, -32000 to 32000; they were excluded"
    ]


def test_a_range_without_readings_and_a_text_are_named_in_a_line(raw_topic, machine):
    far = {"topic": "/can", "field": "force", "valid_range": (2e4, 3e4)}
    with pytest.raises(DataError, match=r"force of /can has no reading in valid_range, 20000 to"):
        derived(loader(raw_topic), machine(force_x_N=far))
    with pytest.raises(DataError, match="not a number"):
        derived(loader(raw_topic, force=["a"] * T.size), machine(force_x_N=far))


def test_cells_without_a_number_are_not_outside_the_valid_range(raw_topic, machine):
    force = np.where(np.arange(T.size) % 5, np.nan, 50.0)
    near = {"topic": "/can", "field": "force", "valid_range": (0.0, 100.0)}
    _, losses, _ = derived(loader(raw_topic, force=force), machine(force_x_N=near))
    assert not any("valid_range" in loss.what for loss in losses)


def test_empty_cells_of_a_table_that_merges_two_rates_are_no_loss():
    assert count_lost_readings(T, np.arange(500) % 5 == 2) == 0


def test_readings_that_a_slow_column_lacks_are_counted():
    is_reading = np.arange(500) % 5 == 2
    is_reading[[102, 107]] = False
    assert count_lost_readings(T, is_reading) == 2


def test_readings_that_a_column_lacks_at_random_or_at_an_end_are_counted_in_full():
    is_reading = np.random.default_rng(1).random(500) < 0.4
    assert count_lost_readings(T, is_reading) == 500 - is_reading.sum()
    assert count_lost_readings(T, np.arange(500) >= 7) == 7
    assert count_lost_readings(T, np.arange(500) < 497) == 3


def test_of_samples_that_share_a_stamp_the_last_is_kept_and_the_others_counted(raw_topic, machine):
    t = T.copy()
    t[100] = t[101]
    raw = loader(raw_topic) | {"/imu": raw_topic(t, x=np.arange(500) * 1.0)}
    channels, losses, _ = derived(raw, machine())
    imu = channels["specific_force_x_m_s2"]
    assert imu.height == 499
    assert imu["specific_force_x_m_s2"][99:102].to_list() == [99.0, 101.0, 102.0]
    assert losses[0].what == "1 samples of x share a stamp with the next; the last of each was kept"


@pytest.mark.parametrize(
    ("values", "fault"),
    [
        (["fast"] * 500, "is String, not a number; choose another field"),
        ([None] * 500, "has no number in 500 samples"),
        ([np.nan] * 499 + [1.0], "has a single sample, but at least two are needed"),
    ],
)
def test_a_field_without_numbers_is_an_error_that_names_channel_field_and_topic(
    raw_topic, machine, values, fault
):
    with pytest.raises(DataError) as error:
        derived(loader(raw_topic, x=values), machine())
    assert str(error.value) == f"specific_force_x_m_s2: x of /imu {fault}"


def test_a_hint_without_numbers_is_a_loss_and_one_of_the_wrong_type_an_error(raw_topic, machine):
    hinted = machine(
        {"acceleration": "kinematic"},
        gear_ratio_1={"topic": "/imu", "field": "x"},
        acc_x_m_s2={"derive": "d/dt speed_x_m_s"},
        specific_force_x_m_s2=None,
    )
    channels, losses, _ = derived(loader(raw_topic, x=[None] * 500), hinted)
    assert "gear_ratio_1" not in channels
    assert str(losses[0]) == "gear_ratio_1: x of /imu has no number in 500 samples"
    with pytest.raises(DataError, match="gear_ratio_1: x of /imu is String"):
        derived(loader(raw_topic, x=["first"] * 500), hinted)


def test_a_causal_force_derived_of_a_channel_of_ones_own_is_known_when_that_is(raw_topic, machine):
    own = {
        "drive_A": {"topic": "/can", "field": "force"},
        "force_x_N": {"derive": "drive_A * 1 [N/A]"},
    }
    channels, _, _ = derived(loader(raw_topic), machine({"causal": True}, **own))
    assert "drive_A" not in channels
    assert (channels["force_x_N"]["known_ns"] >= channels["force_x_N"]["unix_ns"]).all()


POSITION = {
    "position_x_m": {"topic": "/can", "field": "speed"},
    "speed_x_m_s": {"derive": "d/dt position_x_m"},
    "acc_x_m_s2": {"derive": "d/dt speed_x_m_s"},
    "specific_force_x_m_s2": None,
}


def from_position(machine, **settings):
    return machine({"acceleration": "kinematic", **settings}, **POSITION)


def test_where_one_channel_is_derived_all_are_filtered_alike(raw_topic, machine):
    """A force that equals the position stays equal to it through the filter."""
    wave = np.random.default_rng(1).normal(size=500).cumsum()
    raw = loader(raw_topic, force=wave, speed=wave)
    channels, _, notes = derived(raw, from_position(machine))
    assert notes == []
    np.testing.assert_array_equal(
        channels["force_x_N"]["force_x_N"], channels["position_x_m"]["position_x_m"]
    )
    assert not np.array_equal(channels["force_x_N"]["force_x_N"], wave)


def test_a_chain_of_derivatives_of_a_parabola_is_its_speed_and_acceleration(raw_topic, machine):
    s = np.arange(500) / 100.0
    raw = loader(raw_topic, speed=0.5 * 0.8 * s**2)
    channels, _, _ = derived(raw, from_position(machine))
    inside = slice(50, -50)
    speed = channels["speed_x_m_s"]["speed_x_m_s"].to_numpy()
    np.testing.assert_allclose(speed[inside], 0.8 * s[inside], atol=1e-3)
    np.testing.assert_allclose(
        channels["acc_x_m_s2"]["acc_x_m_s2"].to_numpy()[inside], 0.8, atol=2e-2
    )


def test_by_default_a_pulse_stays_where_it_is_and_with_causal_nothing_looks_ahead(
    raw_topic, machine
):
    pulse = np.exp(-(((np.arange(500) - 250) / 15.0) ** 2))
    raw = loader(raw_topic, force=pulse)
    smooth, _, _ = derived(raw, from_position(machine, cutoff_hz=5.0))
    assert smooth["force_x_N"]["force_x_N"].arg_max() == 250
    causal = from_position(machine, cutoff_hz=5.0, causal=True)
    before, _, _ = derived(raw, causal)
    later = loader(raw_topic, force=np.where(np.arange(500) > 300, 1e6, pulse))
    after, _, _ = derived(later, causal)
    assert before["force_x_N"]["force_x_N"].arg_max() > 250
    assert before["force_x_N"][:301].equals(after["force_x_N"][:301])


def test_a_cutoff_above_0_45_of_a_topics_rate_is_not_applied_and_reported(raw_topic, machine):
    slow = slice(None, None, 4)
    raw = loader(raw_topic)
    raw["/slow"] = raw_topic(T[slow], force=np.random.default_rng(2).normal(size=125))
    mixed = machine(
        {"acceleration": "kinematic"},
        **POSITION | {"force_x_N": {"topic": "/slow", "field": "force"}},
    )
    channels, _, notes = derived(raw, mixed)
    assert notes == ["force_x_N: low-pass of 20 Hz not applied, its topic has only 25 Hz"]
    np.testing.assert_array_equal(channels["force_x_N"]["force_x_N"], raw["/slow"]["force"])


def test_angles_are_not_filtered(raw_topic, machine):
    raw = loader(raw_topic)
    channels, _, _ = derived(
        raw,
        machine(
            {"acceleration": "kinematic"},
            **POSITION | {"pitch_rad": {"topic": "/imu", "field": "x", "unit": "deg"}},
        ),
    )
    np.testing.assert_allclose(
        channels["pitch_rad"]["pitch_rad"], np.deg2rad(raw["/imu"]["x"].to_numpy())
    )


def test_the_pitch_of_a_quaternion_is_nose_up_and_in_the_topics_own_time(raw_topic, machine):
    raw = loader(raw_topic)
    n = raw["/imu"].height
    half = np.linspace(0.0, 0.1, n)
    parts = {"x": np.zeros(n), "y": -np.sin(half), "z": np.zeros(n), "w": np.cos(half)}
    raw["/imu"] = raw["/imu"].with_columns(
        pl.Series(f"orientation.{axis}", value) for axis, value in parts.items()
    )
    pitch = {"topic": "/imu", "derive": "pitch(orientation)"}
    channels, _, _ = derived(
        raw, machine({"acceleration": "kinematic"}, **POSITION | {"pitch_rad": pitch})
    )
    np.testing.assert_allclose(channels["pitch_rad"]["pitch_rad"], 2 * half, atol=1e-12)
    np.testing.assert_array_equal(channels["pitch_rad"]["unix_ns"], T)


SIDES = {
    "speed_left_m_s": {"topic": "/can", "field": "speed"},
    "speed_right_m_s": {"topic": "/imu", "field": "x"},
    "speed_x_m_s": {"derive": "mean(speed_left_m_s, speed_right_m_s)"},
}


def wheels(machine, settings=None, **channels):
    return machine(
        settings, specific_force_x_m_s2={"topic": "/imu", "field": "x"}, **SIDES, **channels
    )


def test_the_mean_of_two_sides_at_the_same_stamps(raw_topic, machine):
    raw = loader(raw_topic)
    channels, _, _ = derived(raw, wheels(machine))
    expected = (raw["/can"]["speed"] + raw["/imu"]["x"]) / 2.0
    np.testing.assert_allclose(channels["speed_x_m_s"]["speed_x_m_s"], expected)


def test_a_mean_interpolates_the_second_side_but_not_over_a_gap(raw_topic, machine):
    raw = loader(raw_topic, speed=np.full(500, 2.0))
    there = np.r_[20:200, 300:500]
    raw["/imu"] = raw_topic(T[there] + 4 * MS, x=np.where(there < 250, 0.0, 10.0))
    channels, _, _ = derived(raw, wheels(machine))
    mean = channels["speed_x_m_s"]
    stamps = mean["unix_ns"].to_numpy()
    assert stamps[0] == T[21]
    assert not ((stamps > T[200]) & (stamps < T[301])).any()
    assert mean["speed_x_m_s"].unique().sort().to_list() == [1.0, 6.0]


def test_a_side_that_comes_back_after_a_gap_makes_no_spike_of_acceleration(raw_topic, machine):
    raw = loader(raw_topic, speed=np.full(500, 2.0))
    there = np.r_[20:200, 300:500]
    raw["/imu"] = raw_topic(T[there] + 4 * MS, x=np.where(there < 250, 0.0, 10.0))
    made = wheels(
        machine,
        {"acceleration": "kinematic", "cutoff_hz": 40.0},
        acc_x_m_s2={"derive": "d/dt speed_x_m_s"},
    )
    channels, _, _ = derived(raw, made)
    np.testing.assert_allclose(channels["acc_x_m_s2"]["acc_x_m_s2"], 0.0, atol=1e-6)


def test_the_direction_is_the_sign_of_the_speed_beyond_its_deadband(raw_topic, machine):
    speed = np.tile([0.5, -0.5, 0.01, -0.01, 0.0], 100)
    channels, _, _ = derived(loader(raw_topic, speed=speed), machine())
    assert channels["direction_x_1"]["direction_x_1"][:5].to_list() == [1, -1, 1, -1, 0]
    dead = machine({"direction_deadband_m_s": 0.02})
    channels, _, _ = derived(loader(raw_topic, speed=speed), dead)
    assert channels["direction_x_1"]["direction_x_1"][:5].to_list() == [1, -1, 0, 0, 0]


def test_a_log_too_short_to_derive_from_is_an_error(raw_topic, machine):
    short = {name: frame[:10] for name, frame in loader(raw_topic).items()}
    with pytest.raises(
        DataError, match="force_x_N: every stretch between gaps of the log is too short"
    ):
        derived(short, from_position(machine))


def test_derived_channels_keep_ascending_stamps(raw_topic, machine):
    channels, _, _ = derived(loader(raw_topic), from_position(machine, causal=True))
    for frame in channels.values():
        assert (np.diff(frame["unix_ns"]) > 0).all()
    assert filters.compute_median_period_ns(channels["acc_x_m_s2"]["unix_ns"].to_numpy()) == 10 * MS


def test_what_stands_for_no_reading_is_left_out_and_counted(raw_topic, machine):
    """A logger that writes the largest float where its sensor is silent."""
    force = np.ones(500)
    force[[5, 6]] = [3.4e38, -1e300]
    channels, losses, _ = derived(loader(raw_topic, force=force), machine())
    assert channels["force_x_N"].height == 498
    assert [loss.what for loss in losses] == [
        "2 of 500 samples of force are beyond 1e+15 N, which cannot be a reading; they were "
        "excluded"
    ]


def test_a_field_of_nothing_but_that_is_an_error(raw_topic, machine):
    with pytest.raises(DataError, match="has only numbers beyond 1e\\+15 N"):
        derived(loader(raw_topic, force=np.full(500, 1e300)), machine())


def test_what_no_sensor_resolves_is_zero(raw_topic, machine):
    channels, losses, _ = derived(loader(raw_topic, force=np.full(500, 1e-310)), machine())
    assert (channels["force_x_N"]["force_x_N"] == 0.0).all()
    assert not losses
