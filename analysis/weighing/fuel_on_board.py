"""Fuel on board: difference of the empty machine's mass between the log and the weighbridge.

200 L of fuel weigh 170 kg. The fuel in the tank at the weighing and at the start of the log, and
the fuel burnt since, are stated or measured; the difference is added to the mass on the ticket.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
import polars as pl

from analysis.model.machine_body import Body, FuelTank
from analysis.model.physical_units import NS_PER_S, SECONDS_PER_HOUR
from analysis.model.schema import get_column_values
from analysis.weighing.motion_samples import Floats
from analysis.weighing.weighing_limits import LIMITS


@dataclass(frozen=True)
class FuelOnBoard:
    """Fuel in the tank over the log.

    Attributes:
        tank: fuel in the tank at the weighing and at the start, as the machine file states it.
        rate_u_1: relative standard uncertainty of the fuel burnt.
        t_ns: (n,) times since the first aligned sample, ascending.
        burnt_L: (n,) litres burnt until then.
    """

    tank: FuelTank
    rate_u_1: float
    t_ns: Floats
    burnt_L: Floats

    @classmethod
    def integrate_fuel_rate(cls, body: Body, aligned: pl.DataFrame) -> Self | None:
        """Integrate the measured or stated fuel rate; None if the machine file states no tank.

        In gaps of the channel its mean rate is used.
        """
        if body.fuel is None or aligned.is_empty():
            return None
        t_ns = aligned["t_ns"].to_numpy().astype(np.float64)
        rate_L_h = np.full(t_ns.size, body.fuel.rate_L_h or 0.0)
        if "fuel_rate_L_h" in aligned.columns:
            measured = get_column_values(aligned, "fuel_rate_L_h")
            known = np.isfinite(measured)
            if known.any():
                rate_L_h = np.where(known, measured, measured[known].mean())
        hours = np.diff(t_ns, prepend=t_ns[:1]) / NS_PER_S / SECONDS_PER_HOUR
        rate_u_1 = LIMITS.unknown_fuel_rate_u if body.fuel_gain_u is None else body.fuel_gain_u
        return cls(body.fuel, rate_u_1, t_ns, np.cumsum(rate_L_h * hours))

    def estimate_fuel_mass_beyond_ticket_and_u_kg(
        self, at_ns: Floats, weights: Floats
    ) -> tuple[float, float]:
        """Fuel mass minus that at the weighing, and its standard uncertainty, in kg.

        Args:
            at_ns: (k,) times at which the log weighed the empty machine.
            weights: (k,) weights of these times, with sum 1.
        """
        burnt_L = float(weights @ np.interp(at_ns, self.t_ns, self.burnt_L))
        more_L = self.tank.begin_L - burnt_L - self.tank.empty_mass_L
        density = self.tank.density_kg_L
        parts_L = (self.tank.u_L, self.rate_u_1 * burnt_L, LIMITS.fuel_density_u * more_L)
        return density * more_L, density * float(np.linalg.norm(parts_L))
