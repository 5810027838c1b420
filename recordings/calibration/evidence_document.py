"""Contents of `evidence.json`: all that is needed to recompute a calibration and to question it.

The published schema, `evidence.schema.json`, is made of these models:
`python -m recordings.calibration.evidence_document` prints it.
"""

import datetime as dt
import json
import sys
from collections.abc import Mapping
from importlib.metadata import version
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import BaseModel, Field, PrivateAttr, StringConstraints, ValidationError

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.calibration.campaign.campaign_subjects import Id, Line
from analysis.calibration.line.calibration import Calibration, CalibrationOptions
from analysis.calibration.line.procedure import PROCEDURES, Procedure, ProcedureNumber
from analysis.calibration.use.calibration_drift import DriftCheck
from analysis.calibration.use.error_limits import ErrorLimits
from analysis.calibration.use.learnt_priors import LearntPriors, copy_machine_with_learnt_priors
from analysis.model.machine import Machine
from analysis.model.strict_config import STRICT
from estimators.errors import EvidenceError
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.released_defaults import (
    list_absent_settings_changed_since,
    list_settings_absent_in_evidence,
    load_released_defaults,
    remove_dotted_values,
    replace_dotted_values,
)
from recordings.signatures.canonical_json import encode_canonical_json, parse_canonical_json

#: Format 1 does not state how errors of learnt means move its runs and its line.
_FIRST: Final = "payscope-calibration-evidence/1"
#: Formats 2 and 3 have the same content; their pages differ. Format 4 has the machine that each log
#: names, and the time zone is no longer part of what defines a mass.
FORMAT: Final = "payscope-calibration-evidence/4"
_NOT_IN_FIRST: Final = {"learnt": {"responses"}, "calibration": {"responses"}}
#: File name of the published schema.
SCHEMA: Final = "evidence.schema.json"
Notice = Literal[
    "Not for trade. Not an accredited calibration. It says what these runs showed, and nothing "
    "about runs that are not in it."
]
NOTICE: Final[Notice] = get_args(Notice)[0]

Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Stamp = Annotated[str, StringConstraints(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")]
Counted = Annotated[int, Field(ge=0, lt=2**53)]
Sentence = Annotated[str, StringConstraints(max_length=4000)]


class UnknownFormatError(EvidenceError):
    """Raised for evidence of another version, which this one cannot read."""


class EvidenceFile(BaseModel):
    """A file by its digest."""

    model_config = STRICT

    name: Sentence
    sha256: Sha256
    size_bytes: Counted


class LoggedTopic(BaseModel):
    """A topic that was read."""

    model_config = STRICT

    topic: Sentence
    messages: Counted
    stamped_by: Line


class EvidenceLog(BaseModel):
    """A log: what was read, what it lost, what its replay gave."""

    model_config = STRICT

    log: Line
    files: tuple[EvidenceFile, ...] = Field(min_length=1)
    topics: tuple[LoggedTopic, ...]
    begins: Line
    duration_s: float
    speed_range_m_s: tuple[float, float] | None
    losses: tuple[Sentence, ...]
    notes: tuple[Sentence, ...]
    can_weigh: bool
    failed_checks: tuple[Line, ...]
    settings_fingerprint: Sha256
    results_fingerprint: Sha256
    recording: Line
    machine_id: Line = ""


class Estimator(BaseModel):
    """Which mass was calibrated: its name, and the digest of everything that defines it."""

    model_config = STRICT

    name: Line
    definition_sha256: Sha256


class ReferenceLoad(BaseModel):
    """The reference of one load."""

    model_config = STRICT

    load_id: Annotated[str, StringConstraints(max_length=4000)]
    reference_kg: float
    u_kg: float


class Link(BaseModel):
    """The evidence of this machine before this one."""

    model_config = STRICT

    id: Id
    counter: Annotated[int, Field(ge=1, lt=2**53)]
    sums_sha256: Sha256


class Chain(BaseModel):
    """The place of this evidence in that of its machine: the counter only grows."""

    model_config = STRICT

    counter: Annotated[int, Field(ge=1, lt=2**53)]
    previous: Link | None


class Signer(BaseModel):
    """Whose signature the statement has."""

    model_config = STRICT

    name: Line
    key_id: Sha256
    public_key: Line


class Software(BaseModel):
    """What computed it."""

    model_config = STRICT

    payscope: Line
    distributions: dict[Line, Line]
    python: Line
    platform: Line


class AsFound(BaseModel):
    """The line before this one, and what it made of this campaign's points."""

    model_config = STRICT

    evidence_id: Id
    alpha_1: float
    beta_kg: float
    rms_error_kg: float | None


class EvidenceTables(BaseModel):
    """The tables beside, by their digests."""

    model_config = STRICT

    readings_sha256: Sha256
    points_sha256: Sha256


class EvidenceDocument(BaseModel):
    """A whole `evidence.json`."""

    model_config = STRICT

    format: Literal[
        "payscope-calibration-evidence/1",
        "payscope-calibration-evidence/2",
        "payscope-calibration-evidence/3",
        "payscope-calibration-evidence/4",
    ]
    kind: Literal["calibration", "check"]
    id: Id
    made: Stamp
    notice: Notice
    campaign: CalibrationCampaign
    expires: dt.date
    machine: Machine
    learnt: LearntPriors | None
    estimator: Estimator
    logs: tuple[EvidenceLog, ...] = Field(min_length=1)
    references: tuple[ReferenceLoad, ...] = Field(min_length=1)
    reference_covariance_kg2: tuple[tuple[float, ...], ...]
    tables: EvidenceTables
    options: CalibrationOptions
    calibration: Calibration | None
    no_fit: Sentence
    limits: ErrorLimits | None
    drift: DriftCheck | None
    as_found: AsFound | None
    replay_tolerance_kg: float = Field(ge=0, le=1e-3)
    procedure: ProcedureNumber = 1
    chain: Chain
    signer: Signer | None
    software: Software
    #: Newer settings, at the default with which they were introduced; not part of the bytes.
    _filled_in_settings: dict[str, Any] = PrivateAttr(default_factory=dict[str, Any])

    @property
    def canonical_json_bytes(self) -> bytes:
        """The bytes of `evidence.json`, without settings that are newer than the evidence."""
        left_out = _NOT_IN_FIRST if self.format == _FIRST else None
        values = self.model_dump(mode="json", exclude=left_out, exclude_unset=True)
        return encode_canonical_json(remove_dotted_values(values, self._filled_in_settings))

    @property
    def settings_at_default(self) -> dict[str, Any]:
        """Settings newer than the evidence: dotted names with the default each is read with."""
        return {
            **list_settings_absent_in_evidence(self.machine, "machine."),
            **list_settings_absent_in_evidence(self.campaign, "campaign."),
            **self._filled_in_settings,
        }

    def copy_with_defaults_of_newer_settings(self, values: Mapping[str, Any]) -> "EvidenceDocument":
        """Fill in settings newer than the evidence at the default they were released with.

        Args:
            values: content of the `evidence.json` that it was read from.
        """
        changed = list_absent_settings_changed_since(
            self.settings_at_default, load_released_defaults()
        )
        if not changed:
            return self
        document = EvidenceDocument.model_validate_json(
            encode_canonical_json(replace_dotted_values(values, changed))
        )
        document._filled_in_settings = changed  # noqa: SLF001  its own
        return document

    @property
    def with_all_settings(self) -> "EvidenceDocument":
        """The evidence with every setting of this version stated, including those at default."""
        return EvidenceDocument.model_validate_json(
            encode_canonical_json(self.model_dump(mode="json"))
        )

    @property
    def other_payscope_version(self) -> str:
        """Version that made it; "" for this one. Other versions word the page differently."""
        made = self.software.payscope
        if made == version("payscope") and self.format == FORMAT:
            return ""
        return f"payscope {made} (format {self.format.rpartition('/')[2]})"

    @property
    def states_run_responses(self) -> bool:
        """Whether its format states how errors of learnt means move each run."""
        return self.format != _FIRST

    @property
    def procedure_rules(self) -> Procedure:
        """Rules of the calibration procedure that the evidence names."""
        return PROCEDURES[self.procedure]

    @property
    def weighing_machine(self) -> Machine:
        """The machine settings that weigh: those of the evidence, with the learnt priors."""
        return (
            self.machine
            if self.learnt is None
            else copy_machine_with_learnt_priors(self.machine, self.learnt.terms)
        )

    def find_log_by_name(self, name: str) -> EvidenceLog | None:
        """Find the log of this name; None if there is none."""
        return next((each for each in self.logs if each.log == name), None)


def parse_untrusted_evidence(json_bytes: bytes, source: str) -> EvidenceDocument:
    """Parse untrusted content of `evidence.json`.

    Raises:
        UnknownFormatError: it states another version, and has content that this version lacks.
        EvidenceError: it is not canonical JSON within the bounds, or does not match the schema.
    """
    values = parse_canonical_json(json_bytes, source)
    try:
        document = EvidenceDocument.model_validate_json(json_bytes)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        made = find_version_of_other_payscope(values)
        if made:
            raise UnknownFormatError(
                f"{source}: made by {made}, and payscope {version('payscope')} cannot read all of "
                f"it ({where}: {first['msg']}): digests and signature were checked, but nothing "
                "was recomputed; verify it with the version that made it"
            ) from None
        place = f" at {where}" if where else ""
        raise EvidenceError(
            f"{source}: does not follow the schema of evidence{place}: {first['msg']}; copy the "
            "original file again"
        ) from None
    if document.canonical_json_bytes != json_bytes:
        raise EvidenceError(
            f"{source}: a value has another type than the schema of evidence requires; copy the "
            "original file again"
        )
    return document.copy_with_defaults_of_newer_settings(values)


def find_version_of_other_payscope(document_values: Any) -> str:
    """Find the version that a document states as its own; "" if it is this one, or none."""
    if not isinstance(document_values, dict) or not isinstance(
        document_values.get("software"), dict
    ):
        return ""
    made, form = document_values["software"].get("payscope"), document_values.get("format")
    if not isinstance(made, str) or not isinstance(form, str):
        return ""
    own = made == version("payscope") and form == FORMAT
    return (
        ""
        if own
        else f"payscope {made[: LIMITS.quoted_characters]} in {form[: LIMITS.quoted_characters]}"
    )


def format_evidence_schema() -> str:
    """Format the published schema: JSON Schema, draft 2020-12."""
    schema: dict[str, Any] = EvidenceDocument.model_json_schema(mode="serialization")
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"https://payscope.invalid/{SCHEMA}",
        **schema,
    }
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.stdout.write(format_evidence_schema())
