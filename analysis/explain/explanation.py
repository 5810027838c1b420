"""Explanation of a run: its answer, causes, gate decisions and undetermined parameters."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.explain.determined_parameters import DeterminedParameters, find_determined_parameters
from analysis.explain.explain_limits import LIMITS
from analysis.explain.worst_manoeuvres import (
    GateStretch,
    ManoeuvreReport,
    compute_fractions_of_gate_reasons,
    list_stretches_of_gate_decisions,
    report_manoeuvre_at_time,
    report_worst_manoeuvres,
)
from analysis.model.answer import Answer, make_answer
from analysis.model.physical_units import NS_PER_S
from analysis.model.run_record import Run
from analysis.model.windows import mark_samples_in_accepted_windows

#: Columns that an explanation uses, by frame; of other frames it uses all columns.
COLUMNS: Final[Mapping[str, tuple[str, ...]]] = {
    "excitation": (
        *("t_ns", "force_x_N", "regressor_acc_x_m_s2", "speed_x_m_s", "direction_x_1"),
        *("phase", "pitch_rad"),
    ),
    "gate": ("t_ns", "corr_x_1", "mi_x_nat", "noise_share_x_1", "accepted_x", "reason_x"),
}
#: Small frames, which are read completely.
SMALL: Final = (
    *("noise", "segments", "loads", "manoeuvres", "nuisances", "budget", "masses", "verdict"),
    *("findings", "planar", "shift"),
)


@dataclass(frozen=True, slots=True)
class Finding:
    """Cause found in the log (row of frame `findings`)."""

    rank: int
    cause: str
    says: str
    severity: str
    channel: str | None
    start_s: float | None
    end_s: float | None
    strength_1: float
    evidence: str
    mass_change_kg: float | None
    mass_change_u_kg: float | None
    setting: str | None
    value: str | None
    alternatives: tuple[str, ...]

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> "Finding":
        """Finding from a row of `findings`."""
        # imported late: the table of causes imports all searches, and most recordings need none
        from analysis.findings import CAUSES, UNKNOWN

        says = {cause.key: cause.statement for cause in (*CAUSES, UNKNOWN)}
        kept: dict[str, Any] = {n: row[n] for n in cls.__dataclass_fields__ if n in row}
        start, end = (row[name] for name in ("start_t_ns", "end_t_ns"))
        kept["says"] = says.get(row["cause"], row["cause"].replace("_", " "))
        kept["start_s"] = None if start is None else start / NS_PER_S
        kept["end_s"] = None if end is None else end / NS_PER_S
        kept["alternatives"] = tuple(filter(None, (row["alternatives"] or "").split(", ")))
        return cls(**kept)

    @property
    def has_proposal(self) -> bool:
        """Whether the finding proposes a change to the machine file."""
        return self.setting is not None and self.value is not None


@dataclass(frozen=True)
class Explanation:
    """Explanation of a run's answer.

    Attributes:
        answer: the answer of the run.
        at_s: explained moment; None for the whole run.
        findings: causes found in the log, in the order of their rank, and only those that cover
            `at_s` if it is given; None if the run did not search for causes.
        manoeuvre: manoeuvre at that moment.
        worst: for a whole run, the manoeuvres that deviate most from their loads.
        gate: gate decisions around the moment.
        shares: fraction of windows by reason of the gate.
        determined: determined parameters; None if unknown.
    """

    answer: Answer
    at_s: float | None
    findings: tuple[Finding, ...] | None
    manoeuvre: ManoeuvreReport | None
    worst: tuple[ManoeuvreReport, ...]
    gate: tuple[GateStretch, ...]
    shares: Mapping[str, float]
    determined: DeterminedParameters | None

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain JSON values."""
        return {
            "at_s": self.at_s,
            "can_weigh": self.answer.verdict.can_weigh,
            "loads": [dict(row) for row in self.answer.loads],
            "verdict": self.answer.verdict.to_dict(),
            "findings": None if self.findings is None else [asdict(each) for each in self.findings],
            "manoeuvre": None if self.manoeuvre is None else asdict(self.manoeuvre),
            "worst_manoeuvres": [asdict(each) for each in self.worst],
            "gate": [asdict(each) for each in self.gate],
            "gate_shares": dict(self.shares),
            "determined": None if self.determined is None else asdict(self.determined),
        }


def make_explanation(run: Run, at_s: float | None = None) -> Explanation:
    """Explain a run, or a moment of it.

    Args:
        run: run with as many of the frames `SMALL` and the columns `COLUMNS` as it has.
        at_s: moment, in seconds since the start.
    """
    frames, settings = run.frames, run.provenance.settings
    gate = frames.get("gate", pl.DataFrame())
    stretches: tuple[GateStretch, ...] = ()
    if at_s is not None and gate.height:
        start, end = (round((at_s + way * LIMITS.around_s) * NS_PER_S) for way in (-1, 1))
        stretches = list_stretches_of_gate_decisions(gate, settings, start, end)
    manoeuvre = None if at_s is None else report_manoeuvre_at_time(frames, at_s)
    return Explanation(
        answer=make_answer(run),
        at_s=at_s,
        findings=_select_findings_near_time(frames, at_s),
        manoeuvre=manoeuvre,
        worst=report_worst_manoeuvres(frames) if at_s is None else (),
        gate=stretches,
        shares=compute_fractions_of_gate_reasons(gate),
        determined=determine_parameters_at_moment(run, manoeuvre, at_s),
    )


def _select_findings_near_time(
    frames: Mapping[str, pl.DataFrame], at_s: float | None
) -> tuple[Finding, ...] | None:
    if "findings" not in frames:
        return None
    found = [Finding.from_row(row) for row in frames["findings"].iter_rows(named=True)]
    if at_s is not None:
        found = [each for each in found if _is_finding_near_time(each, at_s)]
    return tuple(found)


def _is_finding_near_time(finding: Finding, at_s: float) -> bool:
    if finding.start_s is None or finding.end_s is None:
        return True
    return finding.start_s - LIMITS.around_s <= at_s <= finding.end_s + LIMITS.around_s


def determine_parameters_at_moment(
    run: Run, manoeuvre: ManoeuvreReport | None, at_s: float | None
) -> DeterminedParameters | None:
    """Parameters determined by the manoeuvre or window at a moment, or by the log."""
    excitation, gate = run.frames.get("excitation"), run.frames.get("gate")
    settings = run.provenance.settings
    if excitation is None or not excitation.height:
        return None
    if at_s is not None:
        window = settings.gate.window_samples / settings.align.rate_hz
        start, end = (
            (at_s - window, at_s) if manoeuvre is None else (manoeuvre.start_s, manoeuvre.end_s)
        )
        inside = pl.col("t_ns").is_between(round(start * NS_PER_S), round(end * NS_PER_S))
        excitation = excitation.filter(inside)
        rows = np.ones(excitation.height, np.bool_)
    elif gate is not None and "accepted_x" in gate.columns and gate.height == excitation.height:
        accepted = gate["accepted_x"].fill_null(value=False).to_numpy()
        rows = mark_samples_in_accepted_windows(accepted, settings.gate.window_samples)
        if not rows.any():
            rows = _select_moving_rows(excitation)
    else:
        rows = _select_moving_rows(excitation)
    return find_determined_parameters(excitation, rows, run.frames.get("noise"), settings)


def _select_moving_rows(excitation: pl.DataFrame) -> np.ndarray:
    moves = pl.col("phase").cast(pl.String) != "standstill"
    return excitation.select(moves.fill_null(value=False)).to_series().to_numpy()
