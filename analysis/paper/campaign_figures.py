"""Figures 5 to 8: a start and stop, and the masses of campaigns by load."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import polars as pl

from analysis.calibration.campaign.by_method import fit_calibration_line_by_method
from analysis.calibration.campaign.method_errors import add_calibrated_mass_error_columns
from analysis.paper import printed_numbers
from analysis.paper.confidence_intervals import compute_mean_intervals
from analysis.paper.paper_limits import LIMITS
from analysis.paper.replayed_campaign import ReplayedCampaign
from analysis.paper.simulated_sources import CAMPAIGNS, START, Extract, RepetitionResults


@dataclass(frozen=True, eq=False)
class Figure5:
    """One start and stop, and the highest index (11) in nat of each phase that has one."""

    frame: pl.DataFrame
    highest_nat: Mapping[str, float]


def make_figure_5_gate_data(campaign: ReplayedCampaign) -> Figure5:
    """Force, acceleration, speed and index of one start and stop."""
    frames, about = campaign.replayed.frames, campaign.replayed.provenance
    trial = campaign.trials.row(0, named=True)
    start_ns = trial["throttle_ns"] - round(LIMITS.before_trial_s * 1e9) - about.t0_unix_ns
    end_ns = trial["end_ns"] + round(LIMITS.after_trial_s * 1e9) - about.t0_unix_ns
    series = (
        frames["excitation"]
        .select("t_ns", "force_x_N", "regressor_acc_x_m_s2", "speed_x_m_s", "phase")
        .join(frames["gate"].select("t_ns", "mi_x_nat", "accepted_x"), on="t_ns")
        .filter(pl.col("t_ns").is_between(start_ns, end_ns))
        .select(t_s=(pl.col("t_ns") - start_ns) / 1e9, **{
            name: pl.col(name)
            for name in ("force_x_N", "regressor_acc_x_m_s2", "speed_x_m_s", "mi_x_nat",
                         "accepted_x", "phase")
        })
    )  # fmt: skip
    highest_nat: dict[str, float] = {}
    for phase in ("accelerating", "braking"):
        highest = series.filter(pl.col("phase") == phase)["mi_x_nat"].max()
        if isinstance(highest, float) and highest:
            highest_nat[phase] = highest
    return Figure5(series, highest_nat)


def tabulate_masses_by_method_and_load(campaign: ReplayedCampaign) -> pl.DataFrame:
    """Masses and their errors by method and load of one campaign, for Figures 6 to 8.

    Returns:
        Frame `calibration`, and r.m.s. errors over the trials of each load in kg: `rms_kg` (line
        fitted to all loads) and `rms_left_out_kg` (line fitted without that load).
    """
    estimates = campaign.tabulate_masses_by_method_and_trial()
    errors = add_calibrated_mass_error_columns(estimates).group_by("method", "load_kg").agg(
        rms_kg=(pl.col("error_kg") ** 2).mean().sqrt(),
        rms_left_out_kg=(pl.col("error_left_out_kg") ** 2).mean().sqrt(),
    )  # fmt: skip
    return fit_calibration_line_by_method(estimates).join(
        errors, ["method", "load_kg"], "left", maintain_order="left"
    )


LOADS: Final = Extract(CAMPAIGNS, tabulate_masses_by_method_and_load)


def _concatenate_load_tables(extracts: RepetitionResults) -> pl.DataFrame:
    return pl.concat(extracts.list_results_of_extract(LOADS), how="vertical_relaxed")


@dataclass(frozen=True, eq=False)
class Figure6:
    """Raw masses by load.

    Attributes:
        frame: one row per method and load.
        bias_kg: largest difference between a mean and the truth.
        implied_kg: masses by LS that Table 2 implies without load and with the largest load.
    """

    frame: pl.DataFrame
    bias_kg: float
    implied_kg: tuple[float, float]


def make_figure_6_raw_mass_data(extracts: RepetitionResults) -> Figure6:
    """Average the raw masses over the campaigns."""
    means = compute_mean_intervals(
        _concatenate_load_tables(extracts),
        ["method", "load_kg", "reference_kg"],
        ["estimate_kg", "estimate_std_kg"],
    )
    alphas, betas = printed_numbers.TABLE_2.values()
    lines = pl.DataFrame(
        {"method": printed_numbers.METHODS, "paper_alpha_1": alphas, "paper_beta_kg": betas}
    )
    table = means.join(lines, "method", "left", maintain_order="left").with_columns(
        paper_implied_kg=(pl.col("reference_kg") - pl.col("paper_beta_kg"))
        / pl.col("paper_alpha_1")
    )
    bias_kg = (table["estimate_kg"] - table["reference_kg"]).abs().max()
    assert isinstance(bias_kg, float)
    of_ls = table.filter(pl.col("method") == "ls").sort("load_kg")["paper_implied_kg"]
    return Figure6(
        frame=table.drop("paper_alpha_1", "paper_beta_kg"),
        bias_kg=bias_kg,
        implied_kg=(of_ls[0], of_ls[-1]),
    )


@dataclass(frozen=True, eq=False)
class Figure7:
    """Calibrated masses by load, and scatter of one trial in kg by method."""

    frame: pl.DataFrame
    scatter_kg: Mapping[str, float]


def make_figure_7_calibrated_mass_data(extracts: RepetitionResults) -> Figure7:
    """Average the calibrated masses over the campaigns."""
    spread = pl.col("estimate_std_kg") * pl.col("alpha_1")
    table = compute_mean_intervals(
        _concatenate_load_tables(extracts).with_columns(calibrated_std_kg=spread),
        ["method", "load_kg", "reference_kg"],
        ["calibrated_kg", "calibrated_std_kg", "error_kg", "error_left_out_kg"],
    )
    scatter = table.group_by("method", maintain_order=True).agg(pl.col("calibrated_std_kg").mean())
    return Figure7(table, dict(scatter.iter_rows()))


@dataclass(frozen=True, eq=False)
class Figure8:
    """Errors by load, and the ratio of the error without the load in the fit to that with it.

    `ends_1` is the mean ratio for the smallest and largest load, `middle_1` for the other loads.
    """

    frame: pl.DataFrame
    ends_1: float
    middle_1: float


def make_figure_8_error_data(extracts: RepetitionResults) -> Figure8:
    """Average the r.m.s. errors by load and method over the campaigns."""
    table = compute_mean_intervals(
        _concatenate_load_tables(extracts), ["method", "load_kg"], ["rms_kg", "rms_left_out_kg"]
    )
    ratios = table.group_by("load_kg", maintain_order=True).agg(
        (pl.col("rms_left_out_kg") / pl.col("rms_kg")).mean().alias("ratio")
    )
    ends = pl.col("load_kg").is_in([ratios["load_kg"].min(), ratios["load_kg"].max()])
    return Figure8(
        frame=table,
        ends_1=ratios.filter(ends).select(pl.col("ratio").mean()).item(),
        middle_1=ratios.filter(~ends).select(pl.col("ratio").mean()).item(),
    )


FIGURE_5: Final = Extract(START, make_figure_5_gate_data)
