"""The logs of a drawn shift, and what is true of it."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from benchmarks.independent.legs import Leg
from benchmarks.independent.machine import Plant
from benchmarks.independent.machine_file import Known, write_machine_file
from benchmarks.independent.mcap_log import write_mcap
from benchmarks.independent.payload_plans import drawn_instruments
from benchmarks.independent.plant import STEP_S, Motion, drive
from benchmarks.independent.sensors import EPOCH_NS, Instruments, Readings, measured
from benchmarks.independent.shift_plans import (
    DURATION_S,
    MASS_KG,
    POURED_SHARE,
    CycleLegs,
    Driver,
    drawn_driver,
    drawn_plant,
    on_hard_ground,
)

#: Standard uncertainties that the machine file states, relative.
GAIN_U: Final = 0.01
RADIUS_U: Final = 0.005
EMPTY_MASS_U: Final = 0.004
#: Of the share that pours on the haul, absolute.
SPILLAGE_U: Final = 0.03
#: Standard deviations of what no file states; offset, slip and drift are shares.
_OFFSET_SHARE: Final = 0.02
_BIAS_M_S2: Final = 0.03
_TILT_DEG: Final = 0.2
_SLIP_SHARE: Final = 0.02
_DRIFT: Final = 0.003
#: A recorder restarts within so many seconds.
_RESTART_S: Final = (1.0, 15.0)
#: A bucket has been emptied when this share of what it loses is out.
_OUT: Final = 0.5
#: Shorter than any cycle.
_CYCLE_S: Final = 15.0


@dataclass(frozen=True)
class ShiftTruth:
    """What is true of a shift.

    Attributes:
        habits: of the driver.
        empty_kg: mass of the machine.
        ground: rolling resistance near and far, slope and hills in degrees.
        errors: of the instruments, by name.
        dump_s: when each cycle dumped, Unix time,
        payload_kg: and what.
        hidden: whether nothing was recorded then.
        minutes: that it lasted.
    """

    habits: tuple[str, ...]
    empty_kg: float
    ground: tuple[float, ...]
    errors: dict[str, float]
    dump_s: tuple[float, ...]
    payload_kg: tuple[float, ...]
    hidden: tuple[bool, ...]
    minutes: float

    @property
    def tonnes(self) -> float:
        """Of all cycles."""
        return sum(self.payload_kg) / 1e3

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return asdict(self)


class ShiftLog(NamedTuple):
    """A shift.

    Attributes:
        files: the topics of each.
        stated: the instruments, as the machine file has them,
        seen: and as they are.
        known: what else the machine file states.
        truth: what is true.
        plant: the machine and its ground.
    """

    files: list[dict[str, Readings]]
    stated: Instruments
    seen: Instruments
    known: Known
    truth: ShiftTruth
    plant: Plant


class ShiftPlan(NamedTuple):
    """What is not drawn of a shift, or within other limits.

    Attributes:
        shorter: share of the drawn length that is driven.
        hours: its length; None: drawn.
        load_share: least and greatest mean load over the machine's mass; None: as habits have it.
        clean: on hard level ground, with instruments that only have noise.
        force_1: factor of the torque that the machine file does not know,
        radius_1: and of the wheel radius,
        share_1: and of the share of the wheels that is measured.
    """

    shorter: float = 1.0
    hours: float | None = None
    load_share: tuple[float, float] | None = None
    clean: bool = False
    force_1: float = 1.0
    radius_1: float = 1.0
    share_1: float = 1.0


_AS_DRAWN: Final = ShiftPlan()


def shift_log(seed: int, plan: ShiftPlan = _AS_DRAWN) -> ShiftLog:
    """Draw a shift.

    Args:
        seed: of everything.
        plan: what is not drawn.
    """
    dice = np.random.default_rng([seed, 25_002])
    mass_kg = float(np.exp(dice.uniform(*np.log(MASS_KG))))
    driver = drawn_driver(dice, mass_kg)
    if plan.load_share is not None:
        share = float(np.random.default_rng([seed, 25_004]).uniform(*plan.load_share))
        driver = driver._replace(load_share=share, habits=driver.habits - {"small loads"})
    plant = drawn_plant(dice, driver, mass_kg)
    if plan.clean:
        plant = on_hard_ground(plant)
    longest_s = plan.shorter * float(dice.uniform(*DURATION_S))
    if plan.hours is not None:
        longest_s = 3600.0 * plan.hours
    made = CycleLegs(dice, driver, plant)
    legs = made.arrival()
    dumps: list[int] = []
    for _ in range(int(longest_s / _CYCLE_S)):
        cycle = made.cycle()
        dumps.append(len(legs) + cycle.dump)
        legs += cycle.legs
    motion = drive(plant, legs, longest_s)
    motion = _ended(dice, motion, dumps)
    seen = _instruments(dice, driver, plant)
    if plan.clean:
        seen = seen._replace(force_gain=1.0, gain_drift=0.0, force_offset_N=0.0)
        seen = seen._replace(acc_bias_m_s2=0.0, tilt_rad=0.0, slip_1_N=0.0)
    seen = seen._replace(force_gain=plan.force_1 * seen.force_gain)
    topics = measured(dice, seen, motion, mass_kg)
    files, holes = _split(dice, topics, motion.duration_s)
    emptied = _dumps(motion, legs, dumps)
    radius_m = plan.radius_1 * seen.radius_m * float(dice.normal(1.0, RADIUS_U))
    share = plan.share_1 * seen.share
    # no more than all wheels are measured: as far below
    share = share if share <= 1.0 else (2.0 - plan.share_1) * seen.share
    stated = seen._replace(radius_m=round(radius_m, 5), share=share)
    known = Known(
        mass_kg * float(dice.normal(1.0, EMPTY_MASS_U)),
        EMPTY_MASS_U * mass_kg,
        GAIN_U,
        RADIUS_U * stated.radius_m,
        spillage=_spillage(seed) if "pours" in driver.habits else None,
    )
    truth = ShiftTruth(
        tuple(sorted(driver.habits)),
        mass_kg,
        (
            plant.rolling_1,
            plant.rolling_far_1,
            float(np.rad2deg(plant.slope_rad)),
            float(np.rad2deg(plant.hills_rad)),
        ),
        {name: getattr(seen, name) for name in _ERRORS},
        tuple(EPOCH_NS / 1e9 + t_s for t_s, _ in emptied),
        tuple(kg for _, kg in emptied),
        tuple(any(begin < t_s < end for begin, end in holes) for t_s, _ in emptied),
        motion.duration_s / 60.0,
    )
    return ShiftLog(files, stated, seen, known, truth, plant)


def write_shift_log(log: ShiftLog, folder: Path) -> tuple[list[Path], Path]:
    """Write the files of a shift and its machine file into a folder, and give their paths."""
    paths = [folder / f"shift_{number}.mcap" for number in range(1, len(log.files) + 1)]
    for path, topics in zip(paths, log.files, strict=True):
        write_mcap(topics, path)
    stated = folder / "machine.toml"
    write_machine_file(stated, log.stated, log.known)
    return paths, stated


#: Of the instruments, what the truth tells.
_ERRORS: Final = (
    *("force_gain", "gain_drift", "force_offset_N", "acc_bias_m_s2", "tilt_rad", "slip_1_N"),
    *("share", "pitch_hz", "boom_hz"),
)


def _spillage(seed: int) -> tuple[float, float]:
    """What the site knows of a load that pours: the mean share, as a check weighing tells it."""
    mean = sum(POURED_SHARE) / 2.0
    dice = np.random.default_rng([seed, 25_003])
    return round(float(dice.normal(mean, SPILLAGE_U)), 3), SPILLAGE_U


def _instruments(dice: np.random.Generator, driver: Driver, plant: Plant) -> Instruments:
    habits = driver.habits
    pitch = "slope, no pitch" not in habits and ("slope, pitch" in habits or dice.random() < 0.5)
    rates = dice.choice([50.0, 100.0], 3)
    return drawn_instruments(dice, plant.mass_kg)._replace(
        force_gain=float(dice.normal(1.0, GAIN_U)),
        gain_drift=float(dice.normal(0.0, _DRIFT)),
        force_offset_N=float(dice.normal(0.0, _OFFSET_SHARE)) * plant.force_max_N,
        acc_bias_m_s2=float(dice.normal(0.0, _BIAS_M_S2)),
        tilt_rad=float(np.deg2rad(dice.normal(0.0, _TILT_DEG))),
        slip_1_N=abs(float(dice.normal(0.0, _SLIP_SHARE))) / plant.force_max_N,
        pitch_noise_rad=0.003,
        force_hz=float(rates[0]),
        imu_hz=float(rates[1]),
        speed_hz=float(rates[2]),
        pitch_hz=50.0 if pitch else 0.0,
        boom_hz=0.0 if "no boom" in habits else float(dice.choice([10.0, 20.0, 50.0])),
    )


def _ended(dice: np.random.Generator, motion: Motion, dumps: list[int]) -> Motion:
    """Two of five recordings end anywhere, the others some time after a dump."""
    ends_s = motion.leg_starts_s[np.asarray(dumps) + 1]
    ended_s = ends_s[ends_s < motion.duration_s]
    if dice.random() < 0.4 or not ended_s.size:
        return motion
    last_s = min(float(ended_s[-1]) + float(dice.uniform(2.0, 30.0)), motion.duration_s)
    rows = round(last_s / STEP_S)
    channels = {name: values[:rows] for name, values in motion.channels.items()}
    return Motion(channels, np.minimum(motion.leg_starts_s, last_s), whole=motion.whole)


def _dumps(motion: Motion, legs: list[Leg], dumps: list[int]) -> list[tuple[float, float]]:
    """When each bucket was emptied, s, and what it lost, kg."""
    load_kg = motion.channels["load_kg"]
    found: list[tuple[float, float]] = []
    for number in dumps:
        begin, end = np.round(motion.leg_starts_s[number : number + 2] / STEP_S).astype(int)
        if end - begin < 2:
            break
        part = load_kg[begin : min(end, load_kg.size)].astype(np.float64)
        lost_kg = float(part[0] - part[-1])
        whole_kg = float(part[0]) - legs[number].load_to_kg
        # one who creeps may drive off with a rest; a recording that ends while it dumps has that
        # dump when most of it is out
        if end < load_kg.size or lost_kg > 0.9 * whole_kg:
            half = int(np.argmax(part <= part[0] - _OUT * lost_kg))
            found.append(((begin + half) * STEP_S, lost_kg))
    return found


def _split(
    dice: np.random.Generator, topics: dict[str, Readings], ends_s: float
) -> tuple[list[dict[str, Readings]], list[tuple[float, float]]]:
    """The files of a recorder that restarts, and when it recorded nothing."""
    cuts = np.sort(dice.uniform(0.1, 0.9, int(dice.integers(0, 4)))) * ends_s
    holes = [(float(cut), float(cut + dice.uniform(*_RESTART_S))) for cut in cuts]
    edges = [0.0, *(time for hole in holes for time in hole), 2.0 * ends_s]
    files: list[dict[str, Readings]] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        part = {name: _between(each, begin, end) for name, each in topics.items()}
        # a recorder that restarts at once has nothing to write
        if all(each.stamp_ns.size for each in part.values()):
            files.append(part)
    return files, holes


def _between(readings: Readings, begin_s: float, end_s: float) -> Readings:
    at_s = (readings.log_ns - EPOCH_NS) / 1e9
    kept = (at_s >= begin_s) & (at_s < end_s)
    values = {name: each[kept] for name, each in readings.values.items()}
    return Readings(readings.stamp_ns[kept], readings.log_ns[kept], values)
