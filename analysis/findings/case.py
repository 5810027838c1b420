"""What the causes look at: the log, its verdict and its joint fit."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import polars as pl

from analysis.column_noise import ColumnNoise
from analysis.diagnosis.evidence import Bools, Evidence, Floats
from analysis.machine import Machine
from analysis.regressor import X
from analysis.weighing.joint_result import JointFit

#: Channels of the force and of the speed, as a machine file may have them.
FORCES: Final = ("torque_left_N_m", "torque_right_N_m", "force_x_N")
SPEEDS: Final = ("speed_left_m_s", "speed_right_m_s", "speed_x_m_s")


@dataclass(frozen=True)
class Case:
    """A log as the causes see it.

    Attributes:
        evidence: as the checks see it.
        aligned: the grid, before the moving mean.
        noise: of the columns.
        raw: stamps by topic.
        digs: where something pushes back.
        judged: the verdict.
    """

    evidence: Evidence
    aligned: pl.DataFrame
    noise: pl.DataFrame
    raw: Mapping[str, pl.DataFrame]
    digs: pl.DataFrame
    judged: pl.DataFrame

    @property
    def machine(self) -> Machine:
        """Channels and settings."""
        return self.evidence.machine

    @property
    def fit(self) -> JointFit | None:
        """The joint fit, by what this log says itself; None where there is none."""
        weighing = self.evidence.weighing
        return None if weighing is None else weighing.own

    @cached_property
    def checks(self) -> dict[str, float]:
        """The verdict's numbers by check; NaN where one does not apply."""
        numbers = self.judged["value"].fill_null(np.nan).to_list()
        return dict(zip(self.judged["check"].to_list(), numbers, strict=True))

    @cached_property
    def column_noise(self) -> ColumnNoise | None:
        """Noise of acceleration, speed and force."""
        return ColumnNoise.of(X, self.noise, self.machine.settings.noise)

    @cached_property
    def stands(self) -> Bools:
        """Which grid samples stand, (n,)."""
        return self.evidence.is_phase("standstill")

    def measured(self, *names: str) -> tuple[str, ...]:
        """Which of these channels are read from the log."""
        return tuple(name for name in names if name in self.series)

    @property
    def series(self) -> Mapping[str, tuple[np.typing.NDArray[np.int64], Floats]]:
        """By channel: unix stamps in ns and readings in SI units, not filtered."""
        signals = self.evidence.signals
        return {} if signals is None else signals.channels

    @property
    def force_channel(self) -> str | None:
        """What names the force: its channel, or that of the left torque."""
        return next(iter(self.measured("force_x_N", "torque_left_N_m", "torque_right_N_m")), None)
