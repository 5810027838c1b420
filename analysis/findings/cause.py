"""A possible fault of the data or the model (`Cause`), and how a log shows it (`Symptom`)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from analysis.findings.finding_inputs import FindingInputs


@dataclass(frozen=True, slots=True)
class MassChange:
    """Change of the headline mass if a cause is corrected.

    Attributes:
        kg: corrected mass minus present mass.
        u_kg: standard uncertainty of the change.
    """

    kg: float
    u_kg: float


@dataclass(frozen=True, slots=True)
class Symptom:
    """A symptom of a cause in a log.

    Attributes:
        strength: measured effect divided by its detection threshold; a finding from 1 on.
        evidence: what was measured, in a sentence.
        channel: channel that shows the symptom.
        span_ns: start and end since the first aligned sample; None means the whole log.
        setting: dotted key of the machine file that corrects the cause.
        value: proposed value of that key, as TOML.
        change: computes the change of the mass; None if it is not known.
        alternatives: causes that this log cannot distinguish from this one.
        invalidates: whether this symptom invalidates the mass, provided that its cause can.
        explains: causes that are only consequences of a symptom this strong, besides
            `Cause.explains`.
        keeps_answer: whether the answer stays the same without the affected samples; None if that
            was not examined.
    """

    strength: float
    evidence: str
    channel: str | None = None
    span_ns: tuple[int, int] | None = None
    setting: str | None = None
    value: str | None = None
    change: Callable[[], MassChange | None] | None = None
    alternatives: tuple[str, ...] = ()
    keeps_answer: bool | None = None
    explains: tuple[str, ...] = ()
    invalidates: bool = True


@dataclass(frozen=True, slots=True)
class Cause:
    """One row of the table of causes.

    Attributes:
        key: its name in the frame `findings`.
        statement: the cause, in a sentence.
        needs: what a log must contain for the cause to be detectable, in a sentence.
        find: finds its symptoms by channel; returns an empty list if the log lacks the inputs in
            `needs`.
        withholds: whether a finding invalidates the mass.
        withholds_only_if_check_fails: whether a finding invalidates the mass only if a check of the
            verdict does.
        explains: causes that are reported as consequences of this one.
        max_explained_strength_ratio: largest ratio of the strength of an explained symptom to that
            of this one.
        masks_others: whether this cause masks most others until it is corrected.
    """

    key: str
    statement: str
    needs: str
    find: Callable[[FindingInputs], list[Symptom]]
    withholds: bool = False
    withholds_only_if_check_fails: bool = False
    explains: tuple[str, ...] = ()
    max_explained_strength_ratio: float = float("inf")
    masks_others: bool = False


def list_only_strongest_symptom(symptoms: Sequence[Symptom]) -> list[Symptom]:
    """Keep only the strongest symptom; the list is empty if there is none."""
    return [max(symptoms, key=lambda each: each.strength)] if symptoms else []
