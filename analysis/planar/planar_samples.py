"""The regressor of all motion in the plane, and which samples of a log may go into it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.axes import Z, available_axes
from analysis.model.schema import values
from analysis.model.settings import Settings
from analysis.stages.gating.gate import braking_within_sight
from analysis.stages.motion.phases import TURNS, speeding_sign, yaw_speeding_sign
from analysis.stages.noise.column_noise import mean_stds
from estimators.arrays import Bools, Floats
from estimators.planar import planar_rows


@dataclass(frozen=True, slots=True)
class PlanarSamples:
    """A log's motion in the plane.

    Attributes:
        t_ns: (n,) time of each sample.
        motion: (n,) samples that make the regressor, NaN where one is missing.
        f: (n, 2) force and yaw torque.
        known: (n,) nothing is missing.
        usable: (n,) nothing is missing, and nothing brakes (unless braking counts as driving).
        moving: (n,) the machine does not stand.
        turning: (n,) it spins, drives an arc or turns.
        pace: (n,) 1 where it speeds up, -1 where it slows down, 0 where neither.
        has_torque: whether there is a yaw torque with a yaw acceleration; without, the second row
            says nothing.
        noise: of each column after the moving mean, by its name.
    """

    t_ns: NDArray[np.int64]
    motion: planar_rows.PlanarRegressor
    f: Floats
    known: Bools
    usable: Bools
    moving: Bools
    turning: Bools
    pace: Floats
    has_torque: bool
    noise: Mapping[str, float]

    def cut(self, part: slice) -> "PlanarSamples":
        """A slice of the log, which shares its memory."""
        return PlanarSamples(
            t_ns=self.t_ns[part],
            motion=self.motion.cut(part),
            f=self.f[part],
            known=self.known[part],
            usable=self.usable[part],
            moving=self.moving[part],
            turning=self.turning[part],
            pace=self.pace[part],
            has_torque=self.has_torque,
            noise=self.noise,
        )


def collect_planar_samples(
    excitation: pl.DataFrame, settings: Settings, noise: pl.DataFrame | None = None
) -> PlanarSamples:
    """Collect what the planar fits need."""
    n, has_torque = excitation.height, Z in available_axes(excitation)
    phase = excitation["phase"]
    speed = values(excitation, "speed_x_m_s")
    yaw_rate = values(excitation, "yaw_rate_rad_s")
    zero = np.zeros(n)
    motion = planar_rows.PlanarRegressor(
        values(excitation, "regressor_acc_x_m_s2"),
        values(excitation, "regressor_acc_y_m_s2") if has_torque else zero,
        speed,
        yaw_rate,
        # in a steady arc it is none
        values(excitation, "yaw_acc_rad_s2") if has_torque else zero,
    )
    torque = values(excitation, "torque_z_N_m") if has_torque else zero
    f = np.column_stack([values(excitation, "force_x_N"), torque])
    known = motion.complete_samples() & np.isfinite(f).all(axis=1)
    known &= phase.is_not_null().to_numpy()
    turning = phase.is_in(TURNS).fill_null(False).to_numpy()
    rate = values(excitation, "speed_rate_x_m_s2")
    along = speeding_sign(speed, rate, settings.phases.steady_acc_m_s2, settings)
    # the yaw rate of straight driving is not steered
    about = np.where(turning, yaw_speeding_sign(yaw_rate, settings), 0.0)
    slows = (along < 0) | (about < 0)
    usable = known
    if settings.gate.exclude_braking:
        stands = (phase == "standstill").fill_null(True).to_numpy()
        speeds_up = ((along > 0) | (about > 0)) & ~slows
        usable = known & ~braking_within_sight(slows, settings)
        usable &= ~stop_endings(slows, speeds_up, stands)
    return PlanarSamples(
        t_ns=excitation["t_ns"].to_numpy(),
        motion=motion,
        f=f,
        known=known,
        usable=usable,
        moving=(phase != "standstill").fill_null(False).to_numpy(),
        turning=turning,
        pace=along,
        has_torque=has_torque,
        noise=mean_stds(settings, noise),
    )


def stop_endings(slows: Bools, speeds_up: Bools, stands: Bools) -> Bools:
    """The samples between braking and the stand that it leads to, (n,).

    Brakes that no sensor sees hold on, too gently for the phase to call it braking.
    """
    event = np.select([slows, speeds_up, stands], [1, 2, 3], 0)
    rows = np.arange(event.size)
    before = np.maximum.accumulate(np.where(event > 0, rows, 0))
    after = np.minimum.accumulate(np.where(event > 0, rows, event.size - 1)[::-1])[::-1]
    return (event == 0) & (event[before] == 1) & (event[after] == 3)


def planar_noise(plane: PlanarSamples, used: Bools) -> Floats:
    """The noise in each column of each row, (2, 6), after the moving mean; `used` (n,) rows."""
    motion, noise = plane.motion, plane.noise
    speed_rms, yaw_rate_rms = (
        float(np.sqrt(np.mean(x**2, where=used))) for x in (motion.speed, motion.yaw_rate)
    )
    acc, speed = noise["regressor_acc_x_m_s2"], noise["speed_x_m_s"]
    yaw_rate, yaw_acc = noise["yaw_rate_rad_s"], noise["yaw_acc_rad_s2"]
    # of ω v, or of an accelerometer, whichever is more
    sideways = float(np.hypot(speed_rms * yaw_rate, yaw_rate_rms * speed))
    return planar_rows.column_noise(yaw_rate_rms, acc, max(acc, sideways), speed, yaw_rate, yaw_acc)
