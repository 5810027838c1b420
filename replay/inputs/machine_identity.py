"""Identify the machine by the machine file and the logs' metadata."""

from collections.abc import Sequence
from typing import NamedTuple

from pydantic import TypeAdapter, ValidationError

from analysis.model.machine import Machine
from analysis.model.machine_body import MachineId
from estimators.errors import LogError
from replay.logs import Log


class MachineIdentity(NamedTuple):
    """Machine with its serial number, and the serial number in the logs' metadata."""

    machine: Machine
    logged_machine_id: str


def identify_machine_and_logged_id(logs: Sequence[Log], machine: Machine) -> MachineIdentity:
    """Determine the machine's serial number, and that in the logs' metadata.

    Args:
        logs: logs of one time line.
        machine: machine with `machine.id`, if its file or evidence has one.

    Returns:
        The machine, with the logs' serial number if it has none; and the serial number in the logs,
        "" without one.

    Raises:
        LogError: a log is of another machine, or two logs are of different machines.
    """
    machine_id = find_machine_id_common_to_logs(logs, machine.machine.id)
    if not machine_id or machine.machine.id is not None or not is_serial_number(machine_id):
        return MachineIdentity(machine, machine_id)
    body = machine.machine.model_copy(update={"id": machine_id})
    return MachineIdentity(machine.model_copy(update={"machine": body}), machine_id)


def find_machine_id_common_to_logs(logs: Sequence[Log], expected_id: str | None) -> str:
    """Find the serial number that is common to all logs that state one; "" if none does.

    Args:
        logs: logs of one machine; each may state several serial numbers.
        expected_id: serial number in machine file or evidence; None without one.

    Raises:
        LogError: as `identify_machine_and_logged_id`.
    """
    common: list[str] = []
    first: Log | None = None
    for log in logs:
        ids = log.machine_ids()
        if not ids:
            continue
        if expected_id is not None and expected_id not in ids:
            raise LogError(
                f"{log.path}: its metadata name machine '{ids[0]}', but machine.id is "
                f"'{expected_id}'; give the machine file and the evidence of '{ids[0]}'"
            )
        both = list(ids) if first is None else [each for each in common if each in ids]
        if not both and first is not None:
            raise LogError(
                f"{log.path}: its metadata name machine '{ids[0]}', but those of {first.path} name "
                f"'{common[0]}'; replay the logs of each machine separately"
            )
        common, first = both, first or log
    return expected_id or common[0] if common else ""


def is_serial_number(text: str) -> bool:
    """Whether a text is usable as a serial number; recorders may write anything."""
    try:
        TypeAdapter(MachineId).validate_python(text)
    except ValidationError:
        return False
    return True
