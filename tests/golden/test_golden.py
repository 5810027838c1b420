"""Small logs give the results that they gave before."""

import json
from dataclasses import replace

import polars as pl
import pytest

from analysis import Run
from tests.golden.golden import (
    LOGS,
    MARGIN_NAT,
    UPDATE,
    differences,
    margin,
    reference,
    reference_path,
    replay,
    value_differences,
)


@pytest.mark.parametrize("log", LOGS)
def test_a_golden_log_gives_the_results_that_are_kept(log: str) -> None:
    kept = json.loads(reference_path(log).read_text(encoding="utf-8"))
    found = list(differences(replay(log), kept))
    assert not found, "\n".join([*found, f"if that is meant, keep it: {UPDATE}"])


@pytest.fixture(scope="module")
def table() -> Run:
    return replay("table.csv")


def test_no_index_lies_so_near_its_threshold_that_a_processor_decides(table: Run) -> None:
    assert margin(table) > MARGIN_NAT


def changed(run: Run, frame: str, **columns: pl.Expr) -> Run:
    return replace(run, frames={**run.frames, frame: run.frames[frame].with_columns(**columns)})


@pytest.mark.parametrize(
    ("frame", "columns", "said"),
    [
        ("masses", {"mass_kg": pl.col("mass_kg") * (1 + 2e-9)}, "mass_kg in row 0"),
        ("gate", {"accepted_x": ~pl.col("accepted_x")}, "accepted_x in row"),
        ("segments", {"extra": pl.lit(1.0)}, "columns"),
        ("estimates/ls", {"mass_kg": pl.lit(None)}, "is None"),
    ],
)
def test_more_than_another_processor_may_change_is_a_difference(
    table: Run, frame: str, columns: dict[str, pl.Expr], said: str
) -> None:
    kept = json.loads(json.dumps(reference(table)))
    assert list(value_differences(table, kept)) == []
    found = list(value_differences(changed(table, frame, **columns), kept))
    assert any(line.startswith(frame) and said in line for line in found), found


def test_one_bit_is_a_difference_on_the_processor_that_the_results_are_of(table: Run) -> None:
    kept = json.loads(json.dumps(reference(table)))
    nudged = changed(table, "masses", mass_kg=pl.col("mass_kg") * (1 + 2.3e-16)).with_fingerprint()
    assert list(differences(nudged, kept)) == [
        "masses: not bit for bit as on this processor before"
    ]
    elsewhere = {**kept, "made_on": {**kept["made_on"], "processor": "another"}}
    assert list(differences(nudged, elsewhere)) == []
