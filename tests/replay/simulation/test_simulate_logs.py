"""Simulated logs as files: what is read back is what was simulated, whole or not at all."""

import json
import os
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from rosbags.highlevel import AnyReader

from analysis.simulation import Scenario, simulate_campaign
from estimators.errors import OutputError, ScenarioError
from replay.simulation.scenario_file import format_scenario_file
from replay.simulation.simulate_logs import (
    make_paths_of_simulated_logs,
    simulate_scenario_to_logs,
    write_logs_and_truths,
)
from tests.one_line import assert_one_line
from tests.replay.sledge import Payscope, join_to_one_line
from tests.twins import mark_heavy_after

SHORT = Scenario.model_validate(
    {
        "campaign": {"loads_kg": [0, 100], "runs": 1, "standstill_s": 1, "rest_s": 1},
        "terrain": {"slope_deg": 2.0},
    }
)
ONE = Scenario.model_validate(
    {"campaign": {"loads_kg": [50], "runs": 1, "standstill_s": 0, "rest_s": 0}}
)
SUFFIXES = ["bag", "mcap", "db3", "csv", ""]


def named(folder, suffix):
    return folder / (f"campaign.{suffix}" if suffix else "campaign")


def read_back(path):
    """Every message by topic: (log time, message), as rosbags reads them."""
    found = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((time_ns, message))
    return found


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


@pytest.mark.parametrize("suffix", mark_heavy_after(1, ["bag", "mcap", "db3", ""]))
def test_messages_read_back_hold_exactly_the_simulated_numbers(tmp_path, suffix):
    paths = simulate_scenario_to_logs(SHORT, named(tmp_path, suffix))
    for log, path in zip(simulate_campaign(SHORT), paths, strict=True):
        found = read_back(path)
        assert set(found) == {"/imu/data", "/wheels/torque", "/wheels/speed"}
        for topic, name in (
            ("/imu/data", "imu"),
            ("/wheels/torque", "torque"),
            ("/wheels/speed", "speed"),
        ):
            frame, messages = log.topics[name], found[topic]
            assert [time_ns for time_ns, _ in messages] == frame["log_time_ns"].to_list()
            assert [stamp_ns(m) for _, m in messages] == frame["header_stamp_ns"].to_list()

        imu = pl.DataFrame(
            [
                (
                    *(getattr(m.linear_acceleration, axis) for axis in "xyz"),
                    *(getattr(m.angular_velocity, axis) for axis in "xyz"),
                )
                for _, m in found["/imu/data"]
            ],
            orient="row",
        )
        np.testing.assert_array_equal(imu, log.topics["imu"][:, 2:8])
        effort = [m.effort for _, m in found["/wheels/torque"]]
        np.testing.assert_array_equal(effort, log.topics["torque"][:, 2:])
        velocity = np.array([m.velocity for _, m in found["/wheels/speed"]])
        radius_m = SHORT.machine.wheel_radius_m
        np.testing.assert_array_equal(velocity, log.topics["speed"][:, 2:].to_numpy() / radius_m)
        assert found["/wheels/torque"][0][1].name == ["front_left", "front_right"]


def test_nose_up_is_a_negative_rotation_about_the_left_axis_in_the_quaternion(tmp_path):
    path = simulate_scenario_to_logs(SHORT, tmp_path / "up.mcap")[0]
    quaternions = [m.orientation for _, m in read_back(path)["/imu/data"]]
    pitch = np.array([-2 * np.arctan2(q.y, q.w) for q in quaternions])
    log = next(simulate_campaign(SHORT))
    np.testing.assert_allclose(pitch, log.topics["imu"]["pitch_rad"], atol=1e-15)
    assert pitch.mean() == pytest.approx(np.radians(2.0), abs=1e-4)


def test_tables_read_back_hold_exactly_the_simulated_numbers(tmp_path):
    paths = simulate_scenario_to_logs(SHORT, tmp_path / "campaign.csv")
    for log, path in zip(simulate_campaign(SHORT), paths, strict=True):
        table = pl.read_csv(path, infer_schema_length=None)
        zero_ns = SHORT.log.start_unix_s * 10**9
        for frame in log.topics.values():
            columns = frame.drop("header_stamp_ns", "log_time_ns").columns
            # each topic has rows of its own, in which the others have nothing
            mine = table.filter(pl.col(columns[0]).is_not_null())
            stamps = (mine["time_s"].to_numpy() * 1e9).round().astype(np.int64)
            np.testing.assert_array_equal(stamps + zero_ns, frame["header_stamp_ns"])
            for column in columns:
                np.testing.assert_array_equal(mine[column], frame[column])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_same_scenario_writes_the_same_bytes(tmp_path, suffix):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        simulate_scenario_to_logs(ONE, named(tmp_path / folder, suffix))
    files = [
        {p.relative_to(tmp_path / f): p.read_bytes() for p in (tmp_path / f).rglob("*.*")}
        for f in ("a", "b")
    ]
    assert files[0] == files[1]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_truth_beside_a_log_says_where_each_run_is_in_its_own_times(tmp_path, suffix):
    path = simulate_scenario_to_logs(ONE, named(tmp_path, suffix))[0]
    truth = json.loads(path.with_name(f"{path.name}.truth.json").read_text(encoding="utf-8"))
    assert truth["log"] == path.name
    assert truth["load_kg"] == 50
    assert Scenario.model_validate(truth["scenario"]) == ONE
    (run,) = truth["runs"]
    assert (run["mass_kg"], run["friction_N_s_m"]) == (3664.0, 2891.0)
    start_s = (run["start_ns"] - truth["time_zero_unix_ns"]) / 1e9
    assert start_s == (0.0 if suffix == "csv" else 1_700_000_000.0)


def test_the_truth_names_the_load_of_every_start_and_the_phase_of_every_topic(tmp_path):
    changes = Scenario.model_validate(
        {
            "campaign": {"loads_kg": [50], "runs": 3, "standstill_s": 0.5, "rest_s": 0},
            "loading": {"change_kg": 100, "change_before_start": 1, "fill_kg_s": 10},
            "sampling": {"speed_rate_hz": 20, "torque_phase_s": 0.25},
        }
    )
    path = simulate_scenario_to_logs(changes, tmp_path / "changes.mcap")[0]
    truth = json.loads(path.with_name("changes.mcap.truth.json").read_text(encoding="utf-8"))
    assert [run["mass_kg"] for run in truth["runs"]] == [3664.0, 3764.0, 3764.0]
    starts = [each for each in truth["manoeuvres"] if each["kind"] == "start"]
    assert [(each["load_kg"], each["load_end_kg"]) for each in starts] == [
        (50.0, 100.0),
        (150.0, 200.0),
        (150.0, 200.0),
    ]
    found = read_back(path)
    for name, topic in (("imu", "/imu/data"), ("torque", "/wheels/torque")):
        first_ns = stamp_ns(found[topic][0][1]) - SHORT.log.start_unix_s * 10**9
        assert first_ns == round(truth["phase_s"][name] * 1e9)
    assert truth["phase_s"]["torque"] == 0.25
    assert len(found["/wheels/speed"]) * 5 == pytest.approx(len(found["/imu/data"]), abs=5)


def test_one_load_is_written_to_the_named_log_and_several_to_one_log_each(tmp_path):
    assert make_paths_of_simulated_logs(ONE, Path("x/shift.bag")) == [Path("x/shift.bag")]
    assert make_paths_of_simulated_logs(SHORT, Path("x/shift.bag")) == [
        Path("x/shift_000kg.bag"),
        Path("x/shift_100kg.bag"),
    ]
    halves = Scenario.model_validate({"campaign": {"loads_kg": [12.5, 1000]}})
    assert make_paths_of_simulated_logs(halves, Path("shift")) == [
        Path("shift_12_5kg"),
        Path("shift_1000kg"),
    ]
    written = simulate_scenario_to_logs(SHORT, tmp_path / "shift.csv")
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "shift_000kg.csv",
        "shift_000kg.csv.truth.json",
        "shift_100kg.csv",
        "shift_100kg.csv.truth.json",
    ]
    assert all(path.is_file() for path in written)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_nothing_is_overwritten_without_force_and_everything_with_it(tmp_path, suffix):
    output = named(tmp_path, suffix)
    simulate_scenario_to_logs(ONE, output)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    with pytest.raises(OutputError, match="exists already; give another output, or --force"):
        simulate_scenario_to_logs(ONE, output)
    assert before == {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    other = ONE.model_copy(update={"sensors": ONE.sensors.model_copy(update={"seed": 7})})
    simulate_scenario_to_logs(other, output, overwrites=True)
    after = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    assert after.keys() == before.keys()
    assert after != before


def test_one_log_in_the_way_keeps_all_others_from_being_written(tmp_path):
    (tmp_path / "shift_100kg.bag").touch()
    with pytest.raises(OutputError, match="shift_100kg"):
        simulate_scenario_to_logs(SHORT, tmp_path / "shift.bag")
    assert [p.name for p in tmp_path.iterdir()] == ["shift_100kg.bag"]


def test_force_does_not_replace_a_folder_that_is_no_log(tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    (home / "letter.txt").touch()
    with pytest.raises(OutputError, match="is a folder, but not a rosbag2 directory"):
        simulate_scenario_to_logs(ONE, home, overwrites=True)
    assert (home / "letter.txt").exists()


def test_a_folder_log_replaces_a_file_of_its_name_with_force(tmp_path):
    (tmp_path / "campaign").touch()
    path = simulate_scenario_to_logs(ONE, tmp_path / "campaign", overwrites=True)[0]
    assert (path / "metadata.yaml").is_file()


@pytest.mark.parametrize(
    ("output", "says"),
    [
        ("log.zip", "unknown format '.zip'; use .bag, .mcap, .db3, .csv"),
        ("absent/log.bag", "no folder"),
        ("file/log.bag", "no folder"),
    ],
)
def test_an_output_that_cannot_be_is_refused_in_one_line_and_leaves_nothing(tmp_path, output, says):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError) as caught:
        simulate_scenario_to_logs(ONE, tmp_path / output)
    assert says in str(caught.value)
    assert_one_line(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_folder_without_a_name_is_no_log():
    with pytest.raises(OutputError, match="is a folder; give a log in it"):
        simulate_scenario_to_logs(ONE, Path())


def test_a_scenario_made_in_python_that_has_no_motion_is_refused_before_anything_is_written(
    tmp_path,
):
    steep = ONE.model_copy(update={"terrain": ONE.terrain.model_copy(update={"slope_deg": 12.0})})
    with pytest.raises(ScenarioError, match="slope and friction resist 3664 kg"):
        simulate_scenario_to_logs(steep, tmp_path / "log.bag")
    assert not list(tmp_path.iterdir())


class TestCommand:
    def test_the_logs_are_named_on_stdout(self, payscope: Payscope, tmp_path: Path) -> None:
        scenario = tmp_path / "one.toml"
        scenario.write_text(format_scenario_file(ONE), encoding="utf-8")
        said = payscope("simulate", scenario, "-o", tmp_path / "log.csv")
        assert (said.status, said.out.split()) == (0, [str(tmp_path / "log.csv")])

    def test_a_machine_that_does_not_start_is_refused_in_one_line_that_names_the_file(
        self, payscope: Payscope, tmp_path: Path
    ) -> None:
        steep = tmp_path / "steep.toml"
        steep.write_text("[terrain]\nslope_deg = 15\n", encoding="utf-8")
        said = payscope("simulate", steep, "-o", tmp_path / "log.bag")
        join_to_one_line(
            said, f"{steep}: campaign.throttle_force_N: the driving force reaches 6000 N"
        )
        assert said.status == 2
        assert list(tmp_path.iterdir()) == [steep]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot write in"):
        simulate_scenario_to_logs(ONE, tmp_path / "log.bag")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_campaign_that_breaks_off_leaves_nothing_behind(tmp_path, suffix):
    def breaks_off():
        yield next(simulate_campaign(ONE))
        raise OSError(28, "No space left on device")

    targets = [named(tmp_path, suffix), named(tmp_path, suffix).with_stem("second")]
    with pytest.raises(OutputError, match="No space left on device"):
        write_logs_and_truths(breaks_off(), targets)
    assert not list(tmp_path.iterdir())
