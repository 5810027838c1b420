"""No cause lies in an accelerometer that the log does not have."""

from collections.abc import Sequence

import pytest

from analysis.findings import find_causes
from analysis.findings.accelerometer_causes import find_low_passed_accelerometer
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.likelihood_search import FittedCause, build_whitened_equations
from benchmarks.findings_rows import design, replayed
from benchmarks.weighed import DERIVED
from tests.twins import mark_heavy_after


@pytest.mark.heavy
@pytest.mark.parametrize(("ways", "has_one"), mark_heavy_after(1, [((), True), (DERIVED, False)]))
def test_a_filter_of_the_accelerometer_is_named_where_one_is_measured(
    monkeypatch: pytest.MonkeyPatch, ways: Sequence[str], has_one: bool
) -> None:
    kept: list[FindingInputs] = []

    def keep(inputs: FindingInputs) -> object:
        kept.append(inputs)
        return find_causes(inputs)

    monkeypatch.setattr("replay.pipeline.find_causes", keep)
    replayed(design(7, odd=False), (), (), ways)
    inputs = kept[0]
    assert inputs.fit_without_learnt_priors is not None
    force, _ = build_whitened_equations(inputs, inputs.fit_without_learnt_priors.motion)
    assert ("delay:imu" in force.columns) is has_one
    inputs.cache["selected_causes"] = {"delay:imu": FittedCause("delay:imu", 0.4, 0.1, 400.0, ())}
    named = find_low_passed_accelerometer(inputs)
    assert bool(named) is has_one
