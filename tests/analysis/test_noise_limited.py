"""Windows in which force is a function of speed: their acceleration is noise, and they say so."""

import numpy as np
import polars as pl
import pytest

from analysis.stages.estimation.method_estimates import summarise_masses, trace_estimates
from analysis.stages.gating.gate import gate_windows
from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from analysis.stages.noise.channel_noise import estimate_channel_noise
from analysis.stages.signals.align import align_channels_on_grid
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.timestamps import assign_timestamps
from tests.analysis.conftest import T0_NS, make_machine, topic
from tests.analysis.noisy_logs import KINEMATIC

CAR_KG, FRICTION_N_S_M = 1600.0, 40.0
METHODS = ("ls", "tls", "pooled")


def pull_away(v):
    """A drive whose torque grows with its speed, up to 6 kN, and then 60 kW."""
    return min(6000.0, 900.0 * (v + 0.05), 60e3 / max(v, 0.01))


def full_throttle(v):
    """6 kN, and then 30 kW."""
    return min(6000.0, 30e3 / max(v, 0.01))


def drives(starts, force_of_speed, lowest_m_s=0.0, stand_s=4.0, drive_s=12.0, brake_N=4000.0):
    """Speed and force (rows,) of a car that accelerates and brakes to the lowest speed, again."""
    rows = []
    v = lowest_m_s
    for _ in range(starts):
        rows += [(v, 0.0)] * round(stand_s * 100)
        for force in (force_of_speed, lambda _: -brake_N):
            k = 0
            while k < drive_s * 100 if force is force_of_speed else v > lowest_m_s:
                pushed = force(v)
                rows.append((v, pushed))
                v = max(v + (pushed - FRICTION_N_S_M * v) / CAR_KG / 100, lowest_m_s)
                k += 1
    return np.array(rows).T


def weighed(starts, force_of_speed, speed_noise_m_s, known=True, seed=1, index=None, **drive):
    """The masses, the accepted LS windows and the gate; with the log's noise, or without."""
    v, f = drives(starts, force_of_speed, **drive)
    generator = np.random.default_rng(seed)
    v = v + speed_noise_m_s * generator.normal(size=v.size)
    f = f + 20.0 * generator.normal(size=f.size)
    settings = {"acceleration": "kinematic", "methods": METHODS}
    settings |= {"index": index} if index else {}
    machine = make_machine(settings, body={"empty_mass_kg": CAR_KG}, **KINEMATIC)
    t = T0_NS + np.arange(v.size) * 10_000_000
    placed, _, _ = assign_timestamps({"/can": topic(t, force=f, speed=v)})
    channels, _ = derive_channels_in_si(read_measured_channels(placed, machine)[0], machine)
    aligned, _ = align_channels_on_grid(channels, machine)
    excitation = compute_excitation(
        smooth_by_trailing_mean(aligned, machine.settings.smooth), machine
    )
    noise = estimate_channel_noise(aligned, excitation, machine) if known else None
    gated = gate_windows(excitation, machine.settings, noise)
    estimates = trace_estimates(excitation, gated, machine.settings, noise)
    table = summarise_masses(excitation, gated, estimates, machine, noise)
    rows = {row["method"]: row for row in table.iter_rows(named=True)}
    return rows, estimates["ls"]["mass_kg"].drop_nulls().to_numpy(), gated


@pytest.mark.parametrize("starts", [1, 4, 30])
def test_windows_without_a_mass_in_them_no_longer_win(starts):
    """Pulling away with a force in proportion to speed; acceleration from the speed.

    Without the noise, LS is 22 kg ± 52 kg: the windows whose mass is noise have tiny residuals.
    """
    blind, windows, _ = weighed(starts, pull_away, 0.02, known=False)
    assert blind["ls"]["mass_kg"] < 0.1 * CAR_KG
    assert blind["tls"]["mass_kg"] < 0.1 * CAR_KG
    assert np.mean(windows < 0.5 * CAR_KG) > 0.5
    seen, windows, gated = weighed(starts, pull_away, 0.02)
    assert (gated["reason_x"] == "noise_limited").sum() > 100
    assert np.mean(windows < 0.5 * CAR_KG) < 0.03
    for method in METHODS:
        mass_kg, std_kg = seen[method]["mass_kg"], seen[method]["mass_std_kg"]
        assert mass_kg == pytest.approx(CAR_KG, rel=0.1), method
        assert abs(mass_kg - CAR_KG) < 3 * std_kg, method
        assert std_kg < 0.1 * CAR_KG, method


@pytest.mark.parametrize("starts", [1, 5])
def test_a_power_limited_car_that_never_stands_has_no_accepted_window(starts):
    """30 kW between 12 and 20 m/s, gate by the predicted deviation: LS was 29 kg ± 31 kg."""
    rolling = {"lowest_m_s": 12.0, "stand_s": 0.0, "drive_s": 20.0, "index": "variance"}
    blind, windows, _ = weighed(starts, full_throttle, 0.05, known=False, **rolling)
    assert blind["ls"]["mass_kg"] < 0.1 * CAR_KG
    assert (windows < 0.5 * CAR_KG).all()
    seen, windows, gated = weighed(starts, full_throttle, 0.05, **rolling)
    assert windows.size == 0
    assert (gated["reason_x"] == "noise_limited").any()
    assert all(row["mass_kg"] is None for row in seen.values())


def loader_starts(throttle_N, seed, rise_s=0.3):
    """Acceleration, speed and force (rows,) of four starts of a loader, with the sensors' noise."""
    rows = []
    v = 0.0
    for seconds, wanted in ((3.0, 0.0), (5.0, throttle_N), (2.0, -throttle_N / 2)) * 4:
        for k in range(round(seconds * 100)):
            pushed = wanted * min(1.0, k / 100 / rise_s) if v > 0.0 or wanted > 0.0 else 0.0
            a = (pushed - 2891.0 * v) / 3614.0
            rows.append((a, v, pushed))
            v = max(v + a / 100, 0.0)
    noise = np.random.default_rng(seed).normal(size=(len(rows), 3))
    return (np.array(rows) + np.array([0.01, 0.005, 60.0]) * noise).T


@pytest.mark.parametrize("throttle_N", [6000.0, 1500.0])
def test_clean_starts_keep_their_windows(throttle_N):
    """All but a few at the first moment of a start or long after: LS is a third off in those."""
    kept = []
    for seed in range(3):
        a, v, f = loader_starts(throttle_N, seed)
        machine = make_machine()
        t = T0_NS + np.arange(v.size) * 10_000_000
        placed, _, _ = assign_timestamps(
            {"/can": topic(t, force=f, speed=v), "/imu": topic(t, x=a)}
        )
        channels, _ = derive_channels_in_si(read_measured_channels(placed, machine)[0], machine)
        aligned, _ = align_channels_on_grid(channels, machine)
        excitation = compute_excitation(
            smooth_by_trailing_mean(aligned, machine.settings.smooth), machine
        )
        before = gate_windows(excitation, machine.settings)["accepted_x"].to_numpy()
        noise = estimate_channel_noise(aligned, excitation, machine)
        gated = gate_windows(excitation, machine.settings, noise)
        after = gated["accepted_x"].to_numpy()
        assert not (after & ~before).any()
        assert set(gated.filter(before & ~after)["reason_x"].cast(pl.String)) <= {"noise_limited"}
        kept.append(after.sum() / before.sum())
    assert np.mean(kept) > 0.93
