"""Resistance that opposes the motion of the integrated machine and holds it at standstill."""

import math
from typing import Final

from analysis.simulation.plant.plant_inputs import DriveStage, MachineAndGround
from estimators.compiled import compiled_inline

#: Distance between a loader's axles in m, over which one ground passes into the other.
_AXLES_APART_M: Final = 1.2


@compiled_inline
def compute_cold_friction_fraction(
    time_s: float, cold_excess_fraction: float, warming_s: float
) -> float:
    """Friction at a time over that of the cold machine, as the machine warms up."""
    if cold_excess_fraction == 0.0:
        return 1.0
    return 1.0 + cold_excess_fraction * math.expm1(-time_s / warming_s)


@compiled_inline
def compute_coulomb_friction_newtons(
    time_s: float, turn_rad_s: float, machine: MachineAndGround, stage: DriveStage
) -> float:
    """Coulomb friction at a time and yaw rate, in N: limit at rest, friction force in motion."""
    coulomb_N = stage.coulomb_N * compute_cold_friction_fraction(
        time_s, machine.coulomb_warming, machine.warming_s
    )
    capacity = coulomb_N + machine.drag_N + stage.scrub_N_s_rad * abs(turn_rad_s)
    if stage.release_s > 0.0:
        since_s = time_s - stage.release_from_s
        capacity += stage.release_N * math.exp(-since_s / stage.release_s)
    if stage.digging_N > 0.0:
        grown = (time_s - stage.digging_from_s) / stage.digging_s
        capacity += stage.digging_N * min(1.0, max(0.0, grown))
    return capacity


@compiled_inline
def compute_gentle_brake_force_newtons(
    time_s: float,
    grip: float,
    mass_kg: float,
    gravity_m_s2: float,
    machine: MachineAndGround,
    stage: DriveStage,
) -> float:
    """Force in N of unmeasured brakes, larger downhill; `grip`: sign of the motion, 0 at rest."""
    if stage.gentle_m_s2 == 0.0 or grip == 0.0:
        return 0.0
    applied = -math.expm1(-(time_s - stage.gentle_from_s) / machine.lag_s)
    return applied * mass_kg * (stage.gentle_m_s2 + max(0.0, -grip * gravity_m_s2))


@compiled_inline
def compute_rolling_resistance_newtons(
    position_m: float,
    speed_m_s: float,
    turn_rad_s: float,
    mass_kg: float,
    slope_rad: float,
    machine: MachineAndGround,
) -> float:
    """Rolling resistance in N; at standstill, the largest force that it can hold."""
    if machine.rolling == 0.0 and machine.second_ground_more == 0.0:
        return 0.0
    coefficient = machine.rolling
    if machine.second_ground_more != 0.0:
        # distance of the machine's middle inside the first ground; negative inside the second
        length_m = machine.ground_length_m
        place_m = (position_m + 0.5 * (length_m + _AXLES_APART_M)) % (2.0 * length_m) - length_m / 2
        inside_m = length_m / 2 - abs(place_m - length_m / 2)
        on_second = min(1.0, max(0.0, 0.5 - inside_m / _AXLES_APART_M))
        coefficient += machine.second_ground_more * on_second
    growth = (1.0 + machine.rolling_growth_s_m * abs(speed_m_s)) * (
        1.0 + machine.rolling_growth_s_rad * abs(turn_rad_s)
    )
    return coefficient * growth * mass_kg * machine.gravity_m_s2 * math.cos(slope_rad)
