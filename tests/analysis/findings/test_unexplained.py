"""A failed check always has a finding: the causes that account for it, or the unknown one."""

import polars as pl
import pytest

from analysis.diagnosis import CHECKS
from analysis.diagnosis.check_row import CheckRow
from analysis.findings import CAUSES
from analysis.findings.unexplained import make_unexplained_symptom
from analysis.model.schema import build_frame

#: Of what costs the mass something; those that tell alone name their own reason.
COSTS = [row for row in CHECKS if row.about == "mass" and row.consequence in ("withhold", "widen")]


def failing(*names: str) -> pl.DataFrame:
    """The verdict of a log that fails these checks alone."""
    rows = [row for row in CHECKS if row.about == "mass"]
    limits = {"minimum": pl.Float64, "maximum": pl.Float64}
    frame = pl.DataFrame(
        {
            "check": [row.name for row in rows],
            "about": [row.about for row in rows],
            "value": [9.0] * len(rows),
            "minimum": [None] * len(rows),
            "maximum": [1.0] * len(rows),
            "passed": [row.name not in names for row in rows],
            "meaning": [row.meaning for row in rows],
            "consequence": [row.consequence for row in rows],
            "remedy": [row.remedy for row in rows],
        },
        schema_overrides=limits,
    )
    return build_frame("verdict", frame.to_dict())


@pytest.mark.parametrize("row", COSTS, ids=lambda row: row.name)
def test_each_check_that_fails_alone_is_what_disagrees(row: CheckRow) -> None:
    found = make_unexplained_symptom(failing(row.name), ())
    assert found is not None
    assert found.strength == 9.0
    assert f"{row.name} 9 > 1: {row.meaning}" in found.evidence


def test_what_a_cause_accounts_for_is_said_once() -> None:
    assert make_unexplained_symptom(failing("wheel_imu_gain_error"), ("wheel_radius",)) is None
    assert make_unexplained_symptom(failing("frozen_s"), ("frozen",)) is None


def test_a_cause_of_something_else_accounts_for_nothing() -> None:
    unrelated = {
        "frozen_s": "delay",
        "imu_tilt_deg": "coulomb",
        "wheel_imu_gain_error": "quantised",
    }
    for check, cause in unrelated.items():
        found = make_unexplained_symptom(failing(check), (cause,))
        assert found is not None
        assert check in found.evidence


def test_a_cause_that_hardly_moves_the_mass_accounts_only_for_what_it_names() -> None:
    shown, mattering = ("delay", "coulomb"), ("coulomb",)
    assert make_unexplained_symptom(failing("force_delay_s"), shown, mattering) is None
    assert make_unexplained_symptom(failing("common_misfit"), shown, mattering) is None
    found = make_unexplained_symptom(failing("common_misfit"), shown, ())
    assert found is not None
    assert "common_misfit" in found.evidence


def test_a_log_that_passes_has_no_unknown_cause() -> None:
    assert make_unexplained_symptom(failing(), ()) is None
    passing = failing("disagreeing_methods", "gating_bias", "constant_force")
    assert make_unexplained_symptom(passing, ()) is None


def test_every_check_has_a_cause_that_accounts_for_it() -> None:
    every = tuple(cause.key for cause in CAUSES)
    assert make_unexplained_symptom(failing(*(row.name for row in COSTS)), every) is None
