"""The command `calibrate`: make a bundle of evidence from a campaign file."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import polars as pl

from analysis.calibration.campaign.campaign_fit import (
    CampaignFit,
    fit_campaign_line,
    list_stated_uncertainties_of_force_scale,
    make_calibration_options,
)
from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.calibration.line.calibration import CalibrationOptions
from analysis.calibration.line.procedure import PRESENT_NUMBER
from analysis.calibration.use.calibration_drift import DriftCheck
from analysis.calibration.use.error_limits import WITHIN
from analysis.calibration.use.learnt_priors import LearntPriors, copy_machine_with_learnt_priors
from analysis.calibration.use.use_limits import LIMITS as USE_LIMITS
from analysis.model.machine import Machine
from estimators.errors import CampaignError, EvidenceError, OutputError
from recordings.calibration.bundle_checks import check_bundle
from recordings.calibration.bundle_folder import EVIDENCE, STATEMENT
from recordings.calibration.calibration_recording import write_calibration_recording
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.derived_values import (
    evaluate_previous_line_as_found,
    make_estimator_with_digest,
    make_reference_loads_and_covariance,
)
from recordings.calibration.evidence_document import (
    FORMAT,
    NOTICE,
    Chain,
    Estimator,
    EvidenceDocument,
    EvidenceTables,
    Link,
    Signer,
)
from recordings.calibration.timestamp import encode_timestamp_request
from recordings.calibration.write_bundle import encode_evidence_tables, write_bundle
from recordings.report.atomic_output import (
    require_writable_folder,
    stage_output_file,
    stage_output_files,
)
from recordings.signatures.canonical_json import encode_canonical_json
from recordings.signatures.keyring import load_keyring, read_valid_signing_key_or_none
from recordings.signatures.signing import SigningKey
from replay.calibration import refuse_campaign
from replay.calibration.campaign_file import load_campaign_and_machine
from replay.calibration.campaign_limits import LIMITS
from replay.calibration.campaign_runs import (
    CampaignReplay,
    collect_software_versions,
    format_current_utc_time,
    generate_random_evidence_id,
    replay_campaign_logs,
)
from replay.calibration.dcc_output import DccOutput, require_dcc_inputs, write_and_verify_dcc


@dataclass(frozen=True, slots=True)
class CalibrationOutcome:
    """Result of `calibrate`, and the files it wrote.

    Attributes:
        folder: folder of the bundle.
        document: the evidence.
        readings: frame `readings`.
        points: points of the calibration, a row per run.
        remarks: remarks for the user, one per line.
        refusals: why a log cannot weigh, by log; logs that can are absent.
    """

    folder: Path
    document: EvidenceDocument
    readings: pl.DataFrame
    points: pl.DataFrame
    remarks: tuple[str, ...]
    refusals: Mapping[str, str]

    @property
    def rejected_readings(self) -> pl.DataFrame:
        """Readings that are not used, with their reasons."""
        return self.readings.filter(~pl.col("used"))

    @property
    def is_within_limits(self) -> bool:
        """Whether a line was fitted, meets its limits (if any), and no drift check failed."""
        said = self.document
        limits = said.limits is None or said.limits.verdict == WITHIN
        # a check without a result has not passed
        steady = said.drift is None or said.drift.drifted is False
        return said.calibration is not None and limits and steady

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "folder": str(self.folder),
            "evidence": self.document.model_dump(mode="json"),
            "points": self.points.to_dicts(),
            "rejected": self.rejected_readings.to_dicts(),
            "refusals": dict(self.refusals),
            "signed": self.document.signer is not None,
            "remarks": list(self.remarks),
        }


@dataclass(frozen=True, slots=True)
class EvidenceParts:
    """Parts of evidence before it is written.

    Attributes:
        kind: "calibration" or "check".
        campaign: reference masses and runs.
        machine: machine with its settings.
        learnt: priors learnt from the logs; None if there are none.
        replayed: readings of the runs, and a record of each log.
        options: options of the fit.
        fitted: line, points and limits.
        drift: drift found by a check.
    """

    kind: Literal["calibration", "check"]
    campaign: CalibrationCampaign
    machine: Machine
    learnt: LearntPriors | None
    replayed: CampaignReplay
    options: CalibrationOptions
    fitted: CampaignFit
    drift: DriftCheck | None = None


def calibrate_from_campaign(  # noqa: PLR0913  each is an option of the command
    campaign_file: Path,
    folder: Path,
    *,
    key_file: Path | None = None,
    previous: Path | None = None,
    keeps_recordings: bool = False,
    overwrites: bool = False,
    timestamp_request_file: Path | None = None,
    dcc: DccOutput | None = None,
    on_log: Callable[[str], None] = lambda _: None,
) -> CalibrationOutcome:
    """Replay a campaign's runs, fit the line, and write the evidence.

    Args:
        campaign_file: path of the campaign file.
        folder: bundle to write.
        key_file: private key; without it PAYSCOPE_SIGNING_KEY may hold one.
        previous: the machine's previous evidence.
        keeps_recordings: whether to include each replay's recording in the bundle.
        overwrites: whether evidence in `folder` may be replaced.
        timestamp_request_file: file for the query to a time-stamp authority; None writes none.
        dcc: output of the digital calibration certificate; None writes none.
        on_log: called with each log's name when its replay begins.

    Raises:
        PayscopeError: the input is invalid; nothing has been written.
    """
    campaign, machine = load_campaign_and_machine(campaign_file)
    # through the form in evidence, whose keys are in another order: the same frames result
    machine = Machine.model_validate_json(encode_canonical_json(machine.model_dump(mode="json")))
    key = read_valid_signing_key_or_none(key_file)
    xml_key = (
        None
        if dcc is None
        else require_dcc_inputs(campaign_file, campaign, dcc, overwrites=overwrites)
    )
    before = (
        None if previous is None else read_previous_evidence(previous, campaign.machine.id, key)
    )
    refuse_campaign.refuse_outputs_among_campaign_files(
        campaign_file, campaign, (folder, timestamp_request_file, dcc and dcc.file)
    )
    require_writable_folder(folder, overwrites=overwrites, marker=EVIDENCE)
    stretch = refuse_campaign.load_range_of_notary_list(campaign_file, campaign)
    if timestamp_request_file is not None:
        refuse_campaign.refuse_impossible_timestamp_request(
            timestamp_request_file, key, overwrites=overwrites
        )
    with stage_output_files([folder], overwrites=overwrites) as stage:
        made = stage / folder.name
        made.mkdir()

        def find_path_of_log(log: str) -> Path:
            return campaign_file.parent / log

        learnt = None
        if campaign.learns_priors and len(campaign.log_names) >= USE_LIMITS.min_logs:
            # with the machine's own priors, to learn priors from all logs together
            first = replay_campaign_logs(campaign, machine, find_path_of_log, None, on_log)
            refuse_campaign.refuse_run_days_unlike_logs(campaign_file, campaign, first, machine)
            refuse_campaign.refuse_unaccounted_logs_of_list(campaign_file, campaign, first, stretch)
            learnt = first.priors_learnt_from_logs
        weighing = (
            machine if learnt is None else copy_machine_with_learnt_priors(machine, learnt.terms)
        )
        replayed = replay_campaign_logs(
            campaign, weighing, find_path_of_log, made if keeps_recordings else None, on_log
        )
        refuse_campaign.refuse_run_days_unlike_logs(campaign_file, campaign, replayed, machine)
        refuse_campaign.refuse_repeated_runs(campaign_file, campaign, replayed)
        refuse_campaign.refuse_machine_unlike_logs(campaign_file, campaign, replayed, machine)
        refuse_campaign.refuse_unaccounted_logs_of_list(campaign_file, campaign, replayed, stretch)
        if learnt is not None:
            learnt = learnt.model_copy(update={"responses": replayed.responses})
        on_log("evidence")
        options = make_calibration_options(
            campaign, list_stated_uncertainties_of_force_scale(campaign, replayed.budgets)
        )
        fitted = fit_campaign_line(
            campaign, machine.machine, replayed.readings, options, replayed.responses
        )
        evidence = EvidenceParts(
            "calibration", campaign, machine, learnt, replayed, options, fitted
        )
        calibrated = write_verified_evidence(evidence, made, folder, key, before, previous, stretch)
    if timestamp_request_file is not None:
        write_timestamp_request(folder, timestamp_request_file, overwrites=overwrites)
    if dcc is None:
        return calibrated
    remark = write_and_verify_dcc(folder, calibrated.document, dcc, xml_key, overwrites=overwrites)
    return replace(calibrated, remarks=(*calibrated.remarks, remark))


def write_timestamp_request(bundle_folder: Path, file: Path, *, overwrites: bool) -> None:
    """Write the time-stamp query for the signature of a bundle."""
    query = encode_timestamp_request((bundle_folder / STATEMENT).read_bytes())
    with stage_output_file(file, overwrites=overwrites) as partial:
        partial.write_bytes(query)


def read_previous_evidence(
    previous: Path, machine_id: str | None, key: SigningKey | None
) -> CheckedBundle:
    """Read and verify the machine's previous evidence.

    Args:
        previous: folder of the evidence.
        machine_id: serial number it must have; None for any.
        key: key that signs the new evidence; None if it stays unsigned.

    Raises:
        EvidenceError: it is of another machine, verification fails, or it is signed by a key that
            is neither `key` nor in the user's keyring.
    """
    checked = check_bundle(previous, None, None, load_keyring())
    wrong = checked.evidence_faults
    if wrong or checked.document is None:
        first = str(wrong[0]) if wrong else "no evidence"
        raise EvidenceError(f"{previous}: cannot be used as --previous: {first}")
    machine = checked.document.campaign.machine.id
    if machine_id not in (None, machine):
        raise EvidenceError(
            f"{previous}: is evidence of machine '{machine}', this campaign is for "
            f"'{machine_id}'; give evidence of the same machine"
        )
    by = checked.signed_by
    if key is not None and by.how == "unsigned":
        raise EvidenceError(
            f"{previous}: is unsigned, and signed evidence cannot follow unsigned evidence; leave "
            "out --previous to start a signed chain, or --key to continue the unsigned one"
        )
    own = key is not None and by.key_id == key.public_key.key_id
    if by.how == "unknown" and not own:
        raise EvidenceError(
            f"{previous}: is {by}, so its signature cannot be verified; if the signer gave you "
            f"this key in person, add it to your keyring with {by.command_to_add_key}"
        )
    return checked


def write_verified_evidence(
    evidence: EvidenceParts,
    staging_folder: Path,
    final_folder: Path,
    key: SigningKey | None,
    earlier_bundle: CheckedBundle | None,
    previous: Path | None,
    list_range: bytes | None = None,
) -> CalibrationOutcome:
    """Write the evidence, verify it, and move it to its final folder.

    Args:
        evidence: parts of the evidence.
        staging_folder: temporary folder, which already contains the recordings.
        final_folder: folder that it becomes once it is verified.
        key: signing key; None leaves it unsigned.
        earlier_bundle: the machine's previous evidence.
        previous: folder of that previous evidence.
        list_range: part of the recorder's notary list, if the campaign names one.

    Raises:
        CampaignError: no run gave a reading.
        OutputError: the written evidence fails verification.
    """
    readings, points = evidence.replayed.readings, evidence.fitted.point_frame
    if readings["mass_kg"].null_count() == readings.height:
        raise CampaignError(
            f"{', '.join(evidence.campaign.log_names)}: no run yielded a reading; "
            "run `payscope run` on each log to see why"
        )
    tables, digests = encode_evidence_tables(readings, points)
    document = _make_evidence_document(evidence, digests, key, earlier_bundle)
    write_calibration_recording(staging_folder, document, readings, points)
    remarks = write_bundle(staging_folder, document, readings, points, tables, key, list_range)
    checked = check_bundle(staging_folder, None if key is None else key.public_key, previous)
    wrong = [str(each) for each in checked.evidence_faults]
    if wrong:
        raise OutputError(
            f"{final_folder}: the written evidence failed verification, so it was removed: "
            + "; ".join(wrong[: LIMITS.max_faults])
        )
    refusals = evidence.replayed.refusals
    return CalibrationOutcome(final_folder, document, readings, points, tuple(remarks), refusals)


def _make_evidence_document(
    evidence: EvidenceParts,
    digests: EvidenceTables,
    key: SigningKey | None,
    previous_bundle: CheckedBundle | None,
) -> EvidenceDocument:
    campaign, machine, fitted = evidence.campaign, evidence.machine, evidence.fitted
    loads, covariance = make_reference_loads_and_covariance(campaign, machine)
    learnt = evidence.learnt
    weighing = machine if learnt is None else copy_machine_with_learnt_priors(machine, learnt.terms)
    estimator = make_estimator_with_digest(campaign, weighing)
    last = None if previous_bundle is None else previous_bundle.document
    document = EvidenceDocument(
        format=FORMAT,
        kind=evidence.kind,
        id=generate_random_evidence_id(),
        made=format_current_utc_time(),
        notice=NOTICE,
        campaign=campaign,
        # a check does not extend the validity of the calibration
        expires=last.expires if last and evidence.kind == "check" else campaign.last_valid_day,
        machine=machine,
        learnt=learnt,
        estimator=estimator,
        logs=evidence.replayed.logs,
        references=loads,
        reference_covariance_kg2=covariance,
        tables=digests,
        options=evidence.options,
        calibration=fitted.calibration,
        no_fit=fitted.no_fit,
        limits=fitted.limits,
        drift=evidence.drift,
        as_found=evaluate_previous_line_as_found(
            last, make_previous_estimator(last), estimator, fitted.point_frame
        ),
        replay_tolerance_kg=LIMITS.replay_tolerance_kg,
        procedure=last.procedure if last and evidence.kind == "check" else PRESENT_NUMBER,
        chain=_make_link_to_previous_evidence(previous_bundle),
        signer=None if key is None else _make_signer_of_campaign(campaign, key),
        software=collect_software_versions(),
    )
    return document.with_all_settings


def make_previous_estimator(previous_evidence: EvidenceDocument | None) -> Estimator | None:
    """Estimator of the previous evidence, its digest computed by this version; None without it."""
    if previous_evidence is None:
        return None
    return make_estimator_with_digest(
        previous_evidence.campaign, previous_evidence.weighing_machine
    )


def _make_signer_of_campaign(campaign: CalibrationCampaign, key: SigningKey) -> Signer:
    name = campaign.campaign.signer
    return Signer(name=name, key_id=key.public_key.key_id, public_key=key.public_key.base64_text)


def _make_link_to_previous_evidence(previous_bundle: CheckedBundle | None) -> Chain:
    """Counter of new evidence in the machine's chain, and its link to the previous evidence."""
    if previous_bundle is None or previous_bundle.document is None:
        return Chain(counter=1, previous=None)
    last = previous_bundle.document
    link = Link(
        id=last.id,
        counter=last.chain.counter,
        sums_sha256=hashlib.sha256(previous_bundle.sums).hexdigest(),
    )
    return Chain(counter=last.chain.counter + 1, previous=link)
