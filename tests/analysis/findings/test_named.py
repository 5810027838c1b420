"""A small twin of `make findings`: each fault is named first, a log without one says nothing."""

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from analysis.findings import CAUSES
from analysis.simulation import Scenario, simulate_campaign
from benchmarks.findings_rows import AXES, design, needed, own_machine, replayed, simulated
from benchmarks.own_rate import Cell, logged, machine_of
from benchmarks.weighed import DERIVED, machine
from replay import open_log
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.logs import TimeAxis
from replay.pipeline import run
from tests.analysis.findings.conftest import BY_NAME, Named
from tests.analysis.findings.kept import OR, PLAIN, UPDATE, log_name, read_kept
from tests.analysis.weighing.weighed import RICH, RUNS, merged
from tests.trials.drawn_designs import join_designs
from tests.trials.fault_injection import FAULTS, Fault
from tests.twins import mark_heavy_after, mark_slow_after

#: Sizes that are found on this machine with a margin; those of others are as they are said.
SIZES = {
    "force late": 3.0,
    "speed late": 4.0,
    "wheels larger": 5.0,
    "force clipped": 1.0,
    "force clock fast": 5.0,
    "IMU tilted": 3.0,
    "IMU turned": 2.0,
    "IMU biased": 3.0,
    "IMU low-passed": 3.0,
    "slip": 1.5,
    "load transfer": 4.0,
    "Coulomb friction": 4.0,
    "force offset": 4.0,
    "force low in reverse": 5.0,
    "braking included": 5.0,
    "a bucket that fills": 10.0,
    "a frame that swings": 1.0,
}
OTHERS = 3.0


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_named_first_in_what_is_kept(fault: Fault) -> None:
    """`test_kept.py` replays these logs, and finds what is kept."""
    kept = read_kept(PLAIN)
    assert log_name(PLAIN, fault) in kept, f"nothing is kept of '{fault.name}': {UPDATE}"
    first, *_ = kept[log_name(PLAIN, fault)]
    assert set(first[0].split(OR)) & set(fault.causes)


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_named_first_by_itself_or_with_its_class(named: Named, fault: Fault) -> None:
    found = named((fault.name, SIZES.get(fault.name, OTHERS)))
    first = found.row(0, named=True)
    told = {first["cause"], *first["alternatives"].split(", ")}
    assert told & set(fault.causes), found.select("cause", "evidence").rows()


@pytest.mark.parametrize("seed", mark_slow_after(1, [7, 8, 11]))
def test_a_log_without_a_fault_has_no_finding(named: Named, seed: int) -> None:
    assert named(seed=seed).is_empty()


@pytest.mark.heavy
def test_brakes_that_the_force_sees_are_no_finding(named: Named) -> None:
    assert named(("braking included", 0.0)).is_empty()


def test_a_payload_in_the_last_start_is_no_wind_up() -> None:
    sections = design(1, odd=False)
    loading = {"change_kg": 0.3 * sections["machine"]["mass_kg"]}
    loading["change_before_start"] = sections["campaign"]["runs"] - 1
    methods = ['settings.trace.methods=["pooled", "rls"]']
    found = replayed(join_designs(sections, {"loading": loading}), (), AXES, methods).frames[
        "findings"
    ]
    assert "wind_up" not in found["cause"]


@pytest.mark.heavy
@pytest.mark.parametrize(
    "other",
    mark_slow_after(1, [pytest.param(("force late", 8.0)), pytest.param(("IMU biased", 5.0))]),
)
def test_what_a_recursion_forgets_is_seen_beside_a_fault_that_bends_its_estimate(
    named: Named, other: tuple[str, float]
) -> None:
    assert "wind_up" in set(named(other, ("a recursion ungated", 1.0))["cause"][:2])


@pytest.mark.slow
def test_a_recursion_that_forgets_only_what_is_renewed_does_not_wind_up() -> None:
    fault = BY_NAME["a recursion ungated"]
    ways = ["settings.trace.directional_forgetting=true"]
    found = replayed(design(7, odd=False), [(fault, 1.0)], AXES, ways).frames["findings"]
    assert "wind_up" not in found["cause"]


@pytest.mark.parametrize("seed", mark_slow_after(1, [9, 36]))
def test_a_recursion_behind_the_gate_does_not_wind_up(seed: int) -> None:
    methods = ['settings.trace.methods=["rls", "rtls"]']
    found = replayed(design(seed, odd=False), (), AXES, methods).frames["findings"]
    assert "wind_up" not in found["cause"]


@pytest.mark.heavy
def test_what_a_coarse_grid_sees_of_the_acceleration_is_all_of_it() -> None:
    rate = ["settings.align.rate_hz=5.0", "settings.gate.window_samples=16"]
    found = replayed(design(7, odd=False), (), AXES, rate).frames["findings"]
    assert "imu_low_passed" not in found["cause"]


def test_two_faults_are_among_the_first_three(named: Named) -> None:
    found = named(("force late", 4.0), ("wheels larger", 5.0))
    assert {"delay", "wheel_radius"} <= set(found["cause"][:3])


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [8_000_015, 8_100_024]))
def test_wheels_that_turn_slower_than_the_ground_are_larger_and_do_not_slip(
    named: Named, seed: int
) -> None:
    row = named(("wheels larger", 0.8), seed=seed).row(0, named=True)
    assert row["cause"] == "wheel_radius"
    assert "slip" not in row["alternatives"]


@pytest.mark.parametrize("seed", mark_slow_after(1, [8_000_000, 8_000_016]))
def test_a_load_that_grows_is_seen_by_the_force_that_brings_it_to_speed(
    named: Named, seed: int
) -> None:
    row = named(("a bucket that fills", 3.0), seed=seed).row(0, named=True)
    assert row["cause"] == "load_changed_inside"
    # 150 kg/s of the loader's mass, on this machine's
    grows = 150.0 * design(seed, odd=False)["machine"]["mass_kg"] / 3614.0
    said = float(row["evidence"].split(" by up to ")[1].split(" kg/s")[0])
    assert said == pytest.approx(grows, rel=0.2)


# two seconds each; that a recursion winds up is among the kept findings
@pytest.mark.slow
@pytest.mark.parametrize("seed", [8_400_001, 8_500_007])
def test_the_end_of_a_minutes_drive_is_no_load_that_falls(named: Named, seed: int) -> None:
    found = named(("a recursion ungated", 3.0), seed=seed)
    assert found["cause"].to_list() == ["wind_up"]


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [8_400_000, 8_500_022, 8_900_001]))
def test_the_knock_of_a_load_that_stops_pouring_is_not_the_reason_for_it(
    named: Named, seed: int
) -> None:
    found = named(("a bucket that fills", 10.0), seed=seed)
    assert found["cause"][0] == "load_changed_inside"


@pytest.mark.parametrize(
    ("seed", "size"),
    mark_slow_after(1, [(8_400_000, 3.0), (8_500_000, 10.0), (8_500_010, 10.0), (8_700_017, 1.0)]),
)
def test_a_pile_is_named_first_where_it_leaves_nothing_to_weigh_by(
    named: Named, seed: int, size: float
) -> None:
    assert named(("a pile", size), seed=seed)["cause"][0] == "external_force"


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("seed", "size"), mark_slow_after(1, [(9_000_004, 4.9), (9_000_006, 2.45)])
)
def test_a_load_transfer_that_looks_like_loads_by_direction_is_named_with_them(
    named: Named, seed: int, size: float
) -> None:
    row = named(("load transfer", size), seed=seed).row(0, named=True)
    assert row["cause"] == "driveline"
    assert "depend on the direction" in row["evidence"]
    assert row["mass_change_kg"] is None


@pytest.mark.parametrize("seed", mark_slow_after(1, [9_200_000, 9_200_004]))
def test_loads_at_every_second_start_are_no_load_transfer(seed: int) -> None:
    machine = design(seed, odd=False)
    carried = {"change_kg": 0.25 * machine["machine"]["mass_kg"], "alternating": True}
    log = join_designs(machine, {"starts": {"directions": "alternating"}, "loading": carried})
    assert replayed(log).frames["findings"].is_empty()


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [9_200_001, 9_200_003]))
def test_a_load_transfer_beside_a_load_taken_once_keeps_its_kilograms(seed: int) -> None:
    machine = needed(design(seed, odd=False), [BY_NAME["load transfer"]])
    half = {
        "change_kg": 0.1 * machine["machine"]["mass_kg"],
        "change_before_start": machine["campaign"]["runs"] // 2,
    }
    log = join_designs(machine, {"starts": {"directions": "alternating"}, "loading": half})
    found = replayed(log, [(BY_NAME["load transfer"], 2.0)]).frames["findings"]
    row = found.filter(pl.col("cause") == "driveline").row(0, named=True)
    assert "depend on the direction" not in row["evidence"]
    assert row["mass_change_kg"] is not None


@pytest.mark.parametrize("seed", mark_slow_after(1, [8_700_003, 8_700_013]))
def test_what_hardly_moves_has_no_wrong_sign(named: Named, seed: int) -> None:
    found = named(("weak starts", 10.0), seed=seed)
    assert found["cause"].to_list() == ["too_little_excitation"]


@pytest.mark.heavy
def test_steps_of_a_coarse_speed_are_no_spikes_and_hide_none(named: Named) -> None:
    found = named(("speed coarse", 10.0), ("torque with spikes", 10.0), seed=8_600_249)
    channels = dict(found.select("cause", "channel").iter_rows())
    assert channels["spikes"] == "torque_left_N_m"
    assert channels["quantised"].startswith("speed")


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [8_600_207, 8_600_311]))
def test_a_speed_of_a_fifth_of_a_metre_a_second_is_a_finding_and_no_fault(
    named: Named, seed: int
) -> None:
    assert "quantised" in named(("speed coarse", 10.0), seed=seed)["cause"].to_list()


def test_a_delay_is_told_with_its_channel_its_size_and_what_mends_it(named: Named) -> None:
    row = named(("force late", 4.0)).row(0, named=True)
    assert row["channel"] == "torque_left_N_m"
    assert row["setting"] == "channels.torque_left_N_m.delay_s, channels.torque_right_N_m.delay_s"
    for value in row["value"].split(", "):
        assert float(value) == pytest.approx(0.04, abs=0.005)
    assert "late relative to speed and accelerometer" in row["evidence"]
    assert row["mass_change_u_kg"] > 0.0


def test_without_an_accelerometer_a_late_speed_may_be_an_early_force() -> None:
    late = merged(RUNS, RICH, {"sensors": {"speed_delay_s": 0.06}})
    (log,) = simulate_campaign(Scenario.model_validate(late))
    replay = run([MemoryLog(log)], copy_machine_with_simulated_channels(machine(DERIVED), log))
    row = replay.frames["findings"].row(0, named=True)
    assert row["cause"] == "delay"
    assert "ms late relative to force, or the force is early" in row["evidence"]


@pytest.mark.heavy
def test_a_swing_stands_before_what_it_makes_of_noise_and_mass(named: Named) -> None:
    found = named(("a frame that swings", 10.0), seed=8)
    assert found["cause"][0] == "resonance"
    assert "heteroscedastic" in set(found["cause"])


@pytest.mark.parametrize("seed", mark_slow_after(1, [8_000_000, 8_000_017, 8_100_010]))
def test_the_stop_of_what_hardly_moves_is_no_spike(named: Named, seed: int) -> None:
    found = named(("weak starts", 10.0), seed=seed)
    assert found["cause"][0] == "too_little_excitation"
    assert "spikes" not in found["cause"]


@pytest.mark.parametrize(
    ("fault", "size"),
    mark_slow_after(1, [("force clock jumps", 10.0), ("speed coarse", 10.0), ("force late", 8.0)]),
)
def test_what_steps_leave_at_low_frequencies_is_no_swing(
    named: Named, fault: str, size: float
) -> None:
    assert "resonance" not in named((fault, size), seed=8)["cause"]


@pytest.mark.heavy
def test_a_slow_swing_is_one() -> None:
    swing = {"vibration_m_s2": 0.1, "vibration_hz": 2.5, "vibration_bandwidth_hz": 0.4}
    slow = join_designs(design(8, odd=False), {"defects": swing})
    assert replayed(slow, (), AXES).frames["findings"]["cause"][0] == "resonance"


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("noise", "size"),
    mark_slow_after(1, [("slow noise", 10.0), ("noise that grows with the force", 10.0)]),
)
def test_a_late_accelerometer_is_told_from_early_wheels_under_a_noisy_force(
    named: Named, noise: str, size: float
) -> None:
    found = named((noise, size), ("IMU low-passed", 5.0), seed=18)
    causes = [{row["cause"], *row["alternatives"].split(", ")} for row in found.to_dicts()]
    assert any("imu_low_passed" in named_as for named_as in causes[:3]), found["cause"]


def test_a_bias_and_a_small_tilt_are_one_class(named: Named) -> None:
    row = named(("IMU tilted", 3.0)).row(0, named=True)
    assert (row["cause"], row["alternatives"]) == ("imu_misaligned", "imu_bias")


def test_findings_are_ranked_from_one_and_no_strength_is_below_its_limit(named: Named) -> None:
    found = named(("force frozen", 3.0), ("IMU tilted", 4.0))
    assert found["rank"].to_list() == list(range(1, found.height + 1))
    assert (found["strength_1"] >= 1.0).all()
    assert set(found["severity"]) <= {"withhold", "widen", "tell"}


def test_a_log_of_one_second_has_a_frame_without_rows_or_with_what_is_missing(named: Named) -> None:
    found = named(("weak starts", 10.0))
    assert "too_little_excitation" in set(found["cause"])


def test_every_fault_names_causes_of_the_table() -> None:
    keys = {cause.key for cause in CAUSES}
    assert {key for fault in FAULTS for key in fault.causes} <= keys
    assert {key for cause in CAUSES for key in cause.explains} <= keys
    assert len(BY_NAME) == len(FAULTS) >= 18
    assert len({cause.key for cause in CAUSES}) == len(CAUSES)


def test_what_is_kept_of_the_frame_is_its_schema(named: Named) -> None:
    assert named(("force late", 3.0)).schema["value"] == pl.String


#: What a pitch is read as, as a factor, and the cause that it is.
PITCHES = {
    "the other sign": (-1.0, "sign_flipped"),
    "degrees": (57.29578, "wrong_unit"),
    "right": (1.0, None),
    # neither: in per cent it is about 0.6 of one in degrees
    "per cent": (100.0, None),
    "three times as large": (3.0, None),
}


@pytest.mark.parametrize("reading", mark_heavy_after(3, PITCHES))
def test_a_pitch_of_the_wrong_sign_or_in_degrees_is_named_on_hills(reading: str) -> None:
    factor, cause = PITCHES[reading]
    hills = {"terrain": {"hills_deg": 3.0, "hills_length_m": 20.0}}
    findings = find_with_pitch(hills, pl.col("pitch_rad") * factor)
    of_pitch = findings.filter(channel="pitch_rad")
    if cause is None:
        assert of_pitch.is_empty()
        return
    first = findings.row(0, named=True)
    assert (first["cause"], first["channel"]) == (cause, "pitch_rad")
    assert first["setting"] == "channels.pitch_rad.scale"
    assert float(first["value"]) == pytest.approx(1.0 / factor, rel=1e-3)


@pytest.mark.parametrize("wanders", mark_heavy_after(1, [True, False]))
def test_a_pitch_that_is_only_worse_than_none_is_neither(wanders: bool) -> None:
    """On level ground; a filter leaks the acceleration into it, or it wanders."""
    leaked = pl.col("specific_force_x_m_s2").ewm_mean(half_life=50.0) / 10.0
    slowly = (pl.int_range(pl.len()) / 300.0).sin() * 0.03
    findings = find_with_pitch({}, slowly if wanders else leaked)
    assert findings.filter(channel="pitch_rad").is_empty()


def find_with_pitch(sections: dict[str, dict[str, float]], pitch_rad: pl.Expr) -> pl.DataFrame:
    """Findings of a design whose pitch channel reads something else."""
    (log,) = simulated(join_designs(design(1, odd=False), sections), ())
    own = copy_machine_with_simulated_channels(own_machine(log.scenario, (), AXES), log)
    topics = {**log.topics, "imu": log.topics["imu"].with_columns(pitch_rad=pitch_rad)}
    read = replace(log, topics=topics)
    return run([MemoryLog(read)], own).frames["findings"]


def test_a_speed_that_stays_at_its_largest_reading_is_saturated(tmp_path: Path) -> None:
    cell = Cell(50.0, 5.0, derived=False)
    drive = logged(cell, 3320)
    limit_m_s = 0.7 * drive["speed"].max()
    drive.with_columns(pl.col("speed").clip(-limit_m_s, limit_m_s)).write_csv(tmp_path / "car.csv")
    with open_log(tmp_path / "car.csv", time=TimeAxis("t", "s")) as log:
        findings = run(log, machine_of(cell, stated=False)).frames["findings"]
    first = findings.row(0, named=True)
    assert (first["cause"], first["channel"]) == ("saturated", "speed_x_m_s")
    assert "frozen" not in findings["cause"]
