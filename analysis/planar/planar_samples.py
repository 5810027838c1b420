"""Samples of planar motion, with flags of those that may be fitted."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.axes import Z, list_axes_allowed_by_channels
from analysis.model.schema import get_column_values
from analysis.model.settings import Settings
from analysis.model.windows import flag_rows_near_flagged_rows
from analysis.stages.gating.gate import mark_possible_braking
from analysis.stages.motion.phases import (
    TURNS,
    compute_sign_of_speed_change,
    compute_sign_of_yaw_rate_change,
)
from analysis.stages.noise.column_noise import compute_column_stds_after_moving_mean
from estimators.arrays import Bools, Floats
from estimators.planar import planar_rows


@dataclass(frozen=True, slots=True)
class PlanarSamples:
    """Planar motion of a log, sample by sample.

    Attributes:
        t_ns: (n,) time of each sample.
        motion: (n,) samples of the regressor; NaN if missing.
        f: (n, 2) force in N and yaw torque in N·m.
        known: (n,) whether nothing is missing.
        usable: (n,) whether nothing is missing and the machine does not brake (unless braking
            counts as driving).
        moving: (n,) whether the machine moves.
        turning: (n,) whether the machine spins, drives an arc or turns.
        speed_change_sign: (n,) 1 speeding up, -1 slowing down, 0 neither.
        has_torque: whether yaw torque and yaw acceleration are measured; otherwise the second row
            is unused.
        noise: noise of each column after the moving mean, by name.
    """

    t_ns: NDArray[np.int64]
    motion: planar_rows.PlanarRegressor
    f: Floats
    known: Bools
    usable: Bools
    moving: Bools
    turning: Bools
    speed_change_sign: Floats
    has_torque: bool
    noise: Mapping[str, float]

    def select_slice(self, sample_slice: slice) -> "PlanarSamples":
        """Slice of the samples, sharing their memory."""
        return PlanarSamples(
            t_ns=self.t_ns[sample_slice],
            motion=self.motion.slice_samples(sample_slice),
            f=self.f[sample_slice],
            known=self.known[sample_slice],
            usable=self.usable[sample_slice],
            moving=self.moving[sample_slice],
            turning=self.turning[sample_slice],
            speed_change_sign=self.speed_change_sign[sample_slice],
            has_torque=self.has_torque,
            noise=self.noise,
        )


def collect_planar_samples(
    excitation: pl.DataFrame, settings: Settings, noise: pl.DataFrame | None = None
) -> PlanarSamples:
    """Collect the samples for the planar fits."""
    n, has_torque = excitation.height, Z in list_axes_allowed_by_channels(excitation)
    phase = excitation["phase"]
    speed = get_column_values(excitation, "speed_x_m_s")
    yaw_rate = get_column_values(excitation, "yaw_rate_rad_s")
    zero = np.zeros(n)
    motion = planar_rows.PlanarRegressor(
        get_column_values(excitation, "regressor_acc_x_m_s2"),
        get_column_values(excitation, "regressor_acc_y_m_s2") if has_torque else zero,
        speed,
        yaw_rate,
        # 0 in a steady arc
        get_column_values(excitation, "yaw_acc_rad_s2") if has_torque else zero,
    )
    torque = get_column_values(excitation, "torque_z_N_m") if has_torque else zero
    f = np.column_stack([get_column_values(excitation, "force_x_N"), torque])
    known = motion.mark_complete_samples() & np.isfinite(f).all(axis=1)
    known &= phase.is_not_null().to_numpy()
    turning = phase.is_in(TURNS).fill_null(False).to_numpy()
    rate = get_column_values(excitation, "speed_rate_x_m_s2")
    along = compute_sign_of_speed_change(speed, rate, settings.phases.steady_acc_m_s2, settings)
    # the small yaw rate of straight driving is not a turn
    about = np.where(turning, compute_sign_of_yaw_rate_change(yaw_rate, settings), 0.0)
    slows = (along < 0) | (about < 0)
    usable = known
    if settings.gate.exclude_braking:
        stands = (phase == "standstill").fill_null(True).to_numpy()
        speeds_up = ((along > 0) | (about > 0)) & ~slows
        usable = known & ~mark_possible_braking(slows, settings)
        usable &= ~mark_samples_between_braking_and_stand(slows, speeds_up, stands)
    return PlanarSamples(
        t_ns=excitation["t_ns"].to_numpy(),
        motion=motion,
        f=f,
        known=known,
        usable=usable,
        moving=(phase != "standstill").fill_null(False).to_numpy(),
        turning=turning,
        speed_change_sign=along,
        has_torque=has_torque,
        noise=compute_column_stds_after_moving_mean(settings, noise),
    )


def mark_samples_between_braking_and_stand(
    is_slowing: Bools, is_speeding_up: Bools, is_standing: Bools
) -> Bools:
    """Flags of the samples between braking and the following standstill, (n,).

    Unmeasured brakes may still act there, too gently to be classified as braking.
    """
    event = np.select([is_slowing, is_speeding_up, is_standing], [1, 2, 3], 0)
    rows = np.arange(event.size)
    before = np.maximum.accumulate(np.where(event > 0, rows, 0))
    after = np.minimum.accumulate(np.where(event > 0, rows, event.size - 1)[::-1])[::-1]
    return (event == 0) & (event[before] == 1) & (event[after] == 3)


def mark_turn_transitions(samples: PlanarSamples, settings: Settings) -> Bools:
    """Flags of the samples where a turn begins, ends or changes its direction, (n,).

    Their means over `smooth.samples` contain friction of both directions, or of standing tyres,
    which balance any torque. Outside a turn, samples within the length of a mean are flagged;
    inside, until half a mean after the reversal.
    """
    span = settings.smooth.samples
    turning, motion = samples.turning, samples.motion
    near = flag_rows_near_flagged_rows(turning, span + 1)
    gained = np.abs(motion.yaw_acceleration) * span / settings.align.rate_hz
    return np.where(turning, np.abs(motion.yaw_rate) < gained / 2.0, near)


def compute_planar_column_noise(
    samples: PlanarSamples, is_used: Bools, arm_y_m: float = 0.0
) -> Floats:
    """Noise of each column of each row after the moving mean.

    Args:
        samples: motion with the noise of its channels.
        is_used: (n,) samples of the fit.
        arm_y_m: position of the IMU to the left, to exclude the noise that the yaw acceleration
            adds to the accelerometer's columns by this lever arm; 0 excludes none.

    Returns:
        (2, 6) r.m.s. by row and column.
    """
    motion, noise = samples.motion, samples.noise
    speed_rms, yaw_rate_rms = (
        float(np.sqrt(np.mean(x**2, where=is_used))) for x in (motion.speed, motion.yaw_rate)
    )
    acc, speed = noise["regressor_acc_x_m_s2"], noise["speed_x_m_s"]
    yaw_rate, yaw_acc = noise["yaw_rate_rad_s"], noise["yaw_acc_rad_s2"]
    if arm_y_m:
        acc = float(np.sqrt(max(acc**2 - (arm_y_m * yaw_acc) ** 2, 0.0)))
    # noise of ω v, or of an accelerometer if larger
    sideways = float(np.hypot(speed_rms * yaw_rate, yaw_rate_rms * speed))
    return planar_rows.compute_column_noise_rms(
        yaw_rate_rms, acc, max(acc, sideways), speed, yaw_rate, yaw_acc
    )
