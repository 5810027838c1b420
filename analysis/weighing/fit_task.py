"""One set of samples, priors and load states, fitted in rounds until lag and slip stand."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.model.prior_settings import LearntTerm, PriorSettings
from analysis.weighing.fit_columns import FitRows, PreviousEstimates, RelativeLoads, average_columns
from analysis.weighing.haul_route import Route
from analysis.weighing.joint_result import (
    JointFit,
    LazyEstimates,
    PriorMeans,
    resistance_slope,
    term_index,
)
from analysis.weighing.lever_arm import NO_SWING, BodySwing
from analysis.weighing.load_states import LoadStates, unit_of_each_stretch
from analysis.weighing.log_effects import NARROW
from analysis.weighing.motion_samples import ColumnNoiseModel, Floats, MotionSamples
from analysis.weighing.nuisances import (
    Nuisance,
    const_prior_std,
    split_const_by_weight,
    split_coulomb_by_weight,
    split_measured_offset,
)
from analysis.weighing.uneven_ground import BY_GROUND
from analysis.weighing.weighing_limits import LIMITS
from analysis.weighing.wheel_kinematics import WheelKinematics
from estimators.joint import prior_fit
from estimators.joint.group_effects import GroupEffects, group_effects
from estimators.joint.prior_fit import Grouping


@dataclass(frozen=True, slots=True)
class _SlipCost:
    """Cost of a share of slip, by an earlier round.

    Attributes:
        mass_kg: that is accelerated, mean of the loads.
        friction_N_s_m: what the resistance grows by with the speed.
        slip_1_N: share of its speed that a newton makes the wheels slip, and its standard
            deviation, where the wheels' own acceleration tells it; else None.
    """

    mass_kg: float
    friction_N_s_m: float
    slip_1_N: tuple[float, float] | None


@dataclass(frozen=True)
class FitTask:
    """Samples to fit, and prior knowledge of them."""

    motion: MotionSamples
    noise: ColumnNoiseModel
    priors: PriorSettings
    terms: tuple[Nuisance, ...]
    wheels: WheelKinematics | None
    states: LoadStates | None
    uneven_1_s: float = 0.0

    def cut_to_first_stretches(self, stretches: int) -> "FitTask":
        """Cut the task to its first stretches."""
        motion = self.motion.cut_to_first_stretches(stretches)
        states = None if self.states is None else self.states.among(motion)
        return replace(self, motion=motion, states=states)

    @cached_property
    def initial_estimates(self) -> PreviousEstimates:
        """Estimates before the first round."""
        return PreviousEstimates(
            slip_1_N=(self._do_wheels_slip() or (0.0, 0.0))[0],
            motion_gain=self._squat_gain(),
            swing=self._swing(),
            speed_late_s=self._speed_late_s(),
            relative_loads=(loads := self._relative_loads()),
            route=self._find_route(loads),
            uneven_1_s=self.uneven_1_s,
        )

    def fit_means(
        self,
        samples: int,
        rounds: int,
        *,
        shift: bool = True,
        begin: JointFit | None = None,
        rows: FitRows | None = None,
    ) -> JointFit:
        """Fit with means of `samples`: lag and slip depend on what the fit finds, so again.

        A force that is late is moved back; one that is low-passed is not, since its derivative
        alone makes up for that (f + τ df/dt).

        Args:
            samples: longest mean.
            rounds: at most.
            shift: whether the force is moved back.
            begin: what is fitted begins from there; None: from what is known before.
            rows: of the first round, where they are at hand.
        """
        lag = term_index("lag", self.terms)
        std = np.zeros(len(self.terms))
        levels = None if self.states is None else self.states.levels(self.motion)
        known = begin.found if begin else self.initial_estimates
        known = known if shift else replace(known, lag_s=0.0)
        solution, mean, known_s = None, std, 0.0
        cost = begin and self._slip_cost(begin.theta, begin.solution, begin.terms)
        for number in range(rounds):
            mean, std = self._round_priors(cost)
            self._narrow_gain_drift(std)
            known_s = known.lag_s
            mean[lag] -= known_s
            if number or rows is None:
                rows = average_columns(self.motion, self.noise, self.terms, samples, known)
            solution = prior_fit.solve(
                rows.A,
                rows.f,
                rows.group,
                rows.noise,
                np.concatenate([np.zeros(2), mean]),
                np.concatenate([np.full(2, np.inf), std]),
                Grouping(rows.direction, rows.shortest, levels),
            )
            if not np.isfinite(solution.theta).all():
                break
            cost = self._slip_cost(solution.theta, solution, self.terms)
            if cost.slip_1_N is not None and self._do_wheels_slip() is None:
                known = replace(known, slip_1_N=cost.slip_1_N[0])
            known, moved = self._update_estimates(known, solution.theta, shift=shift)
            if number and moved < LIMITS.lag_tolerance_s:
                break
        assert solution is not None
        theta = solution.theta.copy()
        # behind the masses and friction
        first = theta.size - len(self.terms)
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
        splits = (split_const_by_weight, split_coulomb_by_weight)
        shares = [split(self.motion, self.priors).expected for split in splits]
        return RelativeLoads.from_masses(
            states.unit, masses_kg[states.membership], (shares[0], shares[1])
        )

    def _find_route(self, loads: RelativeLoads | None) -> Route | None:
        """Between where these loads are loaded and dumped."""
        if loads is None:
            return None
        return Route.of(self.motion, loads.unit, loads.is_loaded_in(loads.unit))

    def _update_estimates(
        self, before: PreviousEstimates, theta: Floats, *, shift: bool
    ) -> tuple[PreviousEstimates, float]:
        """Update the estimates by a round, and return how far the lag moved."""
        masses = theta.size - 1 - len(self.terms)
        names = (term.name for term in self.terms)
        by_name = dict(zip(names, theta[masses + 1 :].tolist(), strict=True))
        late_s = by_name["lag"]
        lag_s = float(np.clip(before.lag_s + late_s, -LIMITS.longest_lag_s, LIMITS.longest_lag_s))
        share, _ = split_measured_offset(self.motion, self.priors)
        width = const_prior_std(self.motion, self.priors)
        after = replace(
            before,
            lag_s=lag_s if shift else 0.0,
            transfer_s2_m=by_name.get("load_transfer", 0.0),
            offset_N=float(
                np.clip(
                    share * by_name["const"],
                    -LIMITS.max_offset_prior_std * width,
                    LIMITS.max_offset_prior_std * width,
                )
            ),
            slip_s_m=by_name["slip"],
            relative_loads=(loads := self._relative_loads(theta[:masses])),
            route=self._find_route(loads),
        )
        return after, abs(late_s)

    def group_effects_of_fit(self, fit: JointFit, rows: FitRows) -> GroupEffects:
        """What each manoeuvre says of its mass, by what a fit found and the rows of that."""
        mean, std = self._round_priors(self._slip_cost(fit.theta, fit.solution, fit.terms))
        if 1 < self.motion.separate_drive_count < LIMITS.drift_min_drives:
            std[term_index("gain_drift", self.terms)] *= NARROW
        # loads that alternate and ground that does are told apart by the fit of both, not here
        ground = [place for place, term in enumerate(self.terms) if term.source == BY_GROUND]
        mean[ground] = fit.theta[fit.count + 1 :][ground]
        std[ground] *= NARROW
        lag = term_index("lag", self.terms)
        mean[lag] -= fit.found.lag_s
        return group_effects(
            rows.A,
            rows.f,
            rows.group,
            rows.noise,
            np.append(0.0, mean),
            np.append(np.inf, std),
            np.unique(unit_of_each_stretch(self.motion), return_inverse=True)[1],
        )

    def _speed_late_s(self) -> float:
        """How late the speed is, where wheels and accelerometer tell it."""
        wheels = self.wheels
        told = wheels is not None and wheels.is_consistent and self.motion.by_accelerometer
        return wheels.delay_s[0] if wheels is not None and told else 0.0

    def _squat_gain(self) -> float:
        """Addition to the acceleration's own part: its squat, if the pitch shows it."""
        told = self.wheels is not None and self.motion.by_accelerometer
        return -self.wheels.squat[0] if self.wheels is not None and told else 0.0

    def _swing(self) -> BodySwing:
        """What a swinging body adds to the accelerometer, where the wheels show it."""
        told = self.wheels is not None and self.motion.by_accelerometer
        return self.wheels.swing if self.wheels is not None and told else NO_SWING

    def _round_priors(self, cost: _SlipCost | None) -> tuple[Floats, Floats]:
        """Prior means and widths; those of slip once its cost is known."""
        std = np.array([term.width(self.motion, self.priors) for term in self.terms])
        mean = np.zeros(len(self.terms))
        if cost is not None:
            self._narrow_slip(cost, mean, std)
            if self.motion.wheel_acceleration is not None:
                at = term_index("slip_acceleration", self.terms)
                self._accept_slip_term(at, cost.mass_kg, self._do_wheels_slip(), mean, std)
        for place, term in self._indices_of_learnt_terms():
            mean[place], std[place] = term.mean, term.std
        return mean, std

    def _slip_cost(
        self, theta: Floats, found: LazyEstimates, terms: tuple[Nuisance, ...]
    ) -> _SlipCost:
        """Compute the cost of slip from the estimates of a round."""
        count = theta.size - 1 - len(terms)
        mass_kg = float(np.mean(theta[:count]))
        friction = max(resistance_slope(theta, terms, self.motion), 0.0)
        if self.motion.wheel_acceleration is None or not mass_kg > 0.0:
            return _SlipCost(mass_kg, friction, None)
        place = term_index("slip_acceleration", terms)
        std = float(found.fit.std[count + 1 + place])
        if not std < LIMITS.slip_posterior_fraction * terms[place].width(self.motion, self.priors):
            return _SlipCost(mass_kg, friction, None)
        return _SlipCost(
            mass_kg, friction, (float(theta[count + 1 + place]) / mass_kg, std / mass_kg)
        )

    def _narrow_gain_drift(self, std: Floats) -> None:
        """Leave out a drift of the gain where loads come back.

        Payloads are differences of neighbours then, in which it cancels; free masses on the way
        would follow any drift.
        """
        if self.states is not None and self.states.load_returns:
            std[term_index("gain_drift", self.terms)] *= NARROW

    def _indices_of_learnt_terms(self) -> list[tuple[int, LearntTerm]]:
        """Where the terms are of which a calibration says something; slip the wheels say better."""
        learnt: dict[str, LearntTerm] = {**self.priors.learnt}
        by_wheels = self.wheels is not None and self.wheels.is_consistent
        return [
            (place, learnt[term.name])
            for place, term in enumerate(self.terms)
            if term.name in learnt and not (by_wheels and term.name == "slip")
        ]

    def _prior_means(self, mean: Floats, moved_s: float) -> PriorMeans:
        """Means of the priors in a round whose force was moved by a delay."""
        mean, mean_u = mean.copy(), np.zeros(len(self.terms))
        mean[term_index("lag", self.terms)] += moved_s
        for place, term in self._indices_of_learnt_terms():
            mean_u[place] = term.mean_u
        return PriorMeans(mean, mean_u)

    def _narrow_slip(self, cost: _SlipCost, mean: Floats, std: Floats) -> None:
        """Slip costs friction · slip, and the wheels may tell it."""
        at = term_index("slip", self.terms)
        friction = cost.friction_N_s_m
        std[at] = min(std[at], friction * self.priors.wheel_slip / self.motion.largest_force)
        std[at] = max(
            std[at],
            LIMITS.min_slip_std_fraction * self.priors.wheel_slip / self.motion.largest_speed,
        )
        self._accept_slip_term(at, -friction, self._do_wheels_slip() or cost.slip_1_N, mean, std)

    def _do_wheels_slip(self) -> tuple[float, float] | None:
        """The slip and its standard deviation in 1/N, where wheels and accelerometer tell it."""
        wheels = self.wheels
        return wheels.slip_1_N if wheels is not None and wheels.is_consistent else None

    def _accept_slip_term(
        self, at: int, cost: float, slip: tuple[float, float] | None, mean: Floats, std: Floats
    ) -> None:
        """Set the prior of a term that is so many times the slip, where that is told."""
        if slip is not None:
            slip_1_N, u_1_N = slip
            mean[at] = cost * slip_1_N
            std[at] = np.hypot(cost * u_1_N, LIMITS.min_slip_std_fraction * std[at])
