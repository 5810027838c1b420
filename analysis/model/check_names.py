"""Former names of checks, which are replaced by the present names when stored data are read.

Signed or fingerprinted files are not changed; only the values read from them have present names.
"""

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final, TypeVar

import polars as pl

#: Present name of a check by its former name.
PRESENT_NAMES: Final[Mapping[str, str]] = {
    "aa": "force_nonlinearity",
    "beyond_prior": "term_beyond_prior",
    "braking": "braking_bias",
    "causes": "invalidating_causes",
    "clipped": "clipped_share",
    "clocks": "clock_drift_s",
    "const": "constant_force",
    "direction": "coulomb_friction",
    "frozen": "frozen_s",
    "gain": "wheel_imu_gain_error",
    "gated": "gating_bias",
    "imu_tilt": "imu_tilt_deg",
    "lag": "force_delay_s",
    "lag_v": "speed_delay_s",
    "methods": "disagreeing_methods",
    "misfit": "common_misfit",
    "one_sided": "one_sided_torque",
    "quadratic": "quadratic_drag",
    "scatter": "manoeuvre_scatter",
    "sides": "side_difference",
    "spin_centre": "spin_centre_m",
    "wheels": "wheel_imu_residual",
}
#: Start of the reason why a reading of a campaign has no mass; the checks follow.
_CANNOT_WEIGH: Final = "this log cannot weigh: "
#: Start of the evidence of an unknown cause; the checks follow.
_UNEXPLAINED: Final = "no known cause explains the failed checks: "
#: Name of a check, at the start or after "; ", before its value and limit.
_NAME_WITH_VALUE: Final = re.compile(r"(^|; )(\w+)(?= has no value| [-+.\deinf]+ [<>] )")

Rows = TypeVar("Rows", pl.DataFrame, pl.LazyFrame)


def replace_former_check_names(text: str) -> str:
    """Replace former names in a list of checks.

    Args:
        text: names of checks, separated by commas, or the reason of a reading that ends with them.

    Returns:
        The text with the present names; any other text unchanged.
    """
    before = _CANNOT_WEIGH if text.startswith(_CANNOT_WEIGH) else ""
    names = text.removeprefix(before).split(", ")
    if not all(name.isidentifier() for name in names):
        return text
    return before + ", ".join(PRESENT_NAMES.get(name, name) for name in names)


def replace_former_names_in_evidence(text: str) -> str:
    """Evidence text of a finding with present names of checks; unchanged if it names none."""
    before, mark, checks = text.partition(_UNEXPLAINED)
    return before + mark + _NAME_WITH_VALUE.sub(_replace_matched_name, checks) if mark else text


def _replace_matched_name(match: re.Match[str]) -> str:
    return match[1] + PRESENT_NAMES.get(match[2], match[2])


#: By frame or table: its column with names of checks, and the function that replaces them.
_COLUMNS: Final[Mapping[str, tuple[str, Callable[[str], str]]]] = {
    "verdict": ("check", replace_former_check_names),
    "loads": ("withheld_for", replace_former_check_names),
    "cycles": ("withheld_for", replace_former_check_names),
    "findings": ("evidence", replace_former_names_in_evidence),
    "results": ("failed_checks", replace_former_check_names),
}


def rename_stored_checks(frame_name: str, rows: Rows) -> Rows:
    """Replace former names of checks in a stored frame or table.

    Args:
        frame_name: name of the frame, or of the table of a fleet.
        rows: rows of the frame or table, with all or some of its columns.

    Returns:
        The rows with the present names.
    """
    column, rename = _COLUMNS.get(frame_name, ("", replace_former_check_names))
    if column not in rows.lazy().collect_schema():
        return rows
    return rows.with_columns(
        pl.col(column).map_batches(
            partial(_rename_checks_in_texts, rename), return_dtype=pl.String, is_elementwise=True
        )
    )


def _rename_checks_in_texts(rename_check: Callable[[str], str], texts: pl.Series) -> pl.Series:
    known = {text: rename_check(text) for text in texts.drop_nulls().unique().to_list()}
    changed = {text: now for text, now in known.items() if text != now}
    return texts.replace(changed) if changed else texts
