"""Refuse a shift that cannot be driven."""

import re
from typing import Final

from analysis.simulation.scenario.manoeuvres import Start
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.scenario.shift_plan import SimulatedShift
from analysis.simulation.trials.trial_limits import check_limits
from estimators.errors import ScenarioError

#: What of `[starts]` holds for the starts of a shift too.
_HABITS: Final = {"throttle_least", "throttle_most", "coulomb_std_N", "stick_share", "stick_hz"}


def check_shift(scenario: Scenario, shift: SimulatedShift) -> None:
    """Refuse a shift that cannot be driven.

    Raises:
        ScenarioError: the key and its fault.
    """
    campaign, machine, rate = scenario.campaign, scenario.machine, shift.turn_rad_s
    changed = {f"loading.{key}" for key in scenario.loading.model_dump(exclude_defaults=True)}
    habits = set(scenario.starts.model_dump(exclude_defaults=True)) - _HABITS
    changed |= {f"starts.{key}" for key in habits}
    changed |= {"campaign.manoeuvres"} if campaign.manoeuvres else set()
    if changed:
        raise ScenarioError(
            f"{min(changed)}: is for campaigns; leave it out, or the section 'shift'"
        )
    if shift.fuel_tank_kg >= machine.mass_kg:
        raise ScenarioError("shift.fuel_tank_kg: is part of machine.mass_kg; give less")
    needed_N_m = (
        machine.friction_z_N_m_s * rate
        + machine.coulomb_z_N_m
        + machine.inertia_z_kg_m2 * rate**2 / 2.0
    )
    if needed_N_m > scenario.full_drive[1]:
        raise ScenarioError(
            f"shift.turn_rad_s: takes up to {needed_N_m:.0f} N·m, more than full throttle gives, "
            f"{scenario.full_drive[1]:.0f} N·m; turn slower"
        )
    both = tuple(
        Start(direction=direction, throttle=scenario.starts.throttle_least)
        for direction in ("forward", "reverse")
    )
    driven = scenario.model_copy(
        update={"campaign": campaign.model_copy(update={"manoeuvres": both}), "shift": None}
    )
    try:
        check_limits(driven, [0.0, shift.load_most_kg])
    except ScenarioError as fault:
        named = re.sub(
            r"campaign\.manoeuvres\.\d+(\.start_s)?", "starts.throttle_least", str(fault)
        )
        raise ScenarioError(named) from None
