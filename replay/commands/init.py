"""`payscope init`: draft a first machine file or campaign file."""

from pathlib import Path
from typing import Annotated

import typer

from replay.commands.common_options import LogKeys, TimeColumn, TimeUnit


def command(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The machine or campaign file to write.")
    ],
    log: Annotated[Path | None, typer.Argument(help="The log.")] = None,
    campaign: Annotated[
        Path | None,
        typer.Option("--campaign", metavar="DIR", help="Draft a campaign of the logs in DIR."),
    ] = None,
    machine: Annotated[
        Path | None,
        typer.Option("-m", "--machine", help="Machine file of the campaign, to find its loads."),
    ] = None,
    time: TimeColumn = None,
    time_unit: TimeUnit = None,
    keys: LogKeys = None,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
) -> None:
    """Draft a machine file from a log, or a campaign file from a folder of logs.

    Check and complete it by hand.
    """
    from recordings.report.atomic_output import (
        refuse_input_as_output,
        require_writable_output,
        stage_output_file,
    )
    from replay.commands.common_options import make_time_axis_from_options
    from replay.init.guess_by_replay import (
        BRAKING,
        drop_answered_brake_question,
        propose_settings_by_replaying_draft,
    )
    from replay.init.guess_machine import draft_machine_file
    from replay.logs import open_log

    if (log is None) == (campaign is None):
        raise typer.BadParameter("give a LOG for a machine file, or --campaign DIR")
    axis = make_time_axis_from_options(time, time_unit, keys)
    if campaign is not None:
        from replay.init.campaign_draft import draft_campaign_file

        require_writable_output(output, overwrites=force)
        text, lacking = draft_campaign_file(campaign, output, machine)
    else:
        assert log is not None
        if machine is not None:
            raise typer.BadParameter("--machine is for --campaign; a LOG yields a machine file")
        with open_log(log, time=axis) as opened:
            refuse_input_as_output(output, opened.files)
            text, missing = draft_machine_file(opened, axis)
            lacking = [f"note: {note}" for note in opened.notes()]
            found = [*BRAKING] if missing else propose_settings_by_replaying_draft(opened, text)
            text = "\n".join([drop_answered_brake_question(text, found), *found])
        lacking += [f"still missing: {sentence}" for sentence in missing]
    with stage_output_file(output, overwrites=force) as partial:
        partial.write_text(text, encoding="utf-8")
    for sentence in lacking:
        typer.echo(sentence, err=True)
    typer.echo(str(output))
