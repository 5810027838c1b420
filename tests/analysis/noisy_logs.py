"""Logs whose noise is known: starts of a loader, seen through sensors of every kind."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from analysis.stages.signals import filters
from tests.analysis.conftest import make_machine

RATE_HZ = 100
PERIOD_NS = 10_000_000
#: Standard deviations of a sample of acceleration, speed and force.
STD = np.array([0.01, 0.005, 60.0])
KINEMATIC = {"acc_x_m_s2": {"derive": "d/dt speed_x_m_s"}, "specific_force_x_m_s2": None}


@dataclass(frozen=True)
class NoisyLog:
    """A log on the grid, and the noise that is in it.

    Attributes:
        aligned, excitation, machine: as the stages have them.
        noise: (rows, 3) of acceleration, speed and force, in motion where vibration differs.
    """

    aligned: pl.DataFrame
    excitation: pl.DataFrame
    machine: Any
    noise: np.ndarray

    def std_of_means(self, samples):
        """(3,) of the trailing means of `samples`."""
        kernel = np.ones(samples) / samples
        means = [np.convolve(column, kernel, "valid") for column in self.noise.T]
        return np.std(means, axis=1)


def motion(starts, stand_s=4.0, throttle_N=4000.0, mass_kg=3614.0, friction_N_s_m=2891.0):
    """Acceleration, speed and force (rows,) of starts with a throttle step and a stop."""
    stages = [(stand_s, 0.0), (6.0, throttle_N), (2.0, 0.7 * throttle_N), (2.0, -throttle_N)]
    rows = []
    v = 0.0
    for seconds, wanted in stages * starts:
        for k in range(round(seconds * RATE_HZ)):
            force = wanted * min(1.0, k / 30) if v > 0.0 or wanted > 0.0 else 0.0
            a = (force - friction_N_s_m * v) / mass_kg
            rows.append((a, v, force))
            v = max(v + a / RATE_HZ, 0.0)
    return np.array(rows)


def noisy_log(kind, seed, starts=6):
    """Make a log of one kind of sensors: see `KINDS`."""
    generator = np.random.default_rng(seed)
    true = motion(starts)
    t = np.arange(len(true)) * PERIOD_NS
    moving = true[:, 1] > 0.02
    noise = STD * generator.normal(size=true.shape)
    if "vibration" in kind:
        noise *= np.where(moving, 3.0, 1.0)[:, None]
    settings, channels = {}, {}
    if "derived" in kind:
        seen, noise = _derived(t, true + noise), _derived(t, noise)
        settings, channels = {"acceleration": "kinematic"}, KINEMATIC
    elif "interpolated" in kind:
        # every channel has its own phase between grid and stamps
        late = generator.uniform(size=3)
        noise[1:] = late * noise[:-1] + (1.0 - late) * noise[1:]
        seen = true + noise
    elif "quantised" in kind:
        step = 0.02
        read = np.round(true[:, 1] / step) * step
        noise[:, 1] = read - true[:, 1]
        seen = true + noise
    else:
        seen = true + noise
    machine = make_machine(settings, **channels)
    names = ("acc_x_m_s2" if "derived" in kind else "specific_force_x_m_s2", "speed_x_m_s")
    columns = dict(zip((*names, "force_x_N"), seen.T, strict=True))
    aligned = pl.DataFrame({"t_ns": t, **columns, "gap": np.zeros(t.size, np.bool_)})
    excitation = compute_excitation(
        smooth_by_trailing_mean(aligned, machine.settings.smooth), machine
    )
    if "never stands" in kind:
        stands = pl.col("phase") == "standstill"
        excitation = excitation.with_columns(
            phase=pl.when(stands).then(None).otherwise(pl.col("phase"))
        )
    told = moving if "vibration" in kind or "quantised" in kind else np.ones(t.size, np.bool_)
    return NoisyLog(aligned, excitation, machine, noise[told])


def _derived(t, columns):
    """The speed (column 1) and force after the low-pass, and the derivative of the speed."""
    _, speed = filters.apply_low_pass(t, columns[:, 1], 20.0, 1e9, causal=False)
    _, force = filters.apply_low_pass(t, columns[:, 2], 20.0, 1e9, causal=False)
    _, acceleration = filters.differentiate_signal(t, speed, 1e9, causal=False)
    return np.column_stack([acceleration, speed, force])
