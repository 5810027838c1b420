"""Grid, window and moving mean follow the log's slowest channel, where no setting is given."""

import numpy as np
import polars as pl
import pytest

from analysis.stages.estimation.method_estimates import explain_why_gate_accepted_nothing
from analysis.stages.signals import filters
from analysis.stages.signals.grid_rate import choose_grid_rate_by_log
from tests.analysis.conftest import make_machine

CHANNELS = ("force_x_N", "speed_x_m_s", "specific_force_x_m_s2")


def channels(seconds=60.0, **rates_hz):
    """Channels at 100 Hz, or at another rate by name."""
    read = {}
    for name in CHANNELS:
        rate_hz = rates_hz.get(name, 100.0)
        t_ns = np.round(np.arange(seconds * rate_hz) * 1e9 / rate_hz).astype(np.int64)
        read[name] = t_ns, np.sin(t_ns / 1e9)
    return read


def all_at(rate_hz, seconds=60.0):
    return channels(seconds, **dict.fromkeys(CHANNELS, rate_hz))


def chosen(read, settings=None):
    """The settings that come out, and the notes."""
    machine = make_machine()
    if settings:
        changed = machine.settings.copy_with_changes(settings)
        machine = machine.model_copy(update={"settings": changed})
    found, notes = choose_grid_rate_by_log(read, machine)
    kept = found.settings
    return (kept.align.rate_hz, kept.gate.window_samples, kept.smooth.samples), notes


@pytest.mark.parametrize("rate_hz", [80.0, 100.0, 200.0, 1000.0])
def test_a_log_of_about_the_papers_rate_or_faster_has_the_papers_values(rate_hz):
    assert chosen(all_at(rate_hz)) == ((100.0, 320, 10), [])


@pytest.mark.parametrize(
    ("rate_hz", "expected"),
    [(50.0, (50.0, 160, 5)), (20.0, (20.0, 64, 2)), (10.0, (10.0, 32, 1))],
)
def test_the_samples_of_a_slower_log_stand_for_the_same_times(rate_hz, expected):
    found, notes = chosen(all_at(rate_hz))
    assert found == expected
    assert f"comes at {rate_hz:g} Hz" in notes[0]
    assert f"a window is {expected[1]} samples" in notes[0]


@pytest.mark.parametrize(("rate_hz", "window_s"), [(5.0, 4.0), (1.0, 20.0)])
def test_a_window_holds_twenty_readings(rate_hz, window_s):
    (grid_hz, window, _), _ = chosen(all_at(rate_hz, 600.0))
    assert window == 20
    assert window / grid_hz == window_s


def test_the_slowest_channel_of_the_regressor_counts():
    assert chosen(channels(speed_x_m_s=20.0))[0] == (20.0, 64, 2)


def test_what_is_set_is_taken_as_given():
    given = {"align.rate_hz": 100.0, "gate.window_samples": 50, "smooth.samples": 3}
    assert chosen(all_at(10.0), given) == ((100.0, 50, 3), [])


def test_a_grid_that_is_set_has_a_window_of_twenty_readings_of_the_log():
    (grid_hz, window, mean), _ = chosen(all_at(1.0, 600.0), {"align.rate_hz": 100.0})
    assert (grid_hz, window, mean) == (100.0, 2000, 10)


def test_holes_do_not_make_a_log_slower():
    read = all_at(20.0)
    holes = {}
    for name, (t_ns, x) in read.items():
        kept = (t_ns // 10**9) % 10 < 6
        holes[name] = t_ns[kept], x[kept]
    assert chosen(holes)[0] == (20.0, 64, 2)


def test_a_gap_is_so_many_periods_of_the_log():
    machine = make_machine()
    read = all_at(10.0)
    found, _ = choose_grid_rate_by_log(read, machine)
    longest_ns = filters.compute_gap_threshold_ns(read["force_x_N"][0], found.settings.align)
    assert longest_ns == pytest.approx(0.3e9)


def test_a_log_too_short_for_a_window_says_how_long_that_is():
    machine = make_machine()
    found, _ = choose_grid_rate_by_log(all_at(1.0, 15.0), machine)
    excitation = pl.DataFrame({"phase": ["cruising"] * 15})
    gated = pl.DataFrame({"accepted_x": [False] * 15, "reason_x": ["warming_up"] * 15})
    why = explain_why_gate_accepted_nothing(excitation, gated, found.settings)
    assert why == "the log lasts 15.00 s, a window needs 20.00 s"


def test_what_is_unset_stays_so_when_other_settings_change():
    changed = make_machine().settings.copy_with_changes({"gate.threshold_nat": 0.5})
    assert changed.gate.threshold_nat == 0.5
    machine = make_machine().model_copy(update={"settings": changed})
    found, _ = choose_grid_rate_by_log(all_at(10.0), machine)
    assert found.settings.gate.window_samples == 32
    assert found.settings.gate.threshold_nat == 0.5


@pytest.mark.parametrize(
    ("later_steps_ms", "rate_hz"),
    [
        pytest.param([100] * 500, 10.0, id="half the log is slower, and would be lost in gaps"),
        pytest.param([100] * 30, 50.0, id="a twentieth is slower: it is a gap"),
        pytest.param(range(70, 900, 4), 50.0, id="readings that come on a change have no rate"),
    ],
)
def test_a_log_that_becomes_slower_has_the_rate_that_reads_it_all(later_steps_ms, rate_hz):
    t_ns = np.cumsum([20] * 3000 + [*later_steps_ms]) * 1_000_000
    (found_hz, *_), _ = chosen({name: (t_ns, np.sin(t_ns / 1e9)) for name in CHANNELS})
    assert found_hz == pytest.approx(rate_hz)
