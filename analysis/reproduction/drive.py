"""Windows of a steady oscillation: what the sensors report of them, many trials at once."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.reproduction.bounds import equation_noise, mass_bounds_kg
from analysis.simulation.scenario import SimulatedSensors
from analysis.smooth import trailing_mean

Floats = NDArray[np.float64]

#: Phases a sample at which a window may start.
PHASES: Final = 10


@dataclass(frozen=True, eq=False)
class SteadyDrive:
    """One period of a steady oscillation, without noise.

    Attributes:
        mass_kg: the true mass.
        friction_N_s_m: the true friction.
        motion: (phases, 3) acceleration in m/s², speed in m/s and force in N, `PHASES` rows a
            sample of the sensors.
    """

    mass_kg: float
    friction_N_s_m: float
    motion: Floats

    def windows(
        self,
        sensors: SimulatedSensors,
        samples: int,
        smooth_samples: int,
        trials: int,
        rng: np.random.Generator,
    ) -> "Windows":
        """Windows that start at random phases, with fresh noise, after the moving mean."""
        before = smooth_samples - 1
        start = rng.integers(self.motion.shape[0], size=(trials, 1))
        steps = PHASES * np.arange(-before, samples)
        true = self.motion[(start + steps) % self.motion.shape[0]]
        noise = (sensors.acc_noise_m_s2, sensors.speed_noise_m_s, sensors.force_noise_N)
        measured = true + noise * rng.standard_normal(true.shape)
        # the mean of a row's first samples reaches into the row before: those are cut off
        smoothed = [
            trailing_mean(column.ravel(), smooth_samples).reshape(column.shape)[:, before:]
            for column in np.moveaxis(measured, -1, 0)
        ]
        return Windows(
            A=np.stack(smoothed[:2], -1),
            f=smoothed[2],
            bound_kg=self._bounds_kg(sensors, true[:, before:]),
            strict_bound_kg=self._bounds_kg(sensors, true),
        )

    def _bounds_kg(self, sensors: SimulatedSensors, true: Floats) -> Floats:
        a, v = true[..., 0], true[..., 1]
        noise_N = equation_noise(sensors, self.mass_kg, self.friction_N_s_m)
        sums = ((x * y).sum(axis=1) for x, y in ((a, a), (a, v), (v, v)))
        return mass_bounds_kg(noise_N, *sums)


@dataclass(frozen=True, eq=False)
class Windows:
    """What the estimators see of many windows.

    Attributes:
        A: (trials, samples, 2) acceleration and speed.
        f: (trials, samples) force.
        bound_kg: (trials,) the Cramér–Rao bound of as many samples before the mean.
        strict_bound_kg: (trials,) with the samples before the window that its first means hold.
    """

    A: Floats
    f: Floats
    bound_kg: Floats
    strict_bound_kg: Floats
