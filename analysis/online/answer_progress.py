"""Progress towards a target uncertainty: evidence so far, and manoeuvres still needed.

The mass of a load is the mean of its manoeuvres' masses. As far as these scatter at random, its
uncertainty falls with their number; errors that all share (gain, slope, wheel radius) are excluded.
"""

import math
from dataclasses import dataclass, replace

from analysis.model.machine_body import Body
from analysis.online.online_limits import LIMITS


@dataclass(frozen=True, slots=True)
class AnswerProgress:
    """Evidence from the manoeuvres of one load so far.

    Attributes:
        until_u_kg: target standard uncertainty; None without a target.
        forward: number of forward manoeuvres.
        reverse: number of reverse manoeuvres.
        mean_kg: mean of the manoeuvres' masses.
        squares_kg2: sum of the masses' squared deviations from the mean.
        own_kg2: mean square of the masses' own standard uncertainties.
    """

    until_u_kg: float | None
    forward: int = 0
    reverse: int = 0
    mean_kg: float = math.nan
    squares_kg2: float = 0.0
    own_kg2: float = math.nan

    @property
    def manoeuvre_count(self) -> int:
        """Number of manoeuvres."""
        return self.forward + self.reverse

    @property
    def manoeuvre_u_kg(self) -> float:
        """Standard deviation of one manoeuvre's mass: its own, updated by the observed scatter."""
        degrees_of_freedom = LIMITS.own_u_degrees_of_freedom + self.manoeuvre_count - 1
        return math.sqrt(
            (LIMITS.own_u_degrees_of_freedom * self.own_kg2 + self.squares_kg2) / degrees_of_freedom
        )

    @property
    def u_kg(self) -> float | None:
        """Random standard uncertainty of the mean; None without a manoeuvre."""
        return (
            self.manoeuvre_u_kg / math.sqrt(self.manoeuvre_count) if self.manoeuvre_count else None
        )

    @property
    def information_percent(self) -> float | None:
        """Information gained towards the target, in percent: (target / uncertainty)²."""
        if self.until_u_kg is None:
            return None
        if self.u_kg is None:
            return 0.0
        return min(100.0, 100.0 * (self.until_u_kg / self.u_kg) ** 2)

    @property
    def missing_manoeuvre_count(self) -> int | None:
        """Number of further manoeuvres needed; None before the first, or without a target."""
        if not self.manoeuvre_count or self.until_u_kg is None:
            return None
        return max(
            0, math.ceil((self.manoeuvre_u_kg / self.until_u_kg) ** 2) - self.manoeuvre_count
        )

    @property
    def missing_reverse_count(self) -> int | None:
        """Number of missing manoeuvres in reverse, so that slope and constant force cancel."""
        missing = self.missing_manoeuvre_count
        if missing is None:
            return None
        return max(0, min(missing, (self.manoeuvre_count + missing) // 2 - self.reverse))

    def add_manoeuvre(self, mass_kg: float, u_kg: float, speed_m_s: float) -> "AnswerProgress":
        """Add a manoeuvre; if it has another load, start again with it.

        Args:
            mass_kg: mass by the manoeuvre.
            u_kg: random standard uncertainty of that mass.
            speed_m_s: speed in the manoeuvre; negative in reverse.
        """
        before = self
        spread_kg = math.hypot(self.manoeuvre_u_kg, u_kg) if self.manoeuvre_count else math.inf
        if abs(mass_kg - self.mean_kg) > LIMITS.other_load_std * spread_kg:
            before = AnswerProgress(self.until_u_kg)
        count = before.manoeuvre_count
        mean_kg = before.mean_kg if count else mass_kg
        differs_kg = mass_kg - mean_kg
        own_kg2 = before.own_kg2 if count else 0.0
        return replace(
            before,
            forward=before.forward + (speed_m_s >= 0.0),
            reverse=before.reverse + (speed_m_s < 0.0),
            mean_kg=mean_kg + differs_kg / (count + 1),
            squares_kg2=before.squares_kg2 + differs_kg**2 * count / (count + 1),
            own_kg2=own_kg2 + (u_kg**2 - own_kg2) / (count + 1),
        )


def choose_target_uncertainty_kg(body: Body, requested_u_kg: float | None) -> float | None:
    """Target uncertainty in kg: the requested one, or a fraction of the empty mass if known."""
    if requested_u_kg is not None or body.empty_mass_kg is None:
        return requested_u_kg
    return LIMITS.target_u_1 * body.empty_mass_kg


def describe_missing_manoeuvres(
    missing_count: int | None, missing_reverse_count: int | None
) -> str:
    """The missing manoeuvres in words; "" if none is missing.

    Args:
        missing_count: number of missing manoeuvres; None if unknown.
        missing_reverse_count: number of them that should be in reverse; None if unknown.
    """
    if missing_count is None or missing_reverse_count is None:
        return "a start that the gate accepts"
    parts = [
        (missing_count - missing_reverse_count, "forward"),
        (missing_reverse_count, "in reverse"),
    ]
    starts = [f"{n} more start{'s' * (n != 1)} {how}" for n, how in parts if n]
    return " and ".join(starts)
