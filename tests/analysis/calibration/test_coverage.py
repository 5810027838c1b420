"""Intervals hold as often as they say, over campaigns at run level: twin of `make calibration`."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration import PLANS, Plan, outcomes, paper_outcomes
from tests.twins import mark_slow_after

#: Campaigns of the paper: a coverage of 0.95 is known to 1.1 % (one deviation).
FEW = 400
#: Campaigns of each plan, by which it is known to 1.4 %.
FEWER = 250


def held(plan, campaigns=FEWER):
    ours, without_u, by_19, alone, _ = outcomes(plan, campaigns, 1).mean(axis=0)
    return ours, without_u, by_19, alone


@pytest.mark.heavy
@pytest.mark.parametrize(
    "plan",
    mark_slow_after(
        1,
        [
            Plan(1, day_known=True),
            Plan(5, references="unequal"),
            Plan(5, references="shared"),
        ],
    ),
    ids=str,
)
def test_calibrated_masses_lie_in_their_intervals(plan):
    ours, without_u, by_19, alone = held(plan)
    assert 0.915 <= without_u <= ours <= 0.985
    # what the paper prints has no such interval, and what a fit of it gives is too narrow
    assert by_19 < 0.92
    assert alone < 0.8


@pytest.mark.heavy
@pytest.mark.parametrize("days", mark_slow_after(1, [2, 3]))
def test_few_days_are_no_excuse(days):
    ours, without_u, _, _ = held(Plan(days, day_kg=25.0))
    assert 0.905 <= without_u <= ours


@pytest.mark.heavy
def test_one_day_alone_says_nothing_of_another():
    assert held(Plan(1, 2, same_day=True))[0] >= 0.915
    assert held(Plan(1, 2))[0] < 0.9


@pytest.mark.heavy
def test_alpha_and_beta_of_the_paper_s_campaign_lie_in_their_intervals():
    found = paper_outcomes(FEW, 2)
    for name in ("54 runs of one reading", "six runs of nine readings"):
        share = found[name][:, :2].mean(axis=0)
        assert (share >= 0.915).all()
        assert (share <= 0.985).all()
    # on single readings noise flattens (19), and its interval shrinks with their number
    assert found["(19) on 54 single runs"][:, 2].mean() == pytest.approx(0.834, abs=0.01)
    assert found["(19) on 54 single runs"][:, 0].mean() < 0.3


@pytest.mark.slow
@pytest.mark.parametrize(("name", "references"), list(PLANS))
def test_intervals_hold_in_every_campaign_of_the_table(name, references):
    if "another day" in name:
        return
    few = name.startswith(("2", "3", "4"))
    ours, without_u, _, _ = held(replace(PLANS[name, references], references=references), 4000)
    assert np.greater_equal([ours, without_u], 0.92 if few else 0.935).all()
    assert few or max(ours, without_u) <= 0.97
