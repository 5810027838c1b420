"""Fleet files (TOML): rules that assign machine files and calibrations to logs."""

import glob
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from estimators.errors import FleetError
from replay.fleet.last_run import NamedFiles, TaskLimits
from replay.fleet.machine_setups import MachineSetup, make_machine_setups
from replay.machines.toml_file import read_toml, validate_toml_content

_STRICT: Final = ConfigDict(extra="forbid", frozen=True)
#: Stands for the machine's name in a rule.
NAME: Final = "{machine}"
#: Parts of a pattern, longest first, and what they stand for.
_PARTS: Final = {
    NAME: r"(?P<machine>[^/]+)",
    "**/": r"(?:[^/]+/)*",
    "*": r"[^/]*",
    "?": r"[^/]",
}
_PART: Final = re.compile("|".join(map(re.escape, _PARTS)))
_Text = Annotated[str, StringConstraints(min_length=1)]


class AboutFleet(BaseModel):
    """Owner of the fleet."""

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

    def machine_of_log_or_none(self, log: str) -> str | None:
        """Machine of a log; None if the rule does not match."""
        found = _compile_path_pattern(self.logs).search(log)
        if found is None:
            return None
        return found.groupdict().get("machine") or self.name


class FleetRules(BaseModel):
    """Content of a fleet file."""

    model_config = _STRICT

    fleet: AboutFleet = AboutFleet.model_validate({})
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
    def task_limits(self) -> TaskLimits:
        """Resource limits of one recording."""
        return self.rules.limits

    def setups_of_log(self, log: str) -> tuple[MachineSetup, ...]:
        """Replay setups of a log: one per calibration of the machine, or one without.

        Raises:
            FleetError: no rule matches.
            PayscopeError: the machine file or evidence of the rule is wrong.
        """
        for rule in self.rules.machines:
            name = rule.machine_of_log_or_none(log)
            if name is not None:
                return self._make_setups(rule, name)
        patterns = ", ".join(rule.logs for rule in self.rules.machines)
        raise FleetError(
            f"{log}: no rule in {self.path} matches this log; the rules are {patterns}"
        )

    def _make_setups(self, rule: MachineRule, name: str) -> tuple[MachineSetup, ...]:
        file = rule.file.replace(NAME, name)
        beside = (self.path.parent / file).absolute()
        file = str(beside) if beside.exists() else file
        folders: tuple[str, ...] = ()
        if rule.calibrations is not None:
            pattern = str(
                self.path.parent.absolute() / rule.calibrations.replace(NAME, glob.escape(name))
            )
            folders = tuple(sorted(glob.glob(pattern)))  # noqa: PTH207 - an absolute pattern
        overrides = (*rule.overrides, *self.overrides)
        return _read_setups_of_rule(name, NamedFiles(file, overrides, folders))


@cache
def _read_setups_of_rule(name: str, files: NamedFiles) -> tuple[MachineSetup, ...]:
    return make_machine_setups(name, files, lenient=False)


@cache
def _compile_path_pattern(text: str) -> re.Pattern[str]:
    """Compile a pattern for the end of a path, anchored at a slash or at its begin."""
    end = 0
    found: list[str] = []
    for part in _PART.finditer(text):
        found += [re.escape(text[end : part.start()]), _PARTS[part[0]]]
        end = part.end()
    return re.compile(rf"(?:^|/){''.join(found)}{re.escape(text[end:])}\Z")


def load_fleet(path: Path, overrides: tuple[str, ...] = ()) -> Fleet:
    """Read a fleet file.

    Args:
        path: a TOML file.
        overrides: `key=value` for every machine file.

    Raises:
        FleetError: one line with the file, the fault, the choices and the remedy.
    """
    if not path.exists():
        raise FleetError(f"{path}: no such fleet file; docs/fleet.md has an example")
    content = read_toml(path, FleetError)
    if "channels" in content and "machines" not in content:
        raise FleetError(
            f"{path}: is a machine file; a fleet file names it: [[machines]] with logs = "
            f'"**/*.mcap", name = "one" and file = "{path.name}"'
        )
    rules = validate_toml_content(path, content, FleetRules, FleetError)
    for number, rule in enumerate(rules.machines, start=1):
        if (NAME in rule.logs) == (rule.name is not None):
            raise FleetError(
                f"{path}: machines[{number}]: give either name or {NAME} in logs, by which the "
                "machine is known"
            )
        if rule.logs.count(NAME) > 1:
            raise FleetError(f"{path}: machines[{number}]: logs has {NAME} more than once")
        if "/" not in rule.logs.partition(NAME)[0] and "**/" in rule.logs.partition(NAME)[2]:
            raise FleetError(
                f"{path}: machines[{number}]: any folder of a path may be {NAME} in '{rule.logs}'; "
                f"name the folder before {NAME}"
            )
    return Fleet(path, rules, overrides)
