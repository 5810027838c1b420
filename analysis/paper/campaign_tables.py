"""Tables 2 to 4 from simulated campaigns, with the printed values."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import polars as pl

from analysis.calibration.campaign.by_method import fit_calibration_line_by_method
from analysis.paper import printed_numbers
from analysis.paper.confidence_intervals import compute_mean_intervals, find_keys_of_lowest_error
from analysis.paper.replayed_campaign import (
    ERRORS,
    ReplayedCampaign,
    compute_calibrated_mass_errors,
    compute_cramer_rao_bound_of_trial_kg,
    rerun_gate_and_estimates,
)
from analysis.paper.simulated_sources import (
    CAMPAIGNS,
    CHAINED_CAMPAIGNS,
    Extract,
    RepetitionResults,
)
from analysis.paper.torque_chain import TorqueChain

#: Methods whose smallest and largest errors are compared; FGLS behaves like LS.
_COMPARED: Final = ("ls", "rls", "tls", "pooled")


class MeanCalibrationLine(NamedTuple):
    """Calibration line (19): slope with its 95 % interval, and offset."""

    alpha_1: float
    alpha_1_low: float
    alpha_1_high: float
    beta_kg: float


@dataclass(frozen=True, eq=False)
class Table2:
    """Table 2, and its calibration lines of LS.

    Attributes:
        frame: one row per `chain` ("ideal" or "front_axle") and `method`.
        chain: torque chain "front_axle".
        printed: slope and offset (kg) of LS in the paper.
        ideal: line of LS with an ideal torque chain.
        chained: line of LS with the assumed torque chain.
        offset_share_1: printed offset over the mean reference mass.
    """

    frame: pl.DataFrame
    chain: TorqueChain
    printed: tuple[float, float]
    ideal: MeanCalibrationLine
    chained: MeanCalibrationLine
    offset_share_1: float


def fit_calibration_lines(campaign: ReplayedCampaign, torque_chain_name: str) -> pl.DataFrame:
    """Fit (19) to a campaign; one row per method with `chain`, `alpha_1`, `beta_kg`."""
    return (
        fit_calibration_line_by_method(campaign.tabulate_masses_by_method_and_trial())
        .group_by("method", maintain_order=True)
        .agg(pl.lit(torque_chain_name).alias("chain"), pl.col("alpha_1", "beta_kg").first())
    )


IDEAL_LINES: Final = Extract(CAMPAIGNS, partial(fit_calibration_lines, torque_chain_name="ideal"))
CHAINED_LINES: Final = Extract(
    CHAINED_CAMPAIGNS, partial(fit_calibration_lines, torque_chain_name="front_axle")
)


def make_table_2_calibration_lines(extracts: RepetitionResults) -> Table2:
    """Mean slope and offset of the calibration line by chain and method, over the campaigns."""
    lines = pl.concat(
        [
            *extracts.list_results_of_extract(IDEAL_LINES),
            *extracts.list_results_of_extract(CHAINED_LINES),
        ],
        how="vertical_relaxed",
    )
    means = compute_mean_intervals(lines, ["chain", "method"], ["alpha_1", "beta_kg"])
    printed = pl.DataFrame({"method": printed_numbers.METHODS, **printed_numbers.TABLE_2}).rename(
        {"alpha_1": "paper_alpha_1", "beta_kg": "paper_beta_kg"}
    )
    table = means.join(printed, "method", "left", maintain_order="left")
    of_ls = {
        row["chain"]: MeanCalibrationLine(*(row[name] for name in MeanCalibrationLine._fields))
        for row in table.filter(pl.col("method") == "ls").iter_rows(named=True)
    }
    alpha_1, beta_kg = (
        printed_numbers.pair_table_values_with_methods(row)["ls"]
        for row in printed_numbers.TABLE_2.values()
    )
    return Table2(
        frame=table,
        chain=TorqueChain(),
        printed=(alpha_1, beta_kg),
        ideal=of_ls["ideal"],
        chained=of_ls["front_axle"],
        offset_share_1=beta_kg / (printed_numbers.MASS_KG + printed_numbers.LOAD_RANGE_KG / 2.0),
    )


class ErrorExtremes(NamedTuple):
    """Smallest and largest error of a method over a setting, each load left out of its fit.

    `alike` are the values of the setting whose error is within the interval of the smallest one.
    """

    method: str
    best: float
    best_kg: float
    worst: float
    worst_kg: float
    alike: tuple[float, ...]
    values: int


@dataclass(frozen=True, eq=False)
class SweptTable:
    """Table 3 or 4: errors as a function of one setting.

    Attributes:
        frame: one row per value and method.
        best_printed: setting values with the smallest printed error, ties included, by method.
        extremes: extremes of our errors by method.
        nearest_bound_1: by method (`pooled`, `rls`), the smallest ratio of error to bound.
        best_kg: smallest of all errors with the own load left out.
    """

    frame: pl.DataFrame
    best_printed: Mapping[str, Sequence[float]]
    extremes: tuple[ErrorExtremes, ...]
    nearest_bound_1: Mapping[str, float]
    best_kg: float


def compute_errors_by_setting(
    campaign: ReplayedCampaign, setting: str, values: Collection[float]
) -> pl.DataFrame:
    """Errors with gate and estimators rerun for each value of a setting, one row per value."""
    frames: list[pl.DataFrame] = []
    for value in values:
        again = rerun_gate_and_estimates(
            campaign, campaign.settings.copy_with_changes({f"gate.{setting}": value})
        )
        frames.append(
            compute_calibrated_mass_errors(again).with_columns(
                pl.lit(float(value)).alias(setting),
                bound_kg=pl.lit(compute_cramer_rao_bound_of_trial_kg(again)),
            )
        )
    return pl.concat(frames)


THRESHOLD: Final = "threshold_nat"
WINDOW: Final = "window_samples"
OVER_THRESHOLDS: Final = Extract(
    CAMPAIGNS,
    partial(compute_errors_by_setting, setting=THRESHOLD, values=tuple(printed_numbers.TABLE_3_KG)),
)
OVER_WINDOWS: Final = Extract(
    CAMPAIGNS,
    partial(
        compute_errors_by_setting,
        setting=WINDOW,
        values=tuple(map(round, printed_numbers.TABLE_4_KG)),
    ),
)


def make_table_3_errors_by_threshold(extracts: RepetitionResults) -> SweptTable:
    """Average the errors by threshold over the campaigns."""
    return _make_error_table_by_setting(
        extracts.list_results_of_extract(OVER_THRESHOLDS), THRESHOLD, printed_numbers.TABLE_3_KG
    )


def make_table_4_errors_by_window(extracts: RepetitionResults) -> SweptTable:
    """Average the errors by window length over the campaigns."""
    return _make_error_table_by_setting(
        extracts.list_results_of_extract(OVER_WINDOWS), WINDOW, printed_numbers.TABLE_4_KG
    )


def _make_error_table_by_setting(
    campaigns: Sequence[pl.DataFrame], setting: str, printed_values: Mapping[float, Sequence[float]]
) -> SweptTable:
    table = _average_errors_by_setting(
        pl.concat(campaigns, how="vertical_relaxed"), setting, printed_values
    )
    best_kg = table["run_left_out_kg"].min()
    assert isinstance(best_kg, float)
    return SweptTable(
        frame=table,
        best_printed={
            method: find_keys_of_lowest_error({at: row[i] for at, row in printed_values.items()})
            for i, method in enumerate(printed_numbers.METHODS)
        },
        extremes=tuple(
            find_best_and_worst_setting(str(method), setting, part)
            for (method,), part in table.group_by("method", maintain_order=True)
            if method in _COMPARED
        ),
        nearest_bound_1={
            method: table.filter(pl.col("method") == method)
            .select(pl.col("over_bound_1").min())
            .item()
            for method in ("pooled", "rls")
        },
        best_kg=best_kg,
    )


def _average_errors_by_setting(
    campaigns: pl.DataFrame, setting: str, printed_values: Mapping[float, Sequence[float]]
) -> pl.DataFrame:
    means = compute_mean_intervals(campaigns, [setting, "method"], [*ERRORS, "bound_kg", "runs"])
    known = pl.DataFrame(
        [
            {setting: at, "method": method, "paper_kg": error}
            for at, row in printed_values.items()
            for method, error in printed_numbers.pair_table_values_with_methods(row).items()
        ]
    )
    return (
        means.with_columns(pl.col(setting).cast(pl.Float64))
        .join(known, [setting, "method"], "left", maintain_order="left")
        .with_columns(
            over_bound_1=pl.col("run_kg") / pl.col("bound_kg"),
            of_load_range_1=pl.col("run_left_out_kg") / printed_numbers.LOAD_RANGE_KG,
        )
    )


def find_best_and_worst_setting(
    method: str, setting: str, selected_rows: pl.DataFrame
) -> ErrorExtremes:
    """Find the values of a setting with the smallest and the largest error of a method."""
    known = dict(selected_rows.select(setting, "run_left_out_kg").drop_nulls().iter_rows())
    (best, *_), worst = find_keys_of_lowest_error(known), max(known, key=lambda at: known[at])
    high = selected_rows.filter(pl.col(setting) == best)["run_left_out_kg_high"][0]
    alike = tuple(at for at, error in known.items() if high is not None and error <= high)
    return ErrorExtremes(method, best, known[best], worst, known[worst], alike, len(known))
