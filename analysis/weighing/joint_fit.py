"""The joint fit: mass and friction with the nuisance terms, and what its uncertainty is made of."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.settings import PriorSettings
from analysis.weighing.equation import Equation, Floats, Ints, NoiseOfColumns
from analysis.weighing.kinematics import Kinematics, kinematics
from analysis.weighing.nuisances import NUISANCES, Moments, Nuisance
from estimators import prior_fit
from estimators.group_mean import trailing_group_mean
from estimators.prior_fit import NoiseMoments, PriorFit

#: Lengths of the mean that are tried: the one with the smallest deviation of the mass is taken.
MEANS: Final = (5, 10, 20, 40, 80, 160)
#: Rounds of finding the lag, moving the force back by it, and fitting again.
_ROUNDS: Final = 4
#: With more noise than this in a direction of its columns a mean is too short.
_MOST_NOISE: Final = 0.3
_NEARLY: Final = 1.1
#: A lag is looked for up to here.
_LONGEST_LAG_S: Final = 0.3
#: A derivative of the force is noise below so many of its deviations.
_RATE_COUNTS: Final = 4.0
#: Samples of the parabola that gives the derivative.
_RATE_SAMPLES: Final = 9
#: What the wheels say of slip is never trusted beyond this share of its prior.
_LEAST_SLIP: Final = 0.05


@dataclass(frozen=True)
class JointFit:
    """The fit, and how it came about.

    Attributes:
        terms: the nuisances, in the order of the parameters behind mass and friction.
        prior_mean: (terms,) and
        prior_std: (terms,) of the priors that were used.
        fit: estimates and parts; mass first, friction second. The lag is the whole lag.
        kinematics: what the wheels say of the accelerometer, where there is one.
        mean_samples: length of the mean.
        motion: what was fitted.
        lag_shape_kg: what it would change to take a lag for a low-pass instead of a delay, or the
            other way round, where neither makes up for it; else 0.
    """

    terms: tuple[Nuisance, ...]
    prior_mean: Floats
    prior_std: Floats
    fit: PriorFit
    kinematics: Kinematics | None
    mean_samples: int
    motion: Equation
    lag_shape_kg: float = 0.0

    @property
    def parts_kg(self) -> dict[str, float]:
        """What the mass' standard uncertainty is made of, by cause."""
        parts = {
            "noise": float(np.sqrt(max(self.fit.noise[0, 0], 0.0))),
            **{
                term.name: abs(float(self.fit.responses[2 + i, 0]))
                for i, term in enumerate(self.terms)
            },
            "channel_noise": abs(float(self.fit.doubt[0])),
            "scatter": float(np.sqrt(max(self.fit.scatter[0, 0], 0.0))),
            "misfit": float(np.sqrt(max(self.fit.misfit[0, 0], 0.0))),
            "lag_shape": abs(self.lag_shape_kg) / 2.0,
        }
        wheels = self.kinematics
        if wheels is not None:
            if self.motion.by_accelerometer:
                parts["speed_delay"] = max(float(self.fit.theta[1]), 0.0) * wheels.delay_s[1]
            if wheels.gain_counts:
                # a wrong wheel radius is in the force, and in a speed's derivative once more
                times = 1.0 if self.motion.by_accelerometer else 2.0
                parts["gain"] = times * abs(wheels.gain[0] * self.mass_kg)
        return parts

    @property
    def mass_kg(self) -> float:
        """The mass, what the speed's delay adds to it taken off."""
        late = 0.0
        if self.kinematics is not None and self.motion.by_accelerometer:
            late = self.kinematics.delay_s[0]
        return float(self.fit.theta[0]) - max(float(self.fit.theta[1]), 0.0) * late

    @property
    def u_kg(self) -> float:
        """Its standard uncertainty by this log alone, without the scale."""
        return float(np.sqrt(sum(part**2 for part in self.parts_kg.values())))


def joint_fit(
    motion: Equation,
    noise: NoiseOfColumns,
    priors: PriorSettings,
    extra: tuple[Nuisance, ...] = (),
) -> JointFit:
    """Fit with the mean that leaves the smallest uncertainty."""
    terms = (*(term for term in NUISANCES if term.applies(motion)), *extra)
    wheels = kinematics(motion, noise, priors)
    first = [_fitted(motion, noise, priors, terms, wheels, samples, 1) for samples in MEANS]
    telling = [found for found in first if found.fit.noise_share <= _MOST_NOISE] or first[-1:]
    least_kg = min(found.u_kg for found in telling)
    # the shortest that is nearly as good: a long mean hides what the model misses
    best = next(found for found in telling if not found.u_kg > _NEARLY * least_kg)
    moved, filtered = (
        _fitted(motion, noise, priors, terms, wheels, best.mean_samples, _ROUNDS, shift=shift)
        for shift in (True, False)
    )
    filters = filtered.fit.residual_rms < moved.fit.residual_rms
    chosen, other = (filtered, moved) if filters else (moved, filtered)
    if not chosen.fit.misfit.any():
        return chosen
    return replace(chosen, lag_shape_kg=chosen.mass_kg - other.mass_kg)


def _fitted(
    motion: Equation,
    noise: NoiseOfColumns,
    priors: PriorSettings,
    terms: tuple[Nuisance, ...],
    wheels: Kinematics | None,
    samples: int,
    rounds: int,
    *,
    shift: bool = True,
) -> JointFit:
    """Fit with means of `samples`: lag and slip depend on what the fit finds, so again.

    A force that is late is moved back; one that is low-passed is not, since its derivative alone
    makes up for that (f + τ df/dt).
    """
    names = [term.name for term in terms]
    widths = np.array([term.width(motion, priors) for term in terms])
    means = np.zeros(len(terms))
    lag_s = 0.0
    fitted: PriorFit | None = None
    std = widths
    for _ in range(rounds):
        mean, std = means.copy(), widths.copy()
        if wheels is not None and fitted is not None and "slip" in names:
            at, friction = names.index("slip"), max(float(fitted.theta[1]), 0.0)
            mean[at] = -friction * wheels.slip_1_N[0]
            std[at] = np.hypot(friction * wheels.slip_1_N[1], _LEAST_SLIP * widths[at])
        if "lag" in names:
            mean[names.index("lag")] = -lag_s
        fitted = _once(motion, noise, terms, mean, std, lag_s, samples)
        found = float(fitted.theta[2 + names.index("lag")])
        if not np.isfinite(found):
            break
        lag_s = float(np.clip(lag_s + found, -_LONGEST_LAG_S, _LONGEST_LAG_S)) if shift else 0.0
    assert fitted is not None
    theta = fitted.theta.copy()
    if shift:
        theta[2 + names.index("lag")] = lag_s
    return JointFit(terms, means, std, replace(fitted, theta=theta), wheels, samples, motion)


def _once(
    motion: Equation,
    noise: NoiseOfColumns,
    terms: tuple[Nuisance, ...],
    prior_mean: Floats,
    prior_std: Floats,
    lag_s: float,
    samples: int,
) -> PriorFit:
    """One linear fit with the force moved back by a lag."""
    rows = np.arange(motion.force.size, dtype=np.float64)
    force = np.interp(rows + lag_s * motion.rate_hz, rows, motion.force)
    raw = Moments(
        motion.acceleration,
        motion.speed,
        force,
        _rate(force, motion.rate_hz, float(np.sqrt(noise.covariance(1)[2, 2]))),
        motion.direction,
        rows / rows.size - 0.5,
    )

    def mean(x: Floats) -> Floats:
        return trailing_group_mean(x, motion.group, samples)[0]

    count = trailing_group_mean(raw.speed, motion.group, samples)[1]
    A = np.column_stack(
        [mean(raw.acceleration), mean(raw.speed), *(mean(term.column(raw)) for term in terms)]
    )
    smoothed = mean(force)
    weight = _weights(A[:, :2], smoothed, motion, noise, count)
    free = np.full(2, np.inf)
    return prior_fit.fit(
        A * weight[:, None],
        smoothed * weight,
        motion.group,
        _noise_moments(terms, raw, motion, noise, count, weight),
        np.concatenate([np.zeros(2), prior_mean]),
        np.concatenate([free, prior_std]),
        motion.direction,
    )


def _weights(
    A: Floats, force: Floats, motion: Equation, noise: NoiseOfColumns, count: Ints
) -> Floats:
    """Square roots of the samples' weights, (n,): the first means of a start are of few samples."""
    used = motion.used
    mass, friction = np.linalg.lstsq(A[used], force[used], rcond=None)[0]
    gradient = np.array([mass, friction, -1.0])
    kinds, which = np.unique(count[used], return_inverse=True)
    variances = np.array([gradient @ noise.covariance(int(k)) @ gradient for k in kinds])
    weight = np.zeros(count.size)
    weight[used] = np.sqrt(variances[-1] / np.maximum(variances[which], variances[-1]))
    return weight


def _rate(force: Floats, rate_hz: float, noise_N: float) -> Floats:
    """The derivative of the force in N/s, 0 where it is no more than noise."""
    half = _RATE_SAMPLES // 2
    steps = (
        np.arange(half, -half - 1, -1) * rate_hz / float(2 * (np.arange(1, half + 1) ** 2).sum())
    )
    rate = np.convolve(force, steps, "same")
    return np.where(np.abs(rate) > _RATE_COUNTS * noise_N * np.sqrt(steps @ steps), rate, 0.0)


def _noise_moments(
    terms: tuple[Nuisance, ...],
    raw: Moments,
    motion: Equation,
    noise: NoiseOfColumns,
    count: Ints,
    weight: Floats,
) -> NoiseMoments:
    """What noise of acceleration, speed and force adds to AᵀA and Aᵀf, by manoeuvre."""
    used = motion.used
    ids, index = np.unique(motion.group[used], return_inverse=True)
    p = 2 + len(terms)
    # derivatives of the columns by acceleration, speed and force
    slopes = np.zeros((int(used.sum()), p, 3))
    slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
    for j, term in enumerate(terms, start=2):
        if term.by_speed is not None:
            slopes[:, j, 1] = term.by_speed(raw)[used]
        if term.by_force is not None:
            slopes[:, j, 2] = term.by_force(raw)[used]
    slopes *= weight[used][:, None, None]
    kinds, which = np.unique(count[used], return_inverse=True)
    covariances = np.stack([noise.covariance(int(samples)) for samples in kinds])
    moments = prior_fit.noise_moments(slopes, covariances, which, index, ids.size)
    return NoiseMoments(*moments)
