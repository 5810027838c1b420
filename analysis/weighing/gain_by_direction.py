"""A gain of the force by direction: the same load has a different mass in reverse.

Gears, motor controllers and strain gauge bridges may give another reading of the same force in
reverse: f (1 - κ s) = m a + b v, where s is 1 forwards and -1 in reverse. Every drive in reverse
then has another mass, as if the machine were loaded there. Real loads are distinguished by evidence
at their changes (a boom movement, a filled bucket), by an empty machine of known mass, by different
loads in one direction, and by payloads that scatter more than the empty machine. A log without any
of these cannot distinguish the two.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import fdtrc

from analysis.model.machine_body import Body
from analysis.model.prior_settings import PriorSettings
from analysis.weighing.fit_task import FitTask
from analysis.weighing.fitted_stretches import mark_stretch_starts
from analysis.weighing.joint_fit import JointFitInputs, fit_jointly, select_terms_of_motion
from analysis.weighing.joint_result import JointFit
from analysis.weighing.load_changes import (
    classify_load_change_evidence,
    find_manoeuvre_of_fitted_samples,
)
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.load_search import fit_with_searched_load_states
from analysis.weighing.load_states import (
    LoadStates,
    compute_weighted_mean_mass_by_state_kg,
)
from analysis.weighing.motion_samples import Bools, ColumnNoiseModel, Floats, MotionSamples
from analysis.weighing.nuisances import Nuisance
from analysis.weighing.uneven_ground import does_load_search_include_ground
from estimators.joint.unit_levels import HINTED

#: Term with a prior so wide that it is almost free.
GAIN_BY_DIRECTION: Final = Nuisance(
    "gain_by_direction",
    "1",
    lambda m: m.force * m.direction,
    lambda _, __: 1e9,
    "a force sensor whose gain differs in reverse",
    "the gain of each direction, by a known load or a known pull",
    by_force=lambda m: m.direction,
)


@dataclass(frozen=True, slots=True)
class DirectionGain:
    """Gain of the force in reverse with which a single load explains the log.

    Attributes:
        gain_1: reading in reverse over the reading forwards, for the same force.
        std_1: its standard deviation.
        loads: number of loads of the answer.
    """

    gain_1: float
    std_1: float
    loads: int

    @property
    def significance_1(self) -> float:
        """Difference of the gain from 1, divided by the smallest one that counts as significant."""
        least_1 = max(LIMITS.direction_gain_min_std * self.std_1, LIMITS.direction_gain_min_1)
        return abs(self.gain_1 - 1.0) / least_1

    @property
    def is_significant(self) -> bool:
        """Whether the gain differs from 1, but by no more than a sensor's plausibly does.

        If the masses differ by direction, the gain itself need not be significant: friction and
        wheel slip leave it uncertain.
        """
        apart_1 = abs(self.gain_1 - 1.0)
        shows = self.significance_1 > 1.0 or (
            self.could_explain_several_loads and apart_1 > LIMITS.direction_gain_min_1
        )
        return shows and apart_1 < LIMITS.direction_gain_max_1

    @property
    def could_explain_several_loads(self) -> bool:
        """Whether the answer has several loads, which this gain could explain instead."""
        return self.loads > 1

    @property
    def relative_mass_u(self) -> float:
        """Relative standard uncertainty of a single load's mass: either direction may be right."""
        return abs(self.gain_1 - 1.0) / float(np.sqrt(3.0))


def estimate_force_gain_by_driving_direction(
    fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings, body: Body
) -> DirectionGain | None:
    """Estimate a gain by direction that explains the log with a single load.

    Args:
        fit: joint fit of the answer.
        noise: noise of acceleration, speed and force.
        priors: priors of the nuisances.
        body: body of the machine file, with the empty mass and that gain if they are known.

    Returns:
        The gain; None if there is none, or if the log distinguishes its loads from such a gain.
    """
    motion = fit.motion
    if body.force_gain_in_reverse is not None or not motion.drives_both_ways:
        return None
    turns = int(np.count_nonzero(np.diff(mark_forward_manoeuvres(motion))))
    if fit.states is None or turns < LIMITS.direction_gain_min_turns:
        return None
    several = fit.mass_count > 1
    if several and (
        not do_loads_only_follow_driving_direction(fit)
        or does_empty_mass_confirm_two_loads(fit, body)
    ):
        return None
    ratio_1_s = (
        fit.previous_estimates.ground_variance_ratio_1_s
        if does_load_search_include_ground(motion)
        else 0.0
    )
    one = FitTask(
        motion,
        noise,
        priors
        if fit.effects is None
        else fit.effects.copy_priors_excluding_unlikely_effects(priors),
        (
            *select_terms_of_motion(motion, has_several_loads=False, has_ground=False),
            GAIN_BY_DIRECTION,
        ),
        fit.kinematics,
        None,
        ratio_1_s,
    ).fit_over_sample_means(fit.samples_per_mean, 2, is_force_advanced=fit.is_force_advanced_by_lag)
    found = compute_reverse_to_forward_gain(one, fit)
    if not found.is_significant:
        return None
    if not several:
        return found
    corrected = replace(motion, force=motion.force * (1.0 - one.theta[-1] * motion.direction))
    inputs = replace(
        JointFitInputs.prepare_from_motion(corrected, noise, priors, fit),
        ground_variance_ratio_1_s=ratio_1_s,
    )
    left = fit_with_searched_load_states(fit_jointly(inputs), inputs, body.repeatability_kg)
    if left.mass_count > 1 or left.states is None:
        return None
    heavy = mark_manoeuvres_of_heavier_direction(fit.states, mark_forward_manoeuvres(motion))
    return None if do_heavy_masses_scatter_more_than_light(left.states, heavy) else found


def compute_reverse_to_forward_gain(
    fit_with_one_load: JointFit, fit_with_load_states: JointFit
) -> DirectionGain:
    """Gain in reverse over the gain forwards, from the last term of a fit with one load.

    If the answer has one load, the standard deviation is at least the one that follows from the
    scatter of the masses in each direction.
    """
    share, std = (
        float(fit_with_one_load.theta[-1]),
        float(fit_with_one_load.posterior_fit.parameter_stds[-1]),
    )
    if fit_with_load_states.mass_count == 1:
        std = max(
            std,
            compute_mass_difference_std_by_direction_kg(fit_with_load_states)
            / 2.0
            / abs(fit_with_load_states.mass_kg),
        )
    return DirectionGain((1.0 - share) / (1.0 + share), 2.0 * std, fit_with_load_states.mass_count)


def compute_mass_difference_std_by_direction_kg(fit: JointFit) -> float:
    """Standard deviation of the difference between the mean masses of both directions, in kg."""
    states = fit.states
    assert states is not None
    forwards = mark_forward_manoeuvres(fit.motion)
    variances = [
        max(_compute_reduced_chi_square(states.manoeuvre_mass_kg[each], states.std_kg[each]), 1.0)
        / float((states.std_kg[each] ** -2.0).sum())
        for each in (forwards, ~forwards)
    ]
    return float(np.sqrt(sum(variances)))


def do_loads_only_follow_driving_direction(fit: JointFit) -> bool:
    """Whether loads follow the driving direction, with no other evidence of their changes."""
    states, motion = fit.states, fit.motion
    assert states is not None
    if motion.empty is not None:
        return False
    forwards = mark_forward_manoeuvres(motion)
    agree = float(np.mean(mark_manoeuvres_of_heavier_direction(states, forwards) == forwards))
    if max(agree, 1.0 - agree) < LIMITS.loads_by_direction_fraction:
        return False
    changes = np.diff(states.state_of_manoeuvre) != 0
    hinted = classify_load_change_evidence(motion)[changes] >= HINTED
    return float(np.mean(hinted)) < LIMITS.hinted_loads_fraction


def mark_forward_manoeuvres(motion: MotionSamples) -> Bools:
    """Whether each manoeuvre goes forwards, (manoeuvres,)."""
    first = np.flatnonzero(motion.is_fittable)[
        mark_stretch_starts(find_manoeuvre_of_fitted_samples(motion))
    ]
    return motion.direction[first] > 0.0


def compute_mean_mass_in_reverse_and_forwards_kg(
    states: LoadStates, is_forward: Bools
) -> tuple[float, float]:
    """Mean mass of the manoeuvres in reverse and forwards, in kg."""
    each = is_forward.astype(np.int64)
    reverse_kg, forwards_kg = compute_weighted_mean_mass_by_state_kg(
        states.manoeuvre_mass_kg, states.std_kg**-2.0, each
    )
    return float(reverse_kg), float(forwards_kg)


def mark_manoeuvres_of_heavier_direction(states: LoadStates, is_forward: Bools) -> Bools:
    """Whether each mass is nearer to the mean of the heavier driving direction, (manoeuvres,)."""
    return states.manoeuvre_mass_kg > float(
        np.mean(compute_mean_mass_in_reverse_and_forwards_kg(states, is_forward))
    )


def does_empty_mass_confirm_two_loads(fit: JointFit, body: Body) -> bool:
    """Whether the lighter direction has the stated empty mass, and the heavier one does not."""
    empty_kg = body.empty_inertia_kg
    if empty_kg is None:
        return False
    assert fit.states is not None
    forwards = mark_forward_manoeuvres(fit.motion)
    light_kg, heavy_kg = sorted(compute_mean_mass_in_reverse_and_forwards_kg(fit.states, forwards))
    gain_u_kg = (body.force_gain_u or 0.0) * empty_kg
    u_kg = float(np.linalg.norm([fit.u_kg, body.empty_mass_u_kg or 0.0, gain_u_kg]))
    return (
        abs(light_kg - empty_kg) < LIMITS.empty_state_u * u_kg
        and heavy_kg - empty_kg > LIMITS.heaviest_state_u * u_kg
    )


def do_heavy_masses_scatter_more_than_light(states: LoadStates, is_heavy: Bools) -> bool:
    """Whether the heavier manoeuvres scatter more than the lighter ones, as payloads do.

    Args:
        states: manoeuvres as one load, weighed with the gain by direction.
        is_heavy: (manoeuvres,) whether each manoeuvre was heavy without that gain.
    """
    spread = [
        _compute_reduced_chi_square(states.manoeuvre_mass_kg[each], states.std_kg[each])
        for each in (is_heavy, ~is_heavy)
    ]
    degrees_of_freedom = [int(each.sum()) - 1 for each in (is_heavy, ~is_heavy)]
    if min(degrees_of_freedom) < 1 or not spread[1] > 0.0:
        return False
    chance = float(fdtrc(degrees_of_freedom[0], degrees_of_freedom[1], spread[0] / spread[1]))
    return chance < LIMITS.payload_scatter_probability


def _compute_reduced_chi_square(mass_kg: Floats, std_kg: Floats) -> float:
    """Reduced χ² of masses about their weighted mean; 0 for a single mass."""
    if mass_kg.size < 2:
        return 0.0
    weight = std_kg**-2.0
    mean_kg = float(weight @ mass_kg / weight.sum())
    return float(weight @ (mass_kg - mean_kg) ** 2) / (mass_kg.size - 1)
