"""The gate on board: its state, and its decision on the current window.

Its decisions are those of `analysis.stages.gating.gate`, by the same rules, in bounded memory: a
window contains a flagged row if the last flagged row is less than a window ago.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from analysis.model.axes import Axis, X, Z
from analysis.model.schema import PHASES
from analysis.model.settings import Settings
from analysis.stages.gating.gate import mark_slipping_samples, subtract_gravity
from analysis.stages.gating.gate_rules import (
    UNKNOWN,
    decide_window_acceptance,
    flag_rows_that_exclude_windows_by_reason,
    mark_braking_rows,
)
from analysis.stages.motion.phases import (
    TURNS,
    compute_sign_of_yaw_rate_change,
    count_rows_in_speed_rate_span,
)
from estimators.arrays import Floats, Ints
from estimators.methods.incremental import WindowState, compute_window_statistics_for_gate
from estimators.methods.ls import WindowStatistics
from estimators.numerics import nearest_neighbours

#: Row number, far in the past, of an event that has not happened yet.
_NEVER: Final = -(10**18)
_CODES: Final = {None: UNKNOWN, **{name: code for code, name in enumerate(PHASES)}}


@dataclass(frozen=True, slots=True)
class GateRow:
    """A row of `gate` on one axis; missing numbers are NaN.

    Attributes:
        corr_1: correlation of acceleration and force.
        mi_nat: the index (11).
        predicted_std: predicted standard deviation of the mass in kg, or of the inertia in kg·m².
        noise_share_1: fraction of noise in the part that only the acceleration explains.
        accepted: whether the window is accepted.
        reason: reason for a rejection, or `accepted`.
        ksg_nat: nearest-neighbour mutual information, if it decides.
    """

    corr_1: float
    mi_nat: float
    predicted_std: float
    noise_share_1: float
    accepted: bool
    reason: str
    ksg_nat: float = float("nan")

    def make_gate_columns(self, axis: Axis = X) -> dict[str, float]:
        """The numbers of the row, by their column names in the frame `gate`."""
        letter = axis.letter
        return {
            f"corr_{letter}_1": self.corr_1,
            f"mi_{letter}_nat": self.mi_nat,
            f"predicted_std_{letter}": self.predicted_std,
            f"noise_share_{letter}_1": self.noise_share_1,
            f"ksg_{letter}_nat": self.ksg_nat,
        }


class GateState(NamedTuple):
    """State of the gate.

    Attributes:
        axis: straight motion or spins.
        row: number of the current row, -1 before the first.
        first_whole: first of the uninterrupted complete rows; None before it.
        last: number of the last flagged row, by reason in order of precedence.
        accelerations: accelerations over the span of the speed rate, for slip; x axis only.
        yaw_rates: yaw rates over that span and one more row, for spins that slow down; z axis only.
        known: whether the phase of this row is known.
        kind: phase of the row if it forms a manoeuvre of its own, "" for driving; None before the
            first row.
        manoeuvre_id: number of the last manoeuvre that began.
        braking_lag: rows before braking that are not pooled; 1 if braking is accepted.
    """

    axis: Axis
    row: int
    first_whole: int | None
    last: Mapping[str, int]
    accelerations: tuple[float, ...]
    yaw_rates: tuple[float, ...]
    known: bool
    kind: str | None
    manoeuvre_id: int
    braking_lag: int

    @property
    def last_braking_row(self) -> int:
        """Number of the last braking row, if braking is excluded."""
        return self.last["braking"]


def make_initial_gate_state(axis: Axis, settings: Settings) -> GateState:
    """State before the first row."""
    nothing = np.zeros(1, np.bool_)
    reasons = flag_rows_that_exclude_windows_by_reason(
        axis, np.zeros(1, np.uint8), np.zeros(1), nothing, nothing, settings.gate
    )
    return GateState(
        axis=axis,
        row=-1,
        first_whole=None,
        last=dict.fromkeys(("gap", *reasons), _NEVER),
        accelerations=(float("nan"),) * count_rows_in_speed_rate_span(settings)
        if axis is X
        else (),
        yaw_rates=(float("nan"),) * (count_rows_in_speed_rate_span(settings) + 1)
        if axis is Z
        else (),
        known=False,
        kind=None,
        manoeuvre_id=-1,
        braking_lag=count_rows_in_speed_rate_span(settings) + settings.smooth.samples
        if settings.gate.exclude_braking
        else 1,
    )


def judge_windows(
    states: Sequence[GateState],
    windows: Sequence[WindowState],
    settings: Settings,
    noise: Floats | None,
) -> list[GateRow]:
    """Judge the windows that end at successive rows; several cost little more than one.

    Args:
        states: state after each row, by `append_rows_without_decision`.
        windows: window that ends at each row.
        settings: settings with window, thresholds and rejections.
        noise: (p + 1, p + 1) noise covariance of a row of [A f]; None if unknown.
    """
    samples = settings.gate.window_samples
    holds = {
        why: np.array([state.row - state.last[why] < samples for state in states])
        for why in states[0].last
    }
    row = np.array([state.row for state in states])
    first = np.array([np.inf if s.first_whole is None else s.first_whole for s in states])
    is_complete = (row >= samples - 1) & ~holds["gap"]
    statistics = WindowStatistics(*np.full((len(WindowStatistics._fields), row.size), np.nan))
    if is_complete.any():
        whole = [window for window, known in zip(windows, is_complete, strict=True) if known]
        for values, known in zip(
            statistics, compute_window_statistics_for_gate(whole, noise), strict=True
        ):
            values[is_complete] = known

    def estimate_window_information(numbers: Ints) -> Floats:
        return np.concatenate(
            [
                nearest_neighbours.estimate_window_mutual_information(
                    windows[k].z[0].copy(),
                    windows[k].z[-1].copy(),
                    samples,
                    np.array([samples - 1]),
                    settings.gate.ksg_neighbours,
                )
                for k in numbers
            ]
        )

    decided = decide_window_acceptance(
        states[0].axis,
        statistics,
        row < first + samples - 1,
        holds,
        estimate_window_information,
        settings.gate,
    )
    reasons = [decided.reasons[chosen] for chosen in decided.chosen.tolist()]
    missing = np.full(row.size, np.nan)
    return [
        GateRow(corr, mi_nat, predicted_std, noise_share, reason == "accepted", reason, ksg_nat)
        for corr, mi_nat, predicted_std, noise_share, reason, ksg_nat in zip(
            decided.corr.tolist(),
            decided.mi_nat.tolist(),
            decided.predicted_std.tolist(),
            decided.noise_share.tolist(),
            reasons,
            (missing if decided.ksg_nat is None else decided.ksg_nat).tolist(),
            strict=True,
        )
    ]


def append_rows_without_decision(
    state: GateState,
    windows: Sequence[WindowState],
    rows: Sequence[Mapping[str, Any]],
    settings: Settings,
) -> list[GateState]:
    """State of the gate after each of some successive rows, without a decision on its window."""
    axis, count = state.axis, len(rows)
    samples = np.array([window.z[:, -1] for window in windows])
    phase = np.array([_CODES[row["phase"]] for row in rows], np.uint8)
    missing = ~np.isfinite(samples).all(axis=1) | (phase == UNKNOWN)
    brakes = slows = mark_braking_rows(phase)
    slips = np.zeros(count, np.bool_)
    accelerations, yaw_rates = state.accelerations, state.yaw_rates
    if axis is X:
        accelerations += tuple(_compute_forward_accelerations_m_s2(rows).tolist())
        rates = _read_cells(rows, "speed_rate_x_m_s2")
        slips = mark_slipping_samples(rates, np.array(accelerations), settings)
    else:
        yaw_rates += tuple(_read_cells(rows, "yaw_rate_rad_s").tolist())
        slows = compute_sign_of_yaw_rate_change(np.array(yaw_rates), settings)[-count:] < 0
    flags = flag_rows_that_exclude_windows_by_reason(
        axis, phase, samples[:, -1], slows, slips, settings.gate
    )
    flagged = {"gap": missing.tolist(), **{why: flag.tolist() for why, flag in flags.items()}}
    span, yaw_span = len(state.accelerations), len(state.yaw_rates)
    states: list[GateState] = []
    for number, row in enumerate(rows):
        k, is_whole = state.row + 1, not flagged["gap"][number]
        state = state._replace(
            row=k,
            first_whole=k if state.first_whole is None and is_whole else state.first_whole,
            last={why: k if flagged[why][number] else last for why, last in state.last.items()},
            accelerations=accelerations[number + 1 : number + 1 + span],
            yaw_rates=yaw_rates[number + 1 : number + 1 + yaw_span],
            **_number_manoeuvre(state, row["phase"], settings, brakes=bool(brakes[number])),
        )
        states.append(state)
    return states


def _number_manoeuvre(
    state: GateState, phase: str | None, settings: Settings, *, brakes: bool
) -> dict[str, Any]:
    """Fields of the state that tell which manoeuvre the next row belongs to, by its phase."""
    if phase is None:
        return {"known": False, "kind": None}
    # manoeuvres have the same numbers on both axes
    alone = phase in TURNS or (settings.gate.exclude_braking and brakes)
    kind = phase if alone else ""
    return {
        "known": True,
        "kind": kind,
        "manoeuvre_id": state.manoeuvre_id + (kind != state.kind),
    }


def _compute_forward_accelerations_m_s2(rows: Sequence[Mapping[str, Any]]) -> Floats:
    pitch = _read_cells(rows, "pitch_rad") if "pitch_rad" in rows[0] else None
    return subtract_gravity(_read_cells(rows, "specific_force_x_m_s2"), pitch)


def _read_cells(rows: Sequence[Mapping[str, Any]], column: str) -> Floats:
    """Cells (rows,) of a column; NaN where it is missing."""
    return np.array([convert_cell_to_float(row.get(column)) for row in rows])


def convert_cell_to_float(cell: float | None) -> float:
    """Cell as a float; NaN if missing."""
    return np.nan if cell is None else float(cell)
