"""Which logs of a shift break off, and when the next one begins."""

from collections.abc import Mapping, Sequence
from typing import Final

import polars as pl

from analysis.model.run_record import Provenance
from recordings.review.torn_logs import TornLog
from replay.inputs.time_line import begins_ns
from replay.logs import Log

_NS: Final = 1e9
#: What readers say of a file that ends before it was closed.
_TORN: Final = ("breaks off", "bytes at the end are lost", "row is torn", "last row (line")


def torn_logs(
    logs: Sequence[Log], wanted: Mapping[str, Sequence[str]], about: Provenance
) -> tuple[TornLog, ...]:
    """Those that break off, in time.

    Args:
        logs: of the shift.
        wanted: the fields that the channels name, by topic.
        about: the replay: its losses, and where its times begin.
    """
    begins = begins_ns(logs, wanted, about.t0_unix_ns)
    ordered = list(begins)
    found: list[TornLog] = []
    for number, log in enumerate(ordered, 1):
        losses = [
            str(loss)
            for loss in about.losses
            if any(words in loss.what for words in _TORN)
            and (loss.source == log.path.name or (log.path / loss.source).exists())
        ]
        topics = log.topics().filter(pl.col("topic").is_in(list(wanted)))
        first, last = topics["start_ns"].min(), topics["end_ns"].max()
        if losses and isinstance(first, int) and isinstance(last, int):
            following = ordered[number : number + 1]
            found.append(
                TornLog(
                    name=log.path.name,
                    number=number,
                    logs=len(ordered),
                    ends_s=(begins[log] + last - first) / _NS,
                    next_s=begins[following[0]] / _NS if following else None,
                    losses=tuple(losses),
                )
            )
    return tuple(found)
