"""Settings that exact trials do not support, for which a log is integrated as a whole."""

from typing import Final

from pydantic import BaseModel

from analysis.simulation.scenario.manoeuvres import Excite, Manoeuvre, Rest, Start, Travel
from analysis.simulation.scenario.scenario import Scenario
from estimators.errors import ScenarioError

#: Keys of other sections by which trials differ, or conditions change within a trial.
_CHANGES_ALONG: Final = {
    "terrain": ("hills_deg",),
    "machine": ("friction_warming", "coulomb_warming", "air_N_s2_m2", "spring_N_m"),
    "rolling": ("second_ground_more", "growth_s_m", "growth_s_rad"),
}


def find_scenario_key_needing_integration(scenario: Scenario) -> str | None:
    """First key of the scenario that needs the integrated plant; None if trials are exact."""
    if scenario.shift is not None:
        return "shift"
    sections: dict[str, BaseModel] = {
        "drivetrain": scenario.drivetrain,
        "chassis": scenario.chassis,
        "brakes": scenario.brakes,
        "starts": scenario.starts,
        "loading": scenario.loading,
    }
    for name, section in sections.items():
        changed = next(iter(section.model_dump(exclude_defaults=True)), None)
        if changed is not None:
            return f"{name}.{changed}"
    for name, keys in _CHANGES_ALONG.items():
        for key in keys:
            if getattr(getattr(scenario, name), key):
                return f"{name}.{key}"
    for number, manoeuvre in enumerate(scenario.campaign.manoeuvres):
        if isinstance(manoeuvre, Start):
            for key in ("coast_s", "digging_N"):
                if getattr(manoeuvre, key):
                    return f"campaign.manoeuvres.{number}.{key}"
        if isinstance(manoeuvre, Travel):
            return f"campaign.manoeuvres.{number} (a travel)"
    return None


def refuse_settings_without_plant_support(scenario: Scenario) -> None:
    """Raise an error for settings that the integrated plant does not support.

    Raises:
        ScenarioError: a setting is not supported; the message names the key and the fault.
    """
    if scenario.drivetrain.relaxation_length_m and not scenario.machine.slip_stiffness_N:
        raise ScenarioError(
            "drivetrain.relaxation_length_m: needs slipping tyres; give machine.slip_stiffness_N "
            "as well"
        )
    asked = find_scenario_key_needing_integration(scenario)
    if asked is None:
        return
    terrain = scenario.terrain
    if scenario.starts.turn_rad_s and (terrain.slope_deg or terrain.hills_deg):
        raise ScenarioError(
            "starts.turn_rad_s: turning starts need level ground; set terrain.slope_deg and "
            "terrain.hills_deg to 0"
        )
    for number, manoeuvre in enumerate(scenario.campaign.manoeuvres_of_trial):
        if not _is_straight(manoeuvre):
            raise ScenarioError(
                f"campaign.manoeuvres.{number}: is not a straight motion, as required with "
                f"{asked}; choose rests, starts and forces, or leave out {asked}"
            )


def _is_straight(manoeuvre: Manoeuvre) -> bool:
    if isinstance(manoeuvre, Excite):
        return manoeuvre.torque is None
    return isinstance(manoeuvre, Rest | Start | Travel)
