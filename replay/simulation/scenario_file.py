"""Read and write scenario files."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from analysis.simulation import Scenario
from analysis.simulation.trials.trial_limits import (
    refuse_undrivable_scenario,
    refuse_undrivable_shift,
)
from estimators.errors import ScenarioError
from recordings.report.atomic_output import stage_output_file
from replay.machines.toml_file import (
    format_toml,
    read_toml_file,
    refuse_other_kind_of_file,
    set_dotted_key_in_content,
    validate_toml_content,
)


def load_scenario_file(path: Path | str | None, overrides: Iterable[str] = ()) -> Scenario:
    """Read a scenario file; omitted keys are as in the paper's campaign.

    Args:
        path: a TOML file; None for the paper's machine without load, and one run.
        overrides: `key=value` with dotted keys, values as TOML writes them.

    Raises:
        ScenarioError: in one line: the file, the key and its fault; also if the machine cannot be
            driven as requested (`analysis.simulation.trials.trial_limits`).
    """
    content: dict[str, Any] = {"campaign": {"loads_kg": [0.0], "runs": 1}}
    if path is not None:
        content = read_toml_file(Path(path), ScenarioError)
        refuse_other_kind_of_file(Path(path), content, "scenario file", ScenarioError)
    for override in overrides:
        set_dotted_key_in_content(content, override, ScenarioError)
    source = Path(path or "--set")
    scenario = validate_toml_content(source, content, Scenario, ScenarioError)
    try:
        if scenario.shift is None:
            refuse_undrivable_scenario(scenario, scenario.campaign.loads_kg)
        else:
            refuse_undrivable_shift(scenario, scenario.shift)
    except ScenarioError as fault:
        raise ScenarioError(f"{source}: {fault}") from None
    return scenario


def format_scenario_file(scenario: Scenario) -> str:
    """Format a scenario file with the values that differ from the defaults."""
    sections = scenario.model_dump(mode="json", exclude_defaults=True)
    manoeuvres = [each.model_dump(exclude_none=True) for each in scenario.campaign.manoeuvres]
    blocks: list[str] = []
    for name, section in sections.items():
        section.pop("manoeuvres", None)
        # an empty section makes a scenario a shift
        if section or name == "shift":
            blocks.append(_format_toml_table(f"[{name}]", section))
    blocks += [_format_toml_table("[[campaign.manoeuvres]]", each) for each in manoeuvres]
    return "\n".join(blocks)


def write_scenario_file(scenario: Scenario, path: Path, *, overwrites: bool = False) -> None:
    """Write a scenario file that `simulate` accepts.

    Raises:
        OutputError: the file exists, or its folder cannot be written to.
    """
    with stage_output_file(path, overwrites=overwrites) as partial:
        partial.write_text(format_scenario_file(scenario), encoding="utf-8")


def _format_toml_table(title: str, values: Mapping[str, Any]) -> str:
    return "".join(
        [
            f"{title}\n",
            *(f"{key} = {format_toml(value)}\n" for key, value in values.items()),
        ]
    )
