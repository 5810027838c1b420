"""The claims of the abstract and of the conclusion, each as we find it.

Every number is given as a share of the machine's mass, as the paper does, and of the payload range,
which is what a scale is judged by.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.reproduction import paper
from analysis.reproduction.claims import CRUISE_S, FED
from analysis.reproduction.intervals import mean_intervals, rms_interval
from analysis.reproduction.item import NAMES, Item, percent

#: The window that the text calls optimal in simulation.
WINDOW_S: Final = 10.0
_NORMAL: Final = 1.96
#: Errors that differ by no more are called alike.
_ALIKE: Final = 1.2
_RMS, _SIMULATION, _EXPERIMENT, _REDUCTION = (
    "RMS error below 1 % of the machine's mass",
    "error in simulation",
    "error in the experiments",
    "smaller than RLS without the criterion",
)


def claims_item(
    table_1: pl.DataFrame, campaigns: pl.DataFrame, cruises: Mapping[str, Sequence[float]]
) -> Item:
    """All claims with what is to be said of them.

    Args:
        table_1: `table1.table_1` with its 10 s rows.
        campaigns: `claims.campaign_claims` of many campaigns.
        cruises: errors of RLS in kg at the end of a long cruise, by how it was fed; "gated" and
            "ungated" among them.
    """
    means = mean_intervals(
        campaigns, ["method", "fed"], ["rms_kg", "rms_left_out_kg", "mean_abs_kg"]
    )
    gated = means.filter(pl.col("fed") == "gated")
    rows = [
        *_rms_rows(gated),
        *_simulation_rows(table_1),
        *_experiment_rows(gated),
        *_cruise_rows(cruises),
        *_campaign_rows(means),
    ]
    frame = pl.DataFrame(rows, infer_schema_length=None).with_columns(
        of_mass_percent=pl.col("found_kg") / paper.MASS_KG * 100.0,
        of_load_range_percent=pl.col("found_kg") / paper.LOAD_RANGE_KG * 100.0,
    )
    return Item(
        "claims",
        "The claims of the abstract and of the conclusion",
        (
            "Campaigns as in Tables 3 and 4, at 320 samples and 0.7 nat. The paper does not say "
            "whether its averages are of errors or of their sizes, nor what its ± covers.",
            "RLS without the criterion is fed every sample, or every sample but braking; the "
            f"claim's constant speed is a cruise of {CRUISE_S:g} s after a start of 3 s.",
        ),
        frame,
        (
            _rms_says(frame),
            _simulation_says(table_1),
            _experiment_says(frame),
            _reduction_says(frame),
        ),
    )


def _row(
    claim: str, case: str, printed: str, found: tuple[float, float | None, float | None]
) -> dict[str, Any]:
    names = ("found_kg", "found_kg_low", "found_kg_high")
    return {"claim": claim, "case": case, "paper": printed} | dict(zip(names, found, strict=True))


def _interval(row: Mapping[str, Any], name: str) -> tuple[float, float | None, float | None]:
    return row[name], row[f"{name}_low"], row[f"{name}_high"]


def _rms_rows(gated: pl.DataFrame) -> list[dict[str, Any]]:
    rows = [
        _row(
            _RMS,
            f"{NAMES[row['method']]}, single runs, own load left out of (19)",
            f"< {percent(paper.RMS_SHARE)}",
            _interval(row, "rms_left_out_kg"),
        )
        for row in gated.iter_rows(named=True)
    ]
    return [
        *rows,
        _row(_RMS, "a constant that ignores the data", "–", (paper.CONSTANT_KG, None, None)),
    ]


def _simulation_rows(table_1: pl.DataFrame) -> list[dict[str, Any]]:
    mean, spread = (100.0 * share for share in paper.SIMULATION_ERROR)
    rows: list[dict[str, Any]] = []
    for row in _ten_seconds(table_1).iter_rows(named=True):
        half = _NORMAL * row["bias_std_kg"]
        found = (row["bias_kg"], row["bias_kg"] - half, row["bias_kg"] + half)
        case = f"{NAMES[row['method']]}, mean of {row['trials']} windows of {WINDOW_S:g} s"
        rows.append(_row(_SIMULATION, case, f"{mean:g} ± {spread:g} %", found))
    return rows


def _experiment_rows(gated: pl.DataFrame) -> list[dict[str, Any]]:
    mean, spread = (100.0 * share for share in paper.EXPERIMENT_ERROR)
    return [
        _row(
            _EXPERIMENT,
            f"{NAMES[row['method']]}, mean size of a run's error after (19)",
            f"{mean:g} ± {spread:g} %",
            _interval(row, "mean_abs_kg"),
        )
        for row in gated.iter_rows(named=True)
    ]


def _cruise_rows(cruises: Mapping[str, Sequence[float]]) -> list[dict[str, Any]]:
    rng = np.random.default_rng(0)
    found = {how: rms_interval(np.array(errors), rng) for how, errors in cruises.items()}
    return [
        _row(
            _REDUCTION,
            f"RLS {how}, RMS error after {CRUISE_S:g} s of cruise",
            "–" if how == "ungated" else f"≥ {percent(paper.REDUCTION)} smaller",
            each,
        )
        | {"smaller_percent": _smaller(each[0], found["ungated"][0], how)}
        for how, each in found.items()
    ]


def _campaign_rows(means: pl.DataFrame) -> list[dict[str, Any]]:
    rls = means.filter(pl.col("method") == "rls")
    ungated_kg = rls.filter(pl.col("fed") == "ungated")["rms_left_out_kg"][0]
    return [
        _row(
            _REDUCTION,
            f"RLS {row['fed']}, single runs of campaigns, own load left out of (19)",
            "–" if row["fed"] == "ungated" else f"≥ {percent(paper.REDUCTION)} smaller",
            _interval(row, "rms_left_out_kg"),
        )
        | {"smaller_percent": _smaller(row["rms_left_out_kg"], ungated_kg, row["fed"])}
        for row in rls.iter_rows(named=True)
    ]


def _smaller(error_kg: float, ungated_kg: float, how: str) -> float | None:
    return None if how == "ungated" else 100.0 * (1.0 - error_kg / ungated_kg)


def _ten_seconds(table_1: pl.DataFrame) -> pl.DataFrame:
    wanted = (pl.col("window_s") == WINDOW_S) & pl.col("method").is_in(paper.METHODS)
    return table_1.filter(wanted)


def _rms_says(frame: pl.DataFrame) -> str:
    rows = frame.filter(pl.col("claim") == _RMS)
    ours, constant = rows[:-1], rows.row(-1, named=True)
    limit_kg = paper.RMS_SHARE * paper.MASS_KG
    held = bool((ours["found_kg"] < limit_kg).all())
    low, high = ours["found_kg"].min(), ours["found_kg"].max()
    return (
        f"Below 1 % of the machine's mass ({limit_kg:.0f} kg) "
        f"{'holds in simulation for every method' if held else 'does not hold for every method'} "
        f"({low:.1f} to {high:.1f} kg). It says little: a constant that ignores the data is at "
        f"{constant['of_mass_percent']:.1f} %, and 1 % of the machine is "
        f"{percent(limit_kg / paper.LOAD_RANGE_KG)} of the payload range."
    )


def _simulation_says(table_1: pl.DataFrame) -> str:
    row = _ten_seconds(table_1).filter(pl.col("method") == "ls").row(0, named=True)
    single = _NORMAL * row["rmse_kg"] / paper.MASS_KG
    mean, spread = paper.SIMULATION_ERROR
    windows = (single / spread) ** 2
    sure = abs(row["bias_kg"]) > _NORMAL * row["bias_std_kg"]
    return (
        f"{percent(mean, 4)} ± {percent(spread, 2)} in simulation: a single window of "
        f"{WINDOW_S:g} s is within ± {percent(single, 2)} at the noise that comes nearest to "
        f"Table 1, whose own 11.66 kg are 0.32 %. ± {percent(spread, 2)} is what the mean of some "
        f"{windows:.0f} such windows has. The mean of ours is "
        f"{percent(row['bias_kg'] / paper.MASS_KG, 4)}, "
        + (
            "more than chance: noise in its regressors biases LS."
            if sure
            else "which so many windows cannot tell from zero."
        )
    )


def _experiment_says(frame: pl.DataFrame) -> str:
    rows = frame.filter(pl.col("claim") == _EXPERIMENT)
    mean, spread = paper.EXPERIMENT_ERROR
    shares = rows["of_mass_percent"]
    ranges = rows["of_load_range_percent"]
    return (
        f"{percent(mean, 2)} ± {percent(spread, 2)} in the experiments is "
        f"{mean * paper.MASS_KG:.1f} ± {spread * paper.MASS_KG:.1f} kg: of the machine's mass a "
        f"simulated campaign has {shares.min():.2f} to {shares.max():.2f} %, which is "
        f"{ranges.min():.1f} to {ranges.max():.1f} % of the payload range. The printed number is "
        "of the loads that (19) was fitted on, and relative to a mass that was known beforehand."
    )


def _reduction_says(frame: pl.DataFrame) -> str:
    rows = frame.filter(pl.col("claim") == _REDUCTION).iter_rows(named=True)
    told = [
        f"{row['case']}, {row['found_kg']:,.1f} kg{_than_ungated(row['smaller_percent'])}"
        for row in rows
    ]
    held = [share >= 100.0 * paper.REDUCTION for share in frame["smaller_percent"].drop_nulls()]
    verdict = "holds throughout" if all(held) else "depends on the drive" if any(held) else "fails"
    return (
        f"At least {percent(paper.REDUCTION)} smaller than RLS without the criterion {verdict}: "
        f"{'; '.join(told)}. Over a long cruise the gate saves RLS from forgetting while nothing "
        f"happens, which directional forgetting does without a gate. {_short_starts(frame)}"
    )


def _short_starts(frame: pl.DataFrame) -> str:
    """What the gate does for RLS in a campaign, by the numbers."""
    campaigns = frame.filter(pl.col("case").str.contains("single runs of campaigns, own"))
    gated, no_braking, ungated = (
        campaigns.filter(pl.col("case").str.starts_with(f"RLS {how},"))["found_kg"][0]
        for how in FED
    )
    if gated > (1.0 - paper.REDUCTION) * ungated:
        return "In a campaign of short starts and stops there is little to be saved from."
    if no_braking < _ALIKE * gated:
        return "In a campaign refusing what brakes does as much as the whole gate."
    return "In a campaign it is the index that does it, not the refusal of what brakes."


def _than_ungated(smaller_percent: float | None) -> str:
    if smaller_percent is None:
        return ""
    word = "smaller" if smaller_percent >= 0.0 else "larger"
    return f" ({abs(smaller_percent):.1f} % {word})"
