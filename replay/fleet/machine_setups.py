"""Setups by which a fleet's logs are replayed, and the fleet file whose rules assign them.

A setup is a machine's resolved file with one of its calibrations. A fleet file (TOML) has rules
that assign machine files and calibrations to logs.
"""

import datetime as dt
import glob
import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from analysis.fleet.calibration_steps import FleetCalibration, fit_fleet_calibration
from analysis.fleet.fleet_tables import TABLES
from analysis.model.machine import Machine
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from estimators.errors import EvidenceError, FleetError
from replay.calibration.apply_evidence import (
    CalibrationRequest,
    MachineCalibration,
    load_and_verify_calibration,
)
from replay.fleet.last_run import NamedFiles, TaskLimits
from replay.inputs.channel_inputs import (
    collect_versions_of_packages,
    convert_machine_without_settings_to_dict,
)
from replay.machines.machine_file import load_machine
from replay.machines.toml_file import read_toml_file, validate_toml_content

#: Version of results, raised whenever existing results must be made again.
FORMAT: Final = 1
_S: Final = 10**9
_STRICT: Final = ConfigDict(extra="forbid", frozen=True)
#: Stands for the machine's name in a rule.
NAME: Final = "{machine}"
#: Wildcards of a pattern, longest first, and the regular expressions that they stand for.
_PARTS: Final = {NAME: r"(?P<machine>[^/]+)", "**/": r"(?:[^/]+/)*", "*": r"[^/]*", "?": r"[^/]"}
_PART: Final = re.compile("|".join(map(re.escape, _PARTS)))
_Text = Annotated[str, StringConstraints(min_length=1)]


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

    def does_apply_on_day(self, day: dt.date | None) -> bool:
        """Whether the setup applies to logs of a day, which is None if unknown."""
        if self.by is None:
            return True
        return day is not None and self.first <= day <= self.by.document.expires

    def convert_to_local_day(self, unix_ns: int | None) -> dt.date | None:
        """Convert Unix time in ns to the day in the machine's time zone; None without a date."""
        if unix_ns is None or unix_ns < FIRST_DATE_NS:
            return None
        return dt.datetime.fromtimestamp(unix_ns // _S, self.machine.machine.time_zone).date()

    @property
    def calibration(self) -> FleetCalibration | None:
        """Calibration of the setup, for comparisons within the fleet; None without evidence."""
        if self.by is None:
            return None
        document = self.by.document
        days = (self.first, document.expires)
        return fit_fleet_calibration(self.name, document.id, days, self.by.calibration)


def make_setups_of_machine(
    name: str, files: NamedFiles, *, is_unfit_evidence_skipped: bool
) -> tuple[MachineSetup, ...]:
    """Make a setup for each calibration, the latest first, and one without calibration.

    Args:
        name: name of the machine.
        files: machine file and evidence; evidence of single-mass checks is skipped.
        is_unfit_evidence_skipped: whether to skip evidence with other settings.

    Raises:
        PayscopeError: the machine file is wrong, or evidence is wrong, of another machine, or
            signed by a key outside the user's keyring.
    """
    machine = load_machine(files.file, files.overrides)
    calibrations: list[tuple[MachineCalibration, Machine]] = []
    for folder in map(Path, files.calibrations):
        if is_mass_check_evidence(folder):
            continue
        by = load_and_verify_calibration(CalibrationRequest(folder))
        if by.signed_by.how == "unknown":
            # a fleet runs unattended, so that no one can be asked about a key
            raise EvidenceError(
                f"{folder}: is {by.signed_by}; if the signer gave you this key in person, add it "
                f"to your keyring with {by.signed_by.command_to_add_key}"
            )
        try:
            weighing = by.require_calibrated_machine(
                by.copy_machine_with_calibrated_settings(machine), files.file
            )
        except EvidenceError:
            if not is_unfit_evidence_skipped:
                raise
            continue
        calibrations.append((by, weighing))
    calibrations.sort(key=lambda each: find_last_day_of_campaign(each[0]), reverse=True)
    calibrated = [
        _make_setup_with_digest(name, files, weighing, by) for by, weighing in calibrations
    ]
    return (*calibrated, _make_setup_with_digest(name, files, machine, None))


def choose_setup_valid_on_day(setups: Sequence[MachineSetup], day: dt.date | None) -> MachineSetup:
    """Choose the setup for logs of a day: with the latest calibration valid then, or none."""
    return next(each for each in setups if each.does_apply_on_day(day))


def _make_setup_with_digest(
    name: str, files: NamedFiles, machine: Machine, calibration: MachineCalibration | None
) -> MachineSetup:
    whole = {
        "format": FORMAT,
        "tables": list(TABLES),
        "name": name,
        "machine": convert_machine_without_settings_to_dict(machine),
        "settings": machine.settings.model_dump(mode="json"),
        "calibration": "" if calibration is None else calibration.document.id,
        "versions": collect_versions_of_packages(),
    }
    basis = hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()
    first = dt.date.min if calibration is None else find_last_day_of_campaign(calibration)
    return MachineSetup(name, files, machine, calibration, first, basis)


def find_last_day_of_campaign(calibration: MachineCalibration) -> dt.date:
    """Find the last day of the campaign, from which on its line applies."""
    return max(run.day for run in calibration.document.campaign.runs)


def is_mass_check_evidence(evidence_folder: Path) -> bool:
    """Whether a folder contains the check of a single mass."""
    try:
        content = json.loads((evidence_folder / "evidence.json").read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("kind") == "check"


class FleetSection(BaseModel):
    """Name of the fleet on its page."""

    model_config = _STRICT

    name: _Text = Field("fleet", description="name, on the page")


class MachineRule(BaseModel):
    """A rule that assigns logs to a machine; the first rule that matches applies."""

    model_config = _STRICT

    logs: _Text = Field(
        description="pattern of the end of a log's path: `*`, `?`, `**/` and `{machine}`"
    )
    file: _Text = Field(
        description="machine file, from the fleet file's folder or a shipped one; may have "
        "`{machine}`"
    )
    name: _Text | None = Field(
        None, description="name of the machine, where `logs` has no `{machine}`"
    )
    calibrations: _Text | None = Field(
        None, description="pattern of folders of evidence; may have `{machine}`"
    )
    overrides: tuple[str, ...] = Field((), description="`key=value`, of the machine file")

    def find_machine_of_log(self, log: str) -> str | None:
        """Name of a log's machine; None if the rule does not match."""
        found = compile_path_end_pattern(self.logs).search(log)
        if found is None:
            return None
        return found.groupdict().get("machine") or self.name


class FleetRules(BaseModel):
    """Content of a fleet file."""

    model_config = _STRICT

    fleet: FleetSection = FleetSection.model_validate({})
    limits: TaskLimits = TaskLimits.model_validate({})
    machines: tuple[MachineRule, ...] = Field(min_length=1)


@dataclass(frozen=True)
class Fleet:
    """A fleet file with its path and overrides.

    Attributes:
        path: path of the file.
        rules: content of the file.
        overrides: `key=value` for every machine file, applied after those of the rules.
    """

    path: Path
    rules: FleetRules
    overrides: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the fleet."""
        return self.rules.fleet.name

    @property
    def time_and_memory_limits(self) -> TaskLimits:
        """Resource limits of one recording."""
        return self.rules.limits

    def list_setups_of_log(self, log: str) -> tuple[MachineSetup, ...]:
        """Replay setups of a log: one per calibration of the machine, or one without.

        Raises:
            FleetError: no rule matches.
            PayscopeError: the machine file or evidence of the rule is wrong.
        """
        for rule in self.rules.machines:
            name = rule.find_machine_of_log(log)
            if name is not None:
                return self._read_setups_of_machine_by_rule(rule, name)
        patterns = ", ".join(rule.logs for rule in self.rules.machines)
        raise FleetError(
            f"{log}: no rule in {self.path} matches this log; add one to its rules: {patterns}"
        )

    def _read_setups_of_machine_by_rule(
        self, rule: MachineRule, machine_name: str
    ) -> tuple[MachineSetup, ...]:
        file = rule.file.replace(NAME, machine_name)
        beside = (self.path.parent / file).absolute()
        file = str(beside) if beside.exists() else file
        folders: tuple[str, ...] = ()
        if rule.calibrations is not None:
            pattern = str(
                self.path.parent.absolute()
                / rule.calibrations.replace(NAME, glob.escape(machine_name))
            )
            folders = tuple(sorted(glob.glob(pattern)))  # noqa: PTH207 - an absolute pattern
        overrides = (*rule.overrides, *self.overrides)
        return _read_machine_setups(machine_name, NamedFiles(file, overrides, folders))


@cache
def _read_machine_setups(name: str, files: NamedFiles) -> tuple[MachineSetup, ...]:
    return make_setups_of_machine(name, files, is_unfit_evidence_skipped=False)


@cache
def compile_path_end_pattern(pattern_text: str) -> re.Pattern[str]:
    """Compile a pattern for the end of a path, anchored at a slash or at the path's start."""
    end = 0
    found: list[str] = []
    for part in _PART.finditer(pattern_text):
        found += [re.escape(pattern_text[end : part.start()]), _PARTS[part[0]]]
        end = part.end()
    return re.compile(rf"(?:^|/){''.join(found)}{re.escape(pattern_text[end:])}\Z")


def load_fleet(fleet_path: Path, overrides: tuple[str, ...] = ()) -> Fleet:
    """Read a fleet file.

    Args:
        fleet_path: a TOML file.
        overrides: `key=value` for every machine file.

    Raises:
        FleetError: one line with the file, the fault, the choices and the remedy.
    """
    if not fleet_path.exists():
        raise FleetError(f"{fleet_path}: no such fleet file; docs/fleet.md has an example")
    content = read_toml_file(fleet_path, FleetError)
    if "channels" in content and "machines" not in content:
        raise FleetError(
            f"{fleet_path}: is a machine file; a fleet file names it: [[machines]] with logs = "
            f'"**/*.mcap", name = "one" and file = "{fleet_path.name}"'
        )
    rules = validate_toml_content(fleet_path, content, FleetRules, FleetError)
    for number, rule in enumerate(rules.machines, start=1):
        if (NAME in rule.logs) == (rule.name is not None):
            raise FleetError(
                f"{fleet_path}: machines[{number}]: needs either name or {NAME} in logs, and not "
                "both, to name the machine"
            )
        if rule.logs.count(NAME) > 1:
            raise FleetError(
                f"{fleet_path}: machines[{number}]: logs has {NAME} more than once; keep one"
            )
        if "/" not in rule.logs.partition(NAME)[0] and "**/" in rule.logs.partition(NAME)[2]:
            raise FleetError(
                f"{fleet_path}: machines[{number}]: in '{rule.logs}', {NAME} would match any "
                f"folder of a path; put the folder above it first, such as logs/{NAME}/"
            )
    return Fleet(fleet_path, rules, overrides)
