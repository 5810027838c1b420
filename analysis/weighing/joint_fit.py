"""The joint fit: masses and friction with the nuisance terms, found in rounds."""

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np

from analysis.settings import LearntTerm, PriorSettings
from analysis.weighing.averages import EarlierRounds, RelativeLoads, averages
from analysis.weighing.drifts import NARROW, LikelyDrifts
from analysis.weighing.equation import Equation, Floats, KeptNoise, NoiseOfColumns
from analysis.weighing.ground import ground_scatter
from analysis.weighing.joint_result import JointFit, MotionResponses, PriorMeans, place_of
from analysis.weighing.kinematics import Kinematics, kinematics
from analysis.weighing.nuisances import (
    NUISANCES,
    Nuisance,
    const_width,
    offset_in_const,
    weight_in_const,
    weight_in_direction,
)
from analysis.weighing.squat import find_squat
from analysis.weighing.states import States, found_states, places, stretch_units, untold_states
from estimators import prior_fit
from estimators.prior_fit import Grouping
from estimators.units import Units, units_of

#: Lengths of the mean that are tried: the one with the smallest deviation of the mass is taken.
MEANS: Final = (5, 10, 20, 40, 80, 160)
#: Rounds of finding the lag, moving the force back by it, and fitting again.
_ROUNDS: Final = 4
#: Of the fits that choose the mean: a lag that is not made up for would choose.
_PILOT_ROUNDS: Final = 2
#: Fewer manoeuvres do not tell a drift from a change of load.
_FEWEST_OF_DRIFT: Final = 6
#: Likewise of load states and the fit that takes the nuisances off.
_STATE_ROUNDS: Final = 4
#: A mass of less, as a share of force over acceleration, is none.
_LEAST: Final = 0.1
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
#: A lag that changes by less is found.
_LAG_FOUND_S: Final = 1e-4
#: So many widths of its prior an offset is taken off the force, at most.
_MOST_OFFSET: Final = 3.0
#: A lag is looked for up to here.
_LONGEST_LAG_S: Final = 0.3
#: Errors of the motion that show what such ones do to the masses.
_LATER_S: Final = 0.005
_LARGER: Final = 0.01
#: What the wheels say of slip is never trusted beyond this share of its prior.
_LEAST_SLIP: Final = 0.05


@dataclass(frozen=True)
class Fitted:
    """What is fitted, and what is known of it.

    Attributes:
        motion: the samples.
        noise: of acceleration, speed and force.
        priors: of the nuisances.
        wheels: what they say of the accelerometer, the force as it was measured.
        ground_1_s: how much the ground's force differs from stretch to stretch (`ground_scatter`).
    """

    motion: Equation
    noise: NoiseOfColumns
    priors: PriorSettings
    wheels: Kinematics | None
    ground_1_s: float = 0.0

    @classmethod
    def of(cls, motion: Equation, noise: NoiseOfColumns, priors: PriorSettings) -> Self:
        """Ask the wheels."""
        noise = KeptNoise(noise)
        return cls(motion, noise, priors, _wheels(motion, noise, priors))


def joint_fit(of: Fitted, states: States | None = None) -> JointFit:
    """Fit with the shortest mean that leaves nearly the smallest uncertainty."""
    motion = of.motion
    several = states is not None and states.count > 1
    terms = tuple(
        term for term in NUISANCES if term.applies(motion) and (several or not term.by_load)
    )
    whole = _Task(motion, of.noise, of.priors, terms, of.wheels, states, of.ground_1_s)
    part = whole.beginning(_TRIED)
    longest = int(np.median(np.bincount(motion.group[motion.used]))) / _MEANS_A_STRETCH
    lengths = [samples for samples in MEANS if samples <= max(longest, MEANS[0])]
    first = [part.fitted(samples, _PILOT_ROUNDS) for samples in lengths]
    # a lag that is far from made up for may leave no mass at all
    first = [found for found in first if found.mass_kg > _LEAST * motion.about_kg] or first
    telling = [found for found in first if found.fit.noise_share <= _MOST_NOISE] or first[-1:]
    least_kg = min(found.u_kg for found in telling)
    # the shortest that is nearly as good: a long mean hides what the model misses
    best = next(found for found in telling if not found.u_kg > _NEARLY * least_kg)
    samples = best.mean_samples
    if abs(best.lag_s) > _SHORT_LAG_S or best.found.transfer_s2_m:
        # slip is of the force on the ground at that moment
        in_time = motion.with_force_moved_back(best.lag_s)
        acting = replace(in_time, force=best.found.acting(in_time))
        whole = replace(whole, wheels=_wheels(acting, of.noise, of.priors))
    share = _averaging_share(first, next(k for k, found in enumerate(first) if found is best))
    moved = replace(whole.fitted(samples, _ROUNDS), averaging_share=share)
    if abs(moved.lag_s) < _SHORT_LAG_S:
        return moved
    filtered = replace(whole.fitted(samples, 2, shift=False), averaging_share=share)
    filters = filtered.fit.residual_rms < moved.fit.residual_rms
    chosen, other = (filtered, moved) if filters else (moved, filtered)
    if not chosen.fit.misfit.any():
        return chosen
    return replace(chosen, lag_shape_kg=chosen.masses_kg - other.masses_kg)


def _wheels(motion: Equation, noise: NoiseOfColumns, priors: PriorSettings) -> Kinematics | None:
    """What the wheels say, or what a calibration says of them."""
    found = kinematics(motion, noise, priors)
    return None if found is None else found.learnt(priors)


def _averaging_share(by_length: list[JointFit], place: int) -> float:
    """What the mean's length does to the mass, as a share of it; 0 where noise could."""
    best, longer = by_length[place], by_length[place + 1 :]
    if any(_differ(best, other) for other in longer):
        # anywhere between the two is as likely
        return (longer[-1].mass_kg / best.mass_kg - 1.0) / float(np.sqrt(3.0))
    if not longer and place and _differ(best, by_length[place - 1]):
        # the longest has no other but the shorter, and may still be as far from the truth
        return 1.0 - by_length[place - 1].mass_kg / best.mass_kg
    return 0.0


def _differ(one: JointFit, other: JointFit) -> bool:
    """Whether means of two lengths give masses that their uncertainties do not explain."""
    first, second = one.u_kg, other.u_kg
    expected_kg = float(np.sqrt(max(abs(first**2 - second**2), min(first, second) ** 2 / 4.0)))
    difference_kg = abs(one.mass_kg - other.mass_kg)
    return difference_kg > max(_DIFFER * expected_kg, _DIFFER_SHARE * abs(one.mass_kg))


def again(
    found: JointFit,
    noise: NoiseOfColumns,
    priors: PriorSettings,
    extra: tuple[Nuisance, ...] = (),
    rounds: int = 1,
) -> JointFit:
    """Fit the same samples with other priors, or with further terms behind the others.

    Drifts that the log is unlikely to have stay left out.
    """
    if found.drifts is not None:
        priors = found.drifts.narrowed(priors)
    terms = (*found.terms, *extra)
    task = _Task(found.motion, noise, priors, terms, found.kinematics, found.states)
    fitted = task.fitted(found.mean_samples, rounds, shift=found.shifted, begin=found)
    if fitted.count != found.count:
        # of other loads
        return fitted
    return replace(
        fitted,
        lag_shape_kg=found.lag_shape_kg,
        averaging_share=found.averaging_share,
        drifts=found.drifts,
        squat=found.squat,
    )


def with_likely_drifts(found: JointFit, noise: NoiseOfColumns, priors: PriorSettings) -> JointFit:
    """Fit without the drifts that the log is unlikely to have."""
    likely = LikelyDrifts.of(found.fit, found.count, found.terms, found.prior_std)
    found = replace(found, drifts=likely)
    return again(found, noise, priors, rounds=2) if likely and likely.left_out else found


def with_squat(found: JointFit, priors: PriorSettings) -> JointFit:
    """Look for an accelerometer whose gain changes with the load."""
    wheels, loads, states = found.kinematics, found.found.relative_loads, found.states
    if wheels is None or loads is None or states is None or not wheels.goes_together:
        return found
    told = found.motion.without_gravity is None or wheels.squat[0] > 0.0
    if not (found.motion.by_accelerometer and told):
        return found
    first = np.unique(states.of, return_index=True)[1]
    squat = find_squat(found.motion, wheels, loads, loads.value[first], priors.gain_by_load)
    return replace(found, squat=squat)


def with_responses(found: JointFit, noise: NoiseOfColumns, priors: PriorSettings) -> JointFit:
    """Find what errors of the motion do to each mass, by fitting once more with each."""
    if found.kinematics is None or not found.motion.by_accelerometer:
        return found
    known, count = found.found, found.count

    def moved(changed: EarlierRounds, by: float) -> Floats:
        other = again(replace(found, found=changed), noise, priors)
        return (other.theta[:count] - found.theta[:count]) / by

    later = replace(known, speed_late_s=known.speed_late_s + _LATER_S)
    larger = replace(known, motion_gain=known.motion_gain + _LARGER)
    responses = MotionResponses(moved(later, _LATER_S), moved(larger, _LARGER))
    return replace(found, by_motion=responses)


def with_states(found: JointFit, of: Fitted, repeatability_kg: float | None) -> JointFit:
    """Look for load states, and fit with a mass each, until nothing changes."""
    number, hints = np.unique(stretch_units(found.motion)), places(found.motion)
    if not np.isfinite(found.theta).all():
        return replace(found, states=untold_states(number))
    found, of = _with_ground(found, of)
    seen: set[bytes] = set()
    for _ in range(_STATE_ROUNDS):
        task = _Task(found.motion, of.noise, of.priors, found.terms, found.kinematics, found.states)
        units = task.units(found)
        states = found_states(replace(units, kind=hints), number, repeatability_kg)
        before = found.states
        if states.count == 1 and found.count == 1:
            return again(replace(found, states=states), of.noise, of.priors)
        if before is not None and np.array_equal(states.of, before.of):
            # the same loads, whose scatter is known better now
            return again(replace(found, states=states), of.noise, of.priors, rounds=2)
        found = joint_fit(of, states)
        if states.of.tobytes() in seen:
            break
        seen.add(states.of.tobytes())
    return found


def _with_ground(found: JointFit, of: Fitted) -> tuple[JointFit, Fitted]:
    """Fit once more with constants that scatter from stretch to stretch, where they do."""
    rows = averages(found.motion, of.noise, found.terms, found.mean_samples, found.found)
    shared = found.theta[found.count :].copy()
    if found.shifted:
        # the force has been moved back by it
        shared[1 + place_of("lag", found.terms)] = 0.0
    scatter_1_s = ground_scatter(rows, shared, found.mean_samples, found.motion.rate_hz)
    if not scatter_1_s:
        return found, of
    of = replace(of, ground_1_s=scatter_1_s)
    return joint_fit(of, found.states), of


@dataclass(frozen=True)
class _Task:
    """What is to be fitted, and what is known."""

    motion: Equation
    noise: NoiseOfColumns
    priors: PriorSettings
    terms: tuple[Nuisance, ...]
    wheels: Kinematics | None
    states: States | None
    ground_1_s: float = 0.0

    def beginning(self, stretches: int) -> "_Task":
        """The same up to the end of so many stretches."""
        motion = self.motion.beginning(stretches)
        states = None if self.states is None else self.states.among(motion)
        return replace(self, motion=motion, states=states)

    def fitted(
        self, samples: int, rounds: int, *, shift: bool = True, begin: JointFit | None = None
    ) -> JointFit:
        """Fit with means of `samples`: lag and slip depend on what the fit finds, so again.

        A force that is late is moved back; one that is low-passed is not, since its derivative
        alone makes up for that (f + τ df/dt).
        """
        lag = place_of("lag", self.terms)
        std = np.zeros(len(self.terms))
        levels = None if self.states is None else self.states.levels(self.motion)
        # behind the masses and friction
        first = 2 if levels is None else levels.count + 1
        known = (
            begin.found
            if begin
            else EarlierRounds(
                slip_1_N=self._slip(),
                motion_gain=self._squat_gain(),
                speed_late_s=self._speed_late_s(),
                relative_loads=self._relative_loads(),
                ground_1_s=self.ground_1_s,
            )
        )
        known = known if shift else replace(known, lag_s=0.0)
        solution, mean, known_s = None, std, 0.0
        masses_and_friction = begin and begin.theta[: begin.count + 1]
        for number in range(rounds):
            mean, std = self._priors(masses_and_friction)
            self._narrow_gain_drift(std)
            known_s = known.lag_s
            mean[lag] -= known_s
            rows = averages(self.motion, self.noise, self.terms, samples, known)
            solution = prior_fit.solve(
                rows.A,
                rows.f,
                rows.group,
                rows.noise,
                np.concatenate([np.zeros(2), mean]),
                np.concatenate([np.full(2, np.inf), std]),
                Grouping(rows.direction, rows.shortest, levels),
            )
            masses_and_friction = solution.theta[:first]
            if not np.isfinite(solution.theta).all():
                break
            known, moved = self._found(known, solution.theta, shift=shift)
            if number and moved < _LAG_FOUND_S:
                break
        assert solution is not None
        theta = solution.theta.copy()
        if shift:
            theta[first + lag] = known.lag_s
        return JointFit(
            self.terms,
            std,
            theta,
            solution,
            self.states,
            self.wheels,
            samples,
            self.motion,
            np.zeros(first - 1),
            known,
            shift,
            self._prior_means(mean, known_s),
        )

    def _relative_loads(self, masses_kg: Floats | None = None) -> RelativeLoads | None:
        """Relate the states' masses to their mean over the manoeuvres; None where there is one.

        Args:
            masses_kg: (states,); None: those that the manoeuvres say.
        """
        states = self.states
        if states is None or states.count < 2:
            return None
        masses_kg = states.means_kg if masses_kg is None else masses_kg
        splits = (weight_in_const, weight_in_direction)
        shares = [split(self.motion, self.priors).expected for split in splits]
        return RelativeLoads.of(states.unit, masses_kg[states.of], (shares[0], shares[1]))

    def _found(
        self, before: EarlierRounds, theta: Floats, *, shift: bool
    ) -> tuple[EarlierRounds, float]:
        """What a round found, and how far the lag moved by it."""
        masses = theta.size - 1 - len(self.terms)
        names = (term.name for term in self.terms)
        by_name = dict(zip(names, theta[masses + 1 :].tolist(), strict=True))
        late_s = by_name["lag"]
        lag_s = float(np.clip(before.lag_s + late_s, -_LONGEST_LAG_S, _LONGEST_LAG_S))
        share, _ = offset_in_const(self.motion, self.priors)
        width = const_width(self.motion, self.priors)
        after = replace(
            before,
            lag_s=lag_s if shift else 0.0,
            transfer_s2_m=by_name.get("load_transfer", 0.0),
            offset_N=float(
                np.clip(share * by_name["const"], -_MOST_OFFSET * width, _MOST_OFFSET * width)
            ),
            slip_s_m=by_name["slip"],
            relative_loads=self._relative_loads(theta[:masses]),
        )
        return after, abs(late_s)

    def units(self, fit: JointFit) -> Units:
        """What each manoeuvre says of its mass, by what a fit found."""
        samples, found = fit.mean_samples, fit.found
        mean, std = self._priors(fit.theta[: fit.count + 1])
        if 1 < self.motion.manoeuvres < _FEWEST_OF_DRIFT:
            std[place_of("gain_drift", self.terms)] *= NARROW
        lag = place_of("lag", self.terms)
        mean[lag] -= found.lag_s
        rows = averages(self.motion, self.noise, self.terms, samples, found)
        return units_of(
            rows.A,
            rows.f,
            rows.group,
            rows.noise,
            np.append(0.0, mean),
            np.append(np.inf, std),
            np.unique(stretch_units(self.motion), return_inverse=True)[1],
        )

    def _speed_late_s(self) -> float:
        """How late the speed is, where wheels and accelerometer tell it."""
        wheels = self.wheels
        told = wheels is not None and wheels.goes_together and self.motion.by_accelerometer
        return wheels.delay_s[0] if wheels is not None and told else 0.0

    def _squat_gain(self) -> float:
        """What is added to the acceleration's own part: its squat, where the pitch shows it."""
        told = self.wheels is not None and self.motion.by_accelerometer
        return -self.wheels.squat[0] if self.wheels is not None and told else 0.0

    def _slip(self) -> float:
        """What share of its speed a newton makes the wheels slip."""
        wheels = self.wheels
        return wheels.slip_1_N[0] if wheels is not None and wheels.goes_together else 0.0

    def _priors(self, masses_and_friction: Floats | None) -> tuple[Floats, Floats]:
        """Means and widths; those of slip once mass and friction are known, by which it costs."""
        std = np.array([term.width(self.motion, self.priors) for term in self.terms])
        mean = np.zeros(len(self.terms))
        if masses_and_friction is not None:
            *masses_kg, friction = masses_and_friction.tolist()
            self._narrow_slip(friction, mean, std)
            if self.motion.wheel_acceleration is not None:
                at = place_of("slip_acceleration", self.terms)
                self._take_from_wheels(at, float(np.mean(masses_kg)), mean, std)
        for place, term in self._learnt_places():
            mean[place], std[place] = term.mean, term.std
        return mean, std

    def _narrow_gain_drift(self, std: Floats) -> None:
        """Leave out a drift of the gain where loads come back.

        Payloads are differences of neighbours then, in which it cancels; free masses on the way
        would follow any drift.
        """
        if self.states is not None and self.states.comes_back:
            std[place_of("gain_drift", self.terms)] *= NARROW

    def _learnt_places(self) -> list[tuple[int, LearntTerm]]:
        """Where the terms are of which a calibration says something; slip the wheels say better."""
        learnt: dict[str, LearntTerm] = {**self.priors.learnt}
        by_wheels = self.wheels is not None and self.wheels.goes_together
        return [
            (place, learnt[term.name])
            for place, term in enumerate(self.terms)
            if term.name in learnt and not (by_wheels and term.name == "slip")
        ]

    def _prior_means(self, mean: Floats, moved_s: float) -> PriorMeans:
        """Those of a round, whose force was moved back by so much."""
        mean, mean_u = mean.copy(), np.zeros(len(self.terms))
        mean[place_of("lag", self.terms)] += moved_s
        for place, term in self._learnt_places():
            mean_u[place] = term.mean_u
        return PriorMeans(mean, mean_u)

    def _narrow_slip(self, friction: float, mean: Floats, std: Floats) -> None:
        """Slip costs friction · slip, and the wheels may tell it."""
        at = place_of("slip", self.terms)
        friction = max(friction, 0.0)
        std[at] = min(std[at], friction * self.priors.wheel_slip / self.motion.largest_force)
        std[at] = max(std[at], _LEAST_SLIP * self.priors.wheel_slip / self.motion.largest_speed)
        self._take_from_wheels(at, -friction, mean, std)

    def _take_from_wheels(self, at: int, cost: float, mean: Floats, std: Floats) -> None:
        """Set the prior of a term that is so many times the slip, where the wheels tell it."""
        if self.wheels is not None and self.wheels.goes_together:
            slip_1_N, u_1_N = self.wheels.slip_1_N
            mean[at] = cost * slip_1_N
            std[at] = np.hypot(cost * u_1_N, _LEAST_SLIP * std[at])
