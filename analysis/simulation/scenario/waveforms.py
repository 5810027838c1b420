"""Periodic excitation waveforms of force and torque, between two values.

All are highest at `peak_s` and lowest half a period later. The paper's triangle
(A/T) |t mod T - T/2| + f0 is the triangular one with lowest = f0, highest = f0 + A/2, peak_s = 0.
"""

import math
from abc import ABC, abstractmethod
from typing import Literal, TypeAlias, overload

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from estimators.arrays import Floats

Shape: TypeAlias = Literal["triangular", "sinusoidal", "polynomial"]


class Waveform(ABC, BaseModel):
    """A shape, its period and place in time; the range is the subclass's, with its unit."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    waveform: Shape = Field(
        default="triangular",
        description="triangular, sinusoidal or polynomial (of the fifth degree from peak to "
        "trough, at rest at both)",
    )
    period_s: float = Field(default=15.0, ge=0.1, le=3600, description="period")
    peak_s: float = Field(
        default=0.0, ge=0, le=3600, description="time of the first peak after the drive begins"
    )

    @property
    @abstractmethod
    def value_range(self) -> tuple[float, float]:
        """Lowest and highest value."""

    @overload
    def __call__(self, time_s: float) -> float: ...
    @overload
    def __call__(self, time_s: Floats) -> Floats: ...
    def __call__(self, time_s: float | Floats) -> float | Floats:
        """The values at one or (n,) times in s since the drive began."""
        lowest, highest = self.value_range
        # 1 at the peak, 0 at the trough, linear in time between them
        shape = abs(2.0 * ((time_s - self.peak_s) / self.period_s % 1.0) - 1.0)
        if self.waveform == "sinusoidal":
            turn = math.pi * shape
            shape = (1.0 - (math.cos(turn) if isinstance(turn, float) else np.cos(turn))) / 2.0
        elif self.waveform == "polynomial":
            shape = shape**3 * (10.0 + shape * (6.0 * shape - 15.0))
        return lowest + (highest - lowest) * shape

    def kink_times_s(self, duration_s: float) -> list[float]:
        """Times in s of the peaks and troughs before `duration_s`, where the wave is not smooth."""
        half = self.period_s / 2.0
        first = math.ceil(-self.peak_s / half)
        last = math.floor((duration_s - self.peak_s) / half)
        return [self.peak_s + half * k for k in range(first, last + 1)]


class ForceWave(Waveform):
    """A longitudinal drive force."""

    lowest_N: float = Field(default=0.0, ge=-1e7, le=1e7, description="lowest force (f0)")
    highest_N: float = Field(
        default=6000.0, ge=-1e7, le=1e7, description="highest force (f0 + A/2 of the paper)"
    )

    @property
    def value_range(self) -> tuple[float, float]:
        """Lowest and highest force in N."""
        return self.lowest_N, self.highest_N


class TorqueWave(Waveform):
    """A yaw torque of the drive."""

    lowest_N_m: float = Field(default=0.0, ge=-1e7, le=1e7, description="lowest torque")
    highest_N_m: float = Field(default=3000.0, ge=-1e7, le=1e7, description="highest torque")

    @property
    def value_range(self) -> tuple[float, float]:
        """Lowest and highest torque in N·m."""
        return self.lowest_N_m, self.highest_N_m
