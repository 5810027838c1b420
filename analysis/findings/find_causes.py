"""The stage `findings`: which causes a log shows, the likeliest first."""

from collections import Counter
from itertools import permutations

import numpy as np
import polars as pl

from analysis.findings.cause import Cause, Change, Symptom
from analysis.findings.cause_table import CAUSES, UNKNOWN
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.unexplained import SHOWN
from analysis.model.schema import build, frame_schema


def findings(inputs: FindingInputs) -> pl.DataFrame:
    """Look for every cause of the table.

    Args:
        inputs: the log.

    Returns:
        `findings`: a row a cause that shows, those that another one explains behind it.
    """
    shown = [(cause, sign) for cause, sign in find_symptoms(inputs) if sign.strength >= 1.0]
    explained = Counter(
        other[0].key
        for other, cause in permutations(shown, 2)
        # of two that explain each other, the stronger is the reason
        if _explains(cause, other)
        and (cause[1].strength >= other[1].strength or not _explains(other, cause))
    )
    shown.sort(key=lambda each: (explained[each[0].key], -each[1].strength))
    inputs.kept[SHOWN] = tuple(cause.key for cause, _ in shown)
    shown += [(UNKNOWN, sign) for sign in UNKNOWN.find(inputs)]
    rows = [_finding_row(rank, cause, sign, inputs) for rank, (cause, sign) in enumerate(shown, 1)]
    columns = frame_schema("findings").columns
    return build(
        "findings",
        {c.name: pl.Series([row[c.name] for row in rows], dtype=c.dtype) for c in columns},
    )


def _explains(one: tuple[Cause, Symptom], other: tuple[Cause, Symptom]) -> bool:
    (cause, own), (seen, sign) = one, other
    if seen.key in own.explains:
        return True
    return seen.key in cause.explains and sign.strength <= cause.outdone * own.strength


def find_symptoms(inputs: FindingInputs) -> list[tuple[Cause, Symptom]]:
    """Symptoms of every cause, below the limit of chance as well."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = [(cause, sign) for cause in CAUSES for sign in cause.find(inputs)]
    return [(cause, sign) for cause, sign in found if np.isfinite(sign.strength)]


def _finding_row(
    rank: int, cause: Cause, sign: Symptom, inputs: FindingInputs
) -> dict[str, object]:
    change = None if sign.change is None else sign.change()
    start, end = sign.span_ns or (None, None)
    return {
        "rank": rank,
        "cause": cause.key,
        "severity": _severity(cause, sign, change, inputs),
        "channel": sign.channel,
        "start_t_ns": start,
        "end_t_ns": end,
        "strength_1": sign.strength,
        "evidence": sign.evidence,
        "mass_change_kg": None if change is None else change.kg,
        "mass_change_u_kg": None if change is None else change.u_kg,
        "setting": sign.setting,
        "value": sign.value,
        "alternatives": ", ".join(sign.alternatives),
    }


def _severity(cause: Cause, sign: Symptom, change: Change | None, inputs: FindingInputs) -> str:
    if sign.harmless:
        return "tell"
    if cause.withholds and not (cause.as_judged and inputs.can_weigh):
        return "withhold"
    if change is None or inputs.fit is None:
        return "tell"
    return "widen" if abs(change.kg) > LIMITS.widening_change_u * inputs.fit.u_kg else "tell"
