"""What the checks look at: the ungated samples of straight motion and of spins."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import polars as pl

from analysis.diagnosis.empty_mass import EmptyMassDifference, compare_empty_mass
from analysis.diagnosis.excluded_stretches import ExcludedStretches
from analysis.diagnosis.measured_channels import Signals
from analysis.diagnosis.side_comparison import SideDifference, side_differences
from analysis.model.axes import Z, axes, spin, straight
from analysis.model.machine import Machine
from analysis.stages.estimation import fit_quality
from analysis.stages.motion.phases import yaw_pace
from analysis.weighing.weigh import Weighing
from estimators.arrays import Bools, Floats


class UngatedFit(NamedTuple):
    """One fit over every moving sample: its first parameter ± std, and R²."""

    value: float
    std: float
    r_squared: float


@dataclass(frozen=True)
class Motion:
    """The samples of one axis: A (n, p), f (n,), and (n,) flags.

    Attributes:
        A: the regressor.
        f: force or yaw torque.
        known: nothing is missing.
        moving: fitted: it moves, and does not brake unless braking counts as driving.
        braking: it slows down.
        speeding: it speeds up.
    """

    A: Floats
    f: Floats
    known: Bools
    moving: Bools
    braking: Bools
    speeding: Bools

    @cached_property
    def fit(self) -> UngatedFit:
        """The fit of the axis' model to all that moves."""
        return UngatedFit(*fit_quality.ungated_fit(self.A, self.f, self.moving))

    @property
    def speed(self) -> Floats:
        """(n,) in m/s, or rad/s of a spin."""
        return self.A[:, 1]


@dataclass(frozen=True)
class CheckInputs:
    """A log as the checks see it.

    Attributes:
        excitation: regressors and phases.
        gated: which windows were accepted.
        machine: empty mass, settings.
        weighing: the joint fit; None where nothing could be fitted.
        signals: the channels as measured; None where only frames are at hand.
        totals: `masses`, nothing withheld.
        t0_unix_ns: when the first row is.
        noise: of the columns; None where it is not known.
        left_out: what checks name, and what the answer is without it, by check.
    """

    excitation: pl.DataFrame
    gated: pl.DataFrame
    machine: Machine
    weighing: Weighing | None = None
    signals: Signals | None = None
    totals: pl.DataFrame | None = None
    t0_unix_ns: int = 0
    noise: pl.DataFrame | None = None
    left_out: Mapping[str, ExcludedStretches] = field(default_factory=dict[str, ExcludedStretches])

    def has(self, *columns: str) -> bool:
        """Whether the log has all of these columns."""
        return set(columns) <= set(self.excitation.columns)

    def is_phase(self, *names: str) -> Bools:
        """Which samples are in one of these phases, (n,)."""
        return self.excitation["phase"].is_in(names).fill_null(False).to_numpy()

    @cached_property
    def force_by_place(self) -> Floats | None:
        """A spring, say, as far as the answer's fit knows it, (n,): it hides the mass from others.

        None where there is none.
        """
        return None if self.weighing is None else self.weighing.fit.force_by_place

    @cached_property
    def empty_mass(self) -> EmptyMassDifference | None:
        """The lightest load against the machine's empty mass; None without either."""
        return compare_empty_mass(self.weighing, self.machine)

    @cached_property
    def sides(self) -> Mapping[str, SideDifference]:
        """Left against right, by kind: torque, speed, slip."""
        return side_differences(self.excitation, self.signals, self.machine, self.t0_unix_ns)

    @cached_property
    def straight(self) -> Motion:
        """Straight motion, without a force that depends on the place."""
        settings = self.machine.settings
        A, f = straight(self.excitation, settings)
        if self.force_by_place is not None:
            f = f - self.force_by_place
        known = np.isfinite(A).all(axis=1) & np.isfinite(f)
        welcome = () if settings.gate.exclude_braking else ("braking",)
        return Motion(
            A,
            f,
            known,
            moving=known & self.is_phase("accelerating", "cruising", *welcome),
            braking=known & self.is_phase("braking"),
            speeding=known & self.is_phase("accelerating"),
        )

    @cached_property
    def spins(self) -> Motion | None:
        """Spins, where the channels allow it and there are enough of them."""
        if Z not in axes(self.excitation):
            return None
        A, f = spin(self.excitation)
        known = np.isfinite(A).all(axis=1) & np.isfinite(f)
        spinning = known & self.is_phase("spinning")
        changes = yaw_pace(A[:, 1], self.machine.settings)
        braking = spinning & (changes < 0)
        welcome = not self.machine.settings.gate.exclude_braking
        moving = spinning if welcome else spinning & ~braking
        if not fit_quality.has_enough_samples(A, moving):
            return None
        return Motion(A, f, spinning, moving, braking, speeding=spinning & (changes > 0))
