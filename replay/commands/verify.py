"""`payscope verify`: check evidence of a calibration without trusting its maker."""

import datetime as dt
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from replay.calibration.verify_bundle import Verification
    from replay.calibration.verify_chain import VerifiedChain


def command(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FOLDER",
            help="Folder of evidence, several for a chain, or a notary list.",
            show_default=False,
        ),
    ] = None,
    logs: Annotated[
        Path | None, typer.Option(help="Folder with the logs: replay them all and compare.")
    ] = None,
    key: Annotated[
        Path | None, typer.Option(help="Public Ed25519 key (PEM) of the signer that you trust.")
    ] = None,
    previous: Annotated[
        Path | None, typer.Option(help="Previous evidence, which you know to be genuine.")
    ] = None,
    require_signed: Annotated[
        bool,
        typer.Option(
            "--require-signed", help="Require a signature by --key, or by a key of the keyring."
        ),
    ] = False,
    verification_day: Annotated[
        dt.datetime | None,
        typer.Option(
            "--on",
            formats=["%Y-%m-%d"],
            metavar="DATE",
            help="Day on which the evidence must be valid; today by default.",
        ),
    ] = None,
    timestamp_authority: Annotated[
        Path | None,
        typer.Option("--tsa", help="Certificates (PEM) of time-stamp authorities that you trust."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
    page: Annotated[
        bool, typer.Option("--page", help="Write the page that checks evidence in a browser.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File to write the page to.", show_default=False),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing page.")] = False,
) -> None:
    """Check evidence: files, signature, chain, fit, budget, report and, with logs, every replay.

    --page writes a page that checks evidence in a browser, by a program of its own: the same for
    all evidence, with the SHA-256 that `payscope --version` prints.

    Several folders are checked each by itself, and as the chain of their machine: gaps, forks and
    links that do not fit are found.

    Exit status 0 if verified; 3 tampered, 5 incomplete, 4 irreproducible, 6 not within limits,
    7 expired, 8 made by another version: the first of these that is found. Nothing in the folder is
    executed.
    """
    if page:
        _write_verifier_page(folders or [], output, overwrites=force)
        return
    if output is not None or not folders:
        what = (
            "-o applies to --page only"
            if folders
            else "give the folder of the evidence, or give --page"
        )
        raise typer.BadParameter(what)
    from replay.calibration.verify_bundle import verify_bundle
    from replay.calibration.verify_chain import VerifiedChain, verify_bundles_and_chains
    from replay.commands.print_tables import print_json

    first, *more = folders
    if not more and first.is_file():
        _verify_notary_list(first, key, is_signature_required=require_signed, as_json=as_json)
        return
    if more and previous is not None:
        raise typer.BadParameter(
            "--previous needs a single folder; add the previous evidence to the list of folders "
            "instead"
        )
    check = (
        partial(verify_bundles_and_chains, folders)
        if more
        else partial(verify_bundle, first, previous=previous)
    )
    found = check(
        log_folder=logs,
        key_file=key,
        is_signature_required=require_signed,
        verification_day=None if verification_day is None else verification_day.date(),
        authority_certificates=timestamp_authority,
    )
    if as_json:
        print_json(found.to_dict())
    elif isinstance(found, VerifiedChain):
        _print_verified_chain(found)
    else:
        _print_verification_findings(found)
    if found.outcome is not None:
        raise typer.Exit(int(found.outcome))


def _write_verifier_page(
    given_folders: list[Path], page_path: Path | None, *, overwrites: bool
) -> None:
    """Write the page that checks evidence in a browser."""
    if given_folders:
        raise typer.BadParameter(
            "--page writes the same page for all evidence; leave out the folder"
        )
    from recordings.calibration.page.verifier_page import (
        NAME,
        build_verifier_page,
        compute_verifier_page_sha256,
    )
    from recordings.report.atomic_output import stage_output_file

    target = page_path or Path(NAME)
    with stage_output_file(target, overwrites=overwrites) as written:
        written.write_bytes(build_verifier_page())
    typer.echo(f"{target}: SHA-256 {compute_verifier_page_sha256()}")


def _verify_notary_list(
    list_path: Path, key_file: Path | None, *, is_signature_required: bool, as_json: bool
) -> None:
    """Verify a notary list and print the result."""
    from replay.commands.print_tables import make_stdout_console, print_json, print_line
    from replay.notary.list_file import UNSEEN, verify_notary_list

    found = verify_notary_list(
        list_path, key_file=key_file, is_signature_required=is_signature_required
    )
    if as_json:
        print_json(found.to_dict())
    else:
        screen = make_stdout_console()
        for finding in found.findings:
            print_line(screen, str(finding), "[bold red]!![/] ")
        for note in found.notes:
            print_line(screen, f"note: {note}")
        print_line(screen, "no check can find:")
        for sentence in UNSEEN:
            print_line(screen, f"- {sentence}")
        print_line(screen, found.verdict)
    if found.outcome is not None:
        raise typer.Exit(int(found.outcome))


def _print_verified_chain(verified_chain: "VerifiedChain") -> None:
    from replay.commands.print_tables import make_stdout_console, print_line

    screen = make_stdout_console()
    for made in verified_chain.bundles:
        _print_verification_findings(made)
        screen.print()
    for finding in verified_chain.findings:
        print_line(screen, str(finding), "[bold red]!![/] ")
    for note in verified_chain.notes:
        print_line(screen, note)
    print_line(screen, verified_chain.chain_verdict)


def _print_verification_findings(verification: "Verification") -> None:
    from replay.commands.print_tables import make_stdout_console, print_line

    screen = make_stdout_console()
    for finding in verification.findings:
        print_line(screen, str(finding), "[bold red]!![/] ")
    for done in verification.checks_made:
        print_line(screen, f"checked: {done}")
    for note in verification.notes:
        print_line(screen, f"note: {note}")
    print_line(screen, "no check can find:")
    for sentence in verification.unverifiable_statements:
        print_line(screen, f"- {sentence}")
    print_line(screen, verification.verdict)
