"""Recursions that forget: an estimate that leaves the mass where nothing tells of it."""

from typing import Final

import numpy as np

from analysis.diagnosis.evidence import Floats
from analysis.findings.case import Case
from analysis.findings.cause import Sign
from analysis.methods import METHODS, Feed
from analysis.schema import values
from analysis.weighing.loads import changes

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
    # a recursion begins anew with each load
    load = np.searchsorted(changes(case.evidence.weighing), rows, "right")
    worst = 0.0, 0.0, 0.0, 0.0
    for number in np.unique(load):
        up, steady = (mass_kg[each & (load == number)] for each in (speeds_up, cruises))
        if min(up.size, steady.size) < _FEWEST:
            continue
        usual_kg = float(np.median(up))
        scatter_kg, leaves_kg = (_rms(each - usual_kg) for each in (up, steady))
        strength = leaves_kg / max(_SCATTER * scatter_kg, _LEAVES * abs(usual_kg))
        worst = max(worst, (strength, usual_kg, scatter_kg, leaves_kg))
    strength, usual_kg, scatter_kg, leaves_kg = worst
    mends = name == "rls" and not trace.directional_forgetting  # no other one can
    return Sign(
        strength,
        f"{name} leaves {usual_kg:.0f} kg by {leaves_kg:.0f} kg (r.m.s.) while the machine keeps "
        f"its speed, and by {scatter_kg:.0f} kg while it speeds up: it forgets faster than it "
        f"learns (forgetting {trace.forgetting:g})",
        setting="settings.trace.directional_forgetting" if mends else None,
        value="true" if mends else None,
    )


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2)))
