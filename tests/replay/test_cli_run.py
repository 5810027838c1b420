"""`payscope run` and the installed command: answers and exit statuses."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from rich.console import Console

from analysis.model.answer import Answer, AnswerRow
from analysis.model.verdict import Check, Verdict
from recordings import read_recording
from replay.commands import print_tables
from replay.commands.run import print_answer
from replay.runs.run_logs import STEPS
from tests.analysis.plane_drives import NOISE, arcs, sensors, spins, starts
from tests.replay.sledge import Payscope, join_to_one_line, sledge

pytestmark = pytest.mark.usefixtures("kept_replays")


class TestRun:
    @pytest.mark.heavy
    def test_prints_the_answer_and_writes_the_recording(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "-o", tmp_path / "out.rrd")
        assert said.status == 0, said.err
        assert "Log usable: " in said.out
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

    def test_json_has_the_answer_with_what_it_is_worth(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        told = ["--set", "machine.force_gain_u=0.01"]
        answer = json.loads(payscope("run", log, "-m", machine_file, "--json", *told).out)
        (load,) = answer["loads"]
        assert abs(load["mass_kg"] - 120.0) < 3.0 * load["u_kg"]
        assert answer["mass_kg"]["joint"] == load["mass_kg"]
        assert answer["mass_std_kg"]["joint"] == load["u_kg"]
        assert load["scale_unknown"] == ""
        assert [row["term"] for row in answer["nuisances"]][:2] == ["const", "lag"]
        assert all(row["prior_std"] > 0.0 for row in answer["nuisances"])
        (gain,) = (row for row in answer["budget"] if row["cause"] == "force_gain")
        assert gain["u_kg"] == pytest.approx(0.01 * load["mass_kg"])
        assert sum(row["share_1"] for row in answer["budget"]) == pytest.approx(1.0)
        assert {check["consequence"] for check in answer["verdict"]["checks"]} == {
            "withhold",
            "widen",
            "method",
            "tell",
        }

    def test_the_mass_comes_first_with_its_budget_and_the_methods_below(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        lines = payscope("run", log, "-m", machine_file, "-vv").out.splitlines()
        assert re.fullmatch(r"mass 1\d\d\S* ± \S+ kg \(standard uncertainty\), 95 %: .*", lines[0])
        begins = [line.split("  ")[0] for line in lines]
        assert begins.index("uncertainty from") < begins.index("method") < begins.index("check")
        assert any(line.startswith("± excludes scale error: set ") for line in lines)

    @pytest.mark.heavy
    def test_the_answer_takes_a_dozen_lines_v_adds_its_budget_and_vv_every_check(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "out.rrd"
        brief = payscope("run", log, "-m", machine_file, "-o", out).out
        assert len(brief.splitlines()) <= 14
        assert f"payscope explain {out} says why" in brief
        more, every = (payscope("run", log, "-m", machine_file, v).out for v in ("-v", "-vv"))
        assert "uncertainty from" not in brief
        assert "uncertainty from" in more
        assert "force_sign" not in more
        assert "force_sign" in every

    def test_a_check_near_its_limit_is_printed_in_full(
        self, capsys: pytest.CaptureFixture[str]
    ) -> None:
        checks = (
            Check("close", "mass", 0.9, None, 1.0, passed=True, meaning="what is close"),
            Check("far", "mass", 0.1, None, 1.0, passed=True, meaning="what is far"),
        )
        print_answer(Answer((), [], [], [], [], 0.1, Verdict(checks)))
        said = capsys.readouterr().out
        assert re.search(r"^close +0\.9 +≤ 1 +near +what is close", said, re.M)
        assert "what is far" not in said
        assert "2 checks passed" in said

    @pytest.mark.parametrize(("verbose", "shown"), [(0, 24), (1, 243)])
    def test_the_loads_of_a_shift_are_counted_beyond_two_dozen(
        self, capsys: pytest.CaptureFixture[str], verbose: int, shown: int
    ) -> None:
        load = {"start_t_ns": 0, "end_t_ns": 10**9, "manoeuvres": 2, "mass_kg": 3600.0}
        load |= {"u_kg": 30.0, "payload_kg": 0.0, "payload_u_kg": 30.0}
        load |= {"scale_unknown": "", "braking_left_out": False, "withheld_for": ""}
        loads = [{"load_id": number} | load for number in range(243)]
        print_answer(Answer((), loads, [], [], [], 0.1, Verdict()), verbosity=verbose)
        said = capsys.readouterr().out
        assert len(re.findall(r"3600 ± 30", said)) == shown
        assert ("219 more loads (-v)" in said) is (verbose == 0)

    @pytest.mark.parametrize("width", [80, 100, 160])
    def test_no_row_of_a_table_is_wider_than_the_screen(
        self,
        payscope: Payscope,
        log: Path,
        machine_file: Path,
        width: int,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        screen = Console(highlight=False, width=width, force_terminal=False)
        monkeypatch.setattr(print_tables, "make_stdout_console", lambda: screen)
        said = payscope("run", log, "-m", machine_file, "-vv")
        sentences = (
            "± excludes scale error: ",
            "largest contribution: ",
            "finding: ",
            "mass ",
            "fingerprint: ",
        )
        rows = [line for line in said.out.splitlines() if not line.startswith(sentences)]
        assert len(rows) > 40
        assert max(len(line) for line in rows) <= width

    @pytest.mark.heavy
    def test_a_force_that_is_too_late_withholds_the_mass_says_how_to_mend_it_and_exits_1(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        late = tmp_path / "late.csv"
        sledge().with_columns(pl.col("force_N").shift(12, fill_value=0.0)).write_csv(late)
        said = payscope("run", late, "-m", machine_file)
        assert said.status == 1
        assert said.out.startswith("Log not usable for weighing: the mass is withheld.")
        assert "force_delay_s: channels.force_x_N.delay_s" in said.out
        mended = ["--set", "channels.force_x_N.delay_s=0.12"]
        assert payscope("run", late, "-m", machine_file, *mended).status == 0

    @pytest.mark.heavy
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
            "run", log, "-m", machine_file, "--json", "--set", "settings.gate.threshold_nat=9"
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
        row = AnswerRow(numbers, {"pooled": 1}, withheld=False)
        print_answer(Answer((row,), [], [], [], [], 0.1, Verdict()), verbosity=1)
        assert "120.00  " in capsys.readouterr().out

    @pytest.mark.usefixtures("not_kept")
    def test_timing_splits_the_seconds_by_stage(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("run", log, "-m", machine_file, "--timing")
        for stage in (
            "open",
            "read",
            "derive",
            "align",
            "smooth",
            "forces",
            "gate",
            "trace",
            "verdict",
        ):
            assert stage in said.err
        multiple = r"^total +([0-9.]+) s; without open, ([0-9.]+) times as long as decode and read$"
        total = re.search(multiple, said.err, re.M)
        assert total is not None
        assert float(total[1]) >= 0.0
        assert float(total[2]) >= 1.0

    @pytest.mark.heavy
    @pytest.mark.usefixtures("not_kept")
    def test_the_bar_is_as_long_as_a_replay_with_its_recording_has_stages(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        output = tmp_path / "out.rrd"
        said = payscope("run", log, "-m", machine_file, "-o", output, "--timing")
        assert len(re.findall(r"^\w+ +[0-9.]+ s$", said.err, re.M)) == len(STEPS)

    @pytest.mark.heavy
    def test_a_failed_verdict_withholds_the_mass_lists_the_checks_and_exits_1(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        unsigned = tmp_path / "unsigned.csv"
        sledge().with_columns(pl.lit(1.0).alias("force_N")).write_csv(unsigned)
        said = payscope("run", unsigned, "-m", machine_file, "-o", tmp_path / "out.rrd")
        assert said.status == 1
        assert "Log not usable" in said.out
        assert "opposing_share" in said.out
        kept = read_recording(tmp_path / "out.rrd").frames["masses"]
        assert kept["mass_kg"].null_count() == kept.height

    @pytest.mark.heavy
    def test_strict_refuses_a_log_with_a_loss_and_writes_nothing(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        holed = tmp_path / "holed.csv"
        sledge().with_columns(
            pl.when(pl.int_range(pl.len()) == 100).then(None).otherwise("force_N").alias("force_N")
        ).write_csv(holed)
        out = tmp_path / "out.rrd"
        join_to_one_line(
            payscope("run", holed, "-m", machine_file, "-o", out, "--strict"), "--strict"
        )
        assert not out.exists()
        assert payscope("run", holed, "-m", machine_file, "-o", out).status == 0
        assert "lost: " in payscope("show", out).out

    def test_strict_refuses_a_log_that_was_torn_in_the_middle_of_a_row(
        self, payscope: Payscope, machine_file: Path, log: Path
    ) -> None:
        log.write_bytes(log.read_bytes()[:-40])
        said = payscope("run", log, "-m", machine_file, "--strict")
        join_to_one_line(
            said, "sledge.csv: its last row", "is cut off", "; leave out --strict to replay"
        )


@pytest.mark.heavy
def test_the_installed_command_answers(tmp_path: Path) -> None:
    script = Path(sys.executable).with_name("payscope")
    left = subprocess.run([script, "--version"], capture_output=True, text=True, check=True)
    assert left.stdout.startswith("payscope ")
    left = subprocess.run(
        [script, "info", tmp_path / "no.bag"], capture_output=True, text=True, check=False
    )
    assert left.returncode == 2
    assert left.stderr.count("\n") == 1


class TestTurns:
    """A log with spins and arcs: inertia and centre of mass beside the mass."""

    LOADER = (
        """
[machine]
name = "loader"
empty_mass_kg = 3614.0
[log]
time = "time_s"
"""
        + "".join(f'[channels.{name}]\nfield = "{name}"\n' for name in NOISE)
        + """
[channels.yaw_acc_rad_s2]
derive = "d/dt yaw_rate_rad_s"
[settings.trace]
methods = ["pooled"]
"""
    )

    @pytest.fixture
    def loader(self, tmp_path: Path) -> Path:
        path = tmp_path / "loader.toml"
        path.write_text(self.LOADER)
        return path

    def table(
        self, path: Path, drive: list[tuple[np.ndarray, np.ndarray]], **changes: pl.Expr
    ) -> Path:
        said = sensors(drive).with_columns(time_s=pl.col("unix_ns") / 1e9, **changes)
        said.drop("unix_ns").write_csv(path)
        return path

    @pytest.mark.heavy
    def test_inertia_and_centre_of_mass_are_printed_and_recorded(
        self, payscope: Payscope, loader: Path, tmp_path: Path
    ) -> None:
        log = self.table(tmp_path / "turns.csv", starts() + spins() + arcs())
        recording = tmp_path / "turns.rrd"
        said = payscope("run", log, "-m", loader, "-o", recording)
        assert said.status == 0
        assert re.search(r"^yaw inertia \S+ ± \S+ kg·m²", said.out, re.M)
        assert "yaw inertia kg·m²" in payscope("run", log, "-m", loader, "-v").out
        assert "m ahead of the origin" in said.out
        assert "m to its right" in said.out
        answer = json.loads(payscope("run", log, "-m", loader, "--json").out)
        assert answer["inertia_z_kg_m2"]["pooled"] == pytest.approx(4200.0, rel=0.02)
        assert answer["verdict"]["tells_inertia"] is True
        assert answer["planar"][-1]["kind"] == "joint"
        shown = json.loads(payscope("show", recording, "planar", "--format", "json").out)
        assert shown == answer["planar"]

    @pytest.mark.heavy
    def test_spins_that_fail_withhold_the_inertia_and_leave_exit_status_and_mass(
        self, payscope: Payscope, loader: Path, tmp_path: Path
    ) -> None:
        unsigned = {"torque_z_N_m": pl.col("torque_z_N_m").abs()}
        log = self.table(tmp_path / "unsigned.csv", starts() + spins(), **unsigned)
        said = payscope("run", log, "-m", loader)
        assert said.status == 0
        assert "yaw inertia" not in said.out
        assert re.search(r"Log usable: \d+ checks of the mass passed", said.out)
        assert "No inertia estimate: the checks of the spins" in said.out
