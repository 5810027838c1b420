"""On board: the gate and the estimators a row of `excitation` at a time, as the replay has them.

State in, state out: a step takes bounded time and memory, and from `excitation` on every decision
of the gate and every θ equals the replay's bit for bit. The deviations are their own (see
`estimators.methods.incremental`): what the replay pools over the log is not known yet. A
manoeuvre's pooled estimate comes when the manoeuvre is over and no braking can claim its last
samples any more, that of a recursion when none can claim the window that it is fed. Straight
motion and spins are gated and estimated alike, each by itself.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from analysis.model.axes import Axis, axes_of_columns, regressor_columns
from analysis.model.methods import METHODS, AxisNoise, FeedKind, Method
from analysis.model.settings import Settings
from analysis.online.gate_state import GateRow, GateState, cell_value, start_gate, step_gate
from analysis.stages.noise.column_noise import axis_noise
from estimators.arrays import Floats
from estimators.estimate import Estimate
from estimators.methods import incremental


class TimedEstimate(NamedTuple):
    """An estimate and the number of the row at which it stands."""

    row: int
    estimate: Estimate


@dataclass(frozen=True, slots=True)
class PendingSample:
    """A sample inside an accepted window that a braking which follows may still claim."""

    row: int
    segment_id: int
    sample: Floats


class SettlingWindow(NamedTuple):
    """The number of an accepted row, and the window that ends there."""

    row: int
    window: incremental.WindowState


@dataclass(frozen=True, slots=True)
class AxisState:
    """All that is kept of an axis between two rows.

    Attributes:
        settings: window, gate, methods.
        axis: straight motion or spins.
        noise: of the columns.
        window: the last `window_samples` rows and their sums.
        gate: what the gate remembers of the rows.
        pasts: of the recursive methods, by name.
        settling: accepted windows that they will be fed unless braking follows.
        fed_row: the last row that they were fed, -1 before the first.
        accepted_row: the last row whose window was accepted, -1 before the first.
        segments: manoeuvre of the last `window_samples` rows, the oldest first, -1 for none.
        standstill: whether those rows stand.
        pending: samples that will be pooled unless braking follows.
        pool: the samples pooled into the manoeuvre `pooled_id` so far, the last being `pooled_row`.
    """

    settings: Settings
    axis: Axis
    noise: AxisNoise
    window: incremental.WindowState
    gate: GateState
    pool: incremental.Pool
    segments: tuple[int, ...]
    standstill: tuple[bool, ...]
    pasts: Mapping[str, Any] = field(default_factory=dict)
    settling: tuple[SettlingWindow, ...] = ()
    fed_row: int = -1
    accepted_row: int = -1
    pending: tuple[PendingSample, ...] = ()
    pooled_id: int = -1
    pooled_row: int = -1


@dataclass(frozen=True, slots=True)
class OnlineState:
    """All that is kept between two rows.

    Attributes:
        settings: window, gate, methods.
        noise: as `start` takes it.
        axes: none before the first row, which tells which there are.
    """

    settings: Settings
    noise: pl.DataFrame | None
    axes: tuple[AxisState, ...] = ()


class AxisStep(NamedTuple):
    """Result of one row on an axis.

    Attributes:
        gate: statistics of the window that ends here, and the gate's decision.
        estimates: by method; the windowed ones at every accepted row, the recursive ones when
            that row has settled, `pooled` when a manoeuvre is over.
    """

    gate: GateRow
    estimates: Mapping[str, TimedEstimate]


class OnlineStep(NamedTuple):
    """Result of one row.

    Attributes:
        state: to step on from.
        straight: mass and friction, from straight motion.
        spin: inertia and friction of turning, from spins; None without a yaw torque, rate and
            acceleration.
    """

    state: OnlineState
    straight: AxisStep
    spin: AxisStep | None

    @property
    def gate(self) -> GateRow:
        """That of straight motion."""
        return self.straight.gate

    @property
    def estimates(self) -> Mapping[str, TimedEstimate]:
        """Estimates of straight motion."""
        return self.straight.estimates


def start(settings: Settings, noise: pl.DataFrame | None = None) -> OnlineState:
    """Before the first row.

    Args:
        settings: window, gate, methods.
        noise: what a replay of the same machine found, or half a minute of standstill; without it
            that of the settings counts where they name all of it, and else no window is refused
            for noise, `pooled` takes the regressor for exact and TLS the usual ratios.
    """
    return OnlineState(settings, noise)


def step(state: OnlineState, row: Mapping[str, Any]) -> OnlineStep:
    """Take one row of `excitation`, as `DataFrame.iter_rows(named=True)` gives it.

    Args:
        state: after the row before; it is left as it was.
        row: the regressors, the force, the phase and what the settings ask for; None is missing.
            With a yaw torque, rate and acceleration spins are estimated as well.
    """
    axes = state.axes or _start_axes(state, row)
    stepped = [_step_axis(each, row) for each in axes]
    after = OnlineState(state.settings, state.noise, tuple(each for each, _ in stepped))
    _, straight = stepped[0]
    return OnlineStep(after, straight, stepped[1][1] if len(stepped) > 1 else None)


def finish(state: OnlineState) -> Iterator[tuple[Axis, Mapping[str, TimedEstimate]]]:
    """The estimates that were still to come: what has not braked by the last row does not."""
    for axis_state in state.axes:
        for found in _finish_axis(axis_state):
            yield axis_state.axis, found


def _start_axes(state: OnlineState, row: Mapping[str, Any]) -> tuple[AxisState, ...]:
    settings = state.settings
    window = settings.gate.window_samples
    found: list[AxisState] = []
    for axis in axes_of_columns(row):
        parameters = len(regressor_columns(axis, settings)) - 1
        found.append(
            AxisState(
                settings,
                axis,
                axis_noise(axis, settings, state.noise),
                incremental.start_window(parameters, window),
                start_gate(axis, settings),
                incremental.start_pool(parameters),
                (-1,) * window,
                (False,) * window,
            )
        )
    return tuple(found)


def _step_axis(state: AxisState, row: Mapping[str, Any]) -> tuple[AxisState, AxisStep]:
    settings = state.settings
    names = regressor_columns(state.axis, settings)
    sample = np.array([cell_value(row.get(name)) for name in names])
    window = incremental.step_window(state.window, sample)
    gate_row, gate = step_gate(state.gate, window, row, settings, state.noise.mean)
    state = replace(
        state,
        window=window,
        gate=gate,
        segments=(*state.segments[1:], gate.segment_id if gate.known else -1),
        standstill=(*state.standstill[1:], row["phase"] == "standstill"),
    )
    estimates: dict[str, TimedEstimate] = {}
    if gate_row.accepted:
        state, estimates = estimate_windowed(state, gate.row)
    while state.settling and gate.row - state.settling[0].row >= gate.braking_lag - 1:
        state, fed = feed_recursive(state)
        estimates |= fed
    if any(methods_fed_by(state, FeedKind.SEGMENTS)):
        state, finished = pool_settled(state, gate.row)
        estimates |= finished
    return state, AxisStep(gate_row, estimates)


def _finish_axis(state: AxisState) -> Iterator[Mapping[str, TimedEstimate]]:
    while state.settling:
        state, fed = feed_recursive(state)
        yield fed
    for pending in state.pending:
        if _begins_next_manoeuvre(state, pending):
            yield _pooled_estimates(state)
            state = _empty_pool(state)
        state = pool_sample(state, pending)
    yield _pooled_estimates(state)


def estimate_windowed(state: AxisState, row: int) -> tuple[AxisState, dict[str, TimedEstimate]]:
    """Every windowed method on the window that ends at `row`, which was accepted."""
    settings, window = state.settings, state.window
    estimates = {
        method.name: TimedEstimate(row, method.step(window, settings.smooth.samples, options))
        for method, options in methods_fed_by(state, FeedKind.WINDOWS)
    }
    if any(methods_fed_by(state, FeedKind.SETTLED)):
        state = replace(state, settling=(*state.settling, SettlingWindow(row, window)))
    if any(methods_fed_by(state, FeedKind.SEGMENTS)):
        newest = min(row - state.accepted_row, settings.gate.window_samples)
        state = queue_for_pooling(state, row, newest)
    return replace(state, accepted_row=row), estimates


def methods_fed_by(state: AxisState, feed: FeedKind) -> Iterator[tuple[Method, Any]]:
    """The methods of the settings that are fed so, with their options."""
    for name in state.settings.trace.methods:
        method = METHODS[name]
        if method.feed is feed:
            yield method, method.options(state.settings.trace, state.noise)


def feed_recursive(state: AxisState) -> tuple[AxisState, dict[str, TimedEstimate]]:
    """Feed the recursive methods the oldest window that settles, unless it brakes by now."""
    settings, (row, window) = state.settings, state.settling[0]
    state = replace(state, settling=state.settling[1:])
    if state.gate.last_braking >= row:
        return state, {}
    newest = min(row - state.fed_row, settings.gate.window_samples)
    mean = settings.smooth.samples
    pasts = dict(state.pasts)
    estimates: dict[str, TimedEstimate] = {}
    for method, options in methods_fed_by(state, FeedKind.SETTLED):
        past = pasts.get(method.name)
        pasts[method.name], estimate = method.step(window, past, newest, mean, options)
        estimates[method.name] = TimedEstimate(row, estimate)
    return replace(state, pasts=pasts, fed_row=row), estimates


def queue_for_pooling(state: AxisState, row: int, newest: int) -> AxisState:
    """The newest samples of an accepted window will be pooled, unless they stand."""
    pending = [
        PendingSample(row + 1 - back, state.segments[-back], state.window.z[:, -back].copy())
        for back in range(newest, 0, -1)
        if not state.standstill[-back]
    ]
    return replace(state, pending=(*state.pending, *pending))


def pool_settled(state: AxisState, row: int) -> tuple[AxisState, Mapping[str, TimedEstimate]]:
    """Pool the samples that no braking can claim any more; an estimate if a manoeuvre is over."""
    waiting = list(state.pending)
    while waiting and row - waiting[0].row >= state.gate.braking_lag - 1:
        if _begins_next_manoeuvre(state, waiting[0]):
            break
        state = pool_sample(state, waiting.pop(0))
    state = replace(state, pending=tuple(waiting))
    is_awaited = any(each.segment_id == state.pooled_id for each in waiting)
    if is_manoeuvre_over(state, row) and not is_awaited:
        return _empty_pool(state), _pooled_estimates(state)
    return state, {}


def _begins_next_manoeuvre(state: AxisState, pending: PendingSample) -> bool:
    return state.pool.samples > 0 and pending.segment_id != state.pooled_id


def is_manoeuvre_over(state: AxisState, row: int) -> bool:
    """Whether no window to come can hold a sample of the manoeuvre that was not accepted yet.

    A window of spins may reach into the standstill behind a spin. Straight motion ends in what no
    window may hold, so that it is over at once.
    """
    if state.pooled_id == -1:
        return True
    window = len(state.segments)
    since = next(
        (back for back in range(window) if state.segments[-1 - back] == state.pooled_id), window
    )
    if since == 0:
        return False
    last_row = row - since
    refused = max(last for why, last in state.gate.last.items() if why != "standstill")
    return since >= window - 1 or max(refused, state.accepted_row) > last_row


def pool_sample(state: AxisState, pending: PendingSample) -> AxisState:
    """Pool a sample, unless braking has claimed it."""
    if state.gate.last_braking >= pending.row:
        return state
    return replace(
        state,
        pool=state.pool.add(pending.sample),
        pooled_id=pending.segment_id,
        pooled_row=pending.row,
    )


def _empty_pool(state: AxisState) -> AxisState:
    return replace(state, pool=incremental.start_pool(len(state.window.z) - 1), pooled_id=-1)


def _pooled_estimates(state: AxisState) -> Mapping[str, TimedEstimate]:
    if state.pool.samples == 0:
        return {}
    mean = state.settings.smooth.samples
    return {
        method.name: TimedEstimate(state.pooled_row, method.step(state.pool, mean, options))
        for method, options in methods_fed_by(state, FeedKind.SEGMENTS)
    }
