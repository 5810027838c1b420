"""Masses that drift or step over the log: the force's gain, its unit, or another machine."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from analysis.diagnosis.check_inputs import list_possible_causes_of_mass_ratio
from analysis.findings.cause import MassChange, Symptom, list_only_strongest_symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.model.physical_units import NS_PER_S
from analysis.weighing.joint_result import JointFit
from analysis.weighing.load_changes import find_manoeuvre_of_fitted_samples
from analysis.weighing.load_states import LoadStates


class _LoadSpan(NamedTuple):
    """Successive manoeuvres with one load: mass and standard deviation in kg, first manoeuvre."""

    mass_kg: float
    std_kg: float
    first_manoeuvre: int


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
    fit = inputs.log_only_fit
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
    return [
        Symptom(
            abs(drift.change_1) / drift.significance_threshold_1,
            f"the empty machine weighs {abs(drift.change_1):.1%} ± {drift.u_1:.1%} "
            f"{'more' if drift.change_1 > 0.0 else 'less'} at the end of the log than at its "
            "beginning: the force's gain drifts, or the machine loses mass",
            channel=inputs.force_channel,
            change=lambda: MassChange(0.0, u_kg),
        )
    ]


def find_step_of_lightest_load(inputs: FindingInputs) -> list[Symptom]:
    """Find a time after which the machine returns to another lightest load than before it.

    Loads come and go, but the empty machine comes back: if it does on both sides of a time, with
    another mass, then the scale of force or speed has changed there, or the machine has.
    """
    fit = inputs.log_only_fit
    spans = [] if fit is None or fit.states is None else _list_load_spans(fit, fit.states)
    steps = [
        (border, before, after)
        for border in range(1, len(spans))
        if (before := _find_lightest_returning_load(spans[:border]))
        and (after := _find_lightest_returning_load(spans[border:]))
        and _is_step_of_lightest_load(before, after)
    ]
    if fit is None or not steps:
        return []
    largest = max(abs(np.log(after.mass_kg / before.mass_kg)) for _, before, after in steps)
    near = [
        each
        for each in steps
        if abs(np.log(each[2].mass_kg / each[1].mass_kg)) > largest - np.log(LIMITS.as_light_ratio)
    ]
    rises = near[0][2].mass_kg > near[0][1].mass_kg
    # heavy loads on the light side of the border may lie on either
    border, before, after = near[0] if rises else near[-1]
    ratio = after.mass_kg / before.mass_kg
    manoeuvre = find_manoeuvre_of_fitted_samples(fit.motion)
    t_ns = inputs.aligned["t_ns"].to_numpy()[fit.motion.is_fittable]
    start_ns = int(t_ns[np.argmax(manoeuvre >= spans[border].first_manoeuvre)])
    causes = " or ".join(list_possible_causes_of_mass_ratio(ratio, inputs.machine))
    return [
        Symptom(
            largest / np.log(LIMITS.lightest_load_step_ratio),
            f"the lightest load weighs {before.mass_kg:,.0f} ± {before.std_kg:,.0f} kg before "
            f"{start_ns / NS_PER_S:,.0f} s and {after.mass_kg:,.0f} ± {after.std_kg:,.0f} kg from "
            f"then on: another machine or attachment, or {causes}",
            span_ns=(start_ns, int(t_ns[-1])),
            # which side is right is not known
            change=lambda: MassChange(0.0, abs(after.mass_kg - before.mass_kg)),
        )
    ]


def _list_load_spans(fit: JointFit, states: LoadStates) -> list[_LoadSpan]:
    """Spans of successive manoeuvres with one load."""
    numbers = states.state_of_manoeuvre
    firsts = np.flatnonzero(np.append(True, numbers[1:] != numbers[:-1]))
    stds = np.add.reduceat(1.0 / (states.std_kg**2 + states.scatter_kg**2), firsts) ** -0.5
    found = zip(fit.masses_kg[numbers[firsts]], stds, states.manoeuvre_ids[firsts], strict=True)
    return [_LoadSpan(float(kg), float(std), int(first)) for kg, std, first in found]


def _find_lightest_returning_load(spans: Sequence[_LoadSpan]) -> _LoadSpan | None:
    """The lightest load, averaged; None if the machine does not come back to it after another."""
    least_kg = min(each.mass_kg for each in spans)
    if least_kg <= 0.0:
        return None
    light = [each for each in spans if each.mass_kg < LIMITS.as_light_ratio * least_kg]
    between = spans[spans.index(light[0]) : spans.index(light[-1])]
    if all(each.mass_kg < LIMITS.heavier_ratio * least_kg for each in between):
        return None
    weight = np.array([each.std_kg**-2 for each in light])
    mean_kg = float(weight @ [each.mass_kg for each in light] / weight.sum())
    return _LoadSpan(mean_kg, float(weight.sum() ** -0.5), light[0].first_manoeuvre)


def _is_step_of_lightest_load(before: _LoadSpan, after: _LoadSpan) -> bool:
    """Whether the lightest loads of two parts of a log are not of one machine and scale."""
    ratio = max(after.mass_kg / before.mass_kg, before.mass_kg / after.mass_kg)
    std_kg = float(np.hypot(before.std_kg, after.std_kg))
    return (
        ratio > LIMITS.lightest_load_step_ratio
        and abs(after.mass_kg - before.mass_kg) > LIMITS.lightest_load_step_std * std_kg
    )
