"""`payscope notarise`: list the finished logs of a recorder, so that none can be omitted."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from replay.notary.notarise_folder import NotarisedFolder


def command(
    folder: Annotated[Path, typer.Argument(help="Folder that the recorder writes its logs to.")],
    key: Annotated[
        Path | None,
        typer.Option(
            help="Private Ed25519 key (PEM) of the recorder; else PAYSCOPE_SIGNING_KEY may hold it."
        ),
    ] = None,
    list_path: Annotated[
        Path | None,
        typer.Option(
            "--list",
            metavar="FILE",
            help="Notary list to append to; by default notary.jsonl in the log folder.",
        ),
    ] = None,
    machine_id: Annotated[
        str, typer.Option("--machine-id", metavar="ID", help="Serial number of the machine.")
    ] = "",
    quiet: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            min=0,
            help="Time without a write after which a log counts as finished.",
        ),
    ] = 60.0,
    every: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", min=1, help="Repeat until interrupted."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print each pass as JSON.")] = False,
) -> None:
    """List the finished logs of a folder, each with its SHA-256, signed and chained to the last.

    The list is only ever appended to. A campaign that names a part of it has to account for
    every log in it; `payscope verify LIST` checks a list.
    """
    import time

    from replay.commands.print_tables import make_stdout_console, print_json
    from replay.notary.notarise_folder import notarise_folder

    while True:
        made = notarise_folder(
            folder, key_file=key, list_path=list_path, machine_id=machine_id, quiet_s=quiet
        )
        if as_json:
            print_json(made.to_dict())
        else:
            _print_notarised_folder(made)
        if every is None:
            return
        make_stdout_console().file.flush()
        time.sleep(every)


def _print_notarised_folder(notarised_folder: "NotarisedFolder") -> None:
    from replay.commands.print_tables import make_stdout_console, print_line

    screen = make_stdout_console()
    for entry in notarised_folder.added:
        span = f", {entry.begins} to {entry.ends}" if entry.begins else ", no absolute time"
        print_line(screen, f"{entry.counter}: {entry.log}{span}")
    for name in notarised_folder.waiting:
        print_line(screen, f"still written to: {name}")
    for note in notarised_folder.notes:
        print_line(screen, note, "[bold red]!![/] ")
    print_line(
        screen,
        f"{notarised_folder.path}: {notarised_folder.last} logs, "
        f"{len(notarised_folder.added)} of them new",
    )
