"""Find contradictions between a campaign and its logs, machine file and date."""

import datetime as dt
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final
from zoneinfo import ZoneInfo

import polars as pl

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign, CampaignRun
from analysis.model.machine import Machine
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.evidence_document import EvidenceDocument, EvidenceLog

_BEGINS: Final = "%Y-%m-%d %H:%M:%S UTC"


def parse_start_time_of_log(log: EvidenceLog) -> dt.datetime | None:
    """Parse the start time of a log; None without absolute time."""
    try:
        return dt.datetime.strptime(log.begins, _BEGINS).replace(tzinfo=dt.UTC)
    except ValueError:
        return None


def iter_sentences_on_run_days_unlike_logs(
    campaign: CalibrationCampaign,
    logs: Sequence[EvidenceLog],
    zone: ZoneInfo,
    evidence_creation: dt.datetime,
) -> Iterator[str]:
    """Yield a sentence for each run whose stated day disagrees with its log or with the evidence.

    Args:
        campaign: the campaign.
        logs: the replayed logs.
        zone: time zone of the machine.
        evidence_creation: time at which the evidence was made.
    """
    by_name = {each.log: each for each in logs}
    for run in campaign.runs:
        log = by_name.get(run.log)
        begin = None if log is None else parse_start_time_of_log(log)
        if log is None:
            continue
        if begin is None:
            if run.day > evidence_creation.astimezone(zone).date():
                yield (
                    f"run '{run.id}' of {run.day}: is after the evidence was made, "
                    f"{evidence_creation:%F %R}"
                )
            continue
        start, end = _compute_run_span(run, log, begin)
        first, last = start.astimezone(zone).date(), end.astimezone(zone).date()
        if not first <= run.day <= last:
            yield (
                f"run '{run.id}' of {run.day}: its log {run.log} was recorded on {first} in the "
                f"machine's time zone, {zone.key}"
            )
        if end > evidence_creation + dt.timedelta(seconds=LIMITS.clock_difference_s):
            yield (
                f"run '{run.id}': its log {run.log} ends {end:%F %R} UTC, after the evidence was "
                f"made, {evidence_creation:%F %R} UTC"
            )


def iter_repeated_run_sentences(
    campaign: CalibrationCampaign, logs: Sequence[EvidenceLog], readings: pl.DataFrame
) -> Iterator[str]:
    """Yield a sentence for each pair of runs that count the same starts twice.

    Runs of a machine cannot overlap in time, and no two runs give masses that are equal to the last
    bit. Excluded runs are not considered.

    Args:
        campaign: the campaign, whose runs do not overlap within a log.
        logs: the replayed logs.
        readings: frame `readings` of all runs.
    """
    by_name = {each.log: each for each in logs}
    counted = [run for run in campaign.runs if not run.excluded and run.log in by_name]
    groups = readings.filter("used").partition_by("run_id", as_dict=True)
    masses_kg = {run_id: tuple(rows["mass_kg"]) for (run_id,), rows in groups.items()}
    runs_by_masses: dict[tuple[float, ...], CampaignRun] = {}
    for run in counted:
        first = runs_by_masses.setdefault(masses_kg.get(run.id, ()), run)
        if masses_kg.get(run.id) and first is not run:
            yield (
                f"runs '{first.id}' and '{run.id}' have the same readings to the last bit: one "
                "drive counts twice"
            )
    starts = {log.log: parse_start_time_of_log(log) for log in logs}
    spans = sorted(
        (*_compute_run_span(run, by_name[run.log], start), run.id, run.log)
        for run in counted
        if (start := starts[run.log]) is not None
    )
    for (_, end, one, log), (start, other_end, two, other_log) in pairwise(spans):
        common_s = (min(end, other_end) - start).total_seconds()
        if log != other_log and common_s > LIMITS.common_time_s:
            yield (
                f"runs '{one}' and '{two}': {common_s:.0f} s of {log} and {other_log} were "
                "recorded at the same time: one drive counts twice"
            )


def select_runs_without_date(document: EvidenceDocument) -> list[CampaignRun]:
    """Select the runs whose logs have no absolute time, so that their days are unproven."""
    without = {each.log for each in document.logs if parse_start_time_of_log(each) is None}
    return [run for run in document.campaign.runs if run.log in without]


def parse_creation_time(document: EvidenceDocument) -> dt.datetime:
    """Parse the time at which the evidence was made, as it states."""
    return dt.datetime.fromisoformat(document.made)


def _compute_run_span(
    run: CampaignRun, log: EvidenceLog, log_begin: dt.datetime
) -> tuple[dt.datetime, dt.datetime]:
    """Compute start and end of a run, in absolute time."""
    from_s = min(run.from_s or 0.0, log.duration_s)
    to_s = log.duration_s if run.to_s is None else min(run.to_s, log.duration_s)
    return log_begin + dt.timedelta(seconds=from_s), log_begin + dt.timedelta(
        seconds=max(from_s, to_s)
    )


def iter_machine_id_contradictions(
    serial_number: str, machine: Machine, logs: Sequence[EvidenceLog]
) -> Iterator[str]:
    """Yield a sentence for the machine file and each log whose machine id is not the campaign's.

    Args:
        serial_number: serial number in the campaign.
        machine: machine file.
        logs: the replayed logs.
    """
    named = machine.machine.id
    if named not in (None, serial_number):
        yield (
            f"the machine file belongs to machine '{named}', but the campaign to '{serial_number}'"
        )
    for log in logs:
        if log.machine_id not in ("", serial_number):
            yield (
                f"{log.log}: its metadata name machine '{log.machine_id}', but the campaign is "
                f"for '{serial_number}'"
            )


def list_logs_without_machine_id(logs: Sequence[EvidenceLog]) -> list[str]:
    """List the logs that do not name the machine that recorded them."""
    return [log.log for log in logs if not log.machine_id]
