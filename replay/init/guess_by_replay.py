"""Guess settings of `payscope init` by replaying its draft: use of braking, and priors."""

import tomllib
from typing import Final

import polars as pl

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.model.verdict import Verdict
from estimators.errors import PayscopeError
from recordings.report.number_text import format_unit_suffix
from replay.init.guess_machine import BRAKES_QUESTION
from replay.init.init_limits import LIMITS
from replay.logs import Log
from replay.pipeline import run

#: Name of the setting of each term's prior.
_SETTINGS: Final = {
    "const": "const_share",
    "lag": "lag_s",
    "lag_drift": "lag_drift_s",
    "quadratic": "quadratic_share",
    "direction": "direction_share",
    "load_transfer": "load_transfer_s2_m",
}
#: Setting that excludes braking unless the machine file has it false.
_EXCLUDE: Final = "settings.gate.exclude_braking"
BRAKING: Final = (
    "# [settings.gate]",
    "# exclude_braking = false      # where the force sensor measures the brakes: a motor that "
    "brakes",
    "",
)


def propose_settings_by_replaying_draft(log: Log, draft_text: str) -> list[str]:
    """Replay a log with its draft, to decide on braking and narrower priors.

    Args:
        log: an opened log.
        draft_text: text of its complete machine file.

    Returns:
        Lines for the machine file. Braking is used if the force shows it and the log can then
        weigh; priors are comments, and absent if the log adds nothing to the defaults.
    """
    replayed = _replay_with_draft_machine(log, draft_text)
    braking = [] if replayed is None else propose_braking_settings(replayed)
    if braking:
        tried = _replay_with_draft_machine(log, "\n".join([draft_text, *braking]))
        if tried is not None and _can_weigh_replayed_log(tried):
            return [*braking, *_propose_prior_settings(tried)]
    return [*BRAKING, *([] if replayed is None else _propose_prior_settings(replayed))]


def drop_answered_brake_question(draft_text: str, proposed_lines: list[str]) -> str:
    """Remove the question about the brakes from a draft if the lines from its replay answer it."""
    answered = any(line.startswith("exclude_braking") for line in proposed_lines)
    return draft_text.replace(f"# to answer: {BRAKES_QUESTION}\n", "") if answered else draft_text


def _replay_with_draft_machine(log: Log, draft_text: str) -> Run | None:
    try:
        return run(log, Machine.model_validate(tomllib.loads(draft_text)))
    except (PayscopeError, ValueError):
        return None


def _can_weigh_replayed_log(replayed_run: Run) -> bool:
    return Verdict.from_frame(replayed_run.frames["verdict"]).can_weigh


def propose_braking_settings(replayed_run: Run) -> list[str]:
    """Lines that keep samples with braking, if a finding shows that the force includes it."""
    found = replayed_run.frames["findings"].filter(pl.col("setting") == _EXCLUDE)
    if found.is_empty() or found["value"][0] != "false":
        return []
    return ["[settings.gate]", f"exclude_braking = false  # {found['evidence'][0]}", ""]


def _propose_prior_settings(replayed_run: Run) -> list[str]:
    lines = _format_prior_proposals(replayed_run) if _can_weigh_replayed_log(replayed_run) else []
    if not lines:
        return []
    return [
        "# If this log is typical of its machine, its logs may have narrower priors:",
        "# [settings.priors]",
        *lines,
        "",
    ]


def _format_prior_proposals(replayed_run: Run) -> list[str]:
    """Format a commented line for each term that the log determines, with its estimate."""
    priors = replayed_run.provenance.settings.priors.model_dump()
    lines: list[str] = []
    for row in replayed_run.frames["nuisances"].iter_rows(named=True):
        setting = _SETTINGS.get(row["term"])
        found = float((row["posterior"] ** 2 + row["posterior_std"] ** 2) ** 0.5)
        narrowed = found / row["prior_std"]
        if setting is None or narrowed > LIMITS.narrowed_prior_fraction:
            continue
        value = f"# {setting} = {priors[setting] * narrowed:.2g}"
        unit = format_unit_suffix(row["unit"])
        said = f"found {row['posterior']:.2g} ± {row['posterior_std']:.1g}{unit}"
        lines.append(f"{value:<32}# {said}")
    return lines
