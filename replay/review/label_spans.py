"""Labels from text topics of the logs: who drove, what was loaded."""

import datetime as dt
import re
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final, NamedTuple

import polars as pl

from analysis.model.machine import Machine
from analysis.model.physical_units import NS_PER_S
from estimators.errors import LogError, ReviewError, suggest_choice
from recordings.review.reviewer_verdicts import LABELS, ShiftVerdict
from replay.inputs.channel_inputs import merge_messages_of_logs
from replay.logs import expand_log_folders, open_log
from replay.machines.machine_file import find_time_axis_of_machine

_CHANNEL: Final = re.compile(r"(?P<label>\w+)=(?P<topic>.+):(?P<field>[^:]+)")
#: Author of what the logs say.
BY_LOGS: Final = "the logs"


class LabelChannel(NamedTuple):
    """Source of a label, written `operator=/shift/operator:data`."""

    label: str
    topic: str
    field: str


def parse_label_channel(text: str) -> LabelChannel:
    """Parse `LABEL=TOPIC:FIELD`.

    Raises:
        ReviewError: it is written otherwise, or no label is called so.
    """
    match = _CHANNEL.fullmatch(text.strip())
    if match is None:
        raise ReviewError(f"'{text}': write LABEL=TOPIC:FIELD, as operator=/shift/operator:data")
    found = LabelChannel(match["label"], match["topic"], match["field"])
    if found.label not in LABELS:
        raise ReviewError(
            f"'{text}': no label '{found.label}'; {suggest_choice(found.label, LABELS)}"
        )
    return found


def read_label_spans(
    paths: Sequence[Path], channels: Sequence[LabelChannel], machine: Machine
) -> list[ShiftVerdict]:
    """Labels of loads in the logs, each valid until the next different message.

    Args:
        paths: logs of the review; all must be dated or share one time line.
        channels: sources of labels.
        machine: machine file with the time format of tables.

    Raises:
        LogError: no log has a topic, or its field.
    """
    found: list[ShiftVerdict] = []
    with ExitStack() as stack:
        logs = [
            stack.enter_context(open_log(path, time=find_time_axis_of_machine(machine)))
            for path in expand_log_folders(paths)
        ]
        for channel in channels:
            holders = [log for log in logs if channel.topic in log.topic_names()]
            if not holders:
                names = sorted({name for log in logs for name in log.topic_names()})
                raise LogError(
                    f"{paths[0]}: no log has the topic '{channel.topic}'; "
                    f"{suggest_choice(channel.topic, names)}"
                )
            parts = {log: log.read(channel.topic, [channel.field]) for log in holders}
            found += iter_verdicts_of_label_spans(
                channel, merge_messages_of_logs(channel.topic, parts)
            )
    return found


def iter_verdicts_of_label_spans(
    channel: LabelChannel, topic_frame: pl.DataFrame
) -> Iterable[ShiftVerdict]:
    """Yield a verdict for each stretch with the same text."""
    texts = [_format_label_value(each) for each in topic_frame[channel.field]]
    times = topic_frame["log_time_ns"].to_list()
    changes = [k for k, text in enumerate(texts) if k == 0 or text != texts[k - 1]]
    for place, after in zip(changes, [*changes[1:], None], strict=True):
        if texts[place]:
            yield ShiftVerdict.model_validate(
                {
                    channel.label: texts[place],
                    "begin": _round_unix_time_to_second(times[place]),
                    "end": None if after is None else _round_unix_time_to_second(times[after]),
                    "author": BY_LOGS,
                }
            )


def _format_label_value(value: object) -> str:
    """Text of a message's value; whole numbers without decimals."""
    if value is None:
        return ""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip()


def _round_unix_time_to_second(unix_ns: int) -> dt.datetime:
    """Round to a second, as verdicts are written."""
    return dt.datetime.fromtimestamp(int(unix_ns // NS_PER_S), dt.UTC)
