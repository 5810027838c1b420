"""The two equations that causes are tested on, as rows with white noise of variance 1.

Force: f = m a + b v, as means of a few samples inside the stretches. Wheels: v = v₀ + ∫a + c t, as
means inside each stretch, with a linear trend removed; the accelerometer's noise accumulates in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from analysis.findings.finding_limits import LIMITS
from analysis.weighing.force_rate import make_parabola_slope_weights
from analysis.weighing.friction_warming import WARMING
from analysis.weighing.motion_samples import ColumnNoiseModel, MotionSamples
from analysis.weighing.stretch_means import list_indices_of_samples_in_whole_blocks
from estimators.arrays import Floats
from estimators.numerics.fit_loss import list_rows_by_group


@dataclass(frozen=True)
class EquationRows:
    """Whitened rows of an equation, and columns of the causes.

    Attributes:
        y: (n,) the quantity to be explained.
        base: (n, p) regressors of a log without faults.
        columns: (n,) effect of one unit of each cause, by its name; absent causes have no effect on
            this equation.
        noise: (p, p) expected contribution of regressor noise to baseᵀ base.
        noise_with: (p,) expected contribution of noise to baseᵀ column, by cause.
        noise_of: expected contribution to columnᵀ column, by cause, of noise that y contains with
            the opposite sign.
        size_N: divisor that makes a row of the force dimensionless.
    """

    y: Floats
    base: Floats
    columns: dict[str, Floats]
    noise: Floats
    noise_with: dict[str, Floats]
    noise_of: dict[str, float]
    size_N: float = 1.0


def build_whitened_force_rows(
    motion: MotionSamples,
    noise: ColumnNoiseModel,
    mass_kg: Floats,
    friction: float,
    *,
    includes_braking: bool = False,
) -> EquationRows:
    """Build the whitened rows of the force equation.

    Args:
        motion: the samples.
        noise: noise of the columns.
        mass_kg: (n,) mass of the load of each sample; differences between loads are removed.
        friction: viscous friction in N·s/m, for the effect of slip.
        includes_braking: whether braking counts as driving.
    """
    taken = list_indices_of_samples_in_whole_blocks(
        motion.stretch_of_sample, LIMITS.force_mean_samples
    )
    usual_kg = float(np.median(mass_kg[motion.is_fittable]))
    std = float(
        np.sqrt(
            (g := np.array([usual_kg, friction, -1.0]))
            @ noise.compute_covariance_of_means(LIMITS.force_mean_samples)
            @ g
        )
    )
    # a force without noise is still rounded
    std = max(std, np.finfo(np.float64).eps * motion.force_95_percentile_newtons) or 1.0
    a, v, f = motion.acceleration[taken], motion.speed[taken], motion.force[taken]
    along = motion.progress[taken]
    slope = make_parabola_slope_weights(LIMITS.force_rate_samples // 2, motion.rate_hz)
    rate = np.convolve(motion.force, slope, "same")[taken]
    columns = {
        "delay:force": -rate,
        "delay:imu": rate,
        "clock_drift": -rate * (taken / max(motion.force.size - 1, 1)),
        "slip": -friction * np.abs(v) * f,
        "driveline": a * f,
        "gain_drift": f * along,
        # oil that warms is no fault
        **{name: v * shape.share(along) for name, shape in WARMING.items()},
        "const": np.ones(f.size),
    }
    if motion.drives_both_ways:
        columns["direction"] = motion.direction[taken]
    if includes_braking:
        columns["braking"] = np.where(f * v < 0.0, -f, 0.0)

    def average_blocks(x: Floats) -> Floats:
        return (
            compute_sums_of_sample_blocks(x, LIMITS.force_mean_samples)
            / LIMITS.force_mean_samples
            / std
        )

    own = noise.compute_covariance_of_means(LIMITS.force_mean_samples) / std**2
    force = float(f.sum()) / LIMITS.force_mean_samples
    along = float((np.sign(v) * f).sum()) / LIMITS.force_mean_samples
    return EquationRows(
        average_blocks(f - (mass_kg[taken] - usual_kg) * a),
        np.column_stack([average_blocks(a), average_blocks(v)]),
        {name: average_blocks(column) for name, column in columns.items()},
        taken.size // LIMITS.force_mean_samples * own[:2, :2],
        {"driveline": force * own[:2, 0], "slip": -friction * along * own[:2, 1]},
        {},
        std,
    )


def build_whitened_wheel_rows(
    motion: MotionSamples, noise: ColumnNoiseModel
) -> EquationRows | None:
    """Build the whitened rows of wheels against accelerometer; None without an accelerometer."""
    reads = motion.specific_force if motion.without_gravity is None else motion.without_gravity
    if reads is None:
        return None
    step_s = 1.0 / motion.rate_hz
    rounding_m_s = np.finfo(np.float64).eps * motion.speed_95_percentile_m_s
    of_speed = max(
        float(noise.compute_covariance_of_means(LIMITS.wheel_mean_samples)[1, 1]),
        rounding_m_s**2,
    )
    of_acc = (
        float(noise.compute_covariance_of_means(LIMITS.accumulated_noise_samples)[0, 0])
        * LIMITS.accumulated_noise_samples
        * step_s**2
        * LIMITS.wheel_mean_samples
    )
    found: list[Floats] = []
    of_gained = 0.0
    for part in list_rows_by_group(motion.stretch_of_sample):
        count = part.size // LIMITS.wheel_mean_samples
        if count < LIMITS.wheel_min_means:
            continue
        part = part[: count * LIMITS.wheel_mean_samples]
        a, v, f = reads[part], motion.speed[part], motion.force[part]
        gained = (np.cumsum(a) - a / 2.0) * step_s
        white, added = compute_whitening_matrix_and_imu_noise(count, of_speed, of_acc)
        of_gained += added
        means = (
            compute_sums_of_sample_blocks(
                np.concatenate([v - gained, gained, np.abs(v) * f, a]), LIMITS.wheel_mean_samples
            )
            / LIMITS.wheel_mean_samples
        )
        found.append(white @ means.reshape(4, count).T)
    if not found:
        return None
    y, gained, slips, reads = np.concatenate(found).T.copy()
    columns = {"wheel_radius": gained, "slip": slips, "delay:speed": -reads, "delay:imu": reads}
    return EquationRows(
        y, np.zeros((y.size, 0)), columns, np.zeros((0, 0)), {}, {"wheel_radius": of_gained}
    )


@lru_cache(maxsize=256)
def compute_whitening_matrix_and_imu_noise(
    count: int, speed_variance: float, acceleration_variance: float
) -> tuple[Floats, float]:
    """Matrix that whitens the noise of a stretch and removes its mean and slope.

    Returns:
        (count - 2, count) matrix, and the accelerometer's fraction of the noise, summed over the
        rows.
    """
    k = np.arange(count, dtype=np.float64)
    adds_up = acceleration_variance * np.minimum(k[:, None], k[None, :])
    covariance = speed_variance * np.eye(count) + adds_up
    white = np.linalg.inv(np.linalg.cholesky(covariance))
    line = white @ np.column_stack([np.ones(count), k])
    across = np.linalg.qr(line, mode="complete")[0][:, 2:]
    rows = np.asarray(across.T @ white, np.float64)
    return rows, float(np.einsum("ij,jk,ik->", rows, adds_up, rows))


def compute_sums_of_sample_blocks(values: Floats, block_size: int) -> Floats:
    """Sums of successive blocks of `block_size` samples, (blocks,)."""
    blocks = values.reshape(-1, block_size)
    total = blocks[:, 0].copy()
    for k in range(1, block_size):
        total += blocks[:, k]
    return total


@dataclass(frozen=True)
class ProjectedEquation:
    """A whitened regression equation with base columns and accepted causes projected out.

    Attributes:
        information: the remaining XᵀX, by candidate cause.
        score: the remaining Xᵀy, by candidate cause.
        square_left: remaining sum of squares over the noise variance of a row.
        variance: noise variance of a row, for sums of many rows.
        row_count: number of rows, which is the sum of squares of noise as stated.
    """

    information: dict[str, float]
    score: dict[str, float]
    square_left: float
    variance: float
    row_count: int

    @classmethod
    def project_out(
        cls, whitened_rows: EquationRows, selected_causes: Sequence[str]
    ) -> "ProjectedEquation":
        """Remove what the base and the selected causes explain, corrected for column noise."""
        own = [name for name in selected_causes if name in whitened_rows.columns]
        others = [name for name in whitened_rows.columns if name not in own]
        known = np.column_stack(
            [whitened_rows.base, *(whitened_rows.columns[name] for name in own)]
        )
        tried = np.column_stack(
            [np.zeros((whitened_rows.y.size, 0)), *(whitened_rows.columns[n] for n in others)]
        )
        count = whitened_rows.base.shape[1]
        gram = known.T @ known
        gram[:count, :count] -= whitened_rows.noise
        cross = known.T @ tried
        for place, name in enumerate(others):
            cross[:count, place] -= whitened_rows.noise_with.get(name, np.zeros(count))
        for place, name in enumerate(own, count):
            both = whitened_rows.noise_with.get(name, np.zeros(count))
            gram[:count, place] -= both
            gram[place, :count] -= both
            gram[place, place] -= whitened_rows.noise_of.get(name, 0.0)
        # a column that is noise alone explains nothing
        power = np.diag(gram)
        size = np.sqrt(np.where(power > 0.0, power, np.inf))
        inverse = np.linalg.pinv(gram / np.outer(size, size), rcond=1e-10, hermitian=True)
        inverse /= np.outer(size, size)
        right = known.T @ whitened_rows.y
        right[count:] += [whitened_rows.noise_of.get(name, 0.0) for name in own]
        theta = inverse @ right
        left = whitened_rows.y - known @ theta
        # contribution of column noise to a score
        score = tried.T @ left
        for place, name in enumerate(others):
            score[place] += whitened_rows.noise_with.get(name, np.zeros(count)) @ theta[:count]
            score[place] += whitened_rows.noise_of.get(name, 0.0)
        squares = (tried**2).sum(axis=0)
        squares -= [whitened_rows.noise_of.get(name, 0.0) for name in others]
        information = squares - np.einsum("ij,ij->j", cross, inverse @ cross)
        kept = [
            k
            for k in range(len(others))
            if information[k] > LIMITS.min_column_left_fraction * squares[k]
        ]
        # noise from the residual of all causes together, whichever of them are true
        noise = left
        if kept:
            q = np.linalg.qr(np.column_stack([known, tried[:, kept]]))[0]
            noise = left - q @ (q.T @ left)
        variance = compute_whitened_row_noise_variance(noise)
        return cls(
            {others[k]: float(information[k]) / variance for k in kept},
            {others[k]: float(score[k]) / variance for k in kept},
            float(left @ left) / variance,
            variance,
            left.size,
        )

    def get_information_left_about_cause(self, cause_name: str) -> float:
        """Remaining information about a candidate cause."""
        return self.information.get(cause_name, 0.0)

    def get_likelihood_score_left_of_cause(self, cause_name: str) -> float:
        """Remaining Xᵀy of a candidate cause."""
        return self.score.get(cause_name, 0.0)


def compute_whitened_row_noise_variance(noise: Floats) -> float:
    """Noise variance of a whitened row, increased if neighbouring rows are correlated."""
    own = float(noise @ noise) / max(noise.size, 1)
    if not own > 0.0:
        return 1.0
    alike = [
        float(noise[lag:] @ noise[:-lag]) / noise.size / own
        for lag in range(1, min(LIMITS.correlated_rows, noise.size // 4) + 1)
    ]
    return max(own * max(1.0 + 2.0 * float(np.sum(alike)), 0.5), LIMITS.min_row_variance)
