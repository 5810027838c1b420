"""Which load to run next."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from analysis.calibration.line.calibration import CalibrationOptions
from analysis.calibration.line.calibration_budget import rank_loads_for_next_run
from analysis.calibration.line.line_fit import fit_calibration_line
from recordings.calibration.calibration_text import describe_next_load
from tests.analysis.calibration.campaigns import readings, references


def fitted(rows, **options):
    told = CalibrationOptions("joint_mass", **options)
    return fit_calibration_line(rows, references(), np.eye(6), told)


def test_an_even_campaign_wants_one_of_its_ends():
    ranked = rank_loads_for_next_run(fitted(readings(days=1, runs=2)))
    assert {one.load_id for one in ranked[:2]} == {"load 0", "load 5"}
    assert all(one.determinant_1 < 1.0 for one in ranked)
    assert [one.determinant_1 for one in ranked] == sorted(one.determinant_1 for one in ranked)


def test_a_campaign_without_heavy_loads_wants_the_heaviest():
    rows = readings(days=1, runs=2).filter(pl.col("load_id").is_in(["load 0", "load 1", "load 2"]))
    best, *_ = rank_loads_for_next_run(fitted(rows))
    assert best.load_id == "load 5"
    # its range reaches to the heaviest reference, where the interval is widest now
    assert best.half_width_kg < 0.8 * best.half_width_now_kg


def test_now_is_the_calibration_as_it_stands():
    calibration = fitted(readings(days=5))
    (best, *_) = rank_loads_for_next_run(calibration)
    inversion = calibration.inversion
    widest = max(inversion.compute_half_interval_kg(3614.0 + 50.0 * k, 0.95, 4.0) for k in range(6))
    assert best.half_width_now_kg == pytest.approx(widest, rel=1e-5)


def test_a_run_of_another_day_is_worth_more_than_one_of_the_same():
    calibration = fitted(readings(days=3, deviations=(10.0, 3.0, 20.0)))
    new, same = (
        rank_loads_for_next_run(calibration)[0],
        rank_loads_for_next_run(calibration, is_on_last_campaign_day=True)[0],
    )
    assert new.half_width_kg < same.half_width_kg


@pytest.mark.heavy
def test_a_run_is_worth_what_it_then_is_on_the_average():
    """The promised determinant is that of campaigns that have the run."""
    promised, found = [], []
    for seed in range(40):
        rows = readings(seed, days=1, runs=2, deviations=(10.0, 0.0, 0.0))
        short = rows.filter(pl.col("run_id") != "0/5/1")
        before = fitted(short, day_known_kg=0.1)
        (at_5,) = (
            x
            for x in rank_loads_for_next_run(before, is_on_last_campaign_day=True)
            if x.load_id == "load 5"
        )
        after = fitted(rows, day_known_kg=0.1)
        promised.append(at_5.determinant_1)
        now = np.array(before.covariance)
        then = np.array(after.covariance)
        found.append((then[0] * then[2] - then[1] ** 2) / (now[0] * now[2] - now[1] ** 2))
    assert np.median(found) == pytest.approx(np.median(promised), rel=0.1)


def test_a_run_that_would_not_narrow_the_interval_is_not_recommended():
    best, *_ = rank_loads_for_next_run(fitted(readings(days=1, runs=2)))
    assert f"one more run with '{best.load_id}'" in describe_next_load(best)
    wider = replace(best, half_width_kg=1.1 * best.half_width_now_kg)
    assert "check the entered masses" in describe_next_load(wider)
