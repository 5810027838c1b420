"""Spillage on the haul: the fraction of the weighed load that arrives at the dump.

A load is weighed while the machine accelerates, at the start of a haul. Later spillage cannot be
distinguished from uneven ground in the log, so the machine file states it
(`machine.haul_spillage_share`), as determined by a check weighing at the dump.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.cycle_parts import CycleParts
from analysis.cycles.load_passes import LoadPasses
from analysis.model.machine_body import Body
from analysis.model.schema import conform_frame_to_schema, get_column_values
from estimators.arrays import Floats

#: Columns that are proportional to the payload.
_IN_PROPORTION: Final = (
    *("payload_kg", "payload_u_random_kg", "payload_u_common_kg", "payload_u_shared_kg"),
    "scale_1",
)


def subtract_spillage(
    cycles: pl.DataFrame,
    cycle_parts: Sequence[CycleParts],
    passes: LoadPasses,
    frames: Mapping[str, pl.DataFrame],
    body: Body,
) -> pl.DataFrame:
    """Reduce payloads to the mass that arrives at the dump; unchanged without a stated spillage.

    Args:
        cycles: frame with payloads as weighed.
        cycle_parts: parts of the cycles, with the start of each haul and the stop for its dump.
        passes: passes, with the manoeuvres that weigh each load.
        frames: the frames `manoeuvres` and `excitation`.
        body: machine body with its spillage.
    """
    if body.haul_spillage_share is None or cycles.is_empty():
        return cycles
    progress = find_haul_fractions_when_weighed(
        cycle_parts, passes, frames["manoeuvres"], frames["excitation"]
    )
    arriving, u = compute_arriving_fraction_and_u(progress, body)
    known = cycles["payload_kg"].is_not_null().to_numpy()
    return subtract_spillage_from_payload_columns(
        cycles.with_columns(
            arriving_1=pl.Series(np.where(known, arriving, np.nan)).fill_nan(None),
            arriving_u_1=pl.Series(np.where(known, u, np.nan)).fill_nan(None),
        )
    )


def compute_arriving_fraction_and_u(haul_fraction: Floats, body: Body) -> tuple[Floats, Floats]:
    """Fraction of the weighed load that arrives, and its standard uncertainty.

    If a fraction s of a load L is spilled evenly over the haul, L (1 - s p) is weighed at the
    fraction p of the haul, and L (1 - s) arrives. The place of the spillage is unknown, so p has a
    rectangular distribution of half-width p.

    Args:
        haul_fraction: (cycles,) fraction p of the haul at which each load is weighed.
        body: machine body with s and its standard uncertainty.
    """
    spilled, spilled_u = body.haul_spillage_share or 0.0, body.haul_spillage_u or 0.0
    weighed = 1.0 - spilled * haul_fraction
    by_share = (1.0 - haul_fraction) / weighed**2 * spilled_u
    by_place = spilled * (1.0 - spilled) / weighed**2 * haul_fraction / np.sqrt(3.0)
    return (1.0 - spilled) / weighed, np.hypot(by_share, by_place)


def subtract_spillage_from_payload_columns(cycles: pl.DataFrame) -> pl.DataFrame:
    """Reduce payloads by the fractions in `arriving_1`, with their uncertainty `arriving_u_1`."""
    if cycles["arriving_1"].null_count() == cycles.height:
        return cycles
    arriving = pl.col("arriving_1").fill_null(1.0)
    added_kg = pl.col("arriving_u_1").fill_null(0.0) / arriving * pl.col("payload_kg")
    scaled = cycles.with_columns(pl.col(name) * arriving for name in _IN_PROPORTION)
    common, shared = (pl.col(f"payload_u_{name}_kg") for name in ("common", "shared"))
    widened = scaled.with_columns(
        (common**2 + added_kg**2).sqrt(), (shared**2 + added_kg**2).sqrt()
    )
    u_kg = (pl.col("payload_u_random_kg") ** 2 + common**2).sqrt()
    return conform_frame_to_schema("cycles", widened.with_columns(payload_u_kg=u_kg))


def find_haul_fractions_when_weighed(
    cycle_parts: Sequence[CycleParts],
    passes: LoadPasses,
    manoeuvres: pl.DataFrame,
    excitation: pl.DataFrame,
) -> Floats:
    """Fraction of the haul at which each load is weighed, (cycles,).

    A manoeuvre weighs the load at its mean time, weighted by squared acceleration; a load is
    weighed at the weighted mean of these times over its manoeuvres.
    """
    t_ns = excitation["t_ns"].to_numpy()
    moves = (excitation["phase"] != "standstill").fill_null(value=False).to_numpy()
    driven = np.cumsum(moves).astype(np.float64)
    weight = np.square(np.nan_to_num(get_column_values(excitation, "regressor_acc_x_m_s2")))
    sums, moments = (np.append(0.0, np.cumsum(x)) for x in (weight, weight * driven))
    first, last = (
        np.searchsorted(t_ns, manoeuvres[name].to_numpy()) for name in ("start_t_ns", "end_t_ns")
    )
    whole = sums[last] - sums[first]
    place = np.where(
        whole > 0.0,
        (moments[last] - moments[first]) / np.maximum(whole, LIMITS.min_acceleration_square),
        driven[first],
    )
    progress = np.zeros(len(cycle_parts))
    for number, part in enumerate(cycle_parts):
        if part.loaded_pass is None or part.haul_ns is None or part.dump_ns is None:
            continue
        begin, end = np.searchsorted(t_ns, (part.haul_ns[0], part.dump_ns[0]))
        haul = driven[min(end, t_ns.size - 1)] - driven[begin]
        own = passes.pass_of_manoeuvre == part.loaded_pass
        if haul > 0.0:
            mean = float(passes.share[own] @ place[own])
            progress[number] = np.clip((mean - driven[begin]) / haul, 0.0, 1.0)
    return progress
