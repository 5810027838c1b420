"""Times that name no zone, of a zone that sets its clocks forward and back."""

from pathlib import Path

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.errors import LogError
from replay import open_log
from replay.logs.tables import TableHints, TimeAxis, TimeError
from replay.logs.tables.dates import convert_local_times_to_utc

SECOND_NS = 10**9
#: Clocks in Berlin go from 3:00 to 2:00 at 1:00 UTC of 25 October 2026.
SET_BACK_S = 1_792_890_000
BERLIN = "Europe/Berlin"


def make_local_times(utc: pl.Series) -> pl.Series:
    """The same moments as a clock in Berlin shows them."""
    local = utc.cast(pl.Datetime("ns", "UTC")).dt.convert_time_zone(BERLIN)
    return local.dt.replace_time_zone(None)


@given(
    begins_s=st.integers(-9_000, 9_000),
    step_s=st.integers(1, 900),
    rows=st.integers(2, 200),
)
def test_a_clock_of_the_zone_is_followed_through_its_change(
    begins_s: int, step_s: int, rows: int
) -> None:
    utc = (pl.int_range(rows, eager=True) * step_s + begins_s + SET_BACK_S) * SECOND_NS
    found = convert_local_times_to_utc(make_local_times(utc).cast(pl.Int64), BERLIN)
    ends_s = begins_s + (rows - 1) * step_s
    if begins_s >= 0 and ends_s < 3_600:
        # within the second hour alone, nothing shows which one it is
        utc = utc - 3_600 * SECOND_NS
    assert found.to_list() == utc.to_list()


def test_a_table_is_of_the_zone_that_is_given(tmp_path: Path) -> None:
    utc = (pl.int_range(9_000, eager=True) + SET_BACK_S - 4_000) * SECOND_NS
    path = tmp_path / "night.csv"
    times = make_local_times(utc).dt.strftime("%Y-%m-%d %H:%M:%S")
    pl.DataFrame({"time": times, "speed": range(9_000)}).write_csv(path)

    set_back = r"a clock that is set back \(\[log\] timezone\)"
    with open_log(path) as log, pytest.raises(LogError, match=set_back):
        log.read("table", ["speed"])
    with open_log(path, time=TimeAxis(None, None, TableHints(timezone=BERLIN))) as log:
        frame = log.read("table", ["speed"])
        assert frame["log_time_ns"].to_list() == utc.to_list()
        assert f"the times name no zone: they are taken as {BERLIN}" in " ".join(log.notes())


def test_rows_without_a_time_leave_the_second_hour_whole() -> None:
    utc = (pl.int_range(9_000, eager=True) + SET_BACK_S - 4_000) * SECOND_NS
    missing = pl.int_range(9_000, eager=True).is_in([3_000, 5_500, 5_501])
    local = make_local_times(utc).cast(pl.Int64).set(missing, None)
    found = convert_local_times_to_utc(local, BERLIN)
    assert found.to_list() == utc.set(missing, None).to_list()


@pytest.mark.parametrize("disorder", ["shuffled", "descending"])
def test_rows_out_of_order_do_not_tell_the_two_hours(disorder: str) -> None:
    utc = (pl.int_range(9_000, eager=True) + SET_BACK_S - 4_000) * SECOND_NS
    local = make_local_times(utc).cast(pl.Int64)
    local = local.reverse() if disorder == "descending" else local.shuffle(seed=1)
    with pytest.raises(TimeError, match="not in recorded order"):
        convert_local_times_to_utc(local, BERLIN)


def test_times_that_a_zone_skips_are_refused() -> None:
    skipped = pl.Series([1_774_749_600 * SECOND_NS])  # 29 March 2026, 2:00 by the clock
    with pytest.raises(TimeError, match="2026-03-29 02:00:00 does not exist in Europe/Berlin"):
        convert_local_times_to_utc(skipped, BERLIN)
