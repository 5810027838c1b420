"""The settings and their limits."""

import pytest
from pydantic import ValidationError

from analysis.settings import Settings, VerdictLimits


def test_the_papers_values_are_the_defaults():
    settings = Settings()
    assert settings.rate_hz == 100.0
    assert settings.smooth_samples == 10
    assert settings.window_samples == 320
    assert settings.threshold_nat == 0.7
    assert settings.acceleration == "specific_force"
    assert settings.exclude_braking
    assert set(settings.methods) == {"ls", "rls", "fgls", "tls", "pooled"}


def test_every_setting_says_what_it_does():
    for name, field in Settings.model_fields.items():
        assert field.description or name == "verdict", name


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rate_hz", 0),
        ("rate_hz", 20_000),
        ("rate_hz", float("nan")),
        ("smooth_samples", 0),
        ("smooth_samples", 2.5),
        ("window_samples", 3),
        ("gate", "luck"),
        ("acceleration", "imu"),
        ("methods", ()),
        ("methods", ("kalman",)),
        ("forgetting", 0.5),
        ("forgetting", 1.01),
        ("fgls_floor", 0.01),
        ("tls_noise_force_N", 0),
        ("tls_noise_acc_m_s2", -1),
        ("tls_noise_speed_m_s", 0),
        ("derivative_cutoff_hz", 0),
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
        Settings.model_validate({name: value})


def test_settings_are_plain_values_and_back():
    settings = Settings(window_samples=400, verdict=VerdictLimits(r_squared_min=0.1))
    assert Settings.model_validate(settings.model_dump(mode="json")) == settings
