"""One table of judgement: a mass that a named cause makes worthless is withheld."""

from typing import Final

import polars as pl

from analysis.model.machine import Machine
from analysis.model.schema import build
from analysis.model.verdict import Verdict

_CHECK: Final = "causes"
_MEANING: Final = "named causes that invalidate a mass which no other check withholds"
_REMEDY: Final = "payscope explain names what mends each"


def withhold_by_findings(
    judged: pl.DataFrame, findings: pl.DataFrame, machine: Machine
) -> pl.DataFrame:
    """Add the check that withholds what a finding withholds.

    Args:
        judged: `verdict`.
        findings: of the same log.
        machine: its limit.

    Returns:
        `verdict` with one row more, behind those of the mass.
    """
    # a cause of what is withheld already is said once, by its finding
    is_open = Verdict.of(judged).can_weigh
    grave = findings.filter(pl.col("severity") == "withhold", pl.lit(is_open))
    most = machine.settings.verdict.causes_max
    names = ", ".join(name.replace("_", " ") for name in grave["cause"])
    row = pl.DataFrame(
        {
            "check": [_CHECK],
            "about": ["mass"],
            "value": [float(grave.height)],
            "minimum": pl.Series([None], dtype=pl.Float64),
            "maximum": [float(most)],
            "passed": [grave.height <= most],
            "meaning": [f"{_MEANING} ({names})" if names else _MEANING],
            "consequence": ["withhold"],
            "remedy": [_REMEDY],
        }
    )
    of_mass = judged.filter(pl.col("about") == "mass").height
    parts = [judged.head(of_mass), row.select(judged.columns), judged.tail(judged.height - of_mass)]
    cast = [part.cast(dict(judged.schema)) for part in parts]  # type: ignore[arg-type]
    return build("verdict", pl.concat(cast).to_dict())
