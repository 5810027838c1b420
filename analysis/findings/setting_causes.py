"""Causes in the settings: braking excluded although the force measures it, and forgetting.

If a machine brakes often, the gate accepts no window. Whether the force sensor measures the brakes
is therefore decided on all samples, gated or not: if it does, braking gives the same mass as
driving.
"""

from collections.abc import Callable

import numpy as np

from analysis.diagnosis.check_inputs import CheckInputs
from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.fit_causes import compute_relative_mass_u_of_answer
from analysis.model.methods import METHODS, FeedKind
from analysis.model.schema import get_column_values
from analysis.stages.estimation import fit_quality
from analysis.weighing.load_frames import find_load_change_rows
from estimators.arrays import Bools, Floats, Ints


def find_unmodelled_braking(inputs: FindingInputs) -> list[Symptom]:
    """Find usable braking that the gate rejects, in a log with few accepted windows."""
    if (
        not inputs.machine.settings.gate.exclude_braking
        or compute_relative_mass_u_of_answer(inputs) < LIMITS.poor_answer_u
    ):
        return []
    reasons = inputs.check_inputs.gated["reason_x"].cast(str)
    window_count = int((reasons != "warming_up").sum())
    refused = float((reasons == "braking").sum()) / max(window_count, 1)
    ratio = compute_braking_to_driving_mass_ratio(inputs.check_inputs)
    if not abs(ratio - 1.0) < LIMITS.braking_mass_tolerance:
        return []
    return [
        Symptom(
            refused / LIMITS.braking_windows_fraction,
            f"excluding braking rejects {refused:.0%} of the windows, but the mass from braking is "
            f"{ratio:.1%} of that from driving: the force sensor measures the braking",
            channel=inputs.force_channel,
            setting="settings.gate.exclude_braking",
            value="false",
        )
    ]


def compute_braking_to_driving_mass_ratio(inputs: CheckInputs) -> float:
    """Mass from braking over mass from driving, without the gate; NaN if undetermined."""
    motion = inputs.straight_motion
    A = np.column_stack([motion.A[:, :2], np.sign(motion.speed_or_yaw_rate)])
    driving = motion.complete & inputs.mark_samples_in_phases("accelerating", "cruising")
    found = [_fit_mass_and_std(A, motion.f, of) for of in (driving, motion.braking)]
    if not all(std_kg < LIMITS.braking_mass_u * abs(kg) for kg, std_kg in found):
        return float("nan")
    return found[1][0] / found[0][0]


def _fit_mass_and_std(A: np.ndarray, f: np.ndarray, chosen_rows: Bools) -> tuple[float, float]:
    mass_kg, std_kg, _ = fit_quality.fit_ungated(A, f, chosen_rows)
    return mass_kg, std_kg


def find_covariance_wind_up(inputs: FindingInputs) -> list[Symptom]:
    """Find recursive estimates that forget at constant speed (wind-up)."""
    found = [
        sign
        for name in inputs.estimates
        if (sign := find_std_growth_of_recursion(inputs, name)) is not None
    ]
    return [max(found, key=lambda sign: sign.strength)] if found else []


def find_std_growth_of_recursion(inputs: FindingInputs, method: str) -> Symptom | None:
    """Symptom of a recursive method whose own standard deviation grows; None if it cannot.

    Without excitation the covariance grows by 1 / forgetting per sample (Åström and Wittenmark
    1995, Adaptive Control, 11.5); faster growth has other reasons.
    """
    frame = inputs.estimates[method]
    trace = inputs.machine.settings.trace
    recursive = METHODS[method].feed is FeedKind.SETTLED
    # with directional forgetting there is no wind-up
    renewed = method == "rls" and trace.directional_forgetting
    if not recursive or renewed or trace.forgetting >= 1.0 or frame.is_empty():
        return None
    std_kg = get_column_values(frame, "mass_std_kg")
    rows = np.searchsorted(
        inputs.check_inputs.excitation["t_ns"].to_numpy(), frame["t_ns"].to_numpy()
    )
    starts, cruises = (
        inputs.check_inputs.mark_samples_in_phases(each)[rows]
        for each in ("accelerating", "cruising")
    )
    # a recursion restarts with each load, and gains information at each start
    load = np.searchsorted(find_load_change_rows(inputs.check_inputs.weighing), rows, "right")
    parts = np.flatnonzero(mark_rising_edges(starts) | mark_rising_edges(load))
    least_kg = apply_function_to_array_parts(np.fmin.accumulate, std_kg, parts)
    steady = apply_function_to_array_parts(np.cumsum, cruises.astype(np.float64), parts)
    grown = np.minimum(np.log(std_kg / least_kg), -0.5 * steady * np.log(trace.forgetting))
    grown[~cruises | ~np.isfinite(grown)] = -np.inf
    if np.count_nonzero(np.isfinite(grown)) < LIMITS.wind_up_min_estimates:
        return None
    worst = int(np.argmax(grown))
    mends = method == "rls"  # no other method has directional forgetting
    return Symptom(
        float(grown[worst] / np.log(LIMITS.wind_up_growth)),
        f"{method}'s standard deviation grows from {least_kg[worst]:.3g} to {std_kg[worst]:.3g} kg "
        f"in {steady[worst]:.0f} samples at constant speed: it forgets faster than it learns "
        f"(forgetting {trace.forgetting:g})",
        setting="settings.trace.directional_forgetting" if mends else None,
        value="true" if mends else None,
    )


def mark_rising_edges(flags_or_numbers: Bools | Ints) -> Bools:
    """(n,) True where a run of True values begins, or where a number increases."""
    return np.diff(flags_or_numbers.astype(np.int64), prepend=0) > 0


def apply_function_to_array_parts(
    function: Callable[[Floats], Floats], values: Floats, part_starts: Ints
) -> Floats:
    """Apply a function to each part of (n,) values; `part_starts` holds their first indices."""
    return np.concatenate([function(part) for part in np.split(values, part_starts)])
