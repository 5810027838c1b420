"""Describe logs that end abruptly, and how many minutes of the shift are lost."""

from collections.abc import Iterable

from pydantic import BaseModel, ConfigDict

from recordings.report.clock_text import ShiftClock, format_duration


class TruncatedLog(BaseModel):
    """Log that ends abruptly.

    Attributes:
        name: name of its file.
        number: position in order of time, from 1.
        logs: number of logs of the shift.
        ends_s: time of its last message, in s since the first sample.
        next_s: start of the next log; None for the last log, since the missing time is unknown.
        losses: texts of the losses that report the truncated end in bytes.
    """

    model_config = ConfigDict(frozen=True)

    name: str
    number: int
    logs: int
    ends_s: float
    next_s: float | None
    losses: tuple[str, ...]

    def describe_missing_time(self, clock: ShiftClock) -> str:
        """Describe the missing time in a sentence."""
        which = f"Log {self.number} of {self.logs} ({self.name})"
        if self.next_s is None:
            return (
                f"{which} breaks off at {clock.format_time(self.ends_s)}: the rest of that log is "
                "unknown, and no number here includes it."
            )
        missing = format_duration(max(self.next_s - self.ends_s, 0.0))
        return (
            f"{which} breaks off at {clock.format_time(self.ends_s)}: at most {missing} are "
            "missing, until "
            "the next log begins."
        )

    @property
    def lost_time_text(self) -> str:
        """Entry for the list of losses: how long the lost part lasts, not how many bytes it has."""
        if self.next_s is None:
            return f"an unknown part of the end of log {self.number} ({self.name})"
        last = format_duration(max(self.next_s - self.ends_s, 0.0))
        return f"at most the last {last} of log {self.number} ({self.name})"


def find_truncated_last_log(truncated_logs: Iterable[TruncatedLog]) -> TruncatedLog | None:
    """Find the shift's last log if it is truncated, so that the shift's end is unknown; or None."""
    return next((each for each in truncated_logs if each.next_s is None), None)
