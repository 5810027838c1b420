"""A mass that swings relative to the machine is found, modelled and named; a rigid one is not."""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
import pytest
from scipy.signal import StateSpace, lsim

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.weighing.motion_samples import MotionSamples
from analysis.weighing.swinging_mass import (
    find_swinging_mass,
    integrate_relative_acceleration_m_s2,
)
from replay import open_log, run
from replay.logs import TimeAxis
from tests.twins import mark_heavy_after

RATE_HZ = 50.0
STAND_S = (7.0, 12.0)


class Swinging(NamedTuple):
    """A machine with a part that swings.

    Attributes:
        empty_kg: mass of the empty machine.
        loads_kg: range of its loads.
        own_kg: swinging mass of the empty machine.
        share: part of the load that swings.
        hz: frequency with the swinging mass of the heaviest load.
        damping: damping ratio.
        on_one_spring: whether the frequency falls as the swinging mass grows.
    """

    empty_kg: float
    loads_kg: tuple[float, float]
    own_kg: float
    share: float
    hz: float
    damping: float
    on_one_spring: bool = False


TANKER = Swinging(9000.0, (3000.0, 6500.0), 0.0, 0.3, 0.4, 0.03)
MACHINES = {
    "tanker": TANKER,
    "trolley with a hanging load": Swinging(3000.0, (600.0, 2000.0), 0.0, 1.0, 0.22, 0.01),
    "tug with wagons": Swinging(1500.0, (500.0, 2500.0), 0.0, 1.0, 2.0, 0.06),
    "stacker with a mast": Swinging(8000.0, (600.0, 1500.0), 1500.0, 0.6, 0.7, 0.02, True),
    "engine with a wagon": Swinging(24000.0, (6000.0, 14000.0), 8000.0, 1.0, 0.8, 0.08, True),
}


def drives(dice: np.random.Generator, cycles: int) -> tuple[np.ndarray, np.ndarray]:
    """Speed at 50 Hz, and the number of each sample's cycle, counted in halves: out, and back."""
    speeds, halves = [np.zeros(250)], [np.zeros(250)]
    for half in range(2 * cycles):
        rise_s, cruise_s = dice.uniform(2.5, 6.0), dice.uniform(4.0, 12.0)
        top_m_s = dice.uniform(1.8, 2.6)
        shape = np.interp(
            np.arange(0.0, 2.0 * rise_s + cruise_s, 1.0 / RATE_HZ),
            [0.0, rise_s, rise_s + cruise_s, 2.0 * rise_s + cruise_s],
            [0.0, top_m_s, top_m_s, 0.0],
        )
        stand = np.zeros(round(dice.uniform(*STAND_S) * RATE_HZ))
        speeds += [shape if half % 2 == 0 else -shape, stand]
        halves += [np.full(shape.size, half), np.full(stand.size, half + 0.6)]
    smooth = np.hanning(17) / np.hanning(17).sum()
    return np.convolve(np.concatenate(speeds), smooth, "same"), np.concatenate(halves)


def swings(machine: Swinging, acceleration: np.ndarray, load_kg: np.ndarray) -> np.ndarray:
    """Force of the swinging part, (n,) in N; a new load hangs still."""
    force = np.zeros(acceleration.size)
    edges = np.flatnonzero(np.diff(load_kg, prepend=np.nan, append=np.nan))
    heaviest_kg = machine.own_kg + machine.share * machine.loads_kg[1]
    for first, end in pairwise(edges):
        own = slice(first, end)
        mass_kg = machine.own_kg + machine.share * load_kg[first]
        ratio = heaviest_kg / mass_kg if machine.on_one_spring else 1.0
        omega = 2.0 * np.pi * machine.hz * np.sqrt(ratio)
        below = [[0.0, 1.0], [-(omega**2), -2.0 * machine.damping * omega]]
        spring = StateSpace(below, [[0.0], [-1.0]], [below[1]], [[-1.0]])
        t = np.arange(end - first) / RATE_HZ
        force[own] = mass_kg * lsim(spring, acceleration[own], t)[1] if t.size > 1 else 0.0
    return force


def weigh_log(
    folder: Path, seed: int, machine: Swinging, *, rigid: bool = False, accelerometer: bool = False
) -> Run:
    """Weigh eight cycles, out with a load and back without one; the loads are in `loads.csv`."""
    dice = np.random.default_rng(seed)
    speed, half = drives(dice, 8)
    loads = dice.uniform(*machine.loads_kg, 8)
    # loaded and unloaded amid the stands
    number = np.floor(half + 0.5).astype(int)
    load_kg = np.where(number % 2 == 0, loads[(number // 2).clip(0, 7)], 0.0)
    acceleration = np.gradient(speed) * RATE_HZ
    mass_kg = machine.empty_kg + load_kg
    force = mass_kg * acceleration + 0.012 * 9.81 * mass_kg * np.tanh(speed / 0.05) + 60.0 * speed
    if not rigid:
        force += swings(machine, acceleration, load_kg)
    force = np.where(np.abs(speed) < 1e-3, 0.0, force)
    force += dice.normal(0.0, 0.004 * machine.empty_kg, speed.size)
    columns = {
        "t": np.arange(speed.size) / RATE_HZ,
        "force": force,
        "speed": speed + dice.normal(0.0, 0.003, speed.size),
        "acceleration": acceleration + dice.normal(0.0, 0.03, speed.size),
    }
    table = folder / f"log_{seed}.csv"
    pl.DataFrame(columns).write_csv(table)
    pl.DataFrame({"kg": loads}).write_csv(folder / "loads.csv")
    described = {
        "machine": {
            "name": "swinging", "digs": False,
            "empty_mass_kg": machine.empty_kg, "empty_mass_u_kg": 0.003 * machine.empty_kg,
        },
        "log": {"time": "t"},
        "channels": {
            "force_x_N": {"field": "force"},
            "speed_x_m_s": {"field": "speed"},
            **(
                {"specific_force_x_m_s2": {"field": "acceleration"}} if accelerometer
                else {"acc_x_m_s2": {"derive": "d/dt speed_x_m_s"}}
            ),
        },
        "settings": {
            "forces": {} if accelerometer else {"acceleration": "kinematic"},
            "gate": {"exclude_braking": False},
        },
    }  # fmt: skip
    return run(open_log(table, time=TimeAxis("t", "s")), Machine.model_validate(described))


def list_payloads_kg(replayed: Run, least_kg: float) -> tuple[np.ndarray, np.ndarray]:
    """Payloads above `least_kg` and their standard uncertainties, in kg."""
    loads = replayed.frames["loads"].filter(pl.col("payload_kg") > least_kg)
    return loads["payload_kg"].to_numpy(), loads["payload_u_kg"].to_numpy()


def get_evidence_of_resonance(replayed: Run) -> str | None:
    """What the finding `resonance` says; None without one."""
    rows = replayed.frames["findings"].filter(pl.col("cause") == "resonance")
    return rows["evidence"][0] if rows.height else None


@pytest.mark.parametrize("seed", mark_heavy_after(1, [1, 2]))
@pytest.mark.parametrize("name", mark_heavy_after(1, list(MACHINES)))
def test_loads_of_a_machine_with_a_part_that_swings_are_weighed(
    tmp_path: Path, name: str, seed: int
):
    machine = MACHINES[name]
    replayed = weigh_log(tmp_path, seed, machine)
    true_kg = pl.read_csv(tmp_path / "loads.csv")["kg"].to_numpy()
    payloads_kg, u_kg = list_payloads_kg(replayed, 0.4 * machine.loads_kg[0])
    assert payloads_kg.size == true_kg.size
    assert (np.abs(payloads_kg - true_kg) < np.maximum(3.0 * u_kg, 0.01 * true_kg)).all()
    assert payloads_kg.sum() == pytest.approx(true_kg.sum(), rel=0.02)
    assert np.median(u_kg / true_kg) < 0.1


@pytest.mark.heavy
@pytest.mark.parametrize("seed", [3, 4])
def test_a_swing_beside_an_accelerometer_is_found_by_the_wheels(tmp_path: Path, seed: int):
    replayed = weigh_log(tmp_path, seed, TANKER, accelerometer=True)
    true_kg = pl.read_csv(tmp_path / "loads.csv")["kg"].to_numpy()
    payloads_kg, u_kg = list_payloads_kg(replayed, 1000.0)
    assert payloads_kg.size == true_kg.size
    assert (np.abs(payloads_kg - true_kg) < 3.0 * u_kg).all()
    assert np.median(u_kg / true_kg) < 0.05
    assert get_evidence_of_resonance(replayed) is not None


@pytest.mark.heavy
@pytest.mark.parametrize("name", list(MACHINES))
def test_the_finding_names_the_mass_that_swings_and_its_frequency(tmp_path: Path, name: str):
    machine = MACHINES[name]
    evidence = get_evidence_of_resonance(weigh_log(tmp_path, 1, machine))
    assert evidence is not None
    found = re.search(r"a mass of about ([\d,]+) kg swings .* at ([\d.]+) Hz", evidence)
    assert found is not None, evidence
    mean_kg = float(pl.read_csv(tmp_path / "loads.csv")["kg"].to_numpy().mean()) / 2.0
    swinging_kg = machine.own_kg + machine.share * mean_kg
    assert float(found[1].replace(",", "")) == pytest.approx(swinging_kg, rel=0.25)
    if not machine.on_one_spring:
        assert float(found[2]) == pytest.approx(machine.hz, rel=0.02)


@pytest.mark.heavy
@pytest.mark.parametrize("name", list(MACHINES))
def test_a_rigid_machine_has_no_mass_that_swings(tmp_path: Path, name: str):
    replayed = weigh_log(tmp_path, 1, MACHINES[name], rigid=True)
    assert get_evidence_of_resonance(replayed) is None
    assert not replayed.frames["nuisances"]["term"].str.contains("swing").any()


def test_a_sprung_mass_moves_as_its_equation_says():
    t = np.arange(0.0, 20.0, 0.01)
    acceleration = np.where(t < 3.0, 0.5, 0.0) * np.sin(2.0 * t)
    omega, damping = 2.0 * np.pi * 0.6, 0.05
    below = [[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]]
    exact = lsim(StateSpace(below, [[0.0], [-1.0]], [below[1]], [[-1.0]]), acceleration, t)[1]
    still = np.zeros(t.size, np.bool_)
    found = integrate_relative_acceleration_m_s2(
        acceleration, np.full(t.size, omega), damping, still, 100.0
    )
    np.testing.assert_allclose(found, exact, atol=2e-3)
    still[1000] = True
    halted = integrate_relative_acceleration_m_s2(
        acceleration, np.full(t.size, omega), damping, still, 100.0
    )
    np.testing.assert_array_equal(halted[:1000], found[:1000])
    assert not halted[1000:].any()


def drives_with_steps(rate_hz: float, drive_s: float, seed: int) -> MotionSamples:
    """Twelve drives to and fro of a rigid 10 t, with 500 N more from the middle of each on."""
    dice = np.random.default_rng(seed)
    speeds: list[np.ndarray] = []
    stretches: list[np.ndarray] = []
    for number in range(12):
        t = np.arange(round(drive_s * dice.uniform(0.8, 1.2) * rate_hz)) / rate_hz
        speed = dice.uniform(1.0, 2.0) * (1.0 - np.exp(-4.0 * t / drive_s))
        stand = np.zeros(round(6.0 * rate_hz))
        speeds += [speed if number % 2 == 0 else -speed, stand]
        stretches += [np.full(t.size, number), np.full(stand.size, -1)]
    speed, stretch = np.concatenate(speeds), np.concatenate(stretches)
    way, nothing = np.sign(speed), np.zeros(speed.size)
    number = np.maximum.accumulate(stretch)
    acceleration = np.where(stretch >= 0, np.gradient(speed) * rate_hz, 0.0)
    motion = MotionSamples(
        acceleration, speed, nothing, stretch, way, number, rate_hz, None, None, None,
        np.linspace(-0.5, 0.5, speed.size), np.cumsum(np.abs(speed)) / rate_hz, nothing, 50.0,
        False, 1.0, 1e5,
    )  # fmt: skip
    late = motion.index_in_stretch / rate_hz > 0.5 * drive_s
    force = 10_000.0 * acceleration + way * (1000.0 + 500.0 * late)
    return replace(motion, force=force + dice.normal(0.0, 60.0, speed.size))


@pytest.mark.parametrize(
    ("rate_hz", "drive_s"), [(50.0, 5.0), (10.0, 15.0), (5.0, 5.0), (2.0, 12.0)]
)
def test_a_force_that_steps_in_every_drive_is_no_swing(rate_hz: float, drive_s: float):
    found = [find_swinging_mass(drives_with_steps(rate_hz, drive_s, seed)) for seed in range(4)]
    assert found == [None] * 4


def drives_alike(seed: int) -> MotionSamples:
    """Twelve drives to and fro of 8.5 t with 1.5 t that swing at 0.8 Hz, all with one profile."""
    dice = np.random.default_rng(seed)
    rate_hz = 50.0
    profile = np.interp(np.arange(0.0, 12.0, 1.0 / rate_hz), [0, 3, 9, 12], [0, 2, 2, 0])
    profile = np.convolve(profile, np.full(17, 1.0 / 17.0), "same")
    stand = np.zeros(round(8.0 * rate_hz))
    one = np.concatenate([profile, stand])
    speed = np.concatenate([one if number % 2 == 0 else -one for number in range(12)])
    drives = np.isin(np.arange(speed.size) % one.size, np.arange(profile.size))
    number = np.arange(speed.size) // one.size
    acceleration = np.gradient(speed) * rate_hz
    nothing = np.zeros(speed.size)
    omega = np.full(speed.size, 2.0 * np.pi * 0.8)
    still = np.arange(speed.size) % one.size == 0
    swing = integrate_relative_acceleration_m_s2(acceleration, omega, 0.03, still, rate_hz)
    way = np.where(number % 2 == 0, 1.0, -1.0)
    force = 10_000.0 * acceleration + 1500.0 * swing + 1000.0 * way * drives
    return MotionSamples(
        acceleration + dice.normal(0.0, 0.03, speed.size), speed,
        force + dice.normal(0.0, 60.0, speed.size), np.where(drives, number, -1), way, number,
        rate_hz, None, None, None, np.linspace(-0.5, 0.5, speed.size),
        np.cumsum(np.abs(speed)) / rate_hz, nothing, 50.0, False, 1.0, 1e5,
    )  # fmt: skip


def test_a_swing_is_found_in_drives_that_are_all_alike():
    found = find_swinging_mass(drives_alike(1))
    assert found is not None
    assert found.frequency_hz == pytest.approx(0.8, rel=0.02)
    assert found.mass_kg == pytest.approx(1500.0, rel=0.15)
