"""Failed checks that no cause accounts for: the finding `unknown` names them."""

from collections.abc import Collection, Mapping
from typing import Any, Final

import polars as pl

from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS

#: Kept of the case: keys of the causes that it shows.
SHOWN: Final = "shown causes"
#: What failing a check costs; those that tell alone, or leave out a method, name their own reason.
_COSTS: Final = ("withhold", "widen")
#: Causes that bend nothing, and so account for no check.
_BEND_NOTHING: Final = ("quantised", "gaps", "wind_up", "braking_left_out")
#: Checks of one thing, and the causes that account for them; others any cause may fail.
_OF_ONE_THING: Final[Mapping[str, tuple[str, ...]]] = {
    "frozen_s": ("frozen",),
    "clipped_share": ("saturated",),
    "clock_drift_s": ("clock_drift", "clock_jump", "irregular_sampling"),
    "imu_tilt_deg": ("imu_misaligned", "imu_bias", "slope", "wrong_unit", "sign_flipped"),
    "one_sided_torque": ("unlike_sides", "sign_flipped", "unsigned", "frozen", "saturated"),
    "filling": ("load_changed_inside", "external_force", "delay", "gain_drift", "driveline"),
}


def find_unexplained_checks(inputs: FindingInputs) -> list[Symptom]:
    """Report failed checks of the mass that no cause accounts for."""
    kept = inputs.cache.get(SHOWN, ())
    found = make_unexplained_symptom(inputs.judged, kept if isinstance(kept, tuple) else ())
    return [] if found is None else [found]


def make_unexplained_symptom(judged: pl.DataFrame, causes: Collection[str]) -> Symptom | None:
    """Symptom of failed checks that no cause explains; None if each is explained.

    Args:
        judged: the frame `verdict`.
        causes: keys of the causes that the log shows.
    """
    failed = [row for row in judged.iter_rows(named=True) if _is_unexplained(row, set(causes))]
    if not failed:
        return None
    said = "; ".join(
        f"{row['check']} {_value_and_limit_text(row)}: {row['meaning']}" for row in failed
    )
    return Symptom(
        max(map(_excess_over_limit, failed)), f"no known cause explains the failed checks: {said}"
    )


def _is_unexplained(row: Mapping[str, Any], causes: set[str]) -> bool:
    """Whether a failed check of the mass has no cause among those found."""
    if row["about"] != "mass" or row["passed"] is not False or row["consequence"] not in _COSTS:
        return False
    accounts = causes & set(_OF_ONE_THING.get(row["check"], causes))
    return not accounts - set(_BEND_NOTHING)


def _value_and_limit_text(row: Mapping[str, Any]) -> str:
    """Value and the limit that it exceeds, as text."""
    if row["value"] is None:
        return "has no value"
    low, high = row["minimum"], row["maximum"]
    beyond = low is not None and row["value"] < low
    limit = f"< {low:g}" if beyond or high is None else f"> {high:g}"
    return f"{row['value']:.3g} {limit}"


def _excess_over_limit(row: Mapping[str, Any]) -> float:
    """Value over its limit, as the strength of the symptom."""
    value, limit = row["value"], row["maximum"]
    if value is None or not limit or limit < 0.0:
        return LIMITS.numberless_check_strength
    return max(abs(value / limit), LIMITS.numberless_check_strength)
