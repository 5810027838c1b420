"""The exception tree of payscope, in the lowest package so that every other can use it.

    PayscopeError           one line: the file, the fault, the choices, the remedy (exit status 2)
    ├── LogError            a log cannot be opened or read as requested
    ├── MachineError        a machine file, one of its settings or an override is wrong
    ├── ScenarioError       a simulation scenario is wrong
    ├── CampaignError       a campaign file of a calibration is wrong, or its runs give no reading
    ├── EvidenceError       evidence, or a key, cannot be read or written
    ├── ReviewError         a reviewer's verdicts are wrong, or a folder cannot take a review
    ├── FleetError          a fleet file, its engine, or a request for a fleet's results is wrong
    ├── QueryError          a query is not a SELECT over the available tables
    ├── RecordingError      a recording cannot be read, or lacks what was requested
    ├── DataError           the samples cannot be used (lengths, no common time, no numbers)
    └── OutputError         an output cannot be written, or already exists

An answer of "no" (a log that cannot weigh) is a result, not an exception.
"""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches


class PayscopeError(Exception):
    """Root of all errors; its text is one line that a user can act on, `args` the original text."""

    def __str__(self) -> str:
        return join_to_one_line(super().__str__())


class LogError(PayscopeError):
    """A log cannot be opened, or cannot be read as requested."""


class MachineError(PayscopeError):
    """A machine file, one of its settings or an override is wrong."""


class ScenarioError(PayscopeError):
    """A simulation scenario is wrong."""


class CampaignError(PayscopeError):
    """A campaign file of a calibration is wrong, or its runs give no reading."""


class EvidenceError(PayscopeError):
    """Evidence of a calibration, or a key, cannot be read or written."""


class ReviewError(PayscopeError):
    """A reviewer's verdicts are wrong, or a folder cannot take a review."""


class FleetError(PayscopeError):
    """A fleet file, its engine, or a request for a fleet's results is wrong."""


class QueryError(PayscopeError):
    """A query is not a SELECT over the available tables."""


class RecordingError(PayscopeError):
    """A recording cannot be read, or lacks what was requested."""


class DataError(PayscopeError):
    """The samples cannot be used (lengths, no common time, no numbers)."""


class NoReadingError(DataError):
    """A channel has no number in the log."""


class OutputError(PayscopeError):
    """An output cannot be written, or already exists."""


def join_to_one_line(text: str) -> str:
    """Join a text to one line, replacing line breaks in quoted bytes and names."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "�" for c in text)


def join_first_names(names: Sequence[object], max_count: int) -> str:
    """The first `max_count` names, separated by commas, and how many more there are."""
    more = f" and {len(names) - max_count} more" if len(names) > max_count else ""
    return ", ".join(map(str, names[:max_count])) + more


def format_count(count: int, singular_noun: str) -> str:
    """Number and noun, with a plural s unless the number is 1."""
    return f"{count:,} {singular_noun}{'' if count == 1 else 's'}"


def suggest_choice(word: str, choices: Iterable[str]) -> str:
    """Suggest the choice most similar to `word`, or list all choices."""
    known = sorted(choices)
    close = get_close_matches(word, known, n=1, cutoff=0.6)
    return f"did you mean '{close[0]}'?" if close else f"known: {', '.join(known) or 'none'}"
