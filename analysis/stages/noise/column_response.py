"""How a column of the grid comes from what was measured, and what that leaves of white noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.model.machine import Machine
from analysis.stages.signals import filters
from estimators.arrays import Floats

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class ColumnResponse:
    """How a column comes from what was measured.

    Attributes:
        derivatives: how often it was differentiated.
        derivative_of: the column of the axis that it is the derivative of, -1 for none.
        filtered: whether the low-pass was applied.
        cutoff: of the low-pass, over the rate.
        causal: whether filter and derivative look back only.
        rate_hz: of the grid.
    """

    derivatives: int
    derivative_of: int
    filtered: bool
    cutoff: float
    causal: bool
    rate_hz: float

    def response(self, at: Floats) -> Floats:
        """Power at frequencies over the rate, of white noise of variance 1 as measured."""
        slope = 2.0 * np.sin(np.pi * at) if self.causal else np.sin(2.0 * np.pi * at)
        power = (slope * self.rate_hz) ** (2 * self.derivatives)
        if self.filtered:
            power = power * filters.power_left(at / self.cutoff, causal=self.causal)
        return power

    def slope(self, at: Floats) -> Complexes:
        """Transfer of one derivative at frequencies over the rate."""
        if self.causal:
            return np.asarray(self.rate_hz * (1.0 - np.exp(-2j * np.pi * at)), np.complex128)
        return self.rate_hz * 1j * np.sin(2.0 * np.pi * at)


def responses(axis: tuple[str, ...], machine: Machine) -> list[ColumnResponse]:
    """How each column of an axis is made.

    Args:
        axis: the columns' names.
        machine: channels, filter and grid.
    """
    chosen = machine.settings.forces.acceleration
    channels = machine.channels
    names = [
        {"specific_force": "specific_force_x_m_s2", "kinematic": "acc_x_m_s2"}[chosen]
        if name == "regressor_acc_x_m_s2"
        else name
        for name in axis
    ]
    filtered = any(channel.differentiates for channel in channels.values())
    cutoff = machine.settings.filter.cutoff_hz / machine.settings.align.rate_hz
    found: list[ColumnResponse] = []
    for name in names:
        depth, at = 0, name
        while at in channels and channels[at].sources:
            depth += channels[at].derivative_of is not None
            at = channels[at].sources[0]
        parent = channels[name].derivative_of if name in channels else None
        found.append(
            ColumnResponse(
                depth,
                names.index(parent) if parent in names else -1,
                filtered and cutoff < filters.HIGHEST_CUTOFF,
                cutoff,
                machine.settings.filter.causal,
                machine.settings.align.rate_hz,
            )
        )
    return found
