"""Findings in the texts, in the viewer's lane and events, and in an explanation's words."""

from pathlib import Path

import polars as pl
import pytest

from analysis import Run
from analysis.explain import make_explanation
from recordings import write_recording
from recordings.explain.explanation_view import (
    describe_answer_and_likeliest_cause,
    draw_explanation,
    iter_lines_of_findings,
    iter_lines_of_gate_reasons,
    plot_explanation,
)
from recordings.report.finding_text import format_findings_markdown
from recordings.rrd.display_frames import make_display_frames
from recordings.rrd.recording_texts import format_answer_markdown
from recordings.rrd.stored_names import STATE
from recordings.rrd.writer import make_scene_of_run

S = 10**9
LANE = "display/states/finding"


def without(run: Run, *names: str) -> Run:
    kept = {name: frame for name, frame in run.frames.items() if name not in names}
    return Run(kept, run.provenance)


def healthy(run: Run) -> Run:
    return Run({**run.frames, "findings": run.frames["findings"].clear()}, run.provenance)


def test_every_finding_is_told_with_evidence_kilograms_and_what_it_cannot_be_told_from(
    drives,
) -> None:
    text = format_findings_markdown(drives(30.0))
    assert "## 1. delay (force_x_N)" in text
    for part in (
        "it is 42 ± 3 ms late",
        "fixing it changes the mass by +123 ± 10 kg",
        "set channels.force_x_N.delay_s = 0.042",
        "cannot be distinguished from: imu low passed",
        "## 2. frozen (speed_x_m_s, 7.0 to 9.0 s)",
    ):
        assert part in text
    assert "- **1** delay (force_x_N): it is 42 ± 3 ms late" in format_answer_markdown(drives(30.0))


def test_a_change_of_unknown_direction_is_only_its_uncertainty(drives) -> None:
    run = drives(30.0)
    run.frames["findings"] = run.frames["findings"].with_columns(mass_change_kg=pl.lit(0.0))
    assert "fixing it may change the mass by ± 10 kg" in format_findings_markdown(run)


def test_silence_is_an_answer_and_a_run_that_was_not_looked_at_says_nothing(drives) -> None:
    run = drives(30.0)
    assert "None of the known causes" in format_findings_markdown(healthy(run))
    assert format_findings_markdown(without(run, "findings")) == ""


def test_in_the_lane_a_finding_of_a_stretch_stands_before_one_of_the_whole_log(drives) -> None:
    lane = make_display_frames(drives(30.0))[LANE].unique("t_ns", keep="last", maintain_order=True)
    assert lane["t_ns"].to_list() == [0, 7 * S, 9 * S, 30 * S - S // 100]
    assert lane[STATE].to_list() == ["delay", "frozen", "delay", None]


def test_the_tab_is_there_only_where_there_are_findings(drives) -> None:
    def tabs(run: Run) -> list[str]:
        root = make_scene_of_run(run).layout.root_container
        return [tab.name for tab in root.contents]

    assert tabs(drives(30.0))[1] == "Findings"
    assert "Findings" not in tabs(healthy(drives(30.0)))


@pytest.mark.heavy
def test_findings_are_events_in_time(drives, tmp_path: Path) -> None:
    import rerun as rr

    path = write_recording(drives(30.0), tmp_path / "out.rrd")
    store = rr.chunk.RrdReader(path).store()
    (chunk,) = (c for c in store.stream() if c.entity_path == "/display/events")
    batch = chunk.to_record_batch()
    assert [each[0].split(" ")[0] for each in batch.column("TextLog:text").to_pylist()] == [
        "delay",
        "frozen",
    ]
    assert [each.total_seconds() for each in batch.column("t").to_pylist()] == [0.0, 7.0]


def test_the_verdict_is_one_sentence_with_the_likeliest_cause(drives) -> None:
    said = describe_answer_and_likeliest_cause(make_explanation(drives(60.0)))
    assert said.count("\n") == 0
    assert said.endswith(
        "likeliest cause of an error: delay (fixing it changes the mass by +123 ± 10 kg), "
        "and 1 finding more."
    )
    assert describe_answer_and_likeliest_cause(make_explanation(healthy(drives(60.0)))).endswith(
        "none of the known causes of an error was detected."
    )
    told = drives(60.0)
    told.frames["findings"] = told.frames["findings"].with_columns(
        severity=pl.lit("tell"), mass_change_kg=pl.lit(None, pl.Float64)
    )
    assert describe_answer_and_likeliest_cause(make_explanation(told)).endswith(
        "none of the findings is known to affect the mass: delay, frozen."
    )
    older = describe_answer_and_likeliest_cause(make_explanation(without(drives(60.0), "findings")))
    assert older.endswith("replay the log.")


def test_at_a_moment_the_gate_is_told_with_the_number_that_decided(drives) -> None:
    explained = make_explanation(drives(60.0), at_s=14.0)
    assert "at 14 s the window is accepted (index" in describe_answer_and_likeliest_cause(explained)
    lines = list(iter_lines_of_gate_reasons(explained))
    assert any("accepted (index" in line and "≥ 0.7 nat" in line for line in lines)
    # what is 5 s away is told as well, a finding elsewhere is not
    assert [each.cause for each in explained.findings or ()] == ["delay", "frozen"]
    late = make_explanation(drives(60.0), at_s=50.0)
    assert [each.cause for each in late.findings or ()] == ["delay"]


def test_the_lines_name_causes_and_proposals(drives) -> None:
    explained = make_explanation(drives(60.0))
    lines = list(iter_lines_of_findings(explained))
    assert lines[0].startswith("1. delay (force_x_N): ")
    assert "   set channels.force_x_N.delay_s = 0.042" in lines


@pytest.mark.heavy
def test_the_picture_is_drawn_of_every_kind_of_run(drives, tmp_path: Path) -> None:
    runs = {
        "nothing accepted": drives(30.0, accepted=False),
        "bare": without(drives(30.0), "findings", "loads", "estimates/rls", "gate"),
        "long": drives(300.0),
    }
    # a second a picture: of a moment, and of the whole run twice
    for (name, run), at_s in zip(runs.items(), (None, 20.0, None), strict=True):
        path = tmp_path / f"{name}.png"
        plot_explanation(run, make_explanation(run, at_s), path)
        assert path.stat().st_size > 20_000


def test_of_a_long_run_the_signals_around_what_stands_out_are_drawn(drives) -> None:
    run = drives(120.0)
    figure = draw_explanation(run, make_explanation(run))
    (*_, below) = figure.subfigs[1].subfigs
    assert below.axes[0].get_xlim()[1] < 30.0
    assert "around 8.0 s" in below.get_suptitle()


def test_a_frame_of_findings_without_rows_draws_no_lane(drives) -> None:
    assert LANE not in make_display_frames(healthy(drives(30.0)))
    assert pl.DataFrame(make_display_frames(drives(30.0))[LANE]).height
