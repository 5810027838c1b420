"""Replay setups of a machine: its resolved file with one of its calibrations."""

import datetime as dt
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from analysis.fleet.calibration_steps import FleetCalibration, fit_fleet_calibration
from analysis.fleet.fleet_tables import TABLES
from analysis.model.machine import Machine
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from estimators.errors import EvidenceError
from replay.calibration.apply_evidence import (
    CalibrationRequest,
    MachineCalibration,
    load_calibration,
)
from replay.fleet.last_run import NamedFiles
from replay.inputs.channel_inputs import machine_without_settings_as_dict, package_versions
from replay.machines.machine_file import load_machine

#: Raised whenever results that are there have to be made anew.
FORMAT: Final = 1
_S: Final = 10**9


@dataclass(frozen=True)
class MachineSetup:
    """One way to replay logs of a machine.

    Attributes:
        name: name of the machine in the fleet file.
        files: files that it was read from.
        machine: resolved machine file.
        by: evidence that calibrates it, or None.
        first: first day on which the evidence applies.
        basis: digest of everything besides the log that a result depends on.
    """

    name: str
    files: NamedFiles
    machine: Machine
    by: MachineCalibration | None
    first: dt.date
    basis: str

    def applies_on_day(self, day: dt.date | None) -> bool:
        """Whether it applies to logs of a day; None for an unknown day."""
        if self.by is None:
            return True
        return day is not None and self.first <= day <= self.by.document.expires

    def local_day_or_none(self, unix_ns: int | None) -> dt.date | None:
        """Day in the machine's time zone; None without a date."""
        if unix_ns is None or unix_ns < FIRST_DATE_NS:
            return None
        return dt.datetime.fromtimestamp(unix_ns // _S, self.machine.machine.zone).date()

    @property
    def calibration(self) -> FleetCalibration | None:
        """Calibration of the setup, for comparisons within the fleet; None without evidence."""
        if self.by is None:
            return None
        document = self.by.document
        days = (self.first, document.expires)
        return fit_fleet_calibration(self.name, document.id, days, self.by.calibration)


def make_machine_setups(name: str, files: NamedFiles, *, lenient: bool) -> tuple[MachineSetup, ...]:
    """One setup for each calibration, the latest first, and one without calibration.

    Args:
        name: name of the machine.
        files: machine file and evidence; evidence of single-mass checks is skipped.
        lenient: whether to skip evidence with other settings.

    Raises:
        PayscopeError: the machine file is wrong, or evidence is wrong, of another machine, or
            signed by a key outside the user's keyring.
    """
    machine = load_machine(files.file, files.overrides)
    calibrations: list[tuple[MachineCalibration, Machine]] = []
    for folder in map(Path, files.calibrations):
        if _is_evidence_of_mass_check(folder):
            continue
        by = load_calibration(CalibrationRequest(folder))
        if by.signed_by.how == "unknown":
            # nobody sits beside a fleet to be asked
            raise EvidenceError(
                f"{folder}: is {by.signed_by}; if the signer gave you this key in person, keep it "
                f"with {by.signed_by.command_to_add_key}"
            )
        try:
            weighing = by.require_calibrated_machine(by.weighing_machine(machine), files.file)
        except EvidenceError:
            if not lenient:
                raise
            continue
        calibrations.append((by, weighing))
    calibrations.sort(key=lambda each: last_day_of_campaign(each[0]), reverse=True)
    calibrated = [_make_setup(name, files, weighing, by) for by, weighing in calibrations]
    return (*calibrated, _make_setup(name, files, machine, None))


def setup_of_day(setups: Sequence[MachineSetup], day: dt.date | None) -> MachineSetup:
    """Setup for logs of a day: with the latest calibration valid then, or without one."""
    return next(each for each in setups if each.applies_on_day(day))


def _make_setup(
    name: str, files: NamedFiles, machine: Machine, calibration: MachineCalibration | None
) -> MachineSetup:
    whole = {
        "format": FORMAT,
        "tables": list(TABLES),
        "name": name,
        "machine": machine_without_settings_as_dict(machine),
        "settings": machine.settings.model_dump(mode="json"),
        "calibration": "" if calibration is None else calibration.document.id,
        "versions": package_versions(),
    }
    basis = hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()
    first = dt.date.min if calibration is None else last_day_of_campaign(calibration)
    return MachineSetup(name, files, machine, calibration, first, basis)


def last_day_of_campaign(calibration: MachineCalibration) -> dt.date:
    """Last day of the campaign, from which its line applies."""
    return max(run.day for run in calibration.document.campaign.runs)


def _is_evidence_of_mass_check(folder: Path) -> bool:
    """Whether a folder contains the check of a single mass."""
    try:
        content = json.loads((folder / "evidence.json").read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("kind") == "check"
