"""Sentences follow the numbers that they are made of."""

from functools import cache

import polars as pl
import pytest

from analysis.paper.paper_excitation import integrate_steady_drive
from analysis.paper.simulated_sources import Extract, RepetitionResults, SteadyStudy
from analysis.paper.table1 import AT_LENGTH, RAW_UNITS, Table1, make_table_1_mass_errors
from analysis.simulation import Scenario
from analysis.simulation.scenario.scenario import SimulatedSensors
from recordings.paper import item_sentences
from tests.twins import mark_slow_after


@cache
def simulated(windows: int) -> dict[Extract[SteadyStudy, pl.DataFrame], pl.DataFrame]:
    study = SteadyStudy(integrate_steady_drive(Scenario()), SimulatedSensors(), windows)
    return {extract: extract.make(study) for extract in (*AT_LENGTH.values(), RAW_UNITS)}


def found(windows: int, further: float) -> Table1:
    """Table 1 of so many windows, its errors further from the bound by this share."""
    extracts = RepetitionResults()
    for extract, frame in simulated(windows).items():
        extracts.add_result_of_repetition(
            extract, frame.with_columns(pl.col("over_bound_1") * (1.0 + further))
        )
    return make_table_1_mass_errors(extracts)


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("windows", "further", "says"),
    mark_slow_after(
        1,
        [
            (2, 0.0, "so few windows cannot tell whether LS and TLS on scaled columns reach"),
            (100, 0.0, "LS and TLS on scaled columns reach the Cramér–Rao bound"),
            (100, 0.6, "LS and TLS on scaled columns do not reach the Cramér–Rao bound"),
        ],
    ),
)
def test_the_bound_is_said_to_be_reached_only_where_the_windows_can_tell(
    windows: int, further: float, says: str
) -> None:
    (sentence,) = [
        line
        for line in item_sentences.make_mass_error_table_sentences(found(windows, further)).findings
        if "reach the Cramér–Rao bound" in line
    ]
    assert sentence.startswith(f"From 5 s on {says}")
