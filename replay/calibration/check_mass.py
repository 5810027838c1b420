"""`calibrate --check`: check a machine with one known mass between calibrations."""

import datetime as dt
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from analysis.calibration.campaign.campaign_fit import check_single_load_by_calibration
from analysis.calibration.campaign.campaign_plan import CalibrationCampaign, CampaignRun
from analysis.calibration.campaign.campaign_subjects import Conditions, ReferenceMass
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from estimators.errors import CampaignError, EvidenceError
from recordings.calibration.bundle_folder import EVIDENCE
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.report.atomic_output import require_writable_folder, stage_output_files
from recordings.signatures.keyring import read_valid_signing_key_or_none
from replay.calibration.calibrate_campaign import (
    CalibrationOutcome,
    EvidenceParts,
    read_previous_evidence,
    write_verified_evidence,
)
from replay.calibration.campaign_runs import replay_campaign_logs
from replay.calibration.refuse_campaign import (
    refuse_machine_unlike_logs,
    refuse_run_days_unlike_logs,
)
from replay.logs import open_log
from replay.machines.machine_file import find_time_axis_of_machine

_MASS: Final = "check-mass"


@dataclass(frozen=True, slots=True)
class KnownMassOnBoard:
    """A known mass on board.

    Attributes:
        value_kg: the mass; 0 for an empty machine.
        u_kg: its standard uncertainty.
        certificate: number of its certificate.
        day: day of the log as YYYY-MM-DD; None takes it from the log.
    """

    value_kg: float
    u_kg: float
    certificate: str
    day: str | None


def write_evidence_of_mass_check(
    log: Path,
    mass_on_board: KnownMassOnBoard,
    evidence_folder: Path,
    *,
    previous: Path,
    key_file: Path | None = None,
    overwrites: bool = False,
    on_log: Callable[[str], None] = lambda _: None,
) -> CalibrationOutcome:
    """Replay a log with a known mass, compare the reading, and write the evidence.

    Machine, settings and priors are those of the calibration.

    Args:
        log: log with the known mass on board throughout.
        mass_on_board: the mass.
        evidence_folder: bundle to write.
        previous: evidence of the calibration, or of an earlier check.
        key_file: private key; without it PAYSCOPE_SIGNING_KEY may hold one.
        overwrites: whether evidence in `evidence_folder` may be replaced.
        on_log: called with the log's name when its replay begins.

    Raises:
        PayscopeError: the input is invalid; nothing has been written.
    """
    key = read_valid_signing_key_or_none(key_file)
    before = read_previous_evidence(previous, None, key)
    last = before.document
    if last is None or last.calibration is None:
        raise EvidenceError(f"{previous}: has no calibration line to check; calibrate first")
    campaign = _make_campaign_of_single_run(last, log, mass_on_board)
    require_writable_folder(evidence_folder, overwrites=overwrites, marker=EVIDENCE)
    with stage_output_files([evidence_folder], overwrites=overwrites) as stage:
        made = stage / evidence_folder.name
        made.mkdir()
        replayed = replay_campaign_logs(
            campaign, last.weighing_machine, lambda _: log, None, on_log, last.procedure_rules
        )
        refuse_machine_unlike_logs(previous, campaign, replayed, last.machine)
        refuse_run_days_unlike_logs(
            Path(f"--day {mass_on_board.day}"), campaign, replayed, last.machine
        )
        on_log("evidence")
        fitted, drift = check_single_load_by_calibration(
            campaign, last.machine.machine, replayed.readings, last.calibration
        )
        evidence = EvidenceParts(
            "check", campaign, last.machine, last.learnt, replayed, last.options, fitted, drift
        )
        return write_verified_evidence(evidence, made, evidence_folder, key, before, previous)


def _make_campaign_of_single_run(
    calibration: EvidenceDocument, log: Path, mass_on_board: KnownMassOnBoard
) -> CalibrationCampaign:
    """Make a campaign whose only run is the log with the known mass on board."""
    if mass_on_board.value_kg < 0.0:
        raise CampaignError(f"--check {mass_on_board.value_kg:g}: give a mass of at least 0 kg")
    mass = ReferenceMass.model_validate(
        {
            "id": _MASS,
            "value_kg": mass_on_board.value_kg or 1.0,
            "u_kg": mass_on_board.u_kg,
            "certificate": mass_on_board.certificate,
        }
    )
    run = CampaignRun.model_validate(
        {
            "id": "check",
            "log": log.name,
            "loads": (_MASS,) if mass_on_board.value_kg else (),
            "day": _choose_date_of_check(calibration, log, mass_on_board.day),
        }
    )
    return calibration.campaign.model_copy(
        update={
            "masses": (mass,) if mass_on_board.value_kg else (),
            "runs": (run,),
            "conditions": Conditions.model_validate({}),
            "notary": None,
            "decision": None,
        }
    )


def _choose_date_of_check(
    calibration: EvidenceDocument, log: Path, given_day: str | None
) -> dt.date:
    """The given day, or else the day of the log in the machine's time zone."""
    if given_day is not None:
        try:
            return dt.date.fromisoformat(given_day)
        except ValueError:
            raise CampaignError(
                f"--day {given_day}: is not a date; write it as 2026-05-31"
            ) from None
    with open_log(log, time=find_time_axis_of_machine(calibration.machine)) as opened:
        start_ns = opened.topics()["start_ns"].min()
    if not isinstance(start_ns, int) or start_ns < FIRST_DATE_NS:
        raise CampaignError(f"{log}: has no date; give it with --day")
    zone = calibration.machine.machine.time_zone
    return dt.datetime.fromtimestamp(start_ns // 10**9, zone).date()
