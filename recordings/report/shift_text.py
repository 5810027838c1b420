"""Describe the result of a shift in one sentence, for page, terminal and recording."""

from collections.abc import Mapping
from typing import Any, Final

from estimators.errors import format_count
from recordings.report.number_text import SCALE_NOT_KNOWN
from recordings.report.report_limits import LIMITS

#: Coverage factor of an interval with a confidence of 95 %.
K: Final = 2.0


def describe_shift_payload(shift: Mapping[str, Any]) -> str:
    """Describe the payload of a shift, which must have at least one counted cycle.

    Args:
        shift: row of the frame `shift`.
    """
    loads = format_count(shift["cycles_counted"], "load")
    answer = f"{format_tonnes(shift['payload_kg'], K * shift['payload_u_kg'])} in {loads}"
    scale = f", {SCALE_NOT_KNOWN}" if shift["scale_unknown"] else ""
    if not does_total_include_uncounted_loads(shift):
        return answer + scale
    whole = format_tonnes(shift["total_kg"], K * shift["total_u_kg"])
    return f"{whole} in the shift: {answer} counted{scale}"


def describe_min_detectable_load(shift: Mapping[str, Any]) -> str:
    """Say below which mass loads count as empty; empty for a recording of an earlier version."""
    least_kg = shift.get("min_detectable_kg")
    if least_kg is None:
        return ""
    return f"loads below about {float(f'{least_kg:.2g}'):,.0f} kg count as empty"


def may_miss_small_loads(shift: Mapping[str, Any]) -> bool:
    """Whether loads of half the mean payload may count as empty."""
    return (shift.get("min_detectable_kg") or 0.0) > LIMITS.missed_load_fraction * (
        shift["payload_mean_kg"] or 0.0
    )


def format_tonnes(mass_kg: float, u_kg: float) -> str:
    """Format a mass in t with its expanded uncertainty, to the significant digits."""
    digits = 1 if u_kg >= 3000.0 else 2 if u_kg >= 300.0 else 3
    return f"{mass_kg / 1e3:,.{digits}f} ± {u_kg / 1e3:,.{digits}f} t"


def does_total_include_uncounted_loads(shift: Mapping[str, Any]) -> bool:
    """Whether the shift's total includes more than the counted loads."""
    parts = ("uncounted_kg", "uncounted_u_kg", "lost_kg", "lost_u_kg")
    return any((shift[name] or 0.0) > 0.0 for name in parts)
