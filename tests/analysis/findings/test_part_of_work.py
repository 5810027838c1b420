"""A shift that digs has no finding for its piles; a log that met one by chance keeps it."""

import polars as pl

from analysis.findings import drop_findings_explained_by_work_cycles
from analysis.model.schema import conform_frame_to_schema
from tests.analysis.cycles.drawn import drawn_shift
from tests.analysis.cycles.test_cycles import found

FINDINGS = conform_frame_to_schema(
    "findings",
    pl.DataFrame({"rank": [1, 2], "cause": ["external_force", "coulomb"]}),
)


def test_the_piles_of_a_shift_are_no_finding_and_the_others_move_up() -> None:
    left = drop_findings_explained_by_work_cycles(
        FINDINGS, found(drawn_shift([700.0, 650.0, 720.0]))
    )
    assert left.select("rank", "cause").rows() == [(1, "coulomb")]
    assert left.schema == FINDINGS.schema


def test_a_pile_in_two_cycles_or_in_cycles_without_digging_stays() -> None:
    assert drop_findings_explained_by_work_cycles(
        FINDINGS, found(drawn_shift([700.0, 650.0]))
    ).equals(FINDINGS)
    undug = found(drawn_shift([700.0, 650.0, 720.0], digs=False))
    assert drop_findings_explained_by_work_cycles(FINDINGS, undug).equals(FINDINGS)
