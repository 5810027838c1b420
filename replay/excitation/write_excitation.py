"""Write a design of excitation as a scenario, or give it as plain values."""

from pathlib import Path
from typing import Any

from analysis.excitation import Design, Score
from analysis.simulation import Scenario
from recordings.report.atomic_output import atomic_file
from replay.simulation.scenario_file import scenario_text


def write_design(design: Design, base: Scenario, output: Path, *, force: bool = False) -> None:
    """Write the best waveform as a scenario file that `simulate` accepts.

    Raises:
        DataError: no waveform fits the yard.
        OutputError: the file is there already, or its folder cannot be written to.
    """
    text = scenario_text(design.scenario(base))
    with atomic_file(output, force=force) as partial:
        partial.write_text(text, encoding="utf-8")


def to_dict(design: Design) -> dict[str, Any]:
    """The design as plain values."""
    return {
        "motion": design.drive,
        "response_s": dict(design.response_s),
        "window_s": design.window_s,
        "accuracy": design.accuracy,
        "reached": design.is_reached,
        "waveforms": [_score(score, best=score is design.best) for score in design.scores],
    }


def _score(score: Score, *, best: bool) -> dict[str, Any]:
    manoeuvre = score.manoeuvre.model_dump(exclude_none=True)
    return {
        "waveform": score.waveform,
        "ways": score.ways,
        "best": best,
        "force": manoeuvre.get("force"),
        "torque": manoeuvre.get("torque"),
        "duration_s": score.manoeuvre.duration_s,
        "window_start_s": score.start_s,
        "predictions": {
            name: {"value": each.value, "std": each.std, "bias": each.bias, "rms": each.rms}
            for name, each in score.predictions.items()
        },
        "relative_error": score.relative_error,
        "rank": score.rank,
        "condition": score.condition,
        "snr": score.snr,
        "snr_needed": score.snr_needed,
        "peak_speed_m_s": score.peak_speed_m_s,
        "reach_m": score.reach_m,
    }
