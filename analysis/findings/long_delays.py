"""Delays of a third of a second and more, as of a GNSS speed: by the correlation of whole channels.

The likelihood of the equation knows delays up to a fifth of a second. Beyond, what is fitted is not
one motion, and everything else shows: friction, an accelerometer that sees a part, a frozen speed.
"""

from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.check_inputs import Bools, Floats
from analysis.findings.constant_forces import gravity_by_pitch
from analysis.findings.finding_inputs import ACC, FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.model.schema import values
from analysis.model.windows import windows_with
from analysis.stages.motion.forces import longitudinal_force
from analysis.stages.signals.grid_rate import rows_in


@dataclass(frozen=True)
class LongDelay:
    """A channel that is late by much.

    Attributes:
        channel: `force`, `speed` or `imu`.
        late_s: by how much; negative: early.
        correlation: with another channel once that is taken off, and as it is.
        rival: the channel that would be off the other way, where there is no third; else empty.
    """

    channel: str
    late_s: float
    correlation: tuple[float, float]
    rival: str = ""


def long_delay(inputs: FindingInputs) -> LongDelay | None:
    """The channel that is late by much against the other two, which go together."""
    if "long delay" not in inputs.kept:
        inputs.kept["long delay"] = _search_delay(inputs)
    return inputs.kept["long delay"]  # type: ignore[return-value]


def _search_delay(inputs: FindingInputs) -> LongDelay | None:
    step_s, channels = _channel_accelerations(inputs)
    if not {"speed", "force"} <= channels.keys():
        return None
    speed, force = channels["speed"], channels["force"]
    drives = np.abs(force) > LIMITS.driving_force_fraction * float(np.quantile(np.abs(force), 0.98))
    if "imu" not in channels:
        seen = _lag_of_force(force, speed, channels["v"], drives, step_s)
        return LongDelay("force", seen[0], seen[1:], "speed") if _is_long(seen) else None
    imu = channels["imu"]
    seen = _find_lag(speed, imu, step_s)
    if _is_long(seen):
        # the one that the force begins with is in time
        before = round(LIMITS.driving_start_s / step_s)
        rows = windows_with(drives[::-1], before)[::-1]
        v = channels["v"]
        later = np.interp(np.arange(v.size) + seen[0] / step_s, np.arange(v.size), v)
        by_imu, by_speed = (
            _residual_square(force, np.column_stack([acceleration, along, np.ones(v.size)]), rows)
            for acceleration, along in ((imu, later), (speed, v))
        )
        if by_imu < by_speed:
            return LongDelay("speed", seen[0], seen[1:])
        return LongDelay("imu", -seen[0], seen[1:])
    seen = _lag_of_force(force, imu, channels["v"], drives, step_s)
    return LongDelay("force", seen[0], seen[1:]) if _is_long(seen) else None


def _is_long(seen: tuple[float, float, float]) -> bool:
    late_s, after, before = seen
    # the other way as they are: a sign
    return (
        abs(late_s) > LIMITS.shortest_long_delay_s
        and after > LIMITS.same_motion_correlation
        and abs(before) < LIMITS.delayed_correlation_ratio * after
    )


def _residual_square(force: Floats, columns: Floats, rows: Bools) -> float:
    """What the equation of motion leaves of the force, in squares."""
    A, f = columns[rows], force[rows]
    left = f - A @ np.linalg.lstsq(A, f, rcond=None)[0]
    return float(left @ left)


def _partial_correlation(force: Floats, acceleration: Floats, v: Floats) -> float:
    """Partial correlation of force and acceleration, about 0, with friction taken out of both.

    A force that rubs goes with the speed, which is the acceleration of later.
    """
    friction = np.column_stack([v, np.sign(v)])
    both = np.column_stack([force, acceleration])
    f, a = (both - friction @ np.linalg.lstsq(friction, both, rcond=None)[0]).T
    size = float(np.linalg.norm(f) * np.linalg.norm(a))
    return float(f @ a) / size if size else 0.0


def _lag_of_force(
    force: Floats, acceleration: Floats, v: Floats, drives: Bools, step_s: float
) -> tuple[float, float, float]:
    """As `_find_lag`, of a force that does not see the brakes."""
    longest = round(LIMITS.longest_delay_s / step_s)
    inside = drives.copy()
    inside[:longest] = inside[-longest:] = False
    seen = [
        _partial_correlation(force[inside], np.roll(acceleration, k)[inside], np.roll(v, k)[inside])
        for k in range(-longest, longest + 1)
    ]
    at = int(np.argmax(seen))
    return (at - longest) * step_s, seen[at], seen[longest]


def _channel_accelerations(inputs: FindingInputs) -> tuple[float, dict[str, Floats]]:
    """Step in s; by channel (n,) what goes with the acceleration, less its mean; the speed `v`."""
    rate_hz = inputs.machine.settings.align.rate_hz
    size = rows_in(LIMITS.delay_mean_s, rate_hz)
    count = min(inputs.aligned.height, round(LIMITS.delay_searched_s * rate_hz)) // size

    def means(x: Floats) -> Floats:
        return x[: count * size].reshape(count, size).mean(axis=1)

    def known(x: Floats) -> Floats:
        return np.nan_to_num(x - np.nanmean(x))

    # a slope needs two means
    if count < max(2 * round(LIMITS.longest_delay_s * rate_hz / size), 2):
        return size / rate_hz, {}
    speed = means(values(inputs.aligned, "speed_x_m_s"))
    force = means(longitudinal_force(inputs.aligned, inputs.machine.machine))
    if not (np.isfinite(speed).any() and np.isfinite(force).any()):
        return size / rate_hz, {}
    # a central difference has the time of its middle
    found = {"speed": np.gradient(speed) * rate_hz / size, "force": force}
    if inputs.measured(ACC):
        found["imu"] = means(values(inputs.aligned, ACC) - gravity_by_pitch(inputs))
    channels = {
        name: known(x) for name, x in found.items() if np.isfinite(x).any() and np.nanstd(x) > 0.0
    }
    return size / rate_hz, {**channels, "v": np.nan_to_num(speed)}


def _find_lag(one: Floats, other: Floats, step_s: float) -> tuple[float, float, float]:
    """How late one is against another in s, their correlation there, and as they are."""
    longest = round(LIMITS.longest_delay_s / step_s)
    size = int(2 ** np.ceil(np.log2(one.size + longest)))
    spectrum = np.fft.rfft(one, size) * np.conj(np.fft.rfft(other, size))
    product = np.fft.irfft(spectrum, size) / (np.linalg.norm(one) * np.linalg.norm(other))
    # lag k: one is k steps behind
    near = np.concatenate([product[-longest:], product[: longest + 1]])
    at = int(np.argmax(near))
    part = 0.0
    if 0 < at < near.size - 1:
        before, here, after = near[at - 1 : at + 2]
        bend = before - 2.0 * here + after
        part = float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0
    return (at - longest + part) * step_s, float(near[at]), float(product[0])
