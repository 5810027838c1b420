"""`payscope simulate`: simulate logs with known truth."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    scenario: Annotated[Path, typer.Argument(help="A scenario file (TOML).")],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="Log to write: .bag, .mcap, .db3, .csv; without suffix, a rosbag2 directory.",
        ),
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the scenario; repeatable."),
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace existing logs.")] = False,
) -> None:
    """Simulate a scenario as logs, one for each load, with its truth in LOG.truth.json."""
    from replay.simulation.scenario_file import load_scenario_file
    from replay.simulation.simulate_logs import simulate_scenario_to_logs

    for path in simulate_scenario_to_logs(
        load_scenario_file(scenario, overrides or []), output, overwrites=force
    ):
        typer.echo(str(path))
