"""`payscope follow`: follow a log while it is being recorded."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

if TYPE_CHECKING:
    from analysis.model.machine import Machine
    from replay.follow.agreement import FollowedDigests
    from replay.follow.follow_logs import FollowedLogState

_KEEPS_FOLLOWED_DATA: Final = "keeps what was recorded while following, without the final replay"


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
            "-o",
            "--output",
            help="Recording (.rrd) to write while following; the causal replay replaces it at the "
            "end.",
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
        float, typer.Option("--valid-s", min=0.0, help="Age in s above which a mass counts as old.")
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
            help="Replay the log so far in the background, using this fraction of one core; 0 "
            "turns it off.",
        ),
    ] = 0.1,
    live: Annotated[
        bool, typer.Option("--live", help="Show the recording in a browser as it grows.")
    ] = False,
    force: Annotated[bool, typer.Option(help="Replace existing outputs.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print a JSON line for each manoeuvre and second.")
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
    from contextlib import ExitStack

    from analysis.online.follower import FollowedRow
    from recordings import read_recording
    from recordings.rrd.viewer_server import serve_viewer_to_browsers
    from replay.commands.follow_panel import FollowPanel, ReportPrinter
    from replay.commands.progress_bar import COMPILING, warn_of_slow_compilation
    from replay.follow.agreement import FollowedDigests
    from replay.follow.background_replay import BackgroundReplays
    from replay.follow.follow_logs import (
        FollowedLogState,
        MachineFileChange,
        follow_logs,
        should_skip_remaining_work,
    )
    from replay.follow.followed_outputs import FollowedOutputs
    from replay.follow.interrupts import InterruptCounter
    from replay.machines.machine_file import load_machine

    change = MachineFileChange(machine)
    loaded = load_machine(machine, overrides or [])
    known = read_recording(noise).frames.get("noise") if noise else None
    digests = FollowedDigests()

    def print_message(line: str) -> None:
        typer.echo(f"payscope: {line}", err=True)

    with ExitStack() as opened:
        interrupts = opened.enter_context(InterruptCounter())
        server = opened.enter_context(serve_viewer_to_browsers()) if live else None
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
            overwrites=force,
        )
        opened.callback(outputs.finish_files)
        opened.enter_context(warn_of_slow_compilation(lambda: typer.echo(COMPILING, err=True)))
        panel = opened.enter_context(FollowPanel())
        replays = opened.enter_context(
            BackgroundReplays(logs, loaded, print_message, share=replay_share)
        )
        printer = ReportPrinter(outputs, panel, replays, as_json=as_json)

        def show_new_rows(following: FollowedLogState, rows: list[FollowedRow]) -> None:
            if output is not None:
                digests.add_followed_rows(rows)
            printer.print_row_reports(following, rows)
            if change.has_file_changed():
                print_message(
                    f"{machine}: has changed; `follow` keeps the machine file that it began with"
                )

        following = follow_logs(
            logs,
            loaded,
            show_new_rows,
            noise=known,
            idle_s=idle_s,
            valid_s=valid_s,
            until_u_kg=until_u,
            interrupts=interrupts,
        )
        if not following.loss_reason:
            printer.wait_for_last_replay_and_print_it(
                following, lambda: should_skip_remaining_work(following, interrupts)
            )
        replays.kill_replay_process()
        for loss in following.losses:
            print_message(str(loss))
        typer.echo(_explain_why_following_ended(following), err=True)
    if output is not None:
        _record_and_compare_causal_replay(logs, loaded, output, following, digests)


def _explain_why_following_ended(following: "FollowedLogState") -> str:
    from estimators.errors import format_count

    follower = following.follower
    spins = f", inertia of {format_count(follower.spins, 'spin')}" if follower.spins else ""
    return (
        f"{following.end_reason}: {format_count(follower.rows_stepped, 'row')}, masses of "
        f"{format_count(follower.manoeuvres, 'manoeuvre')}{spins}"
    )


def _record_and_compare_causal_replay(
    logs: list[Path],
    machine: "Machine",
    output: Path,
    following: "FollowedLogState",
    followed_digests: "FollowedDigests",
) -> None:
    """Record the causal replay of the followed log; on ctrl-C, the followed recording is kept."""
    from estimators.errors import LogError, PayscopeError
    from recordings.follow.growing_file import is_unfinished_recording
    from replay.follow.agreement import iter_agreement_lines, record_and_compare_followed_log

    is_growing = following.is_interrupted
    if following.loss_reason:
        how = _KEEPS_FOLLOWED_DATA if output.exists() else "is not written"
        why = (
            f"{following.loss_reason}; " if following.is_interrupted else ""
        )  # else it was reported above
        raise LogError(f"{why}{output} {how}")
    try:
        agreements = record_and_compare_followed_log(
            logs, machine, output, followed_digests, is_growing=is_growing
        )
    except KeyboardInterrupt:
        how = "as it was followed" if is_unfinished_recording(output) else "not compared"
        typer.echo(f"recorded: {output}, {how} (interrupted)", err=True)
        return
    except PayscopeError as error:
        if not (output.is_file() and is_unfinished_recording(output)):
            raise
        raise LogError(f"{error}; {output} {_KEEPS_FOLLOWED_DATA}") from error
    for line in iter_agreement_lines(agreements, machine.settings, is_growing=is_growing):
        typer.echo(line, err=True)
    typer.echo(f"recorded: {output}", err=True)
