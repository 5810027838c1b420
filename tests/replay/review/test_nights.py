"""Whole reviews of nights: a clock set back or forward, midnight, a reader in another zone."""

import datetime as dt
import time
from pathlib import Path
from zoneinfo import ZoneInfo

import openpyxl
import polars as pl
import pytest

from analysis.simulation import Scenario
from replay.review.review_shift import ReviewOptions, review_shift
from replay.simulation.simulate_logs import make_paths_of_simulated_logs, simulate_scenario_to_logs
from tests.replay.shift_review import CHANNELS, SCENARIO
from tests.replay.sledge import Payscope
from tests.twins import mark_slow_after

SHIPPED = Path(__file__).resolve().parents[3] / "replay/machines/cat262c.toml"
BERLIN = ZoneInfo("Europe/Berlin")
#: When the log begins, and the hours that its loads are dumped in, by the clock in Berlin.
NIGHTS = {
    "clock set back": ("2026-10-25T00:55:30Z", ["02:00 +02:00", "02:00 +01:00"]),
    "over midnight": (
        "2026-06-30T21:55:30Z",
        ["2026-06-30 23:00 +02:00", "2026-07-01 00:00 +02:00"],
    ),
    "clock set forward": ("2026-03-29T00:55:30Z", ["01:00 +01:00", "03:00 +02:00"]),
}


@pytest.fixture(scope="module", params=mark_slow_after(2, NIGHTS), ids=list(NIGHTS))
def night(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, str, list[str]]:
    """The review of a machine in Berlin, its beginning and its hours."""
    begins, hours = NIGHTS[request.param]
    folder = tmp_path_factory.mktemp("night")
    start_s = dt.datetime.fromisoformat(begins).timestamp()
    plain = SCENARIO.model_dump(exclude_defaults=True)
    scenario = Scenario.model_validate(plain | {"log": {"start_unix_s": start_s}})
    simulate_scenario_to_logs(scenario, folder / "shift.mcap")
    machine = folder / "night.toml"
    text = SHIPPED.read_text(encoding="utf-8")
    zone = next(line for line in text.splitlines() if line.startswith("timezone"))
    machine.write_text(text.replace(zone, 'timezone = "Europe/Berlin"') + CHANNELS, "utf-8")
    with pytest.MonkeyPatch.context() as reader:
        reader.setenv("TZ", "America/Denver")
        time.tzset()
        logs = make_paths_of_simulated_logs(scenario, folder / "shift.mcap")
        made = review_shift(logs, machine, folder / "review", ReviewOptions())
    time.tzset()
    return made.folder, begins, hours


@pytest.mark.heavy
def test_no_two_loads_have_one_time_and_each_is_the_clocks_in_berlin(
    night: tuple[Path, str, list[str]],
) -> None:
    rows = pl.read_parquet(night[0] / "ledger.parquet")
    assert rows["local_time"].n_unique() == rows.height >= 4
    for unix_ns, text in rows.select("end_unix_ns", "local_time").iter_rows():
        local = dt.datetime.fromtimestamp(unix_ns // 10**9, BERLIN)
        assert text.endswith(f"{local:%H:%M:%S} {local:%z}"[:-2] + ":00")


def test_the_page_has_both_hours_in_their_order(night: tuple[Path, str, list[str]]) -> None:
    page = (night[0] / "review.html").read_text(encoding="utf-8")
    hours = page[page.index('id="hours"') :]
    places = [hours.index(f'<th scope="row">{hour}</th>') for hour in night[2]]
    assert places == sorted(places)


def test_the_workbook_goes_on_in_utc_where_the_wall_clock_jumps(
    night: tuple[Path, str, list[str]],
) -> None:
    sheet = openpyxl.load_workbook(night[0] / "ledger.xlsx")["ledger"]
    heads, _, *rows = sheet.iter_rows(values_only=True)
    found = [dict(zip(heads, row, strict=True)) for row in rows]
    utc = [row["UTC"] for row in found]
    assert utc == sorted(utc)
    for row in found:
        assert row["local time"] - dt.timedelta(hours=row["offset from UTC"]) == row["UTC"]


def test_a_load_is_rejected_by_its_wall_time_with_offset(
    night: tuple[Path, str, list[str]], payscope: Payscope
) -> None:
    rows = pl.read_parquet(night[0] / "ledger.parquet").filter("counted")
    when = rows["local_time"][-1].split(" ")[-2:]
    done = payscope("review", str(night[0]), "--reject", "".join(when), "--author", "M")
    assert done.status == 0, done.err
    after = pl.read_parquet(night[0] / "ledger.parquet")
    assert after.filter("rejected")["id"].to_list() == [rows["id"][-1]]


def test_the_week_has_the_loads_of_each_day(
    night: tuple[Path, str, list[str]], payscope: Payscope
) -> None:
    done = payscope("review", "--week", str(night[0]))
    rows = pl.read_parquet(night[0] / "ledger.parquet")
    days = {
        f"{dt.datetime.fromtimestamp(ns // 10**9, BERLIN):%Y-%m-%d}" for ns in rows["end_unix_ns"]
    }
    for day in days:
        assert f"day {day}: " in done.out
