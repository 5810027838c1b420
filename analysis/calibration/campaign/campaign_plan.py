"""A calibration campaign as its file states it: reference masses, runs, method, decision rule."""

import datetime as dt
from itertools import pairwise
from typing import Any, Final, Literal, Self

import numpy as np
from pydantic import BaseModel, Field, model_validator

from analysis.calibration.campaign.campaign_subjects import (
    CalibratedMachine,
    Conditions,
    EvidenceSubject,
    Id,
    Line,
    Organisation,
    ReferenceMass,
)
from analysis.model.strict_config import STRICT
from estimators.errors import suggest_choice

#: Estimators of the joint fit: the machine's whole mass, or the difference to runs without load.
JOINT_ESTIMATORS: Final = ("joint_mass", "joint_payload")
#: Name of the load of a run without any mass on board.
EMPTY: Final = "empty"

#: Start of `certificate_signature` if the laboratory's key is in `dcc_keys` of the campaign.
_TRUSTED: Final = "signed by a key of dcc_keys"
#: Keys required for a certificate by ISO/IEC 17025:2017, 7.8.2.1 c, f, o, and 7.8.4.1 b.
_CERTIFICATE_KEYS: Final = (
    "authoriser",
    "authoriser_function",
    "place",
    "place_kind",
    "deviations",
)
_CONDITION_KEYS: Final = ("temperature_degC", "slope_deg", "surface", "tyres", "fuel")

Estimator = Literal[
    "joint_mass", "joint_payload", "pooled", "ls", "rls", "rtls", "fgls", "tls", "huber"
]


class CampaignRun(BaseModel):
    """A log, or a stretch of one, with known loads on board."""

    model_config = STRICT

    id: Id = Field(description="name of the run; its number if it has none")
    log: Line = Field(min_length=1, description="the log, from the campaign file's folder")
    from_s: float | None = Field(None, ge=0, description="begin, in seconds from the log's start")
    to_s: float | None = Field(None, gt=0, description="end, likewise")
    loads: tuple[Id, ...] = Field(description="ids of the masses on board; [] without load")
    day: dt.date = Field(description="day of the run")
    operator: Line = Field("", description="who drove")
    conditions: Conditions = Field(Conditions.model_validate({}), description="if not all runs'")
    excluded: Line = Field("", description="why it counts for nothing; kept in the evidence")

    @property
    def load_id(self) -> str:
        """Name of the loads on board."""
        return "+".join(sorted(self.loads)) or EMPTY

    def contains_middle_of_span(self, start_s: float, end_s: float) -> bool:
        """Whether the middle of a time span, in s from the start of the log, lies in the run."""
        middle = (start_s + end_s) / 2.0
        return (self.from_s or 0.0) <= middle < (np.inf if self.to_s is None else self.to_s)

    @model_validator(mode="after")
    def _refuse_end_before_start(self) -> Self:
        if self.to_s is not None and self.to_s <= (self.from_s or 0.0):
            raise ValueError(f"run '{self.id}': to_s is not after from_s; correct one of them")
        if len(set(self.loads)) < len(self.loads):
            raise ValueError(f"run '{self.id}': lists the same mass twice; remove one")
        return self


class StatedComponent(BaseModel):
    """A component of the uncertainty budget that no run shows."""

    model_config = STRICT

    component: Line = Field(min_length=1, description="name, such as tare or local gravity")
    u_kg: float | None = Field(None, ge=0, le=1e5, description="standard uncertainty, if known")
    absorbed: bool = Field(
        default=False,
        description="whether it is constant for the machine, so that the line absorbs it",
    )
    known: Line = Field("stated in the campaign file", description="how it is known")


class CampaignMethod(BaseModel):
    """Which mass is calibrated, and how far its line is believed."""

    model_config = STRICT

    estimator: Estimator = Field(
        "joint_mass",
        description="joint_mass, joint_payload (difference to runs without load), "
        "or a method of the paper",
    )
    learn: bool = Field(
        default=True,
        description="whether the nuisance terms of the joint fit get their priors from all logs "
        "together",
    )
    confidence_1: float = Field(0.95, gt=0.5, lt=1, description="of every interval")
    day_known_kg: float | None = Field(
        None, ge=0, le=1e5, description="standard deviation from day to day, where it is known"
    )
    margin_1: float = Field(
        0.0, ge=0, le=1, description="how far beyond the references it holds, of their range"
    )
    stated: tuple[StatedComponent, ...] = Field(
        (), description="components of the budget that no run shows"
    )


class CampaignLimits(BaseModel):
    """Which error limits a calibrated mass is to be within, and how sure the answer has to be."""

    model_config = STRICT

    accuracy_class: Line = Field(description='such as "OIML R 51 Y(b)" or "OIML R 134 2"')
    scale_interval_kg: float | None = Field(None, gt=0, description="e of R 51")
    in_service: bool = Field(default=False, description="R 51's limits in service, not initial")
    tare_kg: float = Field(
        0.0, ge=0, description="taken off references: the machine's mass, where a load is judged"
    )
    risk_1: float = Field(
        0.05, gt=0, lt=0.5, description="probability of a wrong verdict; the guard band follows"
    )


class LeftOutLog(BaseModel):
    """A log of the recorder that is none of the campaign."""

    model_config = STRICT

    number: int = Field(ge=1, lt=2**53, description="its line number in the list")
    reason: Line = Field(min_length=1, description="why it is none of the campaign")


class NotaryStretch(BaseModel):
    """Which logs the recorder made: a stretch of the list that its notary keeps."""

    model_config = STRICT

    list: Line = Field(min_length=1, description="list of `payscope notarise`, from this folder")
    first: int = Field(ge=1, lt=2**53, description="number of the first log")
    last: int = Field(ge=1, lt=2**53, description="number of the last")
    left_out: tuple[LeftOutLog, ...] = Field(
        (), max_length=5000, description="logs between them that are none of the campaign"
    )

    @property
    def omission_reason_by_log_number(self) -> dict[int, str]:
        """Reason for leaving out a log, by the number of the log."""
        return {each.number: each.reason for each in self.left_out}

    @model_validator(mode="after")
    def _refuse_reversed_range_and_left_out_beyond_it(self) -> Self:
        if self.last < self.first:
            raise ValueError(
                f"last ({self.last}) is before first ({self.first}); correct one of them"
            )
        numbers = [each.number for each in self.left_out]
        for number in numbers:
            if not self.first <= number <= self.last:
                raise ValueError(
                    f"notary: number {number} in left_out is not between first and last; remove it"
                )
            if numbers.count(number) > 1:
                raise ValueError(
                    f"notary: number {number} appears twice in left_out; remove one entry"
                )
        return self


class CalibrationCampaign(BaseModel):
    """A whole campaign file."""

    model_config = STRICT

    campaign: EvidenceSubject
    laboratory: Organisation | None = None
    customer: Organisation | None = None
    machine: CalibratedMachine
    masses: tuple[ReferenceMass, ...] = Field((), max_length=200)
    dcc_keys: tuple[Line, ...] = Field(
        (), max_length=50, description="files with keys of laboratories that are trusted, in PEM"
    )
    conditions: Conditions = Conditions.model_validate({})
    method: CampaignMethod = CampaignMethod.model_validate({})
    decision: CampaignLimits | None = None
    #: Not written if not given, so that earlier campaigns do not change.
    notary: NotaryStretch | None = Field(None, exclude_if=lambda value: value is None)
    runs: tuple[CampaignRun, ...] = Field(min_length=1, max_length=500)

    @model_validator(mode="before")
    @classmethod
    def _fill_in_run_ids(cls, content: object) -> object:
        if not isinstance(content, dict) or not isinstance(content.get("runs"), list):
            return content
        runs = [
            {"id": f"run-{number:02}", **run} if isinstance(run, dict) else run
            for number, run in enumerate(content["runs"], start=1)
        ]
        return {**content, "runs": runs}

    @model_validator(mode="after")
    def _refuse_inconsistent_campaign(self) -> Self:
        for what, ids in (
            ("mass", [each.id for each in self.masses]),
            ("run", [each.id for each in self.runs]),
        ):
            twice = sorted({each for each in ids if ids.count(each) > 1})
            if twice:
                raise ValueError(f"two of the {what}s have the same id '{twice[0]}'; rename one")
        known = {each.id for each in self.masses}
        for run in self.runs:
            for load in run.loads:
                if load not in known:
                    raise ValueError(
                        f"run '{run.id}': no mass '{load}'; {suggest_choice(load, known)}"
                    )
        self._refuse_overlapping_runs()
        return self

    def _refuse_overlapping_runs(self) -> None:
        """Raise an error if two runs overlap, so that no start counts twice."""
        spans = sorted(
            (run.log, run.from_s or 0.0, np.inf if run.to_s is None else run.to_s, run.id)
            for run in self.runs
        )
        for (log, _, end, first), (other, start, _, second) in pairwise(spans):
            if log == other and start < end:
                raise ValueError(
                    f"runs '{first}' and '{second}' overlap in {log}; correct from_s or to_s"
                )

    @property
    def learns_priors(self) -> bool:
        """Whether the campaign learns priors from its logs for the calibrated mass."""
        return self.method.learn and self.method.estimator in JOINT_ESTIMATORS

    @property
    def log_names(self) -> tuple[str, ...]:
        """Names of the logs, each once, in the order of the runs."""
        return tuple(dict.fromkeys(run.log for run in self.runs))

    @property
    def load_ids(self) -> tuple[str, ...]:
        """Ids of the loads, each once, in the order of the runs."""
        return tuple(dict.fromkeys(run.load_id for run in self.runs))

    @property
    def last_valid_day(self) -> dt.date:
        """Last day on which the evidence is valid."""
        last = max(run.day for run in self.runs)
        return last + dt.timedelta(days=self.campaign.valid_days)

    @property
    def missing_certificate_entries(self) -> tuple[str, ...]:
        """Keys that ISO/IEC 17025, 7.8, requires for a certificate and the file does not give."""
        found = [name for name in ("laboratory", "customer") if getattr(self, name) is None]
        asked: tuple[tuple[str, BaseModel, tuple[str, ...]], ...] = (
            ("campaign", self.campaign, _CERTIFICATE_KEYS),
            ("machine", self.machine, ("make", "model", "condition")),
        )
        for table, model, names in asked:
            found += [f"{table}.{name}" for name in names if not getattr(model, name)]
        for name in _CONDITION_KEYS:
            if any(
                self.fill_run_conditions_from_campaign(run)[name] in ("", None) for run in self.runs
            ):
                found.append(f"conditions.{name}")
        return tuple(found)

    def fill_run_conditions_from_campaign(self, run: CampaignRun) -> dict[str, Any]:
        """Conditions of a run by name: those of the campaign where the run states none."""
        own, common = run.conditions.model_dump(), self.conditions.model_dump()
        return {n: common[n] if own[n] in ("", None) else own[n] for n in own}

    @property
    def untraceable_references_text(self) -> tuple[str, ...]:
        """Sentences on the references that are not traceable."""
        found: list[str] = []
        for mass in self.masses:
            if mass.u_kg == 0.0:
                found.append(f"mass '{mass.id}' has a standard uncertainty of 0")
            if mass.stated_by:
                found.append(f"mass '{mass.id}' is stated by the {mass.stated_by}")
            elif not mass.certificate:
                found.append(f"mass '{mass.id}' has no certificate")
            if mass.dcc and not mass.certificate_signature.startswith(_TRUSTED):
                found.append(f"the certificate of mass '{mass.id}' is {mass.certificate_signature}")
        if self.method.estimator != "joint_payload":
            if self.machine.empty_mass_u_kg == 0.0:
                found.append("the machine's empty mass has a standard uncertainty of 0")
            if not self.machine.empty_certificate:
                found.append("the machine's empty mass has no certificate")
        return tuple(found)

    def select_masses_of_load(self, load_id: str) -> tuple[ReferenceMass, ...]:
        """The masses of a load."""
        wanted = () if load_id == EMPTY else load_id.split("+")
        return tuple(each for each in self.masses if each.id in wanted)

    def describe_invalid_certificates(self) -> list[str]:
        """Sentences on the certificates that were not valid on the day of a run."""
        found: list[str] = []
        for run in self.runs:
            dated = [(f"mass '{m.id}'", m.expires) for m in self.select_masses_of_load(run.load_id)]
            if self.method.estimator != "joint_payload":
                dated.append(("the machine's empty mass", self.machine.empty_expires))
            found += [
                f"run '{run.id}' of {run.day}: the certificate of {what} expired on {last}"
                for what, last in dated
                if last is not None and last < run.day
            ]
        return found
