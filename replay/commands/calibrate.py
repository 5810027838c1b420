"""`payscope calibrate`: calibrate a machine by its own logs, and write evidence."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from replay.calibration.calibrate_campaign import CalibrationOutcome


def command(
    source: Annotated[
        Path, typer.Argument(help="Campaign file; with --check, a log with REF_KG on board.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of evidence to write.")],
    key: Annotated[
        Path | None,
        typer.Option(
            help="Private Ed25519 key (PEM) that signs; else PAYSCOPE_SIGNING_KEY may hold one."
        ),
    ] = None,
    previous: Annotated[
        Path | None, typer.Option(help="Previous evidence of this machine.")
    ] = None,
    recordings: Annotated[
        bool, typer.Option("--recordings", help="Keep the recording of each log's replay.")
    ] = False,
    check: Annotated[
        float | None,
        typer.Option(
            "--check",
            metavar="REF_KG",
            min=0,
            help="Check --previous by a log with a mass of REF_KG.",
        ),
    ] = None,
    check_u: Annotated[
        float, typer.Option(metavar="KG", min=0, help="Standard uncertainty of REF_KG.")
    ] = 0.0,
    certificate: Annotated[str, typer.Option(help="Number of the certificate of REF_KG.")] = "",
    day: Annotated[
        str | None, typer.Option(metavar="DATE", help="Day of the log, if it has no date.")
    ] = None,
    timestamp_request: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the query that a time-stamp authority (RFC 3161) answers."
        ),
    ] = None,
    dcc: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write a digital calibration certificate (DCC 3.2.1) as well."
        ),
    ] = None,
    dcc_key: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Private ECDSA or RSA key (PEM) that signs --dcc."),
    ] = None,
    dcc_certificate: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Certificate (PEM) for --dcc-key, if any.")
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace existing evidence.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Replay a campaign's runs, fit the line to reference masses, and write evidence of it.

    Exit status 1 if there is no line, a limit is exceeded, or a check finds drift.
    """
    from replay.calibration.calibrate_campaign import calibrate_from_campaign
    from replay.calibration.check_mass import KnownMassOnBoard, write_evidence_of_mass_check
    from replay.calibration.dcc_output import DccOutput
    from replay.commands.print_tables import make_stdout_console, print_json
    from replay.commands.progress_bar import StageProgress

    if check is None and (check_u or certificate or day):
        raise typer.BadParameter("--check-u, --certificate and --day need --check")
    if check is not None and previous is None:
        raise typer.BadParameter("--check needs --previous, the evidence that it checks")
    if check is not None and timestamp_request is not None:
        raise typer.BadParameter(
            "--timestamp-request is for a campaign, not for --check; leave it out"
        )
    if dcc is None and (dcc_key or dcc_certificate):
        raise typer.BadParameter("--dcc-key and --dcc-certificate need --dcc")
    if check is not None and dcc is not None:
        raise typer.BadParameter("--dcc is for a campaign, not for --check; leave it out")
    with StageProgress(1) as stages:
        if check is not None and previous is not None:
            known = KnownMassOnBoard(check, check_u, certificate, day)
            made = write_evidence_of_mass_check(
                source, known, output, previous=previous, key_file=key, overwrites=force
            )
        else:
            made = calibrate_from_campaign(
                source,
                output,
                key_file=key,
                previous=previous,
                keeps_recordings=recordings,
                overwrites=force,
                timestamp_request_file=timestamp_request,
                dcc=None if dcc is None else DccOutput(dcc, dcc_key, dcc_certificate),
                on_log=stages.begin_stage,
            )
    if as_json:
        print_json(made.to_dict())
    else:
        _print_calibration_evidence(make_stdout_console(), made)
    if not made.is_within_limits:
        raise typer.Exit(1)


def _print_calibration_evidence(
    screen: "Console", calibration_outcome: "CalibrationOutcome"
) -> None:
    from analysis.calibration.campaign.campaign_readings import CANNOT_WEIGH
    from recordings.calibration.calibration_report import (
        format_kilograms_or_dash,
        list_report_names_and_values,
    )
    from recordings.calibration.calibration_text import write_report_paragraphs
    from recordings.calibration.certificate_text import make_traceability_warnings
    from replay.commands.print_tables import make_plain_table, print_line, print_table_uncut

    table = make_plain_table(
        *("run", "load", "reference kg", "readings", "estimate kg", "calibrated kg", "error kg"),
        "left out kg",
    )
    for row in calibration_outcome.points.iter_rows(named=True):
        numbers = ("mean_kg", "calibrated_kg", "error_kg", "error_left_out_kg")
        table.add_row(
            row["run_id"],
            row["load_id"],
            format_kilograms_or_dash(row["reference_kg"]),
            str(row["readings"]),
            *(format_kilograms_or_dash(row[name]) for name in numbers),
        )
    print_table_uncut(screen, table)
    refusals = calibration_outcome.refusals
    alike = calibration_outcome.rejected_readings.group_by(
        "run_id", "log", "reason", maintain_order=True
    )
    for (run_id, log, reason), rows in alike:
        # a log that can weigh may have a load that cannot
        whole = reason.startswith(CANNOT_WEIGH) and log in refusals
        why = f"{CANNOT_WEIGH}: {refusals[log]}" if whole else reason
        one = rows.height == 1
        which = f"reading {rows['reading'][0]}" if one else f"{rows.height} readings"
        print_line(screen, f"left out: {run_id}, {which}: {why}")
    screen.print()
    for name, value in list_report_names_and_values(calibration_outcome.document):
        if name != "made":
            print_line(screen, f"{name}: {value}")
    screen.print()
    for sentence in make_traceability_warnings(calibration_outcome.document):
        print_line(screen, sentence, "[bold red]!![/] ")
    for sentence in write_report_paragraphs(
        calibration_outcome.document, calibration_outcome.readings, calibration_outcome.points
    ):
        print_line(screen, sentence)
    for remark in calibration_outcome.remarks:
        print_line(screen, f"note: {remark}")
    signer = calibration_outcome.document.signer
    if signer is None:
        print_line(
            screen,
            "UNSIGNED: nobody vouches for this evidence; sign it with --key KEY.pem",
            "[bold red]!![/] ",
        )
    else:
        key = f"key {signer.key_id[:12]}…"
        unnamed = (
            f"signed with {key}, without a name; state it as campaign.signer in the campaign file"
        )
        print_line(screen, f"signed as {signer.name}, {key}" if signer.name else unnamed)
    if calibration_outcome.document.chain.previous is None:
        print_line(
            screen, "first evidence of this machine; --previous chains it to earlier evidence"
        )
    print_line(screen, f"evidence: {calibration_outcome.folder}")
