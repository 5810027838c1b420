"""One fit of samples, priors and load states, iterated until lag and slip converge."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.model.prior_settings import LearntTerm, PriorSettings
from analysis.weighing.body_swing import NO_SWING, BodySwing
from analysis.weighing.fit_columns import (
    FitRows,
    PreviousEstimates,
    RelativeLoads,
    average_and_weight_fit_columns,
)
from analysis.weighing.haul_route import HaulRoute
from analysis.weighing.joint_result import (
    JointFit,
    PriorMeans,
    compute_resistance_slope_at_mean_speed,
    find_term_index,
)
from analysis.weighing.load_changes import find_manoeuvre_of_stretches
from analysis.weighing.load_states import LoadStates
from analysis.weighing.motion_samples import ColumnNoiseModel, Floats, MotionSamples
from analysis.weighing.nuisances import (
    Nuisance,
    compute_constant_force_prior_std_of_motion_newtons,
    estimate_error_fraction_and_std_of_constant,
    estimate_load_proportional_share_of_constant,
    estimate_load_proportional_share_of_coulomb,
)
from analysis.weighing.slip_by_load import SLIP_BY_LOAD
from analysis.weighing.uneven_ground import BY_GROUND
from analysis.weighing.weighing_limits import LIMITS
from analysis.weighing.wheel_kinematics import WheelKinematics
from estimators.joint import prior_fit
from estimators.joint.prior_fit import Grouping, Solution
from estimators.joint.unit_levels import UnitLevels, estimate_unit_levels


@dataclass(frozen=True, slots=True)
class _MassFrictionAndSlip:
    """Mass, friction and wheel slip of an earlier iteration, which give the cost of slip.

    Attributes:
        mass_kg: accelerated mass, mean of the loads.
        friction_N_s_m: slope of the resistance over the speed.
        slip_1_N: slip per newton as a fraction of the speed, and its standard deviation; None if
            the wheels' own acceleration does not determine it.
    """

    mass_kg: float
    friction_N_s_m: float
    slip_1_N: tuple[float, float] | None


@dataclass(frozen=True)
class FitTask:
    """Samples to fit, with prior knowledge about them."""

    motion: MotionSamples
    noise: ColumnNoiseModel
    priors: PriorSettings
    terms: tuple[Nuisance, ...]
    kinematics: WheelKinematics | None
    states: LoadStates | None
    ground_variance_ratio_1_s: float = 0.0

    def cut_to_first_stretches(self, stretch_count: int) -> "FitTask":
        """Cut the task to its first stretches."""
        motion = self.motion.cut_to_first_stretches(stretch_count)
        states = (
            None if self.states is None else self.states.reassign_to_manoeuvres_of_motion(motion)
        )
        return replace(self, motion=motion, states=states)

    @cached_property
    def initial_estimates(self) -> PreviousEstimates:
        """Estimates before the first iteration."""
        return PreviousEstimates(
            slip_1_N=(self._estimate_slip_and_std_by_wheels() or (0.0, 0.0))[0],
            motion_gain=self._estimate_squat_gain_correction(),
            swing=self._get_body_swing_in_accelerometer(),
            speed_delay_s=self._estimate_speed_delay_s(),
            relative_loads=(loads := self._compute_relative_loads()),
            route=self._find_route(loads),
            ground_variance_ratio_1_s=self.ground_variance_ratio_1_s,
        )

    def fit_over_sample_means(
        self,
        samples_per_mean: int,
        iterations: int,
        *,
        is_force_advanced: bool = True,
        initial_fit: JointFit | None = None,
        fit_rows: FitRows | None = None,
    ) -> JointFit:
        """Fit means of `samples_per_mean`, iterating since the columns depend on lag and slip.

        A late force is advanced by its delay. A low-passed force is not, since its derivative alone
        corrects it (f + τ df/dt).

        Args:
            samples_per_mean: samples in the longest mean.
            iterations: maximum number of iterations.
            is_force_advanced: whether the force is advanced by its delay.
            initial_fit: fit to start from; None starts from `initial_estimates`.
            fit_rows: rows of the first iteration, if already computed.
        """
        lag = find_term_index("lag", self.terms)
        std = np.zeros(len(self.terms))
        levels = (
            None
            if self.states is None
            else self.states.assign_random_intercepts_to_stretches(self.motion)
        )
        known = initial_fit.previous_estimates if initial_fit else self.initial_estimates
        known = known if is_force_advanced else replace(known, force_delay_s=0.0)
        solution, mean, known_s = None, std, 0.0
        cost = initial_fit and self._compute_mass_friction_and_slip(
            initial_fit.theta, initial_fit.solution, initial_fit.terms
        )
        for number in range(iterations):
            mean, std = self._make_prior_means_and_stds_of_iteration(cost)
            self._exclude_gain_drift_in_place_if_loads_recur(std)
            known_s = known.force_delay_s
            mean[lag] -= known_s
            if number or fit_rows is None:
                # for a shift, each of them holds hundreds of megabytes
                fit_rows = solution = None
                fit_rows = average_and_weight_fit_columns(
                    self.motion, self.noise, self.terms, samples_per_mean, known
                )
            solution = prior_fit.solve_with_priors(
                fit_rows.A,
                fit_rows.f,
                fit_rows.group,
                fit_rows.noise,
                np.concatenate([np.zeros(2), mean]),
                np.concatenate([np.full(2, np.inf), std]),
                Grouping(fit_rows.direction, fit_rows.shortest, levels),
            )
            if not np.isfinite(solution.theta).all():
                break
            cost = self._compute_mass_friction_and_slip(solution.theta, solution, self.terms)
            if cost.slip_1_N is not None and self._estimate_slip_and_std_by_wheels() is None:
                known = replace(known, slip_1_N=cost.slip_1_N[0])
            known, moved = self._update_estimates_and_get_lag_change_s(
                known, solution.theta, is_force_advanced=is_force_advanced
            )
            if number and moved < LIMITS.lag_tolerance_s:
                break
        assert solution is not None
        theta = solution.theta.copy()
        # the terms follow masses and friction
        first = theta.size - len(self.terms)
        if is_force_advanced:
            theta[first + lag] = known.force_delay_s
        return JointFit(
            self.terms,
            std,
            theta,
            solution,
            self.states,
            self.kinematics,
            samples_per_mean,
            self.motion,
            np.zeros(first - 1),
            known,
            is_force_advanced,
            self._make_prior_means(mean, known_s),
        )

    def _compute_relative_loads(self, masses_kg: Floats | None = None) -> RelativeLoads | None:
        """Relate the states' masses to their mean over the manoeuvres; None with one state.

        Args:
            masses_kg: (states,) masses; None uses the manoeuvres' own estimates.
        """
        states = self.states
        if states is None or states.state_count < 2:
            return None
        masses_kg = states.means_kg if masses_kg is None else masses_kg
        splits = (
            estimate_load_proportional_share_of_constant,
            estimate_load_proportional_share_of_coulomb,
        )
        shares = [split(self.motion, self.priors).expected for split in splits]
        return RelativeLoads.from_masses(
            states.manoeuvre_ids, masses_kg[states.state_of_manoeuvre], (shares[0], shares[1])
        )

    def _find_route(self, loads: RelativeLoads | None) -> HaulRoute | None:
        """Find the route between the places of loading and dumping, by the relative loads."""
        if loads is None:
            return None
        return HaulRoute.from_motion(
            self.motion,
            loads.manoeuvre_ids,
            loads.mark_loaded_manoeuvres_by_number(loads.manoeuvre_ids),
        )

    def _update_estimates_and_get_lag_change_s(
        self, previous_estimates: PreviousEstimates, theta: Floats, *, is_force_advanced: bool
    ) -> tuple[PreviousEstimates, float]:
        """Update the estimates after an iteration; also return the lag's absolute change in s."""
        masses = theta.size - 1 - len(self.terms)
        names = (term.name for term in self.terms)
        by_name = dict(zip(names, theta[masses + 1 :].tolist(), strict=True))
        late_s = by_name["lag"]
        limit_s, force_delay_s = LIMITS.longest_lag_s, previous_estimates.force_delay_s + late_s
        force_delay_s = float(np.clip(force_delay_s, -limit_s, limit_s))
        share, _ = estimate_error_fraction_and_std_of_constant(self.motion, self.priors)
        width = compute_constant_force_prior_std_of_motion_newtons(self.motion, self.priors)
        after = replace(
            previous_estimates,
            force_delay_s=force_delay_s if is_force_advanced else 0.0,
            load_transfer_s2_m=by_name.get("load_transfer", 0.0),
            offset_N=float(
                np.clip(
                    share * by_name["const"],
                    -LIMITS.max_offset_prior_std * width,
                    LIMITS.max_offset_prior_std * width,
                )
            ),
            slip_s_m=by_name["slip"],
        )
        if self.states is not None and self.states.state_count > 1:
            loads = self._compute_relative_loads(theta[:masses])
            after = replace(after, relative_loads=loads, route=self._find_route(loads))
        return after, abs(late_s)

    def estimate_manoeuvre_masses(self, fit: JointFit, fit_rows: FitRows) -> UnitLevels:
        """Mass of each manoeuvre by itself, given the shared parameters of a fit."""
        mean, std = self._make_prior_means_and_stds_of_iteration(
            self._compute_mass_friction_and_slip(fit.theta, fit.solution, fit.terms)
        )
        if 1 < self.motion.separate_drive_count < LIMITS.drift_min_drives:
            std[find_term_index("gain_drift", self.terms)] *= LIMITS.left_out_prior_ratio
        # alternating loads and alternating ground are distinguished by the fit of both, not here
        ground = [place for place, term in enumerate(self.terms) if term.source == BY_GROUND]
        mean[ground] = fit.theta[fit.mass_count + 1 :][ground]
        std[ground] *= LIMITS.left_out_prior_ratio
        lag = find_term_index("lag", self.terms)
        mean[lag] -= fit.previous_estimates.force_delay_s
        return estimate_unit_levels(
            fit_rows.A,
            fit_rows.f,
            fit_rows.group,
            fit_rows.noise,
            np.append(0.0, mean),
            np.append(np.inf, std),
            np.unique(find_manoeuvre_of_stretches(self.motion), return_inverse=True)[1],
        )

    def _estimate_speed_delay_s(self) -> float:
        """Delay of the speed in s, if wheels and accelerometer determine it."""
        wheels = self.kinematics
        is_delay_known = (
            wheels is not None and wheels.is_consistent and self.motion.by_accelerometer
        )
        return wheels.delay_s[0] if wheels is not None and is_delay_known else 0.0

    def _estimate_squat_gain_correction(self) -> float:
        """Relative correction of the acceleration for a squat that the pitch measures."""
        is_squat_known = self.kinematics is not None and self.motion.by_accelerometer
        return -self.kinematics.squat[0] if self.kinematics is not None and is_squat_known else 0.0

    def _get_body_swing_in_accelerometer(self) -> BodySwing:
        """Effect of a swinging body on the accelerometer, if the wheels show it."""
        is_swing_known = self.kinematics is not None and self.motion.by_accelerometer
        return self.kinematics.swing if self.kinematics is not None and is_swing_known else NO_SWING

    def _make_prior_means_and_stds_of_iteration(
        self, previous_mass_friction_slip: _MassFrictionAndSlip | None
    ) -> tuple[Floats, Floats]:
        """Prior means and standard deviations, (terms,); of slip only if its cost is known."""
        std = np.array([term.compute_prior_std(self.motion, self.priors) for term in self.terms])
        mean = np.zeros(len(self.terms))
        if previous_mass_friction_slip is not None:
            self._set_slip_prior_by_wheels_in_place(previous_mass_friction_slip, mean, std)
            if self.motion.wheel_acceleration is not None:
                at = find_term_index("slip_acceleration", self.terms)
                self._set_prior_proportional_to_slip_in_place(
                    at,
                    previous_mass_friction_slip.mass_kg,
                    self._estimate_slip_and_std_by_wheels(),
                    mean,
                    std,
                )
                self._set_prior_of_slip_by_load_in_place(previous_mass_friction_slip, mean, std)
        for place, term in self._list_indexed_learnt_terms():
            mean[place], std[place] = term.mean, term.std
        return mean, std

    def _compute_mass_friction_and_slip(
        self, theta: Floats, estimates: Solution, terms: tuple[Nuisance, ...]
    ) -> _MassFrictionAndSlip:
        """Mass, friction and slip by the estimates of an iteration."""
        count = theta.size - 1 - len(terms)
        mass_kg = float(np.mean(theta[:count]))
        friction = max(compute_resistance_slope_at_mean_speed(theta, terms, self.motion), 0.0)
        if self.motion.wheel_acceleration is None or not mass_kg > 0.0:
            return _MassFrictionAndSlip(mass_kg, friction, None)
        place = find_term_index("slip_acceleration", terms)
        std = float(estimates.fit.parameter_stds[count + 1 + place])
        prior_std = terms[place].compute_prior_std(self.motion, self.priors)
        if not std < LIMITS.slip_posterior_fraction * prior_std:
            return _MassFrictionAndSlip(mass_kg, friction, None)
        return _MassFrictionAndSlip(
            mass_kg, friction, (float(theta[count + 1 + place]) / mass_kg, std / mass_kg)
        )

    def _exclude_gain_drift_in_place_if_loads_recur(self, prior_std: Floats) -> None:
        """Set the prior of a gain drift to 0 if loads return.

        A drift then cancels in payloads, as differences of successive masses; the masses follow it.
        """
        if self.states is not None and self.states.load_returns:
            prior_std[find_term_index("gain_drift", self.terms)] *= LIMITS.left_out_prior_ratio

    def _list_indexed_learnt_terms(self) -> list[tuple[int, LearntTerm]]:
        """Terms with learnt priors and their indices, except slip if the wheels determine it."""
        learnt: dict[str, LearntTerm] = {**self.priors.learnt}
        by_wheels = self.kinematics is not None and self.kinematics.is_consistent
        return [
            (place, learnt[term.name])
            for place, term in enumerate(self.terms)
            if term.name in learnt and not (by_wheels and term.name == "slip")
        ]

    def _make_prior_means(self, prior_mean: Floats, advanced_s: float) -> PriorMeans:
        """Prior means of an iteration whose force was advanced by a delay in s."""
        prior_mean, mean_u = prior_mean.copy(), np.zeros(len(self.terms))
        prior_mean[find_term_index("lag", self.terms)] += advanced_s
        for place, term in self._list_indexed_learnt_terms():
            mean_u[place] = term.mean_u
        return PriorMeans(prior_mean, mean_u)

    def _set_slip_prior_by_wheels_in_place(
        self, mass_friction_slip: _MassFrictionAndSlip, prior_mean: Floats, prior_std: Floats
    ) -> None:
        """Set the prior of the slip terms to friction times slip, if the wheels determine slip."""
        at = find_term_index("slip", self.terms)
        friction = mass_friction_slip.friction_N_s_m
        prior_std[at] = min(
            prior_std[at],
            friction * self.priors.wheel_slip / self.motion.force_95_percentile_newtons,
        )
        prior_std[at] = max(
            prior_std[at],
            LIMITS.min_slip_std_fraction
            * self.priors.wheel_slip
            / self.motion.speed_95_percentile_m_s,
        )
        self._set_prior_proportional_to_slip_in_place(
            at,
            -friction,
            self._estimate_slip_and_std_by_wheels() or mass_friction_slip.slip_1_N,
            prior_mean,
            prior_std,
        )

    def _set_prior_of_slip_by_load_in_place(
        self, mass_friction_slip: _MassFrictionAndSlip, prior_mean: Floats, prior_std: Floats
    ) -> None:
        """Set the prior of the reduction of slip by load to a share of the slip, if it is known."""
        slip = self._estimate_slip_and_std_by_wheels() or mass_friction_slip.slip_1_N
        if slip is None or SLIP_BY_LOAD not in self.terms:
            return
        at = self.terms.index(SLIP_BY_LOAD)
        share_kg = LIMITS.slip_stiffness_by_load_1 * mass_friction_slip.mass_kg
        # a negative slip is not reduced by the load
        prior_mean[at] = share_kg * max(slip[0], 0.0)
        prior_std[at] = max(
            share_kg * float(np.hypot(*slip)), LIMITS.min_slip_std_fraction * prior_std[at]
        )

    def _estimate_slip_and_std_by_wheels(self) -> tuple[float, float] | None:
        """Slip and its standard deviation in 1/N; None if wheels do not determine it."""
        wheels = self.kinematics
        return wheels.slip_1_N if wheels is not None and wheels.is_consistent else None

    def _set_prior_proportional_to_slip_in_place(
        self,
        term_index: int,
        force_per_slip: float,
        slip: tuple[float, float] | None,
        prior_mean: Floats,
        prior_std: Floats,
    ) -> None:
        """Set the prior of a term that is `force_per_slip` times the slip, if slip is known."""
        if slip is not None:
            slip_1_N, u_1_N = slip
            prior_mean[term_index] = force_per_slip * slip_1_N
            prior_std[term_index] = np.hypot(
                force_per_slip * u_1_N, LIMITS.min_slip_std_fraction * prior_std[term_index]
            )
