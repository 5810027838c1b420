"""Simulate a scenario as logs with known truth."""

from pathlib import Path

from analysis.simulation import Scenario, simulate_campaign
from estimators.errors import OutputError
from replay.simulation.log_truth import write_shift_truth
from replay.simulation.write_log import write_logs


def simulate(scenario: Scenario, output: Path, *, force: bool = False) -> list[Path]:
    """Write the scenario's logs, and beside each its truth (`LOG.truth.json`).

    Args:
        scenario: what to simulate.
        output: the log; its suffix says the format (.bag, .mcap, .db3, .csv; none: a rosbag2
            directory).
            With several loads, each has its own log, named after it: `campaign.bag` becomes
            `campaign_000kg.bag`, `campaign_050kg.bag`, …. A shift of several logs numbers them,
            `shift_1.bag`, …, and what is true of all is in `shift.cycles.json`.
        force: whether logs that are there may be replaced.

    Returns:
        The logs, in the order of the loads, or of a shift; they make one time line.

    Raises:
        OutputError: no format has that suffix, an output is there already, or the folder cannot
            be written to.
        ScenarioError: the machine cannot be driven as asked.
    """
    targets = log_paths(scenario, output)
    if scenario.shift is None:
        write_logs(simulate_campaign(scenario), targets, force=force)
        return targets
    from analysis.simulation.logs.shift_logs import ShiftSimulation

    shift = ShiftSimulation(scenario, scenario.shift)
    beside = shift_truth_path(output)
    write_logs(
        shift.logs(),
        targets,
        force=force,
        beside={beside: lambda path: write_shift_truth(shift.truth(), scenario, targets, path)},
    )
    return targets


def shift_truth_path(output: Path) -> Path:
    """Where the truth of a simulated shift is."""
    return output.with_name(f"{output.stem}.cycles.json")


def log_paths(scenario: Scenario, output: Path) -> list[Path]:
    """The logs that `simulate` writes.

    Raises:
        OutputError: the output has no name.
    """
    if not output.name:
        raise OutputError(f"{output}: is a folder; name a log in it, such as '{output}/log.mcap'")
    if scenario.shift is not None:
        return _number_outputs(output, scenario.shift.logs)
    loads = scenario.campaign.loads_kg
    if len(loads) == 1:
        return [output]
    return [output.with_name(f"{output.stem}_{_number(load)}kg{output.suffix}") for load in loads]


def _number_outputs(output: Path, count: int) -> list[Path]:
    if count == 1:
        return [output]
    digits = len(str(count))
    return [
        output.with_name(f"{output.stem}_{number:0{digits}}{output.suffix}")
        for number in range(1, count + 1)
    ]


def _number(load_kg: float) -> str:
    # a point would start a suffix
    return f"{load_kg:03.0f}" if load_kg.is_integer() else str(load_kg).replace(".", "_")
