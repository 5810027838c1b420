"""Tables whose time begins at 0 each: in the order given, or refused with both ways to say it."""

from pathlib import Path

import polars as pl
import pytest

from analysis.model.machine import Machine
from estimators.errors import LogError
from recordings import read_recording, write_recording
from replay import load_machine, open_log, run
from replay.inputs.channel_inputs import read_channel_fields_and_losses
from replay.inputs.decode_cache import decode_logs_in_parallel
from replay.inputs.time_line import compute_log_offsets_ns, describe_log_order, sort_logs_by_time
from replay.logs import TimeAxis
from tests.replay.sledge import MACHINE as MACHINE_FILE
from tests.replay.sledge import sledge

MACHINE = Machine.model_validate(
    {
        "machine": {"name": "bus"},
        "log": {"time": "t"},
        "channels": {
            "force_x_N": {"field": "force"},
            "speed_x_m_s": {"field": "speed"},
            "acc_x_m_s2": {"derive": "d/dt speed_x_m_s"},
        },
        "settings": {"forces": {"acceleration": "kinematic"}},
    }
)
WANTED = {"table": ["force", "speed"]}
NS = 10**9
PARTS = ("drive.csv", "imu.parquet")


def table(path: Path, force: float, *, begins_s: float = 0.0, without: str = "") -> Path:
    """Half a minute at 10 Hz."""
    t = begins_s + pl.int_range(300, eager=True) / 10.0
    frame = pl.DataFrame({"t": t, "force": force + 0.0 * t, "speed": 1.0 + 0.0 * t})
    frame.drop(without or []).write_parquet(path)
    return path


def opened(*paths: Path):
    return [open_log(path, time=TimeAxis("t")) for path in paths]


@pytest.mark.parametrize("turned", [False, True])
def test_tables_that_count_from_0_follow_one_another_in_the_order_given(
    tmp_path: Path, turned: bool
) -> None:
    paths = [table(tmp_path / f"{force}.parquet", float(force)) for force in (1, 2, 3)]
    logs = opened(*(paths[::-1] if turned else paths))
    raw, _ = read_channel_fields_and_losses(logs, MACHINE)
    whole = raw["table"]
    assert whole["log_time_ns"].is_sorted()
    assert whole["force"].unique(maintain_order=True).to_list() == [3, 2, 1][:: 1 if turned else -1]
    steps_s = whole["log_time_ns"].diff().drop_nulls() / NS
    # a hole that no gap rule bridges, wherever a table ends
    assert sorted(steps_s)[-3:] == pytest.approx([0.1, 10.0, 10.0])
    (said,) = describe_log_order(compute_log_offsets_ns(logs, WANTED))
    assert said.endswith(f"({', '.join(log.path.name for log in logs)})")


def test_files_that_follow_one_another_have_their_samples_on_one_grid(tmp_path: Path) -> None:
    """Half a step beside it they would be interpolated, with half the noise."""
    begins_s = (0.0, 0.013, 0.05)
    paths = [
        table(tmp_path / f"{number}.parquet", 1.0, begins_s=each)
        for number, each in enumerate(begins_s)
    ]
    raw, _ = read_channel_fields_and_losses(opened(*paths), MACHINE)
    since_ns = raw["table"]["log_time_ns"] - raw["table"]["log_time_ns"].min()
    assert (since_ns % (NS // 10)).unique().to_list() == [0]


DAY_S = 86_400.0


@pytest.mark.parametrize(
    ("begins_s", "offsets_s"),
    [
        pytest.param((DAY_S - 30.0, 0.0), (0.0, DAY_S), id="midnight between two logs"),
        pytest.param(
            (DAY_S - 60.0, DAY_S - 20.0, 15.0), (0.0, 0.0, DAY_S), id="midnight within a log"
        ),
        pytest.param((50_400.0, 25_200.0), (0.0, 0.0), id="logs of a day, the later one first"),
        pytest.param((4_000_000.0, 0.0), (0.0, 4_000_039.9), id="a counter that restarts"),
        pytest.param((100.0, 5_000.0), (0.0, 0.0), id="a counter that goes on"),
        pytest.param((30.0, 0.0), (0.0, 0.0), id="a counter, the later log first"),
        pytest.param((20.0, 0.0), (0.0, 59.9), id="a counter that restarts within the first log"),
    ],
)
def test_logs_whose_times_begin_again_follow_one_another(
    tmp_path: Path, begins_s: tuple[float, ...], offsets_s: tuple[float, ...]
) -> None:
    """The load that was hauled through midnight was two, and the shift began with its end."""
    logs = opened(
        *(table(tmp_path / f"{k}.parquet", 1.0, begins_s=each) for k, each in enumerate(begins_s))
    )
    found = compute_log_offsets_ns(logs, WANTED)
    assert [each / NS for each in found.values()] == pytest.approx(list(offsets_s), abs=0.1)
    assert len(describe_log_order(found)) == any(offsets_s)


@pytest.mark.parametrize(
    ("begins_s", "sorted_s"),
    [
        pytest.param((0.0, DAY_S - 30.0), (DAY_S - 30.0, 0.0), id="through midnight"),
        pytest.param((30_000.0, 5.0), (5.0, 30_000.0), id="in a morning"),
        pytest.param((0.0, DAY_S - 9_000.0), (0.0, DAY_S - 9_000.0), id="in a day"),
        pytest.param((4_000_000.0, 0.0), (4_000_000.0, 0.0), id="a counter that restarts"),
    ],
)
def test_a_shift_through_midnight_is_sorted_by_its_nights(
    tmp_path: Path, begins_s: tuple[float, ...], sorted_s: tuple[float, ...]
) -> None:
    logs = opened(*(table(tmp_path / f"{each}.parquet", 1.0, begins_s=each) for each in begins_s))
    assert [int(log.topics()["start_ns"][0]) / NS for log in sort_logs_by_time(logs, WANTED)] == [
        *sorted_s
    ]


def test_tables_with_a_clock_stay_where_they_are(tmp_path: Path) -> None:
    first = table(tmp_path / "a.parquet", 1.0, begins_s=1.7e9)
    second = table(tmp_path / "b.parquet", 2.0, begins_s=1.7e9 + 40.0)
    logs = opened(first, second)
    assert set(compute_log_offsets_ns(logs, WANTED).values()) == {0}
    assert describe_log_order(compute_log_offsets_ns(logs, WANTED)) == []


def test_a_table_that_is_given_twice_counts_once(tmp_path: Path) -> None:
    path = table(tmp_path / "a.parquet", 1.0)
    raw, _ = read_channel_fields_and_losses(opened(path, path), MACHINE)
    assert raw["table"].height == 300


def test_tables_that_hold_some_in_common_are_refused_in_a_line_with_both_ways(
    tmp_path: Path,
) -> None:
    whole = table(tmp_path / "whole.parquet", 1.0)
    part = table(tmp_path / "part.parquet", 2.0, without="speed")
    with pytest.raises(LogError) as refused:
        read_channel_fields_and_losses(opened(whole, part), MACHINE)
    said = str(refused.value)
    assert "\n" not in said
    assert "whole.parquet" in said
    assert "part.parquet" in said
    assert "consecutive logs with the same" in said
    assert "parallel logs with no common" in said


@pytest.mark.heavy
def test_tables_with_no_column_in_common_are_one_log(tmp_path: Path) -> None:
    machine_file = tmp_path / "sledge.toml"
    machine_file.write_text(MACHINE_FILE)
    machine = load_machine(machine_file)
    whole = sledge()
    whole.write_csv(tmp_path / "whole.csv")
    whole.select("time_s", "force_N").write_csv(tmp_path / "drive.csv")
    # another recorder, at half the rate
    whole.drop("force_N").gather_every(2).write_parquet(tmp_path / "imu.parquet")
    named = [open_log(tmp_path / name, time=TimeAxis("time_s")) for name in PARTS]
    expected = run(open_log(tmp_path / "whole.csv", time=TimeAxis("time_s")), machine)
    for logs in (named, named[::-1], decode_logs_in_parallel(named, machine, tmp_path / "kept")):
        made = run(logs, machine)
        assert {"raw/table/drive", "raw/table/imu"} <= made.frames.keys()
        assert made.provenance.stamps == {"table/drive": "table", "table/imu": "table"}
        (load,), (known,) = (each.frames["loads"].to_dicts() for each in (made, expected))
        assert load["mass_kg"] == pytest.approx(known["mass_kg"], abs=known["u_kg"])
        assert made.provenance.losses == ()
    # what was recorded is replayed by the same machine file
    write_recording(made, tmp_path / "both.rrd")
    assert read_recording(tmp_path / "both.rrd") == made
    again = run(open_log(tmp_path / "both.rrd"), machine)
    assert again.frames["loads"].equals(made.frames["loads"])


def test_a_column_that_no_table_has_is_named_with_those_that_there_are(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in PARTS]
    sledge().select("time_s", "force_N").write_csv(paths[0])
    sledge().select("time_s", "speed_m_s").write_parquet(paths[1])
    (tmp_path / "sledge.toml").write_text(MACHINE_FILE)
    logs = [open_log(path, time=TimeAxis("time_s")) for path in paths]
    with pytest.raises(LogError, match=r"drive\.csv.*imu\.parquet: no column 'acc_m_s2'"):
        run(logs, load_machine(tmp_path / "sledge.toml"))
