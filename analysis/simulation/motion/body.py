"""The machine and its load as a rigid body in the plane, with two equations of motion.

    F = m s_x - ω² mc_x - ω̇ mc_y + b_x v + (F_c + F_r) sign(v)
    T = mc_x s_y - mc_y s_x + Izz ω̇ + b_ψ ω + T_c sign(ω)

the rows of the paper's (4) that wheels measure (`estimators.planar.planar_rows`), with Coulomb
friction F_c, T_c and rolling resistance F_r, which is in proportion to the weight. F and T are all
force and torque but friction and gravity: drive less brakes. s is the specific force of the
origin, midway between the wheels, which do not slip sideways: s_x = dv/dt + g_x, s_y = ω v + g_y,
where g_x and g_y are the slope's share of gravity along the machine's axes, turned away.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.scenario.scenario import Scenario

#: Numbers of one instant, or (n,) of several.
Values: TypeAlias = float | NDArray[np.float64]


class LongitudinalYawPair(NamedTuple):
    """A quantity along x (force, speed, acceleration) and about z (torque, yaw rate, …)."""

    x: Values
    z: Values


@dataclass(frozen=True)
class RigidBody:
    """A machine with a load on a slope; moments are about the origin."""

    mass_kg: float
    first_moment_x_kg_m: float
    first_moment_y_kg_m: float
    inertia_z_kg_m2: float
    friction_x_N_s_m: float
    friction_z_N_m_s: float
    coulomb_x_N: float
    coulomb_z_N_m: float
    #: g sin(slope), positive if the machine faces uphill at heading 0.
    uphill_m_s2: float
    slope_rad: float
    #: Rolling resistance at low speed where the motion begins, proportional to the weight.
    rolling_x_N: float

    @classmethod
    def make_loaded_body(cls, scenario: Scenario, load_kg: float) -> Self:
        """The scenario's machine with a point-mass load in its bucket."""
        machine, terrain = scenario.machine, scenario.terrain
        x, y = machine.load_x_m, machine.load_y_m
        return cls(
            mass_kg=machine.mass_kg + load_kg,
            first_moment_x_kg_m=machine.mass_kg * machine.com_x_m + load_kg * x,
            first_moment_y_kg_m=machine.mass_kg * machine.com_y_m + load_kg * y,
            inertia_z_kg_m2=machine.inertia_z_kg_m2 + load_kg * (x * x + y * y),
            friction_x_N_s_m=machine.friction_N_s_m,
            friction_z_N_m_s=machine.friction_z_N_m_s,
            coulomb_x_N=machine.coulomb_N,
            coulomb_z_N_m=machine.coulomb_z_N_m,
            uphill_m_s2=terrain.gravity_m_s2 * float(np.sin(terrain.slope_rad)),
            slope_rad=terrain.slope_rad,
            rolling_x_N=scenario.rolling.coefficient
            * (machine.mass_kg + load_kg)
            * terrain.gravity_m_s2
            * math.cos(terrain.slope_rad),
        )

    @property
    def max_holding_force_and_torque(self) -> tuple[float, float]:
        """Largest force and torque that friction holds at standstill."""
        return self.coulomb_x_N + self.rolling_x_N, self.coulomb_z_N_m

    @property
    def com_x_m(self) -> float:
        """Centre of mass in m ahead of the origin."""
        return self.first_moment_x_kg_m / self.mass_kg

    @property
    def com_y_m(self) -> float:
        """Centre of mass in m to the left of the origin."""
        return self.first_moment_y_kg_m / self.mass_kg

    def slope_acceleration_along_and_across(self, heading: Values) -> tuple[Values, Values]:
        """Force of the slope per kilogram along the body's x (ahead) and y (left), in m/s².

        Args:
            heading: heading in rad; the force along x is largest at 0.
        """
        if isinstance(heading, float):  # the functions of numpy are slow on single numbers
            return self.uphill_m_s2 * math.cos(heading), -self.uphill_m_s2 * math.sin(heading)
        return self.uphill_m_s2 * np.cos(heading), -self.uphill_m_s2 * np.sin(heading)

    def subtract_friction_and_gravity(
        self,
        applied_force_and_torque: LongitudinalYawPair,
        rate: LongitudinalYawPair,
        heading: Values,
    ) -> LongitudinalYawPair:
        """Applied force and torque minus viscous friction and gravity.

        Args:
            applied_force_and_torque: F and T, drive minus brakes.
            rate: v and ω.
            heading: heading in rad.
        """
        gravity_x, gravity_y = self.slope_acceleration_along_and_across(heading)
        v, omega = rate
        return LongitudinalYawPair(
            applied_force_and_torque.x
            - self.friction_x_N_s_m * v
            - self.mass_kg * gravity_x
            + omega * omega * self.first_moment_x_kg_m,
            applied_force_and_torque.z
            - self.friction_z_N_m_s * omega
            - self.first_moment_x_kg_m * (omega * v + gravity_y)
            + self.first_moment_y_kg_m * gravity_x,
        )

    def compute_accelerations(
        self, net_force_and_torque: LongitudinalYawPair, moving_axes: tuple[bool, bool]
    ) -> LongitudinalYawPair:
        """dv/dt and ω̇ under `net_force_and_torque`; 0 for an axis that does not move."""
        m, mc_y = self.mass_kg, self.first_moment_y_kg_m
        if not any(moving_axes):
            return LongitudinalYawPair(0.0 * net_force_and_torque.x, 0.0 * net_force_and_torque.z)
        if not moving_axes[0]:
            return LongitudinalYawPair(
                0.0 * net_force_and_torque.x, net_force_and_torque.z / self.inertia_z_kg_m2
            )
        if not moving_axes[1]:
            return LongitudinalYawPair(net_force_and_torque.x / m, 0.0 * net_force_and_torque.z)
        turn = (net_force_and_torque.z + mc_y * net_force_and_torque.x / m) / (
            self.inertia_z_kg_m2 - mc_y * mc_y / m
        )
        return LongitudinalYawPair((net_force_and_torque.x + mc_y * turn) / m, turn)

    def compute_required_force_and_torque(
        self,
        rate: LongitudinalYawPair,
        acceleration: LongitudinalYawPair,
        heading: Values,
        friction_signs: LongitudinalYawPair,
    ) -> LongitudinalYawPair:
        """Force F and torque T that a motion requires.

        `friction_signs` are the signs of Coulomb friction on each axis.
        """
        left = self.subtract_friction_and_gravity(
            LongitudinalYawPair(0.0 * rate.x, 0.0 * rate.z), rate, heading
        )
        dv, turn = acceleration
        mc_y = self.first_moment_y_kg_m
        return LongitudinalYawPair(
            self.mass_kg * dv
            - mc_y * turn
            - left.x
            + self.max_holding_force_and_torque[0] * friction_signs.x,
            self.inertia_z_kg_m2 * turn
            - mc_y * dv
            - left.z
            + self.max_holding_force_and_torque[1] * friction_signs.z,
        )
