"""Two runs with each other's load are named, and nothing else is."""

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from analysis.calibration.line.calibration import Calibration
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.calibration.line.outliers import find_runs_with_swapped_loads
from recordings.calibration.calibration_text import describe_runs_with_swapped_loads
from tests.analysis.calibration.line.test_line_fit import OPTIONS
from tests.twins import mark_slow_after

#: Known loads, all carried once a day.
LOADS_KG = 3200.0 + 250.0 * np.arange(6)
DAYS = 2


def campaign(seed: int, loads_of_runs: Sequence[int], days: int = DAYS) -> Calibration:
    """A line through runs that scatter by 20 kg, days by 10 kg, with the loads that are stated.

    Run k is driven with load k, and again on the next day.
    """
    rng = np.random.default_rng(seed)
    day_kg, rows = rng.normal(0.0, 10.0, days), list[tuple[str, str, str, float, bool]]()
    for run, stated in enumerate(loads_of_runs):
        day, load = divmod(run, LOADS_KG.size)
        mean_kg = 1.06 * LOADS_KG[load] - 50.0 + day_kg[day] + rng.normal(0.0, 20.0)
        for reading_kg in mean_kg + rng.normal(0.0, 15.0, 8):
            rows.append((f"r{run}", f"w{stated}", f"2026-09-{14 + day}", float(reading_kg), True))
    readings = pl.DataFrame(rows, ["run_id", "load_id", "day", "mass_kg", "used"], orient="row")
    names = [f"w{load}" for load in range(LOADS_KG.size)]
    references = pl.DataFrame({"load_id": names, "reference_kg": LOADS_KG})
    return fit_calibration_line(readings, references, np.eye(LOADS_KG.size), OPTIONS)


def with_exchange(first: int, second: int) -> list[int]:
    """Loads of the runs, two of them exchanged."""
    loads = [*range(LOADS_KG.size)] * DAYS
    loads[first], loads[second] = loads[second], loads[first]
    return loads


@pytest.mark.parametrize(("first", "second"), [(1, 3), (0, 7), (8, 9)])
def test_two_exchanged_runs_are_named_and_stay_in_the_fit(first: int, second: int) -> None:
    calibration = campaign(3, with_exchange(first, second))
    found = find_runs_with_swapped_loads(calibration)
    assert found is not None
    assert found.runs == (f"r{first}", f"r{second}")
    assert found.p_1 < 0.01
    assert f"runs 'r{first}' and 'r{second}' may be exchanged" in str(found)
    assert [point.load_id for point in calibration.points if point.run_id == f"r{first}"] == [
        f"w{second % LOADS_KG.size}"
    ]


@pytest.mark.heavy
@pytest.mark.parametrize("seeds", mark_slow_after(1, [range(40), range(40, 400)]))
def test_a_clean_campaign_names_no_exchange(seeds: range) -> None:
    loads = [*range(LOADS_KG.size)] * DAYS
    named = [
        seed for seed in seeds if find_runs_with_swapped_loads(campaign(seed, loads)) is not None
    ]
    assert len(named) <= 0.01 * len(seeds)


def test_a_campaign_of_hundreds_of_runs_is_searched_without_a_fit_of_every_pair() -> None:
    loads = [*range(LOADS_KG.size)] * 40
    assert find_runs_with_swapped_loads(campaign(3, loads, days=40)) is None


def test_one_wrong_load_is_no_exchange() -> None:
    loads = [*range(LOADS_KG.size)] * DAYS
    loads[2] = 4
    assert find_runs_with_swapped_loads(campaign(3, loads)) is None


def test_a_calibration_names_exchanged_runs_and_a_check_by_it_does_not() -> None:
    exchanged = campaign(3, with_exchange(1, 3))
    said = [
        describe_runs_with_swapped_loads(SimpleNamespace(kind=kind, calibration=line))  # pyright: ignore
        for kind, line in (("calibration", exchanged), ("check", exchanged), ("calibration", None))
    ]
    assert [len(each) for each in said] == [1, 0, 0]


def test_three_runs_do_not_show_an_exchange() -> None:
    assert find_runs_with_swapped_loads(campaign(3, [1, 0, 2], days=1)) is None
