"""What a report says about the information gathered for the target uncertainty."""

from dataclasses import replace

import pytest

from analysis.online.online_report import OnlineReport
from replay.follow.report_file import describe_progress_to_target_uncertainty

FIRST = OnlineReport(
    event="manoeuvre",
    unix_ns=0,
    t_s=0.0,
    phase="standstill",
    gate="accepted",
    index_nat=None,
    validity="none_yet",
    mass_kg=None,
    mass_u_kg=None,
    friction_x_N_s_m=None,
    friction_u_N_s_m=None,
    age_s=None,
    manoeuvres=0,
    until_u_kg=40.0,
    percent=0.0,
)


def test_before_the_first_mass_there_is_no_information() -> None:
    said = describe_progress_to_target_uncertainty(FIRST)
    assert said == "0 % of the information for ± 40 kg; needs a start that the gate accepts"


def test_without_a_target_there_is_no_progress() -> None:
    aimless = replace(FIRST, until_u_kg=None, percent=None)
    assert describe_progress_to_target_uncertainty(aimless) == ""


@pytest.mark.parametrize(
    ("manoeuvres", "percent", "missing", "said"),
    [
        (1, 24.6, (3, 2), "25 % of the information for ± 40 kg: present load 3,612.3 ± 80.6 kg "
         "from 1 manoeuvre; needs 1 more start forward and 2 more starts in reverse"),
        (5, 100.0, (0, 0), "100 % of the information for ± 40 kg: present load 3,612.3 ± 80.6 kg "
         "from 5 manoeuvres"),
    ],
)  # fmt: skip
def test_the_present_load_has_its_share_of_the_information(
    manoeuvres: int, percent: float, missing: tuple[int, int], said: str
) -> None:
    report = replace(
        FIRST,
        load_mass_kg=3612.34,
        load_u_kg=80.6,
        load_manoeuvres=manoeuvres,
        percent=percent,
        starts_missing=missing[0],
        reverse_missing=missing[1],
    )
    assert describe_progress_to_target_uncertainty(report) == said
