"""Options of the last run, stored beside the results to select current ones and to run again."""

from dataclasses import dataclass
from typing import Final

from pydantic import BaseModel, ConfigDict, Field

CURRENT: Final = "current.json"
#: Object beside the results with the calibrations in use.
CALIBRATIONS: Final = "calibrations.json"
#: Object beside the results with the recordings that could not be replayed, and why, by source.
FAILED: Final = "failed.json"


class TaskLimits(BaseModel):
    """Resource limits of one recording."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    seconds: float = Field(3600.0, gt=0, description="time in s; a task that takes longer is ended")
    memory_GiB: float = Field(0.75, gt=0, description="memory in GiB that every task declares")
    memory_per_byte: float = Field(
        3.0,
        ge=0,
        description="bytes declared in addition per byte of log; a task that uses twice is ended",
    )

    def compute_memory_bytes_for_log(self, size_bytes: int) -> int:
        """Compute the memory in bytes that the task of a log of this size declares."""
        return int(self.memory_GiB * 2**30 + self.memory_per_byte * size_bytes)


@dataclass(frozen=True)
class NamedFiles:
    """Files that a fleet file names for a machine.

    Attributes:
        file: path of the machine file.
        overrides: `key=value` overrides of the machine file.
        calibrations: folders of evidence.
    """

    file: str
    overrides: tuple[str, ...] = ()
    calibrations: tuple[str, ...] = ()


class LastRunMachine(BaseModel):
    """A machine of the last run: its files, and the digests of its setups."""

    files: NamedFiles
    bases: tuple[str, ...]


class LastRun(BaseModel):
    """Options of the last run, stored next to the results."""

    fleet: str = "fleet"
    limits: TaskLimits = TaskLimits.model_validate({})
    machines: dict[str, LastRunMachine] = {}
