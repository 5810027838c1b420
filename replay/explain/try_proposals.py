"""Correct a machine file from findings, trying each proposal by replays.

A proposal is accepted if with it the log can still weigh, fails no other check, no longer shows the
cause (or less than half of it, or less of it with the mass changed as claimed), if all this also
holds on a half of the log that it was not fitted to, and if the empty mass does not contradict it.
The next proposal is taken from the findings that remain: a finding that another cause explains
disappears with that cause, and is not corrected while the cause remains. If the mass remains
withheld, nothing is written.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple

import polars as pl

from analysis.explain import Finding
from analysis.model.answer import Answer, make_answer
from analysis.model.machine import Machine
from analysis.model.run_record import Run
from estimators.errors import DataError, MachineError
from recordings.report.atomic_output import stage_output_file
from recordings.report.finding_text import find_readable_cause_name, read_findings_of_run
from replay.explain.judge_proposal import ProposalTrial, Stretch, explain_failure_on_held_out_half
from replay.explain.proposal_edits import (
    Proposal,
    insert_proposals_into_machine_file,
    make_proposal_for_each_key_of_finding,
)
from replay.explain.proposal_limits import LIMITS
from replay.inputs.channel_inputs import list_channel_fields
from replay.inputs.derived_logs import CachedLog, LogPart
from replay.logs import Log, open_log
from replay.machines.machine_file import (
    find_machine_file_or_shipped_one,
    find_time_axis_of_machine,
    load_machine,
)
from replay.pipeline import run

#: Causes that describe how poor the answer is, and not why.
_POOR: Final = ("too_little_excitation", "collinear", "coloured_residuals", "heteroscedastic")


@dataclass(frozen=True, slots=True)
class MachineText:
    """A machine file with its overrides.

    Attributes:
        path: path of the file, or name of a shipped one.
        overrides: `key=value` overrides.
    """

    path: Path
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RejectedProposal:
    """A proposal that was rejected or not tried.

    Attributes:
        proposal: the proposal; for a finding with several keys, that of the first.
        why: reason for the rejection, in words.
    """

    proposal: Proposal
    why: str


@dataclass(frozen=True)
class CorrectedMachine:
    """A corrected machine file and its effect.

    Attributes:
        path: path of the file; None if no proposal helps and none was written.
        changes: accepted proposals.
        rejected: rejected proposals.
        before: answer without the proposals.
        after: answer with the accepted proposals.
        remaining: findings that remain.
    """

    path: Path | None
    changes: tuple[Proposal, ...]
    rejected: tuple[RejectedProposal, ...]
    before: Answer
    after: Answer
    remaining: tuple[Finding, ...]


@dataclass(frozen=True)
class ProposalReplays:
    """Replays of one log with different proposals in its machine file.

    Attributes:
        log: the log.
        text: text of the machine file.
        load: function that reads a machine from the text of its file and the proposed keys.
        on_stage: called with each stage of a replay when it begins.
    """

    log: Log
    text: str
    load: Callable[[str, Sequence[str]], Machine]
    path: Path
    on_stage: Callable[[str], None] = lambda _: None

    def replay_log_with_proposals(
        self, proposals: Sequence[Proposal], span_ns: Stretch = (None, None)
    ) -> Run:
        """Replay the log, or a part of it, with proposals in its machine file.

        Raises:
            DataError: the log cannot be replayed with them.
            MachineError: the proposals give an invalid machine file.
        """
        machine = self.load(
            insert_proposals_into_machine_file(self.text, proposals, self.path),
            [each.key for each in proposals],
        )
        whole = span_ns == (None, None)
        return run(self.log if whole else LogPart(self.log, *span_ns), machine, self.on_stage)

    @cached_property
    def log_span_ns(self) -> tuple[int, int]:
        """First and last log time of the topics that the machine file uses."""
        topics = self.log.topics().filter(
            pl.col("topic").is_in(list(list_channel_fields(self.load(self.text, ()))))
        )
        start, end = topics["start_ns"].min(), topics["end_ns"].max()
        return (start if isinstance(start, int) else 0), (end if isinstance(end, int) else 0)


@dataclass
class ProposalProgress:
    """Proposals accepted and rejected so far.

    Attributes:
        run: replay with the accepted proposals.
        changes: accepted proposals.
        rejected: rejected proposals.
        tried: causes and channels already tried.
        while_withheld: findings accepted while the mass was withheld.
    """

    run: Run
    changes: list[Proposal] = field(default_factory=list[Proposal])
    rejected: list[RejectedProposal] = field(default_factory=list[RejectedProposal])
    tried: set[tuple[str, str | None]] = field(default_factory=set[tuple[str, str | None]])
    while_withheld: list[Finding] = field(default_factory=list[Finding])


def write_corrected_machine_file(
    log_path: Path,
    machine_text: MachineText,
    run_without_proposals: Run,
    output: tuple[Path, bool],
    on_stage: Callable[[str], None] = lambda _: None,
) -> CorrectedMachine:
    """Write a copy of the machine file with the proposals that help.

    Args:
        log_path: log, or recording of it.
        machine_text: machine file of the replay.
        run_without_proposals: replay without proposals.
        output: file to write, and whether to replace an existing one.
        on_stage: called with each stage of a replay when it begins.

    Raises:
        PayscopeError: the machine file cannot be read, or the output cannot be written.
    """
    file = find_machine_file_or_shipped_one(machine_text.path)
    text = _read_text_of_machine_file(file)
    machine = load_machine(machine_text.path, machine_text.overrides)
    with (
        open_log(log_path, time=find_time_axis_of_machine(machine)) as opened,
        tempfile.TemporaryDirectory(prefix="payscope-") as folder,
    ):
        trial = Path(folder) / file.name

        def load_trial_machine(text: str, keys: Sequence[str]) -> Machine:
            trial.write_text(text, encoding="utf-8")
            others = [o for o in machine_text.overrides if o.partition("=")[0].strip() not in keys]
            try:
                return load_machine(trial, others)
            except MachineError as error:
                raise MachineError(str(error).removeprefix(f"{trial}: ")) from None

        progress = try_proposals_one_by_one(
            run_without_proposals,
            ProposalReplays(CachedLog(opened), text, load_trial_machine, file, on_stage),
        )
    if not progress.changes:
        return _make_corrected_machine(None, progress, run_without_proposals)
    with stage_output_file(output[0], overwrites=output[1]) as partial:
        partial.write_text(
            insert_proposals_into_machine_file(text, progress.changes, file), encoding="utf-8"
        )
    return _make_corrected_machine(output[0], progress, run_without_proposals)


def try_proposals_one_by_one(
    run_without_proposals: Run, replays: ProposalReplays
) -> ProposalProgress:
    """Try the proposals one by one, and accept those that help.

    Args:
        run_without_proposals: replay without proposals.
        replays: replays of the log.
    """
    tried = ProposalProgress(run_without_proposals)
    for _ in range(LIMITS.max_proposals):
        finding = _find_next_finding_to_try(tried)
        if finding is None:
            break
        try_proposal_of_finding(tried, finding, replays)
    behind = find_causes_explained_by_others(tried)
    tried.rejected += [
        RejectedProposal(
            make_proposal_for_each_key_of_finding(each)[0],
            f"{find_readable_cause_name(behind[each.cause])} explains this finding and is still "
            "present",
        )
        for each in list_untried_findings(tried)
        if each.cause in behind
    ]
    if tried.changes and not make_answer(tried.run).verdict.can_weigh:
        tried.rejected += [
            RejectedProposal(each, "the mass remains withheld")
            for each in _select_first_proposal_of_causes(tried.changes)
        ]
        return ProposalProgress(run_without_proposals, rejected=tried.rejected)
    reject_unneeded_accepted_proposals(tried, replays)
    return tried


def _select_first_proposal_of_causes(proposals: Sequence[Proposal]) -> list[Proposal]:
    """Proposal for the first key of each cause."""
    return list({each.cause: each for each in reversed(proposals)}.values())[::-1]


def reject_unneeded_accepted_proposals(
    progress: ProposalProgress, replays: ProposalReplays
) -> None:
    """Reject proposals accepted while the mass was withheld that turn out unnecessary."""
    for finding in progress.while_withheld[:-1]:
        others = [each for each in progress.changes if each.cause != finding.cause]
        try:
            without = replays.replay_log_with_proposals(others)
        except (DataError, MachineError):
            continue
        shown = {each.cause for each in read_findings_of_run(without)}
        if make_answer(without).verdict.can_weigh and finding.cause not in shown:
            own = next(each for each in progress.changes if each.cause == finding.cause)
            progress.rejected.append(
                RejectedProposal(own, "the correction does not improve the mass")
            )
            progress.changes, progress.run = others, without


def _read_text_of_machine_file(machine_path: Path) -> str:
    try:
        return machine_path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MachineError(f"{machine_path}: cannot be read ({error})") from None


def _find_next_finding_to_try(progress: ProposalProgress) -> Finding | None:
    """First untried finding with a proposal whose cause no remaining cause explains, or None."""
    return next(
        (
            each
            for each in list_untried_findings(progress)
            if each.cause not in find_causes_explained_by_others(progress)
        ),
        None,
    )


def list_untried_findings(progress: ProposalProgress) -> list[Finding]:
    """Findings with a proposal that was not tried."""
    shown = read_findings_of_run(progress.run)
    return [
        each
        for each in shown
        if _make_cause_and_channel_key(each) not in progress.tried
        and make_proposal_for_each_key_of_finding(each)
    ]


def find_causes_explained_by_others(progress: ProposalProgress) -> dict[str, str]:
    """Causes that another remaining cause may explain, and that cause, by name.

    Causes that invalidate the mass are left out, since trying them loses nothing.
    """
    # imported here, since the table of causes imports all detectors
    from analysis.findings import CAUSES

    shown = read_findings_of_run(progress.run)
    untried = {_make_cause_and_channel_key(each) for each in list_untried_findings(progress)}
    stays = {each.cause for each in shown if _make_cause_and_channel_key(each) not in untried}
    ranks = {each.cause: each.rank for each in reversed(shown)}
    grave = {each.cause for each in shown if each.severity == "withhold"}
    return {
        behind: cause.key
        for cause in CAUSES
        if cause.key in stays
        for behind in cause.explains
        # causes that only describe a poor answer, or result from it, do not exclude a proposal
        if behind not in grave
        and cause.key not in _POOR
        and ranks[cause.key] < ranks.get(behind, 0)
    }


class _FindingKey(NamedTuple):
    """Key of a finding: its cause and its channel."""

    cause: str
    channel: str | None


def _make_cause_and_channel_key(finding: Finding) -> _FindingKey:
    return _FindingKey(finding.cause, finding.channel)


def try_proposal_of_finding(
    progress: ProposalProgress, finding: Finding, replays: ProposalReplays
) -> None:
    """Replay with the proposal of a finding, and accept or reject it."""
    progress.tried.add(_make_cause_and_channel_key(finding))
    changes = list(make_proposal_for_each_key_of_finding(finding))
    try:
        replayed = replays.replay_log_with_proposals([*progress.changes, *changes])
        why = ProposalTrial(
            finding, progress.run, replayed
        ).explain_why_trial_is_not_better() or explain_failure_on_held_out_half(
            finding,
            progress.run,
            replays.log_span_ns,
            lambda more, stretch: replays.replay_log_with_proposals(
                [*progress.changes, *more], stretch
            ),
        )
    except (DataError, MachineError) as error:
        why = str(error)
    else:
        if not why:
            if not make_answer(replayed).verdict.can_weigh:
                progress.while_withheld.append(finding)
            progress.run = replayed
            progress.changes += changes
            return
    progress.rejected.append(RejectedProposal(changes[0], why))


def _make_corrected_machine(
    output_path: Path | None, progress: ProposalProgress, run_without_proposals: Run
) -> CorrectedMachine:
    return CorrectedMachine(
        output_path,
        tuple(progress.changes),
        tuple(progress.rejected),
        make_answer(run_without_proposals),
        make_answer(progress.run),
        read_findings_of_run(progress.run),
    )
