"""SQL over a fleet: the tables, faults in one line."""

from pathlib import Path

import pytest

from estimators.errors import FleetError, QueryError
from replay.fleet.gathered_tables import open_results_of_fleet, query_fleet_tables
from replay.query.run_query import prepare_query_of_sources
from tests.one_line import assert_one_line


def test_tables_are_joined_and_summed(kept: Path) -> None:
    found = query_fleet_tables(
        open_results_of_fleet(str(kept)),
        "SELECT r.machine, count(*) AS loads, max(l.mass_kg) AS most_kg FROM loads l "
        "JOIN results r ON l.key = r.key WHERE r.can_weigh GROUP BY r.machine",
    )
    assert found["machine"].to_list() == ["unit-01", "unit-02", "unit-03"]
    assert found["loads"].to_list() == [2, 2, 2]
    assert found["most_kg"].is_between(3500.0, 4000.0).all()


def test_query_takes_results_too_and_opens_their_moments(kept: Path) -> None:
    sql = "SELECT key, at_s FROM segments WHERE samples_accepted > 0"
    found = prepare_query_of_sources([str(kept)], sql).collect_rows(merge_within_s=5.0)
    assert found["key"].n_unique() == 6
    first = found.row(0, named=True)
    assert first["opens"] == (
        f"payscope fleet open {kept} {first['key'][:12]} --at {first['from_s']:.3f}"
    )


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
    with pytest.raises(QueryError) as fault:
        query_fleet_tables(open_results_of_fleet(str(kept)), sql)
    assert part in str(fault.value)
    assert_one_line(fault.value)


def test_a_folder_without_results_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(FleetError, match="fleet run"):
        open_results_of_fleet(str(tmp_path))
    with pytest.raises(FleetError, match="no such folder"):
        open_results_of_fleet(str(tmp_path / "nowhere"))
