"""Replay the logs of a campaign, and keep their readings and records for the evidence."""

import datetime as dt
import platform
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Final, NamedTuple
from uuid import uuid4

import polars as pl

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign, CampaignRun
from analysis.calibration.campaign.campaign_readings import (
    make_readings_of_campaign_runs,
    make_run_changes_per_learnt_mean_u,
)
from analysis.calibration.line.procedure import PRESENT_PROCEDURE, Procedure
from analysis.calibration.line.shared_errors import RunResponse
from analysis.calibration.use.learnt_priors import (
    LearntPriors,
    TermOfLog,
    list_learnable_term_estimates,
    pool_learnt_terms_over_logs,
)
from analysis.diagnosis.checks import INVALIDATING_CAUSES
from analysis.model.answer import make_answer
from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from estimators.errors import DataError
from recordings import write_recording
from recordings.calibration.bundle_folder import RUNS
from recordings.calibration.evidence_document import (
    EvidenceFile,
    EvidenceLog,
    LoggedTopic,
    Software,
)
from replay.calibration.campaign_limits import LIMITS
from replay.logs import open_log
from replay.machines.machine_file import find_time_axis_of_machine
from replay.pipeline import run

#: Character that ends the name of a distribution in a requirement.
_NAME: Final = re.compile(r"[^A-Za-z0-9._-]")


@dataclass(frozen=True, slots=True)
class CampaignReplay:
    """Replays of the logs of a campaign.

    Attributes:
        readings: frame `readings` of all runs, in the campaign's order.
        logs: record of each log for the evidence.
        budgets: frame `budget` of each log.
        terms: nuisance estimates of each log that can weigh.
        responses: change of each run's mass with the errors of the learnt means.
        refusals: why a log cannot weigh and the remedy, by log; logs that can are absent.
    """

    readings: pl.DataFrame
    logs: tuple[EvidenceLog, ...]
    budgets: tuple[pl.DataFrame, ...]
    terms: tuple[TermOfLog, ...]
    responses: tuple[RunResponse, ...]
    refusals: Mapping[str, str]

    @property
    def priors_learnt_from_logs(self) -> LearntPriors | None:
        """Priors learnt from all logs; None if there are too few."""
        terms = pool_learnt_terms_over_logs(self.terms)
        return LearntPriors(terms=terms, logs=self.terms) if terms else None


def replay_campaign_logs(
    campaign: CalibrationCampaign,
    machine: Machine,
    find_path: Callable[[str], Path],
    recordings_folder: Path | None = None,
    on_log: Callable[[str], None] = lambda _: None,
    procedure: Procedure = PRESENT_PROCEDURE,
) -> CampaignReplay:
    """Replay every log of a campaign once.

    Args:
        campaign: the campaign.
        machine: channels and settings.
        find_path: returns the path of a log of the campaign.
        recordings_folder: folder for recordings of the replays, if any.
        on_log: called with each log's name when its replay begins.
        procedure: procedure of the calibration.

    Raises:
        PayscopeError: a log cannot be read or used.
    """
    frames: list[pl.DataFrame] = []
    logs: list[EvidenceLog] = []
    budgets: list[pl.DataFrame] = []
    terms: list[TermOfLog] = []
    responses: list[RunResponse] = []
    refusals: dict[str, str] = {}
    for number, name in enumerate(campaign.log_names, start=1):
        on_log(name)
        runs = [each for each in campaign.runs if each.log == name]
        known = (
            copy_machine_with_single_load_if_stated(machine, runs)
            if procedure.known_loads_kept
            else machine
        )
        with open_log(find_path(name), time=find_time_axis_of_machine(machine)) as log:
            try:
                replayed = run(log, known)
            except DataError as error:
                raise DataError(f"{find_path(name)}: {error}") from None
            topics = log.topics()
        recording = ""
        if recordings_folder is not None:
            stem = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "-" for c in name)
            recording = f"{RUNS}/{number:02}-{stem[-60:]}.rrd"
            (recordings_folder / RUNS).mkdir(exist_ok=True)
            write_recording(replayed, recordings_folder / recording)
        frames.append(
            make_readings_of_campaign_runs(replayed, runs, campaign.method.estimator, procedure)
        )
        responses += make_run_changes_per_learnt_mean_u(replayed, runs, campaign.method.estimator)
        logs.append(make_evidence_log_record(name, replayed, topics, recording))
        if not logs[-1].can_weigh:
            refusals[name] = describe_why_log_cannot_weigh(replayed)
        budgets.append(replayed.frames["budget"])
        terms += (
            list_learnable_term_estimates(name, replayed.frames["nuisances"])
            if logs[-1].can_weigh
            else ()
        )
    return CampaignReplay(
        pl.concat(frames), tuple(logs), tuple(budgets), tuple(terms), tuple(responses), refusals
    )


def describe_why_log_cannot_weigh(replayed_run: Run) -> str:
    """Say why a log cannot weigh (invalidating causes, failed checks), and how to remedy it."""
    reasons: list[str] = []
    for row in replayed_run.frames["findings"].filter(severity="withhold").to_dicts():
        mends = f". Set {row['setting']} = {row['value']}" if row["setting"] else ""
        reasons.append(f"{row['cause'].replace('_', ' ')}: {row['evidence']}{mends}")
    for check in make_answer(replayed_run).verdict.list_withholding_checks("mass"):
        if check.check == INVALIDATING_CAUSES:
            continue
        value = "unknown" if check.value is None else f"{check.value:.3g}"
        mends = f". Remedy: {check.remedy}" if check.remedy else ""
        reasons.append(f"{check.check} {value} (limit {check.limit_text}): {check.meaning}{mends}")
    return "; ".join(reasons)


def copy_machine_with_single_load_if_stated(
    machine: Machine, runs: Sequence[CampaignRun]
) -> Machine:
    """Copy the machine with `single_load` if the runs state one load for the whole log."""
    whole = all(each.from_s is None and each.to_s is None for each in runs)
    is_empty_stated = machine.settings.loads.empty_from_s is not None
    if not whole or is_empty_stated or len({each.load_id for each in runs}) != 1:
        return machine
    settings = machine.settings.copy_with_changes({"loads.single_load": True})
    return machine.model_copy(update={"settings": settings})


@cache
def collect_software_versions() -> Software:
    """Versions of payscope, its libraries and the platform."""
    return Software(
        payscope=version("payscope"),
        distributions=_list_installed_requirement_versions(),
        python=platform.python_version(),
        platform=platform.platform(),
    )


def _list_installed_requirement_versions() -> dict[str, str]:
    """Versions of payscope and all its installed direct and indirect requirements, by name."""
    found: dict[str, str] = {}
    waiting = ["payscope"]
    while waiting:
        name = waiting.pop()
        try:
            about = distribution(name)
        except PackageNotFoundError:
            continue
        if about.name not in found:
            found[about.name] = about.version
            waiting += [_NAME.split(each, maxsplit=1)[0] for each in about.requires or ()]
    return dict(sorted(found.items()))


def format_current_utc_time() -> str:
    """Current time in UTC as evidence states it: `2026-01-31T12:00:00Z`."""
    return f"{dt.datetime.now(dt.UTC):%Y-%m-%dT%H:%M:%SZ}"


def generate_random_evidence_id() -> str:
    """Random unique id for evidence."""
    return str(uuid4())


def make_evidence_log_record(
    name: str, replayed_run: Run, topics: pl.DataFrame, recording: str
) -> EvidenceLog:
    """Make the record of a replayed log that evidence keeps."""
    about = replayed_run.provenance
    said = make_answer(replayed_run)
    excitation = replayed_run.frames["excitation"]
    speed = (
        excitation["speed_x_m_s"].drop_nulls() if excitation.height else pl.Series(dtype=pl.Float64)
    )
    messages = dict(zip(topics["topic"], topics["messages"], strict=True))
    taken = about.fingerprint
    assert taken is not None
    t_ns = replayed_run.frames["aligned"]["t_ns"]
    return EvidenceLog(
        log=name,
        files=tuple(EvidenceFile(**each.model_dump()) for each in about.inputs),
        topics=tuple(
            LoggedTopic(topic=topic, messages=messages.get(topic, 0), stamped_by=stamped)
            for topic, stamped in sorted(about.stamps.items())
        ),
        begins=_format_start_as_iso_time(about.t0_unix_ns),
        duration_s=float(t_ns[-1] - t_ns[0]) / 1e9 if t_ns.len() else 0.0,
        speed_range_m_s=None if speed.is_empty() else _find_min_and_max(speed),
        losses=tuple(str(loss)[: LIMITS.loss_characters] for loss in about.losses),
        notes=tuple(note[: LIMITS.loss_characters] for note in about.notes),
        can_weigh=said.verdict.can_weigh,
        failed_checks=tuple(check.check for check in said.verdict.list_withholding_checks("mass")),
        settings_fingerprint=taken.settings,
        results_fingerprint=taken.results,
        recording=recording,
        machine_id=about.logged_machine_id[: LIMITS.machine_id_characters],
    )


class _ValueRange(NamedTuple):
    """Smallest and largest value of a column."""

    low: float
    high: float


def _find_min_and_max(values: pl.Series) -> _ValueRange:
    numbers = values.to_numpy()
    return _ValueRange(float(numbers.min()), float(numbers.max()))


def _format_start_as_iso_time(t0_unix_ns: int) -> str:
    if t0_unix_ns < FIRST_DATE_NS:
        return f"{t0_unix_ns / 1e9:.3f} s of the log's own clock"
    stamp = dt.datetime.fromtimestamp(t0_unix_ns // 10**9, dt.UTC)
    return f"{stamp:%Y-%m-%d %H:%M:%S} UTC"
