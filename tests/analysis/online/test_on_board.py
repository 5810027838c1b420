"""On board and in replay: the same decisions, and the same θ bit for bit."""

import copy

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from analysis.model.axes import X, Z, read_parameters_and_stds, select_estimate_rows_of_axis
from analysis.model.methods import METHODS
from analysis.model.settings import Settings
from analysis.online import on_board as online
from analysis.stages.estimation.method_estimates import trace_estimates
from analysis.stages.gating.gate import gate_windows
from analysis.stages.gating.segments import assign_pooled_manoeuvre_numbers_to_samples
from analysis.stages.noise.channel_noise import estimate_channel_noise
from tests.analysis import plane_drives as plane
from tests.analysis.noisy_logs import noisy_log
from tests.analysis.settings_by_name import settings_of
from tests.twins import mark_heavy_after

EVERY = tuple(METHODS)
MANOEUVRES = ("standstill", "start", "cruise", "brake")


def on_board(excitation, settings, noise=None, rows_at_once=7):
    """By axis every step of the gate, and the estimates by method as (row, θ)."""
    state = online.start(settings, noise)
    stepped = {axis.letter: ([], {name: [] for name in settings.trace.methods}) for axis in (X, Z)}
    steps = []
    for part in excitation.iter_slices(rows_at_once):
        steps += online.step_rows(state, part.rows(named=True))
        state = steps[-1].state
    for step in steps:
        for axis, seen in ((X, step.straight), (Z, step.spin)):
            if seen is None:
                continue
            rows_of_gate, found = stepped[axis.letter]
            rows_of_gate.append(seen.gate)
            for method, (at, estimate) in seen.estimates.items():
                found[method].append((at, estimate))
    for axis, late in online.finish(state):
        for method, (at, estimate) in late.items():
            stepped[axis.letter][1][method].append((at, estimate))
    return stepped


def assert_as_in_replay(excitation, settings, noise=None, axis=X):
    gated = gate_windows(excitation, settings, noise)
    frames = trace_estimates(excitation, gated, settings, noise)
    stepped = on_board(excitation, settings, noise)
    return gated, assert_axis_as_in_replay(excitation, gated, frames, stepped, axis)


def assert_axis_as_in_replay(excitation, gated, frames, stepped, axis):
    """Assert it of one axis; its estimates on board."""
    rows_of_gate, found = stepped[axis.letter]
    assert [m.reason for m in rows_of_gate] == gated[f"reason_{axis.letter}"].to_list()
    for name in rows_of_gate[0].make_gate_columns(axis):
        if name in gated.columns:
            expected = gated[name].fill_null(np.nan).to_numpy()
            mine = [m.make_gate_columns(axis)[name] for m in rows_of_gate]
            np.testing.assert_array_equal(mine, expected)
    times = excitation["t_ns"].to_numpy()
    for method, rows in found.items():
        frame = select_estimate_rows_of_axis(axis, frames[method])
        assert [times[at] for at, _ in rows] == frame["t_ns"].to_list(), method
        expected, _ = read_parameters_and_stds(axis, frame)
        theta = np.array([e.theta for _, e in rows]).reshape(expected.shape)
        np.testing.assert_array_equal(theta, expected, err_msg=method)
    return found


def holes_in(excitation, holes):
    """Rows without a force, or without any speed and so without a phase."""
    k = pl.int_range(pl.len())
    for at, length, column in holes:
        inside = k.is_between(at, at + length)
        names = ("force_x_N",) if column else ("speed_x_m_s", "speed_rate_x_m_s2", "phase")
        excitation = excitation.with_columns(
            pl.when(inside).then(None).otherwise(pl.col(name)).alias(name) for name in names
        )
    return excitation


@st.composite
def logs(draw):
    """A drive of any manoeuvres, with holes."""
    stages = draw(
        st.lists(
            st.tuples(st.sampled_from(MANOEUVRES), st.floats(0.3, 4.0)), min_size=2, max_size=6
        )
    )
    names, seconds = zip(*stages, strict=True)
    total = round(sum(seconds) * 100)
    holes = st.tuples(st.integers(0, total), st.integers(0, 30), st.booleans())
    drive = {
        "manoeuvres": names,
        "seconds": seconds,
        "direction": draw(st.sampled_from([1.0, -1.0])),
        "noise": draw(st.sampled_from([1.0, 0.1, 10.0])),
        "seed": draw(st.integers(0, 2**31)),
    }
    return drive, draw(st.lists(holes, max_size=2))


@st.composite
def choices(draw):
    """Settings that decide what is fed, and how."""
    chosen = {
        "window_samples": draw(st.sampled_from([16, 60, 110])),
        "threshold_nat": draw(st.sampled_from([0.1, 0.7])),
        "exclude_braking": draw(st.booleans()),
        "forgetting": draw(st.sampled_from([0.998, 0.9, 1.0])),
        "directional_forgetting": draw(st.booleans()),
        "index": draw(st.sampled_from(["information", "gaussian", "variance"])),
        "slip_acc_m_s2": draw(st.sampled_from([None, 0.5])),
        "saturation_force_N": draw(st.sampled_from([None, 5500.0])),
    }
    return settings_of(**chosen, methods=EVERY)


def examples(number):
    return hypothesis_settings(
        deadline=None,
        max_examples=number,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )


@pytest.fixture(scope="module")
def noise():
    """The noise of a log with a derived acceleration: it refuses some windows."""
    log = noisy_log("derived acceleration", 8)
    return estimate_channel_noise(log.aligned, log.excitation, log.machine)


@pytest.mark.heavy
@given(log=logs(), settings=choices(), known=st.booleans())
@examples(5)
def test_every_decision_and_every_estimate_equals_the_replays(
    drive, excitation_of, noise, log, settings, known
):
    made, holes = log
    excitation = holes_in(excitation_of(drive(**made)), holes)
    assert_as_in_replay(excitation, settings, noise if known else None)


@pytest.mark.heavy
@pytest.mark.parametrize("coulomb", mark_heavy_after(1, [False, True]))
def test_noise_of_the_log_refuses_and_corrects_on_board_as_in_replay(
    drive, excitation_of, noise, coulomb
):
    settings = settings_of(coulomb=coulomb, methods=EVERY)
    made = drive(("standstill", "start", "brake", "standstill"), (3.5, 5.0, 2.0, 1.5))
    gated, found = assert_as_in_replay(excitation_of(made), settings, noise)
    reasons = set(gated["reason_x"].cast(pl.String))
    assert "noise_limited" in reasons
    if coulomb:
        # beside a third column no window is better than its noise
        return
    _, blind = on_board(excitation_of(made), settings)[X.letter]
    for method in ("pooled", "tls"):
        assert found[method][-1][1].theta[0] != blind[method][-1][1].theta[0]


@pytest.mark.slow
@given(log=logs(), settings=choices(), known=st.booleans())
@examples(40)
def test_every_decision_and_every_estimate_of_many_logs_equals_the_replays(
    drive, excitation_of, noise, log, settings, known
):
    made, holes = log
    excitation = holes_in(excitation_of(drive(**made)), holes)
    assert_as_in_replay(excitation, settings, noise if known else None)


@pytest.fixture(scope="module")
def two_starts(drive, excitation_of):
    trip = ("standstill", "start", "brake", "standstill")
    return excitation_of(drive(trip * 2, (1.5, 5.0, 2.0, 1.5) * 2))


@pytest.mark.heavy
def test_the_papers_window_accepts_and_pools_as_in_replay(two_starts):
    settings = Settings(trace={"methods": EVERY})
    gated, found = assert_as_in_replay(two_starts, settings)
    assert gated["accepted_x"].sum() > 100
    assert len(found["pooled"]) == 2


@pytest.mark.heavy
def test_a_log_that_ends_in_braking_pools_nothing_that_braking_may_claim(two_starts):
    settings = Settings(trace={"methods": EVERY}, gate={"window_samples": 60})
    braking = np.flatnonzero((two_starts["phase"] == "braking").fill_null(False).to_numpy())
    _, found = assert_as_in_replay(two_starts[: int(braking[0]) + 3], settings)
    assert found["pooled"][-1][0] == braking[0] - 20


@pytest.mark.heavy
def test_with_a_coulomb_column(drive, excitation_of, machine):
    trip = ("standstill", "start", "brake", "standstill", "start")
    coulomb = machine({"coulomb": True, "methods": EVERY, "window_samples": 200})
    excitation = excitation_of(drive(trip, (1.5, 4.0, 2.0, 1.5, 3.0)), coulomb)
    gated, _ = assert_as_in_replay(excitation, coulomb.settings)
    assert gated["accepted_x"].any()


def test_with_the_gate_of_nearest_neighbours(two_starts):
    settings = Settings(gate={"index": "ksg", "window_samples": 100}, trace={"methods": ("ls",)})
    gated, _ = assert_as_in_replay(two_starts[:700], settings)
    assert gated["ksg_x_nat"].is_not_null().any()


@pytest.mark.heavy
def test_a_log_without_an_accelerometer_or_any_row(two_starts):
    settings = Settings(trace={"methods": EVERY})
    assert_as_in_replay(two_starts.drop("specific_force_x_m_s2"), settings)
    assert list(online.finish(online.start(settings))) == []


@pytest.mark.heavy
def test_a_pooled_estimate_comes_when_braking_can_claim_no_sample_of_it(two_starts):
    """Braking is seen at once, so the manoeuvre that it ends is over then."""
    settings = Settings(trace={"methods": ("pooled",)})
    numbers = assign_pooled_manoeuvre_numbers_to_samples(
        two_starts, gate_windows(two_starts, settings), settings
    )
    state, came = online.start(settings), {}
    for k, row in enumerate(two_starts.iter_rows(named=True)):
        step = online.step(state, row)
        state = step.state
        for standing in step.estimates.values():
            came[k] = standing.row
    braking = np.flatnonzero((two_starts["phase"] == "braking").fill_null(False).to_numpy())
    for at, (k, last) in enumerate(came.items()):
        assert last == np.flatnonzero(numbers == np.unique(numbers[numbers >= 0])[at])[-1]
        begins = braking[braking > last][0]
        assert begins <= k <= begins + 20


@pytest.mark.heavy
def test_a_step_leaves_the_state_that_it_was_given(two_starts):
    settings = Settings(trace={"methods": EVERY}, gate={"window_samples": 60})
    state = online.start(settings)
    rows = list(two_starts[:400].iter_rows(named=True))
    for row in rows[:300]:
        state = online.step(state, row).state
    before = copy.deepcopy(state)
    first = online.step(state, rows[300])
    again = online.step(state, rows[300])
    assert repr(before) == repr(state)
    assert repr(first) == repr(again)


@pytest.mark.heavy
def test_the_deviations_are_those_of_a_moving_mean_over_white_noise(drive, excitation_of):
    """Their own, but of the size of the replay's."""
    settings = Settings(trace={"methods": tuple(METHODS)})
    excitation = excitation_of(drive(seconds=(1.5, 6.0, 2.0, 1.5)))
    gated = gate_windows(excitation, settings)
    frames = trace_estimates(excitation, gated, settings)
    _, found = on_board(excitation, settings)[X.letter]
    for method, rows in found.items():
        mine = np.array([e.std for _, e in rows])[:, 0]
        ratio = np.median(mine / frames[method]["mass_std_kg"].to_numpy())
        assert 0.5 < ratio < 2.0, method


@st.composite
def drives_in_the_plane(draw):
    """Spins to both sides, starts, arcs and joint motion in any order, with holes."""
    kinds = {
        "spin": lambda sign: plane.braked(plane.spin(sign, seconds=3.0)),
        "start": lambda sign: plane.braked(plane.start(sign, seconds=3.0)),
        "arc": lambda sign: plane.arc(1.2, 0.5 * sign, seconds=2.0),
        "joint": lambda _: [plane.joint(4.0), plane.hold(1.0)],
    }
    one = st.tuples(st.sampled_from(sorted(kinds)), st.sampled_from([1.0, -1.0]))
    chosen = [("spin", 1.0), *draw(st.lists(one, min_size=1, max_size=3))]
    said = plane.sensors([part for kind, sign in chosen for part in kinds[kind](sign)])
    rows = st.tuples(st.integers(0, said.height), st.integers(0, 30), st.booleans())
    return said, draw(st.lists(rows, max_size=1))


@pytest.fixture(scope="module")
def yaw_noise():
    return plane.replayed(plane.sensors(plane.spins()))["noise"]


def assert_both_axes_as_in_replay(log, settings, noise):
    said, holes = log
    excitation = holes_in(plane.excitation(said), holes)
    gated = gate_windows(excitation, settings, noise)
    frames = trace_estimates(excitation, gated, settings, noise)
    stepped = on_board(excitation, settings, noise)
    for axis in (X, Z):
        assert_axis_as_in_replay(excitation, gated, frames, stepped, axis)


@pytest.mark.heavy
@given(log=drives_in_the_plane(), settings=choices(), known=st.booleans())
@examples(2)
def test_spins_and_straight_motion_of_one_drive_equal_the_replays(yaw_noise, log, settings, known):
    assert_both_axes_as_in_replay(log, settings, yaw_noise if known else None)


@pytest.mark.slow
@given(log=drives_in_the_plane(), settings=choices(), known=st.booleans())
@examples(24)
def test_spins_and_straight_motion_of_many_drives_equal_the_replays(
    yaw_noise, log, settings, known
):
    assert_both_axes_as_in_replay(log, settings, yaw_noise if known else None)


@pytest.mark.heavy
def test_spins_give_the_inertia_on_board(yaw_noise):
    excitation = plane.excitation(plane.sensors(plane.spins()))
    settings = Settings(trace={"methods": EVERY})
    gated, found = assert_as_in_replay(excitation, settings, yaw_noise, Z)
    assert gated["accepted_z"].sum() > 100
    inertia = [estimate.theta[0] for _, estimate in found["pooled"]]
    assert len(inertia) == 4
    np.testing.assert_allclose(inertia, plane.LOADER[1], rtol=0.03)


@pytest.mark.heavy
def test_a_spin_that_slows_down_is_pooled_only_where_braking_is_welcome(yaw_noise):
    excitation = plane.excitation(plane.sensors(plane.spins()))
    samples = {}
    for welcome in (False, True):
        settings = settings_of(exclude_braking=not welcome, methods=("pooled",))
        gated, _ = assert_as_in_replay(excitation, settings, yaw_noise, Z)
        samples[welcome] = gated["accepted_z"].sum()
    assert samples[True] > samples[False] > 0
