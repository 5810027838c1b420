"""A gear has no value between two gears, and does not set the rate of what is derived of it."""

import numpy as np
import pytest

from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.grid_rate import choose_grid_rate_by_log
from analysis.stages.signals.piecewise_constant import (
    drop_values_between_steps,
    is_piecewise_constant,
)
from analysis.stages.signals.timestamps import assign_timestamps

S = 1_000_000_000


@pytest.mark.parametrize(
    ("name", "readings", "expected"),
    [
        ("gear_1", np.repeat([1.0, 2.0, 3.0, 2.0], 8), True),
        ("lever_1", np.ones(20), True),
        ("torque_percent", np.repeat([10.0, 20.0], 8), False),
        ("gear_1", np.tile([1.0, 2.0], 8), False),
        ("throttle_1", np.repeat(np.linspace(0.0, 1.0, 40), 8), False),
        ("gear_1", np.ones(1), False),
    ],
)
def test_a_pure_number_of_few_values_that_seldom_change_is_piecewise_constant(
    name: str, readings: np.ndarray, *, expected: bool
) -> None:
    assert is_piecewise_constant(name, readings) is expected


def test_between_two_unlike_readings_there_is_no_value() -> None:
    t, gear = np.array([0, 10, 20]), np.array([1.0, 1.0, 2.0])
    at = np.array([0, 5, 10, 11, 20])
    kept = drop_values_between_steps(t, gear, at, np.interp(at, t, gear))
    np.testing.assert_array_equal(kept, [1.0, 1.0, 1.0, np.nan, 2.0])


def test_a_force_of_a_gear_read_once_a_second_comes_at_the_rate_of_the_torque(raw_topic, machine):
    at = 1_700_000_000 * S + np.arange(0, 10 * S, S // 10)
    raw = {
        "/engine": raw_topic(at, torque=np.full(100, 3.0), speed=np.sin(np.arange(100) / 10)),
        "/gearbox": raw_topic(at[::10], gear=np.repeat([4.0, 2.0], 5)),
    }
    own = machine(
        torque_N_m={"topic": "/engine", "field": "torque"},
        gear_1={"topic": "/gearbox", "field": "gear"},
        gear_ratio_1={"derive": "where(gear_1 > 3, 4, 2)"},
        force_x_N={"derive": "torque_N_m * gear_ratio_1 / 1 [m]"},
        speed_x_m_s={"topic": "/engine", "field": "speed"},
        specific_force_x_m_s2={"topic": "/engine", "field": "speed"},
    )
    read, _ = read_measured_channels(assign_timestamps(raw)[0], own)
    own, _ = choose_grid_rate_by_log(read, own)
    assert own.settings.align.rate_hz == 10.0
    force = derive_channels_in_si(read, own)[0]["force_x_N"]
    # from 4 s, the last reading of the one gear, to 5 s, the first of the other, none is known
    assert force.t_ns.tolist() == [*at[:41], *at[50:91]]
    assert list(dict.fromkeys(force.x.tolist())) == [12.0, 6.0]
