"""Claims of the abstract and the conclusion, compared with simulated campaigns.

Every error is given relative to the machine's mass, as in the paper, and relative to the payload
range, as is usual for scales.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

import numpy as np
import polars as pl

from analysis.calibration.campaign.method_errors import add_calibrated_mass_error_columns
from analysis.model.settings import Settings
from analysis.paper import printed_numbers
from analysis.paper.campaign_tables import OVER_WINDOWS, WINDOW
from analysis.paper.confidence_intervals import bootstrap_rms_and_interval, compute_mean_intervals
from analysis.paper.paper_limits import LIMITS
from analysis.paper.replayed_campaign import ReplayedCampaign, rerun_estimates_on_accepted_windows
from analysis.paper.simulated_sources import CAMPAIGNS, CRUISES, Extract, RepetitionResults
from analysis.paper.table1 import AT_LENGTH
from analysis.stages.gating.gate import gate_windows

#: Samples that RLS is fed: those that the gate accepts, all except braking, or all.
Fed: TypeAlias = Literal["gated", "no braking", "ungated"]
#: Samples that RLS is fed over a long cruise, and whether it forgets directionally.
CRUISE_FED: Final[tuple[tuple[Fed, bool], ...]] = (
    ("ungated", False),
    ("gated", False),
    ("gated", True),
    ("ungated", True),
)

#: Reasons to reject a window other than information or braking.
_INCOMPLETE: Final = ("warming_up", "gap")
#: Quantile of the normal distribution for a 95 % interval.
_NORMAL: Final = 1.96
_PARAMETERS: Final = 2  # mass and friction
_FLOAT_BYTES: Final = 8


def rerun_estimates_with_window_rule(
    campaign: ReplayedCampaign, window_rule: Fed, settings: Settings
) -> ReplayedCampaign:
    """Rerun the estimates of a campaign with other accepted windows.

    Args:
        campaign: replayed campaign.
        window_rule: rule that selects the windows for the estimators.
        settings: settings of gate, estimators and forgetting.
    """
    if window_rule == "ungated":
        settings = settings.copy_with_changes({"gate.exclude_braking": False})
    gated = gate_windows(campaign.replayed.frames["excitation"], settings)
    if window_rule != "gated":
        refused = _INCOMPLETE if window_rule == "ungated" else (*_INCOMPLETE, "braking")
        gated = gated.with_columns(accepted_x=~pl.col("reason_x").cast(pl.String).is_in(refused))
    return rerun_estimates_on_accepted_windows(campaign, gated, settings)


def compute_rls_errors_at_end_of_cruise_kg(campaign: ReplayedCampaign) -> tuple[float, ...]:
    """Errors of RLS at the end of the cruise of a single trial, for each of `CRUISE_FED`."""
    return tuple(
        compute_rls_error_at_end_of_cruise_kg(campaign, how, directional)
        for how, directional in CRUISE_FED
    )


def compute_rls_error_at_end_of_cruise_kg(
    campaign: ReplayedCampaign, window_rule: Fed, is_forgetting_directional: bool
) -> float:
    """Error of the last estimate of RLS in the cruise, in kg; NaN without one."""
    methods = {"trace.methods": ("rls",), "trace.directional_forgetting": is_forgetting_directional}
    again = rerun_estimates_with_window_rule(
        campaign, window_rule, campaign.settings.copy_with_changes(methods)
    )
    cruised_ns = int(campaign.trials["braking_ns"][0]) - again.replayed.provenance.t0_unix_ns
    before = again.replayed.frames["estimates/rls"].filter(pl.col("t_ns") <= cruised_ns)
    if before.is_empty():
        return float("nan")
    return float(before["mass_kg"][-1] - campaign.trials["mass_kg"][0])


def compute_errors_of_paper_claims(campaign: ReplayedCampaign) -> pl.DataFrame:
    """Errors of one campaign that the claims concern.

    Returns:
        One row per method and selection of windows (RLS also without the criterion): `method`,
        `fed`, in kg `rms_kg` and `rms_left_out_kg` of the trials' masses after (19), and
        `mean_abs_kg`, the mean absolute error with every load in the fit.
    """
    rls = campaign.settings.copy_with_changes({"trace.methods": ("rls",)})
    without: tuple[Fed, ...] = ("no braking", "ungated")
    estimates = {"gated": campaign.tabulate_masses_by_method_and_trial()} | {
        how: rerun_estimates_with_window_rule(
            campaign, how, rls
        ).tabulate_masses_by_method_and_trial()
        for how in without
    }
    return pl.concat(
        add_calibrated_mass_error_columns(masses)
        .group_by("method", maintain_order=True)
        .agg(
            pl.lit(how).alias("fed"),
            rms_kg=(pl.col("error_kg") ** 2).mean().sqrt(),
            rms_left_out_kg=(pl.col("error_left_out_kg") ** 2).mean().sqrt(),
            mean_abs_kg=pl.col("error_kg").abs().mean(),
        )
        for how, masses in estimates.items()
    )


CAMPAIGN_ERRORS: Final = Extract(CAMPAIGNS, compute_errors_of_paper_claims)
CRUISE_ERRORS: Final = Extract(CRUISES, compute_rls_errors_at_end_of_cruise_kg)
TEN_SECONDS: Final = AT_LENGTH[LIMITS.optimal_window_s]


def compute_ls_buffer_bytes(window_samples: int) -> int:
    """Size in bytes of the rows of [A f] that OLS stores in order to subtract the oldest."""
    return window_samples * (_PARAMETERS + 1) * _FLOAT_BYTES


def compute_rls_state_bytes() -> int:
    """Size in bytes of the state of RLS: θ, P, sum of squares and its weight (`rls.RlsState`)."""
    return (_PARAMETERS + _PARAMETERS**2 + 2) * _FLOAT_BYTES


@dataclass(frozen=True, eq=False)
class Claims:
    """Claims, and the result for each.

    Attributes:
        frame: a row per finding: `claim` (buffer, rms, simulation, experiment, reduction), `of`
            (what the error is of: constant, window, trial, cruise), `method`, `fed`, `directional`,
            `windows` (that gave a mass), of the claim about the buffer `window_samples` and
            `buffer_bytes`, `found_kg` with its 95 % interval, `smaller_percent` (than RLS
            without the criterion), `of_mass_percent`, `of_load_range_percent`.
        rms_limit_kg: the claimed limit of the RMS error.
        rms_held: whether it holds for every method.
        rms_kg: smallest and largest RMS error.
        constant_percent: error of a constant that ignores the data, in percent of the machine's
            mass.
        window_spread_1: share of the mass within which 95 % of single windows of 10 s lie.
        windows_claimed: number of windows whose mean has the claimed precision.
        bias_kg: mean error of LS with windows of 10 s.
        biased: whether that error is significant.
        experiment_mass_percent: smallest and largest mean absolute error of a trial, in percent of
            the machine's mass.
        experiment_range_percent: the same errors in percent of the payload range.
        reduced: whether each error is reduced as much as claimed.
        rule_that_improves_rls: measure that improves RLS in a campaign of short starts.
        buffer: OLS and RLS compared on the windows that gate both.
    """

    frame: pl.DataFrame
    rms_limit_kg: float
    rms_held: bool
    rms_kg: tuple[float, float]
    constant_percent: float
    window_spread_1: float
    windows_claimed: float
    bias_kg: float
    biased: bool
    experiment_mass_percent: tuple[float, float]
    experiment_range_percent: tuple[float, float]
    reduced: tuple[bool, ...]
    rule_that_improves_rls: Literal["nothing", "refusing braking", "the index"]
    buffer: "BufferErrors"


@dataclass(frozen=True)
class BufferErrors:
    """Errors of OLS and RLS as a function of the buffer that OLS needs.

    Attributes:
        windows: window lengths in samples.
        as_good: window lengths at which the interval of RLS includes the error of OLS.
        ls_kg: smallest and largest error of OLS.
        rls_kg: smallest and largest error of RLS.
    """

    windows: tuple[int, ...]
    as_good: tuple[int, ...]
    ls_kg: tuple[float, float]
    rls_kg: tuple[float, float]


def check_claims_by_simulation(extracts: RepetitionResults) -> Claims:
    """Compare every claim with windows, campaigns and cruises."""
    means = compute_mean_intervals(
        pl.concat(extracts.list_results_of_extract(CAMPAIGN_ERRORS), how="vertical_relaxed"),
        ["method", "fed"],
        ["rms_kg", "rms_left_out_kg", "mean_abs_kg"],
    )
    gated = means.filter(pl.col("fed") == "gated")
    windows = extracts.get_only_result(TEN_SECONDS).filter(
        pl.col("method").is_in(printed_numbers.METHODS)
    )
    buffer = _make_error_and_buffer_rows_by_window(
        pl.concat(extracts.list_results_of_extract(OVER_WINDOWS), how="vertical_relaxed")
    )
    rows = [
        *buffer,
        *(
            make_claim_row("rms", "trial", row, "rms_left_out_kg")
            for row in gated.iter_rows(named=True)
        ),
        make_claim_row("rms", "constant", {"found": printed_numbers.CONSTANT_KG}, "found"),
        *(_make_claim_row_of_window_length(row) for row in windows.iter_rows(named=True)),
        *(
            make_claim_row("experiment", "trial", row, "mean_abs_kg")
            for row in gated.iter_rows(named=True)
        ),
        *make_claim_rows_of_cruises(np.array(extracts.list_results_of_extract(CRUISE_ERRORS))),
        *_make_claim_rows_of_campaigns(means),
    ]
    frame = pl.DataFrame(rows, infer_schema_length=None).with_columns(
        of_mass_percent=pl.col("found_kg") / printed_numbers.MASS_KG * 100.0,
        of_load_range_percent=pl.col("found_kg") / printed_numbers.LOAD_RANGE_KG * 100.0,
    )
    rms = frame.filter((pl.col("claim") == "rms") & (pl.col("of") == "trial"))
    constant = frame.filter(pl.col("of") == "constant")
    experiment = frame.filter(pl.col("claim") == "experiment")
    limit_kg = printed_numbers.RMS_SHARE * printed_numbers.MASS_KG
    ls = windows.filter(pl.col("method") == "ls").row(0, named=True)
    spread_1 = _NORMAL * ls["rmse_kg"] / printed_numbers.MASS_KG
    smaller = frame["smaller_percent"].drop_nulls()
    return Claims(
        frame=frame,
        rms_limit_kg=limit_kg,
        rms_held=bool((rms["found_kg"] < limit_kg).all()),
        rms_kg=_find_min_and_max_of_column(rms["found_kg"]),
        constant_percent=constant["of_mass_percent"].item(),
        window_spread_1=spread_1,
        windows_claimed=(spread_1 / printed_numbers.SIMULATION_ERROR[1]) ** 2,
        bias_kg=ls["bias_kg"],
        biased=abs(ls["bias_kg"]) > _NORMAL * ls["bias_std_kg"],
        experiment_mass_percent=_find_min_and_max_of_column(experiment["of_mass_percent"]),
        experiment_range_percent=_find_min_and_max_of_column(experiment["of_load_range_percent"]),
        reduced=tuple(share >= 100.0 * printed_numbers.REDUCTION for share in smaller),
        rule_that_improves_rls=find_gate_rule_that_reduces_rls_error(means),
        buffer=_compare_ls_buffer_with_rls(frame.filter(pl.col("claim") == "buffer")),
    )


def _make_error_and_buffer_rows_by_window(campaigns: pl.DataFrame) -> list[dict[str, Any]]:
    """Mean errors of OLS and RLS by window length, and the bytes of memory of each."""
    means = compute_mean_intervals(
        campaigns.filter(pl.col("method").is_in(["ls", "rls"])),
        [WINDOW, "method"],
        ["run_left_out_kg"],
    )
    rows: list[dict[str, Any]] = []
    for row in means.iter_rows(named=True):
        samples = round(row[WINDOW])
        held = (
            compute_ls_buffer_bytes(samples) if row["method"] == "ls" else compute_rls_state_bytes()
        )
        of_window = {"window_samples": samples, "buffer_bytes": held}
        rows.append(make_claim_row("buffer", "trial", {**row, **of_window}, "run_left_out_kg"))
    return rows


def _compare_ls_buffer_with_rls(frame: pl.DataFrame) -> BufferErrors:
    ls, rls = (frame.filter(pl.col("method") == method) for method in ("ls", "rls"))
    beside = ls.join(rls, "window_samples", suffix="_rls", maintain_order="left")
    reaches = pl.min_horizontal("found_kg_low_rls", "found_kg_rls") <= pl.col("found_kg")
    return BufferErrors(
        windows=tuple(beside["window_samples"]),
        as_good=tuple(beside.filter(reaches)["window_samples"]),
        ls_kg=_find_min_and_max_of_column(ls["found_kg"]),
        rls_kg=_find_min_and_max_of_column(rls["found_kg"]),
    )


def make_claim_row(
    claim: str, sample_kind: str, means_row: Mapping[str, Any], value_column: str
) -> dict[str, Any]:
    """Row of a finding whose value and interval are in `means_row` under `value_column`."""
    return {
        "claim": claim,
        "of": sample_kind,
        "method": means_row.get("method"),
        "fed": means_row.get("fed"),
        "directional": means_row.get("directional", False),
        "windows": means_row.get("trials") if sample_kind == "window" else None,
        "window_samples": means_row.get("window_samples"),
        "buffer_bytes": means_row.get("buffer_bytes"),
        "found_kg": means_row[value_column],
        "found_kg_low": means_row.get(f"{value_column}_low"),
        "found_kg_high": means_row.get(f"{value_column}_high"),
        "smaller_percent": means_row.get("smaller_percent"),
    }


def _make_claim_row_of_window_length(means_row: Mapping[str, Any]) -> dict[str, Any]:
    half = _NORMAL * means_row["bias_std_kg"]
    ends = {"bias_kg_low": means_row["bias_kg"] - half, "bias_kg_high": means_row["bias_kg"] + half}
    return make_claim_row("simulation", "window", {**means_row, **ends}, "bias_kg")


def make_claim_rows_of_cruises(errors_kg: np.ndarray) -> list[dict[str, Any]]:
    """Rows of findings from errors (cruises, 4), one column for each of `CRUISE_FED`."""
    rng = np.random.default_rng(0)
    found = [bootstrap_rms_and_interval(errors, rng) for errors in errors_kg.T]
    ungated_kg = found[0][0]
    return [
        make_claim_row(
            "reduction",
            "cruise",
            {
                "method": "rls",
                "fed": how,
                "directional": directional,
                **dict(zip(("rms", "rms_low", "rms_high"), each, strict=True)),
                "smaller_percent": _compute_reduction_percent(each[0], ungated_kg)
                if number
                else None,
            },
            "rms",
        )
        for number, ((how, directional), each) in enumerate(zip(CRUISE_FED, found, strict=True))
    ]


def _make_claim_rows_of_campaigns(means: pl.DataFrame) -> list[dict[str, Any]]:
    rls = means.filter(pl.col("method") == "rls")
    ungated_kg = rls.filter(pl.col("fed") == "ungated")["rms_left_out_kg"][0]
    rows: list[dict[str, Any]] = []
    for row in rls.iter_rows(named=True):
        gated = row["fed"] != "ungated"
        smaller = _compute_reduction_percent(row["rms_left_out_kg"], ungated_kg) if gated else None
        rows.append(
            make_claim_row(
                "reduction", "trial", {**row, "smaller_percent": smaller}, "rms_left_out_kg"
            )
        )
    return rows


def _compute_reduction_percent(error_kg: float, ungated_kg: float) -> float:
    return 100.0 * (1.0 - error_kg / ungated_kg)


def find_gate_rule_that_reduces_rls_error(
    mean_errors: pl.DataFrame,
) -> Literal["nothing", "refusing braking", "the index"]:
    """Rule of the gate that reduces the error of RLS on short starts, or "nothing".

    Args:
        mean_errors: mean errors by method and by the samples that it is fed.
    """
    rls = mean_errors.filter(pl.col("method") == "rls")
    by_fed = dict(rls.select("fed", "rms_left_out_kg").iter_rows())
    if by_fed["gated"] > (1.0 - printed_numbers.REDUCTION) * by_fed["ungated"]:
        return "nothing"
    return (
        "refusing braking"
        if by_fed["no braking"] < LIMITS.alike_error_ratio * by_fed["gated"]
        else "the index"
    )


def _find_min_and_max_of_column(column: pl.Series) -> tuple[float, float]:
    low, high = column.min(), column.max()
    assert isinstance(low, float)
    assert isinstance(high, float)
    return low, high
