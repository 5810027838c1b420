"""What Figures 2 to 8 draw, as frames, with what is to be said of them."""

from typing import Final

import polars as pl

from analysis.calibration.straight_line import calibrate, run_errors
from analysis.reproduction import paper
from analysis.reproduction.campaign import Campaign
from analysis.reproduction.intervals import mean_intervals
from analysis.reproduction.item import NAMES, NO_NUMBERS, Item, listed

#: Before a run's start and after its end, so that the picture shows the gate open and close.
_MARGIN_S: Final = 0.5


def fig_5_item(campaign: Campaign) -> Item:
    """Force, acceleration, speed and index of one start and stop."""
    frames, about = campaign.replayed.frames, campaign.replayed.provenance
    run = campaign.runs.row(0, named=True)
    begin_ns = run["throttle_ns"] - 2_000_000_000 - about.t0_unix_ns
    end_ns = run["end_ns"] + round(_MARGIN_S * 1e9) - about.t0_unix_ns
    series = (
        frames["excitation"]
        .select("t_ns", "force_x_N", "regressor_acc_x_m_s2", "speed_x_m_s", "phase")
        .join(frames["gate"].select("t_ns", "mi_x_nat", "accepted_x"), on="t_ns")
        .filter(pl.col("t_ns").is_between(begin_ns, end_ns))
        .select(t_s=(pl.col("t_ns") - begin_ns) / 1e9, **{
            name: pl.col(name)
            for name in ("force_x_N", "regressor_acc_x_m_s2", "speed_x_m_s", "mi_x_nat",
                         "accepted_x", "phase")
        })
    )  # fmt: skip
    highest = {
        phase: series.filter(pl.col("phase") == phase)["mi_x_nat"].max()
        for phase in ("accelerating", "braking")
    }
    told = listed(f"{value:.1f} nat while {phase}" for phase, value in highest.items() if value)
    return Item(
        "fig5",
        "Figure 5: force, acceleration, speed and index of a start and stop",
        ("The first run of a simulated campaign, without load; the window is 320 samples.",),
        series,
        (
            f"The index reaches {told}. The paper, too, sees it large while decelerating; but "
            "braking takes another hydraulic path than the torque sensors see, so a window that "
            "contains braking is refused whatever its index.",
            NO_NUMBERS,
        ),
    )


def loads_of(campaign: Campaign) -> pl.DataFrame:
    """A row a method and load of one campaign, for Figures 6 to 8.

    Returns:
        The frame `calibration` with, r.m.s. over the load's runs in kg, `rms_kg` (every load in
        the fit) and `rms_left_out_kg`.
    """
    estimates = campaign.estimates()
    errors = run_errors(estimates).group_by("method", "load_kg").agg(
        rms_kg=(pl.col("error_kg") ** 2).mean().sqrt(),
        rms_left_out_kg=(pl.col("error_left_out_kg") ** 2).mean().sqrt(),
    )  # fmt: skip
    return calibrate(estimates).join(errors, ["method", "load_kg"], "left", maintain_order="left")


def fig_6_item(loads: pl.DataFrame) -> Item:
    """Raw masses by load, from `loads_of` of many campaigns."""
    means = mean_intervals(
        loads, ["method", "load_kg", "reference_kg"], ["estimate_kg", "estimate_std_kg"]
    )
    printed = {
        method: (alpha, beta)
        for method, alpha, beta in zip(paper.METHODS, *paper.TABLE_2.values(), strict=True)
    }
    lines = pl.DataFrame(
        {
            "method": list(printed),
            "paper_alpha_1": [alpha for alpha, _ in printed.values()],
            "paper_beta_kg": [beta for _, beta in printed.values()],
        }
    )
    table = means.join(lines, "method", "left", maintain_order="left").with_columns(
        paper_implied_kg=(pl.col("reference_kg") - pl.col("paper_beta_kg"))
        / pl.col("paper_alpha_1")
    )
    bias = (table["estimate_kg"] - table["reference_kg"]).abs().max()
    first, last = (
        table.filter((pl.col("method") == "ls") & (pl.col("load_kg") == load))["paper_implied_kg"]
        for load in (table["load_kg"].min(), table["load_kg"].max())
    )
    return Item(
        "fig6",
        "Figure 6: masses before calibration",
        (
            "Means of nine runs over the campaigns, ± the standard deviation of one run; the "
            "dashed lines are what Table 2 implies that the paper measured.",
        ),
        table.drop("paper_alpha_1", "paper_beta_kg"),
        (
            f"With an ideal torque chain raw means are within {bias:.0f} kg of the truth before "
            f"any calibration. Table 2 implies raw LS masses from {first[0]:,.0f} to "
            f"{last[0]:,.0f} kg for a machine of 3614 to 3864 kg: the paper's torque "
            "chain, not its estimators, is what its calibration corrects.",
            NO_NUMBERS,
        ),
    )


def fig_7_item(loads: pl.DataFrame) -> Item:
    """Calibrated masses by load."""
    spread = pl.col("estimate_std_kg") * pl.col("alpha_1")
    table = mean_intervals(
        loads.with_columns(calibrated_std_kg=spread),
        ["method", "load_kg", "reference_kg"],
        ["calibrated_kg", "calibrated_std_kg", "error_kg", "error_left_out_kg"],
    )
    tight = table.group_by("method", maintain_order=True).agg(pl.col("calibrated_std_kg").mean())
    runs = listed(
        f"{NAMES[method]} {std:.1f} kg" for method, std in tight.iter_rows()
    )  # fmt: skip
    return Item(
        "fig7",
        "Figure 7: masses after calibration by (19)",
        ("Means of nine runs over the campaigns, ± the standard deviation of one run.",),
        table,
        (f"One run's calibrated mass scatters by {runs}.", NO_NUMBERS),
    )


def fig_8_item(loads: pl.DataFrame) -> Item:
    """R.m.s. errors by load and method."""
    table = mean_intervals(loads, ["method", "load_kg"], ["rms_kg", "rms_left_out_kg"])
    grow = table.group_by("load_kg").agg(
        (pl.col("rms_left_out_kg") / pl.col("rms_kg")).mean().alias("ratio")
    )
    ends = grow.filter(pl.col("load_kg").is_in([grow["load_kg"].min(), grow["load_kg"].max()]))
    middle = grow.join(ends, on="load_kg", how="anti")
    return Item(
        "fig8",
        "Figure 8: error of the calibrated mass by load",
        (
            "R.m.s. over a load's nine runs, mean over the campaigns with its 95 % interval; solid "
            "bars have the load in the fit, as in the paper, hatched ones do not.",
        ),
        table,
        (
            "Leaving a load out of the fit costs most at the ends of the range: "
            f"{ends['ratio'].mean():.2f} times the in-sample error at 0 and 250 kg, "
            f"{middle['ratio'].mean():.2f} times between.",
            NO_NUMBERS,
        ),
    )
