"""Frame `shift`: totals of the cycles, with random and common uncertainty.

The mass dumped in the shift is the sum over the counted cycles, the cycles that the log shows
without a mass, and the cycles hidden by gaps; one uncertainty covers the whole sum.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.boom_dumps import mark_standing_samples
from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.cycles_lost_in_gaps import (
    estimate_cycles_lost_in_gaps,
    find_spans_of_missing_channels_ns,
    mark_gaps_that_may_be_work_breaks,
)
from analysis.cycles.cycles_without_mass import (
    estimate_uncounted_cycle_count,
    estimate_unweighed_load_and_u_kg,
)
from analysis.cycles.empty_machine import BY_CALIBRATION, ShiftScale
from analysis.model.physical_units import NS_PER_S
from analysis.model.schema import FRAMES, build_frame
from analysis.model.windows import find_flagged_runs

_NO_SCALE: Final = ShiftScale()


class LabelTotal(NamedTuple):
    """Total of the counted loads with one label.

    Attributes:
        label: the label; "" for loads without one.
        loads: number of loads.
        payload_kg: sum of the payloads.
        payload_u_kg: standard uncertainty of the sum.
    """

    label: str
    loads: int
    payload_kg: float
    payload_u_kg: float


def make_shift_totals_frame(
    cycles: pl.DataFrame,
    excitation: pl.DataFrame,
    aligned: pl.DataFrame,
    scale: ShiftScale = _NO_SCALE,
    min_detectable_kg: float | None = None,
) -> pl.DataFrame:
    """Make the frame `shift`, which has one row.

    Args:
        cycles: the frame `cycles`.
        excitation: frame with the phases.
        aligned: frame with the gaps of the recording.
        scale: source of the payloads' scale.
        min_detectable_kg: smallest load that a single start can detect, if known.
    """
    gaps = find_spans_of_missing_channels_ns(excitation, aligned)
    lost, more = (
        estimate_cycles_lost_in_gaps(
            cycles, gaps, mark_gaps_that_may_be_work_breaks(gaps, excitation)
        ),
        estimate_uncounted_cycle_count(cycles, excitation, aligned),
    )
    t_ns = excitation["t_ns"].to_numpy()
    duration_s = float(t_ns[-1] - t_ns[0]) / NS_PER_S if t_ns.size else 0.0
    gap_s = sum(end - start for start, end in gaps) / NS_PER_S
    idle_s = sum_idle_time_s(excitation)
    row: dict[str, Any] = {
        "start_t_ns": int(t_ns[0]) if t_ns.size else 0,
        "end_t_ns": int(t_ns[-1]) if t_ns.size else 0,
        **make_totals_of_counted_cycles(cycles, ()),
        "lost_cycles": lost.cycles,
        "lost_cycles_u": lost.u,
        "lost_kg": lost.payload_kg,
        "lost_u_kg": lost.payload_u_kg,
        "digs": cycles.height - cycles["dig_t_ns"].null_count(),
        "boom_dumps": more.dumps,
        "uncounted_cycles": more.cycles,
        "uncounted_cycles_u": more.u,
        "on_board_kg": more.on_board_kg,
        "on_board_u_kg": more.on_board_u_kg,
        "min_detectable_kg": min_detectable_kg,
        "scale_from": scale.told_by,
        "scale_unknown": scale.unknown,
        "gain_1": scale.gain_1,
        "gain_u_1": scale.gain_u_1,
        "duration_s": duration_s,
        "gap_s": gap_s,
        "idle_s": idle_s,
        "utilisation_1": max(duration_s - gap_s - idle_s, 0.0) / max(duration_s - gap_s, 1e-9),
    }
    row |= sum_total_payload_with_u(row)
    declared = FRAMES["shift"].columns
    return build_frame("shift", {c.name: pl.Series([row[c.name]], dtype=c.dtype) for c in declared})


def estimate_min_detectable_load_kg(manoeuvres: pl.DataFrame, loads: pl.DataFrame) -> float | None:
    """Smallest load in kg that one manoeuvre can detect; None if masses or scatter are unknown.

    It is the minimum detectable value of ISO 11843-1, with the median noise of a manoeuvre's mass
    and the largest scatter of the manoeuvres of one load.

    Args:
        manoeuvres: frame with masses and their standard deviations.
        loads: frame with the scatter.
    """
    noise_kg = manoeuvres["mass_std_kg"].drop_nulls().to_numpy()
    scatter_kg = loads["scatter_kg"].drop_nulls().to_numpy()
    if not noise_kg.size or not scatter_kg.size or not loads["scatter_known"].any():
        return None
    return LIMITS.min_detectable_std * float(np.hypot(np.median(noise_kg), scatter_kg.max()))


def recompute_shift_totals(
    shift_frame: pl.DataFrame, cycles: pl.DataFrame, rejected_cycles: Collection[int] = ()
) -> pl.DataFrame:
    """Recompute the totals for changed cycles: calibrated ones, or without rejected ones.

    Args:
        shift_frame: frame `shift`.
        cycles: frame `cycles`.
        rejected_cycles: numbers of cycles to exclude.
    """
    sums = make_totals_of_counted_cycles(cycles, rejected_cycles)
    mean_kg = shift_frame["payload_mean_kg"][0]
    scale = float(sums["payload_mean_kg"] or 0.0) / mean_kg if mean_kg else 1.0
    row = shift_frame.row(0, named=True)
    # a load whose payload the calibration withholds was dumped nevertheless
    refused = int(sums["cycles_without_mass"] or 0) - int(row["cycles_without_mass"] or 0)
    found = sums | {
        "uncounted_cycles": (row["uncounted_cycles"] or 0.0) + refused,
        "lost_kg": (row["lost_kg"] or 0.0) * scale,
        "lost_u_kg": (row["lost_u_kg"] or 0.0) * scale,
    }
    if (cycles["scale_from"] == BY_CALIBRATION).any():
        found |= {"scale_from": BY_CALIBRATION, "scale_unknown": ""}
    found |= sum_total_payload_with_u(row | found)
    return shift_frame.with_columns(
        pl.lit(value).cast(shift_frame.schema[name]).alias(name) for name, value in found.items()
    )


def sum_total_payload_with_u(shift_row: Mapping[str, Any]) -> dict[str, float]:
    """Total mass dumped in the shift, with its uncertainty, as columns of `shift`.

    The total includes counted cycles, cycles without a mass and cycles lost in gaps.

    Cycles without a mass share the common uncertainty of the payloads that they are estimated from.
    """
    counted_kg, lost_kg = shift_row["payload_kg"], shift_row["lost_kg"] or 0.0
    number_u = shift_row["uncounted_cycles_u"] or 0.0
    known = (shift_row["payload_mean_kg"], shift_row["payload_std_kg"], shift_row["cycles_counted"])
    more_kg, more_u_kg = estimate_unweighed_load_and_u_kg(
        shift_row["uncounted_cycles"] or 0.0, number_u, *known
    )
    total_kg = counted_kg + more_kg + lost_kg
    common_kg = shift_row["payload_u_common_kg"] * (
        total_kg / counted_kg if counted_kg > 0.0 else 1.0
    )
    parts = (shift_row["payload_u_random_kg"], common_kg, more_u_kg, shift_row["lost_u_kg"] or 0.0)
    return {
        "uncounted_kg": more_kg,
        "uncounted_u_kg": more_u_kg,
        "total_kg": total_kg,
        "total_u_kg": float(np.linalg.norm(parts)),
    }


def make_totals_of_counted_cycles(
    cycles: pl.DataFrame, rejected_cycles: Collection[int]
) -> dict[str, Any]:
    """Totals of the counted cycles, as columns of `shift`.

    Random errors of the passes are added in quadrature, each with its total weight in the sum,
    since an empty pass is part of the payloads before and after it. Common ones are added linearly.
    """
    out = pl.col("cycle").is_in(list(rejected_cycles))
    counted = cycles.filter(pl.col("counted") & ~out)
    payload, back = counted["payload_kg"], counted["carry_back_kg"]
    random_kg = compute_random_u_of_payload_sum_kg(counted)
    common_kg = float(counted["payload_u_shared_kg"].sum())
    return {
        "cycles": cycles.height,
        "cycles_counted": counted.height,
        "cycles_rejected": cycles.filter(out).height,
        "cycles_without_mass": cycles.filter(pl.col("payload_kg").is_null()).height,
        "payload_kg": float(payload.sum()),
        "payload_u_random_kg": random_kg,
        "payload_u_common_kg": common_kg,
        "payload_u_kg": float(np.hypot(random_kg, common_kg)),
        "payload_mean_kg": _return_float_or_none(payload.mean()),
        "payload_std_kg": _return_float_or_none(payload.std()),
        "carry_back_mean_kg": _return_float_or_none(back.mean()),
        "arriving_1": _return_float_or_none(counted["arriving_1"].mean()),
        "arriving_u_1": _return_float_or_none(counted["arriving_u_1"].mean()),
        # that of the clean bucket's mass is common to all carry-backs
        "carry_back_u_kg": _return_float_or_none(counted["carry_back_u_kg"].mean()),
    }


def _return_float_or_none(value: object) -> float | None:
    return value if isinstance(value, float) else None


def compute_random_u_of_payload_sum_kg(counted_cycles: pl.DataFrame) -> float:
    """Random standard uncertainty of the sum of payloads, in kg."""
    weight: dict[int, float] = {}
    u_kg: dict[int, float] = {}
    carried = 0.0
    for row in counted_cycles.iter_rows(named=True):
        before_1 = row["tare_before_1"]
        shares = (
            ("loaded", 1.0),
            ("empty_before", -before_1),
            ("empty_after", before_1 - 1.0),
        )
        own = 0.0
        for name, share in shares:
            number = row[f"{name}_id"]
            if number is not None:
                weight[number] = weight.get(number, 0.0) + share
                u_kg[number] = row["scale_1"] * row[f"{name}_u_kg"]
                own += (share * u_kg[number]) ** 2
        # in the sum only the first and the last carry-back remain
        carried = max(carried, row["payload_u_random_kg"] ** 2 - own)
    return float(np.sqrt(sum((weight[n] * u_kg[n]) ** 2 for n in weight) + carried))


def sum_idle_time_s(excitation: pl.DataFrame) -> float:
    """Total time in s of standstills that are long enough to be idling."""
    if excitation.is_empty():
        return 0.0
    stands = mark_standing_samples(excitation)
    t_ns = excitation["t_ns"].to_numpy()
    begins, ends = find_flagged_runs(stands)
    lengths = (t_ns[ends] - t_ns[begins]) / NS_PER_S
    return float(lengths[lengths > LIMITS.idle_s].sum())


def sum_cycles_by_label(
    cycles: pl.DataFrame, cycle_labels: Sequence[str], rejected_cycles: Collection[int] = ()
) -> list[LabelTotal]:
    """Totals by label; empty if no cycle has a label.

    Each total includes the common uncertainty, so the uncertainties of two labels must not be added
    in quadrature.

    Args:
        cycles: frame `cycles`.
        cycle_labels: label of each row; "" for none.
        rejected_cycles: numbers of cycles to exclude.
    """
    if not any(cycle_labels):
        return []
    found: list[LabelTotal] = []
    named = cycles.with_columns(pl.Series("label", cycle_labels, dtype=pl.String))
    for label in sorted(set(cycle_labels), key=lambda each: (each == "", each)):
        sums = make_totals_of_counted_cycles(
            named.filter(label=label).drop("label"), rejected_cycles
        )
        total = LabelTotal(label, sums["cycles_counted"], sums["payload_kg"], sums["payload_u_kg"])
        if total.loads:
            found.append(total)
    return found
