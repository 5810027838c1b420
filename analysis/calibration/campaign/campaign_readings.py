"""Readings of a campaign's runs, for each manoeuvre and by each method."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.calibration.campaign.campaign_plan import (
    EMPTY,
    JOINT_ESTIMATORS,
    CampaignRun,
    Estimator,
)
from analysis.calibration.line.procedure import PRESENT_PROCEDURE, Procedure
from analysis.calibration.line.shared_errors import RunResponse, SharedErrors
from analysis.model.methods import METHODS, SummaryRule
from analysis.model.physical_units import NS_PER_S
from analysis.model.run_record import Run
from analysis.model.uncertainty_sources import SCALES

#: Columns of readings: a row per manoeuvre; a run without any has one row without a mass.
READINGS: Final[dict[str, type[pl.DataType]]] = {
    "run_id": pl.String,
    "load_id": pl.String,
    "day": pl.String,
    "log": pl.String,
    "reading": pl.Int64,
    "start_s": pl.Float64,
    "end_s": pl.Float64,
    "mass_kg": pl.Float64,
    "std_kg": pl.Float64,
    "common_u_kg": pl.Float64,
    "used": pl.Boolean,
    "reason": pl.String,
}
#: Reason of the readings of a log that cannot weigh, before the names of its failed checks.
CANNOT_WEIGH: Final = "this log cannot weigh"
_NOTHING: Final = "no manoeuvre of this stretch was informative enough"
_IS_ZERO: Final = "without load: the zero that payloads are counted from"
_NO_ZERO: Final = "no run of this log without load, so there is no payload as a difference"
#: Factors that are equal for every mass: slope and level of the line absorb them. The uncertainty
#: in the machine file does not say how they change.
_FACTORS: Final = tuple(scale.name for scale in SCALES if not scale.by_load)


def make_readings_of_campaign_runs(
    replayed_run: Run,
    runs: Sequence[CampaignRun],
    estimator: Estimator,
    procedure: Procedure = PRESENT_PROCEDURE,
) -> pl.DataFrame:
    """Readings of the campaign's runs in one log.

    Args:
        replayed_run: replay of that log.
        runs: the campaign's runs in it, in order.
        estimator: estimator of the mass.
        procedure: procedure of the calibration.

    Returns:
        Frame `readings`, in seconds from the log's first aligned sample; unused readings have a
        reason.
    """
    joint = estimator in JOINT_ESTIMATORS
    said = (
        make_joint_fit_readings(replayed_run, procedure)
        if joint
        else make_method_readings(replayed_run, estimator)
    )
    rows: list[dict[str, Any]] = []
    for run in runs:
        inside = [
            each for each in said if run.contains_middle_of_span(each["start_s"], each["end_s"])
        ]
        about = {
            "run_id": run.id,
            "load_id": run.load_id,
            "day": run.day.isoformat(),
            "log": run.log,
        }
        for number, each in enumerate(inside, start=1):
            row = {**about, "reading": number, **each}
            if run.excluded:
                row |= {"used": False, "reason": f"excluded: {run.excluded}"}
            rows.append(row)
        if not inside:
            why = f"excluded: {run.excluded}" if run.excluded else _NOTHING
            rows.append({**about, "reading": 1, "used": False, "reason": why})
    found = pl.DataFrame(rows, schema=READINGS, orient="row")
    return subtract_mean_empty_reading(found) if estimator == "joint_payload" else found


def make_run_changes_per_learnt_mean_u(
    replayed_run: Run, runs: Sequence[CampaignRun], estimator: Estimator
) -> tuple[RunResponse, ...]:
    """Responses of the runs in one log to errors of learnt means; empty without any.

    Args:
        replayed_run: replay of the log under learnt priors.
        runs: the campaign's runs in it, in order.
        estimator: estimator of the mass.
    """
    shared = SharedErrors.from_frames(replayed_run.frames)
    if shared is None or estimator not in JOINT_ESTIMATORS:
        return ()
    said = replayed_run.frames["manoeuvres"].to_dicts()
    moved = {
        run.id: np.mean(
            [shared.mass_responses_kg["mass", each["load_id"]] for each in inside], axis=0
        )
        for run in runs
        if not run.excluded
        and (
            inside := [
                e
                for e in said
                if run.contains_middle_of_span(e["start_t_ns"] / NS_PER_S, e["end_t_ns"] / NS_PER_S)
            ]
        )
    }
    if estimator == "joint_payload":
        zero = [moved[run.id] for run in runs if run.id in moved and run.load_id == EMPTY]
        moved = {name: each - np.mean(zero, axis=0) for name, each in moved.items() if zero}
    return tuple(
        RunResponse(run_id=name, term=term, response_kg=value)
        for name, each in moved.items()
        for term, value in zip(shared.terms, each.tolist(), strict=True)
    )


def make_joint_fit_readings(replayed_run: Run, procedure: Procedure) -> list[dict[str, Any]]:
    """Readings of the joint fit, one per manoeuvre."""
    loads = {row["load_id"]: row for row in replayed_run.frames["loads"].to_dicts()}
    factors = () if procedure.factors_in_common else _FACTORS
    absorbed = [*list_uncertainty_sources_common_within_log(replayed_run), *factors]
    own = replayed_run.frames["budget"].filter(pl.col("cause").is_in(absorbed))
    own_kg = dict(own.group_by("load_id").agg((pl.col("u_kg") ** 2).sum().sqrt()).iter_rows())
    found: list[dict[str, Any]] = []
    for row in replayed_run.frames["manoeuvres"].to_dicts():
        load = loads[row["load_id"]]
        withheld = f"{CANNOT_WEIGH}: {load['withheld_for']}" if load["withheld"] else ""
        common_kg = subtract_common_uncertainty_kg(load["u_common_kg"], own_kg.get(row["load_id"]))
        found.append(
            _make_reading_row(row, row["mass_kg"], row["mass_std_kg"], common_kg, withheld)
        )
    return found


def list_uncertainty_sources_common_within_log(replayed_run: Run) -> list[str]:
    """Uncertainty sources common to one log's masses but not to all masses of the campaign.

    Errors of learnt means are absorbed by the line. Their prior widths vary from log to log, and
    scatter the runs about the line.
    """
    nuisances = replayed_run.frames["nuisances"]
    if "prior_mean_u" not in nuisances.columns:
        return []
    learnt = nuisances.filter(pl.col("prior_mean_u") > 0.0)["term"]
    return ["learnt", *("slip" if term == "wheel_slip" else term for term in learnt)]


def subtract_common_uncertainty_kg(u_kg: float | None, part_kg: float | None) -> float | None:
    """Standard uncertainty without one of its parts."""
    if u_kg is None or not part_kg:
        return u_kg
    return float(np.sqrt(max(u_kg**2 - part_kg**2, 0.0)))


def make_method_readings(replayed_run: Run, method: str) -> list[dict[str, Any]]:
    """Reading of each manoeuvre by a method of the paper, with a statistical uncertainty only."""
    about = replayed_run.provenance
    segments = replayed_run.frames["segments"]
    if f"estimates/{method}" not in replayed_run.frames or segments.is_empty():
        return []
    t0_ns = about.t0_unix_ns
    trials = segments.select(
        start_ns=pl.col("start_t_ns") + t0_ns,
        end_ns=pl.col("end_t_ns") + t0_ns,
        load_kg=0.0,
        mass_kg=0.0,
    )
    masses = average_masses_by_method_and_run(replayed_run, trials).filter(
        pl.col("method") == method
    )["mass_kg"]
    verdict = [row for row in replayed_run.frames["loads"].to_dicts() if row["withheld"]]
    withheld = f"{CANNOT_WEIGH}: {verdict[0]['withheld_for']}" if verdict else ""
    stated = replayed_run.frames[f"estimates/{method}"].drop_nulls("mass_std_kg")
    found: list[dict[str, Any]] = []
    for row, mass_kg in zip(segments.to_dicts(), masses, strict=True):
        if mass_kg is None:
            continue  # braking, a turn, or too little in it: no start
        inside = stated.filter(pl.col("t_ns").is_between(row["start_t_ns"], row["end_t_ns"]))
        # windows overlap: together they say no more than one of them
        std_kg = inside["mass_std_kg"].mean() if inside.height else None
        found.append(_make_reading_row(row, mass_kg, std_kg, 0.0, withheld))
    return found


def _make_reading_row(
    row: dict[str, Any],
    mass_kg: float | None,
    std_kg: Any,
    common_uncertainty_kg: float | None,
    withholding_reason: str,
) -> dict[str, Any]:
    """Row of a reading; it is unused and has the reason if the mass is not finite."""
    known = mass_kg is not None and bool(np.isfinite(mass_kg))
    reason = withholding_reason or ("" if known else _NOTHING)
    return {
        "start_s": row["start_t_ns"] / NS_PER_S,
        "end_s": row["end_t_ns"] / NS_PER_S,
        "mass_kg": mass_kg if known else None,
        "std_kg": std_kg if known else None,
        "common_u_kg": common_uncertainty_kg if known else None,
        "used": not reason,
        "reason": reason,
    }


def subtract_mean_empty_reading(readings: pl.DataFrame) -> pl.DataFrame:
    """Subtract each log's mean empty reading from its masses; its error is their common_u_kg.

    Empty readings, and logs without one, are not used.
    """
    parts: list[pl.DataFrame] = []
    for log in readings.partition_by("log", maintain_order=True):
        zero = log.filter((pl.col("load_id") == EMPTY) & pl.col("used"))
        level_kg = zero["mass_kg"].mean() if zero.height else None
        spread_kg = zero["mass_kg"].std() if zero.height > 1 else None
        shared_kg = (
            float(spread_kg) / np.sqrt(zero.height)  # pyright: ignore[reportArgumentType]
            if spread_kg is not None
            else (zero["std_kg"][0] if zero.height else None)
        )
        why = pl.lit(_NO_ZERO if level_kg is None else _IS_ZERO)
        out = (pl.col("load_id") == EMPTY) | pl.lit(level_kg is None)
        parts.append(
            log.with_columns(
                mass_kg=pl.col("mass_kg") - pl.lit(level_kg, pl.Float64),
                common_u_kg=pl.when(pl.col("mass_kg").is_not_null()).then(
                    pl.lit(shared_kg, pl.Float64)
                ),
                reason=pl.when(pl.col("used") & out).then(why).otherwise("reason"),
                used=pl.col("used") & ~out,
            )
        )
    return pl.concat(parts)


def average_masses_by_method_and_run(replayed_run: Run, runs: pl.DataFrame) -> pl.DataFrame:
    """One mass per method and run; null if nothing in the run was accepted.

    Windowed methods give the mean of the windows that end in the run, weighted by 1/std²; recursive
    ones their last state in the run; `pooled` a fit of the run's samples.

    Args:
        replayed_run: a replay of the campaign's logs.
        runs: a row per run: `start_ns`, `end_ns` (Unix), `load_kg`, `mass_kg` (the reference).

    Returns:
        A row per method and run: method, run, load_kg, reference_kg, mass_kg.
    """
    t0 = replayed_run.provenance.t0_unix_ns
    rows: list[dict[str, object]] = []
    for name, frame in replayed_run.frames.items():
        stage, _, method = name.partition("/")
        if stage != "estimates":
            continue
        known = frame.drop_nulls(["mass_kg", "mass_std_kg"])
        mass_kg, weight = known["mass_kg"], 1.0 / known["mass_std_kg"] ** 2
        weighted_kg = mass_kg * weight
        unix_ns = known["t_ns"].to_numpy() + t0
        # the ends of windows ascend
        starts = np.searchsorted(unix_ns, runs["start_ns"].to_numpy()).tolist()
        ends = np.searchsorted(unix_ns, runs["end_ns"].to_numpy(), "right").tolist()
        for number, run in enumerate(runs.iter_rows(named=True)):
            start, end = starts[number], ends[number]
            if end <= start:
                mass = None
            elif METHODS[method].summary is SummaryRule.LAST:
                mass = mass_kg[end - 1]
            else:
                weights = float(weight[start:end].sum())
                mass = float(weighted_kg[start:end].sum()) / weights if weights else np.nan
            rows.append(
                {
                    "method": method,
                    "run": number,
                    "load_kg": run["load_kg"],
                    "reference_kg": run["mass_kg"],
                    "mass_kg": mass,
                }
            )
    return pl.DataFrame(
        rows,
        schema={
            "method": pl.String,
            "run": pl.Int64,
            "load_kg": pl.Float64,
            "reference_kg": pl.Float64,
            "mass_kg": pl.Float64,
        },
    )
