"""Masses that drift or step over the log: the force's gain, its unit, or another machine."""

from typing import NamedTuple

import numpy as np

from analysis.diagnosis.check_inputs import list_possible_causes_of_mass_ratio
from analysis.findings.cause import MassChange, Symptom, list_only_strongest_symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.model.physical_units import NS_PER_S
from analysis.weighing.load_changes import find_manoeuvre_of_fitted_samples
from estimators.arrays import Floats


class _LightestLoad(NamedTuple):
    """Mass of the lightest loads in a part of a log, with its standard deviation, in kg."""

    mass_kg: float
    std_kg: float

    def format_mass(self) -> str:
        """Format mass and standard deviation."""
        return f"{self.mass_kg:,.0f} ± {self.std_kg:,.0f} kg"


class _LightestLoadStep(NamedTuple):
    """Lightest loads before and after a load state that begins a part of the log."""

    first_state_run: int
    before: _LightestLoad
    after: _LightestLoad

    @property
    def mass_ratio(self) -> float:
        """Lightest load after the step over that before it."""
        return self.after.mass_kg / self.before.mass_kg


def find_drift_among_loads(inputs: FindingInputs) -> list[Symptom]:
    """Find a drift of the force's gain in a log of several loads."""
    return list_only_strongest_symptom(
        [*find_drift_of_empty_mass(inputs), *find_steadily_changing_mass(inputs)]
    )


def find_steadily_changing_mass(inputs: FindingInputs) -> list[Symptom]:
    """Find load states that a mass proportional to time describes as well.

    The two are compared by the Bayesian information criterion (Schwarz 1978). Masses in the two
    driving directions may differ by a constant, as if loads alternated with the direction.
    """
    fit = inputs.fit_without_learnt_priors
    states = None if fit is None else fit.states
    if fit is None or states is None or states.manoeuvre_ids.size < LIMITS.steady_min_manoeuvres:
        return []
    if not (fit.mass_kg and (states.std_kg > 0.0).all()):
        return []
    motion, count = fit.motion, states.manoeuvre_ids.size
    number = np.searchsorted(states.manoeuvre_ids, find_manoeuvre_of_fitted_samples(motion))
    t_s = inputs.aligned["t_ns"].to_numpy()[motion.is_fittable] / NS_PER_S
    middle_s, direction = (
        np.bincount(number, each, count) / np.bincount(number)
        for each in (t_s, motion.direction[motion.is_fittable])
    )
    along = (middle_s - middle_s[0]) / (middle_s[-1] - middle_s[0]) - 0.5
    both_ways = bool(np.ptp(np.sign(direction)) > 0.0)
    columns = [along, np.ones(count), *([direction] * both_ways)]
    noise_kg = float(np.median(states.std_kg))
    weight = noise_kg / states.std_kg
    A, y = np.column_stack(columns) * weight[:, None], states.manoeuvre_mass_kg * weight
    theta = np.linalg.lstsq(A, y, rcond=None)[0]
    by_loads = (states.manoeuvre_mass_kg - states.means_kg[states.state_of_manoeuvre]) * weight
    # a fit better than the noise allows is not significant
    steadily, by_steps = (
        max(float(each @ each) / count, noise_kg**2) for each in (y - A @ theta, by_loads)
    )
    more = float(np.log(count)) * (len(columns) - states.state_count)
    # two loads are a single step, which a line hardly fits by chance
    allowed = LIMITS.indistinguishable_gain if states.state_count > 2 else 0.0
    if count * float(np.log(steadily / by_steps)) + more >= allowed:
        return []
    change_1 = float(theta[0]) / fit.mass_kg
    variance = steadily * count / (count - len(columns))
    std_1 = float(np.sqrt(variance * np.linalg.inv(A.T @ A)[0, 0])) / abs(fit.mass_kg)
    return [
        Symptom(
            abs(change_1) / max(LIMITS.trusted_gain_drift_1, LIMITS.named_term_min_std * std_1),
            f"the masses change evenly, by {change_1:+.1%} ± {std_1:.1%} over the log: the force's "
            "gain drifts, or the load changes steadily, as in a tank that empties",
            channel=inputs.force_channel,
            change=lambda: MassChange(0.0, abs(change_1) / 2.0 * abs(fit.mass_kg)),
        )
    ]


def find_drift_of_empty_mass(inputs: FindingInputs) -> list[Symptom]:
    """Find an empty machine whose mass changes over the log by more than burnt fuel explains."""
    weighing = inputs.check_inputs.weighing
    drift = None if weighing is None else weighing.significant_empty_mass_drift
    if weighing is None or drift is None:
        return []
    u_kg = drift.gain_u_1 * abs(weighing.fit.mass_kg)
    change, cause = (
        ("more", "gains mass, such as mud")
        if drift.change_1 > 0.0
        else ("less", "loses mass, such as fuel")
    )
    return [
        Symptom(
            abs(drift.change_1) / drift.significance_threshold_1,
            f"the empty machine weighs {abs(drift.change_1):.1%} ± {drift.u_1:.1%} {change} at the "
            "end of the log than at its beginning: the force's gain drifts, or the machine "
            f"{cause}",
            channel=inputs.force_channel,
            change=lambda: MassChange(0.0, u_kg),
        )
    ]


def find_step_of_lightest_load(inputs: FindingInputs) -> list[Symptom]:
    """Find a time before and after which the lightest recurring load differs.

    The empty machine recurs: if the lightest load recurs on both sides of a time, but with another
    mass, the scale of force or speed may have changed at that time, or the machine.
    """
    fit = inputs.fit_without_learnt_priors
    if fit is None or fit.states is None:
        return []
    states, numbers = fit.states, fit.states.state_of_manoeuvre
    firsts = np.flatnonzero(np.append(True, numbers[1:] != numbers[:-1]))
    weight = 1.0 / (states.std_kg**2 + states.scatter_kg**2)
    step = _find_largest_step_of_lightest_load(
        fit.masses_kg[numbers[firsts]], np.add.reduceat(weight, firsts) ** -0.5
    )
    if step is None:
        return []
    first_manoeuvre = states.manoeuvre_ids[firsts[step.first_state_run]]
    t_ns = inputs.aligned["t_ns"].to_numpy()[fit.motion.is_fittable]
    start = np.argmax(find_manoeuvre_of_fitted_samples(fit.motion) >= first_manoeuvre)
    gear, *units = list_possible_causes_of_mass_ratio(
        step.mass_ratio, tolerance=LIMITS.step_unit_tolerance
    )
    return [
        Symptom(
            abs(float(np.log(step.mass_ratio))) / np.log(LIMITS.lightest_load_step_ratio),
            f"the lightest load weighs {step.before.format_mass()} before "
            f"{t_ns[start] / NS_PER_S:,.0f} s and {step.after.format_mass()} from then on: another "
            f"machine or attachment, a machine that is never empty on one side, or "
            f"{' or '.join([gear, *units])}",
            span_ns=(int(t_ns[start]), int(t_ns[-1])),
            # which side is right is not known
            change=lambda: MassChange(0.0, abs(step.after.mass_kg - step.before.mass_kg)),
            # a step by just the ratio of two units is hardly another machine
            invalidates=bool(units),
        )
    ]


def _find_largest_step_of_lightest_load(
    masses_kg: Floats, stds_kg: Floats
) -> _LightestLoadStep | None:
    """Find where the lightest load that comes back changes most; None if it does not.

    Args:
        masses_kg: (n,) masses of successive loads.
        stds_kg: (n,) their standard deviations.
    """
    steps: list[_LightestLoadStep] = []
    for border in range(1, masses_kg.size):
        before = _find_lightest_returning_load(masses_kg[:border], stds_kg[:border])
        after = _find_lightest_returning_load(masses_kg[border:], stds_kg[border:])
        if before is None or after is None:
            continue
        step = _LightestLoadStep(border, before, after)
        # a load that the lighter side has as well is of the same scale
        lighter = masses_kg[:border] if step.mass_ratio > 1.0 else masses_kg[border:]
        heavier_kg = max(before.mass_kg, after.mass_kg)
        if not (np.abs(np.log(lighter / heavier_kg)) < np.log(LIMITS.as_light_ratio)).any():
            steps.append(step)
    sure = [
        each
        for each in steps
        if abs(np.log(each.mass_ratio)) > np.log(LIMITS.lightest_load_step_ratio)
        and abs(each.after.mass_kg - each.before.mass_kg)
        > LIMITS.lightest_load_step_std * np.hypot(each.before.std_kg, each.after.std_kg)
    ]
    if not sure:
        return None
    sizes = np.abs(np.log([each.mass_ratio for each in sure]))
    near = np.flatnonzero(sizes > sizes.max() - np.log(LIMITS.as_light_ratio))
    # loads at the border that are heavy for the lighter side belong to the other
    return sure[near[0]] if sure[near[0]].mass_ratio > 1.0 else sure[near[-1]]


def _find_lightest_returning_load(masses_kg: Floats, stds_kg: Floats) -> _LightestLoad | None:
    """Average the lightest loads; None if the machine does not come back to them after another.

    Args:
        masses_kg: (n,) masses of successive loads.
        stds_kg: (n,) their standard deviations.
    """
    least_kg = float(masses_kg.min())
    if not least_kg > 0.0:  # nor a mass that is unknown
        return None
    light = np.flatnonzero(masses_kg < LIMITS.as_light_ratio * least_kg)
    if not (masses_kg[light[0] : light[-1]] > LIMITS.heavier_ratio * least_kg).any():
        return None
    weight = stds_kg[light] ** -2
    return _LightestLoad(
        float(weight @ masses_kg[light] / weight.sum()), float(weight.sum() ** -0.5)
    )
