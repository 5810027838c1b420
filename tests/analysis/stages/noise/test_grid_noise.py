"""Noise that the grid does not show, from the channels' own samples."""

import numpy as np
import polars as pl
import pytest
from scipy.signal import butter, sosfreqz

from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from analysis.stages.noise.channel_noise import estimate_channel_noise, list_noise_source_notes
from analysis.stages.noise.grid_noise import estimate_white_noise_std
from analysis.stages.signals.align import align_channels_on_grid
from analysis.stages.signals.derive import derive_channels_in_si
from tests.analysis.conftest import make_machine

MASS_KG, FORCE_N, SPEED_M_S = 1850.0, 20.0, 0.01
KINEMATIC = {
    "acc_x_m_s2": {"derive": "d/dt speed_x_m_s"},
    "specific_force_x_m_s2": None,
}


def readings(rate_hz, seconds=120.0, seed=1, force_N=FORCE_N, speed_m_s=SPEED_M_S):
    """A car that speeds up and slows down and never stands, by its force and its speed."""
    rng = np.random.default_rng(seed)
    t = np.arange(seconds * rate_hz) / rate_hz
    speed = 12.0 + 4.0 * np.sin(0.7 * t) + 2.0 * np.sin(1.9 * t)
    acceleration = 2.8 * np.cos(0.7 * t) + 3.8 * np.cos(1.9 * t)
    force = MASS_KG * acceleration + 20.0 * speed + 150.0
    t_ns = np.round(t * 1e9).astype(np.int64)
    return {
        "force_x_N": (t_ns, force + rng.normal(0.0, force_N, t.size)),
        "speed_x_m_s": (t_ns, speed + rng.normal(0.0, speed_m_s, t.size)),
    }


def noise_of(read, **settings):
    """`noise` of a car at these settings."""
    given = {name.replace("__", "."): value for name, value in settings.items()}
    machine = make_machine(settings={"acceleration": "kinematic"}, **KINEMATIC)
    machine = machine.model_copy(update={"settings": machine.settings.copy_with_changes(given)})
    aligned, _ = align_channels_on_grid(derive_channels_in_si(read, machine)[0], machine)
    excitation = compute_excitation(
        smooth_by_trailing_mean(aligned, machine.settings.smooth), machine
    )
    return estimate_channel_noise(aligned, excitation, machine, read), aligned


def stds(noise):
    own = noise.filter((pl.col("first") == pl.col("second")) & (pl.col("lag") == 0))
    return {
        n: (float(np.sqrt(c)), s) for n, c, s in own.select("first", "covariance", "source").rows()
    }


def filtered(rate_hz, cutoff_hz):
    """Standard deviations of force, speed and its derivative after the filter, by its response."""
    at = (np.arange(8192) + 0.5) / 16384.0
    sos = butter(4, cutoff_hz, fs=rate_hz, output="sos")
    low = np.abs(sosfreqz(sos, 2.0 * np.pi * at)[1]) ** 4
    slope = (np.sin(2.0 * np.pi * at) * rate_hz) ** 2
    shares = np.sqrt([low.mean(), low.mean(), (low * slope).mean()])
    return dict(
        zip(
            ("force_x_N", "speed_x_m_s", "regressor_acc_x_m_s2"),
            shares * [FORCE_N, SPEED_M_S, SPEED_M_S],
            strict=True,
        )
    )


@pytest.mark.parametrize("cutoff_hz", [1.0, 2.0, 3.0, 5.0])
def test_a_filter_that_leaves_no_band_is_seen_through(cutoff_hz):
    """They were 3 kN, 37 kN and 3 MN at 3, 2 and 1 Hz."""
    found = stds(noise_of(readings(100.0), filter__cutoff_hz=cutoff_hz)[0])
    for name, expected in filtered(100.0, cutoff_hz).items():
        std, source = found[name]
        assert std == pytest.approx(expected, rel=0.1), name
        assert source == "samples"


@pytest.mark.parametrize("grid_hz", [80.0, 50.0, 25.0, 20.0, 10.0])
def test_a_grid_slower_than_the_log_makes_no_noise(grid_hz):
    """It was 1e14 m/s² at 50 Hz and less."""
    found = stds(noise_of(readings(100.0), align__rate_hz=grid_hz)[0])
    assert 0.02 < found["regressor_acc_x_m_s2"][0] < 0.4
    assert found["regressor_acc_x_m_s2"][1] == "samples"


def test_at_the_logs_own_rate_and_the_usual_cutoff_the_grid_shows_it():
    found = stds(noise_of(readings(100.0))[0])
    assert {source for _, source in found.values()} == {"differences"}
    for name, expected in filtered(100.0, 20.0).items():
        assert found[name][0] == pytest.approx(expected, rel=0.1)


def test_the_covariances_of_a_mean_follow():
    """The noise of a derivative falls with the length of the mean, that of the force slower."""
    noise, _ = noise_of(readings(100.0), filter__cutoff_hz=2.0)
    acc, force = (
        noise.filter((pl.col("first") == name) & (pl.col("second") == name))
        .sort("lag")["covariance"]
        .to_numpy()
        for name in ("regressor_acc_x_m_s2", "force_x_N")
    )
    assert acc.min() < -0.3 * acc[0]
    assert force.min() > -0.3 * force[0]


def test_a_lower_cutoff_is_a_remedy():
    """The check that calls a log noisy says so."""
    by_cutoff = [
        stds(noise_of(readings(100.0), filter__cutoff_hz=hz)[0])["regressor_acc_x_m_s2"][0]
        for hz in (20.0, 10.0, 5.0, 3.0, 2.0, 1.0)
    ]
    assert by_cutoff == sorted(by_cutoff, reverse=True)


def test_noise_is_never_more_than_the_equation_leaves_over():
    """At 1 Hz fast changes are driving: they say 260 N where 20 N are."""
    read = readings(1.0, 900.0)
    noise, aligned = noise_of(read, align__rate_hz=1.0, smooth__samples=1)
    found = stds(noise)
    assert found["force_x_N"][1] == "residuals"
    moved = aligned.select("acc_x_m_s2", "speed_x_m_s").to_numpy()
    known = np.isfinite(moved).all(axis=1)
    A = np.column_stack([moved[known], np.ones(int(known.sum()))])
    force = aligned["force_x_N"].to_numpy()[known]
    left = force - A @ np.linalg.lstsq(A, force, rcond=None)[0]
    assert found["force_x_N"][0] <= 1.05 * float(left.std())


def test_noise_is_never_more_than_the_channel_varies():
    rng = np.random.default_rng(3)
    read = readings(1.0, 900.0)
    t_ns, force = read["force_x_N"]
    read["force_x_N"] = t_ns, rng.permutation(force)
    noise, aligned = noise_of(read, align__rate_hz=1.0, smooth__samples=1)
    for name, (std, _) in stds(noise).items():
        column = aligned["acc_x_m_s2" if "acc" in name else name].to_numpy()
        assert std <= 1.25 * float(np.nanstd(column)), name


def test_a_note_says_what_tells_the_noise():
    noise, _ = noise_of(readings(100.0), filter__cutoff_hz=2.0)
    assert list_noise_source_notes(noise) == [
        "noise of regressor_acc_x_m_s2, speed_x_m_s, force_x_N: estimated from the raw "
        "samples and propagated through filter and derivative, because the grid is too coarse to "
        "show it"
    ]
    assert list_noise_source_notes(noise_of(readings(100.0))[0]) == []


@pytest.mark.parametrize("rate_hz", [10_000.0, 1_000.0, 100.0, 50.0, 10.0])
def test_a_channels_own_samples_tell_its_noise(rate_hz):
    t_ns, force = readings(rate_hz, 300.0)["force_x_N"]
    assert estimate_white_noise_std(t_ns, force, 3e9 / rate_hz) == pytest.approx(FORCE_N, rel=0.15)


def test_steps_of_a_reading_are_noise_of_a_twelfth_of_their_square():
    t_ns, speed = readings(100.0, speed_m_s=1e-9)["speed_x_m_s"]
    step = 0.1
    found = estimate_white_noise_std(t_ns, np.round(speed / step) * step, 3e7)
    assert found == pytest.approx(step / np.sqrt(12.0), rel=0.05)


def test_the_same_log_has_the_same_noise():
    one, two = (noise_of(readings(100.0), filter__cutoff_hz=2.0)[0] for _ in range(2))
    assert one.equals(two)
