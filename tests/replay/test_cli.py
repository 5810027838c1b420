"""The command line: answers, exit statuses, and one line for whatever is wrong."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import polars as pl
import pytest

from recordings import read_recording
from replay.commands.replaying import print_answer
from tests.replay.readers.written_logs import Joints, write_mcap
from tests.replay.sledge import Payscope, Said, sledge


class TestRun:
    def test_prints_the_answer_and_writes_the_recording(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "-o", tmp_path / "out.rrd")
        assert said.status == 0, said.err
        assert "can weigh" in said.out
        assert read_recording(tmp_path / "out.rrd").frames["masses"].height == 5

    def test_json_gives_every_key_of_the_contract(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "out.rrd"
        said = payscope("run", log, "-m", machine_file, "-o", out, "--json")
        answer = json.loads(said.out)
        assert {"mass_kg", "mass_std_kg", "payload_kg", "accepted_share", "verdict", "losses"} <= (
            answer.keys()
        )
        assert answer["recording"] == str(out)
        assert answer["mass_kg"]["pooled"] == pytest.approx(120.0, rel=0.02)
        assert answer["payload_kg"]["pooled"] == pytest.approx(20.0, abs=2.5)
        assert answer["verdict"]["can_weigh"] is True
        assert 0 < answer["accepted_share"] <= 1

    def test_several_logs_are_one_time_line(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        whole = sledge()
        parts = [tmp_path / "a.csv", tmp_path / "b.csv"]
        whole[:2000].write_csv(parts[0])
        whole[2000:].write_csv(parts[1])
        one = tmp_path / "whole.csv"
        whole.write_csv(one)
        masses = [
            json.loads(payscope("run", *logs, "-m", machine_file, "--json").out)["mass_kg"]
            for logs in (parts, parts[::-1], [one])
        ]
        assert masses[0] == masses[1] == masses[2]

    def test_override_wins_over_the_machine_file(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope(
            "run", log, "-m", machine_file, "--json", "--set", "settings.threshold_nat=9"
        )
        assert said.status == 1
        assert json.loads(said.out)["accepted_share"] == 0

    def test_a_mass_without_a_deviation_is_printed_alone(
        self, capsys: pytest.CaptureFixture[str]
    ) -> None:
        numbers = {
            "mass_kg": {"pooled": 120.0},
            "mass_std_kg": {"pooled": None},
            "payload_kg": {"pooled": 20.0},
            "friction_x_N_s_m": {"pooled": None},
            "friction_x_std_N_s_m": {"pooled": None},
        }
        said = {"losses": [], "notes": [], "accepted_share": 0.1, "recording": None}
        print_answer(
            {**numbers, **said, "verdict": {"can_weigh": True, "checks": []}}, as_json=False
        )
        assert "120.00  " in capsys.readouterr().out

    def test_timing_splits_the_seconds_by_stage(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--timing")
        for stage in ("read", "derive", "align", "smooth", "forces", "gate", "trace", "verdict"):
            assert stage in said.err

    def test_a_failed_verdict_withholds_the_mass_lists_the_checks_and_exits_1(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        unsigned = tmp_path / "unsigned.csv"
        sledge().with_columns(pl.lit(1.0).alias("force_N")).write_csv(unsigned)
        said = payscope("run", unsigned, "-m", machine_file, "-o", tmp_path / "out.rrd")
        assert said.status == 1
        assert "cannot weigh" in said.out
        assert "opposing_share" in said.out
        kept = read_recording(tmp_path / "out.rrd").frames["masses"]
        assert kept["mass_kg"].null_count() == kept.height

    def test_strict_refuses_a_log_with_a_loss_and_writes_nothing(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        holed = tmp_path / "holed.csv"
        sledge().with_columns(
            pl.when(pl.int_range(pl.len()) == 100).then(None).otherwise("force_N").alias("force_N")
        ).write_csv(holed)
        out = tmp_path / "out.rrd"
        one_line(payscope("run", holed, "-m", machine_file, "-o", out, "--strict"), "--strict")
        assert not out.exists()
        assert payscope("run", holed, "-m", machine_file, "-o", out).status == 0


def one_line(said: Said, *parts: str) -> None:
    """Exit 2, nothing on stdout, one line on stderr that names what it should."""
    assert said.status == 2, said
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert "Traceback" not in said.err
    for part in parts:
        assert part in said.err, said.err


class TestWrongInput:
    """Each fault by name: exit 2 and one line, or a stated refusal; never half a file."""

    @pytest.fixture(autouse=True)
    def _nothing_half_written(self, tmp_path: Path):
        yield
        assert not list(tmp_path.glob("*.rrd"))
        assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]

    def test_missing_log(self, payscope: Payscope, machine_file: Path, tmp_path: Path) -> None:
        one_line(payscope("run", tmp_path / "no.bag", "-m", machine_file), "no.bag", "no such")

    def test_missing_machine_file(self, payscope: Payscope, log: Path, tmp_path: Path) -> None:
        one_line(payscope("run", log, "-m", tmp_path / "no.toml"), "no.toml")

    def test_directory_without_bags(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "empty").mkdir()
        one_line(payscope("run", tmp_path / "empty", "-m", machine_file), "no bag")

    def test_wrong_suffix(self, payscope: Payscope, machine_file: Path, tmp_path: Path) -> None:
        (tmp_path / "log.txt").write_text("hello")
        one_line(payscope("run", tmp_path / "log.txt", "-m", machine_file), ".bag", ".mcap")

    def test_wrong_field_names_the_choices(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.field=force_n")
        one_line(said, "force_n", "force_N")

    def test_wrong_topic_names_the_nearest_and_the_key_to_set(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.topic=/tabel")
        one_line(said, "no topic '/tabel'", "table", "channels.force_x_N.topic")

    def test_wrong_unit(self, payscope: Payscope, log: Path, machine_file: Path) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.unit=kg")
        one_line(said, "sledge.toml", "channels.force_x_N", "kg")
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.unit=blob")
        one_line(said, "blob")

    def test_unknown_key_names_the_nearest(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "settings.window_sample=400")
        one_line(said, "settings.window_sample", "did you mean 'window_samples'?")

    def test_override_without_a_value(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        one_line(payscope("run", log, "-m", machine_file, "--set", "rate"), "key=value")

    def test_a_value_of_another_kind_is_asked_for_in_the_words_of_toml(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        for override, wanted in (("methods=ls", "a list"), ("verdict=3", "a table")):
            said = payscope("run", log, "-m", machine_file, "--set", f"settings.{override}")
            one_line(said, f"input should be {wanted}, not")

    def test_machine_file_without_channels_says_which_it_needs(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "m.toml").write_text('[machine]\nname = "bare"\n')
        said = payscope("run", log, "-m", tmp_path / "m.toml")
        one_line(said, "m.toml", "no force: give channels.force_x_N")

    def test_machine_file_that_is_no_toml(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "m.toml").write_text("[machine\n")
        one_line(payscope("run", log, "-m", tmp_path / "m.toml"), "m.toml", "TOML")

    def test_log_shorter_than_the_window_is_a_stated_refusal(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        short = tmp_path / "short.csv"
        sledge(seconds=2.0).write_csv(short)
        said = payscope("run", short, "-m", machine_file)
        assert said.status == 1
        assert "the log lasts 2.00 s, a window needs 3.20 s" in said.out

    def test_log_of_one_row(self, payscope: Payscope, machine_file: Path, tmp_path: Path) -> None:
        sledge(seconds=0.01).write_csv(tmp_path / "one.csv")
        one_line(payscope("run", tmp_path / "one.csv", "-m", machine_file), "single sample")

    def test_log_of_no_row(self, payscope: Payscope, machine_file: Path, tmp_path: Path) -> None:
        sledge()[:0].write_csv(tmp_path / "none.csv")
        one_line(payscope("run", tmp_path / "none.csv", "-m", machine_file), "none.csv")

    def test_channel_of_nothing_but_nan(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        nans = tmp_path / "nans.parquet"
        sledge().with_columns(pl.lit(float("nan")).alias("force_N")).write_parquet(nans)
        one_line(payscope("run", nans, "-m", machine_file), "force_x_N", "no number")

    def test_nan_and_infinite_samples_are_left_out_and_stated(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        holed = tmp_path / "holed.parquet"
        row = pl.int_range(pl.len())
        sledge().with_columns(
            pl.when(row == 50)
            .then(float("nan"))
            .when(row == 60)
            .then(float("inf"))
            .otherwise("force_N")
            .alias("force_N")
        ).write_parquet(holed)
        said = payscope("run", holed, "-m", machine_file)
        assert said.status == 0
        assert "2 of 4000 samples of force_N are missing or not finite" in said.out

    def test_stamps_that_go_backwards_are_sorted_and_the_masses_stay(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        shuffled = tmp_path / "shuffled.csv"
        rows = sledge().with_row_index()
        swapped = rows.with_columns(
            pl.when(pl.col("index") == 700)
            .then(702.5)
            .otherwise(pl.col("index").cast(pl.Float64))
            .alias("order")
        ).sort("order")
        swapped.drop("index", "order").write_csv(shuffled)
        masses = [
            json.loads(payscope("run", path, "-m", machine_file, "--json").out)["mass_kg"]
            for path in (log, shuffled)
        ]
        assert masses[0] == masses[1]
        said = payscope("run", shuffled, "-m", machine_file)
        assert "lost: shuffled.csv table: the time goes back at 1 rows: sorted by time" in said.out

    def test_text_where_a_number_should_be(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        words = tmp_path / "words.parquet"
        sledge().with_columns(pl.lit("fast").alias("force_N")).write_parquet(words)
        said = payscope("run", words, "-m", machine_file)
        one_line(said, "words.parquet with", "sledge.toml: force_x_N", "not a number")

    def test_channels_that_share_no_time(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.delay_s=1000")
        one_line(said, "share no stretch of time")

    def test_unknown_option_and_command(self, payscope: Payscope) -> None:
        one_line(payscope("run", "--frobnicate"), "--frobnicate")
        one_line(payscope("rum"), "rum")
        one_line(payscope("run"), "logs")


class TestOutputs:
    def test_nothing_is_overwritten_without_force(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "out.rrd"
        out.write_text("mine")
        one_line(payscope("run", log, "-m", machine_file, "-o", out), "out.rrd", "--force")
        assert out.read_text() == "mine"
        assert payscope("run", log, "-m", machine_file, "-o", out, "--force").status == 0
        assert read_recording(out).frames

    def test_missing_folder(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "no" / "out.rrd"
        one_line(payscope("run", log, "-m", machine_file, "-o", out), "out.rrd", "folder")

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
    def test_read_only_folder_of_a_plain_user(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        locked = tmp_path / "locked"
        locked.mkdir(mode=0o555)
        one_line(payscope("run", log, "-m", machine_file, "-o", locked / "out.rrd"), "locked")

    @pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
    def test_read_only_folder(self, log: Path, machine_file: Path, tmp_path: Path) -> None:
        locked = tmp_path / "locked"
        locked.mkdir(mode=0o555)
        for path in (tmp_path, *tmp_path.parents[:-2]):
            path.chmod(path.stat().st_mode | 0o055)
        code = (
            "import os, sys; from replay.cli import main; import recordings, replay.pipeline, "
            "replay.commands.replaying, analysis.units; os.setuid(65534); main()"
        )
        words = ["run", log, "-m", machine_file, "-o", locked / "out.rrd"]
        left = subprocess.run(
            [sys.executable, "-c", code, *map(str, words)],
            capture_output=True,
            text=True,
            check=False,
            cwd=Path(__file__).resolve().parents[2],
        )
        one_line(Said(left.returncode, left.stdout, left.stderr), "locked", "Permission denied")

    def test_a_recording_ends_in_rrd_so_that_no_log_is_lost_to_force(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        before = log.read_bytes(), machine_file.read_bytes()
        for out in (log, machine_file):
            said = payscope("run", log, "-m", machine_file, "-o", out, "--force")
            one_line(said, out.name, ".rrd")
        assert (log.read_bytes(), machine_file.read_bytes()) == before

    def test_a_log_is_not_overwritten_by_its_machine_file(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        before = log.read_bytes()
        (tmp_path / "link.toml").symlink_to(log)
        for out in (log, tmp_path / "link.toml"):
            one_line(payscope("init", log, "-o", out, "--force"), out.name, "the input itself")
        assert log.read_bytes() == before


class TestShow:
    @pytest.fixture
    def recording(self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path) -> Path:
        out = tmp_path / "out.rrd"
        assert payscope("run", log, "-m", machine_file, "-o", out).status == 0
        return out

    def test_lists_the_stages_and_prints_each_of_them_in_each_format(
        self, payscope: Payscope, recording: Path, tmp_path: Path
    ) -> None:
        run = read_recording(recording)
        listed = json.loads(payscope("show", recording, "--format", "json").out)
        assert list(listed) == list(run.frames)
        for stage, frame in run.frames.items():
            assert payscope("show", recording, stage).status == 0
            as_json = json.loads(payscope("show", recording, stage, "--format", "json").out)
            assert len(as_json) == frame.height
            parquet = tmp_path / "stage.parquet"
            said = payscope(
                "show", recording, stage, "--format", "parquet", "-o", parquet, "--force"
            )
            assert said.status == 0
            assert pl.read_parquet(parquet).equals(frame)

    def test_the_suffix_of_the_output_says_the_format(
        self, payscope: Payscope, recording: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "masses.parquet"
        assert payscope("show", recording, "masses", "-o", out).status == 0
        assert pl.read_parquet(out).equals(read_recording(recording).frames["masses"])
        one_line(payscope("show", recording, "masses", "-o", tmp_path / "masses.txt"), ".parquet")

    def test_a_stage_is_not_written_over_its_recording(
        self, payscope: Payscope, recording: Path
    ) -> None:
        said = payscope("show", recording, "gate", "--format", "csv", "-o", recording, "--force")
        one_line(said, "out.rrd", "the input itself")
        assert read_recording(recording).frames

    def test_what_only_a_stage_can_do_needs_one(self, payscope: Payscope, recording: Path) -> None:
        for words in (["--from", 1], ["-o", recording.with_name("a.csv")], ["--format", "csv"]):
            one_line(payscope("show", recording, *words), "name one")

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
        one_line(payscope("show", recording, "gat"), "did you mean 'gate'?")
        one_line(payscope("show", log, "gate"), "sledge.csv")
        one_line(payscope("show", recording, "gate", "--format", "parquet"), "-o")
        one_line(payscope("show", recording, "masses", "--from", 1), "no time")

    def test_plot_draws_a_page(self, payscope: Payscope, recording: Path, tmp_path: Path) -> None:
        picture = tmp_path / "page.png"
        assert payscope("plot", recording, "-o", picture).status == 0
        assert picture.read_bytes().startswith(b"\x89PNG")
        one_line(payscope("plot", recording, "-o", picture), "--force")
        one_line(payscope("plot", recording, "-o", tmp_path / "page.doc"), ".png")


class TestInit:
    def test_a_table_with_telling_names_gives_a_machine_file_that_runs(
        self, payscope: Payscope, tmp_path: Path
    ) -> None:
        table = tmp_path / "axis.csv"
        sledge().rename({"acc_m_s2": "acc_x_m_s2"}).write_csv(table)
        made = tmp_path / "made.toml"
        assert payscope("init", table, "-o", made).status == 0
        answer = json.loads(payscope("run", table, "-m", made, "--json").out)
        assert answer["mass_kg"]["pooled"] == pytest.approx(120.0, rel=0.02)

    @pytest.mark.parametrize(
        "name", ["logs/linear_axis.bag", "logs/linear_axis_ros2", "logs/linear_axis.csv"]
    )
    def test_the_linear_axis_runs_from_its_first_machine_file(
        self, payscope: Payscope, shared_data: Path, tmp_path: Path, name: str
    ) -> None:
        made = tmp_path / "made.toml"
        said = payscope("init", shared_data / name, "-o", made)
        assert said.status == 0
        assert said.err == ""
        said = payscope(
            "run", shared_data / name, "-m", made, "--json",
            "--set", "settings.exclude_braking=false",
        )  # fmt: skip
        assert json.loads(said.out)["mass_kg"]["pooled"] == pytest.approx(95.11, rel=0.02)

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
        assert answer["mass_kg"]["pooled"] == pytest.approx(3614.0, rel=0.01)

    def test_the_unit_of_a_tables_time_goes_into_the_machine_file(
        self, payscope: Payscope, tmp_path: Path
    ) -> None:
        table, made = tmp_path / "ms.csv", tmp_path / "made.toml"
        stamp = (pl.col("time_s") * 1000 + 1.7e12).cast(pl.Int64).alias("stamp")
        sledge().select(stamp, pl.exclude("time_s")).write_csv(table)
        said = payscope("init", table, "-o", made, "--time", "stamp", "--time-unit", "ms")
        assert said.status == 0
        assert tomllib.loads(made.read_text())["log"] == {"time": "stamp", "time_unit": "ms"}

    def test_what_is_missing_is_said(
        self, payscope: Payscope, shared_data: Path, tmp_path: Path
    ) -> None:
        made = tmp_path / "made.toml"
        said = payscope("init", shared_data / "bags/jackal_imu_odom.bag", "-o", made)
        assert "still missing: a force" in said.err
        assert "missing: a force" in made.read_text()


class TestInfo:
    def test_every_bag_of_others_is_described_or_one_line_says_why_not(
        self, payscope: Payscope, shared_data: Path
    ) -> None:
        for path in sorted((shared_data / "bags").iterdir()):
            said = payscope("info", path)
            if said.status == 0:
                assert path.name in said.out
            else:
                one_line(said, path.name)

    def test_several_logs_are_described_though_one_is_empty(
        self, payscope: Payscope, shared_data: Path
    ) -> None:
        bags = shared_data / "bags"
        said = payscope("info", bags / "empty-file.bag", bags / "talker.mcap")
        assert said.status == 2
        assert "talker.mcap" in said.out
        assert "empty-file.bag: the file is empty" in said.err

    def test_json(self, payscope: Payscope, log: Path) -> None:
        told = json.loads(payscope("info", log, "--json").out)
        assert told["messages"] == 4000
        assert told["topics"][0]["topic"] == "table"

    def test_wrong_time_zone(self, payscope: Payscope, log: Path) -> None:
        one_line(payscope("info", log, "--timezone", "Mars/Base"), "Mars/Base")


def test_the_installed_command_answers(tmp_path: Path) -> None:
    script = Path(sys.executable).with_name("payscope")
    left = subprocess.run([script, "--version"], capture_output=True, text=True, check=True)
    assert left.stdout.startswith("payscope ")
    left = subprocess.run(
        [script, "info", tmp_path / "no.bag"], capture_output=True, text=True, check=False
    )
    assert left.returncode == 2
    assert left.stderr.count("\n") == 1
