"""`payscope run`: the main job."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs (.bag, .mcap, rosbag2, .db3, .csv, .parquet).")
    ],
    machine: Annotated[Path, typer.Option("-m", "--machine", help="The machine file.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="The recording to write (.rrd).")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the machine file; repeatable."),
    ] = None,
    timing: Annotated[bool, typer.Option(help="Print the seconds of each stage.")] = False,
    strict: Annotated[bool, typer.Option(help="Refuse a log with any loss.")] = False,
    live: Annotated[
        bool, typer.Option("--live", help="Watch the recording in the viewer as it is written.")
    ] = False,
    force: Annotated[bool, typer.Option(help="Replace an existing recording.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Replay logs (in one time line) and say what the machine weighs, and whether to believe it.

    Exit status 1 when the log cannot weigh: the mass is withheld and the failed checks are listed.
    """
    from replay.commands.replaying import print_answer, replay_logs

    if live and output is None:
        raise typer.BadParameter("--live shows a recording: name it with -o")
    answer = replay_logs(
        logs,
        machine,
        output,
        overrides or [],
        strict=strict,
        force=force,
        timing=timing,
        live=live,
    )
    print_answer(answer, as_json=as_json)
    if not answer["verdict"]["can_weigh"]:
        raise typer.Exit(1)
