"""Inputs of the checks: the ungated samples of straight motion and of spins.

They include the comparison of the log's mass with the machine's empty mass: an omitted gear ratio,
a force in another unit or a wrong radius multiplies every mass of a log by the same factor, which
nothing else shows. The difference is judged by its standard uncertainty, including the scale.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
import polars as pl

from analysis.diagnosis.diagnosis_limits import LIMITS
from analysis.diagnosis.excluded_stretches import ExcludedStretches
from analysis.diagnosis.measured_channels import RawSignals
from analysis.diagnosis.side_comparison import SideDifference, compare_left_and_right_sides
from analysis.model.axes import (
    Z,
    list_axes_allowed_by_channels,
    make_spin_regressor_and_torque,
    make_straight_regressor_and_force,
)
from analysis.model.machine import Machine
from analysis.model.settings import Settings
from analysis.model.uncertainty_sources import combine_u
from analysis.stages.estimation import fit_quality
from analysis.stages.motion.phases import compute_sign_of_yaw_rate_change
from analysis.weighing.empty_mass_datum import list_factors_without_uncertainty
from analysis.weighing.mass_budget import make_mass_budget
from analysis.weighing.weigh import Weighing
from analysis.weighing.weighing_limits import LIMITS as WEIGHING_LIMITS
from estimators.arrays import Bools, Floats

#: Usual factors by which forces, speeds or the stated mass are wrong, with their causes.
_CANDIDATES: Final = {
    1.6093: "mile/h instead of km/h, or the reverse",
    2.0: "one side instead of both, or both instead of one",
    2.2369: "mile/h instead of m/s",
    3.6: "km/h instead of m/s",
    4.4482: "lbf instead of N",
    1.3558: "lbf·ft instead of N·m",
    8.8507: "lbf·in instead of N·m",
    9.5493: "rpm instead of rad/s",
    9.80665: "kgf instead of N, or g instead of m/s²",
    57.296: "degrees instead of radians",
    1000.0: "a thousand",
}
#: Likewise of the machine file's mass.
_MASS_UNITS: Final = {
    1.1023: "short tons instead of tonnes, or the reverse, in machine.empty_mass_kg",
    2.2046: "lb instead of kg, or the reverse, in machine.empty_mass_kg",
}


@dataclass(frozen=True)
class EmptyMassDifference:
    """Difference between the lightest load and the machine's empty mass.

    Attributes:
        mass_kg: lightest mass, without the inertia of rotating parts.
        empty_kg: empty mass in the machine file.
        u_kg: standard uncertainty of the difference, including the scale.
        is_scale_known: whether the machine file states the scale's uncertainty, which is 10 %
            if not.
        empty_known: whether the log shows when the machine was empty, or has several loads.
        machine: machine file, for the factors that it states.
    """

    mass_kg: float
    empty_kg: float
    u_kg: float
    is_scale_known: bool
    empty_known: bool
    machine: Machine

    @property
    def difference_over_uncertainty(self) -> float:
        """The difference in standard uncertainties; negative if the log's mass is smaller."""
        return (self.mass_kg - self.empty_kg) / self.u_kg

    @property
    def mass_ratio(self) -> float:
        """Ratio of the mass to the empty mass."""
        return self.mass_kg / self.empty_kg

    @property
    def can_test_scale(self) -> bool:
        """Whether no payload can explain the difference, so that it tests the scale."""
        return (
            self.difference_over_uncertainty < 0.0
            or self.empty_known
            or self.difference_over_uncertainty > LIMITS.payload_u
        )

    @property
    def difference_and_causes_text(self) -> str:
        """The factor and its possible causes, as text."""
        scale = (
            ""
            if self.is_scale_known
            else " (with 10 % for the scale, whose uncertainty the machine file does not state)"
        )
        payload = (
            "" if self.difference_over_uncertainty < 0.0 or self.empty_known else "a payload, or "
        )
        return (
            f"the lightest load weighs {self.mass_kg:,.0f} ± {self.u_kg:,.0f} kg{scale}, "
            f"{self.mass_ratio:.3g} times the {self.empty_kg:,.0f} kg of the empty machine: "
            f"{payload}{' or '.join(self.possible_causes)}"
        )

    @property
    def possible_causes(self) -> list[str]:
        """Possible causes of this factor, as text."""
        return list_possible_causes_of_mass_ratio(self.mass_ratio, self.machine)


def list_possible_causes_of_mass_ratio(
    mass_ratio: float, machine: Machine | None = None, tolerance: float = LIMITS.factor_tolerance
) -> list[str]:
    """Possible causes of masses that are wrong by a factor, as text, the gear or gain first.

    Args:
        mass_ratio: the factor.
        machine: machine file whose own factors and empty mass may be wrong; None if they are not in
            the factor.
        tolerance: largest difference of the logarithms of the factor and that of a cause.
    """
    if mass_ratio <= 0.0:
        return ["a force with the wrong sign"]
    times = max(mass_ratio, 1.0 / mass_ratio)
    known = _CANDIDATES if machine is None else {**_CANDIDATES, **_MASS_UNITS}
    share_1 = 1.0 if machine is None else machine.machine.force_share
    if share_1 < 1.0:
        known[1.0 / share_1] = f"machine.force_share ({share_1:g})"
    radius_m = None if machine is None else machine.machine.wheel_radius_m
    if radius_m is not None and radius_m != 1.0:
        stated = f"machine.wheel_radius_m ({radius_m:g}) applied twice, or not at all"
        known[max(radius_m, 1.0 / radius_m)] = stated
    near = [
        (off, f"{each:.4g}, {what}")
        for each, what in known.items()
        # a candidate must be nearer than a factor of 1
        if (off := abs(np.log(times / each))) < min(tolerance, np.log(each) / 2.0)
    ]
    named = [what for _, what in sorted(near)]
    gear = f"a gear or gain of {times:.3g}"
    return [gear if mass_ratio > 1.0 else f"{gear} applied inversely", *named[:3]]


@dataclass(frozen=True)
class AxisMotion:
    """Samples of one axis: A (n, p), f (n,), and (n,) flags.

    Attributes:
        A: regressor.
        f: force in N, or yaw torque in N·m.
        complete: whether no value is missing.
        moving: whether a sample is fitted: in motion, and not braking unless that counts as
            driving.
        braking: whether the machine slows down.
        speeding: whether the machine speeds up.
    """

    A: Floats
    f: Floats
    complete: Bools
    moving: Bools
    braking: Bools
    speeding: Bools

    @cached_property
    def ungated_fit(self) -> fit_quality.UngatedFit:
        """Fit of the axis' model to every moving sample."""
        return fit_quality.fit_ungated(self.A, self.f, self.moving)

    def compute_explained_variance_fraction(self, settings: Settings) -> float:
        """Fraction of the force's variance that the model explains.

        If that of the samples is below the limit, the larger one of samples and of means over
        a second: the noise of a derivative may dominate single samples.
        """
        own = self.ungated_fit.r_squared
        if not own < settings.verdict.r_squared_min:
            return own
        rows = max(1, round(LIMITS.explained_mean_s * settings.align.rate_hz))
        of_means = fit_quality.compute_r_squared_of_means(self.A, self.f, self.moving, rows)
        return float(np.fmax(own, of_means))

    @property
    def speed_or_yaw_rate(self) -> Floats:
        """Speed (n,) in m/s, or yaw rate in rad/s for a spin."""
        return self.A[:, 1]


@dataclass(frozen=True)
class CheckInputs:
    """Frames and results of one log that the checks judge.

    Attributes:
        excitation: frame with regressors and phases.
        gated: frame with the accepted windows.
        machine: machine file with empty mass and settings.
        weighing: the joint fit; None where nothing could be fitted.
        signals: raw channels; None if only frames are available.
        totals: the frame `masses`, before anything is withheld.
        t0_unix_ns: Unix time of the first row.
        noise: noise of the columns; None if unknown.
        left_out: excluded stretches and the answer without them, by check.
    """

    excitation: pl.DataFrame
    gated: pl.DataFrame
    machine: Machine
    weighing: Weighing | None = None
    signals: RawSignals | None = None
    totals: pl.DataFrame | None = None
    t0_unix_ns: int = 0
    noise: pl.DataFrame | None = None
    left_out: Mapping[str, ExcludedStretches] = field(default_factory=dict[str, ExcludedStretches])

    def has_grid_columns(self, *columns: str) -> bool:
        """Whether the log has all of these columns."""
        return set(columns) <= set(self.excitation.columns)

    def mark_samples_in_phases(self, *phases: str) -> Bools:
        """Whether each sample is in one of the named phases, (n,)."""
        return self.excitation["phase"].is_in(phases).fill_null(False).to_numpy()

    @cached_property
    def position_dependent_force_newtons(self) -> Floats | None:
        """Position-dependent force of the joint fit, such as a spring's, (n,) in N, or None."""
        return None if self.weighing is None else self.weighing.fit.force_by_position

    @cached_property
    def empty_mass_difference(self) -> EmptyMassDifference | None:
        """Lightest load compared with the empty mass; None if either is missing."""
        return compare_lightest_load_with_empty_mass(self.weighing, self.machine)

    @cached_property
    def side_differences(self) -> Mapping[str, SideDifference]:
        """Differences of right and left by kind: torque, speed, slip."""
        return compare_left_and_right_sides(
            self.excitation, self.signals, self.machine, self.t0_unix_ns
        )

    @cached_property
    def straight_motion(self) -> AxisMotion:
        """Samples of straight motion, without the position-dependent force."""
        settings = self.machine.settings
        A, f = make_straight_regressor_and_force(self.excitation, settings)
        if self.position_dependent_force_newtons is not None:
            f = f - self.position_dependent_force_newtons
        known = np.isfinite(A).all(axis=1) & np.isfinite(f)
        welcome = () if settings.gate.exclude_braking else ("braking",)
        return AxisMotion(
            A,
            f,
            known,
            moving=known & self.mark_samples_in_phases("accelerating", "cruising", *welcome),
            braking=known & self.mark_samples_in_phases("braking"),
            speeding=known & self.mark_samples_in_phases("accelerating"),
        )

    @cached_property
    def spin_motion(self) -> AxisMotion | None:
        """Samples of spins; None if the channels do not allow it or there are too few."""
        if Z not in list_axes_allowed_by_channels(self.excitation):
            return None
        A, f = make_spin_regressor_and_torque(self.excitation)
        known = np.isfinite(A).all(axis=1) & np.isfinite(f)
        spinning = known & self.mark_samples_in_phases("spinning")
        changes = compute_sign_of_yaw_rate_change(A[:, 1], self.machine.settings)
        braking = spinning & (changes < 0)
        welcome = not self.machine.settings.gate.exclude_braking
        moving = spinning if welcome else spinning & ~braking
        if not fit_quality.has_enough_moving_samples(A, moving):
            return None
        return AxisMotion(A, f, spinning, moving, braking, speeding=spinning & (changes > 0))


def compare_lightest_load_with_empty_mass(
    weighing: Weighing | None, machine: Machine
) -> EmptyMassDifference | None:
    """Compare the lightest load with the empty machine.

    Args:
        weighing: the joint fit.
        machine: machine file with its empty mass and scale uncertainties.

    Returns:
        The comparison; None if either mass is missing, or the fit has no uncertainty.
    """
    body = machine.machine
    if weighing is None or body.empty_mass_kg is None:
        return None
    fit = weighing.fit
    lightest = int(np.argmin(fit.masses_kg))
    sources = make_mass_budget(weighing, machine, fit.make_mass_coefficients_of_state(lightest))
    mass_kg = float(fit.masses_kg[lightest])
    unknown = bool(list_factors_without_uncertainty(sources))
    scale_kg = WEIGHING_LIMITS.unknown_scale_u * abs(mass_kg) if unknown else 0.0
    u_kg = float(np.linalg.norm([combine_u(sources), scale_kg, body.empty_mass_u_kg or 0.0]))
    if not np.isfinite([mass_kg, u_kg]).all() or u_kg == 0.0:
        return None
    # the lightest of several is biased towards light by chance
    by_chance_kg = combine_u(sources, "random") * float(np.sqrt(2.0 * np.log(fit.mass_count)))
    named = machine.settings.loads.empty_from_s is not None
    return EmptyMassDifference(
        mass_kg + by_chance_kg - body.rotating_mass_kg,
        body.empty_mass_kg,
        u_kg,
        not unknown,
        named or fit.mass_count > 1,
        machine,
    )
