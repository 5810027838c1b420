"""A simulated shift as files: several logs of one time line, torn ends, and the truth beside."""

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from rosbags.highlevel import AnyReader

from analysis.simulation import Scenario
from replay import load_machine, open_log, run
from replay.simulation.log_truth import do_logs_have_truth_of_trials
from replay.simulation.scenario_file import format_scenario_file, load_scenario_file
from replay.simulation.simulate_logs import (
    make_paths_of_simulated_logs,
    make_shift_truth_path,
    simulate_scenario_to_logs,
)
from tests.one_line import assert_one_line
from tests.replay.sledge import Payscope, join_to_one_line
from tests.twins import mark_heavy_after

SHIFT = Scenario.model_validate(
    {
        "shift": {
            "duration_h": 0.04,
            "logs": 2,
            "restart_s": 2.0,
            "damaged_logs": 1,
            "damage_share": 0.2,
            "topics": ["boom", "odometry", "gnss"],
        },
        "log": {"dropout_share": 0.01},
    }
)
TOPICS = {
    "/imu/data": 100.0,
    "/wheels/torque": 100.0,
    "/wheels/speed": 100.0,
    "/boom/angles": 100.0,
    "/odometry": 100.0,
    "/gnss/fix": 10.0,
}


def named(folder: Path, suffix: str) -> Path:
    return folder / (f"shift.{suffix}" if suffix else "shift")


def truth_of(output: Path) -> dict[str, Any]:
    return json.loads(make_shift_truth_path(output).read_text(encoding="utf-8"))


@pytest.mark.parametrize("suffix", mark_heavy_after(1, ["bag", "mcap", "db3", ""]))
def test_the_logs_of_a_shift_are_read_as_one_time_line_and_the_torn_one_says_so(
    tmp_path: Path, suffix: str
) -> None:
    output = named(tmp_path, suffix)
    paths = simulate_scenario_to_logs(SHIFT, output)
    assert [path.stem for path in paths] == ["shift_1", "shift_2"]
    truth = truth_of(output)
    assert [each["log"] for each in truth["logs"]] == [path.name for path in paths]
    before_ns = 0
    for path, told in zip(paths, truth["logs"], strict=True):
        with open_log(path) as log:
            assert bool(log.losses()) == (told["torn_share"] > 0.0)
            assert set(log.topics()["topic"]) == set(TOPICS)
            times = log.read("/imu/data", ["linear_acceleration.x"])["header_stamp_ns"]
            first_ns, last_ns = times[0], times[-1]
        assert first_ns >= told["start_ns"] > before_ns
        before_ns = told["end_ns"]
        seconds = (told["end_ns"] - told["start_ns"]) / 1e9
        missing_s = (told["end_ns"] - last_ns) / 1e9
        if told["torn_share"]:
            # an index at the end of the file is lost with it
            assert 0.1 < missing_s < 2.0 * told["torn_share"] * seconds + 2.0
        else:
            assert missing_s < 0.05
    assert sum(told["torn_share"] > 0.0 for told in truth["logs"]) == 1


@pytest.mark.heavy
def test_messages_hold_what_the_machine_has_besides(tmp_path: Path) -> None:
    whole = SHIFT.model_copy(
        update={"shift": SHIFT.shift.model_copy(update={"logs": 1, "damaged_logs": 0})}  # pyright: ignore
    )
    (path,) = simulate_scenario_to_logs(whole, tmp_path / "shift.mcap")
    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    seconds = (truth_of(path)["logs"][0]["end_ns"] - truth_of(path)["logs"][0]["start_ns"]) / 1e9
    for topic, rate_hz in TOPICS.items():
        assert len(found[topic]) == pytest.approx(rate_hz * seconds, rel=0.05)
    boom, odometry, fix = (found[t][100] for t in ("/boom/angles", "/odometry", "/gnss/fix"))
    assert boom.name == ["boom", "bucket"]
    assert len(boom.position) == 2
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert fix.latitude == pytest.approx(49.0, abs=1e-3)
    assert (fix.status.status, fix.status.service) == (0, 1)


def test_the_truth_beside_a_log_has_its_manoeuvres_and_that_of_the_shift_its_cycles(
    tmp_path: Path,
) -> None:
    output = tmp_path / "shift.csv"
    paths = simulate_scenario_to_logs(SHIFT, output)
    truth = truth_of(output)
    cycles = pl.DataFrame(truth["cycles"])
    assert cycles.height >= 1
    assert (cycles["start_ns"] < cycles["dig_ns"]).all()
    assert cycles["first_log"][0] == 0
    assert Scenario.model_validate(truth["scenario"]) == SHIFT
    # which are none of a campaign's trials
    assert not do_logs_have_truth_of_trials(paths)
    for path in paths:
        text = path.with_name(f"{path.name}.truth.json").read_text(encoding="utf-8")
        beside = json.loads(text)
        assert {"start", "rest"} <= {each["kind"] for each in beside["manoeuvres"]}
        assert beside["runs"] == []


def test_a_shift_in_one_log_has_its_name(tmp_path: Path) -> None:
    one = Scenario.model_validate({"shift": {}})
    assert make_paths_of_simulated_logs(one, tmp_path / "day.bag") == [tmp_path / "day.bag"]
    ten = Scenario.model_validate({"shift": {"logs": 10}})
    assert make_paths_of_simulated_logs(ten, Path("day"))[0] == Path("day_01")


def test_the_same_shift_is_written_with_the_same_bytes(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        simulate_scenario_to_logs(SHIFT, tmp_path / folder / "shift.bag")
    files = [{p.name: p.read_bytes() for p in (tmp_path / f).iterdir()} for f in ("a", "b")]
    assert files[0] == files[1]


def test_a_scenario_file_of_a_shift_reads_back(tmp_path: Path) -> None:
    for scenario in (SHIFT, Scenario.model_validate({"shift": {}})):
        path = tmp_path / "shift.toml"
        path.write_text(format_scenario_file(scenario), encoding="utf-8")
        assert load_scenario_file(path) == scenario


@pytest.mark.heavy
def test_a_shift_is_replayed(tmp_path: Path) -> None:
    paths = simulate_scenario_to_logs(SHIFT, tmp_path / "shift.bag")
    with ExitStack() as stack:
        logs = [stack.enter_context(open_log(path)) for path in paths]
        made = run(logs, load_machine("cat262c.toml"))
    assert made.frames["segments"].height > 3


class TestCommand:
    def test_logs_and_truth_of_a_shift(self, payscope: Payscope, tmp_path: Path) -> None:
        scenario = tmp_path / "shift.toml"
        scenario.write_text("[shift]\nduration_h = 0.02\nlogs = 1\n", encoding="utf-8")
        said = payscope("simulate", scenario, "-o", tmp_path / "day.mcap")
        assert (said.status, said.out.split()) == (0, [str(tmp_path / "day.mcap")])
        assert (tmp_path / "day.cycles.json").is_file()
        again = payscope("simulate", scenario, "-o", tmp_path / "day.mcap")
        join_to_one_line(again, "exists already; give another output, or --force")

    @pytest.mark.parametrize(
        ("text", "says"),
        [
            ("duration = 1", "unknown key 'shift.duration'; did you mean 'duration_h'?"),
            ("duration_h = 24", "shift.duration_h: input should be less than or equal to 12"),
            ("turn_rad_s = 3.0", "shift.turn_rad_s: takes up to"),
        ],
    )
    def test_what_is_wrong_with_a_shift_is_said_in_one_line(
        self, payscope: Payscope, tmp_path: Path, text: str, says: str
    ) -> None:
        scenario = tmp_path / "shift.toml"
        scenario.write_text(f"[shift]\n{text}\n", encoding="utf-8")
        said = payscope("simulate", scenario, "-o", tmp_path / "day.mcap")
        assert said.status == 2
        assert says in said.err
        assert_one_line(said.err.strip())
