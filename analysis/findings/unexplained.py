"""Failed checks that no cause accounts for: the finding `unknown` names them."""

from collections.abc import Collection, Mapping
from typing import Any, Final

import polars as pl

from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS

#: Key in the cache: the causes that the log shows, and those of them that affect the mass.
SHOWN: Final = "shown causes"
MATTERING: Final = "mattering causes"
#: Consequences of failed checks that need a cause; other checks name their own reason.
_COSTS: Final = ("withhold", "widen")
#: Causes that do not bias the fit, and so account for no check.
_BEND_NOTHING: Final = ("quantised", "gaps", "repeated_rows", "wind_up", "braking_left_out")
#: Causes of the quantity that a check tests: they account for it whatever their effect on the mass.
_OF_ITS_QUANTITY: Final[Mapping[str, tuple[str, ...]]] = {
    "force_delay_s": ("delay",),
    "speed_delay_s": ("delay", "imu_low_passed"),
    "wheel_imu_gain_error": ("wheel_radius", "imu_loose", "imu_low_passed"),
    "wheel_imu_residual": ("slip", "slope", "delay", "imu_low_passed", "imu_loose"),
    "force_nonlinearity": ("driveline", "gain_by_speed", "braking_inside", "saturated"),
    "braking_bias": ("braking_inside",),
    "manoeuvre_scatter": ("load_changed_inside", "gain_by_direction", "gain_drift"),
    "relative_u": ("too_little_excitation", "collinear"),
    "channel_noise": ("too_little_excitation", "resonance", "quantised"),
}
#: Checks that only certain causes account for; any cause that affects the mass accounts for the
#: others.
_OF_ONE_THING: Final[Mapping[str, tuple[str, ...]]] = {
    "frozen_s": ("frozen", "saturated"),
    "clipped_share": ("saturated",),
    "clock_drift_s": ("clock_drift", "clock_jump", "irregular_sampling"),
    "imu_tilt_deg": ("imu_misaligned", "imu_bias", "slope", "wrong_unit", "sign_flipped"),
    "one_sided_torque": ("unlike_sides", "sign_flipped", "unsigned", "frozen", "saturated"),
    "filling": (
        *("load_changed_inside", "external_force", "delay", "gain_drift", "driveline"),
        "gain_by_speed",
    ),
}


def find_failed_checks_without_cause(inputs: FindingInputs) -> list[Symptom]:
    """Report the failed checks of the mass that no cause accounts for, as one symptom."""
    shown, mattering = (inputs.cache.get(name, ()) for name in (SHOWN, MATTERING))
    assert isinstance(shown, tuple)
    assert isinstance(mattering, tuple)
    found = make_unexplained_symptom(inputs.verdict_frame, shown, mattering)
    return [] if found is None else [found]


def make_unexplained_symptom(
    verdict: pl.DataFrame,
    found_causes: Collection[str],
    found_mass_causes: Collection[str] | None = None,
) -> Symptom | None:
    """Symptom of failed checks that no cause explains; None if each is explained.

    Args:
        verdict: the frame `verdict`.
        found_causes: keys of the causes that the log shows.
        found_mass_causes: keys of those causes that invalidate the mass, change it by about its
            uncertainty, or have an unknown effect on it; None means all.
    """
    explained_names, matter = (
        set(found_causes),
        set(found_causes if found_mass_causes is None else found_mass_causes),
    )
    failed = [
        row
        for row in verdict.iter_rows(named=True)
        if _is_failed_mass_check_unexplained(row, explained_names, matter)
    ]
    if not failed:
        return None
    said = "; ".join(
        f"{row['check']} {_format_value_and_limit(row)}: {row['meaning']}" for row in failed
    )
    return Symptom(
        max(map(_compute_value_to_limit_ratio, failed)),
        f"no known cause explains the failed checks: {said}",
    )


def _is_failed_mass_check_unexplained(
    check_row: Mapping[str, Any], found_causes: set[str], found_mass_causes: set[str]
) -> bool:
    """Whether a check of the mass has failed and none of the found causes accounts for it."""
    if (
        check_row["about"] != "mass"
        or check_row["passed"] is not False
        or check_row["consequence"] not in _COSTS
    ):
        return False
    check = check_row["check"]
    if check in _OF_ONE_THING:
        accounts = found_causes & set(_OF_ONE_THING[check])
    else:
        accounts = found_mass_causes | found_causes & set(_OF_ITS_QUANTITY.get(check, ()))
    return not accounts - set(_BEND_NOTHING)


def _format_value_and_limit(check_row: Mapping[str, Any]) -> str:
    """Value and the limit that it exceeds, as text."""
    if check_row["value"] is None:
        return "has no value"
    low, high = check_row["minimum"], check_row["maximum"]
    beyond = low is not None and check_row["value"] < low
    limit = f"< {low:g}" if beyond or high is None else f"> {high:g}"
    return f"{check_row['value']:.3g} {limit}"


def _compute_value_to_limit_ratio(check_row: Mapping[str, Any]) -> float:
    """Value over its limit, as the strength of the symptom."""
    value, limit = check_row["value"], check_row["maximum"]
    if value is None or not limit or limit < 0.0:
        return LIMITS.numberless_check_strength
    return max(abs(value / limit), LIMITS.numberless_check_strength)
