"""Samples from which the columns of the nuisance terms are computed."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

from analysis.weighing.motion_samples import Floats, Ints, select_rows_of_array_fields


@dataclass(frozen=True)
class ColumnInputs:
    """Samples for the columns, (n,) each, with the force advanced by the current lag.

    Attributes:
        acceleration: in m/s².
        wheel_acceleration: derivative of the wheel speed in m/s² if it is the acceleration; else 0.
        speed: in m/s.
        ground_speed_ratio: ground speed over wheel speed, by the known slip.
        force: force on the ground in N, corrected for its delay.
        force_rate: derivative of the measured force in N/s; 0 where within the noise, if there is
            an accelerometer.
        force_bend: second derivative of the force in N/s²; 0 if there is an accelerometer.
        force_rises_1: 1 where the force rises, -1 where it falls; 0 if the fit has no hysteresis.
        direction: driving direction of each manoeuvre.
        progress: from -1/2 to 1/2 over the log.
        under_way_s: time since the stretch began.
        relative_load: mass with load divided by the reference mass, minus 1.
        load_contrast: `relative_load` over its root mean square: about -1 empty, 1 loaded.
        path_position_1: position on the path, from -1/2 to 1/2.
        travelled_m: distance from the start of the stretch.
        route_1: position on the route, from 0 at the dump to 1 at its end.
        route_length_m: length of the route.
        relative_gear_ratio: gear ratio over the log's largest; 0 without one.
        slip_s_m: estimated cost of slip, as a fraction of the force per m/s.
        load_transfer_s2_m: estimated load transfer, as a fraction of the force per m/s².
        rises_by_force_1_N: derivative of `force_rises_1` with respect to the force.
        weight_shares: expected fractions of the constant force and of Coulomb friction that are
            proportional to the weight.
        force_rate_parabola: index of the parabola that gave each `force_rate`; None if values
            within the noise are set to 0.
        swing_m_s2: acceleration of a swinging mass relative to the machine; None without one.
        heading_from_dump: 1 with the front away from the nearest dump, else -1; None without a
            route that is long enough.
    """

    acceleration: Floats
    wheel_acceleration: Floats
    speed: Floats
    ground_speed_ratio: Floats
    force: Floats
    force_rate: Floats
    force_bend: Floats
    force_rises_1: Floats
    direction: Floats
    progress: Floats
    under_way_s: Floats
    relative_load: Floats
    load_contrast: Floats
    path_position_1: Floats
    travelled_m: Floats
    route_1: Floats
    route_length_m: float
    relative_gear_ratio: Floats
    slip_s_m: float
    load_transfer_s2_m: float
    rises_by_force_1_N: float
    weight_shares: tuple[float, float]
    force_rate_parabola: Ints | None
    swing_m_s2: Floats | None = None
    heading_from_dump: Floats | None = None

    @property
    def ground_speed_m_s(self) -> Floats:
        """(n,) ground speed in m/s: the wheel speed less the known slip."""
        return self.ground_speed_ratio * self.speed

    def select_rows(self, row_indices: Ints) -> Self:
        """Copy with the given samples only."""
        return replace(self, **select_rows_of_array_fields(self, row_indices))

    @cached_property
    def direction_times_relative_weight(self) -> Floats:
        """Driving direction times the relative weight with the load, (n,)."""
        return self.direction * (1.0 + self.relative_load)
