"""Whatever is wrong with input or output: one line, exit 2, never half a file."""

import json
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

from recordings import read_recording
from tests.conftest import REPO
from tests.replay.fewer_rights import obeying_modes
from tests.replay.sledge import Payscope, Said, join_to_one_line, sledge


class TestWrongInput:
    """Each fault by name: exit 2 and one line, or a stated refusal; never half a file."""

    @pytest.fixture(autouse=True)
    def _nothing_half_written(self, tmp_path: Path):
        yield
        assert not list(tmp_path.glob("*.rrd"))
        assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]

    def test_missing_log(self, payscope: Payscope, machine_file: Path, tmp_path: Path) -> None:
        join_to_one_line(
            payscope("run", tmp_path / "no.bag", "-m", machine_file), "no.bag", "no such"
        )

    def test_missing_machine_file(self, payscope: Payscope, log: Path, tmp_path: Path) -> None:
        join_to_one_line(payscope("run", log, "-m", tmp_path / "no.toml"), "no.toml")

    def test_directory_without_bags(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "empty").mkdir()
        join_to_one_line(payscope("run", tmp_path / "empty", "-m", machine_file), "contains no log")

    def test_wrong_suffix(self, payscope: Payscope, machine_file: Path, tmp_path: Path) -> None:
        (tmp_path / "log.doc").write_text("hello")
        join_to_one_line(payscope("run", tmp_path / "log.doc", "-m", machine_file), ".bag", ".mcap")

    def test_wrong_field_names_the_choices(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.field=force_n")
        join_to_one_line(said, "force_n", "force_N")

    def test_wrong_topic_names_the_nearest_and_the_key_to_set(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.topic=/tabel")
        join_to_one_line(said, "no topic '/tabel'", "table", "channels.force_x_N.topic")

    def test_wrong_unit(self, payscope: Payscope, log: Path, machine_file: Path) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.unit=kg")
        join_to_one_line(said, "sledge.toml", "channels.force_x_N", "kg")
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.unit=blob")
        join_to_one_line(said, "blob")

    def test_unknown_key_names_the_nearest(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "settings.window_sample=400")
        join_to_one_line(
            said, "settings: unknown key 'window_sample'", "'settings.gate.window_samples'?"
        )
        said = payscope("run", log, "-m", machine_file, "--set", "settings.gate.window=400")
        join_to_one_line(said, "settings.gate.window", "did you mean 'window_samples'?")

    @pytest.mark.parametrize(("stage", "meant"), [("gat", "gate"), ("smoth", "smooth")])
    def test_a_misspelt_stage_is_answered_with_the_stage(
        self, payscope: Payscope, log: Path, machine_file: Path, stage: str, meant: str
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", f"settings.{stage}.samples=4")
        join_to_one_line(said, f"unknown key 'settings.{stage}'; did you mean '{meant}'?")

    def test_override_without_a_value(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        join_to_one_line(payscope("run", log, "-m", machine_file, "--set", "rate"), "key=value")

    def test_a_value_of_another_kind_is_asked_for_in_the_words_of_toml(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        for override, wanted in (("trace.methods=ls", "a list"), ("verdict=3", "a table")):
            said = payscope("run", log, "-m", machine_file, "--set", f"settings.{override}")
            join_to_one_line(said, f"input should be {wanted}, not")
        said = payscope("run", log, "-m", machine_file, "--set", "settings.trace.methods=ls")
        join_to_one_line(said, 'write ["ls"]')

    def test_a_value_in_another_unit_is_told_which_its_key_has(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        for override, unit in (
            ("wheel_radius_m=350", "it is in m"),
            ("force_gain_u=5", "it is relative: 0.01 is 1 %"),
        ):
            said = payscope("run", log, "-m", machine_file, "--set", f"machine.{override}")
            join_to_one_line(said, unit)

    def test_a_number_beyond_all_bounds_is_named(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        many = ("--set", "settings.gate.window_samples=1" + "0" * 20)
        said = payscope("run", log, "-m", machine_file, *many)
        join_to_one_line(said, "settings.gate.window_samples", "64 bits")
        said = payscope("run", log, "-m", machine_file, "--goal", "inf")
        join_to_one_line(said, "--goal", "a finite number, not inf")
        made = ("calibrate", log, "-o", tmp_path / "check", "--previous", tmp_path / "evidence")
        join_to_one_line(payscope(*made, "--check", "inf"), "--check", "a finite number, not inf")

    @pytest.mark.parametrize(
        ("words", "says"),
        [
            (("info",), "Missing argument 'LOG'; `payscope info --help` lists what it takes"),
            (("run", "a.bag"), "`payscope init LOG -o machine.toml` drafts a machine file"),
            (("plot", "a.rrd", "-o", "b.png", "--figure", "x"), "'--figure': 'x' is not one of"),
            (("show", "a.rrd", "gate", "--from", "x"), "'--from': input should be a valid number"),
            (("show", "a.rrd", "--from", "3"), "payscope: --from, --to, --at and -o need the name"),
        ],
    )
    def test_wrong_usage_is_said_in_words_that_help(
        self, payscope: Payscope, words: tuple[str, ...], says: str
    ) -> None:
        join_to_one_line(payscope(*words), says)

    def test_a_decimal_comma_is_answered_with_the_point(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "m.toml").write_text('[machine]\nname = "a"\nwheel_radius_m = 0,42  # worn\n')
        join_to_one_line(
            payscope("run", log, "-m", tmp_path / "m.toml"), "write 0.42, with a decimal point"
        )

    @pytest.mark.parametrize(
        ("text", "says"),
        [
            ("[machin]\nwheel_radius_m = 0.4", "unknown key 'machin'; did you mean 'machine'?"),
            ('[machine]\nname = "a"\nwheel_radus_m = 0.4', "did you mean 'wheel_radius_m'?"),
            ('[machine]\nname = "a"', "needs machine.wheel_radius_m"),
        ],
    )
    def test_what_is_misspelt_comes_before_what_lacks_it(
        self, payscope: Payscope, log: Path, tmp_path: Path, text: str, says: str
    ) -> None:
        speed = 'field = "speed"\nscale = "wheel_radius_m"\n'
        (tmp_path / "m.toml").write_text(f"{text}\n[channels.speed_x_m_s]\n{speed}")
        join_to_one_line(payscope("run", log, "-m", tmp_path / "m.toml"), says)

    @pytest.mark.parametrize(
        ("text", "says"),
        [
            ('[machine]\nfile = "a.toml"\n[[masses]]', "a campaign file of `payscope calibrate`"),
            ('[machine]\nfile = "a.toml"\n[[masses]]', "the machine file that it names is a.toml"),
            ("[[machines]]", "a fleet file of `payscope fleet`"),
            ("[campaign]\n[sensors]", "a scenario file of `payscope simulate`"),
        ],
    )
    def test_another_file_of_payscope_is_named(
        self, payscope: Payscope, log: Path, tmp_path: Path, text: str, says: str
    ) -> None:
        (tmp_path / "m.toml").write_text(text)
        join_to_one_line(
            payscope("run", log, "-m", tmp_path / "m.toml"), says, "not a machine file"
        )

    def test_machine_file_without_channels_says_which_it_needs(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "m.toml").write_text('[machine]\nname = "bare"\n')
        said = payscope("run", log, "-m", tmp_path / "m.toml")
        join_to_one_line(said, "m.toml", "no force channel: give channels.force_x_N")

    def test_machine_file_that_is_no_toml(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "m.toml").write_text("[machine\n")
        join_to_one_line(payscope("run", log, "-m", tmp_path / "m.toml"), "m.toml", "TOML")

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
        join_to_one_line(payscope("run", tmp_path / "one.csv", "-m", machine_file), "single sample")

    def test_log_of_no_row(self, payscope: Payscope, machine_file: Path, tmp_path: Path) -> None:
        sledge()[:0].write_csv(tmp_path / "none.csv")
        join_to_one_line(payscope("run", tmp_path / "none.csv", "-m", machine_file), "none.csv")

    def test_channel_of_nothing_but_nan(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        nans = tmp_path / "nans.parquet"
        sledge().with_columns(pl.lit(float("nan")).alias("force_N")).write_parquet(nans)
        join_to_one_line(payscope("run", nans, "-m", machine_file), "force_x_N", "no number")

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

    @pytest.mark.heavy
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
        assert (
            "lost: shuffled.csv table: the time goes back at 1 row; all rows were sorted by time"
            in said.out
        )

    def test_text_where_a_number_should_be(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        words = tmp_path / "words.parquet"
        sledge().with_columns(pl.lit("fast").alias("force_N")).write_parquet(words)
        said = payscope("run", words, "-m", machine_file)
        join_to_one_line(said, "words.parquet with", "sledge.toml: force_x_N", "not a number")

    def test_channels_that_share_no_time(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--set", "channels.force_x_N.delay_s=1000")
        join_to_one_line(said, "the channels do not overlap in time")

    def test_live_without_a_recording_to_show(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        join_to_one_line(payscope("run", log, "-m", machine_file, "--live"), "--live", "-o")

    def test_unknown_option_and_command(self, payscope: Payscope) -> None:
        join_to_one_line(payscope("run", "--frobnicate"), "--frobnicate")
        join_to_one_line(payscope("rum"), "rum")
        join_to_one_line(payscope("run"), "LOG")


class TestOutputs:
    @pytest.mark.heavy
    def test_nothing_is_overwritten_without_force(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "out.rrd"
        out.write_text("mine")
        join_to_one_line(payscope("run", log, "-m", machine_file, "-o", out), "out.rrd", "--force")
        assert out.read_text() == "mine"
        assert payscope("run", log, "-m", machine_file, "-o", out, "--force").status == 0
        assert read_recording(out).frames

    def test_missing_folder(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "no" / "out.rrd"
        join_to_one_line(payscope("run", log, "-m", machine_file, "-o", out), "out.rrd", "folder")

    @pytest.mark.heavy
    def test_read_only_folder(self, log: Path, machine_file: Path, tmp_path: Path) -> None:
        locked = tmp_path / "locked"
        locked.mkdir(mode=0o555)
        code = "from replay.commands.cli import main; main()"
        words = ["run", log, "-m", machine_file, "-o", locked / "out.rrd"]
        left = subprocess.run(
            [*obeying_modes(), sys.executable, "-c", code, *map(str, words)],
            capture_output=True,
            text=True,
            check=False,
            cwd=REPO,
        )
        join_to_one_line(
            Said(left.returncode, left.stdout, left.stderr), "locked", "Permission denied"
        )

    def test_a_recording_ends_in_rrd_so_that_no_log_is_lost_to_force(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        other = log.with_name("other.csv")
        other.write_bytes(log.read_bytes())
        before = log.read_bytes(), machine_file.read_bytes()
        for out, words in (
            (log, "is also an input"),
            (machine_file, "is also an input"),
            (other, ".rrd"),
        ):
            said = payscope("run", log, "-m", machine_file, "-o", out, "--force")
            join_to_one_line(said, out.name, words)
        assert (log.read_bytes(), machine_file.read_bytes()) == before
        assert other.read_bytes() == log.read_bytes()

    def test_no_command_writes_over_what_it_is_given_to_read(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        logs, evidence = tmp_path / "logs", tmp_path / "evidence"
        recorded, converted = logs / "bag" / "shift.csv", tmp_path / "by_another_name.csv"
        recorded.parent.mkdir(parents=True)
        recorded.write_bytes(log.read_bytes())
        (recorded.parent / "metadata.yaml").write_text("")
        (logs / "load.csv").write_bytes(log.read_bytes())
        (logs / "damaged.bag").write_text("no bag")
        evidence.mkdir()
        (evidence / "evidence.json").write_text("{}")
        converted.hardlink_to(log)
        before = {each: each.read_bytes() for each in tmp_path.rglob("*") if each.is_file()}
        check = ("calibrate", log, "--check", "1", "--previous", evidence)
        for words, out in (
            (("query", log, "SELECT 1"), converted),
            (("sweep", log, "-m", machine_file, "--over", "a.b=1", "--format", "csv"), converted),
            (("init", "--campaign", logs), logs / "load.csv"),
            (("init", "--campaign", logs), logs / "damaged.bag"),
            (("init", "--campaign", logs, "-m", machine_file), machine_file),
            (("convert", recorded), recorded.parent),
            (check, evidence),
            ((*check, "--key", machine_file, "--dcc", machine_file), tmp_path / "new"),
        ):
            said = payscope(*words, "-o", out, "--force")
            join_to_one_line(said, "give another output")
        assert {each: each.read_bytes() for each in before} == before

    def test_a_log_is_not_overwritten_by_its_machine_file(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        before = log.read_bytes()
        (tmp_path / "link.toml").symlink_to(log)
        for out in (log, tmp_path / "link.toml"):
            join_to_one_line(
                payscope("init", log, "-o", out, "--force"), out.name, "is also an input"
            )
        assert log.read_bytes() == before
