"""Exclusion of the stretches that a check finds from the fit, and its effect on the answer.

A sensor that freezes for a second in a day, or an engine at its limit, is no reason to withhold the
answer: such stretches are excluded. If that changes the answer, the channel cannot be trusted
elsewhere either, and the answer is withheld.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl

from analysis.diagnosis.diagnosis_limits import LIMITS
from analysis.diagnosis.measured_channels import RawSignals, Spans
from analysis.model.machine import Machine
from analysis.model.verdict_limits import VerdictLimits
from analysis.model.windows import flag_windows_with_flagged_rows
from analysis.stages.gating.gate import reject_windows_with_excluded_rows
from analysis.stages.motion.phases import count_rows_in_speed_rate_span
from analysis.weighing.braking_comparison import compute_mean_mass_a_minus_b_kg
from analysis.weighing.weigh import Weighing
from estimators.arrays import Bools


@dataclass(frozen=True)
class ExcludedStretches:
    """Effect of excluding the stretches that a check finds.

    Attributes:
        fitted_s: duration of the part of the stretches that the fit had used.
        mass_change_over_u: change of the mass without them, in standard uncertainties of the new
            answer; infinite if nothing is left.
    """

    fitted_s: float
    mass_change_over_u: float

    @property
    def does_exclusion_keep_mass(self) -> bool:
        """Whether the answer stays the same without the stretches."""
        return self.mass_change_over_u <= LIMITS.harmless_change_u

    @property
    def exclusion_effect_text(self) -> str:
        """The effect of the exclusion as text."""
        if not self.fitted_s:
            return "none of it is among the weighed samples"
        part = f"{self.fitted_s:.1f} s of it among the weighed samples"
        by = f"by {self.mass_change_over_u:.1f} standard uncertainties"
        if self.does_exclusion_keep_mass:
            return f"{part}, excluded: this moves the mass {by}"
        if not np.isfinite(self.mass_change_over_u):
            return f"{part}: without it no sample is left"
        return f"{part}: without it the mass moves {by}"


@dataclass(frozen=True)
class RefitWithoutStretches:
    """The answer without the harmless stretches that checks find.

    Attributes:
        weighing: the joint fit.
        gated: the frame `gate`, with windows that contain excluded stretches rejected.
        named: effect of excluding the stretches, by check.
    """

    weighing: Weighing | None
    gated: pl.DataFrame
    named: Mapping[str, ExcludedStretches]


def refit_without_failing_stretches(
    signals: RawSignals,
    aligned_grid: tuple[pl.DataFrame, int],
    gated: pl.DataFrame,
    machine: Machine,
    weigh_grid: Callable[[pl.DataFrame], Weighing | None],
) -> RefitWithoutStretches:
    """Fit with and without the stretches that checks of the readings find.

    Args:
        signals: raw channels.
        aligned_grid: `aligned` and the Unix time of its first row in ns.
        gated: frame with the accepted windows.
        machine: machine file with settings.
        weigh_grid: computes the joint fit of a grid without the excluded rows.
    """
    aligned, t0_unix_ns = aligned_grid
    weighing = weigh_grid(aligned)
    rows = np.zeros(aligned.height, np.bool_)
    named: dict[str, ExcludedStretches] = {}
    for check, spans, why in _iter_stretches_to_exclude_by_check(signals, machine.settings.verdict):
        held = mark_grid_rows_in_spans(spans, aligned["t_ns"].to_numpy() + t0_unix_ns, machine)
        if not held.any() or weighing is None:
            continue
        fitted = int(np.count_nonzero(held & mark_fitted_or_growing_load_samples(weighing)))
        found = ExcludedStretches(fitted / machine.settings.align.rate_hz, 0.0)
        if fitted:
            without = weigh_grid(aligned.with_columns(left_out=pl.Series(rows | held)))
            found = ExcludedStretches(
                found.fitted_s, compute_mass_change_over_uncertainty(weighing, without)
            )
            weighing = without if found.does_exclusion_keep_mass else weighing
        named[check] = found
        if found.does_exclusion_keep_mass:
            rows |= held
            # the moving mean and the phase look back
            seen = flag_windows_with_flagged_rows(
                held,
                count_rows_in_speed_rate_span(machine.settings) + machine.settings.smooth.samples,
            )
            gated = reject_windows_with_excluded_rows(gated, seen, why, machine.settings)
    return RefitWithoutStretches(weighing, gated, named)


def _iter_stretches_to_exclude_by_check(
    signals: RawSignals, limits: VerdictLimits
) -> Iterator[tuple[str, Mapping[str, Spans], str]]:
    """Name, stretches by channel, and rejection reason of each failing check."""
    if signals.longest_frozen_duration_s > limits.frozen_max_s:
        yield "frozen_s", signals.frozen_spans, "gap"  # a frozen reading was not measured
    if signals.largest_clipped_fraction > limits.clipped_max:
        yield "clipped_share", signals.clipped_spans, "saturated"


def mark_fitted_or_growing_load_samples(weighing: Weighing) -> Bools:
    """Flags (n,) of the samples of the fit and of manoeuvres whose load appears to change."""
    motion = weighing.fit.motion
    return motion.is_fittable | np.isin(
        motion.manoeuvre_of_sample, [each.manoeuvre_id for each in weighing.growing_load_manoeuvres]
    )


def compute_mass_change_over_uncertainty(
    fit_with_all: Weighing, fit_without: Weighing | None
) -> float:
    """Change of the mass without the stretches, over its standard uncertainty."""
    if fit_without is None:
        return np.inf
    mass_change_over_u = (
        abs(compute_mean_mass_a_minus_b_kg(fit_without.fit, fit_with_all.fit))
        / fit_without.fit.u_kg
    )
    return mass_change_over_u if np.isfinite(mass_change_over_u) else np.inf


def mark_grid_rows_in_spans(
    spans_by_channel: Mapping[str, Spans], unix_ns: np.ndarray, machine: Machine
) -> Bools:
    """Whether a stretch of any channel overlaps each grid row, (n,)."""
    reach_ns = int(LIMITS.smeared_periods / machine.settings.filter.cutoff_hz * 1e9)
    held = np.zeros(unix_ns.size, np.bool_)
    for start, end in (span for each in spans_by_channel.values() for span in each):
        first, last = np.searchsorted(unix_ns, [start - reach_ns, end + reach_ns])
        held[first:last] = True
    return held
