"""Drives in the plane as sensors say them: starts, spins, arcs and joint motion, with noise.

Speeds are prescribed or pushed through first-order friction; force and yaw torque are what Newton
and Euler ask for (`estimators.planar.planar_rows.regressor` times the loader's parameters).
"""

import numpy as np
import polars as pl

from analysis.diagnosis import CheckInputs, judge_log_by_checks
from analysis.model.machine import Machine
from analysis.model.verdict import Verdict
from analysis.planar.centre_of_mass import make_planar_frames
from analysis.stages.estimation.method_estimates import (
    summarise_masses,
    trace_estimates,
    withhold_masses,
)
from analysis.stages.gating.gate import gate_windows
from analysis.stages.gating.segments import estimate_each_manoeuvre_by_pooling
from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from analysis.stages.noise.channel_noise import estimate_channel_noise
from analysis.stages.signals.align import align_channels_on_grid
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.mounting import compute_rotation_to_machine_axes
from estimators.planar import planar_rows as model
from tests.analysis.settings_by_name import staged

RATE_HZ = 100
#: In the order of `model.PARAMETERS`: a loader whose centre of mass lies 138 mm ahead.
LOADER = np.array([3614.0, 4200.0, 500.0, -60.0, 2891.0, 1500.0])
NOISE = {
    "force_x_N": 60.0,
    "torque_z_N_m": 45.0,
    "speed_x_m_s": 0.005,
    "specific_force_x_m_s2": 0.01,
    "specific_force_y_m_s2": 0.01,
    "specific_force_z_m_s2": 0.01,
    "roll_rate_rad_s": 0.001,
    "pitch_rate_rad_s": 0.001,
    "yaw_rate_rad_s": 0.001,
}


def hold(seconds, v=0.0, omega=0.0):
    """Both kept."""
    return _ramp(seconds, v, v, omega, omega)


def start(sign=1.0, seconds=5.0, force_N=6000.0):
    """Straight: a force that rises steadily, against viscous friction."""
    v = _pushed(seconds, sign * force_N, LOADER[0], LOADER[4])
    return v, np.zeros(v.size)


def spin(sign=1.0, seconds=5.0, torque_N_m=4000.0):
    """In place: a yaw torque that rises steadily."""
    omega = _pushed(seconds, sign * torque_N_m, LOADER[1], LOADER[5])
    return np.zeros(omega.size), omega


def to(seconds, previous, v=0.0, omega=0.0):
    """From where the `previous` manoeuvre ended to other speeds, steadily."""
    return _ramp(seconds, previous[0][-1], v, previous[1][-1], omega)


def joint(seconds=60.0):
    """v and ω both triangular, out of step, forward only and to both sides."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return 0.2 + 1.4 * _triangle(t, 9.0), 0.8 * (2.0 * _triangle(t, 6.5) - 1.0)


def _triangle(t, period_s):
    share = (t % period_s) / period_s
    return np.where(share < 0.5, 2.0 * share, 2.0 - 2.0 * share)


def _pushed(seconds, push, inertia, friction):
    samples = round(seconds * RATE_HZ)
    x, rates = 0.0, np.zeros(samples)
    for k in range(samples):
        rates[k] = x
        x += (push * k / samples - friction * x) / inertia / RATE_HZ
    return rates


def _ramp(seconds, v0, v1, w0, w1):
    share = np.arange(round(seconds * RATE_HZ)) / round(seconds * RATE_HZ)
    return v0 + (v1 - v0) * share, w0 + (w1 - w0) * share


def braked(*manoeuvres):
    """Each manoeuvre from a standstill and braked to one."""
    out = [hold(1.5)]
    for each in manoeuvres:
        out += [each, to(1.5, each), hold(1.5)]
    return out


def starts():
    return braked(start(), start(-1.0), start())


def spins():
    return braked(spin(), spin(-1.0), spin(), spin(-1.0))


def arc(v, omega, seconds=6.0):
    """Entered and left by ramps; v, ω constant between."""
    steady = hold(seconds, v, omega)
    return [to(2.0, hold(0.1), v, omega), steady, to(2.0, steady), hold(1.0)]


def arcs():
    return [*arc(1.2, 0.5), *arc(-1.0, 0.6), *arc(1.5, -0.4)]


def sensors(drive, seed=1, noise=1.0, parameters=LOADER, origin_x_m=0.0, imu=None):
    """What the sensors say, a column each, with t_ns.

    Args:
        drive: manoeuvres in their order.
        seed: of the noise.
        noise: share of `NOISE`.
        parameters: of the machine.
        origin_x_m: where the origin lies from the centre that the machine turns about, along x.
        imu: how the IMU sits, at the origin.
    """
    v, omega = (np.concatenate(each) for each in zip(*drive, strict=True))
    acc, alpha = np.gradient(v) * RATE_HZ, np.gradient(omega) * RATE_HZ
    zero = np.zeros(v.size)
    seen = np.stack([acc - omega**2 * origin_x_m, omega * v + alpha * origin_x_m, zero + 9.80665])
    exact = model.make_planar_regressor(seen[0], seen[1], v, omega, alpha) @ parameters
    turn = np.stack([zero, zero, omega])
    if imu is not None:
        seen, turn = (
            compute_rotation_to_machine_axes(imu).T @ seen,
            compute_rotation_to_machine_axes(imu).T @ turn,
        )
    said = dict(zip(NOISE, [exact[:, 0], exact[:, 1], v, *seen, *turn], strict=True))
    generator = np.random.default_rng(seed)
    return pl.DataFrame(
        {
            "unix_ns": 1_700_000_000 * 10**9 + np.arange(v.size) * (10**9 // RATE_HZ),
            **{n: x + noise * NOISE[n] * generator.normal(size=x.size) for n, x in said.items()},
        }
    )


def machine(without=(), imu=None, body=(), **settings):
    """A machine with every channel, its yaw acceleration derived from the gyroscope."""
    channels = {name: {"field": name} for name in NOISE if name not in without}
    if "yaw_acc_rad_s2" not in without:
        channels["yaw_acc_rad_s2"] = {"derive": "d/dt yaw_rate_rad_s"}
    body = {"name": "loader", "empty_mass_kg": 3614.0, **dict(body)}
    if imu is not None:
        body["imu"] = imu.model_dump()
    return Machine.model_validate(
        {"machine": body, "channels": channels, "settings": staged(**settings)}
    )


def excitation(said, loader=None):
    """What the estimators are fed of what the sensors say."""
    return _to_excitation(said, loader or machine())[1]


def _to_excitation(said, loader):
    channels, _ = derive_channels_in_si(read_measured_channels({"table": said}, loader)[0], loader)
    aligned, _ = align_channels_on_grid(channels, loader)
    return aligned, compute_excitation(
        smooth_by_trailing_mean(aligned, loader.settings.smooth), loader
    )


def replayed(said, loader=None):
    """Every stage of what the sensors say, by name."""
    loader = loader or machine()
    settings = loader.settings
    aligned, excitation = _to_excitation(said, loader)
    noise = estimate_channel_noise(aligned, excitation, loader)
    gated = gate_windows(excitation, settings, noise)
    estimates = trace_estimates(excitation, gated, settings, noise)
    judged = judge_log_by_checks(CheckInputs(excitation, gated, loader))
    opinion = Verdict.from_frame(judged)
    return {
        "aligned": aligned,
        "excitation": excitation,
        "noise": noise,
        "gate": gated,
        **{f"estimates/{method}": each for method, each in estimates.items()},
        "segments": estimate_each_manoeuvre_by_pooling(excitation, gated, settings, noise),
        "verdict": judged,
        "masses": withhold_masses(
            summarise_masses(excitation, gated, estimates, loader, noise), opinion, ()
        ),
        **dict(
            zip(
                ("planar", "planar_budget"),
                make_planar_frames(excitation, gated, opinion, loader, noise),
                strict=True,
            )
        ),
    }
