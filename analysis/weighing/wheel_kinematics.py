"""Relation of wheels and accelerometer: gain, slip and delay of the speed."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.body_swing import NO_SWING, BodySwing
from analysis.weighing.motion_samples import ColumnNoiseModel, Floats, Ints, MotionSamples
from analysis.weighing.stretch_means import EVERY, MEAN
from analysis.weighing.weighing_limits import LIMITS
from estimators.numerics.fit_loss import list_rows_by_group
from estimators.numerics.group_sums import NoiseMoments
from estimators.numerics.small_systems import NOTHING

#: Terms of wheels and accelerometer that a calibration learns, in this order.
TERMS: Final = ("wheel_slip", "gain", "speed_delay")


@dataclass(frozen=True, slots=True)
class WheelKinematics:
    """Comparison of wheels and accelerometer; values are (estimate, standard deviation).

    Attributes:
        gain: relative excess of the change of the wheel speed over the integrated accelerometer.
        gain_by_prior: the same gain with its prior, which corrects the mass unless
            `is_gain_significant`.
        delay_s: delay of the speed.
        slip_1_N: 1 / C, slip per newton as a fraction of the speed.
        is_gain_significant: whether the gain exceeds what its prior and the noise allow.
        covariance: (3, 3) covariance of slip, gain (with its prior) and delay.
        mismatch: residuals over the speed's noise; above 3, slip and delay are not used.
        disagreement_m_s: r.m.s. residual beyond the speed's noise.
        prior_std: (3,) prior standard deviations of slip, gain and delay.
        mean_u: (3,) standard uncertainties of learnt means; else 0.
        squat: fraction of the acceleration that pitching adds to the accelerometer, which is
            corrected for; 0 unless pitch or wheels show it.
        pitch_shows_squat: whether the squat is estimated from the pitch, not from the wheels.
        swing: swing of an accelerometer above the pitch axis.
        springs: springs of the body; None if they are unknown.
        estimates_of_this_log: estimates of this log alone, if a calibration replaces them.
    """

    gain: tuple[float, float]
    gain_by_prior: tuple[float, float]
    delay_s: tuple[float, float]
    slip_1_N: tuple[float, float]
    is_gain_significant: bool
    covariance: Floats
    mismatch: float
    disagreement_m_s: float
    prior_std: Floats
    mean_u: Floats
    squat: tuple[float, float] = (0.0, 0.0)
    pitch_shows_squat: bool = False
    swing: BodySwing = NO_SWING
    springs: BodySwing | None = None
    estimates_of_this_log: "WheelKinematics | None" = None

    @property
    def estimates_by_prior_name(self) -> dict[str, tuple[float, float]]:
        """Slip, gain and delay, by the names of their learnt priors."""
        return dict(zip(TERMS, (self.slip_1_N, self.gain_by_prior, self.delay_s), strict=True))

    @property
    def is_consistent(self) -> bool:
        """Whether the residuals of the comparison are small enough to use slip and delay."""
        return self.mismatch <= LIMITS.max_kinematic_mismatch

    @property
    def can_start_next_comparison(self) -> bool:
        """Whether the comparison is good enough as the starting point of another one."""
        return self.is_consistent and abs(self.delay_s[0]) < LIMITS.longest_delay_s

    def copy_with_learnt_slip_gain_and_delay(self, priors: PriorSettings) -> "WheelKinematics":
        """Replace slip, gain and delay by those learnt by a calibration.

        The three are correlated, so they are replaced together. This log's own values stay if its
        gain exceeds what its prior and the noise allow, if wheels and accelerometer are
        inconsistent, or if a term is not learnt.
        """
        terms = [priors.learnt[name] for name in TERMS if name in priors.learnt]
        if len(terms) < len(TERMS) or not self.is_consistent or self.is_gain_significant:
            return self
        slip, gain, delay = ((term.mean, term.std) for term in terms)
        return replace(
            self,
            slip_1_N=slip,
            gain_by_prior=gain,
            delay_s=delay,
            covariance=np.diag([term.std**2 for term in terms]),
            prior_std=np.array([term.std for term in terms]),
            mean_u=np.array([term.mean_u for term in terms]),
            estimates_of_this_log=self,
        )


#: Columns, response and stretch of the rows of a comparison, and the noise in them.
ComparisonRows = tuple[Floats, Floats, Ints, NoiseMoments]


def estimate_gain_that_noise_mimics(
    rows: ComparisonRows, noise: ColumnNoiseModel, prior_std: Floats, step_s: float
) -> float:
    """Size of the apparent gain that noise in the integrated accelerometer causes.

    The coefficient of a noisy column is too small (Fuller, Measurement Error Models, section 1.1).
    The integral of white noise is a random walk; after removal of a line, N steps have a mean
    square of N/15 times that of one step.

    Args:
        rows: the comparison's rows.
        noise: noise of the channels.
        prior_std: (4,) prior standard deviations, divided by that of the residual.
        step_s: step of the grid.
    """
    X, _, group, _ = rows
    of_step = (
        noise.compute_covariance_of_means(LIMITS.accumulated_noise_samples)[0, 0]
        * LIMITS.accumulated_noise_samples
        * step_s**2
    )
    counts = np.bincount(group)
    walked = of_step / 15.0 * float(counts @ ((counts - 1) * EVERY + MEAN))
    squares = (X**2).sum(axis=0)
    scale = np.where(squares > NOTHING, np.sqrt(squares), 1.0)
    precision = (X / scale).T @ (X / scale) + np.diag((prior_std * scale) ** -2.0)
    if not np.isfinite(precision).all():  # a log without noise has no residuals
        return 0.0
    return walked * float(np.linalg.pinv(precision)[0, 0]) / scale[0] ** 2


def compute_parameter_std_bounds_by_noise(
    rows: ComparisonRows, noise: ColumnNoiseModel, prior_std: Floats, step_s: float
) -> Floats:
    """Lower bound of the parameters' standard deviations by instrument noise alone, (4,).

    Noise of the accelerometer accumulates over a manoeuvre and the fit follows it, so the residuals
    of a few manoeuvres understate it.
    """
    X, _, group, _ = rows
    of_mean = (
        noise.compute_covariance_of_means(LIMITS.accumulated_noise_samples)[0, 0]
        * LIMITS.accumulated_noise_samples
        * step_s**2
        * EVERY
    )
    of_speed = noise.compute_covariance_of_means(MEAN)[1, 1] * MEAN / EVERY
    squares = (X**2).sum(axis=0)
    # for a column of zeros only the prior is known
    scale = np.where(squares > NOTHING, np.sqrt(squares), 1.0)
    X = X / scale
    added = np.concatenate([np.cumsum(X[part][::-1], axis=0) for part in list_rows_by_group(group)])
    scores = of_mean * added.T @ added + of_speed * X.T @ X
    gram = X.T @ X
    variance = float(np.trace(scores)) / X.shape[1]
    prior = np.diag((prior_std * scale) ** -2.0)
    bread = np.linalg.pinv(gram / variance + prior)
    covariance = bread @ (scores / variance**2 + prior) @ bread
    # rounding may make a tiny variance negative
    return np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale


def differentiate_wheel_speed(motion: MotionSamples) -> Floats:
    """Acceleration from the wheels, with gravity by the pitch if measured, (n,) in m/s²."""
    rate_m_s2 = np.gradient(motion.speed) * motion.rate_hz
    if motion.specific_force is None or motion.without_gravity is None:
        return rate_m_s2
    return rate_m_s2 + (motion.specific_force - motion.without_gravity)
