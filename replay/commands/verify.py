"""`payscope verify`: evidence of a calibration, checked by whoever trusts nobody."""

import datetime as dt
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from replay.calibration.verify_bundle import Verified


def command(
    folder: Annotated[Path, typer.Argument(help="Folder of evidence.")],
    logs: Annotated[
        Path | None, typer.Option(help="Folder with the logs: replay them all and compare.")
    ] = None,
    key: Annotated[
        Path | None, typer.Option(help="Public Ed25519 key (PEM) of the signer that you trust.")
    ] = None,
    previous: Annotated[
        Path | None, typer.Option(help="Evidence before it, which you know to be genuine.")
    ] = None,
    require_signed: Annotated[
        bool,
        typer.Option(
            "--require-signed", help="Ask for a signature by --key, or by a key of the keyring."
        ),
    ] = False,
    on: Annotated[
        dt.datetime | None,
        typer.Option(formats=["%Y-%m-%d"], metavar="DATE", help="Judge its expiry on that day."),
    ] = None,
    tsa: Annotated[
        Path | None,
        typer.Option(help="Certificates (PEM) of time-stamp authorities that you trust."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Check evidence: files, signature, chain, fit, budget, report and, with logs, every replay.

    Exit status 0 where all holds; 3 tampered, 5 incomplete, 4 irreproducible, 6 not within limits,
    7 expired, 8 made by another version: the first of these that is found. Nothing in the folder is
    run.
    """
    from replay.calibration.verify_bundle import verify
    from replay.commands.print_tables import print_json

    found = verify(
        folder,
        logs=logs,
        key_file=key,
        previous=previous,
        signed=require_signed,
        on=None if on is None else on.date(),
        tsa=tsa,
    )
    if as_json:
        print_json(found.to_dict())
    else:
        _print(found)
    if found.outcome is not None:
        raise typer.Exit(int(found.outcome))


def _print(found: "Verified") -> None:
    from replay.commands.print_tables import console, print_line

    screen = console()
    for finding in found.findings:
        print_line(screen, str(finding), "[bold red]!![/] ")
    for done in found.done:
        print_line(screen, f"checked: {done}")
    for note in found.notes:
        print_line(screen, f"note: {note}")
    print_line(screen, "no check can find:")
    for sentence in found.unseen:
        print_line(screen, f"- {sentence}")
    print_line(screen, found.verdict)
