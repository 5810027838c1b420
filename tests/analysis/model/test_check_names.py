"""Checks that had another name: stored texts and frames are read with the present one."""

import polars as pl
import pytest

from analysis.diagnosis import CHECKS
from analysis.model.check_names import (
    PRESENT_NAMES,
    rename_stored_checks,
    replace_former_check_names,
    replace_former_names_in_evidence,
)

UNEXPLAINED = "no known cause explains the failed checks: "


def test_every_former_name_leads_to_a_check_there_is() -> None:
    checks = {row.name for row in CHECKS} | {"invalidating_causes"}
    assert set(PRESENT_NAMES.values()) <= checks
    assert not set(PRESENT_NAMES) & checks
    assert len(set(PRESENT_NAMES.values())) == len(PRESENT_NAMES)


@pytest.mark.parametrize(
    ("stored", "now"),
    [
        ("lag", "force_delay_s"),
        ("relative_std, lag_v, wheels", "relative_std, speed_delay_s, wheel_imu_residual"),
        ("this log cannot weigh: causes", "this log cannot weigh: invalidating_causes"),
        ("force_delay_s", "force_delay_s"),
        ("", ""),
        # what a person wrote, or a sentence
        ("excluded: braking, gain", "excluded: braking, gain"),
        ("the mass differs, braking", "the mass differs, braking"),
    ],
)
def test_a_list_of_checks_has_the_present_names(stored: str, now: str) -> None:
    assert replace_former_check_names(stored) == now
    assert replace_former_check_names(now) == now


def test_the_evidence_of_an_unknown_cause_has_the_present_names() -> None:
    stored = f"{UNEXPLAINED}gain 0.05 > 0.01: the gain; lag is late; aa has no value: a force"
    now = stored.replace(": gain", ": wheel_imu_gain_error").replace("aa", "force_nonlinearity")
    assert replace_former_names_in_evidence(stored) == now
    assert replace_former_names_in_evidence(f"unknown: {stored}") == f"unknown: {now}"
    assert replace_former_names_in_evidence("lag 0.2 > 0.1") == "lag 0.2 > 0.1"


@pytest.mark.parametrize(
    ("frame", "column", "stored", "now"),
    [
        ("verdict", "check", "gated", "gating_bias"),
        ("loads", "withheld_for", "r_squared, lag", "r_squared, force_delay_s"),
        ("cycles", "withheld_for", "lag", "force_delay_s"),
        ("results", "failed_checks", "direction", "coulomb_friction"),
        ("findings", "evidence", f"{UNEXPLAINED}lag 1 > 0", f"{UNEXPLAINED}force_delay_s 1 > 0"),
        ("nuisances", "term", "lag", "lag"),
        ("budget", "cause", "gain", "gain"),
    ],
)
def test_a_stored_frame_has_the_present_names(
    frame: str, column: str, stored: str, now: str
) -> None:
    rows = pl.DataFrame({column: [stored, None, "r_squared"], "of": [1, 2, 3]})
    expected = rows.with_columns(pl.Series(column, [now, None, "r_squared"]))
    assert rename_stored_checks(frame, rows).equals(expected)
    assert rename_stored_checks(frame, rows.lazy()).collect().equals(expected)
    assert rename_stored_checks(frame, rows.select("of")).equals(rows.select("of"))
    assert rename_stored_checks(frame, rows.clear()).schema == rows.schema
