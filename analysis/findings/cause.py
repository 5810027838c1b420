"""A cause, and its symptom in a log."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from analysis.findings.finding_inputs import FindingInputs


@dataclass(frozen=True, slots=True)
class MassChange:
    """Change of the headline mass if a cause is mended.

    Attributes:
        kg: mass afterwards less the mass now.
        u_kg: standard uncertainty of that.
    """

    kg: float
    u_kg: float


@dataclass(frozen=True, slots=True)
class Symptom:
    """A symptom of a cause in a log.

    Attributes:
        strength: evidence over the limit that chance stays below; a finding from 1 on.
        evidence: what was measured, in a sentence.
        channel: where it is.
        span_ns: from where to where, since the first aligned sample; None: the whole log.
        setting: dotted key of the machine file that mends it.
        value: proposed for it, as TOML.
        change: of the mass; None where it is not known.
        alternatives: causes that this log cannot tell it from.
        explains: causes that are seen where this is as large as it is, besides those of its cause.
        harmless: whether what is named was left out, and the answer is the same without it; None
            where nobody has looked.
    """

    strength: float
    evidence: str
    channel: str | None = None
    span_ns: tuple[int, int] | None = None
    setting: str | None = None
    value: str | None = None
    change: Callable[[], MassChange | None] | None = None
    alternatives: tuple[str, ...] = ()
    harmless: bool | None = None
    explains: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Cause:
    """One row of the table of causes.

    Attributes:
        key: its name in the frame `findings`.
        says: what it is, in a sentence.
        needs: what a log must hold for it to be seen at all, in a sentence.
        find: looks for it, channel by channel; nothing where the log does not hold that.
        withholds: whether it invalidates the mass.
        as_judged: whether it withholds only where a check of the verdict does.
        explains: causes that are seen where it is, and stand behind it.
        outdone: what is stronger by this factor is not explained by it.
        hides: whether little else shows before it is mended.
    """

    key: str
    says: str
    needs: str
    find: Callable[[FindingInputs], list[Symptom]]
    withholds: bool = False
    as_judged: bool = False
    explains: tuple[str, ...] = ()
    outdone: float = float("inf")
    hides: bool = False


def strongest_symptom(symptoms: Sequence[Symptom]) -> list[Symptom]:
    """The strongest of several symptoms, as a list; empty of none."""
    return [max(symptoms, key=lambda each: each.strength)] if symptoms else []
