"""`payscope compare`: equal recordings, one setting changed, tolerances, and what is refused."""

import json
from pathlib import Path

import polars as pl
import pytest

from recordings import read_recording
from tests.replay.kept_replays import replays_anew
from tests.replay.sledge import Payscope, Said, join_to_one_line, sledge

pytestmark = pytest.mark.usefixtures("kept_replays")

THRESHOLD = "settings.gate.threshold_nat=1.0"


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the recordings of this module lie."""
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture
def recorded(payscope: Payscope, log: Path, machine_file: Path, kept: Path):
    """Record the sledge under a name, once, with whatever is set."""

    def record(name: str, *words: str, of: Path = log) -> Path:
        path = kept / name
        if not path.exists():
            said = payscope("run", of, "-m", machine_file, "-o", path, *words)
            assert said.status in (0, 1), said.err
        return path

    return record


def parts(said: Said) -> list[str]:
    """The titles of what was printed."""
    return [line.partition(":")[0] for line in said.out.splitlines() if line.endswith(":")]


@pytest.mark.heavy
def test_two_replays_with_the_same_settings_are_equal(payscope: Payscope, recorded) -> None:
    with replays_anew():
        said = payscope("compare", recorded("a.rrd"), recorded("again.rrd"))
    assert said.status == 0, said
    assert said.out.splitlines()[-1].startswith("Equal: ")
    assert parts(said) == []
    found = json.loads(payscope("compare", recorded("a.rrd"), recorded("a.rrd"), "--json").out)
    assert found["equal"] is True
    assert found["stages"] == found["settings"] == found["estimates"] == []
    frames = read_recording(recorded("a.rrd")).frames
    assert found["columns"] == sum(frame.width for frame in frames.values())


@pytest.mark.heavy
def test_a_changed_setting_is_named_with_what_it_moves_and_nothing_else(
    payscope: Payscope, recorded
) -> None:
    a, b = recorded("a.rrd"), recorded("b.rrd", "--set", THRESHOLD)
    found = json.loads(payscope("compare", a, b, "--json").out)
    assert found["settings"] == [{"name": "settings.gate.threshold_nat", "a": 0.7, "b": 1.0}]
    assert found["inputs"] == found["versions"] == found["only_a"] == found["only_b"] == []
    changed = {stage["name"]: stage for stage in found["stages"]}
    upstream = {"raw/table", "aligned", "excitation", "noise", "digging"}
    assert not upstream & set(changed)
    frames = [read_recording(path).frames for path in (a, b)]
    gates = [frame["gate"]["accepted_x"] for frame in frames]
    (accepted,) = (c for c in changed["gate"]["columns"] if c["name"] == "accepted_x")
    assert accepted["rows"] == (gates[0] != gates[1]).sum() > 0
    estimates = [frame["estimates/ls"].height for frame in frames]
    traced = changed["estimates/ls"]
    assert [traced["rows_a"], traced["rows_b"]] == estimates
    assert traced["common"] == estimates[1] < estimates[0]


@pytest.mark.heavy
def test_estimates_stand_side_by_side_and_those_that_moved_most_first(
    payscope: Payscope, recorded
) -> None:
    a, b = recorded("a.rrd"), recorded("b.rrd", "--set", THRESHOLD)
    said = payscope("compare", a, b)
    assert said.status == 1
    assert "They differ" in said.out.splitlines()[-1]
    assert "settings.gate.threshold_nat" in said.out
    found = json.loads(payscope("compare", a, b, "--json").out)
    moves = [abs(each["change_in_stds"]) for each in found["estimates"]]
    assert moves == sorted(moves, reverse=True)
    masses = [read_recording(path).frames["masses"] for path in (a, b)]
    of_ls = [float(m.filter(method="ls")["mass_kg"][0]) for m in masses]
    (ls,) = (e for e in found["estimates"] if e["about"] == "ls" and e["quantity"] == "mass_kg")
    assert [ls["a"], ls["b"]] == of_ls
    assert ls["change"] == pytest.approx(of_ls[1] - of_ls[0])


@pytest.mark.heavy
def test_manoeuvres_whose_mass_moved_stand_side_by_side(payscope: Payscope, recorded) -> None:
    a, b = recorded("a.rrd"), recorded("w.rrd", "--set", "settings.smooth.samples=5")
    found = json.loads(payscope("compare", a, b, "--json").out)
    segments = [read_recording(path).frames["segments"] for path in (a, b)]
    moved = segments[0]["mass_kg"].ne_missing(segments[1]["mass_kg"]).sum()
    of_mass = [e for e in found["manoeuvres"] if e["quantity"] == "mass_kg"]
    assert len(of_mass) == moved > 0


@pytest.mark.heavy
def test_a_mass_that_is_withheld_in_one_replay_is_none_there(payscope: Payscope, recorded) -> None:
    refused = recorded("refused.rrd", "--set", "settings.gate.threshold_nat=9")
    said = payscope("compare", recorded("a.rrd"), refused)
    assert said.status == 1
    assert "checks passed" in parts(said)
    assert " none " in said.out


@pytest.mark.heavy
def test_rtol_forgives_what_is_smaller(payscope: Payscope, recorded) -> None:
    a = recorded("a.rrd")
    c = recorded("c.rrd", "--set", "machine.gravity_m_s2=9.80666")
    exact = json.loads(payscope("compare", a, c, "--json").out)
    assert [each["name"] for each in exact["settings"]] == ["machine.gravity_m_s2"]
    offset = recorded("offset.rrd", "--set", "channels.force_x_N.scale=1.0000001")
    bits = json.loads(payscope("compare", a, offset, "--json").out)
    loose = json.loads(payscope("compare", a, offset, "--rtol", "1e-5", "--json").out)
    changed = {stage["name"] for stage in bits["stages"]}
    assert {"aligned", "excitation", "masses"} <= changed
    assert "aligned" not in {stage["name"] for stage in loose["stages"]}
    assert loose["estimates"] == []
    assert len(bits["estimates"]) > 0
    masses = [c for stage in bits["stages"] if stage["name"] == "masses" for c in stage["columns"]]
    assert {c["largest_relative"] < 1e-5 for c in masses if c["name"] == "mass_kg"} == {True}


@pytest.mark.heavy
def test_another_grid_is_compared_at_the_times_that_both_have(payscope: Payscope, recorded) -> None:
    slow = recorded("slow.rrd", "--set", "settings.align.rate_hz=50")
    found = json.loads(payscope("compare", recorded("a.rrd"), slow, "--json").out)
    (aligned,) = (stage for stage in found["stages"] if stage["name"] == "aligned")
    assert aligned["rows_a"] > aligned["rows_b"] == aligned["common"]


@pytest.mark.heavy
def test_a_recording_of_both_is_written_beside_what_is_printed(
    payscope: Payscope, recorded, tmp_path: Path
) -> None:
    a, b = recorded("a.rrd"), recorded("b.rrd", "--set", THRESHOLD)
    both = tmp_path / "ab.rrd"
    said = payscope("compare", a, b, "-o", both)
    assert said.status == 1
    assert said.out == payscope("compare", a, b).out
    assert read_recording(both).frames == {}
    join_to_one_line(payscope("compare", a, b, "-o", both), "exists already")
    join_to_one_line(payscope("compare", a, b, "-o", a, "--force"), "is also an input")
    join_to_one_line(payscope("compare", a, b, "-o", tmp_path / "ab.mcap"), ".rrd")


@pytest.mark.heavy
def test_a_recording_of_both_shows_what_only_one_of_them_found(
    payscope: Payscope, recorded, tmp_path: Path
) -> None:
    import rerun as rr

    a, late = recorded("a.rrd"), recorded("late.rrd", "--set", "channels.force_x_N.delay_s=0.05")
    assert read_recording(late).frames["findings"]["cause"].to_list() == ["delay"]
    both = tmp_path / "ab.rrd"
    assert payscope("compare", a, late, "-o", both).status == 1
    drawn = {chunk.entity_path for chunk in rr.chunk.RrdReader(both).store().stream()}
    assert {"/A/states/gate", "/B/states/gate", "/B/states/finding"} <= drawn
    assert "/A/states/finding" not in drawn


class TestRefused:
    """Nothing on stdout, one line on stderr, exit status 2."""

    @pytest.mark.heavy
    def test_other_logs_unless_asked_for(
        self, payscope: Payscope, recorded, tmp_path: Path
    ) -> None:
        other = tmp_path / "other.csv"
        sledge(mass_kg=130.0).write_csv(other)
        a, d = recorded("a.rrd"), recorded("d.rrd", of=other)
        join_to_one_line(
            payscope("compare", a, d), "different logs", "sledge.csv", "other.csv", "--other"
        )
        said = payscope("compare", a, d, "--other-logs", "--json")
        assert said.status == 1
        found = json.loads(said.out)
        assert {stage["name"] for stage in found["stages"]} <= {"masses", "verdict"}
        (pooled,) = (
            e for e in found["estimates"] if (e["about"], e["quantity"]) == ("pooled", "mass_kg")
        )
        assert pooled["change"] == pytest.approx(10.0, abs=1.0)

    @pytest.mark.heavy
    def test_the_same_log_under_another_name_is_no_other_log(
        self, payscope: Payscope, recorded, log: Path, tmp_path: Path
    ) -> None:
        renamed = tmp_path / "renamed.csv"
        renamed.write_bytes(log.read_bytes())
        said = payscope("compare", recorded("a.rrd"), recorded("r.rrd", of=renamed))
        assert said.status == 0, said
        assert "renamed.csv" in said.out

    def test_what_is_no_recording(self, payscope: Payscope, recorded, log: Path) -> None:
        join_to_one_line(payscope("compare", recorded("a.rrd"), log), "not a Rerun recording")
        join_to_one_line(payscope("compare", "no.rrd", recorded("a.rrd")), "no such recording")

    def test_a_tolerance_below_zero(self, payscope: Payscope, recorded) -> None:
        a = recorded("a.rrd")
        join_to_one_line(payscope("compare", a, a, "--rtol", "-1"), "--rtol")


@pytest.mark.heavy
def test_a_replay_of_a_recording_is_compared_with_it(
    payscope: Payscope, recorded, machine_file: Path, tmp_path: Path
) -> None:
    again = tmp_path / "again.rrd"
    said = payscope("run", recorded("a.rrd"), "-m", machine_file, "-o", again, "--set", THRESHOLD)
    assert said.status in (0, 1), said.err
    for pair in ((recorded("a.rrd"), again), (again, recorded("a.rrd"))):
        found = json.loads(payscope("compare", *pair, "--json").out)
        assert {change["name"] for change in found["settings"]} == {"settings.gate.threshold_nat"}
        assert "gate" in {stage["name"] for stage in found["stages"]}
    join_to_one_line(
        payscope("compare", recorded("b.rrd", "--set", THRESHOLD), again), "different logs"
    )


@pytest.mark.heavy
def test_the_shortest_of_what_both_have_is_compared_when_rows_are_lost(
    payscope: Payscope, recorded, kept: Path
) -> None:
    """A recording that lacks a stage is told to lack it."""
    from dataclasses import replace

    from recordings import write_recording

    run = read_recording(recorded("a.rrd"))
    fewer = {name: frame for name, frame in run.frames.items() if name != "planar"}
    fewer["gate"] = fewer["gate"][:-10].with_columns(pl.col("mi_x_nat") + 0.0)
    path = write_recording(replace(run, frames=fewer), kept / "fewer.rrd", overwrites=True)
    said = payscope("compare", recorded("a.rrd"), path)
    assert said.status == 1
    assert "stages in A alone: planar" in said.out
    height = run.frames["gate"].height
    assert f"{height:,} rows in A, {height - 10:,} in B, {height - 10:,} in both" in said.out
