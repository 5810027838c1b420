"""Write labels and sentences on the claims of the paper's abstract and conclusion."""

from collections.abc import Mapping
from typing import Any, Final

import polars as pl

from analysis.paper import printed_numbers
from analysis.paper.claims import Claims, compute_ls_buffer_bytes, compute_rls_state_bytes
from analysis.paper.paper_limits import LIMITS as PAPER_LIMITS
from recordings.paper.paper_wording import NAMES, ItemSentences, format_percent

_CLAIMS: Final = {
    "buffer": "RLS as accurate as OLS without a large buffer",
    "rms": "RMS error below 1 % of the machine's mass",
    "simulation": "error in simulation",
    "experiment": "error in the experiments",
    "reduction": "smaller than RLS without the criterion",
}
_DIRECTIONAL: Final = {
    "gated": "gated, forgetting directionally",
    "ungated": "ungated but forgetting directionally",
}
_SHORT_STARTS: Final = {
    "nothing": "In a campaign of short starts and stops the gate has little to save RLS from.",
    "refusing braking": (
        "In a campaign, refusing only the windows that contain braking helps as much as the gate."
    ),
    "the index": "In a campaign it is the index that helps, not refusing windows with braking.",
}


def add_claim_texts(claims: Claims) -> pl.DataFrame:
    """Add claim, case and printed number as text to the numbers found."""
    rows = list(claims.frame.iter_rows(named=True))
    words = pl.DataFrame(
        {
            "claim": [_CLAIMS[row["claim"]] for row in rows],
            "case": [_describe_case_of_claim(row) for row in rows],
            "paper": [_format_printed_number(row) for row in rows],
        }
    )
    numbers = ("buffer_bytes", "found_kg", "found_kg_low", "found_kg_high", "smaller_percent")
    shares = ("of_mass_percent", "of_load_range_percent")
    return pl.concat([words, claims.frame.select(*numbers, *shares)], how="horizontal")


def _describe_case_of_claim(claim_row: Mapping[str, Any]) -> str:
    """Describe the case that a number belongs to."""
    if claim_row["of"] == "constant":
        return "a constant that ignores the data"
    name = NAMES[claim_row["method"]]
    if claim_row["claim"] == "buffer":
        return (
            f"{name}, {claim_row['window_samples']} samples in the gate's window, keeps "
            f"{claim_row['buffer_bytes']:,} B; single runs, own load left out of (19)"
        )
    if claim_row["claim"] == "rms":
        return f"{name}, single runs, own load left out of (19)"
    if claim_row["claim"] == "simulation":
        return (
            f"{name}, mean of {claim_row['windows']} windows of {PAPER_LIMITS.optimal_window_s:g} s"
        )
    if claim_row["claim"] == "experiment":
        return f"{name}, mean size of a run's error after (19)"
    if claim_row["of"] == "cruise":
        how = _DIRECTIONAL[claim_row["fed"]] if claim_row["directional"] else claim_row["fed"]
        return f"{name} {how}, RMS error after {PAPER_LIMITS.cruise_s:g} s of cruise"
    return f"{name} {claim_row['fed']}, single runs of campaigns, own load left out of (19)"


def _format_printed_number(claim_row: Mapping[str, Any]) -> str:
    """Format the number printed in the paper; a dash if it gives none."""
    if claim_row["claim"] == "buffer":
        return "–"
    if claim_row["claim"] == "rms":
        return (
            "–"
            if claim_row["of"] == "constant"
            else f"< {format_percent(printed_numbers.RMS_SHARE)}"
        )
    if claim_row["claim"] == "reduction":
        ungated = claim_row["smaller_percent"] is None
        return "–" if ungated else f"≥ {format_percent(printed_numbers.REDUCTION)} smaller"
    simulated = claim_row["claim"] == "simulation"
    printed = printed_numbers.SIMULATION_ERROR if simulated else printed_numbers.EXPERIMENT_ERROR
    mean, spread = (100.0 * share for share in printed)
    return f"{mean:g} ± {spread:g} %"


def make_claim_sentences(claims: Claims) -> ItemSentences:
    """Make the sentences on choices and on the result of each claim."""
    return ItemSentences(
        (
            "Campaigns as in Tables 3 and 4, at 320 samples and 0.7 nat. The paper does not say "
            "whether its averages are of errors or of their sizes, nor what its ± covers.",
            "For the claim on the buffer, RLS runs on across changes of the load, as on board. For "
            "the others it starts again at each change, as in a replay, from the first window of "
            "that load alone, and so is worse.",
            "RLS without the criterion is fed every sample, or every sample but braking; the "
            f"claim's constant speed is a cruise of {PAPER_LIMITS.cruise_s:g} s after a start of "
            "3 s.",
        ),
        (
            _make_memory_claim_sentences(claims),
            _make_rms_claim_sentences(claims),
            _make_simulation_claim_sentences(claims),
            _make_experiment_claim_sentences(claims),
            _make_error_reduction_claim_sentences(claims),
        ),
    )


def _make_memory_claim_sentences(claims: Claims) -> str:
    buffer, of_ls, of_rls = claims.buffer, claims.buffer.ls_kg, claims.buffer.rls_kg
    windows = len(buffer.windows)
    sentence = (
        f"RLS keeps {compute_rls_state_bytes()} B where OLS keeps the window, "
        f"{compute_ls_buffer_bytes(min(buffer.windows)):,} to "
        f"{compute_ls_buffer_bytes(max(buffer.windows)):,} B. "
        f"Single runs are {of_rls[0]:.1f} to {of_rls[1]:.1f} kg off with RLS and {of_ls[0]:.1f} to "
        f"{of_ls[1]:.1f} kg with OLS; "
    )
    if len(buffer.as_good) == windows:
        held = "at every window RLS is as accurate as OLS within its interval"
    elif buffer.as_good:
        held = (
            f"at {len(buffer.as_good)} of {windows} windows RLS is as accurate as OLS within its "
            "interval"
        )
    else:
        held = f"at none of {windows} windows is RLS as accurate as OLS"
    return (
        f"{sentence}{held}. The buffer is not saved, though: the index (11) is of the same window, "
        "and whatever gates RLS by it keeps those rows. How long a step takes: docs/on-board.md."
    )


def _make_rms_claim_sentences(claims: Claims) -> str:
    low, high = claims.rms_kg
    holds = "holds in simulation for every method"
    return (
        f"Below 1 % of the machine's mass ({claims.rms_limit_kg:.0f} kg) "
        f"{holds if claims.rms_held else 'does not hold for every method'} "
        f"({low:.1f} to {high:.1f} kg). It says little: a constant that ignores the data is at "
        f"{claims.constant_percent:.1f} %, and 1 % of the machine is "
        f"{format_percent(claims.rms_limit_kg / printed_numbers.LOAD_RANGE_KG)} of the payload "
        "range."
    )


def _make_simulation_claim_sentences(claims: Claims) -> str:
    mean, spread = printed_numbers.SIMULATION_ERROR
    return (
        f"{format_percent(mean, 4)} ± {format_percent(spread, 2)} in simulation: a single window "
        "of "
        f"{PAPER_LIMITS.optimal_window_s:g} s is within "
        f"± {format_percent(claims.window_spread_1, 2)} at the noise that comes "
        f"nearest to Table 1, whose own 11.66 kg are 0.32 %. ± {format_percent(spread, 2)} is "
        "what the "
        f"mean of some {claims.windows_claimed:.0f} such windows has. The mean of ours is "
        f"{format_percent(claims.bias_kg / printed_numbers.MASS_KG, 4)}, "
        + (
            "which is more than chance: noise in the regressors biases LS."
            if claims.biased
            else "which so many windows cannot tell from zero."
        )
    )


def _make_experiment_claim_sentences(claims: Claims) -> str:
    mean, spread = printed_numbers.EXPERIMENT_ERROR
    of_mass, of_range = claims.experiment_mass_percent, claims.experiment_range_percent
    return (
        f"{format_percent(mean, 2)} ± {format_percent(spread, 2)} in the experiments is "
        f"{mean * printed_numbers.MASS_KG:.1f} ± {spread * printed_numbers.MASS_KG:.1f} kg: "
        "of the machine's mass a "
        f"simulated campaign has {of_mass[0]:.2f} to {of_mass[1]:.2f} %, which is "
        f"{of_range[0]:.1f} to {of_range[1]:.1f} % of the payload range. The printed number is "
        "of the loads that (19) was fitted on, and relative to a mass that was known beforehand."
    )


def _make_error_reduction_claim_sentences(claims: Claims) -> str:
    rows = claims.frame.filter(pl.col("claim") == "reduction").iter_rows(named=True)
    each = [
        f"{_describe_case_of_claim(row)}, {row['found_kg']:,.1f} kg"
        f"{_format_error_reduction(row['smaller_percent'])}"
        for row in rows
    ]
    held = claims.reduced
    verdict = "holds throughout" if all(held) else "depends on the drive" if any(held) else "fails"
    return (
        f"At least {format_percent(printed_numbers.REDUCTION)} smaller than RLS without the "
        "criterion "
        f"{verdict}: "
        f"{'; '.join(each)}. Over a long cruise the gate saves RLS from forgetting while nothing "
        "happens, which directional forgetting does without a gate. "
        f"{_SHORT_STARTS[claims.rule_that_improves_rls]}"
    )


def _format_error_reduction(smaller_percent: float | None) -> str:
    """Format the reduction of an error in percent; empty if unknown."""
    if smaller_percent is None:
        return ""
    word = "smaller" if smaller_percent >= 0.0 else "larger"
    return f" ({abs(smaller_percent):.1f} % {word})"
