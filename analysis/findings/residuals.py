"""What mass and friction leave of the force: coloured, of uneven size, or swinging.

The same sum of channels is looked at while the machine stands, where it holds the instruments'
noise alone; its spectrum while it drives is compared with that.
"""

from typing import Final, NamedTuple

import numpy as np

from analysis.diagnosis.evidence import Bools, Floats
from analysis.findings.case import Case
from analysis.findings.cause import Sign
from analysis.forces import longitudinal_force, regressor_acceleration
from analysis.schema import values

#: Samples of a spectrum, half of which the next one shares.
_LENGTH: Final = 128
#: Fewer spectra tell nothing, more are not needed.
_FEWEST: Final = 6
_MOST: Final = 4000
#: Frequencies of a resonance, of slow noise, and of what it is compared with.
_SWINGS_HZ: Final = (2.0, 20.0)
_SLOW_HZ: Final = 1.2
_FAST_HZ: Final = (3.0, 10.0)
#: Ratios of power that chance and resampling stay below.
_PEAK: Final = 3.0
_UNEVEN: Final = 1.7
_COLOURED: Final = 1.9


class Spectra(NamedTuple):
    """Power by frequency, (k,): while it drives, and while it stands."""

    hz: Floats
    driving: Floats
    standing: Floats
    counts: tuple[int, int]


def spectra(case: Case) -> Spectra | None:
    """Of f - m a - b v; None where there is too little of either."""
    if "spectra" in case.kept:
        return case.kept["spectra"]  # type: ignore[return-value]
    case.kept["spectra"] = found = _spectra(case)
    return found


def _spectra(case: Case) -> Spectra | None:
    fit, aligned, machine = case.fit, case.aligned, case.machine
    rate_hz = machine.settings.align.rate_hz
    # without an answer by what all that moves says
    straight = case.evidence.straight
    mass_kg = straight.fit.value if fit is None else fit.mass_kg
    viscous = 0.0 if fit is None else fit.viscous
    lag = fit.lag_s if fit is not None and fit.shifted else 0.0
    used = straight.moving if fit is None else fit.motion.used
    rows = np.arange(aligned.height, dtype=np.float64)
    force = longitudinal_force(aligned, machine.machine)
    force = np.interp(rows + lag * rate_hz, rows, force)
    A = np.column_stack([regressor_acceleration(aligned, machine), values(aligned, "speed_x_m_s")])
    left = force - A @ np.array([mass_kg, viscous])
    known = np.isfinite(left)
    driving = _powers(left, A, used & known)
    standing = _powers(left, None, case.stands_still & known)
    if min(len(driving), len(standing)) < _FEWEST:
        return None
    hz = np.arange(_LENGTH // 2 + 1) * rate_hz / _LENGTH
    counts = (len(driving), len(standing))
    # a stretch that holds a stop or a knock is no noise
    return Spectra(hz, np.median(driving, axis=0), np.median(standing, axis=0), counts)


def _powers(x: Floats, A: Floats | None, used: Bools) -> list[Floats]:
    """Spectra of the stretches that are used, without their own line, mass and friction."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], used, [False]]).astype(np.int8)))
    window = np.hanning(_LENGTH)
    line = np.column_stack([np.ones(_LENGTH), np.linspace(-1.0, 1.0, _LENGTH)])
    out: list[Floats] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        for first in range(int(begin), int(end) - _LENGTH + 1, _LENGTH // 2):
            part = slice(first, first + _LENGTH)
            own = line if A is None else np.column_stack([line, A[part]])
            rest = x[part] - own @ np.linalg.lstsq(own, x[part], rcond=None)[0]
            out.append(np.abs(np.fft.rfft(rest * window)) ** 2)
            if len(out) >= _MOST:
                return out
    return out


def _level(hz: Floats, power: Floats, low: float, high: float) -> float:
    return float(np.median(power[(hz >= low) & (hz <= high)]))


def resonance(case: Case) -> list[Sign]:
    """A peak of the driving spectrum over what is an octave about it."""
    found = spectra(case)
    if found is None:
        return []
    hz, power = found.hz, found.driving
    ratio = np.zeros(hz.size)
    for at in np.flatnonzero((hz >= _SWINGS_HZ[0]) & (hz <= _SWINGS_HZ[1])):
        beside = (hz > hz[at] / 2.0) & (hz < hz[at] * 2.0) & (np.abs(np.arange(hz.size) - at) > 2)
        ratio[at] = power[at] / max(float(np.median(power[beside])), 1e-12)
    at = int(np.argmax(ratio))
    return [
        Sign(
            float(ratio[at]) / _PEAK,
            f"at {hz[at]:.1f} Hz what the fit leaves swings {np.sqrt(ratio[at]):.1f} times as much "
            "as beside it",
        )
    ]


def heteroscedastic(case: Case) -> list[Sign]:
    """More noise while it drives than while it stands."""
    found = spectra(case)
    if found is None:
        return []
    driving, standing = (
        _level(found.hz, power, *_FAST_HZ) for power in (found.driving, found.standing)
    )
    ratio = driving / max(standing, 1e-12)
    return [
        Sign(
            ratio / _UNEVEN,
            f"what the fit leaves has {np.sqrt(ratio):.1f} times the noise of standing",
        )
    ]


def coloured(case: Case) -> list[Sign]:
    """Slow noise of the channels at standstill, beyond white noise."""
    found = spectra(case)
    if found is None:
        return []
    slow = _level(found.hz, found.standing, 0.5, _SLOW_HZ)
    fast = _level(found.hz, found.standing, *_FAST_HZ)
    ratio = slow / max(fast, 1e-12)
    return [
        Sign(
            ratio / _COLOURED,
            f"below {_SLOW_HZ:g} Hz the noise has {ratio:.1f} times the power that white noise has",
        )
    ]
