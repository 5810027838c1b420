"""The command `calibrate`: a campaign file in, a bundle of evidence out."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis.calibration.campaign import CalibrationCampaign
from analysis.calibration.campaign_fit import fit_campaign, options_of, stated_scale
from analysis.machine import Machine
from estimators.errors import CampaignError, EvidenceError, OutputError
from recordings.evidence.as_found import as_found
from recordings.evidence.bundle import tables_of, write_bundle
from recordings.evidence.checks import Checked, check_bundle
from recordings.evidence.derived import estimator_of, reference_loads
from recordings.evidence.document import FORMAT, NOTICE, Chain, EvidenceDocument, Link, Signer
from recordings.evidence.findings import Outcome
from recordings.evidence.recording import write_calibration
from recordings.evidence.signing import SigningKey, signing_key
from recordings.output import check_folder, staged
from replay.campaign_file import load_campaign
from replay.campaign_runs import Replayed, new_id, now, replay_runs, software

#: How far a replay elsewhere may be off, in kg: other processors have other last bits.
TOLERANCE_KG: Final = 1e-6
_MOST_LINES: Final = 3


@dataclass(frozen=True, slots=True)
class Calibrated:
    """What `calibrate` found and wrote.

    Attributes:
        folder: the bundle.
        document: its evidence.
        readings: frame `readings`.
        points: a row a run.
        remarks: for whoever made it, a line each.
    """

    folder: Path
    document: EvidenceDocument
    readings: pl.DataFrame
    points: pl.DataFrame
    remarks: tuple[str, ...]

    @property
    def rejected(self) -> pl.DataFrame:
        """Readings that count for nothing, with their reasons."""
        return self.readings.filter(~pl.col("used"))

    @property
    def good(self) -> bool:
        """Whether there is a line."""
        return self.document.calibration is not None

    def to_dict(self) -> dict[str, Any]:
        """The same as plain values."""
        return {
            "folder": str(self.folder),
            "evidence": self.document.model_dump(mode="json"),
            "points": self.points.to_dicts(),
            "rejected": self.rejected.to_dicts(),
            "signed": self.document.signer is not None,
            "remarks": list(self.remarks),
        }


def calibrate(
    campaign_file: Path,
    folder: Path,
    *,
    key_file: Path | None = None,
    previous: Path | None = None,
    recordings: bool = False,
    force: bool = False,
    on_log: Callable[[str], None] = lambda _: None,
) -> Calibrated:
    """Replay a campaign's runs, fit the line, and write the evidence.

    Args:
        campaign_file: the campaign.
        folder: the bundle to write.
        key_file: private key; without it the environment may hold one.
        previous: the machine's evidence before this.
        recordings: whether each replay's recording is part of the bundle.
        force: whether evidence in `folder` may be replaced.
        on_log: told each log's name as its replay begins.

    Raises:
        PayscopeError: whatever is wrong with the input, before anything is written.
    """
    campaign, machine = load_campaign(campaign_file)
    key = signing_key(key_file)
    before = _before(previous, campaign)
    check_folder(folder, force=force)
    with staged([folder], force=force) as stage:
        made = stage / folder.name
        made.mkdir()
        replayed = replay_runs(
            campaign,
            machine,
            lambda log: campaign_file.parent / log,
            made if recordings else None,
            on_log,
        )
        on_log("evidence")
        document, points, tables = _evidence(campaign, machine, replayed, key, before)
        write_calibration(made, document, replayed.readings, points)
        remarks = write_bundle(made, document, replayed.readings, points, tables, key)
        _refuse_faulty(made, folder, key, previous)
    return Calibrated(folder, document, replayed.readings, points, tuple(remarks))


def _before(previous: Path | None, campaign: CalibrationCampaign) -> Checked | None:
    """The machine's evidence before this, checked.

    Raises:
        EvidenceError: it is of another machine, or something is wrong with it.
    """
    if previous is None:
        return None
    checked = check_bundle(previous)
    wrong = [each for each in checked.findings if each.outcome is not Outcome.OUTSIDE]
    if wrong or checked.document is None:
        first = str(wrong[0]) if wrong else "no evidence"
        raise EvidenceError(f"{previous}: nothing can be chained to it: {first}")
    machine = checked.document.campaign.machine.id
    if machine != campaign.machine.id:
        raise EvidenceError(
            f"{previous}: is evidence of machine '{machine}', this campaign of "
            f"'{campaign.machine.id}'; name that of the same machine"
        )
    return checked


def _evidence(
    campaign: CalibrationCampaign,
    machine: Machine,
    replayed: Replayed,
    key: SigningKey | None,
    before: Checked | None,
) -> tuple[EvidenceDocument, pl.DataFrame, dict[str, bytes]]:
    """The evidence, its points and its tables as they are written."""
    if replayed.readings["mass_kg"].null_count() == replayed.readings.height:
        raise CampaignError(
            "no run of the campaign gave a reading; `payscope run` says of each log why"
        )
    options = options_of(campaign, stated_scale(campaign, replayed.budgets))
    fitted = fit_campaign(campaign, machine.machine, replayed.readings, options)
    tables, digests = tables_of(replayed.readings, fitted.frame)
    loads, covariance = reference_loads(campaign, machine)
    estimator = estimator_of(campaign, machine)
    document = EvidenceDocument(
        format=FORMAT,
        kind="calibration",
        id=new_id(),
        made=now(),
        notice=NOTICE,
        campaign=campaign,
        expires=campaign.expires,
        machine=machine,
        estimator=estimator,
        logs=replayed.logs,
        references=loads,
        reference_covariance_kg2=covariance,
        tables=digests,
        options=options,
        calibration=fitted.calibration,
        no_fit=fitted.no_fit,
        as_found=as_found(before.document if before else None, estimator, fitted.frame),
        replay_tolerance_kg=TOLERANCE_KG,
        chain=_chain(before),
        signer=None
        if key is None
        else Signer(
            name=campaign.campaign.signer, key_id=key.public.key_id, public_key=key.public.text
        ),
        software=software(),
    )
    return document, fitted.frame, tables


def _chain(before: Checked | None) -> Chain:
    if before is None or before.document is None:
        return Chain(counter=1, previous=None)
    last = before.document
    link = Link(
        id=last.id,
        counter=last.chain.counter,
        sums_sha256=hashlib.sha256(before.sums).hexdigest(),
    )
    return Chain(counter=last.chain.counter + 1, previous=link)


def _refuse_faulty(made: Path, folder: Path, key: SigningKey | None, previous: Path | None) -> None:
    """Check what was written as a stranger would, before it gets its name."""
    checked = check_bundle(made, None if key is None else key.public, previous)
    wrong = [str(each) for each in checked.findings if each.outcome is not Outcome.OUTSIDE]
    if wrong:
        raise OutputError(
            f"{folder}: what was written does not pass its own check, so nothing was kept: "
            + "; ".join(wrong[:_MOST_LINES])
        )
