"""Effect of the noise of an axis' columns on its estimates, and its uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from analysis.model.axes import Axis, X, Z
from analysis.model.methods import AxisNoise, Method
from analysis.model.schema import NOISE_COLUMNS
from analysis.model.settings import NoiseSettings, Settings
from analysis.stages.noise.noise_limits import LIMITS
from estimators.arrays import Floats, Ints
from estimators.methods.attenuation import compute_attenuation_corrections_of_windows
from estimators.methods.ls import compute_residual_noise_variance, solve_windows
from estimators.methods.method_limits import LIMITS as METHOD_LIMITS
from estimators.methods.tls import TlsOptions
from estimators.numerics.small_systems import factor_packed_ldl, invert_factored_systems

#: Noise ratios for TLS if neither log nor settings give the noise: those of the paper's sensors.
_USUAL: Final[Mapping[str, TlsOptions]] = {
    "x": TlsOptions((0.01, 0.005, 0.001), 60.0),
    "z": TlsOptions((0.026, 0.001), 45.0),
}


@dataclass(frozen=True, slots=True)
class ColumnNoise:
    """Noise of an axis' columns and its force or torque, before the moving mean.

    Attributes:
        names: names of the p columns.
        covariances: (p, p, lags) E[first(t) second(t + lag)], in the columns' units.
    """

    names: tuple[str, ...]
    covariances: Floats

    @classmethod
    def select_axis_noise(
        cls, axis: Axis, noise: pl.DataFrame | None, settings: NoiseSettings
    ) -> "ColumnNoise | None":
        """Noise of an axis from the frame `noise`, or white noise from complete settings."""
        columns = NOISE_COLUMNS[axis.letter]
        names = tuple(columns)
        if noise is not None:
            # in the order of `NOISE_COLUMNS`, as the stage makes them
            rows = noise.filter(pl.col("first").is_in(names))
            names = tuple(rows["first"].unique(maintain_order=True))
            covariances = rows["covariance"].to_numpy()
            return cls(names, covariances.reshape(len(names), len(names), -1)) if names else None
        std = [getattr(settings, name) for name in columns.values()]
        if None in std:
            return None
        return cls(names, np.diag(np.square(std))[:, :, None].astype(float))

    @property
    def stds_of_one_sample(self) -> Floats:
        """(p,) standard deviations of one sample."""
        return np.sqrt(np.maximum(np.diagonal(self.covariances[:, :, 0]), 0.0))

    def compute_covariance_of_means(self, samples_per_mean: int) -> Floats:
        """(p, p) covariance of trailing means of `samples_per_mean`."""
        lag = np.arange(self.covariances.shape[2])
        pairs = np.maximum(samples_per_mean - lag, 0) / samples_per_mean**2
        return find_nearest_semidefinite_matrix(self._sum_covariances_over_lags(pairs))

    def compute_power_at_zero_frequency(self) -> Floats:
        """(p, p) power at 0 Hz: variance per sample of long sums."""
        lags = self.covariances.shape[2]
        return find_nearest_semidefinite_matrix(
            self._sum_covariances_over_lags(1.0 - np.arange(lags) / lags)
        )

    def _sum_covariances_over_lags(self, weights: Floats) -> Floats:
        """Sum of the covariances at positive and negative lags, weighted by `weights` (lags,)."""
        # summed without BLAS, whose last bits depend on its threads: on board they are the replay's
        later = np.einsum("ijk,k->ij", self.covariances[:, :, 1:], weights[1:])
        return self.covariances[:, :, 0] * weights[0] + later + later.T


@dataclass(frozen=True)
class DerivativeNoise:
    """Noise if the acceleration is the derivative of the speed.

    The mean of n samples is then the difference of two speeds over n steps; a sum of covariances at
    short lags does not give its noise.
    """

    columns: ColumnNoise
    rate_hz: float

    def compute_covariance_of_means(self, samples_per_mean: int) -> Floats:
        """(3, 3) noise covariance of a trailing mean of `samples_per_mean`."""
        found = self.columns.compute_covariance_of_means(samples_per_mean)
        if samples_per_mean < LIMITS.derivative_mean_samples:
            return found
        found = found.copy()
        speed = self.columns.compute_covariance_of_means(1)[1, 1]
        found[0, :] = found[:, 0] = 0.0
        found[0, 0] = 2.0 * speed * (self.rate_hz / samples_per_mean) ** 2
        return found


def find_nearest_semidefinite_matrix(covariance: Floats) -> Floats:
    """Nearest positive semidefinite matrix: sums of estimated covariances may be indefinite."""
    scale = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    scale = np.where(scale > 0.0, scale, 1.0)
    of_unit, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    if of_unit[0] >= 0.0:
        return covariance
    return (vectors * np.maximum(of_unit, 0.0)) @ vectors.T * np.outer(scale, scale)


def collect_axis_noise(
    axis: Axis, settings: Settings, noise: pl.DataFrame | None = None
) -> AxisNoise:
    """Collect the noise of an axis from the log and the settings.

    Args:
        axis: x or z axis.
        settings: settings with the length of the moving mean, and noise.
        noise: frame `noise` of the log; without it the settings must give all columns.
    """
    known = ColumnNoise.select_axis_noise(axis, noise, settings.noise)
    usual = _make_tls_options_by_settings(axis, settings.noise)
    if known is None or len(known.names) < len(NOISE_COLUMNS[axis.letter]):
        return AxisNoise(usual, None, None)
    mean, lasting = (
        known.compute_covariance_of_means(settings.smooth.samples),
        known.compute_power_at_zero_frequency(),
    )
    std = np.sqrt(np.diagonal(mean))
    *of_A, of_f = (float(each) for each in std)
    if axis is X:
        of_A.append(LIMITS.sign_noise_std_1 / np.sqrt(settings.smooth.samples))
    if axis is X and settings.forces.coulomb:
        mean, lasting = (
            np.insert(np.insert(each, 2, 0.0, 0), 2, 0.0, 1) for each in (mean, lasting)
        )
    # a column without any noise has no scale
    ratios = TlsOptions(tuple(of_A), of_f) if (std > 0.0).all() else usual
    return AxisNoise(ratios, mean, lasting)


def _make_tls_options_by_settings(axis: Axis, settings: NoiseSettings) -> TlsOptions:
    """Noise ratios of an axis for TLS: the default, overridden by the settings."""
    usual = _USUAL[axis.letter]
    given = [getattr(settings, name) for name in NOISE_COLUMNS[axis.letter].values()]
    both = zip(given, (*usual.noise_A[:2], usual.noise_f), strict=True)
    *of_A, of_f = (float(value or std) for value, std in both)
    return TlsOptions((*of_A, *usual.noise_A[2:]), of_f)


def compute_column_stds_after_moving_mean(
    settings: Settings, noise: pl.DataFrame | None = None
) -> dict[str, float]:
    """Noise standard deviation of each column after the moving mean, by name.

    The default where the noise is unknown.
    """
    stds: dict[str, float] = {}
    for axis in (X, Z):
        usual = _make_tls_options_by_settings(axis, settings.noise)
        each = (*usual.noise_A[:2], usual.noise_f)
        for name, std in zip(NOISE_COLUMNS[axis.letter], each, strict=True):
            stds[name] = std / float(np.sqrt(settings.smooth.samples))
        known = ColumnNoise.select_axis_noise(axis, noise, settings.noise)
        if known is not None:
            seen = np.sqrt(
                np.diagonal(known.compute_covariance_of_means(settings.smooth.samples))
            ).tolist()
            told = dict(zip(known.names, seen, strict=True))
            stds |= {name: std for name, std in told.items() if std > 0.0}
    return stds


def estimate_attenuation_errors_of_windows(
    method: Method,
    A: Floats,
    f: Floats,
    index: Ints,
    theta: Floats,
    settings: Settings,
    noise: AxisNoise,
) -> Floats:
    """Signed errors of the windows' estimates by attenuation, (rows, p), which no residual shows.

    Noise in the columns attenuates the estimates. Methods that treat the regressor as exact have
    the full attenuation as an error; methods that correct it know the noise only roughly, and have
    a fraction of it.

    Args:
        method: a windowed or recursive method.
        A: (n, p) regressor.
        f: (n,) force or torque.
        index: (rows,) last samples of the windows.
        theta: (rows, p) estimates of the windows.
        settings: settings with the window.
        noise: noise of the axis.
    """
    if noise.moving_mean_covariance is None:
        return np.zeros_like(theta)
    drawn = compute_attenuation_corrections_of_windows(
        A, f, settings.gate.window_samples, index, theta, noise.moving_mean_covariance
    )
    return METHOD_LIMITS.uncertain_correction_fraction * drawn if method.takes_noise_off else drawn


def estimate_window_stds_by_column_noise(
    A: Floats, f: Floats, window: int, index: Ints, theta: Floats, noise: AxisNoise
) -> Floats:
    """Standard deviations of the windows' estimates by column noise alone, (rows, p); 0 if unknown.

    They are a lower bound: the residuals of a window may be tiny by chance, or because the force is
    a function of the speed.
    """
    if noise.moving_mean_covariance is None or noise.long_sum_variance is None:
        return np.zeros_like(theta)
    p = A.shape[1]
    grams = np.ascontiguousarray(solve_windows(A, f, window, index).grams.T)
    bread = invert_factored_systems(*factor_packed_ldl(grams, p, p))
    each = np.ascontiguousarray(theta.T)
    # slow noise adds up over a window; the variance is at least that of a single sample
    variance = np.maximum(
        compute_residual_noise_variance(each, noise.moving_mean_covariance),
        compute_residual_noise_variance(each, noise.long_sum_variance),
    )
    return np.sqrt(np.array([bread[i, i] for i in range(p)]) * variance).T
