"""`payscope run` prints and stores the fingerprint of a run."""

import json
from pathlib import Path

from recordings import read_recording
from tests.replay.sledge import Payscope


def test_one_line_shows_it_and_json_and_recording_hold_it_whole(
    payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.rrd"
    said = payscope("run", log, "-m", machine_file, "-o", out)
    (line,) = [line for line in said.out.splitlines() if line.startswith("fingerprint: ")]
    kept = read_recording(out)
    taken = kept.provenance.fingerprint
    assert taken is not None
    assert line == f"fingerprint: {taken}"
    assert kept.fingerprinted() == kept
    assert list(taken.frames) == list(kept.frames)
    answer = json.loads(payscope("run", log, "-m", machine_file, "--json").out)
    assert answer["fingerprint"] == {
        "inputs": taken.inputs,
        "settings": taken.settings,
        "results": taken.results,
    }


def test_another_setting_and_another_name_of_the_log_change_what_they_should(
    payscope: Payscope, log: Path, machine_file: Path
) -> None:
    def taken(*words: object) -> dict[str, str]:
        return json.loads(payscope("run", *words, "-m", machine_file, "--json").out)["fingerprint"]

    first = taken(log)
    renamed = log.with_name("renamed.csv")
    renamed.write_bytes(log.read_bytes())
    assert taken(renamed) == first
    other = taken(log, "--set", "settings.gate.threshold_nat=0.9")
    assert [name for name in first if first[name] != other[name]] == ["settings", "results"]
