"""Excitation of the paper: a periodic triangular force or torque from standstill.

Once the transient has decayed the motion is periodic, and many of its windows are measured at once.
"""

from dataclasses import dataclass

import numpy as np

from analysis.paper.cramer_rao import (
    compute_cramer_rao_mass_bounds_kg,
    compute_equation_noise_std_newtons,
)
from analysis.paper.paper_limits import LIMITS
from analysis.simulation import Scenario, solve_motion
from analysis.simulation.scenario.manoeuvres import Excite
from analysis.simulation.scenario.scenario import SimulatedSensors
from analysis.simulation.scenario.waveforms import ForceWave, TorqueWave
from analysis.stages.motion.smooth import compute_trailing_mean
from estimators.arrays import Floats


@dataclass(frozen=True, eq=False)
class MeasuredWindows:
    """Windows of measured samples, as the estimators receive them.

    Attributes:
        A: (count, samples, 2) acceleration and speed.
        f: (count, samples) force.
        bound_kg: (count,) Cramér–Rao bound of as many samples before the moving mean.
        strict_bound_kg: (count,) bound that includes the samples before the window in its first
            means.
    """

    A: Floats
    f: Floats
    bound_kg: Floats
    strict_bound_kg: Floats


@dataclass(frozen=True, eq=False)
class SteadyDrive:
    """One period of a steady oscillation, without noise.

    Attributes:
        mass_kg: the true mass.
        friction_N_s_m: the true friction.
        motion: (phases, 3) acceleration in m/s², speed in m/s and force in N, with
            `phases_per_sample` rows per sample of the sensors.
    """

    mass_kg: float
    friction_N_s_m: float
    motion: Floats

    def simulate_noisy_windows(
        self,
        sensors: SimulatedSensors,
        window_samples: int,
        smooth_samples: int,
        window_count: int,
        rng: np.random.Generator,
    ) -> MeasuredWindows:
        """Measure windows at random phases, with new noise and then the moving mean."""
        before = smooth_samples - 1
        start = rng.integers(self.motion.shape[0], size=(window_count, 1))
        steps = LIMITS.phases_per_sample * np.arange(-before, window_samples)
        true = self.motion[(start + steps) % self.motion.shape[0]]
        noise = (sensors.acc_noise_m_s2, sensors.speed_noise_m_s, sensors.force_noise_N)
        measured = true + noise * rng.standard_normal(true.shape)
        # the mean of a row's first samples includes the previous row, so they are cut off
        smoothed = [
            compute_trailing_mean(column.ravel(), smooth_samples).reshape(column.shape)[:, before:]
            for column in np.moveaxis(measured, -1, 0)
        ]
        return MeasuredWindows(
            A=np.stack(smoothed[:2], -1),
            f=smoothed[2],
            bound_kg=self._compute_cramer_rao_bounds_kg(sensors, true[:, before:]),
            strict_bound_kg=self._compute_cramer_rao_bounds_kg(sensors, true),
        )

    def _compute_cramer_rao_bounds_kg(
        self, sensors: SimulatedSensors, true_regressors: Floats
    ) -> Floats:
        a, v = true_regressors[..., 0], true_regressors[..., 1]
        noise_N = compute_equation_noise_std_newtons(sensors, self.mass_kg, self.friction_N_s_m)
        sums = ((x * y).sum(axis=1) for x, y in ((a, a), (a, v), (v, v)))
        return compute_cramer_rao_mass_bounds_kg(noise_N, *sums)


def make_waveform_scenario(
    scenario: Scenario, *, force: ForceWave | None, torque: TorqueWave | None
) -> Scenario:
    """Scenario with one run without load, five periods of these waveforms."""
    period_s = (force or torque or ForceWave()).period_s
    drive = Excite(duration_s=LIMITS.figure_periods * period_s, force=force, torque=torque)
    campaign = scenario.campaign.model_copy(
        update={"loads_kg": (0.0,), "runs": 1, "manoeuvres": (drive,)}
    )
    return scenario.model_copy(update={"campaign": campaign})


def integrate_steady_drive(scenario: Scenario, force: ForceWave | None = None) -> SteadyDrive:
    """One period of the steady oscillation under a force, by default the paper's triangle.

    Args:
        scenario: machine and sensors' rate.
        force: the waveform.
    """
    force = force or ForceWave()
    motion = solve_motion(make_waveform_scenario(scenario, force=force, torque=None), 0.0)
    steps = round(force.period_s * scenario.sensors.rate_hz * LIMITS.phases_per_sample)
    time_s = force.period_s * (LIMITS.settled_periods + np.arange(steps) / steps)
    true = motion.sample_channels(time_s)
    return SteadyDrive(
        motion.body.mass_kg,
        motion.body.friction_x_N_s_m,
        np.column_stack([true.acc_x_m_s2, true.speed_x_m_s, true.force_x_N]),
    )
