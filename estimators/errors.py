"""The exception tree of payscope, in the lowest package so that every other can use it.

    PayscopeError           one line: the file, the fault, the choices, the remedy (exit status 2)
    ├── LogError            a log cannot be opened or read as asked
    ├── MachineError        a machine file, one of its settings or an override is wrong
    ├── ScenarioError       a simulation scenario is wrong
    ├── CampaignError       a campaign file of a calibration is wrong, or its runs give no reading
    ├── EvidenceError       evidence, or a key, cannot be read or written as asked
    ├── ReviewError         a reviewer's verdicts are wrong, or a folder is no review's
    ├── FleetError          a fleet file, its engine, or what is asked of a fleet's results is wrong
    ├── QueryError          a query is no SELECT over the tables there are
    ├── RecordingError      a recording cannot be read, or does not hold what was asked for
    ├── DataError           the samples cannot be worked with (lengths, no common time, no numbers)
    └── OutputError         an output cannot be written, or is there already

An answer of "no" (a log that cannot weigh) is a result, not an exception.
"""

from collections.abc import Iterable
from difflib import get_close_matches


class PayscopeError(Exception):
    """The root: one line that a person can act on; `args` keeps the text as it was given."""

    def __str__(self) -> str:
        return one_line(super().__str__())


class LogError(PayscopeError):
    """A log cannot be opened or read as asked."""


class MachineError(PayscopeError):
    """A machine file, one of its settings or an override is wrong."""


class ScenarioError(PayscopeError):
    """A simulation scenario is wrong."""


class CampaignError(PayscopeError):
    """A campaign file of a calibration is wrong, or its runs give no reading."""


class EvidenceError(PayscopeError):
    """Evidence of a calibration, or a key, cannot be read or written as asked."""


class ReviewError(PayscopeError):
    """A reviewer's verdicts are wrong, or a folder cannot take a review."""


class FleetError(PayscopeError):
    """A fleet file, its engine, or what is asked of a fleet's results is wrong."""


class QueryError(PayscopeError):
    """A query is no SELECT over the tables there are."""


class RecordingError(PayscopeError):
    """A recording cannot be read, or does not hold what was asked for."""


class DataError(PayscopeError):
    """The samples cannot be worked with."""


class OutputError(PayscopeError):
    """An output cannot be written, or is there already."""


def one_line(text: str) -> str:
    """Join a text to one line, with line breaks of quoted bytes and names replaced."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "�" for c in text)


def counted(number: int, thing: str) -> str:
    """So many of a thing whose plural takes an s."""
    return f"{number:,} {thing}{'' if number == 1 else 's'}"


def nearest(word: str, choices: Iterable[str]) -> str:
    """Say which of `choices` was probably meant by `word`, or list them all."""
    known = sorted(choices)
    close = get_close_matches(word, known, n=1, cutoff=0.6)
    return f"did you mean '{close[0]}'?" if close else f"known: {', '.join(known) or 'none'}"
