"""Simulated logs as files: one table of suffixes, and the truth beside each log."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

from analysis.simulation import SimulatedLog
from estimators.errors import OutputError
from recordings.report.atomic_output import atomic_files
from replay.logs.writers.bag_writer import write_bag
from replay.logs.writers.mcap_writer import write_mcap
from replay.logs.writers.rosbag2_writer import write_db3, write_rosbag2
from replay.logs.writers.table_writer import write_csv
from replay.logs.writers.tear_off import tear
from replay.simulation.log_truth import truth_path, write_truth

#: A rosbag2 directory has no suffix.
WRITERS: Final[dict[str, Callable[[SimulatedLog, Path], None]]] = {
    ".bag": write_bag,
    ".mcap": write_mcap,
    ".db3": write_db3,
    ".csv": write_csv,
    "": write_rosbag2,
}


def write_logs(
    logs: Iterable[SimulatedLog],
    targets: Sequence[Path],
    *,
    force: bool = False,
    beside: Mapping[Path, Callable[[Path], None]] = MappingProxyType({}),
) -> None:
    """Write each log to its target, and the truth to `TARGET.truth.json`: all of them, or none.

    Args:
        logs: as many as there are targets.
        targets: in one folder; the suffix says the format.
        force: whether outputs that are there may be replaced.
        beside: further files of the same folder, each with what writes it when all logs are
            written.

    Raises:
        OutputError: no format has that suffix, an output is there already, or the folder cannot
            be written to.
    """
    for target in targets:
        if target.suffix not in WRITERS:
            raise OutputError(
                f"{target}: no format '{target.suffix}'; use .bag, .mcap, .db3, .csv, "
                "or no suffix for a rosbag2 directory"
            )
    with atomic_files([*targets, *map(truth_path, targets), *beside], force=force) as stage:
        for log, target in zip(logs, targets, strict=True):
            WRITERS[target.suffix](log, stage / target.name)
            if log.torn_share:
                tear(stage / target.name, log.torn_share)
            write_truth(log, stage / target.name)
        for target, write in beside.items():
            write(stage / target.name)
