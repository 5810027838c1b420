"""Causes that are the machine's work are no findings: a shift that digs drives into piles."""

from typing import Final

import polars as pl

from analysis.findings.finding_limits import LIMITS

#: What pushes back in a start that digs.
_PILE: Final = "external_force"


def drop_work_findings(findings: pl.DataFrame, cycles: pl.DataFrame) -> pl.DataFrame:
    """The findings without those that the cycles explain, ranked anew.

    Args:
        findings: the frame.
        cycles: frame `cycles`.
    """
    dug = cycles.filter("counted")["dig_t_ns"].drop_nulls().len()
    if dug < LIMITS.work_min_cycles:
        return findings
    left = findings.filter(pl.col("cause") != _PILE)
    rank = pl.int_range(1, pl.len() + 1).cast(findings.schema["rank"])
    return left.with_columns(rank.alias("rank"))
