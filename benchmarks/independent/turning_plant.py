"""A skid-steered machine in the plane, in steps of a millisecond, compiled.

Newton and Euler about the centre of mass. Two sides push; four tyres resist sliding sideways, each
by the weight that it carries and no more than it grips, so that the machine slides and turns about
a point that moves; what is in proportion to the yaw rate at first is not later.
"""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.independent.machine import GRAVITY_M_S2

Floats = NDArray[np.float64]

#: One step of the plant.
STEP_S: Final = 0.001
#: What is recorded, in this order; the accelerations are specific forces of the origin.
CHANNELS: Final = (
    *("force_left_N", "force_right_N", "speed_m_s", "sideways_m_s", "yaw_rate_rad_s"),
    *("acc_x_m_s2", "acc_y_m_s2", "yaw_acc_rad_s2"),
)

#: Kinds of leg: stand on the brakes, push (ramps), keep speeds, wave (triangles), brake.
STAND, PUSH, KEEP, WAVE, STOP = 0, 1, 2, 3, 4

#: Dry friction is whole from this speed on, m/s or rad/s.
_DRY: Final = 0.004
#: A driver who keeps speeds closes this share of what is missing a second.
_KEEPS_1_S: Final = 3.0
#: Brakes that no sensor sees, a share of the speed a second.
_BRAKES_1_S: Final = 4.0


class Turner(NamedTuple):
    """Body, ground and drive.

    Attributes:
        mass_kg: of it.
        com_x_m: centre of mass ahead of the origin, midway between the wheels,
        com_y_m: and to the left.
        inertia_kg_m2: about the vertical through the centre of mass.
        half_base_m: wheels ahead of and behind the origin.
        half_track_m: and beside it.
        com_height_m: which moves weight to the rear as it accelerates.
        viscous_N_s_m: friction along the machine.
        coulomb_N: dry friction along it.
        rolling_1: rolling resistance over the weight.
        turning_N_m: dry friction of turning.
        turning_N_m_s: viscous friction of turning.
        grip_1: what a tyre grips sideways over its load.
        grip_m_s: sliding speed at which that is three quarters used.
        warming_1: share of the viscous frictions that is gone in the end.
        slope_rad: of the ground.
        slope_to_rad: towards where it rises, from where the machine first looks.
    """

    mass_kg: float
    com_x_m: float
    com_y_m: float
    inertia_kg_m2: float
    half_base_m: float
    half_track_m: float
    com_height_m: float
    viscous_N_s_m: float
    coulomb_N: float
    rolling_1: float
    turning_N_m: float
    turning_N_m_s: float
    grip_1: float
    grip_m_s: float
    warming_1: float
    slope_rad: float
    slope_to_rad: float

    @property
    def inertia_origin_kg_m2(self) -> float:
        """About the vertical through the origin."""
        return self.inertia_kg_m2 + self.mass_kg * (self.com_x_m**2 + self.com_y_m**2)


class TurnLeg(NamedTuple):
    """One thing that the driver does.

    Attributes:
        kind: stand, push, keep, wave or stop.
        duration_s: of it.
        force_N: pushed up to, or amplitude of a wave about `mean_N`.
        torque_N_m: likewise.
        mean_N: of a wave.
        force_period_s: of a wave,
        torque_period_s: of a wave.
        speed_m_s: to keep,
        yaw_rate_rad_s: to keep.
    """

    kind: float
    duration_s: float
    force_N: float = 0.0
    torque_N_m: float = 0.0
    mean_N: float = 0.0
    force_period_s: float = 1.0
    torque_period_s: float = 1.0
    speed_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0


_RECORD: Final = np.dtype([(name, "f8") for name in TurnLeg._fields])


@njit(cache=True)
def _triangle(t_s: float, period_s: float) -> float:
    share = (t_s / period_s) % 1.0
    return 1.0 - 4.0 * abs(share - 0.5)


@njit(cache=True)
def _side_friction(m: Turner, u: float, w: float) -> tuple[float, float]:
    """Dry friction and rolling resistance of the left and the right side, each by its own speed."""
    side_N = (m.coulomb_N + m.rolling_1 * m.mass_kg * GRAVITY_M_S2) / 2.0
    over = m.half_track_m * w
    return side_N * np.tanh((u - over) / _DRY), side_N * np.tanh((u + over) / _DRY)


@njit(cache=True)
def _asked(m: Turner, leg: Any, t_s: float, u: float, w: float) -> tuple[float, float]:
    """Force and yaw torque that the driver asks of the drive."""
    if leg.kind == PUSH:
        risen = t_s / leg.duration_s
        return leg.force_N * risen, leg.torque_N_m * risen
    if leg.kind == WAVE:
        return (
            leg.mean_N + leg.force_N * _triangle(t_s, leg.force_period_s),
            leg.torque_N_m * _triangle(t_s, leg.torque_period_s),
        )
    if leg.kind == KEEP:
        begun = min(t_s / 2.0, 1.0)
        aim_u, aim_w = begun * leg.speed_m_s, begun * leg.yaw_rate_rad_s
        inertia = m.inertia_kg_m2 + m.mass_kg * (m.com_x_m**2 + m.com_y_m**2)
        base = m.grip_1 * m.mass_kg * GRAVITY_M_S2 * m.half_base_m
        scrub = base * np.tanh(aim_w * m.half_base_m / m.grip_m_s)
        left_N, right_N = _side_friction(m, aim_u, aim_w)
        force = m.viscous_N_s_m * aim_u + left_N + right_N
        torque = m.turning_N_m_s * aim_w + m.turning_N_m * np.tanh(aim_w / _DRY) + scrub
        torque += m.half_track_m * (right_N - left_N)
        return (
            force + m.mass_kg * _KEEPS_1_S * (aim_u - u),
            torque + inertia * _KEEPS_1_S * (aim_w - w),
        )
    return 0.0, 0.0


@njit(cache=True)
def _turned(m: Turner, legs: NDArray[Any], lag_s: float, out: Floats) -> None:
    u = v = w = heading = force = torque = acc_x = 0.0
    row, total = 0, out.shape[1]
    for number in range(legs.size):
        leg = legs[number]
        for step in range(round(leg.duration_s / STEP_S)):
            ask_N, ask_N_m = _asked(m, leg, step * STEP_S, u, w)
            force += (ask_N - force) * STEP_S / lag_s
            torque += (ask_N_m - torque) * STEP_S / lag_s
            warm = 1.0 - m.warming_1 * row / total
            weight_N = m.mass_kg * GRAVITY_M_S2
            fx = force - m.viscous_N_s_m * warm * u
            left_N, right_N = _side_friction(m, u, w)
            fx -= left_N + right_N
            moment = torque - m.turning_N_m_s * warm * w - m.turning_N_m * np.tanh(w / _DRY)
            moment -= m.half_track_m * (right_N - left_N)
            fy = 0.0
            moved = m.mass_kg * acc_x * m.com_height_m / (2.0 * m.half_base_m)
            for end in range(2):
                x = m.half_base_m if end == 0 else -m.half_base_m
                share = 0.5 + 0.5 * m.com_x_m / x
                load_N = weight_N * share - moved * np.sign(x)
                side_N = -m.grip_1 * load_N * np.tanh((v + w * x) / m.grip_m_s)
                fy += side_N
                moment += x * side_N
            gx = -m.mass_kg * GRAVITY_M_S2 * np.sin(m.slope_rad) * np.cos(m.slope_to_rad - heading)
            gy = -m.mass_kg * GRAVITY_M_S2 * np.sin(m.slope_rad) * np.sin(m.slope_to_rad - heading)
            if leg.kind == STAND or leg.kind == STOP:
                brake = _BRAKES_1_S * (10.0 if leg.kind == STAND else 1.0)
                fx -= m.mass_kg * brake * u
                moment -= m.inertia_kg_m2 * brake * w
            # gravity acts on the centre of mass, what is about the origin is taken there
            at_com = moment - m.com_x_m * fy + m.com_y_m * fx
            turn = at_com / m.inertia_kg_m2
            ax = (fx + gx) / m.mass_kg + turn * m.com_y_m + w * w * m.com_x_m
            ay = (fy + gy) / m.mass_kg - turn * m.com_x_m + w * w * m.com_y_m
            if leg.kind == STAND and abs(u) + abs(w) + abs(v) < 0.02:
                u = v = w = turn = ax = ay = 0.0
            out[0, row] = force / 2.0 - torque / (2.0 * m.half_track_m)
            out[1, row] = force / 2.0 + torque / (2.0 * m.half_track_m)
            out[2, row] = u
            out[3, row] = v
            out[4, row] = w
            # an accelerometer does not feel gravity
            out[5, row] = ax - gx / m.mass_kg
            out[6, row] = ay - gy / m.mass_kg
            out[7, row] = turn
            acc_x = ax
            u += (ax + w * v) * STEP_S
            v += (ay - w * u) * STEP_S
            w += turn * STEP_S
            heading += w * STEP_S
            row += 1


def turn(machine: Turner, legs: Sequence[TurnLeg], lag_s: float) -> dict[str, Floats]:
    """Drive through the legs.

    Args:
        machine: and its ground.
        legs: one after another.
        lag_s: time constant of the drive.

    Returns:
        (steps,) each of `CHANNELS`.
    """
    steps = sum(round(leg.duration_s / STEP_S) for leg in legs)
    out = np.zeros((len(CHANNELS), steps))
    _turned(machine, np.array([tuple(leg) for leg in legs], _RECORD), lag_s, out)
    return dict(zip(CHANNELS, out, strict=True))
