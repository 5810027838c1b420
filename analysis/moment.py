"""The gate on board: what it remembers of the rows so far, and what it says of the window now.

The same decisions in the same order as `analysis.gate`, in bounded memory:
a window holds a flagged row when the last one flagged is less than a window ago.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.constants import g as standard_gravity

from analysis.phases import TURNS, beside_speed_rate, span_rows
from analysis.settings import Settings
from estimators import neighbours
from estimators.incremental import WindowState, window_statistics
from estimators.information import information_index
from estimators.ls import WindowStatistics

_NEVER = -(10**18)
#: Statistics of a window that misses samples.
_INCOMPLETE = WindowStatistics(*np.array([[np.nan], [np.nan], [np.nan], [np.inf]]))


@dataclass(frozen=True, slots=True)
class Moment:
    """A row of `gate`; a number that is missing is NaN."""

    corr_x_1: float
    mi_x_nat: float
    predicted_std_x: float
    accepted: bool
    reason: str
    ksg_x_nat: float = float("nan")


@dataclass(frozen=True, slots=True)
class Watch:
    """What the gate remembers.

    Attributes:
        row: number of the row now, -1 before the first.
        first_whole: number of the first row that misses nothing, None before it.
        last: number of the last row that each refusal was about, by its reason.
        accelerations: of the machine over the span of the speed rate, for slip.
        known: whether the phase of this row is known.
        kind: what the manoeuvre of this row stands alone for, "" for driving, None for no row.
        segment_id: number of the last manoeuvre that began.
        braking_lag: rows before braking that are not pooled; 1 where braking is welcome.
    """

    row: int
    first_whole: int | None
    last: Mapping[str, int]
    accelerations: tuple[float, ...]
    known: bool
    kind: str | None
    segment_id: int
    braking_lag: int

    @property
    def last_braking(self) -> int:
        """Number of the last row that braked, where braking is excluded."""
        return self.last["braking"]


def start_watch(settings: Settings) -> Watch:
    """Before the first row."""
    refusals = ("gap", "saturated", "turning", "braking", "moving", "slip")
    return Watch(
        row=-1,
        first_whole=None,
        last=dict.fromkeys(refusals, _NEVER),
        accelerations=(float("nan"),) * span_rows(settings),
        known=False,
        kind=None,
        segment_id=-1,
        braking_lag=span_rows(settings) + settings.smooth.samples
        if settings.gate.exclude_braking
        else 1,
    )


def watch(
    before: Watch, window: WindowState, row: Mapping[str, Any], settings: Settings
) -> tuple[Moment, Watch]:
    """Judge the window that ends at this row.

    Args:
        before: what was remembered of the rows before.
        window: the window, this row in it.
        row: a row of `excitation`.
        settings: window, threshold, what is refused.
    """
    now = _remember(before, window, row, settings)
    samples = settings.gate.window_samples
    holds = {name: now.row - last < samples for name, last in now.last.items()}
    complete = now.row >= samples - 1 and not holds["gap"]
    statistics = window_statistics(window) if complete else _INCOMPLETE
    rho, spread, predicted_std, condition = (float(each[0]) for each in statistics)
    index = float(information_index(np.array([rho]))[0])
    refusals = {
        "warming_up": now.first_whole is None or now.row < now.first_whole + samples - 1,
        "gap": holds["gap"],
        "saturated": holds["saturated"],
        "turning": holds["turning"],
        "braking": holds["braking"],
        "standstill": not holds["moving"],
        "slip": holds["slip"],
        "no_variance": np.isnan(rho),
        "negative_dependence": rho < 0,
    }
    ksg = float("nan")
    match settings.gate.index:
        case "information":
            poor = index < settings.gate.threshold_nat
        case "variance":
            poor = not predicted_std <= settings.gate.threshold_std_kg
        case "ksg":
            if not any(refusals.values()):
                ksg = _nearest(window, settings)
            poor = not ksg >= settings.gate.threshold_nat
    refusals["low_information"] = poor
    refusals["ill_conditioned"] = not condition <= settings.gate.condition_max
    reason = next((name for name, holds_now in refusals.items() if holds_now), "accepted")
    return (
        Moment(
            rho if complete and spread > 0 else float("nan"),
            index,
            predicted_std,
            reason == "accepted",
            reason,
            ksg,
        ),
        now,
    )


def _remember(
    before: Watch, window: WindowState, row: Mapping[str, Any], settings: Settings
) -> Watch:
    """What is remembered with this row."""
    k, phase = before.row + 1, row["phase"]
    sample = window.z[:, -1]
    known = phase is not None
    missing = not (np.isfinite(sample).all() and known)
    accelerations = (*before.accelerations[1:], _machine_acceleration(row))
    limit = settings.gate.saturation_force_N
    flags = {
        "gap": missing,
        # a mean of clipped samples is the limit but for rounding
        "saturated": limit is not None and bool(abs(sample[-1]) >= limit * (1.0 - 1e-9)),
        "turning": phase in TURNS,
        "braking": settings.gate.exclude_braking and phase == "braking",
        "moving": phase != "standstill",
        "slip": _slips(row, accelerations, settings),
    }
    kind = None
    if known:
        kind = phase if phase in TURNS or flags["braking"] else ""
    return replace(
        before,
        row=k,
        first_whole=k if before.first_whole is None and not missing else before.first_whole,
        last={name: k if flags[name] else last for name, last in before.last.items()},
        accelerations=accelerations,
        known=known,
        kind=kind,
        segment_id=before.segment_id + (known and kind != before.kind),
    )


def _machine_acceleration(row: Mapping[str, Any]) -> float:
    """The accelerometer without gravity, where the pitch is known."""
    measured = row.get("specific_force_x_m_s2")
    value = np.nan if measured is None else float(measured)
    if "pitch_rad" in row:
        pitch = np.nan if row["pitch_rad"] is None else float(row["pitch_rad"])
        value -= standard_gravity * np.sin(pitch)
    return value


def _slips(row: Mapping[str, Any], accelerations: tuple[float, ...], settings: Settings) -> bool:
    if settings.gate.slip_acc_m_s2 is None or row["speed_rate_x_m_s2"] is None:
        return False
    mean = beside_speed_rate(np.array(accelerations), settings)[-1]
    return bool(abs(row["speed_rate_x_m_s2"] - mean) > settings.gate.slip_acc_m_s2)


def _nearest(window: WindowState, settings: Settings) -> float:
    """The mutual information of the window by nearest neighbours."""
    end = np.array([settings.gate.window_samples - 1])
    found = neighbours.window_mutual_information(
        window.z[0].copy(),
        window.z[-1].copy(),
        settings.gate.window_samples,
        end,
        settings.gate.ksg_neighbours,
    )
    return float(found[0])
