"""The parameters, among mass, friction and constant force, that a stretch of motion determines."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from analysis.explain.explain_limits import LIMITS
from analysis.model.axes import X
from analysis.model.schema import get_column_values
from analysis.model.settings import Settings
from analysis.stages.noise.column_noise import ColumnNoise
from estimators.arrays import Bools, Floats
from estimators.planar.identifiability import find_identifiable_parameters

#: The parameters of the x row, and a constant force.
_MASS, _FRICTION, _COULOMB, _CONSTANT = (
    *("mass_kg", "friction_x_N_s_m", "coulomb_x_N"),
    "constant_force_N",
)
_NAMES: Final = (_MASS, _FRICTION, _COULOMB, _CONSTANT)


@dataclass(frozen=True, slots=True)
class DeterminedParameters:
    """Parameters that the motion determines.

    Attributes:
        samples: number of samples examined.
        alone: parameters that are determined individually.
        combinations: determined combinations of other parameters, as text: `mass_kg - 5
            coulomb_x_N`.
        lost: parameters that occur neither in `alone` nor in `combinations`.
        trade_offs: pairs of parameters, and their correlation if beyond `trade_off_correlation`.
    """

    samples: int
    alone: tuple[str, ...]
    combinations: tuple[str, ...]
    lost: tuple[str, ...]
    trade_offs: tuple[tuple[str, str, float], ...]


def find_determined_parameters(
    excitation: pl.DataFrame, chosen_samples: Bools, noise: pl.DataFrame | None, settings: Settings
) -> DeterminedParameters | None:
    """Find which parameters the chosen samples determine.

    Args:
        excitation: frame with regressor, speed and direction.
        chosen_samples: (n,) whether each sample is used.
        noise: frame `noise`; if None, the settings' noise is used.
        settings: settings with the moving mean and the noise.

    Returns:
        The determined parameters and combinations; None if there are too few samples, or their
        noise is unknown.
    """
    acceleration = get_column_values(excitation, "regressor_acc_x_m_s2")
    speed = get_column_values(excitation, "speed_x_m_s")
    if "direction_x_1" in excitation.columns:
        direction = get_column_values(excitation, "direction_x_1")
    else:
        direction = np.sign(speed)
    A = np.column_stack([acceleration, speed, direction, np.ones(speed.size)])
    A = A[chosen_samples & np.isfinite(A).all(1)]
    std = find_column_noise_stds(noise, settings)
    samples = A.shape[0]
    if samples < LIMITS.determined_min_rows or std is None:
        return None
    # adjacent samples share most of the moving mean, so samples in between add no information
    A = A[:: max(min(settings.smooth.samples, samples // LIMITS.determined_min_rows), 1)]
    found = find_identifiable_parameters(A, _NAMES, std)
    named = [name for name, alone in zip(_NAMES, found.identifiable, strict=True) if alone]
    joined = [
        name
        for row in found.determined_combinations
        for name, c in zip(_NAMES, row, strict=True)
        if c
    ]
    return DeterminedParameters(
        samples=samples,
        alone=tuple(named),
        combinations=tuple(found.format_combinations()),
        lost=tuple(name for name in _NAMES if name not in (*named, *joined)),
        trade_offs=find_correlated_parameter_pairs(A),
    )


def find_column_noise_stds(noise: pl.DataFrame | None, settings: Settings) -> Floats | None:
    """Noise (4,) of acceleration, speed, sign and constant after the mean, if known."""
    known = ColumnNoise.select_axis_noise(X, noise, settings.noise)
    if known is None:
        return None
    std = np.sqrt(
        np.maximum(np.diagonal(known.compute_covariance_of_means(settings.smooth.samples)), 0.0)
    )
    by_name = dict(zip(known.names, std, strict=True))
    measured = [by_name.get("regressor_acc_x_m_s2", 0.0), by_name.get("speed_x_m_s", 0.0)]
    if min(measured) <= 0.0:
        return None
    return np.array([*measured, LIMITS.constant_noise_std_1, LIMITS.constant_noise_std_1])


def find_correlated_parameter_pairs(A: Floats) -> tuple[tuple[str, str, float], ...]:
    """Correlations of least-squares estimates beyond `trade_off_correlation`, strongest first."""
    length = np.linalg.norm(A, axis=0)
    kept = [i for i in range(A.shape[1]) if length[i] > 0.0]
    scaled = A[:, kept] / length[kept]
    gram = scaled.T @ scaled
    squares = np.linalg.eigvalsh(gram)
    if len(kept) < 2 or squares[0] <= np.finfo(float).eps * squares[-1]:
        return ()
    covariance = np.linalg.inv(gram)
    std = np.sqrt(np.diagonal(covariance))
    correlation = covariance / np.outer(std, std)
    pairs = [
        (_NAMES[kept[i]], _NAMES[kept[j]], float(correlation[i, j]))
        for i in range(len(kept))
        for j in range(i + 1, len(kept))
        if abs(correlation[i, j]) > LIMITS.trade_off_correlation
    ]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair[2])))
