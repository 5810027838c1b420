"""Causes that another one hides: what a log shows once that one is mended.

A force of the wrong sign, or in another unit, leaves nothing that could be weighed, so that nothing
else shows. What mends it is a scale, and the log is looked at once more with it.
"""

import tomllib
from collections.abc import Callable, Mapping
from typing import Final

import polars as pl

from analysis.findings.table import CAUSES
from analysis.machine import Machine

#: Of a longer log its beginning is looked at once more.
_LONGEST_S: Final = 3600.0
_HIDES: Final = [cause.key for cause in CAUSES if cause.hides]
_SCALE: Final = "scale"


def beginning(raw: Mapping[str, pl.DataFrame]) -> dict[str, pl.DataFrame]:
    """The first hour of a log.

    Args:
        raw: by topic: log_time_ns and more, in its order.

    Returns:
        The same of that hour; everything where a topic would be left empty.
    """
    end_ns = min(int(frame["log_time_ns"][0]) for frame in raw.values()) + int(_LONGEST_S * 1e9)
    cut = {topic: frame.filter(pl.col("log_time_ns") < end_ns) for topic, frame in raw.items()}
    return dict(raw) if any(frame.is_empty() for frame in cut.values()) else cut


def behind(
    found: pl.DataFrame, machine: Machine, look: Callable[[Machine], pl.DataFrame]
) -> pl.DataFrame:
    """Put behind a cause that hides others what the log shows without it.

    Args:
        found: `findings`.
        machine: that the log was replayed with.
        look: the findings of the log with another machine file.

    Returns:
        `findings`: the cause that hides others, then those that the log has once it is mended;
        as they were where nothing is hidden, or mending it leaves the cause where it was.
    """
    first = found.head(1)
    if not first["cause"].is_in(_HIDES).any() or first["setting"][0] is None:
        return found
    changed = _scaled(machine, first["setting"][0], first["value"][0])
    if changed is None:
        return found
    others = look(changed)
    if first["cause"][0] in others["cause"]:
        return found
    others = others.with_columns(
        evidence=pl.format("once {} is mended: {}", pl.lit(first["cause"][0]), "evidence")
    )
    both = pl.concat([first, others])
    return both.with_columns(rank=pl.int_range(1, both.height + 1, dtype=pl.Int64))


def _scaled(machine: Machine, keys: str, values: str) -> Machine | None:
    """The machine with other scales of channels; None where more than scales would change."""
    scales = tomllib.loads(f"values = [{values}]")["values"]
    channels = dict(machine.channels)
    for key, scale in zip(keys.split(", "), scales, strict=True):
        section, _, rest = key.partition(".")
        name, _, field = rest.rpartition(".")
        if section != "channels" or field != _SCALE:
            return None
        channels[name] = channels[name].model_copy(update={_SCALE: float(scale)})
    return machine.model_copy(update={"channels": channels})
