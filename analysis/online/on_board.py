"""On board: gate and estimators, one row of `excitation` at a time, as in replay.

State in, state out: a step takes bounded time and memory, and from `excitation` on every decision
of the gate and every θ equals the replay's bit for bit. Standard deviations differ (see
`estimators.methods.incremental`), since the replay pools them over a log that is not known yet. The
pooled estimate of a manoeuvre is made once it is over and later braking can no longer exclude its
last samples; that of a recursion once braking can no longer exclude the window it is fed. Straight
motion and spins are gated and estimated in the same way, but separately.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import polars as pl

from analysis.model.axes import Axis, list_axes_allowed_by_columns, list_regressor_columns
from analysis.model.methods import METHODS, AxisNoise, FeedKind, Method
from analysis.model.settings import Settings
from analysis.online.gate_state import (
    GateRow,
    GateState,
    append_rows_without_decision,
    convert_cell_to_float,
    judge_windows,
    make_initial_gate_state,
)
from analysis.stages.noise.column_noise import collect_axis_noise
from estimators.arrays import Floats
from estimators.estimate import Estimate
from estimators.methods import incremental


class TimedEstimate(NamedTuple):
    """An estimate with the number of its row."""

    row: int
    estimate: Estimate


@dataclass(frozen=True, slots=True)
class PendingSample:
    """A sample in an accepted window that later braking may still exclude."""

    row: int
    manoeuvre_id: int
    sample: Floats


class SettlingWindow(NamedTuple):
    """Number of an accepted row, and the window that ends there."""

    row: int
    window: incremental.WindowState


@dataclass(frozen=True, slots=True)
class AxisPlan:
    """Settings and methods of an axis, which all of its rows share.

    Attributes:
        settings: settings with window, gate and methods.
        axis: straight motion or spins.
        noise: noise of the columns.
        columns: columns of the regressor, and the force.
        methods: methods of the settings by their kind of feed, each with its options.
    """

    settings: Settings
    axis: Axis
    noise: AxisNoise
    columns: tuple[str, ...]
    methods: Mapping[FeedKind, Sequence[tuple[Method, Any]]]

    @classmethod
    def from_settings(cls, axis: Axis, settings: Settings, noise: pl.DataFrame | None) -> Self:
        """Look up columns, noise and options of an axis."""
        of_axis = collect_axis_noise(axis, settings, noise)
        chosen = [METHODS[name] for name in settings.trace.methods]
        optioned = [(method, method.options(settings.trace, of_axis)) for method in chosen]
        methods = {feed: [e for e in optioned if e[0].feed is feed] for feed in FeedKind}
        columns = tuple(list_regressor_columns(axis, settings))
        return cls(settings, axis, of_axis, columns, methods)


class AxisState(NamedTuple):
    """State of an axis between two rows.

    Attributes:
        plan: settings and methods of the axis.
        window: the last `window_samples` rows and their sums.
        gate: state of the gate.
        pasts: states of the recursive methods, by name.
        settling: accepted windows to feed the recursive methods unless braking follows.
        fed_row: last row fed to the recursive methods, -1 before the first.
        accepted_row: last row with an accepted window, -1 before the first.
        manoeuvre_ids: manoeuvre of the last `window_samples` rows, the oldest first, -1 for none.
        standstill: whether each of the rows of `manoeuvre_ids` is at standstill.
        pending: samples to pool unless braking follows.
        pool: samples pooled so far into the manoeuvre `pooled_id`, the last at row `pooled_row`.
    """

    plan: AxisPlan
    window: incremental.WindowState
    gate: GateState
    pool: incremental.Pool
    manoeuvre_ids: tuple[int, ...]
    standstill: tuple[bool, ...]
    pasts: Mapping[str, Any]
    settling: tuple[SettlingWindow, ...] = ()
    fed_row: int = -1
    accepted_row: int = -1
    pending: tuple[PendingSample, ...] = ()
    pooled_id: int = -1
    pooled_row: int = -1


@dataclass(frozen=True, slots=True)
class OnlineState:
    """State between two rows.

    Attributes:
        settings: settings with window, gate and methods.
        noise: frame `noise` as passed to `start`.
        axes: state of each axis; empty before the first row, which determines the axes.
    """

    settings: Settings
    noise: pl.DataFrame | None
    axes: tuple[AxisState, ...] = ()


class AxisStep(NamedTuple):
    """Result of one row on an axis.

    Attributes:
        gate: statistics and decision of the gate on the window that ends at this row.
        estimates: estimates by method: windowed ones at every accepted row, recursive ones once
            braking can no longer exclude it, `pooled` at the end of a manoeuvre.
    """

    gate: GateRow
    estimates: Mapping[str, TimedEstimate]


class OnlineStep(NamedTuple):
    """Result of one row.

    Attributes:
        state: state for the next step.
        straight: results of straight motion: mass and friction.
        spin: results of spins: inertia and turning friction; None without yaw torque, rate and
            acceleration.
    """

    state: OnlineState
    straight: AxisStep
    spin: AxisStep | None

    @property
    def gate(self) -> GateRow:
        """Gate of straight motion."""
        return self.straight.gate

    @property
    def estimates(self) -> Mapping[str, TimedEstimate]:
        """Estimates of straight motion."""
        return self.straight.estimates


def start(settings: Settings, noise: pl.DataFrame | None = None) -> OnlineState:
    """State before the first row.

    Args:
        settings: settings with window, gate and methods.
        noise: frame `noise` of a replay of the same machine, or of half a minute of standstill;
            without it the settings' noise is used if complete, otherwise no window is rejected for
            noise, `pooled` treats the regressor as exact and TLS uses the default ratios.
    """
    return OnlineState(settings, noise)


def step(state: OnlineState, row: Mapping[str, Any]) -> OnlineStep:
    """Process one row of `excitation`, as from `DataFrame.iter_rows(named=True)`.

    Args:
        state: state after the previous row; it is not changed.
        row: regressors, force, phase and columns that the settings require; None means missing.
            With yaw torque, rate and acceleration, spins are estimated as well.
    """
    return step_rows(state, [row])[0]


def step_rows(state: OnlineState, rows: Sequence[Mapping[str, Any]]) -> list[OnlineStep]:
    """Process successive rows like `step`; judging their windows together costs less.

    Args:
        state: state after the previous row; it is not changed.
        rows: one or more rows.
    """
    axes = state.axes or _make_initial_axis_states(state, rows[0])
    stepped = zip(*(_step_axis(each, rows) for each in axes), strict=True)
    return [
        OnlineStep(
            OnlineState(state.settings, state.noise, tuple(after for after, _ in by_axis)),
            by_axis[0][1],
            by_axis[1][1] if len(by_axis) > 1 else None,
        )
        for by_axis in stepped
    ]


def finish(state: OnlineState) -> Iterator[tuple[Axis, Mapping[str, TimedEstimate]]]:
    """Yield the outstanding estimates at the end of a log, when no more braking can follow."""
    for axis_state in state.axes:
        for found in _finish_axis(axis_state):
            yield axis_state.plan.axis, found


def _make_initial_axis_states(state: OnlineState, row: Mapping[str, Any]) -> tuple[AxisState, ...]:
    settings = state.settings
    window = settings.gate.window_samples
    axes = list_axes_allowed_by_columns(row)
    return tuple(
        AxisState(
            plan,
            incremental.make_empty_window(len(plan.columns) - 1, window),
            make_initial_gate_state(plan.axis, settings),
            incremental.make_empty_pool(len(plan.columns) - 1),
            (-1,) * window,
            (False,) * window,
            {},
        )
        for plan in (AxisPlan.from_settings(axis, settings, state.noise) for axis in axes)
    )


def _step_axis(
    state: AxisState, rows: Sequence[Mapping[str, Any]]
) -> list[tuple[AxisState, AxisStep]]:
    """Process some rows on one axis; the state after each row, and its result."""
    plan, window = state.plan, state.window
    windows: list[incremental.WindowState] = []
    for row in rows:
        sample = np.array([convert_cell_to_float(row.get(name)) for name in plan.columns])
        window = incremental.advance_window(window, sample)
        windows.append(window)
    gates = append_rows_without_decision(state.gate, windows, rows, plan.settings)
    stepped: list[tuple[AxisState, AxisStep]] = []
    judged = judge_windows(gates, windows, plan.settings, plan.noise.moving_mean_covariance)
    for row, window, gate, gate_row in zip(rows, windows, gates, judged, strict=True):
        state = state._replace(
            window=window,
            gate=gate,
            manoeuvre_ids=(*state.manoeuvre_ids[1:], gate.manoeuvre_id if gate.known else -1),
            standstill=(*state.standstill[1:], row["phase"] == "standstill"),
        )
        state, estimates = _estimate_at_judged_row(state, gate_row)
        stepped.append((state, AxisStep(gate_row, estimates)))
    return stepped


def _estimate_at_judged_row(
    state: AxisState, gate_row: GateRow
) -> tuple[AxisState, dict[str, TimedEstimate]]:
    """Estimates of all methods that the current row completes, and the new state."""
    gate = state.gate
    estimates: dict[str, TimedEstimate] = {}
    if gate_row.accepted:
        state, estimates = estimate_windowed_methods(state, gate.row)
    while state.settling and gate.row - state.settling[0].row >= gate.braking_lag - 1:
        state, fed = feed_recursive_methods(state)
        estimates |= fed
    if state.plan.methods[FeedKind.SEGMENTS]:
        state, finished = pool_samples_after_braking_delay(state, gate.row)
        estimates |= finished
    return state, estimates


def _finish_axis(state: AxisState) -> Iterator[Mapping[str, TimedEstimate]]:
    while state.settling:
        state, fed = feed_recursive_methods(state)
        yield fed
    for pending in state.pending:
        if _does_sample_start_next_manoeuvre(state, pending):
            yield _make_pooled_estimates(state)
            state = _start_empty_pool(state)
        state = pool_sample_unless_braking(state, pending)
    yield _make_pooled_estimates(state)


def estimate_windowed_methods(
    state: AxisState, row: int
) -> tuple[AxisState, dict[str, TimedEstimate]]:
    """Estimates of every windowed method for the accepted window that ends at `row`."""
    settings, window = state.plan.settings, state.window
    estimates = {
        method.name: TimedEstimate(row, method.step(window, settings.smooth.samples, options))
        for method, options in state.plan.methods[FeedKind.WINDOWS]
    }
    if state.plan.methods[FeedKind.SETTLED]:
        state = state._replace(settling=(*state.settling, SettlingWindow(row, window)))
    if state.plan.methods[FeedKind.SEGMENTS]:
        newest = min(row - state.accepted_row, settings.gate.window_samples)
        state = queue_moving_samples_for_pooling(state, row, newest)
    return state._replace(accepted_row=row), estimates


def feed_recursive_methods(state: AxisState) -> tuple[AxisState, dict[str, TimedEstimate]]:
    """Feed the recursive methods the oldest settling window, unless braking has followed."""
    settings, (row, window) = state.plan.settings, state.settling[0]
    state = state._replace(settling=state.settling[1:])
    if state.gate.last_braking_row >= row:
        return state, {}
    newest = min(row - state.fed_row, settings.gate.window_samples)
    mean = settings.smooth.samples
    pasts = dict(state.pasts)
    estimates: dict[str, TimedEstimate] = {}
    for method, options in state.plan.methods[FeedKind.SETTLED]:
        past = pasts.get(method.name)
        pasts[method.name], estimate = method.step(window, past, newest, mean, options)
        estimates[method.name] = TimedEstimate(row, estimate)
    return state._replace(pasts=pasts, fed_row=row), estimates


def queue_moving_samples_for_pooling(state: AxisState, row: int, new_samples: int) -> AxisState:
    """Queue the newest samples of an accepted window for pooling, unless they stand."""
    pending = [
        PendingSample(row + 1 - back, state.manoeuvre_ids[-back], state.window.z[:, -back].copy())
        for back in range(new_samples, 0, -1)
        if not state.standstill[-back]
    ]
    return state._replace(pending=(*state.pending, *pending))


def pool_samples_after_braking_delay(
    state: AxisState, row: int
) -> tuple[AxisState, Mapping[str, TimedEstimate]]:
    """Pool samples that braking can no longer exclude; at a manoeuvre's end, estimate from them."""
    waiting = list(state.pending)
    while waiting and row - waiting[0].row >= state.gate.braking_lag - 1:
        if _does_sample_start_next_manoeuvre(state, waiting[0]):
            break
        state = pool_sample_unless_braking(state, waiting.pop(0))
    state = state._replace(pending=tuple(waiting))
    is_awaited = any(each.manoeuvre_id == state.pooled_id for each in waiting)
    if is_manoeuvre_over(state, row) and not is_awaited:
        return _start_empty_pool(state), _make_pooled_estimates(state)
    return state, {}


def _does_sample_start_next_manoeuvre(state: AxisState, pending_sample: PendingSample) -> bool:
    return state.pool.samples > 0 and pending_sample.manoeuvre_id != state.pooled_id


def is_manoeuvre_over(state: AxisState, row: int) -> bool:
    """Whether no later window can add a sample of the manoeuvre.

    A window of spins may extend into the standstill after a spin. Straight motion ends in samples
    that no window may contain, so it is over immediately.
    """
    if state.pooled_id == -1:
        return True
    ids = state.manoeuvre_ids
    window = len(ids)
    since = next((back for back in range(window) if ids[-1 - back] == state.pooled_id), window)
    if since == 0:
        return False
    last_row = row - since
    refused = max(last for why, last in state.gate.last.items() if why != "standstill")
    return since >= window - 1 or max(refused, state.accepted_row) > last_row


def pool_sample_unless_braking(state: AxisState, pending_sample: PendingSample) -> AxisState:
    """Pool a sample, unless braking has excluded it."""
    if state.gate.last_braking_row >= pending_sample.row:
        return state
    return state._replace(
        pool=state.pool.add(pending_sample.sample),
        pooled_id=pending_sample.manoeuvre_id,
        pooled_row=pending_sample.row,
    )


def _start_empty_pool(state: AxisState) -> AxisState:
    return state._replace(pool=incremental.make_empty_pool(len(state.window.z) - 1), pooled_id=-1)


def _make_pooled_estimates(state: AxisState) -> Mapping[str, TimedEstimate]:
    if state.pool.samples == 0:
        return {}
    mean = state.plan.settings.smooth.samples
    return {
        method.name: TimedEstimate(state.pooled_row, method.step(state.pool, mean, options))
        for method, options in state.plan.methods[FeedKind.SEGMENTS]
    }
