"""Gate decisions over time, and the manoeuvres that deviate most from their loads."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from analysis.explain.explain_limits import LIMITS
from analysis.model.physical_units import NS_PER_S
from analysis.model.settings import Settings

#: By reason, the statistic that decides, the setting with its limit, and the comparison.
_DECIDES: Final[Mapping[str, tuple[str, str, str]]] = {
    "accepted": ("mi_x_nat", "threshold_nat", "≥"),
    "low_information": ("mi_x_nat", "threshold_nat", "≥"),
    "noise_limited": ("noise_share_x_1", "noise_share_max", "≤"),
}


@dataclass(frozen=True, slots=True)
class GateStretch:
    """Consecutive windows with the same reason.

    Attributes:
        start_s: end of the first window, in seconds since the start.
        end_s: end of the last window.
        reason: reason of the gate.
        column: statistic that decided, if any.
        value: median of that statistic.
        limit: limit of the statistic, with the sign of the comparison.
    """

    start_s: float
    end_s: float
    reason: str
    column: str | None = None
    value: float | None = None
    limit: str | None = None


@dataclass(frozen=True, slots=True)
class ManoeuvreReport:
    """Mass of a manoeuvre compared with that of its load.

    Attributes:
        start_s: seconds since the start.
        end_s: end, in seconds since the start.
        load_id: id of its load; None without a load.
        mass_kg: mass of the manoeuvre alone.
        mass_std_kg: standard deviation of that mass.
        load_kg: mass of the load.
        deviations: difference of the two masses over the standard deviation of `mass_kg`.
        reason: reason of the gate if it rejected the manoeuvre.
    """

    start_s: float
    end_s: float
    load_id: int | None
    mass_kg: float | None
    mass_std_kg: float | None
    load_kg: float | None
    deviations: float | None
    reason: str


def list_stretches_of_gate_decisions(
    gate: pl.DataFrame, settings: Settings, start_ns: int, end_ns: int
) -> tuple[GateStretch, ...]:
    """Gate decisions in order of time, each with the statistic that decided.

    Args:
        gate: frame `gate`, with `t_ns`.
        settings: settings with the limits.
        start_ns: end of the first window.
        end_ns: end of the last window.
    """
    if "reason_x" not in gate.columns:
        return ()
    rows = gate.filter(pl.col("t_ns").is_between(start_ns, end_ns))
    reason = pl.col("reason_x").cast(pl.String)
    rows = rows.with_columns(reason=reason).with_columns(run=pl.col("reason").rle_id())
    spans = rows.group_by("run", maintain_order=True).agg(
        pl.col("reason").first(),
        start=pl.col("t_ns").first(),
        end=pl.col("t_ns").last(),
    )
    long = spans.filter((pl.col("end") - pl.col("start")) >= LIMITS.stretch_min_s * NS_PER_S)
    kept = (long if long.height else spans).head(LIMITS.max_stretches)
    found: list[GateStretch] = []
    for span in kept.iter_rows(named=True):
        inside = rows.filter(pl.col("run") == span["run"])
        found.append(_make_gate_stretch(span, inside, settings))
    return tuple(found)


def _make_gate_stretch(
    row_span: Mapping[str, Any], gate_rows: pl.DataFrame, settings: Settings
) -> GateStretch:
    """Stretch with the median of the statistic that decided, and its limit."""
    start_s, end_s, reason = (
        row_span["start"] / NS_PER_S,
        row_span["end"] / NS_PER_S,
        str(row_span["reason"]),
    )
    decides = _DECIDES.get(reason)
    if reason == "negative_dependence" and "corr_x_1" in gate_rows.columns:
        return GateStretch(
            start_s,
            end_s,
            reason,
            "corr_x_1",
            _compute_median_of_gate_column(gate_rows, "corr_x_1"),
            "> 0",
        )
    if decides is None or decides[0] not in gate_rows.columns:
        return GateStretch(start_s, end_s, reason)
    column, limit, sign = decides
    level = getattr(settings.gate, limit)
    return GateStretch(
        start_s,
        end_s,
        reason,
        column,
        _compute_median_of_gate_column(gate_rows, column),
        f"{sign} {level:g}",
    )


def _compute_median_of_gate_column(gate_rows: pl.DataFrame, column: str) -> float | None:
    value = gate_rows[column].median()
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


def compute_fractions_of_gate_reasons(gate: pl.DataFrame) -> dict[str, float]:
    """Fraction of windows by reason, the most frequent first."""
    if "reason_x" not in gate.columns or not gate.height:
        return {}
    counts = gate["reason_x"].cast(pl.String).value_counts(sort=True)
    return {str(name): count / gate.height for name, count in counts.rows()}


def report_worst_manoeuvres(frames: Mapping[str, pl.DataFrame]) -> tuple[ManoeuvreReport, ...]:
    """Manoeuvres whose mass deviates most from that of their load, in standard deviations.

    If no manoeuvre has a mass, the longest ones that the gate rejected, except one that is nearly
    as long as the log.
    """
    known = [each for each in _report_manoeuvres_by_load(frames) if each.deviations is not None]
    if known:
        known.sort(key=lambda each: -abs(each.deviations or 0.0))
        return tuple(known[: LIMITS.max_manoeuvres])
    longest_s = LIMITS.whole_log_fraction * _compute_log_duration_s(frames)
    parts = (
        each
        for each in _report_manoeuvres_rejected_by_gate(frames)
        if each.end_s - each.start_s < longest_s
    )
    refused = sorted(parts, key=lambda each: each.start_s - each.end_s)
    return tuple(refused[: LIMITS.max_manoeuvres])


def _compute_log_duration_s(frames: Mapping[str, pl.DataFrame]) -> float:
    """Time between the first and the last sample; infinite if unknown."""
    motion = frames.get("excitation")
    if motion is None or motion.is_empty():
        return math.inf
    return float(motion["t_ns"][-1] - motion["t_ns"][0]) / NS_PER_S


def report_manoeuvre_at_time(
    frames: Mapping[str, pl.DataFrame], at_s: float
) -> ManoeuvreReport | None:
    """Manoeuvre at a moment: one with a mass, otherwise one that the gate rejected."""
    for found in (_report_manoeuvres_by_load(frames), _report_manoeuvres_rejected_by_gate(frames)):
        here = [each for each in found if each.start_s <= at_s <= each.end_s]
        if here:
            return here[0]
    return None


def _report_manoeuvres_by_load(frames: Mapping[str, pl.DataFrame]) -> list[ManoeuvreReport]:
    loads, manoeuvres = frames.get("loads"), frames.get("manoeuvres")
    if loads is None or manoeuvres is None:
        return []
    masses = dict(loads.select("load_id", "mass_kg").rows())
    found: list[ManoeuvreReport] = []
    for row in manoeuvres.iter_rows(named=True):
        mass, std, load = row["mass_kg"], row["mass_std_kg"], masses.get(row["load_id"])
        apart = None
        if mass is not None and std and load is not None:
            apart = (mass - load) / std
        times = row["start_t_ns"] / NS_PER_S, row["end_t_ns"] / NS_PER_S
        found.append(ManoeuvreReport(*times, row["load_id"], mass, std, load, apart, "accepted"))
    return found


def _report_manoeuvres_rejected_by_gate(
    frames: Mapping[str, pl.DataFrame],
) -> list[ManoeuvreReport]:
    segments = frames.get("segments")
    if segments is None:
        return []
    return [
        ManoeuvreReport(
            row["start_t_ns"] / NS_PER_S,
            row["end_t_ns"] / NS_PER_S,
            None,
            row.get("mass_kg"),
            row.get("mass_std_kg"),
            None,
            None,
            str(row["reason"]),
        )
        for row in segments.iter_rows(named=True)
    ]
