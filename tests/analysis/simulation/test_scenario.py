"""What a scenario may be."""

import pytest
from pydantic import ValidationError

from analysis.simulation import Scenario


def test_the_defaults_are_the_papers_campaign():
    made = Scenario()
    assert made.campaign.loads_kg == (0, 50, 100, 150, 200, 250)
    assert made.campaign.runs == 9
    assert (made.machine.mass_kg, made.machine.friction_N_s_m) == (3614.0, 2891.0)


@pytest.mark.parametrize(
    ("sections", "what"),
    [
        ({"terrain": {"slope_deg": 12.0}}, "slope and Coulomb friction hold 3864 kg"),
        ({"machine": {"coulomb_N": 7000.0}}, "slope and Coulomb friction hold"),
        (
            {
                "campaign": {"valve_lag_s": 10.0, "start_s": 0.1, "throttle_force_N": 100.0},
                "machine": {"coulomb_N": 50.0},
            },
            "reaches 1 N in campaign.start_s",
        ),
        ({"terrain": {"slope_deg": -12.0}}, "does not stop the machine on this slope"),
        ({"campaign": {"throttle_force_N": 1e6}}, "beyond 50 m/s"),
        ({"campaign": {"loads_kg": [0, 50, 50]}}, "a load appears twice"),
        ({"campaign": {"loads_kg": [-50]}}, "between 0 and 1e6 kg"),
        ({"log": {"latency_jitter_s": 0.02}}, "recorded in order"),
        ({"sensors": {"force_noise_N": float("nan")}}, "finite number"),
    ],
)
def test_what_cannot_be_simulated_is_refused_with_the_reason(sections, what):
    with pytest.raises(ValidationError, match=what):
        Scenario.model_validate(sections)
