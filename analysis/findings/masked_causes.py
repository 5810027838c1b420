"""Causes that another one hides: what a log shows once that one is mended.

A force of the wrong sign, in another unit or late by a second leaves nothing that could be weighed,
so that nothing else shows. What mends it is a key of a channel, and the log is looked at once more
with it.
"""

import tomllib
from collections.abc import Callable, Mapping
from typing import Final

import polars as pl

from analysis.findings.cause_table import CAUSES
from analysis.findings.delay_causes import is_long
from analysis.findings.finding_limits import LIMITS
from analysis.model.machine import Machine

_HIDES: Final = [cause.key for cause in CAUSES if cause.hides]
#: Keys of a channel that mend one.
_OF_CHANNEL: Final = ("scale", "unit", "delay_s")


def first_findings(raw: Mapping[str, pl.DataFrame]) -> dict[str, pl.DataFrame]:
    """The first hour in which a log has all of its topics, and what is before it.

    Args:
        raw: by topic: log_time_ns and more, in its order.
    """
    end_ns = max(int(frame["log_time_ns"][0]) for frame in raw.values()) + int(
        LIMITS.masked_searched_s * 1e9
    )
    return {topic: frame.filter(pl.col("log_time_ns") < end_ns) for topic, frame in raw.items()}


def add_masked_findings(
    found: pl.DataFrame,
    machine: Machine,
    look: Callable[[Machine], pl.DataFrame | None],
    *,
    whole: bool,
) -> pl.DataFrame:
    """Put behind a cause that hides others what the log shows without it.

    Args:
        found: `findings`.
        machine: that the log was replayed with.
        look: the findings of the log with another machine file; None where it cannot be replayed.
        whole: whether that is the whole log, and not its beginning.

    Returns:
        `findings`: the causes that hide others, then those that the log has once they are mended.
        As it was where nothing is hidden, or mending a cause leaves it where it was.
    """
    hiding: list[pl.DataFrame] = []
    seen = found
    for _ in range(LIMITS.masked_rounds):
        first = seen.head(1)
        changed = _mend_machine(machine, first)
        others = None if changed is None else look(changed)
        if changed is None or others is None or _has_cause(others, first["cause"][0]):
            break
        hiding.append(first)
        machine, seen = changed, others
    if not hiding:
        return found
    names = " and ".join(each["cause"][0].replace("_", " ") for each in hiding)
    seen = seen.with_columns(evidence=pl.format("once {} is mended: {}", pl.lit(names), "evidence"))
    both = pl.concat(
        [*hiding, seen] if whole else [*hiding, seen, _keep_first_look(found, hiding, seen)]
    )
    return both.with_columns(rank=pl.int_range(1, both.height + 1, dtype=pl.Int64))


def _has_cause(found: pl.DataFrame, cause: str) -> bool:
    return cause in found["cause"]


def _keep_first_look(
    found: pl.DataFrame, hiding: list[pl.DataFrame], seen: pl.DataFrame
) -> pl.DataFrame:
    """What the first look saw and the part that was looked at once more may not have."""
    explained = [
        key for each in CAUSES for key in each.explains if _is_hidden_by_any(hiding, each.key)
    ]
    known = [*explained, *seen["cause"], *(each["cause"][0] for each in hiding)]
    return found.filter(~pl.col("cause").is_in(known))


def _is_hidden_by_any(hiding: list[pl.DataFrame], cause: str) -> bool:
    return any(_has_cause(each, cause) for each in hiding)


def _mend_machine(machine: Machine, first: pl.DataFrame) -> Machine | None:
    """The machine without a cause that hides others; None where no channel mends one."""
    if first.is_empty() or first["setting"][0] is None:
        return None
    if first["cause"][0] not in _HIDES and not is_long(first["cause"][0], first["strength_1"][0]):
        return None
    return _scale_channels(machine, first["setting"][0], first["value"][0])


def _scale_channels(machine: Machine, keys: str, values: str) -> Machine | None:
    """The machine with channels read otherwise; None where more would change."""
    channels = dict(machine.channels)
    read = tomllib.loads(f"values = [{values}]")["values"]
    for key, value in zip(keys.split(", "), read, strict=True):
        section, _, rest = key.partition(".")
        name, _, field = rest.rpartition(".")
        if section != "channels" or field not in _OF_CHANNEL:
            return None
        channels[name] = channels[name].model_copy(update={field: value})
    return machine.model_copy(update={"channels": channels})
