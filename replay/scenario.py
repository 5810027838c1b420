"""Scenario files."""

from pathlib import Path

from analysis.simulation import Scenario
from estimators.errors import ScenarioError
from replay.toml_file import read_model


def load_scenario(path: Path | str) -> Scenario:
    """Read a scenario file; what it leaves out is as in the paper's campaign.

    Raises:
        ScenarioError: in one line: the file, the key, what is wrong with it.
    """
    return read_model(Path(path), Scenario, ScenarioError)
