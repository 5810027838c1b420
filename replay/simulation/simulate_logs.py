"""Simulate a scenario, and write its logs in any format, each with its truth."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

import polars as pl

from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from estimators.errors import OutputError
from recordings.report.atomic_output import stage_output_files
from replay.logs.writers.bag_writer import write_bag
from replay.logs.writers.mcap_writer import write_mcap
from replay.logs.writers.rosbag2_writer import METADATA, write_db3, write_rosbag2
from replay.simulation.log_truth import (
    make_truth_path_of_log,
    write_truth_of_log,
    write_truth_of_shift,
)


def write_log_as_csv(log: SimulatedLog, path: Path) -> None:
    """Write `log` as CSV at `path`, which must not exist.

    `time_s` counts from the start of the campaign, so that the tables of all loads are on one time
    line, and every time is exact to the nanosecond, unlike Unix seconds in a double. The other
    columns are the machine file's channels, with numbers that read back exactly.
    """
    topics = (frame.drop("log_time_ns") for frame in log.topics.values())
    table = next(topics)
    for topic in topics:
        table = table.join(topic, on="header_stamp_ns", how="full", coalesce=True)
    time_s = (pl.col("header_stamp_ns") - log.origin_unix_ns) / 1e9
    table.sort("header_stamp_ns").select(
        time_s.alias("time_s"), pl.exclude("header_stamp_ns")
    ).write_csv(path)


#: Function that writes a log, by suffix of its path; a rosbag2 directory has none.
WRITERS: Final[dict[str, Callable[[SimulatedLog, Path], None]]] = {
    ".bag": write_bag,
    ".mcap": write_mcap,
    ".db3": write_db3,
    ".csv": write_log_as_csv,
    "": write_rosbag2,
}


def write_logs_and_truths(
    logs: Iterable[SimulatedLog],
    targets: Sequence[Path],
    *,
    overwrites: bool = False,
    further_files: Mapping[Path, Callable[[Path], None]] = MappingProxyType({}),
) -> None:
    """Write each log to its target, and its truth to `TARGET.truth.json`: all of them or none.

    Args:
        logs: one log per target.
        targets: paths in one folder; the suffix sets the format.
        overwrites: whether to replace existing outputs.
        further_files: further files in that folder, each with the function that writes it, called
            after the logs are written.

    Raises:
        OutputError: no format has that suffix, an output is there already, or the folder cannot
            be written to.
    """
    for target in targets:
        if target.suffix not in WRITERS:
            raise OutputError(
                f"{target}: unknown format '{target.suffix}'; use .bag, .mcap, .db3, .csv, "
                "or no suffix for a rosbag2 directory"
            )
    with stage_output_files(
        [*targets, *map(make_truth_path_of_log, targets), *further_files], overwrites=overwrites
    ) as stage:
        for log, target in zip(logs, targets, strict=True):
            WRITERS[target.suffix](log, stage / target.name)
            if log.torn_share:
                truncate_log_file(stage / target.name, log.torn_share)
            write_truth_of_log(log, stage / target.name)
        for target, write in further_files.items():
            write(stage / target.name)


def truncate_log_file(log: Path, fraction: float) -> None:
    """Cut off the end of a log's file; a directory also loses its metadata.

    Args:
        log: file, or rosbag2 directory with one storage file.
        fraction: fraction of its bytes to cut off, from 0 to 1.
    """
    if log.is_dir():
        (log / METADATA).unlink()
        (log,) = log.iterdir()
    size = log.stat().st_size
    with log.open("r+b") as file:
        file.truncate(size - round(size * fraction))


def simulate_scenario_to_logs(
    scenario: Scenario, output: Path, *, overwrites: bool = False
) -> list[Path]:
    """Write the scenario's logs, each with its truth (`LOG.truth.json`).

    Args:
        scenario: scenario to simulate.
        output: path of the log; its suffix sets the format (.bag, .mcap, .db3, .csv; none: a
            rosbag2 directory). Several loads have a log each: `campaign.bag` becomes
            `campaign_000kg.bag`, `campaign_050kg.bag`, …. Several logs of a shift are numbered,
            `shift_1.bag`, …, and the truth of the whole shift is in `shift.cycles.json`.
        overwrites: whether to replace existing logs.

    Returns:
        Paths of the logs, in order of loads or of time; all logs are on one time line.

    Raises:
        OutputError: no format has that suffix, an output is there already, or the folder cannot
            be written to.
        ScenarioError: the machine cannot be driven as requested.
    """
    targets = make_paths_of_simulated_logs(scenario, output)
    if scenario.shift is None:
        write_logs_and_truths(simulate_campaign(scenario), targets, overwrites=overwrites)
        return targets
    from analysis.simulation.logs.shift_logs import ShiftSimulation

    shift = ShiftSimulation(scenario, scenario.shift)
    beside = make_shift_truth_path(output)
    write_logs_and_truths(
        shift.simulate_logs(),
        targets,
        overwrites=overwrites,
        further_files={
            beside: lambda path: write_truth_of_shift(
                shift.collect_truth(), scenario, targets, path
            )
        },
    )
    return targets


def make_shift_truth_path(output: Path) -> Path:
    """Make the path of the truth of a simulated shift."""
    return output.with_name(f"{output.stem}.cycles.json")


def make_paths_of_simulated_logs(scenario: Scenario, output: Path) -> list[Path]:
    """Make the paths of the logs that `simulate` writes.

    Raises:
        OutputError: the output is a folder, without the name of a log.
    """
    if not output.name:
        raise OutputError(f"{output}: is a folder; give a log in it, such as '{output}/log.mcap'")
    if scenario.shift is not None:
        return _make_numbered_paths(output, scenario.shift.logs)
    loads = scenario.campaign.loads_kg
    if len(loads) == 1:
        return [output]
    return [
        output.with_name(f"{output.stem}_{_format_load_for_file_name(load)}kg{output.suffix}")
        for load in loads
    ]


def _make_numbered_paths(output: Path, path_count: int) -> list[Path]:
    if path_count == 1:
        return [output]
    digits = len(str(path_count))
    return [
        output.with_name(f"{output.stem}_{number:0{digits}}{output.suffix}")
        for number in range(1, path_count + 1)
    ]


def _format_load_for_file_name(load_kg: float) -> str:
    # a point would begin a suffix
    return f"{load_kg:03.0f}" if load_kg.is_integer() else str(load_kg).replace(".", "_")
