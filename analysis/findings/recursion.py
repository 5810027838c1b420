"""Recursions that forget: an estimate that leaves the mass where nothing tells of it."""

from typing import Final

import numpy as np

from analysis.findings.case import Case
from analysis.findings.cause import Sign
from analysis.methods import METHODS, Feed
from analysis.schema import values

#: An estimate may leave by so many times what it scatters by while the machine speeds up,
_SCATTER: Final = 3.0
#: and by this share of the mass.
_LEAVES: Final = 0.02
#: Fewer estimates of either kind tell nothing.
_FEWEST: Final = 100


def wind_up(case: Case) -> list[Sign]:
    """Estimates that forget while the machine keeps its speed (wind-up)."""
    found = [sign for name in case.estimates if (sign := _of_method(case, name)) is not None]
    return [max(found, key=lambda sign: sign.strength)] if found else []


def _of_method(case: Case, name: str) -> Sign | None:
    frame = case.estimates[name]
    trace = case.machine.settings.trace
    recursive = METHODS[name].feed is Feed.SETTLED
    if not recursive or trace.forgetting >= 1.0 or frame.is_empty():
        return None
    mass_kg = values(frame, "mass_kg")
    rows = np.searchsorted(case.evidence.excitation["t_ns"].to_numpy(), frame["t_ns"].to_numpy())
    known = np.isfinite(mass_kg)
    speeds_up, cruises = (
        known & case.evidence.is_phase(each)[rows] for each in ("accelerating", "cruising")
    )
    if min(np.count_nonzero(speeds_up), np.count_nonzero(cruises)) < _FEWEST:
        return None
    usual_kg = float(np.median(mass_kg[speeds_up]))
    scatter_kg, leaves_kg = (
        float(np.sqrt(np.mean((mass_kg[rows] - usual_kg) ** 2))) for rows in (speeds_up, cruises)
    )
    return Sign(
        leaves_kg / max(_SCATTER * scatter_kg, _LEAVES * abs(usual_kg)),
        f"{name} leaves {usual_kg:.0f} kg by {leaves_kg:.0f} kg (r.m.s.) while the machine keeps "
        f"its speed, and by {scatter_kg:.0f} kg while it speeds up: it forgets faster than it "
        f"learns (forgetting {trace.forgetting:g})",
        setting=None if trace.directional_forgetting else "settings.trace.directional_forgetting",
        value=None if trace.directional_forgetting else "true",
    )
