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
    """One file that was read; a rosbag2 directory has one entry per file."""

    model_config = ConfigDict(frozen=True)

    name: str
    sha256: str
    size_bytes: int


class Provenance(BaseModel):
    """Origin of the frames: everything needed to repeat and to verify the replay."""

    model_config = ConfigDict(frozen=True)

    inputs: tuple[InputFile, ...] = ()
    #: The resolved machine file: every section with its defaults, as plain JSON values.
    machine: dict[str, Any] = {}
    settings: Settings = Settings.model_validate({})
    versions: dict[str, str] = {}
    t0_unix_ns: int = 0
    #: Kind of stamp that places each topic's samples in time: "header", "log" or "table".
    stamps: dict[str, str] = {}
    losses: tuple[Loss, ...] = ()
    #: Notes for readers of the answer, a sentence each.
    notes: tuple[str, ...] = ()
    #: The machine's serial number in the metadata of the logs; "" if they do not give it.
    logged_machine_id: Annotated[str, AfterValidator(join_to_one_line)] = ""
    #: Fingerprint of the inputs, the settings and the frames when the run ended.
    fingerprint: Fingerprint | None = None


@dataclass(frozen=True, eq=False)
class Run:
    """Frames by name (`aligned`, `gate`, `estimates/ls`, …) in pipeline order, and provenance."""

    frames: Mapping[str, pl.DataFrame]
    provenance: Provenance = field(default_factory=Provenance)

    def __eq__(self, other: object) -> bool:
        """Whether provenance and frames are equal: order, dtypes, nulls and values bit for bit."""
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
