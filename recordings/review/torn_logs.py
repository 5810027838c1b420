"""Logs that break off, and how many minutes of the shift that costs."""

from collections.abc import Iterable

from pydantic import BaseModel, ConfigDict

from recordings.report.clock_text import ShiftClock, duration_text


class TornLog(BaseModel):
    """A log that breaks off.

    Attributes:
        name: of its file.
        number: in time, from 1.
        logs: how many the shift has.
        ends_s: its last message, in s since the first sample.
        next_s: when the next log begins; None after the last: nobody knows how much is missing.
        losses: the lines of the losses that say so, in bytes.
    """

    model_config = ConfigDict(frozen=True)

    name: str
    number: int
    logs: int
    ends_s: float
    next_s: float | None
    losses: tuple[str, ...]

    def sentence(self, clock: ShiftClock) -> str:
        """The missing time in a sentence."""
        which = f"Log {self.number} of {self.logs} ({self.name})"
        if self.next_s is None:
            return (
                f"{which} breaks off at {clock.format_time(self.ends_s)}: what came after it is "
                "unknown, "
                "and in no number here."
            )
        missing = duration_text(max(self.next_s - self.ends_s, 0.0))
        return (
            f"{which} breaks off at {clock.format_time(self.ends_s)}: at most {missing} are "
            "missing, until "
            "the next log begins."
        )

    @property
    def loss(self) -> str:
        """The gap as an entry of the list of losses, as a duration instead of bytes."""
        if self.next_s is None:
            return f"the end of log {self.number} ({self.name}), nobody knows how much"
        last = duration_text(max(self.next_s - self.ends_s, 0.0))
        return f"at most the last {last} of log {self.number} ({self.name})"


def torn_last_log(torn: Iterable[TornLog]) -> TornLog | None:
    """The last log of the shift where that is torn: then nobody knows when the shift ended."""
    return next((each for each in torn if each.next_s is None), None)
