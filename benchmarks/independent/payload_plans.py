"""Payload by difference: machines, situations, and what is driven empty and then loaded."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from benchmarks.independent.legs import DRIVE, STAND, THROTTLE, WHOLE_LEG, Leg
from benchmarks.independent.machine import GRAVITY_M_S2, Plant
from benchmarks.independent.machine_file import Known
from benchmarks.independent.plant import Motion, drive
from benchmarks.independent.sensors import Instruments, Readings, measured

#: Starts without a load, then as many with it.
PLANS: Final = {"5+5": 5, "9+9": 9}
#: Payloads, and what they are of the machine's mass.
PAYLOAD_KG: Final = (50.0, 1000.0)
PAYLOAD_SHARE: Final = (0.015, 0.30)
MASS_KG: Final = (800.0, 8000.0)
#: What is left of the weakest start's acceleration when all that holds is taken off, m/s².
_LEFT_M_S2: Final = 0.4
#: Slip is stated for a machine of this mass.
_SLIP_MASS_KG: Final = 3600.0
_LONGEST_S: Final = 900.0
#: Gentle brakes end a stop from this speed on.
_TAIL_M_S: Final = 0.6
_TRIES: Final = 200


class Situation(NamedTuple):
    """What is wrong with a log; shares are of the force at full throttle.

    Attributes:
        acc_bias_m_s2: of the accelerometer.
        tilt_deg: of it, nose up.
        rolling_1: rolling resistance over the weight.
        rolling_speed_s_m: by what share that grows per m/s.
        offset_share: offset of the force.
        coulomb_share: dry friction.
        squat_deg_s2_m: pitch per m/s² of the empty machine,
        squat_by_mass: growing with the mass.
        sag_deg: nose down under a load of a tenth of the machine.
        gain_drift: of the force over the log; its sign is drawn.
        fills: whether the bucket fills during every start with a load.
        warming: share of the viscous friction that is gone in the end.
        tail_m_s2: brakes that no sensor sees end every stop from a walking speed; 0: as drawn.
        slip_N: force over the share of its speed that it makes the wheels slip, per 3.6 t.
        kinematic: acceleration from the wheels.
        share_per_load: change of the measured wheels' share under a load as heavy as the machine.
        slope_deg: of the ground, without a pitch channel; its sign is drawn.
        wander: how many times as usual force and accelerometer wander slowly.
        ways: 1 forward only, 2 alternating, 0 either.
    """

    acc_bias_m_s2: float = 0.0
    tilt_deg: float = 0.0
    rolling_1: float = 0.0
    rolling_speed_s_m: float = 0.0
    offset_share: float = 0.0
    coulomb_share: float = 0.0
    squat_deg_s2_m: float = 0.0
    squat_by_mass: bool = False
    sag_deg: float = 0.0
    gain_drift: float = 0.0
    fills: bool = False
    warming: float = 0.0
    tail_m_s2: float = 0.0
    slip_N: float = 0.0
    kinematic: bool = False
    share_per_load: float = 0.0
    slope_deg: float = 0.0
    wander: float = 1.0
    ways: int = 0


SITUATIONS: Final[Mapping[str, Situation]] = {
    "clean": Situation(),
    "bias +0.05": Situation(acc_bias_m_s2=0.05),
    "bias -0.05": Situation(acc_bias_m_s2=-0.05),
    "bias +0.1": Situation(acc_bias_m_s2=0.1),
    "bias -0.1": Situation(acc_bias_m_s2=-0.1),
    "tilt 0.3": Situation(tilt_deg=0.3),
    "tilt 1": Situation(tilt_deg=1.0),
    "rolling 1 one way": Situation(rolling_1=0.01, ways=1),
    "rolling 2 one way": Situation(rolling_1=0.02, ways=1),
    "rolling 3 one way": Situation(rolling_1=0.03, ways=1),
    "rolling 1 both ways": Situation(rolling_1=0.01, ways=2),
    "rolling 2 both ways": Situation(rolling_1=0.02, ways=2),
    "rolling 3 both ways": Situation(rolling_1=0.03, ways=2),
    "rolling 2 by speed": Situation(rolling_1=0.02, rolling_speed_s_m=0.05),
    "rolling 4 by speed": Situation(rolling_1=0.04, rolling_speed_s_m=0.05),
    "offset 5": Situation(offset_share=0.05),
    "Coulomb 5": Situation(coulomb_share=0.05),
    "squat 0.3": Situation(squat_deg_s2_m=0.3),
    "squat 0.3 by mass": Situation(squat_deg_s2_m=0.3, squat_by_mass=True),
    "sag 0.3": Situation(sag_deg=0.3),
    "drift 0.5": Situation(gain_drift=0.005),
    "drift 1": Situation(gain_drift=0.01),
    "drift 5": Situation(gain_drift=0.05),
    "filling": Situation(fills=True),
    "warming 25": Situation(warming=0.25),
    "gentle brakes": Situation(tail_m_s2=0.1),
    "slip 80": Situation(slip_N=80e3, kinematic=True),
    "slip 40": Situation(slip_N=40e3, kinematic=True),
    "share by load": Situation(share_per_load=0.05),
    "slope 0.5": Situation(slope_deg=0.5),
    "wander 4": Situation(wander=4.0),
}


@dataclass(frozen=True)
class PayloadTruth:
    """What is true of a log.

    Attributes:
        empty_kg: mass of the machine.
        payload_kg: at the end of each start with a load,
        payload_begin_kg: and at its beginning.
        empty_to_s: when it stood after its last start without a load, from the start of the log,
        loaded_from_s: and when the first one with it began.
        force_N: at full throttle.
        ways: 1 forward only, 2 alternating.
        starts: with a load, and as many without.
    """

    empty_kg: float
    payload_kg: float
    payload_begin_kg: float
    empty_to_s: float
    loaded_from_s: float
    force_N: float
    ways: int
    starts: int

    @property
    def mean_kg(self) -> float:
        """The mean of a load that grows."""
        return (self.payload_kg + self.payload_begin_kg) / 2.0

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return asdict(self)


class PayloadLog(NamedTuple):
    """A log in memory."""

    topics: dict[str, Readings]
    instruments: Instruments
    known: Known
    truth: PayloadTruth
    motion: Motion


class _Habits(NamedTuple):
    """How someone drives.

    Attributes:
        throttle_least: of a start; 1 is the most.
        start_s: how long the throttle is held,
        stand_s: and how long the machine stands before.
        brake_m_s2: gentlest and harshest stop.
        seen_1: share of a stop that the force sensors see.
        tail_m_s2: unseen brakes at the end of a stop, 0 for none.
        ways: 1 forward only, 2 alternating.
    """

    throttle_least: float
    start_s: float
    stand_s: float
    brake_m_s2: tuple[float, float]
    seen_1: float
    tail_m_s2: float
    ways: int


def payload_log(situation: Situation, starts: int, seed: int) -> PayloadLog:
    """Draw a machine and its log.

    Args:
        situation: what is wrong.
        starts: without a load, and as many with it.
        seed: of everything that is drawn.
    """
    dice = np.random.default_rng([seed, starts, 25_001])
    plant, payload_kg, habits = _machine(dice, situation)
    fill_1 = float(dice.uniform(0.25, 1.0)) if situation.fills else 0.0
    begin_kg = payload_kg * (1.0 - fill_1)
    legs = _legs(dice, habits, starts, (begin_kg, payload_kg))
    # friction warms over the log, whose length the first drive tells
    once = drive(plant, legs, _LONGEST_S)
    plant = plant._replace(warming_share=situation.warming, warming_s=once.duration_s)
    motion = drive(plant, legs, _LONGEST_S) if situation.warming else once
    assert motion.whole
    # a stand and a drive are one start; the load comes in a longer stand
    stood_s, loaded_s = map(float, motion.leg_starts_s[2 * starts : 2 * starts + 2])
    seen = _instruments(dice, situation, plant)
    truth = PayloadTruth(
        plant.mass_kg,
        payload_kg,
        begin_kg,
        stood_s,
        loaded_s,
        plant.force_max_N,
        habits.ways,
        starts,
    )
    known = Known(
        plant.mass_kg, kinematic=situation.kinematic, empty_s=(0.0, (stood_s + loaded_s) / 2.0)
    )
    topics = measured(dice, seen, motion, plant.mass_kg)
    return PayloadLog(topics, seen, known, truth, motion)


def _machine(dice: np.random.Generator, situation: Situation) -> tuple[Plant, float, _Habits]:
    for _ in range(_TRIES):
        mass_kg = float(np.exp(dice.uniform(*np.log(MASS_KG))))
        payload_kg = mass_kg * float(np.exp(dice.uniform(*np.log(PAYLOAD_SHARE))))
        force_N = mass_kg * float(dice.uniform(1.1, 2.2))
        least = float(dice.uniform(0.4, 1.0))
        ways = int(dice.integers(1, 3))
        brakes = (float(dice.uniform(0.4, 0.9)), float(dice.uniform(0.9, 2.5)))
        seen_1 = float(dice.uniform(0.3, 1.0))
        slope = float(dice.choice([-1.0, 1.0])) * np.deg2rad(situation.slope_deg)
        habits = _Habits(
            least,
            float(dice.uniform(2.0, 4.0)),
            float(dice.uniform(3.0, 6.0)),
            brakes,
            seen_1,
            situation.tail_m_s2,
            situation.ways or ways,
        )
        plant = Plant(
            mass_kg,
            mass_kg * float(dice.uniform(0.3, 1.2)),
            force_N,
            coulomb_N=situation.coulomb_share * force_N,
            rolling_1=situation.rolling_1,
            rolling_far_1=situation.rolling_1,
            rolling_speed_s_m=situation.rolling_speed_s_m,
            slope_rad=float(slope),
            drive_lag_s=float(dice.uniform(0.08, 0.25)),
            brake_lag_s=float(dice.uniform(0.05, 0.15)),
            stick_share=float(dice.uniform(0.0, 0.06)),
            stick_hz=float(dice.uniform(0.3, 1.5)),
            squat_s2_m=float(np.deg2rad(situation.squat_deg_s2_m)),
            squat_by_mass=float(situation.squat_by_mass),
            sag_rad_kg=float(np.deg2rad(situation.sag_deg)) / (0.1 * mass_kg),
        )
        heaviest_kg = mass_kg + payload_kg
        held_m_s2 = plant.coulomb_N / heaviest_kg
        held_m_s2 += GRAVITY_M_S2 * (plant.rolling_1 + abs(plant.slope_rad))
        drivable = least * force_N / heaviest_kg - held_m_s2 > _LEFT_M_S2
        if drivable and PAYLOAD_KG[0] <= payload_kg <= PAYLOAD_KG[1]:
            return plant, payload_kg, habits
    raise AssertionError(f"no machine of {_TRIES} can drive {situation}")


def _legs(
    dice: np.random.Generator, habits: _Habits, starts: int, load_kg: tuple[float, float]
) -> list[Leg]:
    """A stand and a drive for each start; the load comes in a longer stand in the middle."""
    legs: list[Leg] = []
    fills = load_kg[1] > load_kg[0]
    for number in range(2 * starts):
        loaded = number >= starts
        stand_s = habits.stand_s * float(dice.uniform(0.9, 1.1))
        if number == starts:
            stand_s += float(dice.uniform(8.0, 15.0))
        start_s = habits.start_s * float(dice.uniform(0.85, 1.15))
        backward = habits.ways == 2 and number % 2 == 1
        # a bucket that fills during a start has been emptied to the same again before the next
        carried = load_kg if loaded else (0.0, 0.0)
        stand = Leg(
            STAND,
            duration_s=stand_s,
            load_to_kg=carried[0],
            load_rate_kg_s=1.5 * max(load_kg[1], 1.0) / stand_s,
            load_when=WHOLE_LEG,
        )
        going = Leg(
            DRIVE,
            direction=-1.0 if backward else 1.0,
            throttle=float(dice.uniform(habits.throttle_least, 1.0)),
            rise_s=float(dice.uniform(0.15, 0.6)),
            start_s=start_s,
            cruise_s=float(dice.uniform(1.0, 4.0)),
            brake_m_s2=float(dice.uniform(*habits.brake_m_s2)),
            seen_1=habits.seen_1,
            tail_m_s=_TAIL_M_S if habits.tail_m_s2 else 0.0,
            tail_m_s2=habits.tail_m_s2,
            load_to_kg=carried[1],
            load_rate_kg_s=(load_kg[1] - load_kg[0]) / start_s if loaded and fills else 0.0,
            load_when=THROTTLE,
        )
        legs += [stand, going]
    legs.append(Leg(STAND, duration_s=3.0))
    return legs


#: Noise of a force sensor on a machine of 3.6 t, N; half to twice of it is drawn.
_FORCE_NOISE_N: Final = 60.0
_ACC_NOISE_M_S2: Final = 0.012
#: What wanders by up to so much, N at 3.6 t and m/s².
_FORCE_WANDER_N: Final = 6.0
_ACC_WANDER_M_S2: Final = 0.001
_SPEED_NOISE_M_S: Final = 0.005


def drawn_instruments(dice: np.random.Generator, mass_kg: float) -> Instruments:
    """Instruments without any fault but noise: each topic at a rate of its own."""
    rates = dice.choice([50.0, 100.0, 100.0, 200.0], 3)
    size = mass_kg / _SLIP_MASS_KG
    return Instruments(
        two_sides=bool(dice.random() < 0.6),
        share=float(dice.choice([0.5, 1.0])),
        radius_m=round(float(dice.uniform(0.35, 0.7)), 3),
        force_noise_N=_FORCE_NOISE_N * size * float(dice.uniform(0.5, 2.0)),
        force_wander_N=_FORCE_WANDER_N * size * float(dice.uniform(0.0, 1.0)),
        wander_s=float(dice.uniform(2.0, 15.0)),
        acc_noise_m_s2=_ACC_NOISE_M_S2 * float(dice.uniform(0.5, 2.0)),
        acc_wander_m_s2=_ACC_WANDER_M_S2 * float(dice.uniform(0.0, 1.0)),
        vibration_m_s2=float(dice.uniform(0.0, 0.1)),
        vibration_hz=float(dice.uniform(18.0, 38.0)),
        imu_height_m=float(dice.uniform(0.1, 0.6)),
        speed_noise_m_s=_SPEED_NOISE_M_S * float(dice.uniform(0.5, 2.0)),
        speed_step_m_s=float(dice.choice([0.0, 0.002, 0.01])),
        force_hz=float(rates[0]),
        imu_hz=float(rates[1]),
        speed_hz=float(rates[2]),
        jitter_s=float(dice.uniform(0.0, 0.0008)),
    )


def _instruments(dice: np.random.Generator, situation: Situation, plant: Plant) -> Instruments:
    sign = float(dice.choice([-1.0, 1.0]))
    slip_N = situation.slip_N * plant.mass_kg / _SLIP_MASS_KG
    seen = drawn_instruments(dice, plant.mass_kg)
    return seen._replace(
        force_wander_N=situation.wander * seen.force_wander_N,
        acc_wander_m_s2=situation.wander * seen.acc_wander_m_s2,
        share_per_load=situation.share_per_load,
        gain_drift=sign * situation.gain_drift,
        force_offset_N=sign * situation.offset_share * plant.force_max_N,
        acc_bias_m_s2=situation.acc_bias_m_s2,
        tilt_rad=float(np.deg2rad(situation.tilt_deg)),
        slip_1_N=1.0 / slip_N if slip_N else 0.0,
    )
