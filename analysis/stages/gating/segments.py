"""Manoeuvres: stretches that a window may lie in, and the pooled estimate of each."""

import numpy as np
import polars as pl

from analysis.model.axes import (
    Axis,
    X,
    Z,
    list_axes_allowed_by_channels,
    make_regressor_and_force,
    make_trace_columns,
)
from analysis.model.methods import METHODS
from analysis.model.schema import PHASE, REASON, build_frame
from analysis.model.settings import Settings
from analysis.stages.gating.gate import mark_samples_for_pooling
from analysis.stages.motion.phases import TURNS
from analysis.stages.noise.column_noise import collect_axis_noise
from estimators.arrays import Ints

#: A straight manoeuvre is named after the first of these that it contains.
_TELLING = ("accelerating", "braking", "cruising", "standstill")


def assign_manoeuvre_numbers_to_samples(excitation: pl.DataFrame, settings: Settings) -> Ints:
    """Number of the manoeuvre of each sample, (rows,), -1 where a sample is missing.

    Straight driving from a standstill or the end of braking to the next braking, turn or gap is
    one manoeuvre; a stretch of braking (unless braking counts as driving), of spinning, of an arc
    or of turning is one each.
    """
    phase = excitation["phase"]
    alone = (*TURNS, *(("braking",) if settings.gate.exclude_braking else ()))
    known = phase.is_not_null().to_numpy()
    kinds = np.array([1 + alone.index(name) if name in alone else 0 for name in PHASE.categories])
    kind = kinds.astype(np.int8)[phase.cast(PHASE).to_physical().fill_null(0).to_numpy()]
    kind = np.where(known, kind, np.int8(-1))
    starts = np.append(True, np.diff(kind) != 0)[: kind.size] & known
    return np.where(known, np.cumsum(starts) - 1, -1).astype(np.int64)


def assign_pooled_manoeuvre_numbers_to_samples(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings, axis: Axis = X
) -> Ints:
    """Number of the manoeuvre that each sample is pooled into, (rows,), -1 for none."""
    used = mark_samples_for_pooling(excitation, gated, settings, axis)
    return np.where(used, assign_manoeuvre_numbers_to_samples(excitation, settings), -1)


def estimate_each_manoeuvre_by_pooling(
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    settings: Settings,
    noise: pl.DataFrame | None = None,
) -> pl.DataFrame:
    """Make `segments`: a row per manoeuvre with its pooled estimate, or the reason for none.

    Args:
        excitation: frame with the regressor and the phases.
        gated: frame `gate` with the accepted windows.
        settings: settings with the window and the phases that are rejected.
        noise: noise of the columns, if known.
    """
    turns = TURNS if Z not in list_axes_allowed_by_channels(excitation) else ("arc", "turning")
    refused_for = {**dict.fromkeys(turns, "turning"), "standstill": "standstill"}
    if settings.gate.exclude_braking:
        refused_for["braking"] = "braking"
    manoeuvre_of_sample = assign_manoeuvre_numbers_to_samples(excitation, settings)
    used = np.zeros(manoeuvre_of_sample.size, np.bool_)
    parts: list[pl.DataFrame] = []
    for axis in list_axes_allowed_by_channels(excitation):
        pooled_ids = assign_pooled_manoeuvre_numbers_to_samples(excitation, gated, settings, axis)
        used |= pooled_ids >= 0
        A, f = make_regressor_and_force(axis, excitation, settings)
        method = METHODS["pooled"]
        options = method.options(settings.trace, collect_axis_noise(axis, settings, noise))
        traced = method.estimator.estimate_along_log(A, f, pooled_ids, options)
        parts.append(
            pl.DataFrame(
                {"segment_id": pooled_ids[traced.index], **make_trace_columns(axis, traced)},
                schema_overrides={"segment_id": pl.Int64},
            )
        )
    # no manoeuvre is pooled on two axes: x uses none that turns, z only those that turn
    estimates = pl.concat(parts, how="diagonal")
    spinning = pl.col("phase") == "spinning"
    table = (
        pl.DataFrame(
            {
                "segment_id": manoeuvre_of_sample,
                "t_ns": excitation["t_ns"],
                "phase": excitation["phase"].cast(pl.String),
                "used": used,
                "reason": gated["reason_x"].cast(pl.String),
            }
        )
        .with_columns(
            # a spin is judged on the yaw axis where there is one
            pl.when(spinning).then(gated["reason_z"].cast(pl.String)).otherwise("reason")
            if Z in list_axes_allowed_by_channels(excitation)
            else "reason"
        )
        .filter(pl.col("segment_id") >= 0)
        .group_by("segment_id", maintain_order=True)
        .agg(
            pl.col("t_ns").first().alias("start_t_ns"),
            pl.col("t_ns").last().alias("end_t_ns"),
            pl.coalesce(
                *(pl.when((pl.col("phase") == p).any()).then(pl.lit(p)) for p in _TELLING),
                pl.col("phase").first(),
            )
            .first()
            .alias("phase"),
            pl.len().alias("samples"),
            pl.col("used").sum().alias("samples_accepted"),
            pl.when(pl.col("used").any())
            .then(pl.lit("accepted"))
            .otherwise(pl.col("reason").mode(maintain_order=True).first())
            .first()
            .alias("reason"),
        )
        .with_columns(
            # the reason of a stretch that is rejected for its phase is that phase
            pl.when(pl.col("samples_accepted") > 0)
            .then("reason")
            .otherwise(pl.col("phase").replace_strict(refused_for, default=pl.col("reason")))
            .cast(REASON),
            pl.col("phase").cast(PHASE),
        )
        .join(estimates, on="segment_id", how="left", maintain_order="left")
    )
    return build_frame("segments", table.to_dict())
