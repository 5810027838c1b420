"""Reject campaigns that contradict their logs, machine file or notary list."""

import datetime as dt
from collections.abc import Iterable
from pathlib import Path

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.model.machine import Machine
from estimators.errors import CampaignError, EvidenceError
from recordings.calibration.campaign_faults import (
    iter_machine_id_contradictions,
    iter_repeated_run_sentences,
    iter_sentences_on_run_days_unlike_logs,
)
from recordings.calibration.notary_stretch import (
    cut_range_from_notary_list,
    iter_unaccounted_log_sentences,
)
from recordings.calibration.timestamp import require_timestamp_library
from recordings.notary.notary_check import check_untrusted_notary_list
from recordings.report.atomic_output import refuse_input_as_output, require_writable_output
from recordings.signatures.signing import SigningKey
from replay.calibration.campaign_runs import CampaignReplay


def refuse_outputs_among_campaign_files(
    campaign_path: Path, campaign: CalibrationCampaign, outputs: Iterable[Path | None]
) -> None:
    """Raise an error if an output would replace an input of the campaign.

    Args:
        campaign_path: campaign file.
        campaign: contents of that file.
        outputs: files and folders to write; None for each that was not requested.

    Raises:
        OutputError: an output is the campaign file, its machine file, its notary list or a log.
    """
    names = [campaign.machine.file, *campaign.log_names]
    if campaign.notary is not None:
        names.append(campaign.notary.list)
    paths = [campaign_path, *(campaign_path.parent / name for name in names)]
    for output in outputs:
        if output is not None:
            refuse_input_as_output(output, (path for path in paths if path.exists()))


def refuse_impossible_timestamp_request(
    file: Path, key: SigningKey | None, *, overwrites: bool
) -> None:
    """Raise an error, before any log is replayed, if a time stamp cannot be requested.

    Raises:
        EvidenceError: there is no signature to stamp, or rfc3161-client is not installed.
        OutputError: the file cannot be written.
    """
    if key is None:
        raise EvidenceError("--timestamp-request needs a signature; give --key")
    require_timestamp_library()
    require_writable_output(file, overwrites=overwrites)


def refuse_run_days_unlike_logs(
    campaign_path: Path,
    campaign: CalibrationCampaign,
    replayed_logs: CampaignReplay,
    machine: Machine,
) -> None:
    """Raise an error if a run's day contradicts its log.

    Args:
        campaign_path: file that gives the days, for the error message.
        campaign: the campaign.
        replayed_logs: replays of its logs.
        machine: machine file, whose time zone applies to the days.

    Raises:
        CampaignError: a run's log is of another day.
    """
    faults = iter_sentences_on_run_days_unlike_logs(
        campaign, replayed_logs.logs, machine.machine.time_zone, dt.datetime.now(dt.UTC)
    )
    fault = next(faults, None)
    if fault is not None:
        raise CampaignError(f"{campaign_path}: {fault}; correct its day, or machine.timezone")


def refuse_repeated_runs(
    campaign_path: Path, campaign: CalibrationCampaign, replayed_logs: CampaignReplay
) -> None:
    """Raise an error if two runs use the same data.

    Raises:
        CampaignError: the same data would count twice.
    """
    fault = next(
        iter_repeated_run_sentences(campaign, replayed_logs.logs, replayed_logs.readings), None
    )
    if fault is not None:
        raise CampaignError(f"{campaign_path}: {fault}; remove one, or say why in excluded")


def refuse_machine_unlike_logs(
    campaign_path: Path,
    campaign: CalibrationCampaign,
    replayed_logs: CampaignReplay,
    machine: Machine,
) -> None:
    """Raise an error if logs or machine file name another machine than the campaign.

    Raises:
        CampaignError: another machine is named.
    """
    fault = next(
        iter_machine_id_contradictions(campaign.machine.id, machine, replayed_logs.logs), None
    )
    if fault is not None:
        raise CampaignError(
            f"{campaign_path}: {fault}; give logs and the machine file of one machine"
        )


def load_range_of_notary_list(campaign_path: Path, campaign: CalibrationCampaign) -> bytes | None:
    """Read and verify the part of a notary list that a campaign names; None if it names none.

    Args:
        campaign_path: campaign file; the list's path is relative to its folder.
        campaign: the campaign.

    Raises:
        CampaignError: the list cannot be read, is incomplete, or is too short.
    """
    stretch = campaign.notary
    if stretch is None:
        return None
    path = campaign_path.parent / stretch.list
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CampaignError(f"{path}: cannot be read ({error.strerror})") from None
    # a notary may be writing it: bytes after the last complete line are not in the range
    kept = check_untrusted_notary_list(data[: data.rfind(b"\n") + 1], dt.datetime.now(dt.UTC))
    last = kept.log_entries[-1].counter if kept.log_entries else 0
    faults = [
        each.what
        for each in kept.faults
        if each.forged
        or (
            stretch.first <= each.counter <= stretch.last
            and each.counter not in stretch.omission_reason_by_log_number
        )
    ]
    if faults:
        raise CampaignError(
            f"{path}: {faults[0]}; `payscope verify {path}` lists all faults; to leave out a log, "
            "give the reason in notary.left_out"
        )
    if last < stretch.last:
        raise CampaignError(
            f"{campaign_path}: notary.last is {stretch.last}, but {path} ends at number {last}; "
            "`payscope notarise` continues the list"
        )
    wanted = campaign.machine.id
    if kept.head is not None and kept.head.machine_id not in ("", wanted):
        raise CampaignError(
            f"{path}: is the notary list of machine '{kept.head.machine_id}', but the campaign is "
            f"for '{wanted}'; give the list of that machine's recorder"
        )
    return cut_range_from_notary_list(data, stretch)


def refuse_unaccounted_logs_of_list(
    campaign_path: Path,
    campaign: CalibrationCampaign,
    replayed_logs: CampaignReplay,
    list_range: bytes | None,
) -> None:
    """Raise an error if a campaign omits a log of its part of the list without a reason.

    Raises:
        CampaignError: a log is omitted, or a log of the campaign is not in the list.
    """
    if campaign.notary is None or list_range is None:
        return
    kept = check_untrusted_notary_list(list_range, dt.datetime.now(dt.UTC), campaign.notary.first)
    fault = next(
        iter_unaccounted_log_sentences(campaign.notary, replayed_logs.logs, kept.log_entries), None
    )
    if fault is not None:
        raise CampaignError(
            f"{campaign_path}: notary: {fault}; add a run for that log, or give the reason for "
            "leaving it "
            "out in notary.left_out"
        )
