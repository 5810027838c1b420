"""Proposals for a draft: channels with reasons, and questions in order of need."""

from dataclasses import dataclass, field
from functools import cache
from typing import Final

from analysis.model.physical_units import gain_and_offset_to_si
from analysis.stages.signals.derive import unit_of_name
from estimators.errors import MachineError
from replay.recognise.words import ColumnMeaning

#: What the answer needs and no column tells, in the order that it is asked in.
ORDER: Final = ("gear", "radius", "column", "side", "unit", "sign")


@dataclass(frozen=True, slots=True)
class LogColumn:
    """A column of a table: its topic (None for the only one), unit as stated, and its name's words.

    `quantity` is what the unit leaves of the name: a column in N is no torque.
    """

    topic: str | None
    field: str
    unit: str | None
    said: ColumnMeaning
    quantity: str | None

    def has_dimension_of_channel(self, channel: str) -> bool:
        """Whether the unit is of a channel's dimension; no unit does not fit."""
        return self.has_dimension_of_unit(unit_of_name(channel))

    def has_dimension_of_unit(self, unit: str) -> bool:
        """Whether the unit is of the dimension of another; percent are no angle."""
        is_alike = self.unit == unit or "percent" not in (self.unit, unit)
        return self.unit is not None and is_alike and has_dimension_of(self.unit, unit)


@cache
def has_dimension_of(unit: str, other: str) -> bool:
    """Whether a unit is of the dimension of another."""
    try:
        gain_and_offset_to_si(unit, other)
    except MachineError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class ChannelProposal:
    """A channel of a draft.

    Attributes:
        column: that is filled.
        topic: None for the table's own.
        field: that fills it; None where it is derived.
        unit: that the field is in; None for SI, "?" where it has to be stated.
        reason: what it rests on.
        derive: the arithmetic, where it is derived.
        is_comment: whether something is missing, so that it stands there as a comment.
    """

    column: str
    topic: str | None
    field: str | None
    unit: str | None
    reason: str
    derive: str | None = None
    is_comment: bool = False


@dataclass(slots=True)
class Recognition:
    """Channels, and questions by what they ask for."""

    channels: list[ChannelProposal] = field(default_factory=list)
    asked: list[tuple[str, str]] = field(default_factory=list)

    @property
    def questions(self) -> list[str]:
        """Each question once, in the order of need."""
        ranked = sorted(self.asked, key=lambda each: ORDER.index(each[0]))
        return list(dict.fromkeys(text for _, text in ranked))

    @property
    def taken_columns(self) -> set[str]:
        """The channels that are filled."""
        return {each.column for each in self.channels if not each.is_comment}

    @property
    def named(self) -> set[str]:
        """The channels that are filled or sketched."""
        return {each.column for each in self.channels}

    def ask_question(self, kind: str, question: str) -> None:
        """Ask for one of `ORDER`."""
        self.asked.append((kind, question))

    def fill_channel(
        self, column: LogColumn, channel: str, reason: str, unit: str | None = None
    ) -> None:
        """Fill a channel; the first column that does so stands."""
        if channel in self.taken_columns:
            return
        stated = _unit_unless_si(unit or column.unit, channel)
        self.channels.append(ChannelProposal(channel, column.topic, column.field, stated, reason))

    def propose_as_comment(self, channel: str, derive: str, reason: str) -> None:
        """Propose a derived channel that needs an answer, as a comment."""
        proposal = ChannelProposal(channel, None, None, None, reason, derive, is_comment=True)
        self.channels.append(proposal)

    def sketch_source(self, column: LogColumn, channel: str, unit: str | None, reason: str) -> None:
        """The channel that a sketch derives from."""
        self.channels.append(
            ChannelProposal(channel, column.topic, column.field, unit, reason, is_comment=True)
        )


def _unit_unless_si(unit: str | None, channel: str) -> str | None:
    """The unit that a channel has to name: none for SI."""
    if unit is None:
        return None
    return None if gain_and_offset_to_si(unit, unit_of_name(channel)) == (1.0, 0.0) else unit
