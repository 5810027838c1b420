"""A cause that hides the others: they stand behind it, as the log shows them once it is mended."""

import polars as pl
import pytest

from analysis.findings import add_masked_findings, cut_to_first_hour
from analysis.model.machine import Machine
from analysis.model.schema import find_frame_declaration
from benchmarks.weighed import machine
from tests.analysis.findings.conftest import Named
from tests.twins import mark_slow_after


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("hides", "size", "other", "cause"),
    mark_slow_after(
        2,
        [
            ("force of the wrong sign", 1.0, ("force offset", 5.0), "offset"),
            # wheels that slip would not tell the unit, gravity does
            ("acceleration in g", 1.0, ("slip", 2.5), "slip"),
            ("accelerometer of the wrong sign", 1.0, ("torque with spikes", 3.0), "spikes"),
            ("speed in km/h", 1.0, ("IMU biased", 4.0), "imu_bias"),
            ("acceleration in g", 1.0, ("force late", 5.0), "delay"),
        ],
    ),
)
def test_behind_a_sign_or_a_unit_stands_what_it_hides(
    named: Named, hides: str, size: float, other: tuple[str, float], cause: str
) -> None:
    found = named((hides, size), other)
    first, second = found.row(0, named=True), found.row(1, named=True)
    assert first["cause"] in {"sign_flipped", "wrong_unit"}
    assert cause in {second["cause"], *second["alternatives"].split(", ")}
    name = first["cause"].replace("_", " ")
    assert second["evidence"].startswith(f"once {name} is corrected: ")
    assert found["rank"].to_list() == list(range(1, found.height + 1))


@pytest.mark.heavy
def test_a_sign_and_a_unit_stand_before_all_else(named: Named) -> None:
    found = named(("accelerometer of the wrong sign", 1.0), ("speed in km/h", 1.0))
    assert found["cause"].to_list() == ["sign_flipped", "wrong_unit"]


LEFT = "channels.torque_left_N_m.scale"


def _found(*causes: str, setting: str | None = "channels.force_x_N.scale") -> pl.DataFrame:
    rows = pl.DataFrame(
        {
            "rank": range(1, len(causes) + 1),
            "cause": causes,
            "setting": [setting] * len(causes),
            "value": ["-1" if setting else None] * len(causes),
            "evidence": ["seen"] * len(causes),
        }
    )
    kept = {column.name: column.dtype for column in find_frame_declaration("findings").columns}
    return pl.concat([pl.DataFrame(schema=kept), rows], how="diagonal_relaxed")


def _never(_: Machine) -> pl.DataFrame:
    raise AssertionError("looked once more")


@pytest.mark.parametrize(
    "found",
    [
        _found(),
        _found("delay"),
        _found("delay", "sign_flipped"),
        _found("sign_flipped", setting=None),
        _found("sign_flipped", setting="settings.gate.exclude_braking"),
    ],
    ids=["nothing", "another", "behind another", "no proposal", "no scale"],
)
def test_what_hides_nothing_or_is_no_scale_is_left_as_it_is(found: pl.DataFrame) -> None:
    assert add_masked_findings(found, machine(()), _never, is_complete_log=True) is found


@pytest.mark.parametrize("again", [_found("sign_flipped", "delay", setting=LEFT), None])
def test_a_proposal_that_does_not_mend_is_not_believed(again: pl.DataFrame | None) -> None:
    looks: list[Machine] = []

    def look(mended: Machine) -> pl.DataFrame | None:
        looks.append(mended)
        return again

    found = _found("sign_flipped", setting=LEFT)
    assert add_masked_findings(found, machine(()), look, is_complete_log=True) is found
    assert [each.channels["torque_left_N_m"].scale for each in looks] == [-1.0]


@pytest.mark.parametrize(
    ("whole", "kept"),
    [(True, ["sign_flipped", "offset"]), (False, ["sign_flipped", "offset", "gaps"])],
)
def test_what_only_the_whole_log_shows_is_kept(whole: bool, kept: list[str]) -> None:
    found = _found("sign_flipped", "too_little_excitation", "gaps", setting=LEFT)
    both = add_masked_findings(
        found, machine(()), lambda _: _found("offset", setting=None), is_complete_log=whole
    )
    assert both["cause"].to_list() == kept
    assert both["rank"].to_list() == list(range(1, len(kept) + 1))


def test_of_a_long_log_the_first_hour_of_all_topics_is_looked_at_once_more() -> None:
    hours = pl.DataFrame({"log_time_ns": [n * 1_800_000_000_000 for n in range(9)]})
    assert cut_to_first_hour({"a": hours})["a"].height == 2
    late = hours.select(pl.col("log_time_ns") + 7_200_000_000_000)
    part = cut_to_first_hour({"a": hours, "b": late})
    assert (part["a"].height, part["b"].height) == (6, 2)
