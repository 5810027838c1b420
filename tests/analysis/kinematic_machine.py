"""A machine file of a table that holds nothing but force and speed."""

from typing import Any

from analysis.model.machine import Machine


def kinematic_machine(name: str, empty_mass_kg: float, cutoff_hz: float) -> Machine:
    """Whose acceleration is derived from the speed, and whose force sees the brakes."""
    body = {"name": name, "empty_mass_kg": empty_mass_kg}
    return machine_of_force_and_speed(
        body, {"gate": {"exclude_braking": False}, "filter": {"cutoff_hz": cutoff_hz}}
    )


def machine_of_force_and_speed(body: dict[str, Any], settings: dict[str, Any]) -> Machine:
    """Whose acceleration is derived from the speed, with further settings."""
    return Machine.model_validate(
        {
            "machine": body,
            "log": {"time": "t"},
            "channels": {
                "force_x_N": {"field": "force"},
                "speed_x_m_s": {"field": "speed"},
                "acc_x_m_s2": {"derive": "d/dt speed_x_m_s"},
            },
            "settings": {"forces": {"acceleration": "kinematic"}, **settings},
        }
    )
