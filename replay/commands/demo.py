"""`payscope demo`: the paper's calibration campaign, simulated, through everything."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The folder for the demo's files.")
    ] = Path("demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated noise.")] = 1,
    force: Annotated[bool, typer.Option(help="Replace the files of an earlier demo.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Simulate six loads × nine runs as ROS bags, replay them, calibrate, record and draw."""
    from replay.commands.printing import console, print_json
    from replay.commands.progress import Stages
    from replay.demo import demo

    with Stages() as stages:
        result = demo(output, seed=seed, force=force, on_stage=stages.begin)
    if as_json:
        print_json(result.to_dict())
    else:
        from replay.commands.demo_tables import render

        console().print(render(result))
