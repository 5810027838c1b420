"""An answer that is read back from a recording, of today and of before the joint fit."""

import pytest

from analysis import Run, Settings
from analysis.model.answer import make_answer
from recordings import read_recording, write_recording
from recordings.rrd.recording_texts import make_texts_of_run


@pytest.mark.heavy
def test_a_recording_from_before_the_joint_fit_is_read_and_answers(drives, tmp_path):
    """It has no loads, and its checks have neither consequence nor remedy: they all withhold."""
    run = drives(30.0)
    frames = {n: f for n, f in run.frames.items() if n not in ("loads", "nuisances", "budget")}
    frames["verdict"] = frames["verdict"].drop("consequence", "remedy")
    settings = run.provenance.settings.model_dump()
    del settings["priors"]
    before = run.provenance.model_copy(update={"settings": Settings.model_validate(settings)})
    path = write_recording(Run(frames, before), tmp_path / "old.rrd")
    said = make_answer(read_recording(path))
    assert said.verdict.can_weigh
    assert [check.consequence for check in said.verdict.checks] == ["withhold"] * 3
    assert said.loads == []
    assert "joint" not in said.rows[0].methods
    assert (
        "pooled, statistical standard deviation"
        in make_texts_of_run(read_recording(path))["answer"]
    )


@pytest.mark.heavy
def test_a_recorded_answer_is_the_answer(drives, tmp_path):
    run = drives(30.0)
    kept = read_recording(write_recording(run, tmp_path / "new.rrd"))
    assert make_answer(kept).to_dict() == make_answer(run).to_dict()
