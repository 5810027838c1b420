"""The machine of a campaign against what its machine file and its logs call theirs."""

from collections.abc import Iterator, Sequence

from analysis.model.machine import Machine
from recordings.calibration.evidence_document import EvidenceLog


def machine_faults(wanted: str, machine: Machine, logs: Sequence[EvidenceLog]) -> Iterator[str]:
    """Yield what contradicts that a campaign is of one machine, a sentence each.

    Args:
        wanted: the serial number of the campaign.
        machine: its machine file.
        logs: what their replay gave.
    """
    named = machine.machine.id
    if named not in (None, wanted):
        yield f"the machine file is of machine '{named}', and the campaign of '{wanted}'"
    for log in logs:
        if log.machine_id not in ("", wanted):
            yield (
                f"{log.log}: its metadata say that it is of machine '{log.machine_id}', and the "
                f"campaign is of '{wanted}'"
            )


def logs_without_machine(logs: Sequence[EvidenceLog]) -> list[str]:
    """The logs that do not say which machine recorded them."""
    return [log.log for log in logs if not log.machine_id]
