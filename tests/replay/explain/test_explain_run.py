"""`payscope explain`: why, from a recording or a log; and a machine file that is mended."""

import json
import subprocess
from pathlib import Path

import polars as pl
import pytest

from analysis import Run
from analysis.model.schema import conform_frame_to_schema
from recordings import read_recording, write_recording
from recordings.rrd.viewer import find_viewer_executable
from replay.explain.proposal_edits import Proposal, insert_proposals_into_machine_file
from tests.replay.sledge import MACHINE, Payscope, join_to_one_line

pytestmark = pytest.mark.usefixtures("kept_replays")

LATE = MACHINE.replace('field = "force_N"', 'field = "force_N"  # of the motor\ndelay_s = 0.05')

FLIPPED = MACHINE.replace(
    'field = "force_N"', 'field = "force_N"  # of the motor\nscale = -1.0  # as mounted'
)


@pytest.fixture
def late(tmp_path: Path) -> Path:
    """A machine file that takes the force to be 50 ms late, which it is not."""
    path = tmp_path / "late.toml"
    path.write_text(LATE)
    return path


@pytest.mark.heavy
def test_a_recording_is_explained_as_it_is_and_a_log_by_its_replay(
    payscope: Payscope, log: Path, late: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.rrd"
    payscope("run", log, "-m", late, "-o", out)
    recorded, replayed = payscope("explain", out), payscope("explain", log, "-m", late)
    assert recorded.status == replayed.status == 0, recorded.err
    assert recorded.out == replayed.out
    assert "delay (force_x_N)" in recorded.out
    assert "set channels.force_x_N.delay_s = " in recorded.out
    assert "\nmanoeuvres farthest from their load:\n" in recorded.out


def test_where_nothing_was_accepted_the_longest_manoeuvres_are_listed(
    payscope: Payscope, log: Path, machine_file: Path
) -> None:
    never = "settings.gate.threshold_nat=50"
    told = payscope("explain", log, "-m", machine_file, "--set", never).out
    assert "\nlongest manoeuvres without a mass:\n" in told


@pytest.fixture
def recovered(payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path) -> Path:
    """What the recorder saves of a recording that was cut off."""
    whole, cut = tmp_path / "whole.rrd", tmp_path / "cut.rrd"
    payscope("run", log, "-m", machine_file, "-o", whole)
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    saved = tmp_path / "recovered.rrd"
    command = [find_viewer_executable(), "rrd", "optimize", cut, "-o", saved]
    subprocess.run(command, check=True, capture_output=True)
    return saved


@pytest.mark.heavy
def test_what_a_recording_lost_is_not_taken_for_what_its_log_does_not_show(
    payscope: Payscope, recovered: Path, tmp_path: Path
) -> None:
    join_to_one_line(payscope("explain", recovered), "is incomplete", "rows", "replay the log")
    assert payscope("plot", recovered, "-o", tmp_path / "some.png").status == 0
    both = tmp_path / "both.rrd"
    said = payscope("compare", tmp_path / "whole.rrd", recovered, "-o", both)
    assert said.status == 1, said.err
    assert both.exists()


@pytest.mark.heavy
def test_a_recording_that_keeps_no_stages_is_not_explained_or_drawn(
    payscope: Payscope, log: Path, machine_file: Path, late: Path, tmp_path: Path
) -> None:
    a, b, both = (tmp_path / f"{name}.rrd" for name in ("a", "b", "both"))
    payscope("run", log, "-m", machine_file, "-o", a)
    payscope("run", log, "-m", late, "-o", b)
    assert payscope("compare", a, b, "-o", both).status == 1
    join_to_one_line(payscope("explain", both), "contains no frames", "two replays", "payscope run")
    join_to_one_line(payscope("plot", both, "-o", tmp_path / "both.png"), "contains no frames")
    assert not (tmp_path / "both.png").exists()


def test_json_has_everything_that_is_said(payscope: Payscope, log: Path, late: Path) -> None:
    told = json.loads(payscope("explain", log, "-m", late, "--at", 16, "--json").out)
    first = told["findings"][0]
    assert (first["cause"], first["setting"]) == ("delay", "channels.force_x_N.delay_s")
    assert told["at_s"] == 16.0
    assert told["gate"][0]["reason"]
    assert {"determined", "verdict", "loads", "manoeuvre"} <= set(told)


def test_a_moment_outside_of_the_run_is_one_line(
    payscope: Payscope, log: Path, late: Path, tmp_path: Path
) -> None:
    picture = tmp_path / "why.png"
    for second in ("-5", "900"):
        said = payscope("explain", log, "-m", late, "--at", second, "-o", picture)
        join_to_one_line(said, log.name, f"has no data at {second} s", "it has 0 to 39.9 s")
    assert not picture.exists()


@pytest.fixture
def flipped(tmp_path: Path) -> Path:
    """A machine file that takes the force the wrong way round."""
    path = tmp_path / "flipped.toml"
    path.write_text(FLIPPED)
    return path


def test_a_mended_machine_file_keeps_comments_and_order_and_is_replayed(
    payscope: Payscope, log: Path, flipped: Path, tmp_path: Path
) -> None:
    target, picture = tmp_path / "mended.toml", tmp_path / "why.png"
    said = payscope("explain", log, "-m", flipped, "--apply", "-o", target, "-o", picture, "--json")
    assert said.status == 0, said
    told = json.loads(said.out)
    mended_to = told["mended"]
    assert told["can_weigh"] is False
    assert [each["key"] for each in mended_to["changes"]] == ["channels.force_x_N.scale"]
    assert mended_to["can_weigh"] is True
    mass = mended_to["loads"][0]["mass_kg"]
    assert mass == pytest.approx(120.0, abs=1.0)
    lines = target.read_text().splitlines()
    bare = [line.partition(" #")[0].rstrip() for line in FLIPPED.splitlines()]
    assert [line.partition(" #")[0].rstrip() for line in lines] == [
        "scale = 1" if line == "scale = -1.0" else line for line in bare
    ]
    (line,) = (line for line in lines if line.startswith("scale"))
    assert "# as mounted; payscope: sign flipped; " in line
    assert line.endswith("; it was -1.0")
    assert 'field = "force_N"  # of the motor' in lines
    assert picture.read_bytes().startswith(b"\x89PNG")
    again = payscope("run", log, "-m", target, "--json")
    assert json.loads(again.out)["loads"][0]["mass_kg"] == mass


@pytest.mark.heavy
def test_a_delay_is_mended_to_within_a_millisecond(
    payscope: Payscope, log: Path, late: Path, tmp_path: Path
) -> None:
    target = tmp_path / "mended.toml"
    said = payscope("explain", log, "-m", late, "--apply", "-o", target, "--json")
    assert said.status == 0, said
    (change,) = json.loads(said.out)["mended"]["changes"]
    assert change["key"] == "channels.force_x_N.delay_s"
    assert abs(change["value"]) < 0.001
    (line,) = (line for line in target.read_text().splitlines() if line.startswith("delay_s"))
    assert line.endswith("; it was 0.05")


def with_findings(run: Run, *findings: dict[str, str]) -> Run:
    """The run with findings that it does not have."""
    nothing = dict.fromkeys(run.frames["findings"].columns)
    rows = [
        {
            **nothing,
            "rank": rank,
            "severity": "widen",
            "strength_1": 3.0,
            "evidence": "a mistake",
            "alternatives": "",
            **finding,
        }
        for rank, finding in enumerate(findings, 1)
    ]
    wrong = conform_frame_to_schema("findings", pl.DataFrame(rows, infer_schema_length=None))
    return Run({**run.frames, "findings": wrong}, run.provenance)


@pytest.mark.heavy
def test_a_proposal_that_leaves_the_log_unable_to_weigh_is_taken_back(
    payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
) -> None:
    out, target = tmp_path / "out.rrd", tmp_path / "mended.toml"
    payscope("run", log, "-m", machine_file, "-o", out)
    doubted = with_findings(
        read_recording(out),
        {"cause": "too_little_excitation", "setting": "settings.gate.threshold_nat", "value": "50"},
    )
    write_recording(doubted, out, overwrites=True)
    said = payscope("explain", out, "-m", machine_file, "--apply", "-o", target)
    assert said.status == 1, said
    assert "not settings.gate.threshold_nat (too little excitation): the log could" in said.out
    assert not target.exists()


@pytest.mark.heavy
def test_what_a_cause_explains_that_stays_is_not_mended(
    payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
) -> None:
    out, target = tmp_path / "out.rrd", tmp_path / "mended.toml"
    payscope("run", log, "-m", machine_file, "-o", out)
    doubted = with_findings(
        read_recording(out),
        {"cause": "quantised"},
        {"cause": "delay", "setting": "channels.force_x_N.delay_s", "value": "0.05"},
    )
    write_recording(doubted, out, overwrites=True)
    said = payscope("explain", out, "-m", machine_file, "--apply", "-o", target)
    assert said.status == 1, said
    why = "delay_s (delay): quantised explains this finding and is still present"
    assert f"not channels.force_x_N.{why}" in said.out.replace("\n", " ")


def test_where_nothing_pays_no_file_is_written_and_the_status_says_so(
    payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
) -> None:
    target = tmp_path / "mended.toml"
    said = payscope("explain", log, "-m", machine_file, "--apply", "-o", target)
    assert said.status == 1
    assert "no proposal improves the mass" in said.out
    assert not target.exists()


CHANGE = Proposal("channels.force_x_N.scale", -1.0, "sign_flipped", "sign flipped; why")


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (
            "# mine\n[channels.force_x_N]\nscale = 1.0 # theirs\nfield = 'a'\n",
            "# mine\n[channels.force_x_N]\n"
            "scale = -1.0 # theirs; payscope: sign flipped; why; it was 1.0\nfield = 'a'\n",
        ),
        (
            "[channels.force_x_N]\nfield = 'a' # b\n",
            "[channels.force_x_N]\nfield = 'a' # b\nscale = -1.0 # payscope: sign flipped; why\n",
        ),
        ("channels.force_x_N = {scale = 2.0}\n", "channels.force_x_N = {scale = -1.0}\n"),
    ],
    ids=["over a value", "a new key", "inline"],
)
def test_a_change_is_written_where_the_key_is(text: str, wanted: str) -> None:
    import tomllib

    written = insert_proposals_into_machine_file(text, [CHANGE], Path("machine.toml"))
    assert tomllib.loads(written) == tomllib.loads(wanted)
    if "{" not in text:
        assert written == wanted


def test_a_boolean_is_changed_with_its_comment() -> None:
    change = Proposal("settings.gate.exclude_braking", True, "braking_inside", "why")
    text = "[settings.gate]\nexclude_braking = false  # electric\n"
    assert insert_proposals_into_machine_file(text, [change], Path("m.toml")).endswith(
        "exclude_braking = true # electric; payscope: why; it was false\n"
    ) or "true  # electric; payscope: why; it was false" in insert_proposals_into_machine_file(
        text, [change], Path("m.toml")
    )


class TestRefused:
    """Nothing on stdout, one line on stderr, exit status 2."""

    def test_a_log_without_its_machine_file(self, payscope: Payscope, log: Path) -> None:
        join_to_one_line(payscope("explain", log), "sledge.csv", "-m")

    def test_apply_without_a_file_or_a_machine_file(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        join_to_one_line(payscope("explain", log, "-m", machine_file, "--apply"), "-o mended.toml")
        target = tmp_path / "mended.toml"
        join_to_one_line(payscope("explain", log, "-m", machine_file, "-o", target), "--apply")
        join_to_one_line(
            payscope("explain", tmp_path / "out.rrd", "--apply", "-o", target),
            "give that file with -m",
        )

    def test_the_machine_file_itself_as_output(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        join_to_one_line(
            payscope("explain", log, "-m", machine_file, "--apply", "-o", machine_file, "--force"),
            "is also an input",
        )

    def test_a_picture_of_no_format(
        self, payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        join_to_one_line(
            payscope("explain", log, "-m", machine_file, "-o", tmp_path / "a.bmp"), ".bmp"
        )
