"""Add verdicts and labels to a review, and recount it without replaying its logs.

A reviewer gives verdicts on the command line; text topics of the logs give labels, such as the
operator and the product.
"""

import datetime as dt
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import polars as pl
from pydantic import ValidationError

from analysis.model.machine import Machine
from analysis.model.physical_units import NS_PER_S
from estimators.errors import LogError, RecordingError, ReviewError, suggest_choice
from estimators.file_digest import file_sha256
from recordings import read_frame
from recordings.report.atomic_output import stage_output_files
from recordings.review.review_state import RECORDING, ReviewState, read_review_state
from recordings.review.reviewer_verdicts import (
    LABELS,
    VERDICTS,
    CycleVerdict,
    ShiftVerdict,
    VerdictFile,
    assign_verdicts_to_rows,
    format_verdicts_as_toml,
    parse_verdicts,
    read_verdict_text,
)
from recordings.review.shift_ledger import (
    PARQUET,
    find_ledger_row_of_cycle,
    parse_local_instant,
    read_cycle_rows_of_review,
)
from replay.inputs.channel_inputs import merge_messages_of_logs
from replay.logs import expand_log_folders, open_log
from replay.machines.machine_file import find_time_axis_of_machine
from replay.review.review_folder import lock_review_folder
from replay.review.write_review import (
    OUTPUTS,
    ShiftCount,
    ShiftReview,
    decimate_position_track,
    write_review_files,
)

_MODEL_KEYS: Final = {"id", "author", "time"}
_CHANNEL: Final = re.compile(r"(?P<label>\w+)=(?P<topic>.+):(?P<field>[^:]+)")
#: Author of the labels that come from the logs.
BY_LOGS: Final = "the logs"


@dataclass(frozen=True)
class RequestedVerdicts:
    """Verdicts of a reviewer from the command line.

    Attributes:
        reject: cycles to exclude from the count, named as `find_ledger_row_of_cycle` describes.
        accept: rejected cycles to count again.
        cycles: further cycles that the note and labels apply to.
        note: note on the named cycles.
        labels: labels by name (`LABELS`), of the named cycles or, without any, of the whole shift.
        spans: labels of parts of the shift, from the logs.
        begin: local time from which labels of the shift apply.
        end: local time up to which labels of the shift apply.
        author: name of the reviewer.
    """

    reject: Sequence[str] = ()
    accept: Sequence[str] = ()
    cycles: Sequence[str] = ()
    note: str = ""
    labels: Mapping[str, str] = field(default_factory=dict[str, str])
    author: str = ""
    begin: str = ""
    end: str = ""
    spans: Sequence[ShiftVerdict] = ()

    def __bool__(self) -> bool:
        """Whether there is any verdict."""
        return bool(
            self.rejection_of_each_named_cycle or self.note or self._given_labels or self.spans
        )

    @property
    def rejection_of_each_named_cycle(self) -> list[tuple[str, bool | None]]:
        """Named cycles, and whether each is rejected; None leaves it unchanged."""
        return [
            *((each, True) for each in self.reject),
            *((each, False) for each in self.accept),
            *((each, None) for each in self.cycles),
        ]

    @property
    def _given_labels(self) -> dict[str, str]:
        return {name: text for name, text in self.labels.items() if text}

    def refuse_incomplete_verdicts(self) -> None:
        """Raise an error for incomplete verdicts.

        Raises:
            ReviewError: the verdicts are incomplete; one line.
        """
        if self.rejection_of_each_named_cycle and not self.author.strip():
            raise ReviewError("a verdict on a cycle needs an author; add --author NAME")
        if self.note and not self.rejection_of_each_named_cycle:
            raise ReviewError("a note needs a cycle; add --reject, --accept or --cycle WHEN")
        if (self.begin or self.end) and (
            self.rejection_of_each_named_cycle or not self._given_labels
        ):
            raise ReviewError(
                "--from and --to give the time span of a label; add --product, --operator, "
                "--truck, --customer or --stockpile, and leave out the cycle"
            )
        trial = {
            "id": "",
            "author": self.author or "-",
            "time": _read_current_time_to_second(),
            "note": self.note,
        }
        try:
            CycleVerdict.model_validate(trial | self._given_labels)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            raise ReviewError(f"--{first['loc'][0]}: {first['msg']}") from None

    def list_changed_verdicts(
        self,
        earlier_verdicts: VerdictFile,
        ledger_rows: pl.DataFrame,
        state: ReviewState,
        review_folder: Path,
    ) -> list[CycleVerdict | ShiftVerdict]:
        """List the verdicts that are not in the file of verdicts yet.

        Args:
            earlier_verdicts: contents of that file.
            ledger_rows: rows of the ledger.
            state: state of the review.
            review_folder: folder of the review.
        """
        logged = [each for each in self.spans if each not in earlier_verdicts.shift]
        return [
            *logged,
            *self._list_verdicts_by_person(earlier_verdicts, ledger_rows, state, review_folder),
        ]

    def _list_verdicts_by_person(
        self,
        earlier_verdicts: VerdictFile,
        ledger_rows: pl.DataFrame,
        state: ReviewState,
        review_folder: Path,
    ) -> list[CycleVerdict | ShiftVerdict]:
        """Verdicts by a person rather than from a log; arguments as for `list_changed_verdicts`."""
        now = _read_current_time_to_second()
        signed = {"author": self.author.strip() or None, "time": now}
        if self.begin or self.end:
            span = {
                name: parse_local_instant(text, state.clock)
                for name, text in (("begin", self.begin), ("end", self.end))
                if text
            }
            if len(span) == 2 and span["begin"] >= span["end"]:
                raise ReviewError(
                    f"--to {self.end} is not after --from {self.begin}; correct one of them"
                )
            said = ShiftVerdict.model_validate(self._given_labels | span | signed)
            if not any(
                said.applies_to_dump_at(ends_ns / NS_PER_S)
                for ends_ns in ledger_rows["end_unix_ns"]
            ):
                raise ReviewError(
                    f"no load is dumped from {self.begin or 'the beginning'} to "
                    f"{self.end or 'the end'} of the shift; correct --from or --to"
                )
            return [said]
        if not self.rejection_of_each_named_cycle:
            # labels of a part of the shift may differ: the later verdict counts
            in_parts = any(each.begin or each.end for each in earlier_verdicts.shift)
            said = {
                name: text
                for name, text in self._given_labels.items()
                if in_parts or getattr(earlier_verdicts.labels_of_whole_shift, name) != text
            }
            return [ShiftVerdict.model_validate(said | signed)] if said else []
        standing = assign_verdicts_to_rows(earlier_verdicts, ledger_rows["id"], review_folder)
        found: dict[int, CycleVerdict] = {}
        for when, reject in self.rejection_of_each_named_cycle:
            row = find_ledger_row_of_cycle(when, ledger_rows, state.clock)
            old = found.get(row) or standing.get(row)
            kept = {} if old is None else old.model_dump(exclude=_MODEL_KEYS)
            said = kept | self._given_labels | ({"note": self.note} if self.note else {})
            said |= {} if reject is None else {"reject": reject}
            if said != kept:
                by = {"id": ledger_rows["id"][row], "author": self.author.strip(), "time": now}
                found[row] = CycleVerdict.model_validate(said | by)
        return list(found.values())


def _read_current_time_to_second() -> dt.datetime:
    return dt.datetime.now(dt.UTC).replace(microsecond=0)


def is_review_folder(folder: Path) -> bool:
    """Whether a folder holds a review that can be recounted."""
    return read_review_state(folder) is not None and (folder / PARQUET).is_file()


def recount_review_with_verdicts(folder: Path, verdicts: RequestedVerdicts) -> ShiftReview:
    """Add verdicts to a review's file, and rewrite its ledger and page.

    Raises:
        ReviewError: the folder has no review, another version wrote it, or it has no such cycle.
    """
    verdicts.refuse_incomplete_verdicts()
    state = read_review_state(folder)
    if state is None:
        raise ReviewError(
            f"{folder}: holds no review of this version; create one with payscope review LOG… -m "
            f"MACHINE -o {folder}"
        )
    with lock_review_folder(folder):
        recording = folder / RECORDING
        try:
            if file_sha256(recording) != state.recording_sha256:
                raise RecordingError(f"{recording} is not the recording that the review wrote")
            summary = read_frame(recording, "shift")
            track = decimate_position_track(read_frame(recording, "aligned"))
            rows, cycles = read_cycle_rows_of_review(folder, state)
        except (OSError, RecordingError, pl.exceptions.PolarsError) as error:
            raise ReviewError(
                f"{folder}: its loads cannot be recounted ({error}); review its logs again"
            ) from None
        before = read_verdict_text(folder)
        added = verdicts.list_changed_verdicts(parse_verdicts(before, folder), rows, state, folder)
        # entries written by a person stay as they are
        text = "\n".join(
            filter(None, (before and f"{before.rstrip()}\n", format_verdicts_as_toml(added)))
        )
        shift = ShiftCount.count_cycles_with_verdicts(
            cycles, summary, state.t0_unix_ns, text, folder
        )
        page = shift.make_review_page(state, [], track)
        names = [*OUTPUTS, *([VERDICTS] if added else [])]
        with stage_output_files([folder / name for name in names], overwrites=True) as stage:
            write_review_files(page, stage)
            if added:
                (stage / VERDICTS).write_text(text, encoding="utf-8")
    return ShiftReview.from_replay(folder, page, is_newly_replayed=False)


class LabelChannel(NamedTuple):
    """Topic and field that a label comes from, written `operator=/shift/operator:data`."""

    label: str
    topic: str
    field: str


def parse_label_channel(text: str) -> LabelChannel:
    """Parse `LABEL=TOPIC:FIELD`.

    Raises:
        ReviewError: the text has another form, or there is no label of that name.
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
    """Read labels of loads from topics of the logs, each valid until a message with another text.

    Args:
        paths: logs of the review; all must be dated or share one time line.
        channels: topic and field of each label.
        machine: machine file with the time format of tables.

    Raises:
        LogError: no log has the topic or the field of a label.
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
    """Yield a verdict for each run of consecutive messages with the same text."""
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
    """Text of a label's value; whole numbers without decimals."""
    if value is None:
        return ""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip()


def _round_unix_time_to_second(unix_ns: int) -> dt.datetime:
    """Round a Unix time in ns down to a second, as times of verdicts are stored."""
    return dt.datetime.fromtimestamp(int(unix_ns // NS_PER_S), dt.UTC)
