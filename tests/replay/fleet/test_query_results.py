"""SQL over a fleet: the tables, an order that is always whole, faults in one line."""

from pathlib import Path

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.errors import FleetError
from replay.fleet.gathered_tables import fleet_results
from replay.fleet.query_results import fleet_query, ordered
from tests.one_line import assert_one_line


def test_tables_are_joined_and_summed(kept: Path) -> None:
    found = fleet_query(
        fleet_results(str(kept)),
        "SELECT r.machine, count(*) AS loads, max(l.mass_kg) AS most_kg FROM loads l "
        "JOIN results r ON l.key = r.key WHERE r.can_weigh GROUP BY r.machine",
    )
    assert found["machine"].to_list() == ["unit-01", "unit-02", "unit-03"]
    assert found["loads"].to_list() == [2, 2, 2]
    assert found["most_kg"].is_between(3500.0, 4000.0).all()


@pytest.mark.parametrize(
    ("sql", "whole"),
    [
        ("SELECT a FROM t", 'SELECT a FROM t ORDER BY "a"'),
        ("SELECT a FROM t LIMIT 3", 'SELECT a FROM t ORDER BY "a" LIMIT 3'),
        ("SELECT a FROM t ORDER BY b DESC", 'SELECT a FROM t ORDER BY b DESC, "a"'),
        (
            "SELECT a FROM t order by b limit 2 offset 1",
            'SELECT a FROM t order by b, "a" limit 2 offset 1',
        ),
        (
            "WITH x AS (SELECT a FROM t ORDER BY a LIMIT 5) SELECT a FROM x",
            'WITH x AS (SELECT a FROM t ORDER BY a LIMIT 5) SELECT a FROM x ORDER BY "a"',
        ),
        ("SELECT 'order by' AS a FROM t", "SELECT 'order by' AS a FROM t ORDER BY \"a\""),
    ],
)
def test_the_order_is_made_whole(sql: str, whole: str) -> None:
    assert ordered(sql, ['"a"']).strip() == whole


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), min_size=1, max_size=30))
def test_rows_that_order_by_leaves_equal_are_in_one_order(rows: list[tuple[int, int]]) -> None:
    said = []
    for shuffled in (rows, rows[::-1]):
        frame = pl.DataFrame(shuffled, schema=["a", "b"], orient="row")
        context = pl.SQLContext(t=frame, eager=True)
        said.append(context.execute(ordered("SELECT a, b FROM t ORDER BY a DESC", ['"a"', '"b"'])))
    assert said[0].equals(said[1])


@pytest.mark.parametrize(
    ("sql", "part"),
    [
        ("SELECT * FROM cicles", "did you mean 'cycles'?"),
        ("SELECT nosuch FROM loads", "nosuch"),
        ("SELECT", "tables: loads"),
        ("DELETE FROM loads WHERE", "query:"),
    ],
)
def test_what_is_no_query_is_said_in_one_line(kept: Path, sql: str, part: str) -> None:
    with pytest.raises(FleetError) as fault:
        fleet_query(fleet_results(str(kept)), sql)
    assert part in str(fault.value)
    assert_one_line(fault.value)


def test_a_folder_without_results_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(FleetError, match="fleet run"):
        fleet_results(str(tmp_path))
    with pytest.raises(FleetError, match="no such folder"):
        fleet_results(str(tmp_path / "nowhere"))
