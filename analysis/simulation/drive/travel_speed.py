"""What the driver of a travel wants: speeds held for a while each, and stands between."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from analysis.simulation.scenario.manoeuvres import Travel
from analysis.simulation.scenario.waveforms import Floats


class Leg(NamedTuple):
    """From standing, or from where the log begins, to the next stand, or to where the log ends.

    Attributes:
        wanted_m_s: (n,) the speed that is wanted, a value a step.
        stand_s: how long the machine stands afterwards; None: it drives on.
    """

    wanted_m_s: Floats
    stand_s: float | None


def travel_legs(travel: Travel, dice: np.random.Generator, step_s: float) -> Iterator[Leg]:
    """The legs of a travel, which together take about its duration."""
    left_s = travel.duration_s
    speed = 0.0
    parts: list[Floats] = []
    first = travel.in_motion
    while left_s > 0.0:
        target = float(dice.uniform(travel.speed_least_m_s, travel.speed_most_m_s))
        hold_s = float(dice.uniform(travel.hold_least_s, travel.hold_most_s))
        stands = bool(dice.random() < travel.stop_share)
        stand_s = float(dice.uniform(travel.stand_least_s, travel.stand_most_s))
        if first:
            speed, first = target, False
        parts += [_ramp(speed, target, travel, step_s), np.full(round(hold_s / step_s), target)]
        left_s -= (parts[-2].size + parts[-1].size) * step_s
        speed = target
        ends = left_s <= 0.0
        if stands or (ends and not travel.in_motion):
            parts.append(_ramp(speed, 0.0, travel, step_s))
            yield Leg(np.concatenate(parts), 0.0 if ends else stand_s)
            left_s -= parts[-1].size * step_s + stand_s
            parts, speed = [], 0.0
    if parts:
        yield Leg(np.concatenate(parts), None)


def _ramp(begin_m_s: float, end_m_s: float, travel: Travel, step_s: float) -> Floats:
    steps = round(abs(end_m_s - begin_m_s) / travel.acceleration_m_s2 / step_s)
    return np.linspace(begin_m_s, end_m_s, steps, endpoint=False)
