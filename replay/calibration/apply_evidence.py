"""Calibrate masses by a calibration's evidence, and refuse logs to which it does not apply."""

import datetime as dt
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import polars as pl

from analysis.calibration.line.calibration import Calibration
from analysis.calibration.use.apply_calibration import (
    ESTIMATORS,
    calibrate_loads,
    collect_later_log_facts,
)
from analysis.calibration.use.learnt_priors import (
    copy_machine_estimating_learnt_mean_errors,
    copy_machine_with_learnt_priors,
)
from analysis.model.machine import Machine
from analysis.model.run_record import Provenance, Run
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from estimators.errors import EvidenceError, join_first_names
from recordings.calibration.bundle_checks import check_bundle
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.derived_values import select_mass_defining_settings
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.signatures.canonical_json import encode_canonical_json
from recordings.signatures.keyring import (
    Keyring,
    add_key_to_keyring,
    load_keyring,
    validate_known_key,
)
from recordings.signatures.signed_by import SignedBy
from recordings.signatures.signing import read_public_key_file
from replay.calibration.campaign_file import copy_machine_with_campaign_empty_mass
from replay.calibration.campaign_limits import LIMITS
from replay.inputs.machine_identity import find_machine_id_common_to_logs
from replay.logs import Log


@dataclass(frozen=True, slots=True)
class CalibrationRequest:
    """A command's request to apply a calibration.

    Attributes:
        folder: folder of the evidence.
        key_file: public key of the required signer.
        is_signature_required: whether a signature by a given or kept key is required.
        prompt_for_key_owner: function that asks on a terminal whether to trust and keep an unknown
            key; None without a terminal.
    """

    folder: Path
    key_file: Path | None = None
    is_signature_required: bool = False
    prompt_for_key_owner: Callable[[SignedBy], str] | None = None


@dataclass(frozen=True, slots=True)
class MachineCalibration:
    """Verified evidence that contains a calibration line.

    Attributes:
        folder: folder of the evidence.
        document: contents of the evidence.
        calibration: the calibration line.
        signed_by: signer of the evidence.
    """

    folder: Path
    document: EvidenceDocument
    calibration: Calibration
    signed_by: SignedBy

    @property
    def machine_id(self) -> str:
        """Serial number of the calibrated machine."""
        return self.document.campaign.machine.id

    def describe_calibration_in_sentence(self, logged_machine_id: str) -> str:
        """One sentence about the calibration.

        Args:
            logged_machine_id: machine named by the logs; "" if they name none.
        """
        document = self.document
        of = "" if logged_machine_id else ", which the log does not name"
        return (
            f"calibrated: {document.estimator.name} by evidence {document.id} of machine "
            f"{self.machine_id}{of}, {self.signed_by}, valid to {document.expires}; "
            f"intervals of {self.calibration.confidence_1:.0%}"
        )

    def copy_machine_with_calibrated_settings(self, machine: Machine) -> Machine:
        """Copy the machine with the empty mass, priors and settings of the calibration."""
        document = self.document
        machine = copy_machine_with_campaign_empty_mass(document.campaign, machine)
        terms = {} if document.learnt is None else document.learnt.terms
        weighing = copy_machine_with_learnt_priors(machine, terms)
        if self.calibration.responses:
            weighing = copy_machine_estimating_learnt_mean_errors(weighing)
        # through the form in evidence, whose keys are in another order: the same frames result
        return Machine.model_validate_json(encode_canonical_json(weighing.model_dump(mode="json")))

    def list_differing_settings_as_text(self, weighing_machine: Machine) -> str:
        """Name the settings that differ from the calibration's, as a predicate; "" if none does.

        Serial number, channels, settings and priors are compared, since they define the mass; the
        name is compared if there is no serial number.
        """
        mine_id = weighing_machine.machine.id
        if mine_id not in (None, self.machine_id):
            return f"belongs to machine '{self.machine_id}', not to '{mine_id}'"
        kept = dict(
            _iter_settings_by_dotted_name(
                select_mass_defining_settings(
                    self.copy_machine_with_calibrated_settings(self.document.machine)
                )
            )
        )
        mine = dict(_iter_settings_by_dotted_name(select_mass_defining_settings(weighing_machine)))
        name = "machine.name"
        if mine_id is None and kept[name] != mine[name]:
            return f"belongs to machine '{kept[name]}', not to '{mine[name]}'"
        names = {*kept, *mine} - {name}
        differ = [
            f"{each} = {_format_setting_value(kept.get(each))} there and "
            f"{_format_setting_value(mine.get(each))} "
            "here"
            for each in sorted(names)
            if kept.get(each) != mine.get(each)
        ]
        named = join_first_names(differ, LIMITS.max_settings)
        return f"was made with other settings: {named}" if differ else ""

    def require_calibrated_machine(self, weighing_machine: Machine, source: object) -> Machine:
        """Return the machine with its serial number if it is the calibrated one.

        With the serial number set, logs that name another machine are rejected.

        Args:
            weighing_machine: from `copy_machine_with_calibrated_settings`, or from a recording.
            source: file that the machine comes from, for the error message.

        Raises:
            EvidenceError: it is another machine, or its settings differ.
        """
        other = self.list_differing_settings_as_text(weighing_machine)
        if other:
            raise EvidenceError(
                f"{self.folder}: {other} ({source}); calibrate again with these settings, or "
                "replay with those of the calibration"
            )
        body = weighing_machine.machine.model_copy(update={"id": self.machine_id})
        return weighing_machine.model_copy(update={"machine": body})

    def refuse_after_expiry(self, start_ns: int | None, subject: object) -> None:
        """Raise an error for a log recorded after the expiry; an undated log counts as today's.

        Args:
            start_ns: Unix time of the log's start in ns; None if unknown.
            subject: the log, for the error message.

        Raises:
            EvidenceError: the evidence had expired when the log was recorded.
        """
        zone = self.document.machine.machine.time_zone
        if start_ns is not None and start_ns >= FIRST_DATE_NS:
            day = dt.datetime.fromtimestamp(start_ns // 10**9, zone).date()
            of = f"{subject} is of {day}"
        else:
            day = dt.datetime.now(zone).date()
            of = f"{subject} has no date, and today is {day}"
        if day > self.document.expires:
            raise EvidenceError(
                f"{self.folder}: expired on {self.document.expires}, {of}; calibrate again"
            )

    def refuse_logs_of_other_machine(self, logs: Sequence[Log]) -> str:
        """Raise an error for logs of another machine, or recorded after the evidence expired.

        Returns:
            The machine's serial number in the logs' metadata; "" if they have none.

        Raises:
            EvidenceError: the evidence had expired when the last log was recorded.
            LogError: a log is of another machine.
        """
        logged = find_machine_id_common_to_logs(logs, self.machine_id)
        starts = [log.topics()["start_ns"].min() for log in logs]
        known = [start for start in starts if isinstance(start, int)]
        self.refuse_after_expiry(
            max(known) if known else None, ", ".join(str(log.path) for log in logs)
        )
        return logged

    def calibrate_masses_of_loads_frame(
        self, frames: Mapping[str, pl.DataFrame], differing_settings: str = ""
    ) -> pl.DataFrame:
        """Add calibrated masses to the frame `loads`, or the reason why the log has none.

        Args:
            frames: `FRAMES` of a replay with `copy_machine_with_calibrated_settings`.
            differing_settings: `list_differing_settings_as_text` of that machine.
        """
        body = self.copy_machine_with_calibrated_settings(self.document.machine).machine
        log = collect_later_log_facts(
            frames, body, f"the calibration {differing_settings}" if differing_settings else ""
        )
        return calibrate_loads(frames["loads"], self.calibration, log)

    def calibrate_masses_of_run(self, run: Run, differing_settings: str = "") -> Run:
        """Copy the run with calibrated masses and a note about the evidence.

        Args:
            run: a replay with `copy_machine_with_calibrated_settings`.
            differing_settings: `list_differing_settings_as_text` of that machine.
        """
        loads = self.calibrate_masses_of_loads_frame(run.frames, differing_settings)
        said = self.describe_calibration_in_sentence(run.provenance.logged_machine_id)
        about = run.provenance.model_copy(update={"notes": (*run.provenance.notes, said)})
        frames = {**run.frames, "loads": loads}
        return replace(run, frames=frames, provenance=about).with_fingerprint()


def load_and_verify_calibration(request: CalibrationRequest) -> MachineCalibration:
    """Read evidence and verify it as `payscope verify` does.

    Raises:
        EvidenceError: the folder has no evidence or no calibration, verification fails, a required
            signature is missing or by an unknown key, or its method gives no masses in `loads`.
    """
    folder = request.folder
    key = None if request.key_file is None else read_public_key_file(request.key_file)
    keyring = load_keyring()
    found = check_bundle(folder, key, None, keyring)
    document = found.document
    wrong = [each for each in found.findings if each.outcome is not BundleOutcome.OTHER_VERSION]
    if wrong or document is None:
        first = str(next(iter(wrong or found.findings), "no evidence"))
        more = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
        raise EvidenceError(
            f"{folder}: cannot be used to calibrate: {first}{more}; `payscope verify` lists all"
        )
    by = (
        accept_signature_of_known_key(request, found.signed_by, keyring)
        if request.is_signature_required
        else found.signed_by
    )
    if document.kind != "calibration":
        raise EvidenceError(
            f"{folder}: is a check against one known mass; give the calibration that it checked"
        )
    if document.calibration is None:
        raise EvidenceError(f"{folder}: is not a calibration: {document.no_fit}")
    if document.estimator.name not in ESTIMATORS:
        raise EvidenceError(
            f"{folder}: calibrates the estimator '{document.estimator.name}', which does not give "
            "the mass of a load; calibrate again with [method] estimator = "
            f"{' or '.join(map(repr, ESTIMATORS))}"
        )
    return MachineCalibration(folder, document, document.calibration, by)


def accept_signature_of_known_key(
    request: CalibrationRequest, signature: SignedBy, keyring: Keyring
) -> SignedBy:
    """Return the signature if its key is known or the user trusts it now, which is then kept.

    Raises:
        EvidenceError: unsigned, or signed by an unknown key that the user rejects.
    """
    if signature.is_trusted:
        return signature
    if signature.how == "unsigned":
        raise EvidenceError(
            f"{request.folder}: is unsigned; calibrate with --key, or leave out --require-signed"
        )
    owner = (
        ""
        if request.prompt_for_key_owner is None
        else request.prompt_for_key_owner(signature).strip()
    )
    if not owner:
        raise EvidenceError(
            f"{request.folder}: is {signature}; get the key from the signer, and give it with "
            f"--key KEY or keep it: {signature.command_to_add_key}"
        )
    fields = {"key": signature.public_key, "owner": owner}
    known = validate_known_key(fields, f"{keyring.path}: key {signature.key_id[:12]}…")
    add_key_to_keyring(keyring, known)
    return replace(signature, how="known", owner=owner)


def calibrate_loads_of_recording(
    frames: Mapping[str, pl.DataFrame],
    provenance: Provenance,
    request: CalibrationRequest,
    recording: Path,
) -> pl.DataFrame:
    """Calibrate the masses in the frame `loads` of a recording.

    Args:
        frames: the frames of `FRAMES` that the recording has.
        provenance: provenance of the recording.
        request: the evidence to apply.
        recording: path of the recording.

    Raises:
        EvidenceError: as from `load_and_verify_calibration`; also if settings or priors of the
            recording differ from the calibration's, or its log is from after the expiry.
    """
    by = load_and_verify_calibration(request)
    other = by.list_differing_settings_as_text(read_machine_from_provenance(provenance))
    if other:
        raise EvidenceError(
            f"{by.folder}: {other} ({recording}); record it with `payscope run --calibration "
            f"{by.folder}`"
        )
    by.refuse_after_expiry(provenance.t0_unix_ns, recording)
    return by.calibrate_masses_of_loads_frame(frames)


def read_machine_from_provenance(provenance: Provenance) -> Machine:
    """Read the machine and the settings that a recording was made with."""
    content = {**provenance.machine, "settings": provenance.settings.model_dump()}
    return Machine.model_validate(content)


def _iter_settings_by_dotted_name(
    values: Mapping[str, Any], prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            yield from _iter_settings_by_dotted_name(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _format_setting_value(value: Any) -> str:
    return "nothing" if value is None else f"{value}"
