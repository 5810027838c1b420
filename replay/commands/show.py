"""`payscope show`: print any frame of a recording, without the viewer."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from replay.commands.common_options import (
    Calibration,
    FormatOption,
    FrameFormat,
    OutputFile,
    RequireSigned,
    SignerKey,
    make_calibration_request,
)

if TYPE_CHECKING:
    from replay.calibration.apply_evidence import CalibrationRequest


def command(
    recording: Annotated[Path, typer.Argument(help="A recording (.rrd).")],
    frame: Annotated[
        str | None,
        typer.Argument(help="A frame, such as gate or estimates/ls; without one, list them."),
    ] = None,
    start_s: Annotated[
        float | None,
        typer.Option("--from", help="First second to print, from the start of the run."),
    ] = None,
    end_s: Annotated[float | None, typer.Option("--to", help="Last second to print.")] = None,
    at_s: Annotated[
        float | None,
        typer.Option(
            "--at", help="Print the values at this second: the last row, or the spans around it."
        ),
    ] = None,
    output_format: FormatOption = None,
    output: OutputFile = None,
    calibration: Calibration = None,
    key: SignerKey = None,
    require_signed: RequireSigned = False,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
) -> None:
    """Print a frame of a recording, or list its frames."""
    if frame is not None:
        wanted = output_format and output_format.value
        asked = make_calibration_request(calibration, key, is_signature_required=require_signed)
        if at_s is not None and (start_s, end_s) != (None, None):
            raise typer.BadParameter(
                "--at gives one time, --from and --to give a range; use one or the other"
            )
        seconds = (start_s, end_s) if at_s is None else at_s
        _print_or_write_frame_rows(
            (recording, frame, asked), seconds, wanted, output, overwrites=force
        )
    elif calibration is not None:
        raise typer.BadParameter("--calibration applies to the frame 'loads' only; name that frame")
    elif (start_s, end_s, at_s, output) != (None, None, None, None):
        raise typer.BadParameter("--from, --to, --at and -o need the name of a frame")
    elif output_format not in (None, FrameFormat.table, FrameFormat.json):
        raise typer.BadParameter(
            "the list of frames is printed as table or json; give a frame for other formats"
        )
    else:
        _print_list_of_frames(recording, as_json=output_format is FrameFormat.json)


def _print_list_of_frames(recording: Path, *, as_json: bool) -> None:
    """Print the recording's frames with their columns, and its losses."""
    from rich.markup import escape

    from recordings import list_columns_by_frame, read_provenance
    from replay.commands.print_tables import (
        make_plain_table,
        make_stdout_console,
        print_json,
        print_line,
        print_table_uncut,
    )

    held = list_columns_by_frame(recording)
    if as_json:
        print_json(held)
        return
    table = make_plain_table("frame")
    table.add_column("columns", overflow="fold")
    for name, columns in held.items():
        # effort[left] must not be taken as markup
        table.add_row(escape(name), escape(" ".join(columns)))
    screen = make_stdout_console()
    print_table_uncut(screen, table)
    provenance = read_provenance(recording)
    for loss in provenance.losses:
        print_line(screen, f"lost: {loss}")
    for note in provenance.notes:
        print_line(screen, f"note: {note}")


def _print_or_write_frame_rows(
    frame_request: "tuple[Path, str, CalibrationRequest | None]",
    time_span_s: tuple[float | None, float | None] | float,
    output_format: str | None,
    output: Path | None,
    *,
    overwrites: bool,
) -> None:
    """Print or write the rows of one frame in a time range, or at one time."""
    from recordings.report.atomic_output import refuse_input_as_output, require_writable_output
    from replay.commands.frame_output import (
        choose_output_format,
        format_frame_as_table,
        print_frame_as_table,
        print_or_write_frame,
    )
    from replay.recording.read_stage import RecordedStage

    recording, name, calibration = frame_request
    output_format = choose_output_format(output_format, output)
    if output is not None:
        refuse_input_as_output(output, [recording])
        require_writable_output(output, overwrites=overwrites)
    stage = RecordedStage.read_frame_as_stage(recording, name)
    if calibration is not None:
        stage = stage.apply_calibration_to_masses(calibration)
    stage = (
        stage.select_rows_between(*time_span_s)
        if isinstance(time_span_s, tuple)
        else stage.select_rows_at_second(time_span_s)
    )
    if output is None and output_format == "table":
        print_frame_as_table(stage.make_frame_with_readable_times(), "--from and --to choose, ")
        return
    print_or_write_frame(
        stage.rows,
        output_format,
        output,
        overwrites=overwrites,
        render=lambda: format_frame_as_table(
            stage.make_frame_with_readable_times(), stage.rows.height
        ),
    )
