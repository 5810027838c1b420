"""Judge a proposed setting by comparing replays with and without it.

The log that a value is fitted to would always confirm it. So it is fitted again to the first half
of the log, and tested on the second.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from analysis.explain import Finding
from analysis.model.answer import Answer, make_answer
from analysis.model.run_record import Run
from analysis.model.schema import get_column_values
from estimators.errors import DataError, MachineError
from recordings.report.finding_text import read_findings_of_run
from replay.explain.proposal_edits import Proposal, make_proposal_for_each_key_of_finding
from replay.explain.proposal_limits import LIMITS

#: First and last log time in ns of a part of a log; None for the start or end of the log.
Stretch = tuple[int | None, int | None]
Replay = Callable[[Sequence[Proposal], Stretch], Run]


@dataclass(frozen=True)
class ProposalTrial:
    """A finding's proposal, with the replays before and after.

    Attributes:
        finding: finding with the proposal.
        before: replay without the proposal.
        after: replay with the proposal.
    """

    finding: Finding
    before: Run
    after: Run

    def explain_why_trial_is_not_better(self) -> str:
        """Why the replay with the proposal is not better; empty if it is."""
        was, now = make_answer(self.before), make_answer(self.after)
        open_before = was.verdict.can_weigh
        if open_before and not now.verdict.can_weigh:
            return "the log could no longer weigh"
        still = find_finding_of_same_cause_and_keys(self.finding, self.after)
        claimed = did_mass_change_as_claimed(was, now, self.finding)
        if still is not None and not is_cause_reduced_by_proposal(
            still, self.finding, is_change_claimed=claimed
        ):
            return "the log still shows the finding"
        by_mass = self._explain_empty_mass_contradiction(was, now)
        if by_mass:
            return by_mass
        if not open_before:
            return ""
        worse = sorted(
            list_failed_checks_with_consequence(now) - list_failed_checks_with_consequence(was)
        )
        if worse:
            return f"the log would fail {', '.join(worse)}"
        if self.finding.severity == "tell" and _find_smallest_u_of_loads_kg(
            now
        ) > LIMITS.max_u_growth * _find_smallest_u_of_loads_kg(was):
            return "the uncertainty would grow"
        return ""

    def _explain_empty_mass_contradiction(self, answer_before: Answer, answer_after: Answer) -> str:
        """Why the empty mass or gravity at rest speaks against the proposal; empty if neither."""
        empty_kg = self.before.provenance.machine["machine"].get("empty_mass_kg")
        one, other = (
            _find_lightest_load_mass_and_u_kg(answer_before),
            _find_lightest_load_mass_and_u_kg(answer_after),
        )
        nearer = False
        if empty_kg and one is not None and other is not None:
            off, now_off = abs(one[0] - empty_kg), abs(other[0] - empty_kg)
            nearer = now_off < off
            if off <= LIMITS.coverage_factor * one[1] and now_off > max(
                off, LIMITS.coverage_factor * other[1]
            ):
                return "the mass agrees with the empty machine's, but would not with this proposal"
        if empty_kg and other is not None and self.finding.cause == "wrong_unit":
            below_kg = max(
                LIMITS.coverage_factor * other[1], LIMITS.lighter_than_empty_1 * empty_kg
            )
            if empty_kg - other[0] > below_kg:
                return "the machine would weigh less than empty: another factor is wrong"
        if self.finding.cause != "wheel_radius" or nearer:
            return ""
        if (
            does_accelerometer_read_gravity(self.after)
            and "imu_loose" not in self.finding.alternatives
        ):
            return ""
        return (
            "the accelerometer's scale may be off as well: gravity along z at rest, or the mass "
            "of the empty machine, would show it"
        )


def explain_failure_on_held_out_half(
    finding: Finding, run_without_proposal: Run, span_ns: tuple[int, int], replay: Replay
) -> str:
    """Why the proposal fails on a held-out half of the log; empty if it holds.

    Args:
        finding: finding of the whole log with the proposal.
        run_without_proposal: replay of the whole log.
        span_ns: first and last log time.
        replay: function that replays a range of log times with additional proposals.

    Returns:
        The reason; "" if the proposal holds.
    """
    middle_ns = find_time_halving_starts_ns(run_without_proposal, *span_ns)
    if middle_ns is None:
        return "the log is too short to test the correction on stretches that it was not fitted to"
    first, second = (None, middle_ns), (middle_ns + 1, None)
    try:
        fitted = find_finding_of_same_cause_and_keys(finding, replay((), first))
        if fitted is None:
            return "the first half of the log does not show the finding"
        unchanged = replay((), second)
        seen = find_finding_of_same_cause_and_keys(finding, unchanged)
        if seen is None:
            return "the second half of the log does not show the finding"
        changed = replay(make_proposal_for_each_key_of_finding(fitted), second)
    except (DataError, MachineError):
        return "half of the log is too short to test the correction"
    was, now = make_answer(unchanged), make_answer(changed)
    left = find_finding_of_same_cause_and_keys(finding, changed)
    claimed = did_mass_change_as_claimed(was, now, seen)
    if left is not None and not is_cause_reduced_by_proposal(left, seen, is_change_claimed=claimed):
        return "the correction from the first half of the log does not improve the second"
    if was.verdict.can_weigh and not now.verdict.can_weigh:
        return "the correction from the first half of the log worsens the second"
    return ""


def find_finding_of_same_cause_and_keys(finding: Finding, run: Run) -> Finding | None:
    """Finding of the same cause with a proposal for the same keys; None if absent."""
    keys = finding.setting
    shown = (each for each in read_findings_of_run(run) if each.cause == finding.cause)
    return next((each for each in shown if each.setting == keys), None)


def find_time_halving_starts_ns(run: Run, start_ns: int, end_ns: int) -> int | None:
    """Log time in ns that separates the earlier half of the starts from the later half.

    The middle of the log if it has no starts; None if it has too few of them.
    """
    t_ns, starts = run.frames["excitation"]["t_ns"], run.frames["manoeuvres"]
    if t_ns.is_empty() or 0 < starts.height < LIMITS.min_starts:
        return None
    middle = 0.5
    if starts.height:  # none may have been weighed, for example with a force of the wrong sign
        at = starts.height // 2
        edge = (int(starts["end_t_ns"][at - 1]) + int(starts["start_t_ns"][at])) // 2
        middle = (edge - int(t_ns[0])) / max(int(t_ns[-1] - t_ns[0]), 1)
    return start_ns + round(middle * (end_ns - start_ns))


def list_failed_checks_with_consequence(answer: Answer) -> set[str]:
    """Failed checks of the mass that withhold it or widen its interval."""
    costs = ("withhold", "widen")
    return {
        each.check
        for each in answer.verdict.checks
        if each.about == "mass" and each.passed is False and each.consequence in costs
    }


class _LoadMass(NamedTuple):
    """Mass of a load with its standard uncertainty."""

    mass_kg: float
    u_kg: float


def _find_lightest_load_mass_and_u_kg(answer: Answer) -> _LoadMass | None:
    weighed = (row for row in answer.loads if row["mass_kg"] is not None)
    known = [_LoadMass(row["mass_kg"], row["u_kg"]) for row in weighed]
    return min(known, default=None)


def does_accelerometer_read_gravity(run: Run) -> bool:
    """Whether the z axis reads gravity at rest, which confirms the accelerometer's scale."""
    frame = run.frames["excitation"]
    if "specific_force_z_m_s2" not in frame.columns:
        return False
    stands = (frame["phase"] == "standstill").fill_null(value=False).to_numpy()
    z = get_column_values(frame, "specific_force_z_m_s2")[stands]
    pull = float(run.provenance.machine["machine"].get("gravity_m_s2", 9.80665))
    return bool(z.size) and abs(float(np.nanmedian(z)) / pull - 1.0) < LIMITS.gravity_tolerance_1


def is_cause_reduced_by_proposal(
    remaining_finding: Finding, finding: Finding, *, is_change_claimed: bool
) -> bool:
    """Whether a cause has nearly vanished, or is weaker and the mass changed as claimed."""
    left = remaining_finding.strength_1 / finding.strength_1
    return left < LIMITS.remaining_strength or (left < 1.0 and is_change_claimed)


def did_mass_change_as_claimed(
    answer_before: Answer, answer_after: Answer, finding: Finding
) -> bool:
    """Whether the masses changed significantly and as the finding claims."""
    claimed, u_kg = finding.mass_change_kg, finding.mass_change_u_kg
    if claimed is None or u_kg is None or abs(claimed) <= LIMITS.coverage_factor * u_kg:
        return False
    if len(answer_before.loads) != len(answer_after.loads):
        return False
    masses = [
        (a["mass_kg"], b["mass_kg"])
        for a, b in zip(answer_before.loads, answer_after.loads, strict=True)
    ]
    moved = [b - a for a, b in masses if a is not None and b is not None]
    return bool(moved) and abs(sum(moved) / len(moved) - claimed) <= LIMITS.coverage_factor * u_kg


def _find_smallest_u_of_loads_kg(answer: Answer) -> float:
    """Smallest standard uncertainty of the loads' masses in kg; infinite without a mass."""
    return min(
        (load["u_kg"] for load in answer.loads if load["u_kg"] is not None), default=math.inf
    )
