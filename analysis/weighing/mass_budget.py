"""Uncertainty budget of the mass: parts from the fit, and the scale, which no log determines."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.model.machine import Machine
from analysis.model.uncertainty_sources import (
    SCALES,
    WHEEL_RADIUS_BY_LOAD,
    UncertaintySource,
    combine_u,
    compute_root_sum_of_squares,
    sort_sources_largest_first,
)
from analysis.weighing.force_by_position import BY_PLACE
from analysis.weighing.joint_result import JointFit
from analysis.weighing.low_gears import BY_GEAR
from analysis.weighing.motion_samples import Floats
from analysis.weighing.uneven_ground import BY_GROUND
from analysis.weighing.weigh import Weighing
from analysis.weighing.weighing_limits import LIMITS


@dataclass(frozen=True, slots=True)
class _FitPart:
    kind: str
    meaning: str
    reduced_by: str


#: Parts of the uncertainty from the fit, besides the priors.
_PARTS: Final = {
    "noise": _FitPart("random", "noise of this log, through its residuals", "more starts"),
    "scatter": _FitPart(
        "random",
        "manoeuvres of one load that disagree with each other",
        "more starts, driven alike",
    ),
    "other_reading": _FitPart(
        "common",
        "masses that change or that scatter: the log cannot distinguish them",
        "more starts with each load; a boom or bucket channel; the scatter of one load's starts: "
        "machine.repeatability_kg",
    ),
    BY_PLACE: _FitPart(
        "common",
        "a force that depends on the place on a short path: a spring, gravity",
        "strokes at different accelerations over the same path",
    ),
    BY_GEAR: _FitPart(
        "common",
        "rotating mass of low gears, which falls with the speed",
        "driving in the top gear; machine.rotating_mass_kg for the mass that rotates there",
    ),
    BY_GROUND: _FitPart(
        "common",
        "ground with another resistance where the machine starts with a load",
        "more cycles; a pitch channel; even ground",
    ),
    "ground_shape": _FitPart(
        "common",
        "ground along the way, whose force is interpolated linearly between a few places",
        "even ground; a pitch channel; larger loads",
    ),
    "other_effects": _FitPart(
        "common",
        "drifts and uneven ground that the log neither shows nor rules out",
        "loads that come back: empty, loaded, empty; a machine that is warm",
    ),
    "drifted_gain": _FitPart(
        "common",
        "the gain of the force drifts over the log, and it is not known at which end it has its "
        "stated value",
        "a force sensor at its working temperature; known loads at both ends of the log",
    ),
    "squat": _FitPart(
        "common",
        "a body that squats more with its load, which tilts its accelerometer against gravity",
        "more starts with each load on even ground; a stiffly mounted accelerometer",
    ),
    "misfit": _FitPart(
        "common",
        "a residual common to all starts that the model does not explain",
        "finding its cause: filters, brakes, tyres",
    ),
    "lag_shape": _FitPart(
        "common",
        "a lag of the force that is neither a pure delay nor a pure low-pass",
        "the force without its filter",
    ),
    "averaging": _FitPart(
        "common",
        "the mass depends on the averaging time: fast motion that the model does not describe",
        "an accelerometer on the body; starts that accelerate longer",
    ),
    "channel_noise": _FitPart(
        "common",
        "noise of speed and acceleration, known to a quarter",
        "a quieter accelerometer, or settings.noise",
    ),
    "learnt": _FitPart(
        "common",
        "errors of the prior means that a calibration learnt: common to all its logs, so that "
        "its line absorbs them",
        "the calibration, which has removed it from the calibrated mass",
    ),
    "speed_delay": _FitPart(
        "common", "delay of the speed behind the accelerometer", "topics with one clock"
    ),
    "gain": _FitPart(
        "common",
        "gain of the accelerometer, or wheels that disagree with it: the log cannot say which",
        "the wheel radius by rolling a known distance; IMU level and mounted stiffly",
    ),
    "falling_friction": _FitPart(
        "common",
        "friction that falls with the speed, which the fit takes for negative viscous friction",
        "starts at different throttles and cruising at several speeds",
    ),
    "braking": _FitPart(
        "common",
        "braking and driving give different masses, and driving alone cannot decide",
        "settings.gate.exclude_braking = true, or a force sensor that measures all brakes",
    ),
    "priors": _FitPart(
        "common",
        "priors twice as wide move the mass by more than its uncertainty",
        "starts at different throttles and both ways, or priors that are known",
    ),
    "gain_by_direction": _FitPart(
        "common",
        "the gain of the force differs in reverse, and it is not known which direction is right",
        "the gain of each direction: machine.force_gain_in_reverse",
    ),
    "missing_term": _FitPart(
        "common",
        "a gain of the force that changes with the speed, the force or its direction of change, "
        "or a nonlinear speed: this log shows one of them",
        "a force at the wheels from a sensor that is linear; starts at different throttles",
    ),
    "unmodelled_force": _FitPart(
        "common",
        "a force that the model lacks and that differs between starts: uneven ground, curves, slip "
        "or slack couplings",
        "a pitch channel and a yaw rate; straight starts on even ground",
    ),
    "warming": _FitPart(
        "common",
        "Coulomb friction or rolling resistance that changes after the start, as when a machine "
        "warms: this log shows it",
        "a machine that is warm; loads that come back",
    ),
    "elasticity": _FitPart(
        "common",
        "a part that flexes between the mass and the motion sensor, so that the mass swings: this "
        "log shows it",
        "the motion of the mass itself, by an accelerometer or encoder on it; starts without jerks",
    ),
    "swing": _FitPart(
        "common",
        "a mass that swings relative to the machine, such as a hanging load, a liquid or a mast: "
        "the log determines how heavy it is",
        "starts without jerks; pauses until nothing swings",
    ),
    "growth": _FitPart(
        "common",
        "a residual that grows evenly over every start, as if the load grew: a force that is late, "
        "an efficiency that changes with the torque, or brakes that release",
        "a force at the wheels, on the clock of the motion; machine.digs = true if it is filled "
        "while it drives",
    ),
    "curvature": _FitPart(
        "common",
        "a force that is not linear in the acceleration",
        "force measured on all wheels; a force sensor that measures all braking; a yaw rate, or "
        "straight starts on even ground",
    ),
}


def make_mass_budget(
    weighing: Weighing, machine: Machine, coefficients: Floats
) -> list[UncertaintySource]:
    """Uncertainty sources of a sum of masses, the largest first, unknown ones last.

    Args:
        weighing: the joint fit.
        machine: machine file with the scale's uncertainties.
        coefficients: (masses,) weight of each mass: 1 for one mass, 1 and -1 for a difference.
    """
    fit, body = weighing.fit, machine.machine
    sum_kg = abs(float(coefficients @ fit.masses_kg))
    loaded_kg = abs(
        float(coefficients @ (fit.masses_kg * compute_relative_loads_of_states(fit, machine)))
    )
    terms = {term.name: term for term in fit.terms}
    sources: list[UncertaintySource] = []
    parts_kg = fit.compute_u_by_cause_kg(coefficients)
    parts_kg |= list_uncertainty_by_failed_checks_kg(weighing, coefficients, parts_kg)
    for source in {term.source: None for term in fit.terms if term.source}:
        own_kg = [parts_kg.pop(name) for name, term in terms.items() if term.source == source]
        parts_kg[source] = float(np.linalg.norm(own_kg))
    for name, u_kg in parts_kg.items():
        if name in terms:
            term = terms[name]
            sources.append(UncertaintySource(name, "common", u_kg, term.meaning, term.reduced_by))
        elif u_kg > 0.0:
            part = _PARTS[name]
            sources.append(UncertaintySource(name, part.kind, u_kg, part.meaning, part.reduced_by))
    # a speed in m/s may have been computed with a fixed radius too, and a bench has no tyres
    hauls_by_wheel_speed = (
        fit.mass_count > 1
        and machine.differentiates_wheel_speed
        and not fit.motion.is_short_path_bench_log
    )
    for scale in SCALES:
        if scale.applies(machine) or (hauls_by_wheel_speed and scale is WHEEL_RADIUS_BY_LOAD):
            relative, of_kg = scale.u(machine), loaded_kg if scale.by_load else sum_kg
            sources.append(
                scale.make_uncertainty_source(None if relative is None else relative * of_kg)
            )
    # in a difference it cancels
    rotating_u_kg = body.rotating_mass_u_kg * abs(float(coefficients.sum()))
    if rotating_u_kg:
        sources.append(
            UncertaintySource(
                "rotating_mass",
                "scale",
                rotating_u_kg,
                "rotating mass of wheels and motors",
                "known loads, or the drawings of the driveline",
            )
        )
    return sort_sources_largest_first(sources)


def compute_relative_load_mass_u(weighing: Weighing, machine: Machine, state: int) -> float:
    """Relative standard uncertainty of a load's mass, without the scale.

    It decides whether the mass is stated: NaN if the fit has none, infinite if the mass is not
    positive.
    """
    sources = make_mass_budget(
        weighing, machine, weighing.fit.make_mass_coefficients_of_state(state)
    )
    mass_kg = float(weighing.fit.masses_kg[state]) - machine.machine.rotating_mass_kg
    if not np.isfinite([mass_kg, combine_u(sources)]).all():
        return float("nan")
    return combine_u(sources, "random", "common") / mass_kg if mass_kg > 0.0 else float("inf")


def estimate_mass_change_without_friction_kg(fit: JointFit, coefficients: Floats) -> float:
    """Change of a sum of masses if viscous friction were known to be zero, in kg."""
    at = fit.mass_count
    responses = fit.posterior_fit.responses
    by_friction = (fit.posterior_fit.noise + fit.posterior_fit.scatter)[
        at
    ] + responses.T @ responses[:, at]
    return -fit.viscous_friction * float(coefficients @ by_friction[:at]) / float(by_friction[at])


def compute_relative_loads_of_states(fit: JointFit, machine: Machine) -> Floats:
    """(masses,) mass of each state relative to the empty machine, or the lightest, minus 1."""
    empty_kg = machine.machine.empty_inertia_kg
    if empty_kg is None:
        empty_kg = float(np.min(fit.masses_kg))
    # without an empty mass there is no relative load
    return fit.masses_kg / empty_kg - 1.0 if empty_kg else np.zeros(fit.mass_count)


def list_uncertainty_by_failed_checks_kg(
    weighing: Weighing, coefficients: Floats, parts_kg: dict[str, float]
) -> dict[str, float]:
    """Additional uncertainty of a sum of masses in kg, by cause, for each check that fails."""
    fit = weighing.fit
    # an error of the equation has the same relative effect on every mass
    share = abs(float(coefficients @ fit.masses_kg)) / abs(fit.mass_kg) if fit.mass_kg else 1.0
    found: dict[str, float] = {}
    if fit.effects is not None and BY_GROUND in fit.effects.mass_change_without_effect_kg:
        moved_kg = float(coefficients @ fit.effects.mass_change_without_effect_kg[BY_GROUND])
        found["ground_shape"] = LIMITS.ground_shape_u_1 * abs(moved_kg)
    if fit.effects is not None and "gain" not in fit.effects.left_out:
        drift_kg = fit.estimate_of_term("gain_drift") * float(coefficients @ fit.masses_kg)
        found["drifted_gain"] = LIMITS.half_gain_drift * abs(drift_kg)
    drift = weighing.significant_empty_mass_drift
    if drift is not None:
        drift_kg = float(
            np.linalg.norm(drift.compute_mass_responses_kg(fit.masses_kg) @ coefficients)
        )
        found["drifted_gain"] = max(found.get("drifted_gain", 0.0), drift_kg)
    curved_kg = (
        abs(weighing.curvature.mass_change_kg) * share if weighing.curvature.is_significant else 0.0
    )
    # only the largest counts: one fault makes several of these terms significant
    missing_kg = [
        (
            (each.term.source or "missing_term") if each.is_confirmed else "unmodelled_force",
            abs(float(coefficients @ each.effect_kg)),
        )
        for each in weighing.missing_terms
    ]
    grown_kg = abs(float(np.sum(coefficients * weighing.filling.significant_mass_changes_kg)))
    name, largest_kg = max(
        ("curvature", curved_kg),
        *missing_kg,
        ("growth", grown_kg),
        key=lambda part: part[1],
    )
    if largest_kg:
        found[name] = largest_kg
    if weighing.by_direction is not None:
        found["gain_by_direction"] = weighing.by_direction.relative_mass_u * abs(
            float(coefficients @ fit.masses_kg)
        )
    viscous, std = fit.viscous_friction_and_std
    if viscous < -LIMITS.falling_friction_std * std:
        found["falling_friction"] = abs(estimate_mass_change_without_friction_kg(fit, coefficients))
    if weighing.braking_doubted:
        found["braking"] = abs(weighing.braking_kg) / 2.0 * share
    leans_kg = abs(float(coefficients @ (weighing.doubled_kg - fit.masses_kg)))
    if leans_kg > LIMITS.prior_dependence_std * compute_root_sum_of_squares(parts_kg.values()):
        found["priors"] = leans_kg
    return found
