"""Spillage on the haul: the share of the weighed load that arrives at the dump.

A load is weighed where the machine gains speed, at the start of a haul. What pours from the bucket
after that leaves no trace in the log that uneven ground does not leave as well, so the machine file
states it (`machine.haul_spillage_share`), as a check weighing at the dump tells it.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.machine import Body
from analysis.model.schema import conform, values

Floats = NDArray[np.float64]

#: Columns that are in proportion to the payload.
_IN_PROPORTION: Final = (
    *("payload_kg", "payload_u_random_kg", "payload_u_common_kg", "payload_u_shared_kg"),
    "scale_1",
)


def subtract_spillage(
    cycles: pl.DataFrame,
    hauls: Sequence[tuple[int, int] | None],
    manoeuvres: pl.DataFrame,
    excitation: pl.DataFrame,
    body: Body,
) -> pl.DataFrame:
    """Make payloads those that arrive at the dump; without a stated spillage they stay.

    Args:
        cycles: the frame, with payloads as weighed.
        hauls: by cycle when its load sets off and when it stands to dump, in ns; None: not seen.
        manoeuvres: when the starts were that weigh.
        excitation: acceleration and phases.
        body: with its spillage.
    """
    if body.haul_spillage_share is None or cycles.is_empty():
        return cycles
    progress = _weighed_at(hauls, manoeuvres, excitation)
    arriving, u = arriving_share(progress, body)
    known = cycles["payload_kg"].is_not_null().to_numpy()
    return deliver(
        cycles.with_columns(
            arriving_1=pl.Series(np.where(known, arriving, np.nan)).fill_nan(None),
            arriving_u_1=pl.Series(np.where(known, u, np.nan)).fill_nan(None),
        )
    )


def arriving_share(progress: Floats, body: Body) -> tuple[Floats, Floats]:
    """The weighed load's share that arrives, and its standard uncertainty.

    Of a load L the share s is spilled evenly over the haul, so that L (1 - s p) is weighed where
    the share p of the haul is driven, and L (1 - s) arrives. Where on the haul it pours is not
    known: p is uncertain by a rectangle of its own width.

    Args:
        progress: (cycles,) p.
        body: with s and its standard uncertainty.
    """
    spilled, spilled_u = body.haul_spillage_share or 0.0, body.haul_spillage_u or 0.0
    weighed = 1.0 - spilled * progress
    by_share = (1.0 - progress) / weighed**2 * spilled_u
    by_place = spilled * (1.0 - spilled) / weighed**2 * progress / np.sqrt(3.0)
    return (1.0 - spilled) / weighed, np.hypot(by_share, by_place)


def deliver(cycles: pl.DataFrame) -> pl.DataFrame:
    """Take the spillage of the columns `arriving_1` and `arriving_u_1` off payloads."""
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
    return conform("cycles", widened.with_columns(payload_u_kg=u_kg))


def _weighed_at(
    hauls: Sequence[tuple[int, int] | None], manoeuvres: pl.DataFrame, excitation: pl.DataFrame
) -> Floats:
    """(cycles,) share of its haul that each load has behind it where it is weighed.

    Acceleration weighs: the share is the mean over the starts of the haul, each sample by the
    square of its acceleration, of the time in motion since the first of them.
    """
    t_ns = excitation["t_ns"].to_numpy()
    moves = (excitation["phase"] != "standstill").fill_null(value=False).to_numpy()
    driven = np.cumsum(moves).astype(np.float64)
    weight = np.square(np.nan_to_num(values(excitation, "regressor_acc_x_m_s2")))
    inside = np.zeros(t_ns.size, np.bool_)
    for begin_ns, end_ns in manoeuvres.select("start_t_ns", "end_t_ns").iter_rows():
        first, last = np.searchsorted(t_ns, [begin_ns, end_ns])
        inside[first : last + 1] = True
    sums = np.append(0.0, np.cumsum(np.where(inside, weight, 0.0)))
    moments = np.append(0.0, np.cumsum(np.where(inside, weight * driven, 0.0)))
    progress = np.zeros(len(hauls))
    for row, span in enumerate(hauls):
        if span is None:
            continue
        first, last = np.minimum(np.searchsorted(t_ns, span), t_ns.size - 1)
        whole, all_driven = sums[last] - sums[first], driven[last] - driven[first]
        if whole > 0.0 and all_driven > 0.0:
            mean = (moments[last] - moments[first]) / whole
            progress[row] = np.clip((mean - driven[first]) / all_driven, 0.0, 1.0)
    return progress
