"""`payscope show`, `plot`, `init` and `info`."""

import json
import tomllib
from pathlib import Path

import polars as pl
import pytest

from recordings import read_recording, write_recording
from replay import load_machine, open_log, run
from replay.commands.frame_output import format_frame_as_table
from replay.machines.machine_file import find_time_axis_of_machine
from tests.replay.logs.damaged import chunks, overwrite
from tests.replay.logs.written_logs import Joints, write_mcap
from tests.replay.sledge import MACHINE, Payscope, join_to_one_line, sledge
from tests.twins import mark_slow_after

pytestmark = pytest.mark.usefixtures("kept_replays")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A replayed log, to be looked at."""
    folder = tmp_path_factory.mktemp("shown")
    log, machine_file = folder / "sledge.csv", folder / "sledge.toml"
    sledge().write_csv(log)
    machine_file.write_text(MACHINE)
    machine = load_machine(machine_file)
    with open_log(log, time=find_time_axis_of_machine(machine)) as opened:
        return write_recording(run(opened, machine), folder / "out.rrd")


def test_on_a_narrow_screen_a_wide_frame_stands_in_parts() -> None:
    frame = pl.DataFrame(
        {"local": ["12:00", "12:01"], "t_s": [0, 60], **{f"column_{k}": [k, 10] for k in range(9)}}
    )
    whole = format_frame_as_table(frame, 40)
    assert len(whole.splitlines()) == 3
    assert format_frame_as_table(frame, 40, 200) == whole
    for width in (5, 30, 60):
        parts = format_frame_as_table(frame, 40, width).split("\n\n")
        names = [line.split() for line in (part.splitlines()[0] for part in parts)]
        assert all(each[:2] == ["local", "t_s"] for each in names)
        assert [name for each in names for name in each[2:]] == frame.columns[2:]
        # one column behind the two stays whole, however narrow the screen
        assert all(max(map(len, part.splitlines())) <= max(width, 23) for part in parts)


class TestShow:
    # a stage in one of the formats in turn, and each in every one
    @pytest.mark.heavy
    @pytest.mark.parametrize("turns", mark_slow_after(1, [1, 3]))
    def test_lists_the_stages_and_prints_each_of_them_in_each_format(
        self, payscope: Payscope, recording: Path, tmp_path: Path, turns: int
    ) -> None:
        run = read_recording(recording)
        listed = json.loads(payscope("show", recording, "--format", "json").out)
        assert list(listed) == list(run.frames)
        for place, (stage, frame) in enumerate(run.frames.items()):
            formats = [("text", "json", "parquet")[(place + turn) % 3] for turn in range(turns)]
            if "text" in formats:
                assert payscope("show", recording, stage).status == 0
            if "json" in formats:
                as_json = json.loads(payscope("show", recording, stage, "--format", "json").out)
                assert len(as_json) == frame.height
            if "parquet" in formats:
                parquet = tmp_path / "stage.parquet"
                words = ("--format", "parquet", "-o", parquet, "--force")
                assert payscope("show", recording, stage, *words).status == 0
                assert pl.read_parquet(parquet).equals(frame)

    @pytest.mark.heavy
    def test_the_suffix_of_the_output_says_the_format(
        self, payscope: Payscope, recording: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "masses.parquet"
        assert payscope("show", recording, "masses", "-o", out).status == 0
        assert pl.read_parquet(out).equals(read_recording(recording).frames["masses"])
        join_to_one_line(
            payscope("show", recording, "masses", "-o", tmp_path / "masses.txt"), ".parquet"
        )

    def test_a_stage_is_not_written_over_its_recording(
        self, payscope: Payscope, recording: Path
    ) -> None:
        said = payscope("show", recording, "gate", "--format", "csv", "-o", recording, "--force")
        join_to_one_line(said, "out.rrd", "is also an input")
        assert read_recording(recording).frames

    def test_what_only_a_stage_can_do_needs_one(self, payscope: Payscope, recording: Path) -> None:
        for words in (["--from", 1], ["-o", recording.with_name("a.csv")], ["--format", "csv"]):
            join_to_one_line(payscope("show", recording, *words), "a frame")

    @pytest.mark.heavy
    def test_a_moment_is_its_last_row_or_the_spans_that_hold_it(
        self, payscope: Payscope, recording: Path
    ) -> None:
        def rows(stage: str, *words: object) -> list[dict[str, object]]:
            said = payscope("show", recording, stage, *words, "--format", "json")
            assert said.status == 0, said
            return json.loads(said.out)

        frames = read_recording(recording).frames
        gate = frames["gate"].filter(pl.col("t_ns") <= 20_004_000_000).tail(1)
        assert [row["t_ns"] for row in rows("gate", "--at", 20.004)] == gate["t_ns"].to_list()
        (axis,) = rows("raw/table", "--at", 20.004)
        assert axis == rows("raw/table", "--to", 20.004)[-1]
        spans = frames["manoeuvres"].select("start_t_ns", "end_t_ns").rows()
        begin, end = (each / 1e9 for each in spans[1])
        (held,) = rows("manoeuvres", "--at", (begin + end) / 2.0)
        assert (held["start_t_ns"], held["end_t_ns"]) == spans[1]
        assert rows("manoeuvres", "--at", begin - 1e-6) == []

    def test_a_moment_is_no_range_and_needs_a_time(
        self, payscope: Payscope, recording: Path
    ) -> None:
        join_to_one_line(
            payscope("show", recording, "gate", "--at", 2, "--from", 1), "use one or the other"
        )
        ends = ["--from", 5, "--to", 1]
        join_to_one_line(
            payscope("show", recording, "gate", *ends), "is not a time span", "earlier first"
        )
        for time in (["--from", "nan"], ["--to", "inf"], ["--at", "nan"]):
            join_to_one_line(payscope("show", recording, "gate", *time), "a finite number")
        join_to_one_line(payscope("show", recording, "masses", "--at", 2), "has no time")
        join_to_one_line(payscope("show", recording, "--at", 2), "need the name of a frame")

    @pytest.mark.heavy
    def test_a_joints_name_in_a_column_is_no_markup(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        table, out = tmp_path / "joints.csv", tmp_path / "joints.rrd"
        sledge().rename({"force_N": "effort[left]"}).write_csv(table)
        words = ["--set", "channels.force_x_N.field=effort[left]"]
        assert payscope("run", table, "-m", machine_file, "-o", out, *words).status == 0
        assert "effort[left]" in payscope("show", out).out

    def test_a_wide_stage_is_not_broken_into_letters_on_a_narrow_screen(
        self, payscope: Payscope, recording: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("COLUMNS", "60")
        monkeypatch.setenv("FORCE_COLOR", "1")
        assert "samples_accepted" in payscope("show", recording, "segments").out

    def test_cuts_by_seconds_from_the_start(self, payscope: Payscope, recording: Path) -> None:
        said = payscope("show", recording, "gate", "--from", 5, "--to", 6, "--format", "json")
        rows = json.loads(said.out)
        assert rows[0]["t_ns"] == 5_000_000_000
        assert rows[-1]["t_ns"] == 6_000_000_000
        assert len(rows) == 101

    def test_csv_goes_to_stdout(self, payscope: Payscope, recording: Path) -> None:
        said = payscope("show", recording, "masses", "--format", "csv")
        assert said.out.startswith("method,mass_kg,mass_std_kg")

    def test_wrong_stage_and_wrong_file(
        self, payscope: Payscope, recording: Path, log: Path
    ) -> None:
        join_to_one_line(payscope("show", recording, "gat"), "did you mean 'gate'?")
        join_to_one_line(payscope("show", log, "gate"), "sledge.csv")
        join_to_one_line(payscope("show", recording, "gate", "--format", "parquet"), "-o")
        join_to_one_line(payscope("show", recording, "masses", "--from", 1), "no time")

    @pytest.mark.heavy
    def test_plot_draws_a_page(self, payscope: Payscope, recording: Path, tmp_path: Path) -> None:
        picture = tmp_path / "page.png"
        assert payscope("plot", recording, "-o", picture).status == 0
        assert picture.read_bytes().startswith(b"\x89PNG")
        join_to_one_line(payscope("plot", recording, "-o", picture), "--force")
        join_to_one_line(payscope("plot", recording, "-o", tmp_path / "page.doc"), ".png")


class TestInit:
    @pytest.mark.heavy
    def test_a_table_with_telling_names_gives_a_machine_file_that_runs(
        self, payscope: Payscope, tmp_path: Path
    ) -> None:
        table = tmp_path / "axis.csv"
        sledge().rename({"acc_m_s2": "acc_x_m_s2"}).write_csv(table)
        made = tmp_path / "made.toml"
        assert payscope("init", table, "-o", made).status == 0
        answer = json.loads(payscope("run", table, "-m", made, "--json").out)
        assert answer["mass_kg"]["pooled"] == pytest.approx(120.0, rel=0.02)

    @pytest.mark.heavy
    @pytest.mark.parametrize(
        "name",
        mark_slow_after(
            2, ["logs/linear_axis.bag", "logs/linear_axis.csv", "logs/linear_axis_ros2"]
        ),
    )
    def test_the_linear_axis_runs_from_its_first_machine_file(
        self, payscope: Payscope, data_in_kind: Path, tmp_path: Path, name: str
    ) -> None:
        made = tmp_path / "made.toml"
        said = payscope("init", data_in_kind / name, "-o", made)
        assert said.status == 0
        assert said.err == ""
        said = payscope("run", data_in_kind / name, "-m", made, "--json")
        assert json.loads(said.out)["mass_kg"]["joint"] == pytest.approx(95.11, rel=0.02)

    def test_whatever_a_log_calls_its_joints_the_file_is_toml(
        self, payscope: Payscope, tmp_path: Path
    ) -> None:
        log, made = tmp_path / "named.mcap", tmp_path / "made.toml"
        efforts = {'left "front"': 1.0, "right\\front": 2.0}
        write_mcap(log, [Joints(k, efforts, '/wheels\\"') for k in range(1, 4)])
        assert payscope("init", log, "-o", made).status == 0
        channels = tomllib.loads(made.read_text())["channels"]
        assert channels["torque_left_N_m"]["topic"] == '/wheels\\"'
        assert channels["torque_left_N_m"]["field"] == 'effort[left "front"]'
        assert channels["torque_right_N_m"]["field"] == "effort[right\\front]"

    def test_only_the_arrays_that_a_joint_state_fills_are_guessed(
        self, payscope: Payscope, tmp_path: Path
    ) -> None:
        log, made = tmp_path / "split.mcap", tmp_path / "made.toml"
        efforts = {"left": 1.0, "right": 2.0}
        write_mcap(log, [Joints(k, efforts, "/torque") for k in range(1, 4)])
        assert payscope("init", log, "-o", made).status == 0
        channels = tomllib.loads(made.read_text())["channels"]
        assert channels.keys() == {"torque_left_N_m", "torque_right_N_m"}

    def test_joints_that_are_of_no_side_are_left_to_choose_from(
        self, payscope: Payscope, tmp_path: Path
    ) -> None:
        log, made = tmp_path / "arm.mcap", tmp_path / "made.toml"
        write_mcap(log, [Joints(k, {"boom": 1.0, "bucket": 2.0}, "/arm") for k in range(1, 4)])
        said = payscope("init", log, "-o", made)
        assert said.status == 0
        assert "still missing: a force" in said.err
        assert "channels" not in tomllib.loads(made.read_text())
        assert "/arm" in made.read_text()

    @pytest.mark.heavy
    def test_the_simulated_machine_runs_from_its_first_machine_file_and_what_only_a_person_knows(
        self, payscope: Payscope, tmp_path: Path
    ) -> None:
        scenario, made = tmp_path / "one.toml", tmp_path / "made.toml"
        scenario.write_text("[campaign]\nloads_kg = [0]\nruns = 2\n")
        log = tmp_path / "one.bag"
        assert payscope("simulate", scenario, "-o", log).status == 0
        said = payscope("init", log, "-o", made)
        assert said.err == (
            "still missing: machine.wheel_radius_m, which turns wheel torques into a force\n"
        )
        known = {
            "machine.wheel_radius_m": 0.42,
            "machine.force_share": 0.5,
            "channels.speed_left_m_s.scale": 0.42,
            "channels.speed_right_m_s.scale": 0.42,
        }
        words = [word for key, value in known.items() for word in ("--set", f"{key}={value}")]
        answer = json.loads(payscope("run", log, "-m", made, "--json", *words).out)
        assert answer["mass_kg"]["joint"] == pytest.approx(3614.0, rel=0.01)

    @pytest.mark.heavy
    def test_the_unit_of_a_tables_time_goes_into_the_machine_file(
        self, payscope: Payscope, tmp_path: Path
    ) -> None:
        table, made = tmp_path / "ms.csv", tmp_path / "made.toml"
        stamp = (pl.col("time_s") * 1000 + 1.7e12).cast(pl.Int64).alias("stamp")
        sledge().select(stamp, pl.exclude("time_s")).write_csv(table)
        said = payscope("init", table, "-o", made, "--time", "stamp", "--time-unit", "ms")
        assert said.status == 0
        assert tomllib.loads(made.read_text())["log"] == {"time": "stamp", "time_unit": "ms"}

    def test_what_is_missing_is_said(self, payscope: Payscope, data: Path, tmp_path: Path) -> None:
        made = tmp_path / "made.toml"
        boot = {"own": "since-boot.bag"}.get(data.name, "jackal_imu_odom.bag")
        said = payscope("init", data / "bags" / boot, "-o", made)
        assert "still missing: a force" in said.err
        assert "missing: a force" in made.read_text()


class TestInfo:
    def test_every_bag_of_others_is_described_or_one_line_says_why_not(
        self, payscope: Payscope, data: Path
    ) -> None:
        for path in sorted((data / "bags").iterdir()):
            said = payscope("info", path)
            if said.status == 0:
                assert path.name in said.out
            else:
                join_to_one_line(said, path.name)

    def test_several_logs_are_described_though_one_is_empty(
        self, payscope: Payscope, data: Path
    ) -> None:
        bags = data / "bags"
        whole = {"own": "zstd.mcap"}.get(data.name, "talker.mcap")
        said = payscope("info", bags / "empty-file.bag", bags / whole)
        assert said.status == 2
        assert whole in said.out
        assert "empty-file.bag: the file is empty" in said.err

    def test_json(self, payscope: Payscope, log: Path) -> None:
        told = json.loads(payscope("info", log, "--json").out)
        assert told["messages"] == 4000
        assert told["topics"][0]["topic"] == "table"

    def test_a_check_of_whole_logs_says_what_it_read_and_leaves_with_0(
        self, payscope: Payscope, log: Path, data: Path
    ) -> None:
        name, read = {"own": ("zstd.mcap", "75 messages (0.012 MB) decoded, 6 CRCs")}.get(
            data.name, ("talker.mcap", "20 messages (0.002 MB) decoded, 2 CRCs")
        )
        said = payscope("info", log, data / "bags" / name, "--check")
        assert said.status == 0
        assert "checked, complete: 4,000 messages" in said.out
        assert f"checked, complete: {read} agree, in" in said.out
        assert "checked" not in payscope("info", log).out

    def test_a_check_of_a_damaged_log_leaves_with_1_and_a_plain_look_with_0(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        path = tmp_path / "shift.mcap"
        write_mcap(path, [Joints(1000 + k, {"left": 1.0}) for k in range(100)])
        overwrite(path, chunks(path)[0].chunk_start_offset + 100, bytes(20))
        assert payscope("info", path).status == 0
        said = payscope("info", log, path, "--check")
        assert said.status == 1
        assert "checked, complete: 4,000 messages" in said.out
        assert "checked, incomplete: 0 messages (0.000 MB) read" in said.out
        assert "! shift.mcap: the chunk at byte" in said.out

    def test_json_tells_a_check_from_none(self, payscope: Payscope, log: Path) -> None:
        assert json.loads(payscope("info", log, "--json").out)["check"] is None
        check = json.loads(payscope("info", log, "--json", "--check").out)["check"]
        assert (check["whole"], check["messages"], check["crcs"]) == (True, 4000, 0)
        assert check["message_bytes"] > 0
        assert check["seconds"] > 0

    def test_a_log_that_cannot_be_opened_counts_more_than_one_that_is_not_whole(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        log.write_bytes(log.read_bytes()[:-40])
        said = payscope("info", log, tmp_path / "no.bag", "--check")
        assert said.status == 2
        assert "checked, incomplete" in said.out
        assert "no such file" in said.err

    def test_wrong_time_zone(self, payscope: Payscope, log: Path) -> None:
        join_to_one_line(payscope("info", log, "--timezone", "Mars/Base"), "Mars/Base")

    def test_an_unknown_unit_of_time_is_refused(self, payscope: Payscope, log: Path) -> None:
        words = ("--time", "a", "--time-unit", "fortnight")
        join_to_one_line(payscope("info", log, *words), "no unit of time 'fortnight'")
