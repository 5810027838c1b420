"""The joint fit: mass and friction with the nuisance terms, and what its uncertainty is made of."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.settings import PriorSettings
from analysis.weighing.averages import averages
from analysis.weighing.equation import Equation, Floats, NoiseOfColumns
from analysis.weighing.kinematics import Kinematics, kinematics
from analysis.weighing.nuisances import NUISANCES, Nuisance
from estimators import prior_fit
from estimators.prior_fit import PriorFit

#: Lengths of the mean that are tried: the one with the smallest deviation of the mass is taken.
MEANS: Final = (5, 10, 20, 40, 80, 160)
#: Rounds of finding the lag, moving the force back by it, and fitting again.
_ROUNDS: Final = 4
#: With more noise than this in a direction of its columns a mean is too short.
_MOST_NOISE: Final = 0.3
_NEARLY: Final = 1.1
#: The mass depends on the mean's length from so many deviations, and from this share of it, on.
_DIFFER: Final = 2.5
_DIFFER_SHARE: Final = 0.02
#: A stretch holds at least so many means that have no sample in common.
_MEANS_A_STRETCH: Final = 6
#: So many stretches tell which mean is best.
_TRIED: Final = 24
#: Up to here it does not matter whether a force is delayed or low-passed.
_SHORT_LAG_S: Final = 0.003
#: A lag is looked for up to here.
_LONGEST_LAG_S: Final = 0.3
#: What the wheels say of slip is never trusted beyond this share of its prior.
_LEAST_SLIP: Final = 0.05


@dataclass(frozen=True)
class JointFit:
    """The fit, and how it came about.

    Attributes:
        terms: the nuisances, in the order of the parameters behind mass and friction.
        prior_std: (terms,) widths of the priors that were used.
        fit: estimates and parts; mass first, friction second. The lag is the whole lag.
        kinematics: what the wheels say of the accelerometer, where there is one.
        mean_samples: length of the mean.
        motion: what was fitted.
        lag_shape_kg: what it would change to take a lag for a low-pass instead of a delay, or the
            other way round, where neither makes up for it; else 0.
        shifted: whether the force was moved back by the lag.
        averaging_kg: what a longer mean changes, where the mass depends on its length.
    """

    terms: tuple[Nuisance, ...]
    prior_std: Floats
    fit: PriorFit
    kinematics: Kinematics | None
    mean_samples: int
    motion: Equation
    lag_shape_kg: float = 0.0
    shifted: bool = True
    averaging_kg: float = 0.0

    @property
    def lag_s(self) -> float:
        """How late the force is."""
        return float(self.fit.theta[2 + _place("lag", self.terms)])

    @property
    def terms_t(self) -> dict[str, float]:
        """By term, how many deviations of what the log tells it is from 0."""
        found = np.abs(self.fit.theta[2:]) / self.fit.std[2:]
        return dict(zip((term.name for term in self.terms), found.tolist(), strict=True))

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
            "averaging": abs(self.averaging_kg),
        }
        wheels = self.kinematics
        if wheels is not None:
            if self.motion.by_accelerometer:
                parts["speed_delay"] = max(float(self.fit.theta[1]), 0.0) * wheels.delay_s[1]
            # a wrong wheel radius is in the force, and in a speed's derivative once more
            times = 1.0 if self.motion.by_accelerometer else 2.0
            if wheels.gain_counts:
                parts["gain"] = times * abs(wheels.gain[0] * self.mass_kg)
            elif self.corrects_gain:
                parts["gain"] = wheels.gain_by_prior[1] * abs(self.mass_kg)
        return parts

    @property
    def mass_kg(self) -> float:
        """The mass, what the speed's delay and the accelerometer's gain do to it taken off."""
        late, gain, wheels = 0.0, 0.0, self.kinematics
        if wheels is not None and wheels.goes_together and self.motion.by_accelerometer:
            late = wheels.delay_s[0]
        if wheels is not None and self.corrects_gain:
            gain = wheels.gain_by_prior[0]
        return (float(self.fit.theta[0]) - max(float(self.fit.theta[1]), 0.0) * late) / (1.0 + gain)

    @property
    def corrects_gain(self) -> bool:
        """Whether the accelerometer's gain, as far as its prior has it, is taken off the mass."""
        wheels = self.kinematics
        if wheels is None or not self.motion.by_accelerometer:
            return False
        return wheels.goes_together and not wheels.gain_counts

    @property
    def u_kg(self) -> float:
        """Its standard uncertainty by this log alone, without the scale."""
        return float(np.sqrt(sum(part**2 for part in self.parts_kg.values())))


def joint_fit(motion: Equation, noise: NoiseOfColumns, priors: PriorSettings) -> JointFit:
    """Fit with the shortest mean that leaves nearly the smallest uncertainty."""
    wheels = kinematics(motion, noise, priors)
    terms = tuple(term for term in NUISANCES if term.applies(motion))
    whole = _Task(motion, noise, priors, terms, wheels)
    part = replace(whole, motion=motion.beginning(_TRIED))
    longest = int(np.median(np.bincount(motion.group[motion.used]))) / _MEANS_A_STRETCH
    lengths = [samples for samples in MEANS if samples <= max(longest, MEANS[0])]
    first = [part.fitted(samples, 1) for samples in lengths]
    telling = [found for found in first if found.fit.noise_share <= _MOST_NOISE] or first[-1:]
    least_kg = min(found.u_kg for found in telling)
    # the shortest that is nearly as good: a long mean hides what the model misses
    best = next(found for found in telling if not found.u_kg > _NEARLY * least_kg)
    samples = best.mean_samples
    averaging_kg = _averaging_kg(first, lengths.index(samples))
    moved = replace(whole.fitted(samples, _ROUNDS), averaging_kg=averaging_kg)
    if abs(moved.lag_s) < _SHORT_LAG_S:
        return moved
    filtered = replace(whole.fitted(samples, 2, shift=False), averaging_kg=averaging_kg)
    filters = filtered.fit.residual_rms < moved.fit.residual_rms
    chosen, other = (filtered, moved) if filters else (moved, filtered)
    if not chosen.fit.misfit.any():
        return chosen
    return replace(chosen, lag_shape_kg=chosen.mass_kg - other.mass_kg)


def _averaging_kg(by_length: list[JointFit], place: int) -> float:
    """What the mean's length does to the mass, as a standard uncertainty; 0 where noise could."""
    best, longer = by_length[place], by_length[place + 1 :]
    if any(_differ(best, other) for other in longer):
        # anywhere between the two is as likely
        return (longer[-1].mass_kg - best.mass_kg) / float(np.sqrt(3.0))
    if not longer and place and _differ(best, by_length[place - 1]):
        # the longest has no other but the shorter, and may still be as far from the truth
        return best.mass_kg - by_length[place - 1].mass_kg
    return 0.0


def _differ(one: JointFit, other: JointFit) -> bool:
    """Whether means of two lengths give masses that their uncertainties do not explain."""
    first, second = one.u_kg, other.u_kg
    expected_kg = float(np.sqrt(max(abs(first**2 - second**2), min(first, second) ** 2 / 4.0)))
    difference_kg = abs(one.mass_kg - other.mass_kg)
    return difference_kg > max(_DIFFER * expected_kg, _DIFFER_SHARE * abs(one.mass_kg))


def _place(name: str, terms: tuple[Nuisance, ...]) -> int:
    return [term.name for term in terms].index(name)


def again(
    found: JointFit, noise: NoiseOfColumns, priors: PriorSettings, extra: tuple[Nuisance, ...] = ()
) -> JointFit:
    """Fit the same samples with other priors, or with further terms behind the others."""
    task = _Task(found.motion, noise, priors, (*found.terms, *extra), found.kinematics)
    return task.fitted(found.mean_samples, 1, shift=found.shifted, begin=found)


@dataclass(frozen=True)
class _Task:
    """What is to be fitted, and what is known."""

    motion: Equation
    noise: NoiseOfColumns
    priors: PriorSettings
    terms: tuple[Nuisance, ...]
    wheels: Kinematics | None

    def fitted(
        self, samples: int, rounds: int, *, shift: bool = True, begin: JointFit | None = None
    ) -> JointFit:
        """Fit with means of `samples`: lag and slip depend on what the fit finds, so again.

        A force that is late is moved back; one that is low-passed is not, since its derivative
        alone makes up for that (f + τ df/dt).
        """
        lag = _place("lag", self.terms)
        wheels = self.wheels
        slip_1_N = wheels.slip_1_N[0] if wheels is not None and wheels.goes_together else 0.0
        std = np.zeros(len(self.terms))
        lag_s = begin.lag_s if begin and shift else 0.0
        fitted = begin.fit if begin else None
        for _ in range(rounds):
            mean, std = self._priors(fitted)
            mean[lag] = -lag_s
            rows = averages(self.motion, self.noise, self.terms, lag_s, samples, slip_1_N)
            fitted = prior_fit.fit(
                rows.A,
                rows.f,
                rows.group,
                rows.noise,
                np.concatenate([np.zeros(2), mean]),
                np.concatenate([np.full(2, np.inf), std]),
                rows.direction,
                rows.shortest,
            )
            found = float(fitted.theta[2 + lag])
            if not np.isfinite(found):
                break
            lag_s = float(np.clip(lag_s + found, -_LONGEST_LAG_S, _LONGEST_LAG_S)) if shift else 0.0
        assert fitted is not None
        theta = fitted.theta.copy()
        if shift:
            theta[2 + lag] = lag_s
        fit = replace(fitted, theta=theta)
        return JointFit(self.terms, std, fit, self.wheels, samples, self.motion, shifted=shift)

    def _priors(self, fitted: PriorFit | None) -> tuple[Floats, Floats]:
        """Means and widths; those of slip once friction is known: it costs friction · slip."""
        std = np.array([term.width(self.motion, self.priors) for term in self.terms])
        mean = np.zeros(len(self.terms))
        if fitted is None:
            return mean, std
        at = _place("slip", self.terms)
        friction = max(float(fitted.theta[1]), 0.0)
        std[at] = min(std[at], friction * self.priors.wheel_slip / self.motion.largest_force)
        std[at] = max(std[at], _LEAST_SLIP * self.priors.wheel_slip / self.motion.largest_speed)
        if self.wheels is not None and self.wheels.goes_together:
            mean[at] = -friction * self.wheels.slip_1_N[0]
            std[at] = np.hypot(friction * self.wheels.slip_1_N[1], _LEAST_SLIP * std[at])
        return mean, std
