"""Shifts: machines, grounds and habits that are drawn, and the legs of their cycles."""

from typing import Final, NamedTuple

import numpy as np

from benchmarks.independent.legs import DIG, DRIVE, MOVING, STAND, WHOLE_LEG, Leg
from benchmarks.independent.machine import GRAVITY_M_S2, Plant

#: Machines, kg.
MASS_KG: Final = (1500.0, 8000.0)
#: Length of a shift, s.
DURATION_S: Final = (2400.0, 4200.0)
#: Rolling resistance over the weight,
ROLLING_1: Final = (0.005, 0.04)
#: and the standard deviation, as a share, of that at the dump from that at the pile: loaded starts
#: are on the one and empty ones on the other, so that all of it goes into the payload.
GROUNDS_DIFFER: Final = 0.25
#: How often a shift has a habit.
HABITS: Final = {
    "reverses out": 0.6,
    "hauls in reverse": 0.15,
    "creeps to dump": 0.25,
    "short cycles": 0.25,
    "gentle brakes": 0.3,
    "harsh brakes": 0.3,
    "boom moves driving": 0.4,
    "no boom": 0.25,
    "no digging": 0.25,
    "pours": 0.2,
    "spills": 0.2,
    "small loads": 0.2,
    "idles": 0.4,
    "slope, pitch": 0.4,
    "slope, no pitch": 0.25,
    "squats": 0.25,
    "warms": 0.5,
}
#: Share of a load that pours on a haul, where it pours.
POURED_SHARE: Final = (0.10, 0.25)
#: Boom angles, rad: on the ground, carrying, above the truck.
_GROUND_RAD, _CARRY_RAD, _HIGH_RAD = -0.5, 0.1, 0.9
_BOOM_RAD_S: Final = 0.7
#: Who creeps starts with this.
_CREEP_M_S2: Final = 0.5
#: A bucket is emptied in so many seconds.
_EMPTIES_S: Final = (1.5, 3.0)


class Driver(NamedTuple):
    """How a shift is driven.

    Attributes:
        habits: of `HABITS`, those that it has.
        haul_m: from the pile to the dump.
        out_m: how far it reverses out of the pile, or from the dump.
        load_share: mean load over the machine's mass,
        load_std_1: and its standard deviation over the mean.
        carry_back_kg: largest rest in the bucket.
        acc_m_s2: gentlest and sharpest start, whatever load and grade.
        top_m_s: it drives so fast at most.
        brake_m_s2: gentlest and harshest stop.
        seen_1: share of a stop that the force sensors see.
        pause_s: mean stand between two legs.
        approach_m: what it starts into the pile from.
        haul_starts: most starts of a haul.
    """

    habits: frozenset[str]
    haul_m: float
    out_m: float
    load_share: float
    load_std_1: float
    carry_back_kg: float
    acc_m_s2: tuple[float, float]
    top_m_s: float
    brake_m_s2: tuple[float, float]
    seen_1: float
    pause_s: float
    approach_m: float
    haul_starts: int


def drawn_driver(dice: np.random.Generator, mass_kg: float) -> Driver:
    """Habits, and what is driven by them."""
    habits = {name for name, chance in HABITS.items() if dice.random() < chance}
    if {"gentle brakes", "harsh brakes"} <= habits:
        habits.discard("harsh brakes")
    if "slope, pitch" in habits:
        habits.discard("slope, no pitch")
    if "hauls in reverse" in habits:
        habits.discard("reverses out")
    if "short cycles" in habits:
        habits.discard("gentle brakes")
    if "no boom" in habits:
        habits.discard("boom moves driving")
    short = "short cycles" in habits
    brakes = (0.5, 2.0)
    if "gentle brakes" in habits:
        brakes = (0.2, 0.5)
    elif "harsh brakes" in habits:
        brakes = (1.5, 2.8)
    small = "small loads" in habits
    out_m = float(dice.uniform(3.0, 4.5) if short else dice.uniform(4.0, 8.0))
    approach_m = float(dice.uniform(2.0, 5.0))
    between_m = float(dice.uniform(5.0, 8.0) if short else dice.uniform(12.0, 60.0))
    gentlest = float(dice.uniform(0.7, 1.0))
    return Driver(
        frozenset(habits),
        approach_m + out_m + between_m,
        out_m,
        0.04 if small else float(dice.uniform(0.08, 0.25)),
        float(dice.uniform(0.05, 0.2)),
        mass_kg * float(dice.uniform(0.0, 0.008)),
        (gentlest, gentlest + float(dice.uniform(0.1, 0.7))),
        float(dice.uniform(2.2, 4.5)),
        brakes,
        float(dice.uniform(0.3, 1.0)),
        float(dice.uniform(1.5, 2.2) if short else dice.uniform(1.8, 4.0)),
        approach_m,
        1 if short else int(dice.integers(1, 4)),
    )


def drawn_plant(dice: np.random.Generator, driver: Driver, mass_kg: float) -> Plant:
    """A machine that can start on its ground as its driver wants."""
    habits = driver.habits
    near = float(dice.uniform(*ROLLING_1))
    far = float(np.clip(near * np.exp(dice.normal(0.0, GROUNDS_DIFFER)), *ROLLING_1))
    slope_deg = hills_deg = 0.0
    if "slope, pitch" in habits:
        slope_deg, hills_deg = dice.uniform(-3.0, 3.0), dice.uniform(0.0, 1.5)
    if "slope, no pitch" in habits:
        slope_deg, hills_deg = dice.uniform(-1.0, 1.0), dice.uniform(0.0, 0.3)
    steep = float(np.deg2rad(abs(slope_deg) + hills_deg))
    held_m_s2 = GRAVITY_M_S2 * (max(near, far) + steep)
    heaviest_kg = mass_kg * (1.0 + 1.3 * driver.load_share)
    force_N = heaviest_kg * (held_m_s2 + driver.acc_m_s2[1]) * float(dice.uniform(1.1, 1.6))
    full_m = float(dice.uniform(0.8, 1.5))
    stalls_N = force_N * float(dice.uniform(0.7, 1.0))
    return Plant(
        mass_kg,
        mass_kg * float(dice.uniform(0.2, 0.6)),
        force_N,
        warming_share=float(dice.uniform(0.05, 0.25)) if "warms" in habits else 0.0,
        warming_s=DURATION_S[1],
        coulomb_N=abs(float(dice.normal(0.0, 0.02))) * force_N,
        rolling_1=near,
        rolling_far_1=far,
        rolling_split_m=driver.haul_m * float(dice.uniform(0.2, 0.8)),
        rolling_speed_s_m=float(dice.uniform(0.0, 0.05)),
        quadratic_N_s2_m2=abs(float(dice.normal(0.0, 0.01))) * force_N / driver.top_m_s**2,
        slope_rad=float(np.deg2rad(slope_deg)),
        hills_rad=float(np.deg2rad(hills_deg)),
        hills_length_m=float(dice.uniform(15.0, 70.0)),
        hills_phase_rad=float(dice.uniform(0.0, 2.0 * np.pi)),
        drive_lag_s=float(dice.uniform(0.08, 0.25)),
        brake_lag_s=float(dice.uniform(0.05, 0.15)),
        stick_share=float(dice.uniform(0.0, 0.08)),
        stick_hz=float(dice.uniform(0.3, 1.5)),
        squat_s2_m=float(np.deg2rad(dice.uniform(0.05, 0.25))) if "squats" in habits else 0.0,
        squat_by_mass=1.0,
        pile_N_m=0.4 * stalls_N / full_m,
        pile_N_m2=0.6 * stalls_N / full_m**2,
        pile_full_m=full_m,
    )


def on_hard_ground(plant: Plant) -> Plant:
    """The same machine on hard level ground, its springs stiff and its oil warm."""
    return plant._replace(
        rolling_1=0.0,
        rolling_far_1=0.0,
        rolling_speed_s_m=0.0,
        coulomb_N=0.0,
        quadratic_N_s2_m2=0.0,
        slope_rad=0.0,
        hills_rad=0.0,
        warming_share=0.0,
        squat_s2_m=0.0,
    )


class Cycle(NamedTuple):
    """The legs of one cycle, and in which of them it dumps."""

    legs: list[Leg]
    dump: int


class CycleLegs:
    """Makes cycles: pile at 0, dump at `haul_m`, digging faces down the track.

    Args:
        dice: of this shift.
        driver: its habits.
        plant: the machine and its ground.
    """

    def __init__(self, dice: np.random.Generator, driver: Driver, plant: Plant) -> None:
        self._dice = dice
        self._driver = driver
        self._plant = plant
        self._carried_kg = 0.0
        self._legs: list[Leg] = []

    def arrival(self) -> list[Leg]:
        """How the shift begins: empty, up the track and back to the pile."""
        driver = self._driver
        self._legs = []
        self._stand(5.0)
        self._drive(driver.haul_m / 2.0, 1.0, 1.0)
        self._pause()
        self._drive(driver.approach_m, -1.0, 1.0)
        self._pause()
        return self._legs

    def cycle(self) -> Cycle:
        """The next one: from in front of the pile to in front of the pile."""
        driver, dice = self._driver, self._dice
        self._legs = []
        if "idles" in driver.habits and dice.random() < 0.06:
            self._stand(float(dice.uniform(35.0, 240.0)))
        spread = float(dice.normal(1.0, driver.load_std_1))
        load_kg = self._plant.mass_kg * driver.load_share * min(max(spread, 0.5), 1.3)
        back_kg = driver.carry_back_kg * float(dice.uniform(0.0, 1.0))
        self._fill(load_kg)
        away = self._leave_pile()
        load_kg = self._haul(load_kg, away)
        dump = self._dump(back_kg, away)
        self._return(away)
        return Cycle(self._legs, dump)

    @property
    def _out_m(self) -> float:
        """Where the machine stands once it has left pile or hopper."""
        hopper = "no digging" in self._driver.habits
        return self._driver.out_m + (self._driver.approach_m if hopper else 0.0)

    @property
    def _boom(self) -> float:
        return self._legs[-1].boom_to_rad if self._legs else _GROUND_RAD

    def _stand(self, seconds: float, boom_rad: float | None = None, **more: float) -> None:
        boom_rad = self._boom if boom_rad is None else boom_rad
        self._legs.append(
            Leg(
                STAND,
                facing=self._legs[-1].facing if self._legs else -1.0,
                duration_s=seconds,
                boom_to_rad=boom_rad,
                boom_rate_rad_s=_BOOM_RAD_S,
                load_to_kg=self._carried_kg,
            )._replace(**more)
        )

    def _pause(self) -> None:
        self._stand(self._driver.pause_s * float(self._dice.uniform(0.8, 1.3)))

    def _throttle(self, acc_m_s2: float, way: float) -> float:
        """What starts so; way is 1 up the track, -1 down."""
        plant = self._plant
        held_m_s2 = GRAVITY_M_S2 * (plant.rolling_1 + plant.rolling_far_1) / 2.0
        held_m_s2 += way * GRAVITY_M_S2 * float(np.sin(plant.slope_rad))
        needed_N = (plant.mass_kg + self._carried_kg) * (held_m_s2 + acc_m_s2) + plant.coulomb_N
        return min(max(needed_N / plant.force_max_N, 0.1), 1.0)

    def _drive(self, to_m: float, facing: float, direction: float, **more: float) -> None:
        """Drive to a place, in the driver's way."""
        driver, dice = self._driver, self._dice
        gentle, harsh = driver.brake_m_s2
        brake = float(np.exp(dice.uniform(np.log(gentle), np.log(harsh))))
        made = Leg(
            DRIVE,
            direction=direction,
            facing=facing,
            throttle=self._throttle(float(dice.uniform(*driver.acc_m_s2)), facing * direction),
            rise_s=float(dice.uniform(0.2, 0.6)),
            start_s=float(dice.uniform(2.5, 5.0)),
            cruise_s=60.0,
            to_m=to_m,
            top_m_s=driver.top_m_s,
            brake_m_s2=brake,
            seen_1=driver.seen_1,
            load_to_kg=self._carried_kg,
            boom_to_rad=self._boom,
            boom_rate_rad_s=_BOOM_RAD_S,
        )
        self._legs.append(made._replace(**more))

    def _fill(self, load_kg: float) -> None:
        """Dig, or be loaded from above while standing."""
        dice, driver = self._dice, self._driver
        self._carried_kg = load_kg
        if "no digging" in driver.habits:
            seconds = float(dice.uniform(4.0, 9.0))
            rate = 1.5 * load_kg / seconds
            self._stand(seconds, _CARRY_RAD, load_rate_kg_s=rate, load_when=WHOLE_LEG)
            return
        self._legs.append(
            Leg(
                DIG,
                facing=-1.0,
                throttle=float(dice.uniform(0.75, 1.0)),
                rise_s=float(dice.uniform(0.3, 0.8)),
                to_m=0.0,
                top_m_s=float(dice.uniform(1.2, 2.5)),
                duration_s=float(dice.uniform(0.3, 1.5)),
                load_to_kg=load_kg * float(dice.uniform(0.6, 1.0)),
                boom_to_rad=_GROUND_RAD,
                boom_rate_rad_s=_BOOM_RAD_S,
            )
        )
        # the bucket is curled full, and lifted
        self._stand(
            float(dice.uniform(1.3, 2.2)),
            _CARRY_RAD,
            load_rate_kg_s=load_kg,
            load_when=WHOLE_LEG,
        )

    def _leave_pile(self) -> tuple[float, float]:
        """Facing and direction of the haul, once the machine is out of the pile."""
        driver = self._driver
        if "hauls in reverse" in driver.habits:
            return -1.0, -1.0
        if "reverses out" in driver.habits or "no digging" not in driver.habits:
            self._drive(self._out_m, -1.0, -1.0)
            self._pause()
        return 1.0, 1.0

    def _haul(self, load_kg: float, away: tuple[float, float]) -> float:
        """Drive to the dump, in one start or several; the load that arrives."""
        dice, driver = self._dice, self._driver
        if "spills" in driver.habits and dice.random() < 0.3:
            load_kg *= float(dice.uniform(0.85, 0.95))
            self._carried_kg = load_kg
            self._stand(1.0, load_rate_kg_s=load_kg, load_when=WHOLE_LEG)
        loses: dict[str, float] = {}
        if "pours" in driver.habits:
            lost_kg = load_kg * float(dice.uniform(*POURED_SHARE))
            load_kg -= lost_kg
            self._carried_kg = load_kg
            seconds = driver.haul_m / driver.top_m_s
            loses = {"load_rate_kg_s": lost_kg / seconds, "load_when": MOVING}
        starts = int(dice.integers(1, driver.haul_starts + 1))
        begin_m = self._out_m
        for number in range(1, starts + 1):
            place_m = begin_m + (driver.haul_m - begin_m) * number / starts
            boom: dict[str, float] = {}
            if number == starts and "boom moves driving" in driver.habits:
                boom = {"boom_to_rad": _HIGH_RAD, "boom_rate_rad_s": 0.2}
            self._drive(place_m, *away, **loses, **boom)
            if number < starts:
                self._pause()
        return load_kg

    def _dump(self, back_kg: float, away: tuple[float, float]) -> int:
        """Raise the boom and empty the bucket, standing or creeping; the leg that empties."""
        dice, driver = self._dice, self._driver
        seconds = float(dice.uniform(*_EMPTIES_S))
        rate = max(self._carried_kg - back_kg, 1.0) / seconds
        self._carried_kg = back_kg
        empties = {"load_to_kg": back_kg, "load_rate_kg_s": rate, "load_when": WHOLE_LEG}
        if self._boom < _HIGH_RAD:
            lifts_s = (_HIGH_RAD - self._boom) / _BOOM_RAD_S + float(dice.uniform(0.3, 0.8))
            self._stand(lifts_s, _HIGH_RAD)
        number = len(self._legs)
        if "creeps to dump" in driver.habits:
            self._drive(
                driver.haul_m + 50.0,
                *away,
                throttle=self._throttle(_CREEP_M_S2, away[0] * away[1]),
                start_s=6.0,
                cruise_s=seconds / 2.0,
                top_m_s=float(dice.uniform(0.25, 0.5)),
                **empties,
            )
            self._stand(float(dice.uniform(0.8, 1.5)))
        else:
            self._stand(seconds + float(dice.uniform(0.3, 1.0)), **empties)
        return number

    def _return(self, away: tuple[float, float]) -> None:
        """Back to where the pile is started into, the boom coming down on the way or before."""
        dice, driver = self._dice, self._driver
        down = _GROUND_RAD
        if "boom moves driving" not in driver.habits:
            self._stand((_HIGH_RAD - down) / _BOOM_RAD_S + 0.3, down)
        if away == (1.0, 1.0):
            self._drive(driver.haul_m - driver.out_m, 1.0, -1.0, boom_to_rad=down)
            self._pause()
        near_m = driver.approach_m * float(dice.uniform(0.8, 1.2))
        starts = int(dice.integers(1, max(driver.haul_starts, 2)))
        begin_m = driver.haul_m - driver.out_m
        for number in range(1, starts + 1):
            place_m = begin_m + (near_m - begin_m) * number / starts
            self._drive(place_m, -1.0, 1.0, boom_to_rad=down)
            self._pause()
