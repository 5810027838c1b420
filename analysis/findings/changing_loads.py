"""Loads that change: during a manoeuvre, or from start to start.

A growing load obeys f = (m + g t) a + (b + g) v, with g in kg/s: accelerating the incoming material
to the machine's speed takes g v. Each manoeuvre has its own mass and growth; friction and constant
forces are common to all manoeuvres.

Alternating loads may be a single load if the measured share of the force changes: when the driving
direction alternates from start to start, so does the sign of the acceleration, and with it the
force that load transfer removes from the measured wheels.
"""

from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np

from analysis.findings.cause import MassChange, Symptom
from analysis.findings.constant_forces import explain_constant_force
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.whitened_rows import (
    ProjectedEquation,
    build_whitened_force_rows,
    compute_sums_of_sample_blocks,
    compute_whitened_row_noise_variance,
)
from analysis.weighing.load_limits import LIMITS as LOAD_LIMITS
from analysis.weighing.stretch_means import list_indices_of_samples_in_whole_blocks
from estimators.errors import format_count
from estimators.numerics.fit_loss import list_rows_by_group

#: Terms fitted besides in every log; noisier columns would absorb the growth.
_USUAL: Final = ("const", "direction")


class ForceShareChange(NamedTuple):
    """Change of the measured fraction of the force with the acceleration.

    Attributes:
        value: change of the fraction, per m/s².
        std: standard deviation of the change, per m/s².
        log_likelihood_gain: increase of twice the log likelihood over one load with a constant
            fraction.
        log_likelihood_gain_of_several_loads: advantage in twice the log likelihood of several loads
            over one load, both with a changing fraction.
        load_count: number of loads of the present answer.
    """

    value: float
    std: float
    log_likelihood_gain: float
    log_likelihood_gain_of_several_loads: float
    load_count: int


def compare_force_change_with_load_changes(inputs: FindingInputs) -> ForceShareChange | None:
    """Compare one load and a changing force fraction with several loads.

    Returns:
        The comparison; None if the answer has one load, or the machine drives one way only.
    """
    fit, noise, motion = (
        inputs.fit_without_learnt_priors,
        inputs.column_noise,
        explain_constant_force(inputs).motion,
    )
    if (
        fit is None
        or noise is None
        or motion is None
        or fit.mass_count == 1
        or not motion.drives_both_ways
    ):
        return None
    viscous, own_kg = max(fit.viscous_friction, 0.0), inputs.look_up_mass_of_samples_kg(motion)
    one_kg = np.full_like(own_kg, np.median(own_kg[motion.is_fittable]))
    # several loads with a changing fraction: loads that do not follow the direction remain loads
    by_loads = ProjectedEquation.project_out(
        build_whitened_force_rows(motion, noise, own_kg, viscous), ("driveline",)
    )
    one = build_whitened_force_rows(motion, noise, one_kg, viscous)
    before, after = (
        ProjectedEquation.project_out(one, ()),
        ProjectedEquation.project_out(one, ("driveline",)),
    )
    square = before.get_information_left_about_cause("driveline")
    if not square > 0.0:
        return None
    variance = min(by_loads.variance, after.variance)
    of_several = after.square_left * after.variance - by_loads.square_left * by_loads.variance
    value = before.get_likelihood_score_left_of_cause("driveline") / square
    gain = value**2 * square * before.variance / variance
    std = (variance / (square * before.variance)) ** 0.5
    return ForceShareChange(value, std, gain, of_several / variance, fit.mass_count)


def find_force_gain_by_direction(inputs: FindingInputs) -> list[Symptom]:
    """Find a force with another gain in reverse, or loads that such a gain could explain."""
    weighing = inputs.check_inputs.weighing
    found = None if weighing is None else weighing.by_direction
    if weighing is None or found is None:
        return []
    apart = found.gain_1 - 1.0
    says = (
        f"in reverse the gain of the force differs by {apart:+.1%} ± {found.std_1:.1%}, or the "
        "load depends on the direction"
    )
    if found.could_explain_several_loads:
        says = (
            f"in reverse the gain of the force differs by {apart:+.1%} ± {found.std_1:.1%} and "
            f"there is one load, or there are {found.loads} that depend on the direction: this log "
            "cannot distinguish the two. To decide, add a boom or bucket channel, or set "
            "settings.loads.single_load, settings.loads.empty_from_s and .empty_to_s, machine.digs "
            "or machine.force_gain_in_reverse (1: equal in both directions)"
        )
    of_mass_kg = found.relative_mass_u * abs(weighing.fit.mass_kg)
    return [
        Symptom(
            max(found.significance_1, 1.0),
            says,
            channel=inputs.force_channel,
            # it is not known which direction is right
            change=None
            if found.could_explain_several_loads
            else lambda: MassChange(0.0, of_mass_kg),
            invalidates=found.could_explain_several_loads,
        )
    ]


class LoadGrowthRate(NamedTuple):
    """Growth of the load during one manoeuvre.

    Attributes:
        first_sample: first grid sample of the manoeuvre.
        kg_s: growth rate; negative if the load falls.
        z_score_over_threshold: the rate's z-score divided by the detection threshold.
    """

    first_sample: int
    kg_s: float
    z_score_over_threshold: float


def find_load_changing_in_motion(inputs: FindingInputs) -> list[Symptom]:
    """Find manoeuvres whose load grows or falls while the machine drives."""
    found = [*_report_excluded_load_changes(inputs), *_find_fitted_load_changes(inputs)]
    return [max(found, key=lambda sign: sign.strength)] if found else []


def _find_fitted_load_changes(inputs: FindingInputs) -> list[Symptom]:
    """Find changing loads in manoeuvres that the fit uses."""
    found = _select_significant_load_changes(inputs)
    if not found:
        return []
    worst = max(found, key=lambda each: each.z_score_over_threshold)
    start = int(inputs.aligned["t_ns"].to_numpy()[worst.first_sample])
    return [
        Symptom(
            worst.z_score_over_threshold * len(found) ** 0.5,
            f"in {format_count(len(found), 'manoeuvre')} the load changes, by up to "
            f"{worst.kg_s:+.0f} kg/s",
            span_ns=(start, start),
        )
    ]


def _report_excluded_load_changes(inputs: FindingInputs) -> list[Symptom]:
    """Report the changing loads that the answer excludes."""
    weighing = inputs.check_inputs.weighing
    if weighing is None:
        return []
    # a gain that depends on the speed looks like a load, larger than any loader carries
    steps = bool(inputs.reportable_missing_terms)
    most_kg = LOAD_LIMITS.largest_load_fraction * abs(weighing.fit.mass_kg)
    growing = [
        each
        for each in weighing.growing_load_manoeuvres
        if each.is_possible and not (steps and each.load_change_kg > most_kg)
    ]
    if not growing:
        return []
    worst = max(growing, key=lambda each: abs(each.load_change_kg) / each.std_kg)
    t = inputs.aligned["t_ns"].to_numpy()
    start = int(t[min(worst.first, t.size - 1)])
    return [
        Symptom(
            abs(worst.load_change_kg) / worst.std_kg / 4.0 * float(np.sqrt(len(growing))),
            f"in {format_count(len(growing), 'manoeuvre')} the load changes, by up to "
            f"{worst.load_change_kg:+.0f} ± {worst.std_kg:.0f} kg; these manoeuvres are excluded",
            span_ns=(start, start),
        )
    ]


def _select_significant_load_changes(inputs: FindingInputs) -> list[LoadGrowthRate]:
    """Manoeuvres whose load changes by more than noise explains."""
    fit, noise, motion = (
        inputs.fit_without_learnt_priors,
        inputs.column_noise,
        explain_constant_force(inputs).motion,
    )
    if fit is None or noise is None or motion is None:
        return []
    parts = [
        part
        for part in list_rows_by_group(motion.stretch_of_sample)
        if part.size >= LIMITS.growth_min_rows * LIMITS.force_mean_samples
    ]
    if len(parts) < 3:  # too few to know the usual scatter
        return []
    viscous = max(fit.viscous_friction, 0.0)
    system = build_whitened_force_rows(
        motion, noise, inputs.look_up_mass_of_samples_kg(motion), viscous
    )
    taken = list_indices_of_samples_in_whole_blocks(
        motion.stretch_of_sample, LIMITS.force_mean_samples
    ).reshape(-1, LIMITS.force_mean_samples)
    group = motion.stretch_of_sample[taken[:, 0]]
    usual = [column for name, column in system.columns.items() if name in _USUAL]
    base = np.column_stack([system.base, *usual])
    q = np.linalg.qr(base / np.linalg.norm(base, axis=0))[0]
    left = system.y - q @ (q.T @ system.y)
    limit = -NormalDist().inv_cdf(LIMITS.growth_false_alarm_probability / 2.0 / len(parts))
    found: list[LoadGrowthRate] = []
    for part in parts:
        stretch = motion.stretch_of_sample[part[0]]
        rows = np.arange(*np.searchsorted(group, [stretch, stretch + 1]))
        rows = rows[taken[rows, 0] < part[0] + LIMITS.longest_loading_s * motion.rate_hz]
        mine = taken[rows].ravel()
        t_s = (mine - part[0]) / motion.rate_hz
        grown = (
            compute_sums_of_sample_blocks(
                t_s * motion.acceleration[mine] + motion.speed[mine], LIMITS.force_mean_samples
            )
            / LIMITS.force_mean_samples
        )
        own = np.column_stack([system.base[rows, 0] * system.size_N, grown]) / system.size_N
        across = own - q[rows] @ (q[rows].T @ own)
        gram = own.T @ across
        rest = gram[1, 1] - gram[0, 1] ** 2 / gram[0, 0]
        if not rest > LIMITS.growth_min_left_fraction * float(own[:, 1] @ own[:, 1]):
            continue
        score = own.T @ left[rows]
        kg_s = float(score[1] - gram[0, 1] / gram[0, 0] * score[0]) / rest
        least = LIMITS.falling_load_factor if kg_s < 0.0 else 1.0
        if not abs(kg_s) * float(np.sqrt(rest / LIMITS.min_row_variance)) / limit / least > 1.0:
            continue  # whatever the noise, which takes long to compute
        others = np.delete(left, rows)
        z_score_over_threshold = (
            abs(kg_s) * float(np.sqrt(rest / compute_whitened_row_noise_variance(others))) / limit
        )
        z_score_over_threshold /= least
        if z_score_over_threshold > 1.0:
            found.append(LoadGrowthRate(int(part[0]), kg_s, z_score_over_threshold))
    return (
        found
        if len(found) > 1
        else [each for each in found if each.z_score_over_threshold > LIMITS.single_growth_factor]
    )
