"""The noise of every column from the log, where it is known."""

import numpy as np
import polars as pl
import pytest

from analysis.model.axes import X, Z
from analysis.model.schema import NOISE_COLUMNS
from analysis.model.settings import NoiseSettings
from analysis.stages.noise.channel_noise import estimate_channel_noise
from analysis.stages.noise.column_noise import ColumnNoise
from tests.analysis.noisy_logs import STD, noisy_log

KINDS = (
    "white",
    "interpolated",
    "vibration in motion",
    "interpolated, vibration in motion",
    "quantised speed",
    "derived acceleration",
    "white, never stands",
    "derived acceleration, never stands",
)
MEAN = 10


def estimated(log):
    frame = estimate_channel_noise(log.aligned, log.excitation, log.machine)
    known = ColumnNoise.select_axis_noise(X, frame, NoiseSettings())
    assert known is not None
    return frame, known


def sources(frame):
    own = frame.filter((pl.col("first") == pl.col("second")) & (pl.col("lag") == 0))
    return dict(own.select("first", "source").iter_rows())


@pytest.mark.parametrize("kind", KINDS)
def test_the_standard_deviation_is_right_within_fifteen_percent(kind):
    """R.m.s. over seeds: of a sample, and of the means that the equations are made of."""
    ratios = []
    for seed in range(910, 916):
        log = noisy_log(kind, seed)
        _, known = estimated(log)
        means = np.sqrt(np.diag(known.compute_covariance_of_means(MEAN)))
        ratios.append(
            [*(known.stds_of_one_sample / log.std_of_means(1)), *(means / log.std_of_means(MEAN))]
        )
    error = np.sqrt((np.log(ratios) ** 2).mean(axis=0))
    assert (error < 0.15).all(), error


def test_each_column_says_what_its_noise_is_from():
    assert set(sources(estimated(noisy_log("white", 1))[0]).values()) == {"standstill"}
    assert set(sources(estimated(noisy_log("white, never stands", 1))[0]).values()) == {
        "differences"
    }
    quantised = sources(estimated(noisy_log("quantised speed", 1))[0])
    assert quantised["speed_x_m_s"] == "differences"
    assert quantised["force_x_N"] == "standstill"


def test_a_setting_overrides_the_log_with_white_noise():
    log = noisy_log("white", 1)
    settings = log.machine.settings.copy_with_changes({"noise.force_N": 7.0})
    machine = log.machine.model_copy(update={"settings": settings})
    frame = estimate_channel_noise(log.aligned, log.excitation, machine)
    assert sources(frame)["force_x_N"] == "setting"
    known = ColumnNoise.select_axis_noise(X, frame, settings.noise)
    assert known is not None
    assert known.stds_of_one_sample[2] == pytest.approx(7.0)
    assert known.compute_covariance_of_means(MEAN)[2] == pytest.approx([0.0, 0.0, 4.9])
    assert known.stds_of_one_sample[:2] == pytest.approx(STD[:2], rel=0.15)


def test_throttle_steps_are_no_noise():
    """Twelve steps of 4 kN leave the force's noise as it is without standstill to tell it."""
    log = noisy_log("white, never stands", 5)
    _, known = estimated(log)
    assert known.stds_of_one_sample[2] == pytest.approx(60.0, rel=0.1)


def test_a_derivative_shares_the_noise_of_its_speed():
    """The mean of a derivative falls with its samples, that of white noise with their root."""
    for kind in ("derived acceleration", "derived acceleration, never stands"):
        _, known = estimated(noisy_log(kind, 3))
        ten, forty = (
            np.sqrt(known.compute_covariance_of_means(samples)[0, 0]) for samples in (10, 40)
        )
        assert 3.0 < ten / forty < 5.0, kind
        # dv/dt leads v: what is fast now was slow before
        later = known.covariances[1, 0, 3] - known.covariances[0, 1, 3]
        assert later < 0.0, kind


def test_the_covariance_of_a_mean_is_that_of_all_pairs():
    log = noisy_log("derived acceleration", 4)
    _, known = estimated(log)
    for samples in (1, 10, 64):
        lag = np.arange(samples)[None, :] - np.arange(samples)[:, None]
        ahead = known.covariances[:, :, np.abs(lag)]
        both = np.where(lag >= 0, ahead, ahead.transpose(1, 0, 2, 3))
        expected = both.mean(axis=(2, 3))
        np.testing.assert_allclose(
            np.diag(known.compute_covariance_of_means(samples)),
            np.maximum(np.diag(expected), 0.0),
            rtol=0.05,
        )


def test_a_log_too_short_to_tell_has_no_noise_rather_than_a_fault():
    log = noisy_log("white", 1)
    short = estimate_channel_noise(log.aligned[:20], log.excitation[:20], log.machine)
    assert short["covariance"].to_list() == [0.0] * short.height
    empty = estimate_channel_noise(log.aligned[:0], log.excitation[:0], log.machine)
    assert empty.height == short.height


def test_rows_are_in_the_order_of_the_declared_columns():
    frame, _ = estimated(noisy_log("white", 1))
    assert frame["first"].unique(maintain_order=True).to_list() == list(NOISE_COLUMNS["x"])
    assert frame.height == 3 * 3 * 64
    assert ColumnNoise.select_axis_noise(Z, frame, NoiseSettings()) is None


def test_without_a_log_settings_that_name_all_of_an_axis_are_its_noise():
    assert ColumnNoise.select_axis_noise(X, None, NoiseSettings(force_N=60.0)) is None
    whole = NoiseSettings(force_N=60.0, acc_m_s2=0.01, speed_m_s=0.005)
    known = ColumnNoise.select_axis_noise(X, None, whole)
    assert known is not None
    np.testing.assert_allclose(known.compute_covariance_of_means(MEAN), np.diag(STD**2) / MEAN)
