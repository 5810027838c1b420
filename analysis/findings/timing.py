"""Delays between force, wheels and accelerometer.

The log holds two of them: of the force against the acceleration, by the likelihood of
f(t - d) = m a + b v + nuisances with everything refitted (the joint fit's lag), and of the speed
against the accelerometer (what the wheels say). Which channel is late is that which explains both.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from analysis.findings.case import ACC, Case
from analysis.findings.cause import Sign
from analysis.findings.mending import mended
from analysis.weighing.equation import Equation, Floats

#: So many deviations, and so much time, a delay must be.
_DEVIATIONS: Final = 4.5
_LEAST_S: Final = 0.005
#: Hypotheses whose gain (twice the log likelihood) differs by less are not told apart.
_APART: Final = 9.0


def lag(case: Case) -> tuple[float, float]:
    """How late the force is against the acceleration, and the deviation of that; NaN without."""
    fit = case.fit
    if fit is None:
        return np.nan, np.nan
    place = [term.name for term in fit.terms].index("lag")
    late_s, std_s = (float(each[place]) for each in fit.posterior)
    return late_s, std_s


def lag_of_wheels(case: Case) -> tuple[float, float]:
    """How late the speed is against the accelerometer; no knowledge where they do not agree."""
    wheels = None if case.fit is None else case.fit.kinematics
    if wheels is None or not wheels.goes_together:
        return 0.0, np.inf
    return wheels.delay_s


def delays(case: Case) -> list[Sign]:
    """The channels that are late, those first that explain most."""
    force_s, force_std = lag(case)
    if not np.isfinite(force_s):
        return []
    speed_s, speed_std = lag_of_wheels(case)
    by_imu = bool(case.measured(ACC)) and np.isfinite(speed_std)
    of_both = np.hypot(force_std, speed_std)
    imu_s, imu_std = _together(force_s, force_std, speed_s, speed_std)
    total = (force_s / force_std) ** 2 + (speed_s / speed_std) ** 2
    #: by channel: its delay, deviation, and what it leaves of `total`
    left = {
        "force": (force_s, force_std, (speed_s / speed_std) ** 2),
        "speed": (speed_s, speed_std, (force_s / force_std) ** 2),
        "imu": (-imu_s, imu_std, ((force_s - speed_s) / of_both) ** 2),
    }
    if not by_imu:
        left = {"force": left["force"]}
    order = sorted(left, key=lambda each: left[each][2])
    first, found = order[0], []
    gains = {first: total - left[first][2]}
    # of two delays the second is what the first does not explain
    if first != "imu" and by_imu:
        other = "speed" if first == "force" else "force"
        gains[other] = left[first][2]
    for name, gain in gains.items():
        late_s, std_s, _ = left[name]
        strength = min(np.sqrt(max(gain, 0.0)) / _DEVIATIONS, abs(late_s) / _LEAST_S)
        rivals = [n for n in order if n != name and left[n][2] - left[name][2] < _APART]
        found.append(_sign(case, name, (late_s, std_s), float(strength), rivals))
    return found


def _together(a: float, a_std: float, b: float, b_std: float) -> tuple[float, float]:
    """The mean of two delays that are one."""
    if not np.isfinite(b_std):
        return a, a_std
    weights = np.array([a_std**-2.0, b_std**-2.0])
    return float((weights @ [a, b]) / weights.sum()), float(weights.sum() ** -0.5)


def _sign(
    case: Case, name: str, found_s: tuple[float, float], strength: float, rivals: list[str]
) -> Sign:
    late_s, std_s = found_s
    channels = _channels(case, name)
    setting, value = case.shifted(channels, late_s)
    words = "late" if late_s > 0 else "early"
    shown = {"force": "force", "speed": "speed", "imu": "accelerometer"}
    against = " and ".join(shown[each] for each in shown if each != name)
    said = f"{abs(1e3 * late_s):.1f} ± {1e3 * std_s:.1f} ms {words} against {against}"
    if rivals:
        said += f"; as likely the {' or '.join(shown[each] for each in rivals)} is off"
    return Sign(
        strength,
        said,
        channel=next(iter(channels), None),
        setting=setting if channels else None,
        value=value if channels else None,
        change=lambda: mended(
            case, lambda motion: _moved(motion, name, late_s), min(std_s / abs(late_s), 1.0)
        ),
        alternatives=("imu_low_passed",) if name == "imu" and late_s > 0 else (),
    )


def _channels(case: Case, name: str) -> tuple[str, ...]:
    if name == "force":
        return case.measured("force_x_N") or case.measured("torque_left_N_m", "torque_right_N_m")
    if name == "speed":
        return case.speed_channels
    return case.measured(ACC)


def _moved(motion: Equation, name: str, late_s: float) -> Equation:
    if name == "force":
        return motion.with_force_moved_back(late_s)
    if name == "speed":
        return motion.with_speed_moved_back(late_s)
    rows = np.arange(motion.force.size, dtype=np.float64)

    def back(x: Floats | None) -> Floats | None:
        if x is None:
            return None
        return np.interp(rows + late_s * motion.rate_hz, rows, x)

    moved = back(motion.acceleration)
    assert moved is not None
    return replace(
        motion,
        acceleration=moved,
        specific_force=back(motion.specific_force),
        without_gravity=back(motion.without_gravity),
    )
