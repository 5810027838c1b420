"""Campaign files of a calibration: TOML in, a validated campaign out, every fault in one line."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from analysis.calibration.campaign.campaign_fit import rule_of
from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.calibration.campaign.reference_masses import references
from analysis.model.machine import Machine
from estimators.errors import CampaignError, DataError
from replay.calibration.certified_masses import with_certified_masses
from replay.machines.machine_file import load_machine, machine_path
from replay.machines.toml_file import read_toml, validate

#: What a draft has for whatever no log can say; no name such as TODOROV.
_TODO: Final = re.compile(r"TODO\b")


def load_campaign(path: Path) -> tuple[CalibrationCampaign, Machine]:
    """Read a campaign file, and the machine file that it names.

    Args:
        path: a TOML file; logs and machine file are named from its folder.

    Raises:
        CampaignError: one line with the file, the fault, the choices and the remedy; also where a
            certificate had expired on the day of a run, or a log is not there.
        MachineError: likewise, of the machine file.
    """
    if not path.exists():
        raise CampaignError(
            f"{path}: no such campaign file; `payscope init --campaign FOLDER -o {path}` drafts "
            "one from a folder of logs"
        )
    content = read_toml(path, CampaignError)
    for place, text in left_open(content):
        raise CampaignError(f"{path}: {place}: is left to complete ('{text}')")
    content = with_certified_masses(path, content)
    campaign = validate(path, content, CalibrationCampaign, CampaignError)
    if campaign.laboratory is not None and campaign.not_stated:
        raise CampaignError(
            f"{path}: [laboratory] makes this a certificate after ISO/IEC 17025, 7.8, which lacks "
            f"{', '.join(campaign.not_stated)}; complete them, or leave [laboratory] out"
        )
    beside = path.parent / campaign.machine.file
    shipped = machine_path(Path(campaign.machine.file))
    machine = load_machine(beside if beside.exists() or not shipped.exists() else shipped)
    machine = of_machine(weighed_in(campaign, machine), campaign.machine.id, path)
    try:
        known, _ = references(campaign, machine.machine)
        rule_of(campaign, known)
    except (CampaignError, DataError) as fault:
        raise CampaignError(f"{path}: {fault}") from None
    overdue = campaign.overdue()
    if overdue:
        more = f" (and {len(overdue) - 1} more)" if len(overdue) > 1 else ""
        raise CampaignError(
            f"{path}: {overdue[0]}{more}; name a valid certificate, or leave the mass out"
        )
    for log in campaign.logs:
        if not (path.parent / log).exists():
            raise CampaignError(
                f"{path}: no log '{log}' in {path.parent}; logs are named from the campaign file's "
                "folder"
            )
    return campaign, machine


def of_machine(machine: Machine, wanted: str, what: object) -> Machine:
    """The machine with its serial number.

    Args:
        machine: as its file has it.
        wanted: its serial number.
        what: the file that gives it, for the error.

    Raises:
        CampaignError: the machine file is that of another machine.
    """
    named = machine.machine.id
    if named not in (None, wanted):
        raise CampaignError(
            f"{what}: is of machine '{wanted}', and its machine file of '{named}'; name the "
            f"machine file of '{wanted}', or correct machine.id"
        )
    return machine.model_copy(update={"machine": machine.machine.model_copy(update={"id": wanted})})


def left_open(content: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Where a draft was not completed: the place of each text whose first word is TODO, and it."""
    if isinstance(content, dict):
        for name, value in content.items():
            yield from left_open(value, f"{place}.{name}" if place else name)
    elif isinstance(content, list):
        for number, value in enumerate(content, start=1):
            yield from left_open(value, f"{place}[{number}]")
    elif isinstance(content, str) and _TODO.match(content):
        yield place, content


def weighed_in(campaign: CalibrationCampaign, machine: Machine) -> Machine:
    """The machine with the empty mass that the campaign file gives, where it gives any."""
    about = campaign.machine
    given = {"empty_mass_kg": about.empty_mass_kg, "empty_mass_u_kg": about.empty_mass_u_kg}
    known = {name: value for name, value in given.items() if value is not None}
    body = machine.machine.model_copy(update=known)
    return machine.model_copy(update={"machine": body})
