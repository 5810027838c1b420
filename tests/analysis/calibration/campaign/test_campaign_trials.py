"""What each run of a campaign says by each method."""

import polars as pl
import pytest

from analysis.calibration.campaign.campaign_readings import average_masses_by_method_and_run
from analysis.model.run_record import Provenance, Run

T0 = 1_700_000_000_000_000_000


def replayed(**methods):
    """Each method's rows: (t_ns, mass, std)."""
    frames = {
        f"estimates/{method}": pl.DataFrame(
            rows,
            schema={"t_ns": pl.Int64, "mass_kg": pl.Float64, "mass_std_kg": pl.Float64},
            orient="row",
        )
        for method, rows in methods.items()
    }
    return Run({"gate": pl.DataFrame(), **frames}, Provenance(t0_unix_ns=T0))


RUNS = pl.DataFrame(
    {
        "start_ns": [T0, T0 + 100],
        "end_ns": [T0 + 99, T0 + 199],
        "load_kg": [0.0, 50.0],
        "mass_kg": [3614.0, 3664.0],
    }
)


def masses(table, method):
    return table.filter(method=method)["mass_kg"].to_list()


def test_windows_count_by_what_they_know_and_only_in_their_own_run():
    rows = [(10, 1.0, 1.0), (99, 4.0, 0.5), (100, 7.0, 1.0)]
    table = average_masses_by_method_and_run(replayed(ls=rows), RUNS)
    assert masses(table, "ls") == [pytest.approx((1.0 + 4 * 4.0) / 5.0), 7.0]
    assert table["run"].to_list() == [0, 1]
    assert table["load_kg"].to_list() == [0.0, 50.0]
    assert table["reference_kg"].to_list() == [3614.0, 3664.0]


def test_the_recursive_method_gives_its_last_state_in_the_run():
    table = average_masses_by_method_and_run(
        replayed(rls=[(1, 1.0, 1.0), (2, 4.0, 9.0), (150, 7.0, 1.0)]), RUNS
    )
    assert masses(table, "rls") == [4.0, 7.0]


def test_a_run_without_an_estimate_is_null():
    nowhere = [(500, 1.0, 1.0), (10, None, None)]
    table = average_masses_by_method_and_run(replayed(ls=nowhere, pooled=[]), RUNS)
    assert masses(table, "ls") == [None, None]
    assert masses(table, "pooled") == [None, None]


def test_without_estimates_there_are_no_rows_but_all_columns():
    table = average_masses_by_method_and_run(Run({}), RUNS)
    assert table.height == 0
    assert table.columns == ["method", "run", "load_kg", "reference_kg", "mass_kg"]
