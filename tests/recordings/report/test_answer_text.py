"""What an answer is worth, in lines: of a load, of a withheld one, of its budget."""

import polars as pl
import pytest

from analysis import Run
from analysis.model.answer import Answer, make_answer
from analysis.model.verdict import Verdict
from recordings.report.answer_text import (
    advise_to_reduce_uncertainty,
    describe_answer_as_lines,
    describe_load_as_lines,
    make_uncertainty_rows,
)
from recordings.report.shift_text import may_miss_small_loads
from recordings.rrd.recording_texts import make_texts_of_run

LOAD = {
    "mass_kg": 3732.4,
    "u_kg": 24.1,
    "payload_kg": 118.4,
    "payload_u_kg": 27.3,
    "mass_halved_priors_kg": 3730.0,
    "mass_doubled_priors_kg": 3740.5,
    "manoeuvres": 9,
    "scale_unknown": "",
    "braking_left_out": False,
    "withheld_for": "",
}


def test_a_load_is_its_mass_with_interval_its_payload_and_what_other_priors_say():
    assert describe_load_as_lines(LOAD) == [
        "mass 3732 ± 24 kg (standard uncertainty), 95 %: 3685 to 3780 kg, from 9 manoeuvres",
        "payload 118 ± 27 kg",
        "prior sensitivity: 3730 kg (×½) … 3740 kg (×2)",
    ]


def test_one_manoeuvre_is_one_and_without_an_empty_mass_there_is_no_payload():
    lines = describe_load_as_lines(
        {**LOAD, "manoeuvres": 1, "payload_kg": None, "payload_u_kg": None}
    )
    assert lines[0].endswith("from 1 manoeuvre")
    assert not any("payload" in line for line in lines)


def test_a_scale_that_nobody_knows_is_said_to_be_in_no_number():
    (line,) = describe_load_as_lines({**LOAD, "scale_unknown": "force_gain, wheel_radius"})[3:]
    assert line.startswith("± excludes scale error: set force_gain_u, wheel_radius_u_m")


@pytest.mark.parametrize(
    ("stated", "shown"),
    [
        ((4000.0, 0.0), "(3727 ± 24 kg on average, while machine.empty_mass_kg is 4000 kg); "),
        ((4000.0, 200.0), "2 loads taken as empty; "),
        ((3750.0, 0.0), "2 loads taken as empty; "),
        (None, "2 loads taken as empty; "),
    ],
)
def test_empty_loads_that_are_not_as_heavy_as_stated_show_both_masses(stated, shown):
    loads = [
        {**LOAD, "mass_kg": mass_kg, "empty": is_empty}
        for mass_kg, is_empty in ((3722.0, True), (4800.0, False), (3732.0, True))
    ]
    answer = Answer((), loads, (), (), (), 1.0, Verdict(), stated_empty_mass=stated)
    assert shown in describe_answer_as_lines(answer)[1]


def test_braking_that_was_left_out_is_said_to_be():
    (line,) = describe_load_as_lines({**LOAD, "braking_left_out": True})[3:]
    assert "braking was left out" in line


@pytest.mark.parametrize(
    ("why", "said"),
    [
        ("force_delay_s, clock_drift_s", "no mass: force_delay_s, clock_drift_s"),
        (None, "no mass: nothing was fitted"),
    ],
)
def test_a_load_without_a_mass_says_why(why, said):
    assert describe_load_as_lines({**LOAD, "mass_kg": None, "withheld_for": why}) == [said]


class TestBudget:
    def test_a_row_a_source_with_a_bar_as_long_as_its_share(self, drives):
        said = make_answer(drives(60.0))
        assert make_uncertainty_rows(said) == [
            ("const", "common", "40", f"{'█' * 23} 95%", "starts in both directions"),
            ("noise", "random", "9", "█ 5%", "more starts"),
            ("force_gain", "scale", "not known", "", "known loads"),
        ]

    def test_what_is_next_to_nothing_is_not_listed(self, drives):
        run = drives(60.0)
        small = run.frames["budget"].with_columns(share_1=run.frames["budget"]["share_1"] / 200.0)
        rows = make_uncertainty_rows(
            make_answer(Run({**run.frames, "budget": small}, run.provenance))
        )
        assert [row[0] for row in rows] == ["force_gain"]

    def test_the_largest_source_is_what_would_shrink_it_most(self, drives):
        told = advise_to_reduce_uncertainty(make_answer(drives(60.0)))
        assert told is not None
        assert "a constant force (const, 95% of the variance)" in told
        assert told.endswith("starts in both directions")

    def test_a_mass_that_is_too_uncertain_is_withheld_with_its_largest_source(self, drives):
        run = drives(60.0, passed=False)
        failed = run.frames["verdict"]["passed"].eq(False)
        verdict = run.frames["verdict"].with_columns(
            check=pl.when(failed).then(pl.lit("relative_u")).otherwise("check")
        )
        told = advise_to_reduce_uncertainty(
            make_answer(Run({**run.frames, "verdict": verdict}, run.provenance))
        )
        assert told is not None
        assert told.startswith("largest contribution: ")

    def test_a_withheld_answer_has_no_advice_and_no_part_in_the_page(self, drives):
        run = drives(60.0, passed=False)
        assert advise_to_reduce_uncertainty(make_answer(run)) is None
        page = make_texts_of_run(run)["answer"]
        assert "Where the uncertainty comes from" not in page
        assert "by the joint fit" not in page

    def test_the_page_has_budget_and_terms_with_prior_and_posterior(self, drives):
        page = make_texts_of_run(drives(60.0))["answer"]
        assert "## Where the uncertainty comes from" in page
        assert "- **const** (common): 40 kg " in page
        assert "- **lag**, how late the force is: -0.0030 ± 0.0010 s, prior ± 0.02 s; " in page
        assert "u of the mass 1.5 kg" in page
        assert "| joint |" in page


@pytest.mark.parametrize(("least_kg", "is_said"), [(300.0, False), (400.0, True)])
def test_small_loads_may_be_missing_where_half_a_usual_one_would_not_show(least_kg, is_said):
    shift = {"payload_mean_kg": 700.0, "min_detectable_kg": least_kg}
    assert may_miss_small_loads(shift) == is_said
