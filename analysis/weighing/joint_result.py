"""Result of the joint fit: masses, nuisances, and the sources of their uncertainty."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.model.uncertainty_sources import compute_root_sum_of_squares
from analysis.weighing.body_squat import LoadSquat
from analysis.weighing.fit_columns import PreviousEstimates
from analysis.weighing.force_by_position import BY_PLACE, make_position_force_columns
from analysis.weighing.force_hysteresis import HYSTERESIS
from analysis.weighing.load_states import LoadStates
from analysis.weighing.log_effects import MostProbableEffects
from analysis.weighing.motion_samples import Floats, MotionSamples
from analysis.weighing.nuisances import Nuisance
from analysis.weighing.weighing_limits import LIMITS
from analysis.weighing.wheel_kinematics import TERMS, WheelKinematics
from estimators.joint.posterior_fit import PosteriorFit
from estimators.joint.prior_fit import Solution
from estimators.numerics.small_systems import factor_covariance


@dataclass(frozen=True)
class PriorMeans:
    """Means of the priors, with their uncertainty.

    Attributes:
        mean: (terms,) prior means; that of the lag is for the whole lag.
        mean_u: (terms,) standard uncertainties of learnt means, whose errors are common to all logs
            of a calibration; else 0.
    """

    mean: Floats
    mean_u: Floats


@dataclass(frozen=True)
class MotionResponses:
    """Responses of the masses to errors of the motion, (masses,) each.

    On level ground all masses change by the same fraction, and so does their difference. If a slope
    is driven up empty and down loaded, the part of the specific force that is gravity has no such
    error, and the full error is in the difference.

    Attributes:
        delay_kg_s: response to a delay of the speed, per second.
        gain_kg: response to a relative error of 1 of the acceleration, excluding gravity.
        swing_kg: response to one standard uncertainty of the body's swing.
    """

    delay_kg_s: Floats
    gain_kg: Floats
    swing_kg: Floats


@dataclass(frozen=True)
class JointFit:
    """A joint fit with its terms, priors, load states and motion.

    Attributes:
        terms: nuisances, in the order of the parameters after masses and friction.
        prior_std: (terms,) prior standard deviations.
        theta: estimates of masses, friction and terms; that of the lag is for the whole lag.
        solution: solution of the last round, from which the uncertainty is computed.
        states: load state of each manoeuvre; None before the search.
        kinematics: comparison of wheels and accelerometer, if there is one.
        samples_per_mean: length of the means.
        motion: fitted samples.
        lag_shape_kg: (masses,) change of the masses if a lag were a low-pass instead of a delay, or
            vice versa; 0 if the shape is known.
        previous_estimates: estimates that the columns were last made with.
        is_force_advanced_by_lag: whether the force was advanced by the lag.
        averaging_share: relative effect of a longer mean on the mass.
        prior_means: prior means with their uncertainty.
        motion_responses: responses to errors of the motion; None if level ground is assumed.
        effects: most probable effects, and changes by other choices; None if there are none.
        squat: gain of the accelerometer by load; None if unknown or not needed.
        hysteresis_kg: (masses,) change of the masses by hysteresis; None if the log shows none.
    """

    terms: tuple[Nuisance, ...]
    prior_std: Floats
    theta: Floats
    solution: Solution
    states: LoadStates | None
    kinematics: WheelKinematics | None
    samples_per_mean: int
    motion: MotionSamples
    lag_shape_kg: Floats
    previous_estimates: PreviousEstimates
    is_force_advanced_by_lag: bool
    prior_means: PriorMeans
    averaging_share: float = 0.0
    motion_responses: MotionResponses | None = None
    effects: MostProbableEffects | None = None
    squat: LoadSquat | None = None
    hysteresis_kg: Floats | None = None

    @cached_property
    def posterior_fit(self) -> PosteriorFit:
        """Estimates with the parts of their uncertainty."""
        return replace(self.solution.fit, theta=self.theta)

    @property
    def mass_count(self) -> int:
        """Number of masses."""
        return self.theta.size - 1 - len(self.terms)

    @property
    def viscous_friction(self) -> float:
        """Viscous friction in N·s/m."""
        return float(self.theta[self.mass_count])

    @property
    def resistance_speed_slope(self) -> float:
        """Slope of resistance over speed, in N·s/m; never negative."""
        return max(compute_resistance_slope_at_mean_speed(self.theta, self.terms, self.motion), 0.0)

    @property
    def force_by_position(self) -> Floats | None:
        """Position-dependent force, (n,) in N; None if there is likely none."""
        own = [k for k, term in enumerate(self.terms) if term.source == BY_PLACE]
        if not own or (self.effects is not None and BY_PLACE in self.effects.left_out):
            return None
        found_N = self.theta[self.mass_count + 1 + np.array(own)]
        columns = make_position_force_columns(self.motion.path_position_1)
        force = columns @ found_N[: columns.shape[1]]
        loads, by_load_N = self.previous_estimates.relative_loads, found_N[columns.shape[1] :]
        if loads is None or not by_load_N.size:
            return force
        relative_1 = loads.look_up_relative_loads(self.motion.manoeuvre_of_sample)
        return force + relative_1 * (columns @ by_load_N)

    @property
    def friction_and_term_estimates(self) -> Floats:
        """(1 + terms,) friction and terms, for columns with the force advanced by its lag."""
        shared = self.theta[self.mass_count :].copy()
        if self.is_force_advanced_by_lag:
            shared[1 + find_term_index("lag", self.terms)] = 0.0
        return shared

    @property
    def viscous_friction_and_std(self) -> tuple[float, float]:
        """Viscous friction and its standard deviation, in N·s/m."""
        return self.viscous_friction, float(self.posterior_fit.parameter_stds[self.mass_count])

    @cached_property
    def term_posteriors(self) -> tuple[Floats, Floats]:
        """Posterior means of the terms, (terms,), and their standard deviations, (terms,)."""
        own = self.posterior_fit.parameter_stds[self.mass_count + 1 :]
        by_means = self._estimate_changes_per_learnt_mean_u[:, self.mass_count + 1 :]
        return self._estimates_of_terms, np.sqrt(own**2 + (by_means**2).sum(axis=0))

    @cached_property
    def _estimate_changes_per_learnt_mean_u(self) -> Floats:
        """(terms, p) response of the estimates to one standard uncertainty of each learnt mean."""
        responses = self.posterior_fit.responses[self.mass_count + 1 :]
        return responses * (self.prior_means.mean_u / self.prior_std)[:, None]

    @cached_property
    def learnt_terms_and_mass_changes_per_mean_u(self) -> tuple[tuple[str, ...], Floats]:
        """Responses of the masses to one standard uncertainty of each learnt mean.

        Returns:
            Names of the terms with learnt means, and (terms, masses) responses in kg.
        """
        uncertain = np.flatnonzero(self.prior_means.mean_u > 0.0)
        names = [self.terms[k].name for k in uncertain]
        moved_kg = self._estimate_changes_per_learnt_mean_u[uncertain, : self.mass_count]
        wheels = self.kinematics
        if wheels is not None and wheels.mean_u.any():
            each = np.eye(self.theta.size)[: self.mass_count]
            changes = map(self._compute_mass_sum_changes_by_slip_gain_and_delay, each)
            by_wheels = np.array(list(changes)) * wheels.mean_u
            names += TERMS
            moved_kg = np.vstack([moved_kg, by_wheels.T])
        return tuple(names), moved_kg

    @property
    def force_delay_s(self) -> float:
        """Delay of the force in s."""
        return self.estimate_of_term("lag")

    def estimate_of_term(self, term_name: str) -> float:
        """Estimate of a nuisance term, in its unit; 0 if the fit lacks the term."""
        names = [term.name for term in self.terms]
        return (
            float(self._estimates_of_terms[names.index(term_name)]) if term_name in names else 0.0
        )

    @property
    def _estimates_of_terms(self) -> Floats:
        return self.theta[self.mass_count + 1 :]

    @property
    def abs_t_by_term(self) -> dict[str, float]:
        """Absolute estimate over its posterior standard deviation, by term."""
        value, std = self.term_posteriors
        found = np.abs(value) / std
        return dict(zip((term.name for term in self.terms), found.tolist(), strict=True))

    def find_term_farthest_from_prior(self, prior_std: Floats) -> tuple[str, float]:
        """The term farthest from its prior mean, and its distance in units of `prior_std` (terms,).

        The lag and the terms of single places on the ground are excluded.
        """
        apart = np.abs(self._estimates_of_terms - self.prior_means.mean) / prior_std
        counted = [term.name != "lag" and not term.source for term in self.terms]
        farthest = int(np.where(counted, apart, -1.0).argmax())
        return self.terms[farthest].name, float(apart[farthest])

    @property
    def most_frequent_state(self) -> int:
        """Index of the state with the most manoeuvres."""
        states = self.states
        return 0 if states is None else int(np.bincount(states.state_of_manoeuvre).argmax())

    def make_mass_coefficients_of_state(self, state: int) -> Floats:
        """(masses,) weights that select the mass of one state."""
        out = np.zeros(self.mass_count)
        out[state] = 1.0
        return out

    def compute_u_by_cause_kg(self, coefficients: Floats) -> dict[str, float]:
        """Parts of the standard uncertainty of the sum `coefficients` @ masses, by cause, in kg."""
        wide = np.concatenate([coefficients, np.zeros(self.theta.size - self.mass_count)])
        fit, responses = self.posterior_fit, self.motion_responses
        summed = np.flatnonzero(wide)

        def compute_weighted_std(covariance: Floats) -> float:
            if summed.size > LIMITS.covariance_masses:
                return float(np.sqrt(max(float(wide @ (covariance @ wide)), 0.0)))
            own = covariance[np.ix_(summed, summed)]
            return float(np.sqrt(max(float(wide[summed] @ own @ wide[summed]), 0.0)))

        mass_kg = float(coefficients @ self.masses_kg)
        parts = {
            "noise": compute_weighted_std(fit.noise),
            **{
                term.name: abs(float(fit.responses[self.mass_count + 1 + i] @ wide))
                for i, term in enumerate(self.terms)
            },
            "channel_noise": abs(float(fit.doubt @ wide)),
            "scatter": compute_weighted_std(fit.scatter),
            "other_reading": 0.0
            if self.states is None
            else self.states.compute_mass_sum_std_by_alternative_partition_kg(coefficients),
            "other_effects": 0.0
            if self.effects is None
            else self.effects.compute_mass_sum_u_by_effect_choice_kg(coefficients),
            "squat": math.hypot(
                self._compute_mass_sum_u_by_squat_in_pitch_kg(coefficients),
                self._compute_mass_sum_u_by_load_dependent_gain_kg(coefficients),
                0.0 if responses is None else float(coefficients @ responses.swing_kg),
            ),
            "misfit": compute_weighted_std(fit.misfit) if fit.has_common_misfit else 0.0,
            "lag_shape": abs(float(self.lag_shape_kg @ coefficients)) / 2.0,
            "averaging": abs(self.averaging_share * mass_kg),
        }
        if self.hysteresis_kg is not None:
            shape_kg = LIMITS.hysteresis_shape_u_1 * float(self.hysteresis_kg @ coefficients)
            parts[HYSTERESIS.name] = math.hypot(parts[HYSTERESIS.name], shape_kg)
        parts |= self._compute_mass_sum_u_by_slip_gain_and_delay_kg(wide, parts["slip"])
        learnt_kg = self.learnt_terms_and_mass_changes_per_mean_u[1] @ coefficients
        if learnt_kg.any():
            parts["learnt"] = float(np.linalg.norm(learnt_kg))
        wheels = self.kinematics
        if wheels is not None and wheels.is_gain_significant:
            # an error of the wheel radius is in the force, and again in the derivative of the speed
            times = 1.0 if self.motion.by_accelerometer else 2.0
            moved_kg = 0.0 if responses is None else float(coefficients @ responses.gain_kg)
            parts["gain"] = times * abs(wheels.gain[0]) * max(abs(mass_kg), abs(moved_kg))
        return parts

    def _compute_mass_sum_u_by_load_dependent_gain_kg(self, coefficients: Floats) -> float:
        """Uncertainty of a sum of masses due to a gain that changes with the load, in kg."""
        squat = self.squat
        return 0.0 if squat is None else squat.compute_mass_sum_u_kg(coefficients, self.masses_kg)

    def _compute_mass_sum_u_by_squat_in_pitch_kg(self, coefficients: Floats) -> float:
        """Uncertainty of a sum of masses due to the squat that the pitch measures, in kg."""
        if self.kinematics is None or not self.motion.by_accelerometer:
            return 0.0
        # springs deflect in proportion to the mass
        by_load = 1.0 if self.squat is None else 1.0 + self.squat.relative_load
        return self.kinematics.squat[1] * abs(float(coefficients @ (self.masses_kg * by_load)))

    @cached_property
    def mass_changes_by_one_std_of_each_term_kg(self) -> Floats:
        """(terms, masses) response to one standard deviation of each nuisance, in kg.

        Slip measured by the wheels narrows its prior.
        """
        found = self.posterior_fit.responses[self.mass_count + 1 :, : self.mass_count].copy()
        slip = find_term_index("slip", self.terms)
        coefficients = self.make_mass_coefficients_of_state(self.most_frequent_state)
        alone_kg = abs(float(found[slip] @ coefficients))
        if alone_kg > 0.0:
            known_kg = self.compute_u_by_cause_kg(coefficients)["slip"]
            found[slip] *= min(known_kg / alone_kg, 1.0)
        return found

    def _compute_mass_sum_u_by_slip_gain_and_delay_kg(
        self, coefficients: Floats, slip_kg: float
    ) -> dict[str, float]:
        """Uncertainty of a sum of masses due to slip, gain and delay, in kg.

        The three are correlated; each part is the one that remains if the parts before are known.
        """
        wheels, friction = self.kinematics, self.resistance_speed_slope
        if wheels is None or not wheels.is_consistent:
            return {}
        moves = self._compute_mass_sum_changes_by_slip_gain_and_delay(coefficients)
        width = self.prior_std[find_term_index("slip", self.terms)]
        found = moves @ factor_covariance(wheels.covariance)
        of_wheels = friction * float(np.sqrt(wheels.covariance[0, 0]))
        beside = slip_kg * float(np.sqrt(max(1.0 - (of_wheels / width) ** 2, 0.0)))
        parts = {"slip": float(np.hypot(found[0], beside))}
        if self.motion.by_accelerometer:
            parts |= {"gain": abs(float(found[1])), "speed_delay": abs(float(found[2]))}
        return parts

    def _compute_mass_sum_changes_by_slip_gain_and_delay(self, coefficients: Floats) -> Floats:
        """(3,) response of a sum of masses to one unit of slip, gain and delay of the wheels."""
        friction = self.resistance_speed_slope
        slip = self.mass_count + 1 + find_term_index("slip", self.terms)
        # change of the masses by one standard deviation of the prior
        response = float(self.posterior_fit.responses[slip] @ coefficients)
        width = self.prior_std[find_term_index("slip", self.terms)]
        of_masses = coefficients[: self.mass_count]
        late = -friction * float(coefficients.sum())
        if self.motion_responses is not None:
            late = float(of_masses @ self.motion_responses.delay_kg_s)
        return np.array(
            [
                -friction * response / width,
                -float(of_masses @ self.masses_kg) if self.is_gain_corrected else 0.0,
                late if self.motion.by_accelerometer else 0.0,
            ]
        )

    @cached_property
    def masses_kg(self) -> Floats:
        """(masses,) masses corrected for the speed's delay and the accelerometer's gains."""
        late, gain, wheels = 0.0, 0.0, self.kinematics
        if wheels is not None and wheels.is_consistent and self.motion.by_accelerometer:
            late = wheels.delay_s[0] - self.previous_estimates.speed_delay_s
        if wheels is not None and self.is_gain_corrected:
            gain = wheels.gain_by_prior[0]
        masses = self.theta[: self.mass_count]
        by_load = 1.0 if self.squat is None else self.squat.mass_overestimation_factors
        return (masses - self.resistance_speed_slope * late) / (1.0 + gain) / by_load

    @property
    def mass_kg(self) -> float:
        """Mass of the load state with the most manoeuvres, in kg."""
        return float(self.masses_kg[self.most_frequent_state])

    @property
    def is_gain_corrected(self) -> bool:
        """Whether the mass is corrected for the accelerometer's gain within its prior."""
        wheels = self.kinematics
        if wheels is None or not self.motion.by_accelerometer:
            return False
        return wheels.is_consistent and not wheels.is_gain_significant

    @property
    def u_kg(self) -> float:
        """Standard uncertainty of `mass_kg` from this log alone, without the scale, in kg."""
        state = self.most_frequent_state
        return self.compute_mass_sum_u_kg(self.make_mass_coefficients_of_state(state))

    def compute_mass_sum_u_kg(self, coefficients: Floats) -> float:
        """Standard uncertainty of a sum of masses, in kg."""
        return compute_root_sum_of_squares(self.compute_u_by_cause_kg(coefficients).values())


def compute_resistance_slope_at_mean_speed(
    theta: Floats, terms: tuple[Nuisance, ...], motion: MotionSamples
) -> float:
    """Slope of resistance over speed at the mean speed, in N·s/m.

    Args:
        theta: (p,) masses, viscous friction, terms.
        terms: nuisances of the fit.
        motion: samples, for the mean speed.
    """
    viscous, *found = theta[-1 - len(terms) :].tolist()
    quadratic = dict(zip((term.name for term in terms), found, strict=True)).get("quadratic", 0.0)
    # drag cannot drive the machine
    return (
        viscous if quadratic <= 0.0 else viscous + 2.0 * quadratic * motion.mean_absolute_speed_m_s
    )


def find_term_index(term_name: str, terms: tuple[Nuisance, ...]) -> int:
    """Index of the term with this name."""
    return [term.name for term in terms].index(term_name)
