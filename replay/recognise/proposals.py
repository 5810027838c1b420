"""Proposed channels of a draft with their reasons, and questions in order of importance."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Final

from analysis.model.physical_units import find_gain_and_offset_to_si
from analysis.stages.signals.derive import find_unit_in_name
from estimators.errors import MachineError
from replay.recognise.words import ColumnMeaning

SIDES: Final = ("left", "right")
AXLES: Final = ("front", "rear")
#: Kinds of questions about what no column states, in the order in which they are asked.
ORDER: Final = ("machine", "gear", "radius", "column", "side", "unit", "sign")


@dataclass(frozen=True, slots=True)
class LogColumn:
    """Column of a log: topic (None for a table's only one), field, unit, and meaning of its name.

    `quantity` is the quantity of the name that the unit permits: a column in N is not a torque.
    """

    topic: str | None
    field: str
    unit: str | None
    name_meaning: ColumnMeaning
    quantity: str | None

    @property
    def source_text(self) -> str:
        """Field as text, after its topic if it has one."""
        return format_field_and_topic(self.topic, self.field)

    def has_dimension_of_channel(self, channel: str) -> bool:
        """Whether the unit has a channel's dimension; False without a unit."""
        return self.has_dimension_of_unit(find_unit_in_name(channel))

    def has_dimension_of_unit(self, unit: str) -> bool:
        """Whether the unit has the dimension of another; percent matches only percent."""
        is_alike = self.unit == unit or "percent" not in (self.unit, unit)
        return self.unit is not None and is_alike and has_same_dimension(self.unit, unit)


def find_columns_by_side_and_axle(columns: Iterable[LogColumn]) -> dict[str, LogColumn]:
    """Assign columns to both sides or to four wheels, by position: `left`, or `front_left`.

    Returns:
        A column for each position; empty unless each has exactly one.
    """
    columns = [*columns]
    sides = {side: [c for c in columns if c.name_meaning.side == side] for side in SIDES}
    found = {place: each for side in SIDES for place, each in _split_by_axle(side, sides[side])}
    are_alike = len(sides["left"]) == len(sides["right"])
    has_each_one = are_alike and all(len(each) == 1 for each in found.values())
    return {place: each[0] for place, each in found.items()} if has_each_one else {}


def _split_by_axle(
    side: str, columns: Sequence[LogColumn]
) -> Iterator[tuple[str, list[LogColumn]]]:
    """Yield two columns of a side by their axles, or another number of columns together."""
    if len(columns) != len(AXLES):
        yield side, [*columns]
        return
    for axle in AXLES:
        yield f"{axle}_{side}", [c for c in columns if c.name_meaning.axle == axle]


@cache
def has_same_dimension(unit_a: str, unit_b: str) -> bool:
    """Whether a unit has the dimension of another."""
    try:
        find_gain_and_offset_to_si(unit_a, unit_b)
    except MachineError:
        return False
    return True


def format_field_and_topic(topic: str | None, field: str) -> str:
    """Format a field, after its topic if it has one."""
    return f"{topic} {field}" if topic else field


@dataclass(frozen=True, slots=True)
class ChannelProposal:
    """Proposed channel of a draft.

    Attributes:
        column: name of the channel.
        topic: topic of the field; None for a table's only one.
        field: source field; None if the channel is derived.
        unit: unit of the field; None for SI, "?" if it must be stated.
        reason: reason for the proposal.
        derive: formula of a derived channel; None for others.
        is_comment: whether it is written as a comment because information is missing.
    """

    column: str
    topic: str | None
    field: str | None
    unit: str | None
    reason: str
    derive: str | None = None
    is_comment: bool = False

    @property
    def source_text(self) -> str:
        """Source field as text, after its topic if it has one."""
        return format_field_and_topic(self.topic, str(self.field))


@dataclass(slots=True)
class Recognition:
    """Proposed channels of a log, and questions by kind."""

    channels: list[ChannelProposal] = field(default_factory=list)
    kinds_and_questions: list[tuple[str, str]] = field(default_factory=list)

    @property
    def questions(self) -> list[str]:
        """Questions without repetition, in order of importance."""
        ranked = sorted(self.kinds_and_questions, key=lambda each: ORDER.index(each[0]))
        return list(dict.fromkeys(text for _, text in ranked))

    @property
    def recognised_channels(self) -> set[str]:
        """Names of the channels that are filled."""
        return {each.column for each in self.channels if not each.is_comment}

    @property
    def filled_or_proposed_channels(self) -> set[str]:
        """Names of the channels that are filled or proposed as comments."""
        return {each.column for each in self.channels}

    def has_channel_of_both_sides(self, channel: str) -> bool:
        """Whether a channel, with {} for its side, is filled or proposed for left and right."""
        return {channel.format(side) for side in SIDES} <= self.filled_or_proposed_channels

    def add_question_of_subject(self, subject: str, question: str) -> None:
        """Add a question of a kind in `ORDER`."""
        self.kinds_and_questions.append((subject, question))

    def fill_channel_if_empty(
        self, column: LogColumn, channel: str, reason: str, unit: str | None = None
    ) -> None:
        """Fill a channel with a column unless it is filled already."""
        if channel in self.recognised_channels:
            return
        stated = drop_unit_if_si(unit or column.unit, channel)
        self.channels.append(ChannelProposal(channel, column.topic, column.field, stated, reason))

    def propose_channel_without_unit(self, column: LogColumn, channel: str) -> None:
        """Propose a channel whose column states no unit, and ask for it."""
        reason = f"{column.source_text}: its unit is not stated"
        self.propose_source_of_derived_channel(column, channel, "?", reason)
        self.add_question_on_unit(column, channel)

    def add_question_on_unit(self, column: LogColumn, channel: str) -> None:
        """Ask for the unit of a column that fills a channel."""
        self.add_question_of_subject(
            "unit", f"the unit of '{column.source_text}', in channels.{channel}.unit"
        )

    def add_derived_channel(self, channel: str, derivation: str, reason: str) -> None:
        """Add a derived channel that needs no answer."""
        self.channels.append(ChannelProposal(channel, None, None, None, reason, derivation))

    def propose_derived_channel_as_comment(
        self, channel: str, derivation: str, reason: str
    ) -> None:
        """Propose a derived channel that needs an answer, as a comment."""
        proposal = ChannelProposal(channel, None, None, None, reason, derivation, is_comment=True)
        self.channels.append(proposal)

    def propose_source_of_derived_channel(
        self, column: LogColumn, channel: str, unit: str | None, reason: str
    ) -> None:
        """Add the source channel of a proposed derivation, as a comment."""
        self.channels.append(
            ChannelProposal(channel, column.topic, column.field, unit, reason, is_comment=True)
        )


def drop_unit_if_si(unit: str | None, channel: str) -> str | None:
    """Return the unit that a channel must state; None if it is that of the channel's name."""
    if unit is None:
        return None
    return (
        None if find_gain_and_offset_to_si(unit, find_unit_in_name(channel)) == (1.0, 0.0) else unit
    )
