"""A machine file mended by what a log shows: one proposal at a time, each tried by a replay.

A proposal is kept where the log then still weighs, no longer shows that cause (or less than half of
it, or less of it and the mass moved as claimed), and is known no worse. The next one is taken from
what the log shows after it: what one cause explains is gone with it, and is not mended while that
cause stays.
"""

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from analysis.explain import Finding
from analysis.model.answer import Answer, answer
from analysis.model.run_record import Run
from estimators.errors import DataError, MachineError
from recordings.report.atomic_output import whole_file
from recordings.report.finding_text import findings_of, name_of
from replay.explain.mended_file import Proposal, mended, proposals
from replay.inputs.cached_log import ReadOnce
from replay.logs import Log, open_log
from replay.machines.machine_file import load_machine, machine_path, time_axis
from replay.pipeline import run

#: Causes that say of the answer how poor it is.
_POOR: Final = ("too_little_excitation", "collinear", "coloured_residuals", "heteroscedastic")
#: More causes at once are no log to mend.
_MOST: Final = 8
#: By how much the uncertainty may grow for a cause that hardly moves the mass.
_WIDER: Final = 1.05
#: A mass moved as claimed is so many standard uncertainties from that, and a claim so many from 0.
_COVERAGE: Final = 2.0
#: What a proposal leaves of a cause is a remainder from this share of its strength on down.
_REMAINDER: Final = 0.5


@dataclass(frozen=True, slots=True)
class MachineText:
    """A machine file, and overrides that count beside it.

    Attributes:
        path: of the file, or the name of a shipped one.
        overrides: `key=value`.
    """

    path: Path
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class TakenBack:
    """A proposal that was tried and does not pay, or was not tried.

    Attributes:
        proposal: its first key.
        why: in words.
    """

    proposal: Proposal
    why: str


@dataclass(frozen=True)
class Mended:
    """What a mended machine file does.

    Attributes:
        path: of the file; None where nothing pays, so that none was written.
        changes: what was written into it.
        taken_back: what was left out.
        before: the answer without.
        after: the answer of a replay with it.
        left: what the log then still shows.
    """

    path: Path | None
    changes: tuple[Proposal, ...]
    taken_back: tuple[TakenBack, ...]
    before: Answer
    after: Answer
    left: tuple[Finding, ...]


@dataclass
class _Tried:
    """What was kept so far, and what not."""

    text: str
    run: Run
    changes: list[Proposal] = field(default_factory=list[Proposal])
    taken_back: list[TakenBack] = field(default_factory=list[TakenBack])
    seen: set[tuple[str, str | None]] = field(default_factory=set[tuple[str, str | None]])


def mend(
    path: Path,
    source: MachineText,
    before: Run,
    output: tuple[Path, bool],
    on_stage: Callable[[str], None] = lambda _: None,
) -> Mended:
    """Write the machine file with the proposals that pay.

    Args:
        path: the log, or a recording of it.
        source: the machine file that it was replayed with.
        before: that replay.
        output: the file to write, and whether to replace one that is there.
        on_stage: told the stages of each replay.

    Raises:
        PayscopeError: the machine file cannot be read, or the output not written.
    """
    file = machine_path(source.path)
    tried = _Tried(_text(file), before)
    machine = load_machine(source.path, source.overrides)
    with (
        open_log(path, time=time_axis(machine)) as opened,
        tempfile.TemporaryDirectory(prefix="payscope-") as folder,
    ):
        log, trial = ReadOnce(opened), Path(folder) / file.name
        for _ in range(_MOST):
            finding = _next(tried)
            if finding is None:
                break
            _try(tried, finding, (log, source, file, trial), on_stage)
    behind = _behind(tried)
    tried.taken_back += [
        TakenBack(proposals(each)[0], f"{name_of(behind[each.cause])} explains it, and stays")
        for each in _untried(tried)
        if each.cause in behind
    ]
    if not tried.changes:
        return _outcome(None, tried, before)
    with whole_file(output[0], force=output[1]) as partial:
        partial.write_text(tried.text, encoding="utf-8")
    return _outcome(output[0], tried, before)


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MachineError(f"{file}: cannot be read ({error})") from None


def _next(tried: _Tried) -> Finding | None:
    """The likeliest cause that has a proposal, was not tried, and stands behind none that stays."""
    return next((each for each in _untried(tried) if each.cause not in _behind(tried)), None)


def _untried(tried: _Tried) -> list[Finding]:
    """Findings with a proposal that was not tried."""
    shown = findings_of(tried.run)
    return [each for each in shown if _key(each) not in tried.seen and proposals(each)]


def _behind(tried: _Tried) -> dict[str, str]:
    """Causes that may be seen where another one is that stays, and that one.

    Those under which no mass is worth anything are not among them: nothing is lost by a trial.
    """
    # the table brings all that looks for causes
    from analysis.findings import CAUSES

    shown = findings_of(tried.run)
    untried = {_key(each) for each in _untried(tried)}
    stays = {each.cause for each in shown if _key(each) not in untried}
    ranks = {each.cause: each.rank for each in reversed(shown)}
    grave = {each.cause for each in shown if each.severity == "withhold"}
    return {
        behind: cause.key
        for cause in CAUSES
        if cause.key in stays
        for behind in cause.explains
        # what only says that the answer is poor, or stands behind it, is no reason not to try
        if behind not in grave
        and cause.key not in _POOR
        and ranks[cause.key] < ranks.get(behind, 0)
    }


def _key(finding: Finding) -> tuple[str, str | None]:
    return finding.cause, finding.channel


def _try(
    tried: _Tried,
    finding: Finding,
    of: tuple[Log, MachineText, Path, Path],
    on_stage: Callable[[str], None],
) -> None:
    """Replay with a proposal, and keep it or take it back."""
    log, source, file, trial = of
    tried.seen.add(_key(finding))
    changes = proposals(finding)
    keys = {each.key for each in (*tried.changes, *changes)}
    overrides = [each for each in source.overrides if each.partition("=")[0].strip() not in keys]
    try:
        text = mended(tried.text, changes, file)
        trial.write_text(text, encoding="utf-8")
        replayed = run(log, load_machine(trial, overrides), on_stage)
    except (DataError, MachineError) as error:
        why = str(error).removeprefix(f"{trial}: ")
        tried.taken_back.append(TakenBack(changes[0], why))
        return
    why = _worse(tried.run, replayed, finding)
    if why:
        tried.taken_back.append(TakenBack(changes[0], why))
        return
    tried.text, tried.run = text, replayed
    tried.changes += changes


def _worse(before: Run, after: Run, finding: Finding) -> str:
    """Why a replay is no better for a proposal, or nothing."""
    was, now = answer(before), answer(after)
    if was.verdict.can_weigh and not now.verdict.can_weigh:
        return "the log could no longer weigh"
    still = next((each for each in findings_of(after) if _key(each) == _key(finding)), None)
    if still is not None and not _less(still, finding, _as_claimed(was, now, finding)):
        return "the log still shows it"
    if finding.severity == "withhold" or not was.verdict.can_weigh:
        return ""
    if finding.severity == "tell" and _u_kg(now) > _WIDER * _u_kg(was):
        return "the uncertainty would grow"
    return ""


def _less(still: Finding, finding: Finding, as_claimed: bool) -> bool:
    """Whether a cause is nearly gone, or shows less and moved the mass as was claimed."""
    left = still.strength_1 / finding.strength_1
    return left < _REMAINDER or (left < 1.0 and as_claimed)


def _as_claimed(was: Answer, now: Answer, finding: Finding) -> bool:
    """Whether the masses moved by what the finding claims, and by more than nothing."""
    claimed, u_kg = finding.mass_change_kg, finding.mass_change_u_kg
    if claimed is None or u_kg is None or abs(claimed) <= _COVERAGE * u_kg:
        return False
    if len(was.loads) != len(now.loads):
        return False
    masses = [(a["mass_kg"], b["mass_kg"]) for a, b in zip(was.loads, now.loads, strict=True)]
    moved = [b - a for a, b in masses if a is not None and b is not None]
    return bool(moved) and abs(sum(moved) / len(moved) - claimed) <= _COVERAGE * u_kg


def _u_kg(said: Answer) -> float:
    """Uncertainty of the load that is known best."""
    return min((load["u_kg"] for load in said.loads if load["u_kg"] is not None), default=math.inf)


def _outcome(path: Path | None, tried: _Tried, before: Run) -> Mended:
    return Mended(
        path,
        tuple(tried.changes),
        tuple(tried.taken_back),
        answer(before),
        answer(tried.run),
        findings_of(tried.run),
    )
