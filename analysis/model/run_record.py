"""`Run`: the frames of one replay, and their provenance."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Self

import polars as pl
from pydantic import AfterValidator, BaseModel, ConfigDict

from analysis.model.fingerprint import Fingerprint, make_run_fingerprint
from analysis.model.loss import Loss
from analysis.model.settings import Settings
from estimators.errors import join_to_one_line


class InputFile(BaseModel):
    """One file that was read: a rosbag2 directory gives one entry a file."""

    model_config = ConfigDict(frozen=True)

    name: str
    sha256: str
    size_bytes: int


class Provenance(BaseModel):
    """Origin of the frames: everything needed to repeat and to verify the replay."""

    model_config = ConfigDict(frozen=True)

    inputs: tuple[InputFile, ...] = ()
    #: The machine file as resolved: every section, defaults filled in, as plain JSON values.
    machine: dict[str, Any] = {}
    settings: Settings = Settings.model_validate({})
    versions: dict[str, str] = {}
    t0_unix_ns: int = 0
    #: Which stamp each topic was placed by: "header", "log" or "table".
    stamps: dict[str, str] = {}
    losses: tuple[Loss, ...] = ()
    #: What a reader of the answer should know, a sentence each.
    notes: tuple[str, ...] = ()
    #: The machine's serial number as the logs' own metadata have it; "" where they do not tell.
    logged_machine_id: Annotated[str, AfterValidator(join_to_one_line)] = ""
    #: Of the inputs, the settings and the frames, as `run` left them.
    fingerprint: Fingerprint | None = None


@dataclass(frozen=True, eq=False)
class Run:
    """Frames by name (`aligned`, `gate`, `estimates/ls`, …) in pipeline order, and provenance."""

    frames: Mapping[str, pl.DataFrame]
    provenance: Provenance = field(default_factory=Provenance)

    def __eq__(self, other: object) -> bool:
        """Same frames in the same order, bit for bit with dtypes and nulls, same provenance."""
        return (
            isinstance(other, Run)
            and list(self.frames) == list(other.frames)
            and all(
                mine.schema == theirs.schema and mine.equals(theirs, null_equal=True)
                for mine, theirs in zip(self.frames.values(), other.frames.values(), strict=True)
            )
            and self.provenance == other.provenance
        )

    def with_fingerprint(self) -> Self:
        """Copy of the run with the fingerprint of its frames in the provenance."""
        about = self.provenance
        digests = [each.sha256 for each in about.inputs]
        taken = make_run_fingerprint(
            self.frames, digests, about.machine, about.settings.model_dump(mode="json")
        )
        return replace(self, provenance=about.model_copy(update={"fingerprint": taken}))

    __hash__ = None  # pyright: ignore[reportAssignmentType] a mutable mapping inside
