"""The stage `findings`: the causes that a log shows, the strongest first, and those they mask.

A force with the wrong sign, in another unit or delayed by a second makes weighing impossible, and
so masks all other causes. One key of a channel corrects it; the log is then searched again with
that key.
"""

import tomllib
from collections import Counter
from collections.abc import Callable, Mapping
from itertools import permutations
from typing import Final

import numpy as np
import polars as pl

from analysis.findings.cause import Cause, MassChange, Symptom
from analysis.findings.cause_table import CAUSES, UNKNOWN
from analysis.findings.delay_causes import is_delay_that_masks_other_causes
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.unexplained import MATTERING, SHOWN
from analysis.model.machine import Machine
from analysis.model.schema import build_frame, find_frame_declaration

_MASKS_OTHERS: Final = [cause.key for cause in CAUSES if cause.masks_others]
#: Keys of a channel that correct a masking cause.
_OF_CHANNEL: Final = ("scale", "unit", "delay_s")
#: Cause that a pile makes: a start against an external force.
_PILE: Final = "external_force"


def find_causes(inputs: FindingInputs) -> pl.DataFrame:
    """Search the log for every cause of the table.

    Args:
        inputs: the log.

    Returns:
        `findings`: a row per detected cause; causes that other findings explain come last.
    """
    shown = [
        (cause, sign) for cause, sign in find_symptoms_of_all_causes(inputs) if sign.strength >= 1.0
    ]
    explained = Counter(
        other[0].key
        for other, cause in permutations(shown, 2)
        # if two causes explain each other, the stronger one counts
        if _does_finding_explain_other(cause, other)
        and (
            cause[1].strength >= other[1].strength or not _does_finding_explain_other(other, cause)
        )
    )
    shown.sort(key=lambda each: (explained[each[0].key], -each[1].strength))
    rows = [
        _make_finding_row(rank, cause, sign, inputs) for rank, (cause, sign) in enumerate(shown, 1)
    ]
    inputs.cache[SHOWN] = tuple(cause.key for cause, _ in shown)
    inputs.cache[MATTERING] = tuple(
        cause.key
        for (cause, _), row in zip(shown, rows, strict=True)
        if _does_finding_affect_mass(row, inputs)
    )
    for rank, sign in enumerate(UNKNOWN.find(inputs), len(rows) + 1):
        rows.append(_make_finding_row(rank, UNKNOWN, sign, inputs))
    columns = find_frame_declaration("findings").columns
    return build_frame(
        "findings",
        {c.name: pl.Series([row[c.name] for row in rows], dtype=c.dtype) for c in columns},
    )


def _does_finding_explain_other(
    explaining: tuple[Cause, Symptom], explained: tuple[Cause, Symptom]
) -> bool:
    """Whether one finding explains another, which is then its consequence."""
    (cause, own), (seen, sign) = explaining, explained
    if seen.key in own.explains:
        return True
    return (
        seen.key in cause.explains
        and sign.strength <= cause.max_explained_strength_ratio * own.strength
    )


def find_symptoms_of_all_causes(inputs: FindingInputs) -> list[tuple[Cause, Symptom]]:
    """Symptoms of every cause, including those below the detection threshold."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = [(cause, sign) for cause in CAUSES for sign in cause.find(inputs)]
    return [(cause, sign) for cause, sign in found if np.isfinite(sign.strength)]


def _make_finding_row(
    rank: int, cause: Cause, symptom: Symptom, inputs: FindingInputs
) -> dict[str, object]:
    change = None if symptom.change is None else symptom.change()
    start, end = symptom.span_ns or (None, None)
    return {
        "rank": rank,
        "cause": cause.key,
        "severity": _choose_consequence_of_finding(cause, symptom, change, inputs),
        "channel": symptom.channel,
        "start_t_ns": start,
        "end_t_ns": end,
        "strength_1": symptom.strength,
        "evidence": symptom.evidence,
        "mass_change_kg": None if change is None else change.kg,
        "mass_change_u_kg": None if change is None else change.u_kg,
        "setting": symptom.setting,
        "value": symptom.value,
        "alternatives": ", ".join(symptom.alternatives),
    }


def _does_finding_affect_mass(finding_row: Mapping[str, object], inputs: FindingInputs) -> bool:
    """Whether a finding invalidates the mass or may change it by about its uncertainty."""
    change_kg = finding_row["mass_change_kg"]
    if (
        finding_row["severity"] != "tell"
        or not isinstance(change_kg, float)
        or inputs.fit_without_learnt_priors is None
    ):
        return True
    u_kg = finding_row["mass_change_u_kg"]
    may_kg = abs(change_kg) + (u_kg if isinstance(u_kg, float) else 0.0)
    return may_kg > LIMITS.accounting_change_u * inputs.fit_without_learnt_priors.u_kg


def _choose_consequence_of_finding(
    cause: Cause, symptom: Symptom, change: MassChange | None, inputs: FindingInputs
) -> str:
    """Consequence of a finding: withhold, widen or tell."""
    if symptom.keeps_answer:
        return "tell"
    if (
        cause.withholds
        and symptom.invalidates
        and not (cause.withholds_only_if_check_fails and inputs.can_weigh)
    ):
        return "withhold"
    if change is None or inputs.fit_without_learnt_priors is None:
        return "tell"
    return (
        "widen"
        if abs(change.kg) > LIMITS.widening_change_u * inputs.fit_without_learnt_priors.u_kg
        else "tell"
    )


def drop_findings_explained_by_work_cycles(
    findings: pl.DataFrame, cycles: pl.DataFrame
) -> pl.DataFrame:
    """Drop findings of external forces if work cycles explain them by piles; rank the rest again.

    Args:
        findings: the frame `findings`.
        cycles: frame `cycles`.
    """
    dug = cycles.filter("counted")["dig_t_ns"].drop_nulls().len()
    if dug < LIMITS.work_min_cycles:
        return findings
    left = findings.filter(pl.col("cause") != _PILE)
    rank = pl.int_range(1, pl.len() + 1).cast(findings.schema["rank"])
    return left.with_columns(rank.alias("rank"))


def cut_to_first_hour(frames_by_topic: Mapping[str, pl.DataFrame]) -> dict[str, pl.DataFrame]:
    """Cut the log to the first hour in which all its topics have data.

    Args:
        frames_by_topic: frames by topic, with `log_time_ns`, in recorded order.

    Returns:
        Frames by topic, including the samples before that hour.
    """
    end_ns = max(int(frame["log_time_ns"][0]) for frame in frames_by_topic.values()) + int(
        LIMITS.masked_searched_s * 1e9
    )
    return {
        topic: frame.filter(pl.col("log_time_ns") < end_ns)
        for topic, frame in frames_by_topic.items()
    }


def add_masked_findings(
    findings: pl.DataFrame,
    machine: Machine,
    find_with_machine: Callable[[Machine], pl.DataFrame | None],
    *,
    is_complete_log: bool,
) -> pl.DataFrame:
    """Add the findings that remain after a masking cause is corrected.

    Args:
        findings: the frame `findings`.
        machine: machine file of the replay.
        find_with_machine: finds causes with another machine file; None if the log cannot be
            replayed.
        is_complete_log: whether `find_with_machine` replays the whole log rather than its
            beginning.

    Returns:
        `findings`: the masking causes, then those of the corrected log. Unchanged if no cause masks
        others, or if correcting one does not remove it.
    """
    hiding: list[pl.DataFrame] = []
    seen = findings
    for _ in range(LIMITS.masked_rounds):
        first = seen.head(1)
        changed = correct_machine_file_by_finding(machine, first)
        others = None if changed is None else find_with_machine(changed)
        if changed is None or others is None or _has_finding_of_cause(others, first["cause"][0]):
            break
        hiding.append(first)
        machine, seen = changed, others
    if not hiding:
        return findings
    names = " and ".join(each["cause"][0].replace("_", " ") for each in hiding)
    seen = seen.with_columns(
        evidence=pl.format("once {} is corrected: {}", pl.lit(names), "evidence")
    )
    both = pl.concat(
        [*hiding, seen]
        if is_complete_log
        else [*hiding, seen, drop_repeated_findings(findings, hiding, seen)]
    )
    return both.with_columns(rank=pl.int_range(1, both.height + 1, dtype=pl.Int64))


def _has_finding_of_cause(findings: pl.DataFrame, cause: str) -> bool:
    return cause in findings["cause"]


def drop_repeated_findings(
    findings: pl.DataFrame, masking_findings: list[pl.DataFrame], unmasked_findings: pl.DataFrame
) -> pl.DataFrame:
    """Keep the findings of the whole log that the second search neither repeats nor explains.

    Args:
        findings: findings of the whole log.
        masking_findings: the masking causes that were corrected, a row each.
        unmasked_findings: findings of the second search, with those causes corrected.
    """
    explained = [
        key
        for each in CAUSES
        for key in each.explains
        if any(_has_finding_of_cause(first, each.key) for first in masking_findings)
    ]
    known = [
        *explained,
        *unmasked_findings["cause"],
        *(each["cause"][0] for each in masking_findings),
    ]
    return findings.filter(~pl.col("cause").is_in(known))


def correct_machine_file_by_finding(
    machine: Machine, masking_finding: pl.DataFrame
) -> Machine | None:
    """Machine file with the masking cause corrected; None if no channel setting corrects it."""
    if masking_finding.is_empty() or masking_finding["setting"][0] is None:
        return None
    if masking_finding["cause"][0] not in _MASKS_OTHERS and not is_delay_that_masks_other_causes(
        masking_finding["cause"][0], masking_finding["strength_1"][0]
    ):
        return None
    return copy_machine_with_channel_settings(
        machine, masking_finding["setting"][0], masking_finding["value"][0]
    )


def copy_machine_with_channel_settings(machine: Machine, keys: str, values: str) -> Machine | None:
    """Machine file with changed channel settings; None if other settings would change as well."""
    channels = dict(machine.channels)
    read = tomllib.loads(f"values = [{values}]")["values"]
    for key, value in zip(keys.split(", "), read, strict=True):
        section, _, rest = key.partition(".")
        name, _, field = rest.rpartition(".")
        if section != "channels" or field not in _OF_CHANNEL:
            return None
        channels[name] = channels[name].model_copy(update={field: value})
    return machine.model_copy(update={"channels": channels})
