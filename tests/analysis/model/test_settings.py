"""The settings and their limits."""

import pytest
from pydantic import ValidationError

from analysis.model.settings import Settings
from analysis.model.verdict_limits import VerdictLimits
from tests.analysis.settings_by_name import settings_of


def test_the_papers_values_are_the_defaults():
    settings = Settings()
    assert settings.align.rate_hz == 100.0
    assert settings.smooth.samples == 10
    assert settings.gate.window_samples == 320
    assert settings.gate.threshold_nat == 0.7
    assert settings.forces.acceleration == "specific_force"
    assert settings.gate.exclude_braking
    assert set(settings.trace.methods) == {"ls", "rls", "fgls", "tls", "pooled"}


def test_every_setting_says_what_it_does():
    for part in Settings.list_stage_models().values():
        assert part.__doc__
        for name, field in part.model_fields.items():
            assert field.description, name


def test_no_two_stages_have_a_setting_of_one_name():
    names = [name for part in Settings.list_stage_models().values() for name in part.model_fields]
    assert len(names) == len(set(names))


def test_settings_are_changed_by_their_dotted_names():
    changed = Settings().copy_with_changes({"gate.window_samples": 400, "trace.methods": ("ls",)})
    assert changed.gate.window_samples == 400
    assert changed.trace.methods == ("ls",)
    assert changed.align == Settings().align
    for name in ("gate.window_sample", "windows.samples"):
        with pytest.raises(ValidationError):
            Settings().copy_with_changes({name: 400})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rate_hz", 0),
        ("rate_hz", 20_000),
        ("rate_hz", float("nan")),
        ("samples", 0),
        ("samples", 2.5),
        ("window_samples", 3),
        ("index", "luck"),
        ("acceleration", "imu"),
        ("methods", ()),
        ("methods", ("kalman",)),
        ("forgetting", 0.5),
        ("forgetting", 1.01),
        ("fgls_floor", 0.01),
        ("force_N", 0),
        ("acc_m_s2", -1),
        ("speed_m_s", 0),
        ("cutoff_hz", 0),
        ("gap_periods", 1),
        ("speed_rate_span_s", 0),
        ("standstill_speed_m_s", -0.1),
        ("steady_acc_m_s2", 0),
        ("turning_rate_rad_s", 0),
        ("saturation_force_N", 0),
        ("slip_acc_m_s2", 0),
        ("condition_max", 1),
        ("verdict", {"relative_std_max": 0}),
        ("verdict", {"partial_correlation_min": 2}),
        ("verdict", {"opposing_share_min": -0.1}),
    ],
)
def test_a_value_that_makes_no_sense_is_refused(name, value):
    with pytest.raises(ValidationError):
        settings_of(**{name: value})


def test_settings_are_plain_values_and_back():
    settings = Settings(gate={"window_samples": 400}, verdict=VerdictLimits(r_squared_min=0.1))
    assert Settings.model_validate(settings.model_dump(mode="json")) == settings
