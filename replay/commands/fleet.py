"""`payscope fleet`: replay many recordings on an engine, and query the results as one table."""

import datetime as dt
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from replay.commands.common_options import FormatOption, FrictionLimit, OutputFile
from replay.commands.screen_limits import LIMITS

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    from analysis.fleet.results_comparison import FleetComparison
    from replay.fleet.compare_results import DayRange
    from replay.fleet.gathered_tables import FleetResults
    from replay.fleet.ray_engine import TaskEngine
    from replay.fleet.run_fleet import FleetRun

app = typer.Typer(
    help="Replay a fleet's recordings on an engine; query, report and compare the results.",
    context_settings={"help_option_names": ["-h", "--help"]},
)
Results = Annotated[
    str, typer.Argument(metavar="RESULTS", help="Results of `fleet run`: a folder, or s3://….")
]
Address = Annotated[
    str | None,
    typer.Option(metavar="HOST:PORT", help="Head node of a Ray cluster; default: this computer."),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1, help="Recordings replayed in parallel on this computer; default: one per processor."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
First = Annotated[
    str | None, typer.Option("--from", metavar="DAY", help="First day, such as 2026-10-01.")
]
Last = Annotated[str | None, typer.Option("--to", metavar="DAY", help="Last day.")]


@app.callback(invoke_without_command=True)
def require_fleet_libraries(context: typer.Context) -> None:
    """Raise an error if the libraries of the extra `fleet` are missing."""
    from estimators.errors import FleetError
    from replay.fleet.ray_engine import find_missing_fleet_library

    name = find_missing_fleet_library()
    if name is not None:
        raise FleetError(f"fleet: {name} is not installed; pip install 'payscope[fleet]'")
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command(name="run")
def run_command(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE...", help="Logs, folders, globs, or s3://bucket/prefix."),
    ],
    machines: Annotated[
        Path, typer.Option("-m", "--machines", help="The fleet file: rules from logs to machines.")
    ],
    output: Annotated[
        str, typer.Option("-o", "--output", help="Where results go: a folder, or s3://….")
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the machine files; repeatable."),
    ] = None,
    recordings: Annotated[
        bool, typer.Option("--recordings", help="Keep every recording's .rrd as well.")
    ] = False,
    address: Address = None,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Replay the recordings that have no result yet; each result is computed once.

    Exit status 1 if a recording has no result.
    """
    from replay.commands.print_tables import print_json
    from replay.commands.progress_bar import FleetProgress
    from replay.fleet.log_sources import list_logs_of_sources
    from replay.fleet.machine_setups import load_fleet
    from replay.fleet.run_fleet import replay_logs_of_fleet

    fleet = load_fleet(machines, tuple(overrides or ()))
    with FleetProgress() as shown:
        logs = list_logs_of_sources(sources)
        shown.begin_progress_bar(logs)
        did = replay_logs_of_fleet(
            logs,
            fleet,
            output,
            _make_task_engine_factory(address, workers),
            shown.count_finished_log,
            shown.note_engine_slots,
            keeps_recordings=recordings,
        )
    if as_json:
        print_json(did.to_dict())
    else:
        _print_fleet_run(did)
    if did.failed:
        raise typer.Exit(1)


@app.command(name="query")
def query_command(
    results: Results,
    sql: Annotated[str, typer.Argument(metavar="SQL", help="A SELECT over the tables.")],
    output_format: FormatOption = None,
    output: OutputFile = None,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
) -> None:
    """Query all results by SQL; the rows are always in the same order."""
    from recordings.report.atomic_output import require_writable_output
    from replay.commands.frame_output import (
        choose_output_format,
        format_frame_as_table,
        print_frame_as_table,
        print_or_write_frame,
    )
    from replay.fleet.gathered_tables import open_results_of_fleet, query_fleet_tables

    chosen = choose_output_format(output_format and output_format.value, output)
    if output is not None:
        require_writable_output(output, overwrites=force)
    rows = query_fleet_tables(open_results_of_fleet(results), sql)
    if chosen == "table" and output is None:
        print_frame_as_table(rows)
        return
    render = partial(format_frame_as_table, rows, rows.height)
    print_or_write_frame(rows, chosen, output, overwrites=force, render=render)


@app.command(name="report")
def report_command(
    results: Results,
    output: Annotated[Path, typer.Option("-o", "--output", help="The page (.html).")],
    force: Annotated[bool, typer.Option(help="Replace an existing page.")] = False,
    friction_limit: FrictionLimit = None,
    as_json: AsJson = False,
) -> None:
    """Write one page over machines and weeks: tonnes, drift, what needs a look."""
    from recordings.fleet.fleet_page import summarise_fleet
    from replay.commands.print_tables import make_stdout_console, print_json, print_line
    from replay.fleet.gathered_tables import open_results_of_fleet
    from replay.fleet.write_fleet_page import write_fleet_report

    fleet_results = open_results_of_fleet(results)
    made = write_fleet_report(
        fleet_results,
        results,
        fleet_results.last_run.fleet,
        output,
        overwrites=force,
        friction_limit_N_s_m=friction_limit,
    )
    said = made.to_dict()
    if as_json:
        print_json(said)
        return
    screen = make_stdout_console()
    print_line(screen, summarise_fleet(said["sum"], len(said["machines"])))
    for each in said["drifts"]:
        print_line(
            screen,
            f"{each['machine']}: {each['of']} {each['change']:+,.1f} {each['unit']} since "
            f"{each['since']}, flagged {each['flagged']}",
        )
    for sentence in made.page.friction:
        print_line(screen, sentence)
    print_line(screen, f"recordings to check: {len(said['to_look_at'])}")
    print_line(screen, f"page: {made.path}")


@app.command(name="compare")
def compare_command(
    a: Annotated[
        str, typer.Argument(metavar="A", help="Results of a `fleet run`: a folder, or s3://….")
    ],
    b: Annotated[
        str | None, typer.Argument(metavar="B", help="Other results of the same logs.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Setting with which to replay the logs of A for the comparison; repeatable.",
        ),
    ] = None,
    first: First = None,
    last: Last = None,
    address: Address = None,
    workers: Workers = None,
    shown: Annotated[
        int,
        typer.Option(
            "-n", min=0, help="Number of recordings to list, those that differ most first."
        ),
    ] = LIMITS.fleet_rows,
    as_json: AsJson = False,
) -> None:
    """Show whether other settings would have changed the tonnes, where, and by how much.

    Exit status 1 if they would have.
    """
    from replay.commands.print_tables import print_json
    from replay.fleet.compare_results import compare_fleets
    from replay.fleet.gathered_tables import open_results_of_fleet

    if (b is None) == (not overrides):
        raise typer.BadParameter(
            "give either other results (B) or other settings (--set), but not both"
        )
    days = _parse_day_range(first, last)
    results = open_results_of_fleet(a)
    if b is None:
        other = _replay_fleet_with_other_settings(
            results, overrides or [], days, _make_task_engine_factory(address, workers)
        )
    else:
        other = open_results_of_fleet(b)
    found = compare_fleets(results, other, days)
    if as_json:
        print_json(
            {
                "sum": found.total_change,
                "machines": found.machines.to_dicts(),
                "recordings": found.logs.head(shown).to_dicts(),
                "only_a": found.only_a,
                "only_b": found.only_b,
            }
        )
    else:
        _print_comparison(found, a, shown)
    if found.total_change["changed"]:
        raise typer.Exit(1)


@app.command(name="open")
def open_command(
    results: Results,
    key: Annotated[str, typer.Argument(help="Key of the result, or its first characters.")],
    at_s: Annotated[
        float | None, typer.Option("--at", help="Move the time cursor to this second of the run.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Write the recording here instead of showing it."),
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
) -> None:
    """Open a recording in the viewer; one that was not kept is replayed from its log."""
    import shutil

    from recordings.report.atomic_output import stage_output_file
    from replay.fleet.gathered_tables import open_results_of_fleet
    from replay.fleet.recording_task import open_recording_of_result
    from replay.recording.view_recording import view_recording

    with open_recording_of_result(open_results_of_fleet(results), key) as recording:
        if output is None:
            view_recording(recording, at_s=at_s)
            return
        with stage_output_file(output, overwrites=force) as written:
            shutil.copyfile(recording, written)
    typer.echo(output)


def _make_task_engine_factory(
    cluster_address: str | None, worker_count: int | None
) -> "Callable[[], AbstractContextManager[TaskEngine]]":
    from replay.fleet.ray_engine import start_ray_engine

    if cluster_address is not None and worker_count is not None:
        raise typer.BadParameter(
            "--workers applies to this machine only; leave it out with --address"
        )
    return partial(start_ray_engine, cluster_address, worker_count)


def _parse_day_range(first_day: str | None, last_day: str | None) -> "DayRange":
    from replay.fleet.compare_results import DayRange

    found: list[dt.date | None] = []
    for name, text in (("--from", first_day), ("--to", last_day)):
        try:
            found.append(None if text is None else dt.date.fromisoformat(text))
        except ValueError:
            raise typer.BadParameter(
                f"{name} {text}: is not a date; write it as 2026-10-01"
            ) from None
    return DayRange(*found)


def _replay_fleet_with_other_settings(
    results: "FleetResults",
    overrides: list[str],
    days: "DayRange",
    engine: "Callable[[], AbstractContextManager[TaskEngine]]",
) -> "FleetResults":
    from replay.commands.progress_bar import FleetProgress
    from replay.fleet.compare_results import RunCallbacks, replay_fleet_with_settings

    with FleetProgress() as shown:
        callbacks = RunCallbacks(
            shown.begin_progress_bar, shown.count_finished_log, shown.note_engine_slots
        )
        other, did, gone = replay_fleet_with_settings(results, overrides, days, engine, callbacks)
    if gone:
        typer.echo(f"{gone} logs are no longer at their old paths and were left out", err=True)
    for source, why in sorted(did.failed.items()):
        typer.echo(f"without a result: {source}: {why}", err=True)
    return other


def _print_fleet_run(run: "FleetRun") -> None:
    from estimators.errors import format_count
    from replay.commands.print_tables import make_stdout_console, print_line

    screen = make_stdout_console()
    total = run.replayed + run.up_to_date + len(run.refused) + len(run.failed)
    print_line(
        screen,
        f"{format_count(total, 'recording')}: {run.replayed:,} replayed, "
        f"{run.up_to_date:,} up to date, {len(run.refused):,} refused, "
        f"{len(run.failed):,} without a result",
    )
    for source, why in sorted(run.refused.items()):
        print_line(screen, f"refused: {why if source in why else f'{source}: {why}'}")
    for source, why in sorted(run.failed.items()):
        print_line(screen, f"without a result: {why if source in why else f'{source}: {why}'}")
    print_line(screen, f"results: {run.destination}")


def _print_comparison(comparison: "FleetComparison", name_a: str, max_recordings: int) -> None:
    from replay.commands.print_tables import (
        make_plain_table,
        make_stdout_console,
        print_line,
        print_table_uncut,
    )

    screen = make_stdout_console()
    whole = comparison.total_change
    print_line(
        screen,
        f"{whole['payload_kg'] / 1e3:,.3f} t in A, {whole['payload_b_kg'] / 1e3:,.3f} t in B: "
        f"{whole['change_kg'] / 1e3:+,.3f} t ({_format_relative_change_of_total(whole)}), by "
        f"{whole['changed']:,.0f} of {whole['logs']:,.0f} recordings",
    )
    if comparison.only_a or comparison.only_b:
        print_line(
            screen, f"not compared: {comparison.only_a} only in A, {comparison.only_b} only in B"
        )
    table = make_plain_table(
        "machine", "recordings", "t in A", "t in B", "change t", "loads A", "B"
    )
    for row in comparison.machines.iter_rows(named=True):
        table.add_row(row["machine"], f"{row['logs']:,}", *_make_mass_change_cells(row))
    print_table_uncut(screen, table)
    listed = comparison.logs.head(max_recordings)
    changed = listed.filter(listed["change_kg"] != 0.0)
    if changed.is_empty():
        return
    print_line(screen, "")
    print_line(screen, "Recordings that differ most")
    table = make_plain_table(
        "machine", "day", "t in A", "t in B", "change t", "loads A", "B", "opens it"
    )
    for row in changed.iter_rows(named=True):
        opens = f"payscope fleet open {name_a} {row['key'][:12]}"
        table.add_row(row["machine"], row["day"], *_make_mass_change_cells(row), opens)
    print_table_uncut(screen, table)


def _make_mass_change_cells(comparison_row: dict[str, float]) -> tuple[str, ...]:
    tonnes = (comparison_row["payload_kg"] / 1e3, comparison_row["payload_b_kg"] / 1e3)
    return (
        *(f"{t:,.3f}" for t in tonnes),
        f"{comparison_row['change_kg'] / 1e3:+,.3f}",
        f"{comparison_row['loads']:,.0f}",
        f"{comparison_row['loads_b']:,.0f}",
    )


def _format_relative_change_of_total(totals: dict[str, float]) -> str:
    if not totals["payload_kg"]:
        return "no tonnes in A"
    return f"{totals['change_kg'] / totals['payload_kg']:+.2%}"
