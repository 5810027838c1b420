"""The machine: straight drives of a wheel loader in steps of a millisecond, compiled.

A driver works through legs (stand, drive, dig). What moves the machine: a drive force behind a
first-order lag. What holds it: viscous friction that warms, Coulomb friction, rolling resistance in
proportion to the weight, a quadratic loss, grade, brakes, the pile. A body on springs pitches with
the acceleration and sinks with the load.
"""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.independent.legs import DIG, DRIVE, MOVING, STAND, THROTTLE, WHOLE_LEG, Leg, records
from benchmarks.independent.machine import GRAVITY_M_S2, Plant

Floats32 = NDArray[np.float32]

#: One step of the plant.
STEP_S: Final = 0.001

#: What is recorded, in this order.
CHANNELS: Final = (
    *("position_m", "speed_m_s", "acceleration_m_s2", "force_N", "load_kg"),
    *("pitch_rad", "squat_rad", "squat_acc_rad_s2", "boom_rad"),
)


class State(NamedTuple):
    """Of the machine and of its driver.

    Attributes:
        stage: of a leg that drives: 0 throttle, 1 cruise, 2 brake.
        entered_s: time since that stage began.
        leg_s: time since the leg began.
        set_m_s: speed that is cruised at.
        stalled_s: how long a leg that digs has stood still in the pile.
    """

    position_m: float
    speed_m_s: float
    force_N: float
    brake_N: float
    load_kg: float
    squat_rad: float
    squat_rate_rad_s: float
    boom_rad: float
    stage: int
    entered_s: float
    leg_s: float
    set_m_s: float
    stalled_s: float


#: A stand is held by a parking brake of this many times the weight.
_PARKING: Final = 1.0
#: Static friction over that of motion.
_STATIC: Final = 1.1
#: A cruising driver closes this share of the missing speed a second.
_CRUISE_GAIN_1_S: Final = 1.5
#: The throttle eases from so much below the top speed on.
_EASES_M_S: Final = 0.3
#: A leg that digs stands only after this time: it begins at rest.
_BEGINS_S: Final = 1.0
#: Slower than this stands.
_STANDS_M_S: Final = 1e-9


@njit(cache=True)
def grade_rad(plant: Plant, leg: Leg, position_m: float) -> float:
    """Grade of the ground, rising ahead of the machine."""
    wave = 2.0 * np.pi * position_m / plant.hills_length_m + plant.hills_phase_rad
    return leg.facing * (plant.slope_rad + plant.hills_rad * np.sin(wave))


@njit(cache=True)
def rolling_1(plant: Plant, position_m: float, speed_m_s: float) -> float:
    """Rolling resistance over the weight."""
    far = 0.5 + 0.5 * np.tanh(2.0 * (position_m - plant.rolling_split_m))
    here = plant.rolling_1 + far * (plant.rolling_far_1 - plant.rolling_1)
    return here * (1.0 + plant.rolling_speed_s_m * abs(speed_m_s))


@njit(cache=True)
def viscous_friction(plant: Plant, t_s: float) -> float:
    """Viscous friction at a time: most of its warming is early."""
    warm = (1.0 - np.exp(-2.5 * t_s / plant.warming_s)) / (1.0 - np.exp(-2.5))
    return plant.viscous_N_s_m * (1.0 - plant.warming_share * warm)


@njit(cache=True)
def _left_m(leg: Leg, state: State) -> float:
    """How far it is to where a leg leads; NaN where it leads nowhere."""
    return leg.facing * leg.direction * (leg.to_m - state.position_m)


@njit(cache=True)
def _pile_force(plant: Plant, leg: Leg, state: State) -> float:
    if leg.kind != DIG:
        return 0.0
    deep_m = max(-_left_m(leg, state), 0.0)
    return deep_m * (plant.pile_N_m + plant.pile_N_m2 * deep_m)


@njit(cache=True)
def _holding_force(plant: Plant, leg: Leg, state: State, mass_kg: float) -> float:
    """What opposes any motion whatever its speed: dry friction, rolling, brakes, pile."""
    weight_N = mass_kg * GRAVITY_M_S2 * np.cos(grade_rad(plant, leg, state.position_m))
    rolling_N = rolling_1(plant, state.position_m, state.speed_m_s) * weight_N
    return plant.coulomb_N + rolling_N + state.brake_N + _pile_force(plant, leg, state)


@njit(cache=True)
def _driving_force(plant: Plant, leg: Leg, state: State, mass_kg: float, t_s: float) -> float:
    """All other forces."""
    speed = state.speed_m_s
    grade_N = mass_kg * GRAVITY_M_S2 * np.sin(grade_rad(plant, leg, state.position_m))
    viscous_N = viscous_friction(plant, t_s) * speed
    return state.force_N - viscous_N - plant.quadratic_N_s2_m2 * speed * abs(speed) - grade_N


@njit(cache=True)
def _load_rate(plant: Plant, leg: Leg, state: State) -> float:
    """Change of the load, kg/s."""
    if leg.kind == DIG:
        deep_m = max(-_left_m(leg, state), 0.0)
        wanted = leg.load_to_kg * min(deep_m / plant.pile_full_m, 1.0)
        return max(wanted - state.load_kg, 0.0) / STEP_S
    active = (
        leg.load_when == WHOLE_LEG
        or (leg.load_when == THROTTLE and leg.kind == DRIVE and state.stage == 0)
        or (leg.load_when == MOVING and abs(state.speed_m_s) > 0.0)
    )
    if not active:
        return 0.0
    missing = leg.load_to_kg - state.load_kg
    most = leg.load_rate_kg_s
    return min(max(missing / STEP_S, -most), most)


@njit(cache=True)
def _commanded_force(plant: Plant, leg: Leg, state: State, mass_kg: float, t_s: float) -> float:
    """What the driver asks of the drive."""
    if leg.kind == STAND:
        return 0.0
    if state.stage == 2:
        drives = abs(state.speed_m_s) > leg.tail_m_s
        return -np.sign(state.speed_m_s) * leg.seen_1 * mass_kg * leg.brake_m_s2 * drives
    if state.stage == 1:
        steady_N = state.force_N - _driving_force(plant, leg, state, mass_kg, t_s)
        steady_N += leg.direction * _holding_force(plant, leg, state, mass_kg)
        wanted_N = steady_N + mass_kg * _CRUISE_GAIN_1_S * (state.set_m_s - state.speed_m_s)
        return min(max(wanted_N, -plant.force_max_N), plant.force_max_N)
    risen = min(state.leg_s / leg.rise_s, 1.0)
    if leg.kind == DIG:
        # nobody drives into a pile faster than this, and everybody with all there is once in it
        risen *= min(max((leg.top_m_s - abs(state.speed_m_s)) / _EASES_M_S, 0.0), 1.0)
    hand = 1.0 + plant.stick_share * np.sin(2.0 * np.pi * plant.stick_hz * t_s)
    smooth = risen * risen * (3.0 - 2.0 * risen)
    return leg.direction * leg.throttle * plant.force_max_N * smooth * hand


@njit(cache=True)
def _moved(plant: Plant, leg: Leg, state: State, mass_kg: float, t_s: float) -> tuple[float, float]:
    """Speed and acceleration after a step."""
    holding_N = _holding_force(plant, leg, state, mass_kg)
    driving_N = _driving_force(plant, leg, state, mass_kg, t_s)
    speed = state.speed_m_s
    if abs(speed) < _STANDS_M_S:
        if leg.kind == STAND:
            holding_N += _PARKING * mass_kg * GRAVITY_M_S2
        if abs(driving_N) <= _STATIC * holding_N:
            return 0.0, 0.0
        rate = (driving_N - np.sign(driving_N) * holding_N) / mass_kg
        return rate * STEP_S, rate
    # what is picked up while driving has to be brought to speed
    picked_N = max(_load_rate(plant, leg, state), 0.0) * speed
    rate = (driving_N - picked_N - np.sign(speed) * holding_N) / mass_kg
    after = speed + rate * STEP_S
    # friction stops, it does not turn round
    if after * speed < 0.0:
        return 0.0, -speed / STEP_S
    return after, rate


@njit(cache=True)
def _arrives(plant: Plant, leg: Leg, state: State, mass_kg: float, t_s: float) -> bool:
    """Whether it is time to brake for the place that a leg leads to."""
    speed = abs(state.speed_m_s)
    friction_N = plant.coulomb_N + viscous_friction(plant, t_s) * speed / 2.0
    held_m_s2 = friction_N / mass_kg
    held_m_s2 += rolling_1(plant, state.position_m, speed) * GRAVITY_M_S2
    # NaN is never less
    return _left_m(leg, state) <= speed * speed / (2.0 * (leg.brake_m_s2 + held_m_s2))


@njit(cache=True)
def _next_stage(plant: Plant, leg: Leg, state: State, mass_kg: float, t_s: float) -> int:
    """The stage of a leg that drives."""
    if state.stage == 2 or _arrives(plant, leg, state, mass_kg, t_s):
        return 2
    if state.stage == 1:
        return 2 if state.entered_s >= leg.cruise_s else 1
    fast = abs(state.speed_m_s) >= leg.top_m_s
    return 1 if fast or state.entered_s >= leg.start_s else 0


@njit(cache=True)
def _leg_over(leg: Leg, state: State) -> bool:
    if leg.kind == DRIVE:
        return state.stage == 2 and state.speed_m_s == 0.0 and state.entered_s > 0.1
    if leg.kind == DIG:
        return state.stalled_s >= leg.duration_s
    return state.leg_s >= leg.duration_s


@njit(cache=True)
def _brake_m_s2(plant: Plant, leg: Leg, state: State) -> float:
    """What the brakes are asked for; a stand is held by a parking brake, which is gone at once."""
    if leg.kind != DRIVE or state.stage < 2:
        return 0.0
    # downhill they hold the weight as well
    along = np.sign(state.speed_m_s) * np.sin(grade_rad(plant, leg, state.position_m))
    holds = max(-GRAVITY_M_S2 * along, 0.0)
    if abs(state.speed_m_s) <= leg.tail_m_s:
        return leg.tail_m_s2 + holds
    return (1.0 - leg.seen_1) * leg.brake_m_s2 + holds


@njit(cache=True)
def _towards(value: float, target: float, rate: float) -> float:
    return value + min(max(target - value, -rate * STEP_S), rate * STEP_S)


@njit(cache=True)
def stepped(plant: Plant, leg: Leg, state: State, t_s: float) -> tuple[State, float, float]:
    """The state a step later, the acceleration, and the acceleration of the pitch."""
    mass_kg = plant.mass_kg + state.load_kg
    command_N = _commanded_force(plant, leg, state, mass_kg, t_s)
    brake_N = mass_kg * _brake_m_s2(plant, leg, state)
    speed, rate = _moved(plant, leg, state, mass_kg, t_s)
    heavier = 1.0 + plant.squat_by_mass * (mass_kg / plant.mass_kg - 1.0)
    aim_rad = plant.squat_s2_m * heavier * rate - plant.sag_rad_kg * state.load_kg
    turn = 2.0 * np.pi * plant.pitch_hz
    squat_acc = turn**2 * (aim_rad - state.squat_rad)
    squat_acc -= 2.0 * plant.pitch_damping * turn * state.squat_rate_rad_s
    squat_rate = state.squat_rate_rad_s + squat_acc * STEP_S
    stage, entered_s, set_m_s = state.stage, state.entered_s + STEP_S, state.set_m_s
    if leg.kind == DRIVE:
        stage = _next_stage(plant, leg, state, mass_kg, t_s)
    if stage != state.stage:
        entered_s, set_m_s = 0.0, state.speed_m_s
    stands = leg.kind == DIG and speed == 0.0 and state.leg_s > _BEGINS_S
    after = State(
        state.position_m + leg.facing * 0.5 * (state.speed_m_s + speed) * STEP_S,
        speed,
        state.force_N + (command_N - state.force_N) * STEP_S / plant.drive_lag_s,
        state.brake_N + (brake_N - state.brake_N) * STEP_S / plant.brake_lag_s,
        max(state.load_kg + _load_rate(plant, leg, state) * STEP_S, 0.0),
        state.squat_rad + squat_rate * STEP_S,
        squat_rate,
        _towards(state.boom_rad, leg.boom_to_rad, leg.boom_rate_rad_s),
        stage,
        entered_s,
        state.leg_s + STEP_S,
        set_m_s,
        state.stalled_s + STEP_S if stands else 0.0,
    )
    return after, rate, squat_acc


@njit(cache=True)
def _leg_begun(state: State) -> State:
    return State(
        state.position_m,
        state.speed_m_s,
        state.force_N,
        state.brake_N,
        state.load_kg,
        state.squat_rad,
        state.squat_rate_rad_s,
        state.boom_rad,
        0,
        0.0,
        0.0,
        0.0,
        0.0,
    )


@njit(cache=True)
def _driven(plant: Plant, legs: NDArray[Any], rows: Floats32, begins: NDArray[np.int64]) -> int:
    state = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0, 0.0, 0.0, 0.0)
    row = 0
    for number in range(legs.size):
        leg = legs[number]
        state = _leg_begun(state)
        begins[number] = row
        while row < rows.shape[1] and not _leg_over(leg, state):
            after, rate, squat_acc = stepped(plant, leg, state, row * STEP_S)
            rows[0, row] = state.position_m
            rows[1, row] = state.speed_m_s
            rows[2, row] = rate
            rows[3, row] = state.force_N
            rows[4, row] = state.load_kg
            rows[5, row] = grade_rad(plant, leg, state.position_m) + state.squat_rad
            rows[6, row] = state.squat_rad
            rows[7, row] = squat_acc
            rows[8, row] = state.boom_rad
            state = after
            row += 1
    begins[legs.size] = row
    return row


class Motion(NamedTuple):
    """What happened.

    Attributes:
        channels: (rows,) each of `CHANNELS`, a row a step.
        leg_starts_s: (legs + 1,) when each leg began, and when the last ended.
        whole: whether all legs were driven in the time.
    """

    channels: dict[str, Floats32]
    leg_starts_s: NDArray[np.float64]
    whole: bool

    @property
    def duration_s(self) -> float:
        """Of all of it."""
        return float(self.leg_starts_s[-1])


def drive(plant: Plant, legs: Sequence[Leg], longest_s: float) -> Motion:
    """Drive through the legs.

    Args:
        plant: the machine and its ground.
        legs: one after another.
        longest_s: where it ends at the latest.
    """
    rows = np.zeros((len(CHANNELS), round(longest_s / STEP_S)), np.float32)
    begins = np.zeros(len(legs) + 1, np.int64)
    count = _driven(plant, records(legs), rows, begins)
    named = {name: rows[at, :count] for at, name in enumerate(CHANNELS)}
    return Motion(named, begins.astype(np.float64) * STEP_S, whole=count < rows.shape[1])
