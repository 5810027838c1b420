"""`payscope follow`: a log while it is recorded."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from replay.follow.agreement import Agreement


def command(
    logs: Annotated[
        list[Path],
        typer.Argument(
            help="Logs that are being recorded (.bag, .bag.active, .mcap, .db3, a text table), or "
            "the folder of a recorder that rotates (rosbag2)."
        ),
    ],
    machine: Annotated[Path, typer.Option("-m", "--machine", help="The machine file.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Record while following; at the end, the causal replay (.rrd)."
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the machine file; repeatable."),
    ] = None,
    noise: Annotated[
        Path | None,
        typer.Option("--noise", metavar="REC", help="Take the noise from an earlier recording."),
    ] = None,
    idle_s: Annotated[
        float, typer.Option("--idle-s", min=0.0, help="End after this many seconds without growth.")
    ] = 10.0,
    valid_s: Annotated[
        float, typer.Option("--valid-s", min=0.0, help="Age after which a mass counts as old.")
    ] = 120.0,
    until_u: Annotated[
        float | None,
        typer.Option(
            "--until-u",
            metavar="KG",
            min=1e-3,
            help="Report the progress towards a mass of the load to ± KG (2 % of the empty mass).",
        ),
    ] = None,
    reports: Annotated[
        Path | None,
        typer.Option("--reports", metavar="MCAP", help="Write each report to a topic of this log."),
    ] = None,
    replay_share: Annotated[
        float,
        typer.Option(
            "--replay-share",
            metavar="SHARE",
            min=0.0,
            max=1.0,
            help="Replay the log so far in the background, in so much of one core; 0: do not.",
        ),
    ] = 0.1,
    live: Annotated[
        bool, typer.Option("--live", help="Show it in a browser on this machine as it grows.")
    ] = False,
    force: Annotated[bool, typer.Option(help="Replace existing outputs.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print reports as JSON lines: manoeuvres, each second.")
    ] = False,
) -> None:
    """Follow a log while it is recorded: gate, estimates and masses as the machine drives.

    Processes complete messages on disk, as on board. Ends when the recorder closes the log, when it
    has not grown for --idle-s, or on ctrl-C. With -o it is recorded as it goes. The replay of the
    log with settings.filter.causal=true then replaces that recording, and the followed results are
    compared with it bit for bit. Started again, it continues where it stopped.

    A process of low priority replays what is recorded so far after manoeuvres, as `run` does with
    this machine file, and once more at the end: load states, payloads, and what withholds them.
    """
    from contextlib import ExitStack, suppress

    from analysis.online.follower import FollowedRow
    from recordings import read_recording
    from recordings.rrd.viewer_server import viewer_server
    from replay.commands.follow_panel import FollowPanel, ReportPrinter
    from replay.commands.progress_bar import COMPILING, warn_on_slow_compile
    from replay.follow.agreement import FollowedDigests, record_followed_log
    from replay.follow.background_replay import BackgroundReplays
    from replay.follow.follow_logs import Following, follow_logs
    from replay.follow.followed_outputs import FollowedOutputs
    from replay.machines.machine_file import load_machine
    from replay.runs.run_logs import RecordTo

    settings = overrides or []
    loaded = load_machine(machine, settings)
    known = read_recording(noise).frames.get("noise") if noise else None
    digests = FollowedDigests()

    def print_message(line: str) -> None:
        typer.echo(f"payscope: {line}", err=True)

    with ExitStack() as opened:
        server = opened.enter_context(viewer_server()) if live else None
        if server is not None:
            print_message(f"open {server.page}")
        outputs = FollowedOutputs(
            logs,
            loaded,
            known,
            print_message,
            output=output,
            reports=reports,
            server=server.address if server else None,
            force=force,
        )
        opened.callback(outputs.close)
        opened.enter_context(warn_on_slow_compile(lambda: typer.echo(COMPILING, err=True)))
        panel = opened.enter_context(FollowPanel())
        replays = opened.enter_context(
            BackgroundReplays(logs, machine, settings, print_message, share=replay_share)
        )
        printer = ReportPrinter(outputs, panel, replays, as_json=as_json)

        def show_new_rows(following: Following, rows: list[FollowedRow]) -> None:
            digests.add(rows)
            printer.show_rows(following, rows)

        following = follow_logs(
            logs,
            loaded,
            show_new_rows,
            noise=known,
            idle_s=idle_s,
            valid_s=valid_s,
            until_u_kg=until_u,
        )
        with suppress(KeyboardInterrupt):  # by ctrl-C while it waits, it ends without
            printer.show_last_replay()
    for loss in following.losses:
        print_message(str(loss))
    follower = following.follower
    spins = f", inertia of {_format_count(follower.spins, 'spin')}" if follower.spins else ""
    typer.echo(
        f"{following.ended}: {follower.rows_stepped:,} rows, masses of "
        f"{_format_count(follower.manoeuvres, 'manoeuvre')}{spins}",
        err=True,
    )
    if output is not None:
        to = RecordTo(output, force=True)
        _, agreements = record_followed_log(logs, machine, to, settings, digests)
        for each in agreements:
            typer.echo(_describe_agreement(each), err=True)
        typer.echo(f"recorded: {output}", err=True)


def _format_count(count: int, what: str) -> str:
    return f"{count:,} {what}" + "s" * (count != 1)


def _describe_agreement(agreement: "Agreement") -> str:
    if agreement.differs_from_s is None:
        return f"{agreement.name}: {agreement.rows:,} rows, as in the replay bit for bit"
    if agreement.is_rounding:
        return f"{agreement.name}: {agreement.rows:,} rows, as in the replay to nine digits"
    return (
        f"{agreement.name}: {agreement.rows:,} rows, {agreement.replayed:,} in the replay; they "
        "differ "
        f"from {agreement.differs_from_s:,.0f} s onwards"
    )
