"""What a driver does, leg by leg."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Kinds of leg.
STAND, DRIVE, DIG = 0, 1, 2
#: When the load changes: never, during the whole leg, while the throttle is held, in motion only.
NEVER, WHOLE_LEG, THROTTLE, MOVING = 0, 1, 2, 3


class Leg(NamedTuple):
    """One thing that the driver does.

    A leg that stands lasts `duration_s`. One that drives holds the throttle, cruises, and brakes to
    the stand. One that digs drives into a pile that begins at `to_m` until it stalls, and pushes
    for `duration_s`; its bucket fills up to `load_to_kg`.

    Attributes:
        kind: stand, drive or dig.
        direction: 1 forward, -1 in reverse.
        facing: 1 where forward leads up the track, -1 where it leads back.
        throttle: share of the whole.
        rise_s: how long it takes to get there.
        start_s: how long it is held.
        cruise_s: how long the speed is kept after that.
        to_m: where on the track it brakes to stand, if it has not before; NaN: nowhere.
        top_m_s: it speeds up to this at most.
        brake_m_s2: a stop decelerates by this besides friction,
        seen_1: such a share of it by the drive, which the force sensors see, and not by brakes;
        tail_m_s: below this speed by brakes alone,
        tail_m_s2: that decelerate by this.
        duration_s: of a stand, or of pushing into a pile that does not give.
        load_to_kg: the load changes to this,
        load_rate_kg_s: at this rate,
        load_when: at these times.
        boom_to_rad: the boom moves there,
        boom_rate_rad_s: at this rate.
    """

    kind: float
    direction: float = 1.0
    facing: float = 1.0
    throttle: float = 1.0
    rise_s: float = 0.3
    start_s: float = 0.0
    cruise_s: float = 0.0
    to_m: float = float("nan")
    top_m_s: float = 1e9
    brake_m_s2: float = 1.5
    seen_1: float = 0.5
    tail_m_s: float = 0.0
    tail_m_s2: float = 0.0
    duration_s: float = 0.0
    load_to_kg: float = 0.0
    load_rate_kg_s: float = 0.0
    load_when: float = NEVER
    boom_to_rad: float = 0.0
    boom_rate_rad_s: float = 0.0


_RECORD: Final = np.dtype([(name, "f8") for name in Leg._fields])


def records(legs: Sequence[Leg]) -> NDArray[Any]:
    """(n,) the same for compiled code: a record has a leg's attributes."""
    return np.array(list(map(tuple, legs)), _RECORD)
