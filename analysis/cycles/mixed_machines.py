"""Logs of two machines in one shift: the empty machine weighs otherwise from one log on.

Fuel, mud, a fork for a bucket change an empty machine by a few per cent; another machine by more.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from estimators.arrays import Floats


@dataclass(frozen=True)
class MixedMachines:
    """An empty mass that jumps where a log begins.

    Attributes:
        log: number of the log that it jumps at, from 0 on.
        before_kg: the lightest starts before it,
        after_kg: and from it on.
    """

    log: int
    before_kg: float
    after_kg: float

    def text(self, name: str) -> str:
        """What a reader must know.

        Args:
            name: of the log that it jumps at.
        """
        more = self.after_kg / self.before_kg - 1.0
        return (
            f"the empty machine weighs {self.before_kg:,.0f} kg before {name} and "
            f"{self.after_kg:,.0f} kg from it on ({more:+.0%}): these may be logs of two machines; "
            "review the logs of each machine by themselves"
        )


def find_mixed_machine(manoeuvres: pl.DataFrame, begins_ns: Sequence[int]) -> MixedMachines | None:
    """Look for a log from which on the empty machine weighs otherwise.

    Args:
        manoeuvres: the frame of a run.
        begins_ns: (logs,) when each log begins, since the first aligned sample, ascending.

    Returns:
        The largest jump; None where there is none, or too little of either side.
    """
    known = manoeuvres.drop_nulls(["mass_kg", "mass_std_kg"])
    if known.is_empty():
        return None
    mass_kg, std_kg, start_ns = (
        known[name].to_numpy() for name in ("mass_kg", "mass_std_kg", "start_t_ns")
    )
    found: list[tuple[float, MixedMachines]] = []
    for number, border_ns in enumerate(begins_ns[1:], 1):
        later = start_ns >= border_ns
        sides = [_lightest_mass(mass_kg[side], std_kg[side]) for side in (~later, later)]
        if sides[0] is None or sides[1] is None:
            continue
        (before_kg, u_kg), (after_kg, other_u_kg) = sides[0], sides[1]
        jump = abs(float(np.log(after_kg / before_kg)))
        surely = abs(after_kg - before_kg) > LIMITS.empty_mass_jump_u * float(
            np.hypot(u_kg, other_u_kg)
        )
        if jump > LIMITS.empty_mass_jump and surely:
            found.append((jump, MixedMachines(number, before_kg, after_kg)))
    return max(found, key=lambda each: each[0])[1] if found else None


def _lightest_mass(mass_kg: Floats, std_kg: Floats) -> tuple[float, float] | None:
    """Mass of the lightest starts, and its deviation; None where none of them is known empty."""
    if mass_kg.size < LIMITS.side_min_starts:
        return None
    low, high = (
        float(x)
        for x in np.quantile(mass_kg, [LIMITS.empty_start_quantile, LIMITS.loaded_start_quantile])
    )
    if low <= 0.0 or high < (1.0 + LIMITS.loaded_start_excess) * low:
        return None
    return low, float(np.median(std_kg))
