"""What simulated campaigns say of the claims in the abstract and the conclusion."""

from typing import Final

import polars as pl

from analysis.calibration.straight_line import run_errors
from analysis.gate import gate
from analysis.reproduction.campaign import Campaign, accepting
from analysis.settings import Settings

#: What recursive least squares is fed: what the gate accepts, all but braking, everything.
FED: Final = ("gated", "no braking", "ungated")
#: The claim's constant speed: so long a cruise follows the start.
CRUISE_S: Final = 90.0

#: Reasons to refuse a window that have nothing to do with information or braking.
_INCOMPLETE: Final = ("warming_up", "gap")


def fed(campaign: Campaign, how: str, settings: Settings) -> Campaign:
    """The campaign with the windows accepted that `how` (of `FED`) says.

    Args:
        campaign: replayed.
        how: what the estimators are fed.
        settings: the gate, which estimators, and how they forget.
    """
    if how == "ungated":
        settings = settings.changed({"gate.exclude_braking": False})
    gated = gate(campaign.replayed.frames["excitation"], settings)
    if how != "gated":
        refused = _INCOMPLETE if how == "ungated" else (*_INCOMPLETE, "braking")
        gated = gated.with_columns(accepted_x=~pl.col("reason_x").cast(pl.String).is_in(refused))
    return accepting(campaign, gated, settings)


def cruise_error_kg(campaign: Campaign, how: str, *, directional: bool = False) -> float:
    """The error of RLS at the end of the cruise of a campaign of one run; NaN without estimate."""
    methods = {"trace.methods": ("rls",), "trace.directional_forgetting": directional}
    again = fed(campaign, how, campaign.settings.changed(methods))
    cruised_ns = int(campaign.runs["braking_ns"][0]) - again.replayed.provenance.t0_unix_ns
    before = again.replayed.frames["estimates/rls"].filter(pl.col("t_ns") <= cruised_ns)
    if before.is_empty():
        return float("nan")
    return float(before["mass_kg"][-1] - campaign.runs["mass_kg"][0])


def campaign_claims(campaign: Campaign) -> pl.DataFrame:
    """What one campaign says of the claims.

    Returns:
        A row a method and what it was fed (RLS also without the criterion): `method`, `fed`, in kg
        `rms_kg` and `rms_left_out_kg` of the runs' masses after (19), and `mean_abs_kg`, the mean
        size of their error with every load in the fit.
    """
    rls = campaign.settings.changed({"trace.methods": ("rls",)})
    estimates = {"gated": campaign.estimates()} | {
        how: fed(campaign, how, rls).estimates() for how in FED[1:]
    }
    return pl.concat(
        run_errors(masses)
        .group_by("method", maintain_order=True)
        .agg(
            pl.lit(how).alias("fed"),
            rms_kg=(pl.col("error_kg") ** 2).mean().sqrt(),
            rms_left_out_kg=(pl.col("error_left_out_kg") ** 2).mean().sqrt(),
            mean_abs_kg=pl.col("error_kg").abs().mean(),
        )
        for how, masses in estimates.items()
    )
