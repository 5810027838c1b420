"""Subjects of a campaign: organisation, machine, reference masses and conditions."""

import datetime as dt
from typing import Annotated, Literal, Self

from pydantic import BaseModel, Field, StringConstraints, model_validator

from analysis.model.strict_config import STRICT

Id = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]

Text = Annotated[str, StringConstraints(max_length=2000)]

Line = Annotated[str, StringConstraints(max_length=200)]


class Organisation(BaseModel):
    """A laboratory or a customer; with `[laboratory]` the evidence is a certificate."""

    model_config = STRICT

    name: Line = Field(min_length=1, description="its name")
    address: Line = Field(min_length=1, description="street and number, or what else finds it")
    city: Line = Field(min_length=1, description="with the postal code")
    country: Annotated[str, StringConstraints(pattern=r"^[A-Z]{2}$")] = Field(
        description="two letters, ISO 3166-1"
    )
    email: Line = Field("", description="of whoever answers questions")

    @property
    def name_and_address_line(self) -> str:
        """Name and address on one line."""
        email = f", {self.email}" if self.email else ""
        return f"{self.name}, {self.address}, {self.city}, {self.country}{email}"


class EvidenceSubject(BaseModel):
    """Who makes the evidence, and what for."""

    model_config = STRICT

    title: Line = Field("", description="heading of the report")
    intended_use: Text = Field(min_length=1, description="what the calibration is for")
    author: Line = Field(min_length=1, description="who made the campaign")
    authoriser: Line = Field("", description="person responsible, if another")
    author_function: Line = Field("", description="the author's function")
    authoriser_function: Line = Field("", description="the authoriser's function")
    place: Line = Field("", description="where the runs were made")
    place_kind: Literal["", "laboratory", "customer", "other"] = Field(
        "", description="whose place that is"
    )
    received: dt.date | None = Field(None, description="day when the machine was handed over")
    deviations: Text = Field("", description='deviations from the method, or "none"')
    replaces: Id | Literal[""] = Field("", description="id of the evidence that this one replaces")
    replaces_reason: Text = Field("", description="why it is replaced")
    signer: Line = Field("", description="whose signing key it is, by name")
    valid_days: int = Field(
        365, ge=1, le=3650, description="days after the last run when the evidence expires"
    )
    remark: Text = Field("", description="for the reader, such as repairs since the last")

    @model_validator(mode="after")
    def _require_reason_with_replaced_evidence(self) -> Self:
        if bool(self.replaces) != bool(self.replaces_reason):
            raise ValueError(
                "replaces and replaces_reason must be given together: the id of the evidence, and "
                "why it is replaced"
            )
        return self


class CalibratedMachine(BaseModel):
    """Which machine it is about; its machine file says how it is weighed."""

    model_config = STRICT

    file: Line = Field(min_length=1, description="machine file, from the campaign file's folder")
    id: Id = Field(description="serial number: evidence is chained by it")
    make: Line = Field("", description="who built it")
    model: Line = Field("", description="model of the machine")
    condition: Line = Field("", description="its condition, such as tyres worn by a third")
    empty_mass_kg: float | None = Field(
        None, gt=0, description="its empty mass, where not the machine file's"
    )
    empty_mass_u_kg: float | None = Field(
        None, ge=0, description="standard uncertainty of it, in the same unit"
    )
    empty_certificate: Line = Field("", description="certificate of the machine's empty mass")
    empty_expires: dt.date | None = Field(None, description="its last day")
    parts: dict[Line, Line] = Field(
        default={}, description="ids of sensors, bucket, firmware: a table of texts"
    )


class ReferenceMass(BaseModel):
    """One reference mass with its certificate."""

    model_config = STRICT

    id: Id = Field(description="name that runs call it by")
    value_kg: float = Field(gt=0, le=1e6, description="its mass")
    u_kg: float = Field(ge=0, le=1e5, description="standard uncertainty (k = 1) of that")
    certificate: Line = Field("", description="id of its certificate")
    expires: dt.date | None = Field(None, description="last day of the certificate")
    stated_by: Literal["", "customer"] = Field(
        "", description='"customer" where the customer says the mass, and no laboratory'
    )
    dcc: Line = Field(
        "", description="digital certificate and item that it is read from: cert.xml#item"
    )
    certificate_sha256: Annotated[str, StringConstraints(pattern=r"^([0-9a-f]{64})?$")] = Field(
        "", description="digest of the certificate; of a dcc it is computed"
    )
    certificate_issuer: Line = Field("", description="laboratory that issued the certificate")
    certificate_signature: Line = Field(
        "", description="signer of the dcc; filled in when it is read"
    )
    source: Line = Field("", description="scale or certificate that several masses share")
    shared_u_kg: float = Field(
        0.0, ge=0, le=1e5, description="part of u_kg that all masses of that source share"
    )

    @model_validator(mode="after")
    def _refuse_shared_u_above_total_u(self) -> Self:
        if self.shared_u_kg > self.u_kg:
            raise ValueError(
                f"'{self.id}': shared_u_kg exceeds u_kg, of which it is a part; correct one of them"
            )
        if self.shared_u_kg and not self.source:
            raise ValueError(
                f"'{self.id}': shared_u_kg needs source, the common origin of the shared "
                "uncertainty"
            )
        return self


class Conditions(BaseModel):
    """Conditions under which the runs were driven."""

    model_config = STRICT

    slope_deg: float | None = Field(None, ge=-45, le=45, description="of the ground, nose up")
    surface: Line = Field("", description="such as dry concrete")
    tyres: Line = Field("", description="such as inflation pressure")
    fuel: Line = Field("", description="such as how full the tank was")
    temperature_degC: float | None = Field(None, ge=-90, le=90, description="of the air")
    note: Line = Field("", description="anything else")
