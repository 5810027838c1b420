"""A small twin of the campaign of unlisted faults: named first, and no wrong mass is shown."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Channel
from benchmarks.unlisted_faults import try_fault
from benchmarks.unlisted_rows import TORQUES, UNLISTED, drawn_log, memory_log
from replay.pipeline import run
from tests.analysis.weighing.weighed import RICH, RUNS, merged, weighed
from tests.twins import mark_heavy_after, mark_slow_after

BY_NAME = {fault.name: fault for fault in UNLISTED}
#: An even seed is driven by the simulator, an odd one by the independent plant.
SIMULATED, INDEPENDENT = 2_800_000, 2_800_001


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("name", "size", "seed"),
    mark_slow_after(
        5,
        [
            ("left torque small", 0.2, SIMULATED),
            ("left wheel slips in hard starts", 0.1, SIMULATED),
            ("IMU upside down", 1.0, SIMULATED),
            ("IMU loose", 2.0, SIMULATED),
            ("gain drifts", 0.1, INDEPENDENT),
            # with a twin of the same channel above, or among the kept findings
            ("left wheel high", 1.15, INDEPENDENT),
            ("speed late", 0.3, SIMULATED),
            ("speed in another unit", 9.5493, INDEPENDENT),
            ("Coulomb friction", 0.1, SIMULATED),
            # another size on the other plant
            ("left torque small", 0.9, INDEPENDENT),
            ("speed late", 1.0, INDEPENDENT),
            ("speed in another unit", 1.0, INDEPENDENT),
        ],
    ),
)
def test_an_unlisted_fault_is_named_first_and_shows_no_wrong_mass(
    name: str, size: float, seed: int
) -> None:
    fault = BY_NAME[name]
    found = try_fault(fault, size, seed)
    assert found.is_named(fault.causes), found
    assert not found.is_wrong, found


@pytest.mark.heavy
@pytest.mark.parametrize(
    "seed",
    mark_slow_after(
        1,
        [
            3_300_001,
            pytest.param(3_320_181, id="both ways on a cross slope"),
            pytest.param(3_320_017, id="sampled unevenly and stamped right"),
            *(3_300_002, 3_300_010),
        ],
    ),
)
def test_a_sound_machine_on_a_cross_slope_in_curves_has_no_finding(seed: int) -> None:
    found = try_fault(None, 0.0, seed)
    assert found.mass_kg is not None
    assert found.causes == []
    assert "side_difference" not in found.failed


@pytest.mark.heavy
@pytest.mark.parametrize(
    "seed",
    mark_slow_after(
        2,
        [
            pytest.param(5_900_172, id="force of the brakes in a slope, and none in motion"),
            pytest.param(5_900_208, id="more of it than friction would explain"),
            5_900_040,
        ],
    ),
)
def test_a_sound_machine_that_its_brakes_hold_on_a_slope_has_no_friction(seed: int) -> None:
    assert try_fault(None, 0.0, seed, odd=True).causes == []


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [3_300_001, 3_300_002]))
def test_an_engine_that_is_off_at_a_stand_is_no_frozen_channel(seed: int) -> None:
    log = drawn_log(seed)
    speed, torque = log.topics["speed"], log.topics["torque"]
    moves_ns = speed.filter(pl.col("speed_left_m_s").abs() > 0.05)["header_stamp_ns"].to_numpy()
    stands = np.flatnonzero(np.diff(moves_ns) > 2e9)
    begins_ns, ends_ns = moves_ns[stands[1]] + 700_000_000, moves_ns[stands[1] + 1] - 300_000_000
    is_off = pl.col("header_stamp_ns").is_between(begins_ns, ends_ns)
    switched = torque.with_columns(
        pl.when(is_off).then(0.0).otherwise(pl.col(name)).alias(name) for name in TORQUES
    )
    assert switched.filter(pl.col(TORQUES[0]) == 0.0).height > 100
    replayed = run(
        [memory_log(replace(log, topics={**log.topics, "torque": switched}))], log.machine
    )
    assert replayed.frames["findings"].is_empty()


@pytest.mark.heavy
@pytest.mark.parametrize("is_on_boom", mark_heavy_after(1, [True, False]))
def test_an_imu_that_turns_with_the_boom_is_found_by_gravity_along_x(is_on_boom: bool) -> None:
    log = drawn_log(INDEPENDENT)
    imu, speed = log.topics["imu"], log.topics["speed"]
    moves_ns = speed.filter(pl.col("speed_left_m_s").abs() > 0.05)["header_stamp_ns"].to_numpy()
    stands = np.flatnonzero(np.diff(moves_ns) > 2e9)
    middles_ns = (moves_ns[stands] + moves_ns[stands + 1]) / 2.0
    # raised and lowered in turn, within a second at the middle of each standstill
    times_ns = np.sort(np.concatenate([middles_ns - 5e8, middles_ns + 5e8]))
    angles_rad = 0.25 * np.repeat(np.arange(stands.size + 1) % 2, 2)[1:-1]
    boom_rad = np.interp(imu["header_stamp_ns"].to_numpy(), times_ns, angles_rad)
    tilt_rad = boom_rad if is_on_boom else 0.01 * boom_rad
    reads = imu["specific_force_x_m_s2"].to_numpy()
    turned = reads * np.cos(tilt_rad) + 9.81 * np.sin(tilt_rad)
    imu = imu.with_columns(specific_force_x_m_s2=turned, boom_rad=boom_rad)
    channels = {**log.machine.channels, "boom_rad": Channel(topic="imu", field="boom_rad")}
    machine = log.machine.model_copy(update={"channels": channels})
    found = run([memory_log(replace(log, topics={**log.topics, "imu": imu}))], machine)
    causes = found.frames["findings"]["cause"].to_list()
    assert causes[:1] == ["imu_on_boom"] if is_on_boom else "imu_on_boom" not in causes


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [INDEPENDENT, SIMULATED]))
def test_a_torque_that_clips_is_found_where_arithmetic_makes_the_force_of_it(seed: int) -> None:
    log = drawn_log(seed)
    torque = log.topics["torque"]
    limits = [0.7 * float(np.abs(torque[name].to_numpy()).max()) for name in TORQUES]
    clipped = torque.with_columns(
        pl.col(name).clip(-limit, limit) for name, limit in zip(TORQUES, limits, strict=True)
    )
    topics = [memory_log(replace(log, topics={**log.topics, "torque": clipped}))]
    direct = run(topics, log.machine).frames["findings"]
    channels = {name: each for name, each in log.machine.channels.items() if name not in TORQUES}
    channels |= {
        f"{side}_motor_N_m": Channel(topic="torque", field=f"torque_{side}_N_m")
        for side in ("left", "right")
    }
    channels["force_x_N"] = Channel(derive="(left_motor_N_m + right_motor_N_m) / wheel_radius_m")
    machine = log.machine.model_copy(update={"channels": channels})
    computed = run(topics, machine).frames["findings"]
    for found in (direct, computed):
        assert found["cause"][0] == "saturated"
    assert computed["channel"][0] in ("left_motor_N_m", "right_motor_N_m")
    limits_N = [float(found["value"][0]) for found in (direct, computed)]
    assert limits_N[1] == pytest.approx(limits_N[0], rel=0.02)


@pytest.mark.heavy
def test_a_pressure_that_rests_while_the_other_works_is_not_clipped() -> None:
    log = drawn_log(INDEPENDENT)
    torque = log.topics["torque"]
    drives_N_m = np.sum([torque[name].to_numpy() for name in TORQUES], axis=0)
    pressures = {
        f"pressure_{side}_bar": np.round(24.0 + np.maximum(sign * drives_N_m, 0.0) / 10.0, 1)
        for side, sign in (("a", 1.0), ("b", -1.0))
    }
    topics = {**log.topics, "torque": torque.with_columns(pl.from_dict(pressures))}
    channels = {name: each for name, each in log.machine.channels.items() if name not in TORQUES}
    channels |= {name: Channel(topic="torque", field=name, unit="bar") for name in pressures}
    channels["force_x_N"] = Channel(
        derive="(pressure_a_bar - pressure_b_bar) * 0.0001 [m**3] / wheel_radius_m"
    )
    machine = log.machine.model_copy(update={"channels": channels})
    replayed = run([memory_log(replace(log, topics=topics))], machine)
    assert "saturated" not in replayed.frames["findings"]["cause"].to_list()
    assert replayed.frames["loads"]["withheld"].to_list() == [False]


@pytest.mark.parametrize("seed", mark_slow_after(1, [5_900_103, 5_900_211]))
def test_a_few_milliseconds_of_a_sound_machine_are_no_delay(seed: int) -> None:
    assert try_fault(None, 0.0, seed).causes == []


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [6_500_018, 6_500_004]))
def test_a_gain_that_drifts_as_if_loads_were_taken_one_after_another_is_named(seed: int) -> None:
    assert try_fault(BY_NAME["gain drifts"], 0.2, seed).is_named(("gain_drift",))


@pytest.mark.heavy
def test_loads_that_are_taken_one_after_another_are_no_drift() -> None:
    three = {"campaign": {"loads_kg": [0, 200, 400], "runs": 3}}
    replayed = weighed(merged(RUNS, RICH, three)).replayed
    assert replayed.frames["loads"].height == 3
    assert replayed.frames["findings"].is_empty()


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("late_s", "seed"), mark_slow_after(1, [(0.1, SIMULATED), (0.04, INDEPENDENT)])
)
def test_the_late_one_of_two_torques_is_named_with_its_delay(late_s: float, seed: int) -> None:
    fault = BY_NAME["left torque late"]
    log = fault.put_into(drawn_log(seed, both_ways=fault.both_ways), late_s, seed)
    findings = run([memory_log(log)], log.machine).frames["findings"]
    (delay,) = findings.filter(cause="delay").to_dicts()
    assert delay["rank"] == 1
    assert delay["setting"] == "channels.torque_left_N_m.delay_s"
    assert float(delay["value"]) == pytest.approx(late_s, abs=0.003)
