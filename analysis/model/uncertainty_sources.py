"""Uncertainty sources, and the scale factors that no log determines."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.model.machine import Machine

#: Ratio of the standard deviation to the median absolute deviation, for a normal distribution.
STD_OF_MAD: Final = 1.4826


@dataclass(frozen=True, slots=True)
class UncertaintySource:
    """Source of uncertainty.

    Attributes:
        name: name of the source.
        kind: random (more starts average it out), common (to the log) or scale (no log determines
            it).
        u: standard uncertainty, in the unit of the quantity; None if unknown.
        meaning: description of the source.
        reduced_by: what would reduce it.
    """

    name: str
    kind: str
    u: float | None
    meaning: str
    reduced_by: str


def sort_sources_largest_first(sources: Iterable[UncertaintySource]) -> list[UncertaintySource]:
    """Sort the sources by size, unknown ones last."""
    return sorted(sources, key=lambda source: np.inf if source.u is None else -source.u)


def list_scale_sources_without_u(sources: Iterable[UncertaintySource]) -> list[str]:
    """Names of scale sources whose uncertainty the machine file lacks."""
    return [source.name for source in sources if source.u is None]


def compute_root_sum_of_squares(parts: Iterable[float]) -> float:
    """Combined standard uncertainty of independent parts, in their unit."""
    return float(np.sqrt(sum(part**2 for part in parts)))


def combine_u(sources: Iterable[UncertaintySource], *kinds: str) -> float:
    """Combined standard uncertainty of the sources of the given kinds, or of all."""
    return float(np.sqrt(sum(s.u**2 for s in sources if s.u and (not kinds or s.kind in kinds))))


@dataclass(frozen=True, slots=True)
class ScaleFactor:
    """A scale factor stated in the machine file, whose error no log can determine.

    Attributes:
        name: name of the source.
        applies: whether it applies to the machine.
        u: function that gives its standard uncertainty, relative for a factor of the force, in
            metres for a position; None if not stated.
        setting: key of the machine file that states the uncertainty.
        meaning: description in a sentence.
        by_load: whether the factor changes with the load; the uncertainty is then for a load as
            heavy as the machine.
        remedy: what would determine the factor, besides the key.
    """

    name: str
    applies: Callable[[Machine], bool]
    u: Callable[[Machine], float | None]
    setting: str
    meaning: str
    by_load: bool = False
    remedy: str = "known loads"

    def make_uncertainty_source(self, u: float | None) -> UncertaintySource:
        """Source of a budget, with `u` as its effect on the quantity."""
        reduced_by = f"{self.remedy}; {self.setting} states what is known"
        return UncertaintySource(self.name, "scale", u, self.meaning, reduced_by)


def count_wheel_radius_in_mass(machine: Machine) -> int:
    """Power of the wheel radius in a mass: 1 by the force, and 1 by an acceleration of wheels."""
    by_force = "force_x_N" not in machine.channels or machine.depends_on_wheel_radius("force_x_N")
    return int(by_force) + int(takes_acceleration_from_wheel_radius(machine))


def takes_acceleration_from_wheel_radius(machine: Machine) -> bool:
    """Whether the acceleration that multiplies the mass is computed with the wheel radius."""
    kinematic = machine.settings.forces.acceleration == "kinematic"
    return kinematic and machine.depends_on_wheel_radius("acc_x_m_s2")


def _is_wheel_radius_by_load_in_mass(machine: Machine) -> bool:
    """Whether tyres change a mass: a stated change counts in a force that the log has in N too."""
    stated = machine.machine.wheel_radius_by_load_u is not None
    return stated or count_wheel_radius_in_mass(machine) > 0


def has_side_torques(machine: Machine) -> bool:
    """Whether the yaw torque is computed from the torques of two sides."""
    return "torque_z_N_m" not in machine.channels


def compute_relative_uncertainty(u: float | None, value: float | None) -> float | None:
    """A standard uncertainty divided by its value; None if one of them is not stated."""
    return None if u is None or value is None else u / value


def _compute_relative_mass_u_by_wheel_radius(machine: Machine) -> float | None:
    u = machine.machine.wheel_radius_u_1
    return None if u is None else u * count_wheel_radius_in_mass(machine)


def _compute_relative_mass_u_by_loaded_wheel_radius(machine: Machine) -> float | None:
    u = machine.machine.wheel_radius_by_load_u
    by_wheels = machine.differentiates_speed or takes_acceleration_from_wheel_radius(machine)
    return None if u is None else u * (2.0 if by_wheels else 1.0)


#: Change of the rolling radius with the load.
WHEEL_RADIUS_BY_LOAD: Final = ScaleFactor(
    "wheel_radius_by_load",
    _is_wheel_radius_by_load_in_mass,
    _compute_relative_mass_u_by_loaded_wheel_radius,
    "machine.wheel_radius_by_load_u",
    "change of the wheels' rolling radius with the load that presses their tyres",
    by_load=True,
)
#: Factors of the force.
SCALES: Final = (
    ScaleFactor(
        "force_gain",
        lambda _: True,
        lambda machine: machine.machine.force_gain_u,
        "machine.force_gain_u",
        "gain of the force or torque sensors",
    ),
    ScaleFactor(
        "force_share",
        lambda machine: machine.machine.force_share < 1.0,
        lambda machine: compute_relative_uncertainty(
            machine.machine.force_share_u, machine.machine.force_share
        ),
        "machine.force_share_u",
        "share of the force on the measured wheels",
    ),
    ScaleFactor(
        "force_share_by_load",
        lambda machine: machine.machine.force_share < 1.0,
        lambda machine: machine.machine.force_share_by_load_u,
        "machine.force_share_by_load_u",
        "change of the measured wheels' share with the load that they carry",
        by_load=True,
    ),
    ScaleFactor(
        "wheel_radius",
        lambda machine: count_wheel_radius_in_mass(machine) > 0,
        _compute_relative_mass_u_by_wheel_radius,
        "machine.wheel_radius_u_m",
        "radius of the wheels",
    ),
    WHEEL_RADIUS_BY_LOAD,
)
#: A factor of the yaw torque alone.
TRACK_WIDTH: Final = ScaleFactor(
    "track_width",
    has_side_torques,
    lambda machine: compute_relative_uncertainty(
        machine.machine.track_width_u_m, machine.machine.track_width_m
    ),
    "machine.track_width_u_m",
    "track width, which converts the torques of the two sides to a yaw torque",
    remedy="measuring it",
)
#: Position of the accelerometer.
IMU_POSITION: Final = ScaleFactor(
    "imu_position",
    lambda machine: machine.settings.forces.acceleration == "specific_force",
    lambda machine: machine.machine.imu.position_u_m,
    "machine.imu.position_u_m",
    "where the accelerometer sits from the origin",
    remedy="measuring it",
)
