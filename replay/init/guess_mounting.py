"""What `payscope init` proposes for `[machine.imu]`, in the lines of a machine file."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import polars as pl

from analysis.stages.signals.mounting_guess import MountingGuess, guess_mounting
from analysis.stages.signals.timestamps import assign_timestamps
from estimators.arrays import Floats, Ints
from estimators.errors import LogError
from replay.logs import Log

#: The topic (None in a table) and the field of a column.
Source = tuple[str | None, str]

_AXES: Final = ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")
_SIDES: Final = ("speed_left_m_s", "speed_right_m_s")
#: So much of a log is looked at.
_LOOK_NS: Final = 600 * 10**9
_LARGEST: Final = 1e6


def mounting_lines(log: Log, sources: Mapping[str, Source]) -> list[str]:
    """Propose how the IMU sits: a table where gravity is sure, a comment where it is not.

    Args:
        log: an opened log.
        sources: where the columns that were recognised come from.

    Returns:
        Lines of a machine file; none where the log has no accelerometer, or a level one.
    """
    if not set(_AXES) <= set(sources):
        return []
    try:
        t_ns, force = _read_fields(log, [sources[name] for name in _AXES])
        speed = _read_speed(log, sources)
    except LogError:
        return []
    guess = guess_mounting(t_ns, force, speed) if t_ns.size else None
    return [] if guess is None else _mounting_lines(guess)


def _mounting_lines(guess: MountingGuess) -> list[str]:
    """Every angle with what it rests on; as comments where a slope may explain them."""
    where = "at standstill" if guess.stood else "on average over the drive"
    found = f"# gravity lies {guess.tilt_deg:.0f}° off the IMU's z axis {where}"
    if guess.is_level and guess.yaw_deg is not None:
        return []
    if guess.is_level and not guess.tilt_is_sure:
        return [f"{found}: level. Its yaw is not told by", "# the log.", ""]
    sure = guess.tilt_is_sure and guess.stood
    lines = [
        found + (": it is mounted so" if sure else ": check this, it may be the ground"),
        "[machine.imu]",
        f"roll_deg = {guess.roll_deg:g}",
        f"pitch_deg = {guess.pitch_deg:g}",
    ]
    if guess.yaw_deg is None:
        lines.append("# yaw_deg = 0                  # the log does not tell it: look at the IMU")
    else:
        std = f"± {guess.yaw_std_deg:.1g}°, from the direction of its starts"
        lines.append(f"yaw_deg = {guess.yaw_deg:g}{' ' * 15}# {std}")
    if not sure:
        lines = [line if line.startswith("#") else f"# {line}" for line in lines]
    return [*lines, ""]


def _read_speed(log: Log, sources: Mapping[str, Source]) -> tuple[Ints, Floats] | None:
    """The machine's speed, or the mean of its sides'; None where there is neither."""
    names = ("speed_x_m_s",) if "speed_x_m_s" in sources else _SIDES
    if not set(names) <= set(sources) or len({sources[name][0] for name in names}) > 1:
        return None
    t_ns, v = _read_fields(log, [sources[name] for name in names])
    return (t_ns, v.mean(axis=1)) if t_ns.size > 1 else None


def _read_fields(log: Log, sources: list[Source]) -> tuple[Ints, Floats]:
    """Stamps (n,) and fields (n, fields) of one topic, finite, one row a stamp.

    Raises:
        LogError: they cannot be read.
    """
    topic = sources[0][0] or "table"
    fields = [field for _, field in sources]
    start_ns = log.topics().filter(pl.col("topic") == topic)["start_ns"][0]
    read = log.read(topic, fields, end_ns=start_ns + _LOOK_NS)
    placed = assign_timestamps({topic: read})[0][topic].unique(
        "unix_ns", keep="last", maintain_order=True
    )
    x = np.stack([placed[field].cast(pl.Float64).to_numpy() for field in fields], axis=1)
    # not finite, or no reading of a machine in any unit
    finite = (np.abs(x) < _LARGEST).all(axis=1)
    return placed["unix_ns"].to_numpy()[finite], x[finite]
