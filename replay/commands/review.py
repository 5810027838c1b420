"""`payscope review`: review the logs of a shift, with its tonnes and their reliability."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from replay.commands.common_options import (
    Calibration,
    FrictionLimit,
    RequireSigned,
    SignerKey,
    make_calibration_request,
)

if TYPE_CHECKING:
    from rich.console import Console

    from replay.review.write_review import ShiftReview


#: Name for how a cycle is given: by its number, its id, or the local time.
_WHEN: Final = "WHEN"
_VERDICT: Final = "Verdict"
#: Parameters that apply with --week.
_WEEK_OPTIONS: Final = ("logs", "output", "week", "friction_limit", "as_json")


def _make_payload_label_option(label_name: str) -> Any:
    return typer.Option(
        f"--{label_name}",
        help=f"The {label_name} of the named cycles, or of the whole shift.",
        rich_help_panel=_VERDICT,
    )


def _make_cycles_option(option_name: str, effect_text: str) -> Any:
    return typer.Option(
        f"--{option_name}",
        metavar=_WHEN,
        help=f"{effect_text}: a number (14), an id, or a local time (14:32:10).",
        rich_help_panel=_VERDICT,
    )


def command(
    context: typer.Context,
    logs: Annotated[
        list[Path],
        typer.Argument(
            help="Logs of one shift, or a folder of them, in any order; or the folder of a review, "
            "which is counted again with its verdicts."
        ),
    ],
    machine: Annotated[
        Path | None, typer.Option("-m", "--machine", help="The machine file, for logs.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder of the review; with --week, its page (.html)."),
    ] = None,
    calibration: Calibration = None,
    key: SignerKey = None,
    require_signed: RequireSigned = False,
    target: Annotated[
        float | None,
        typer.Option(metavar="KG", min=1e-3, help="Judge loads against KG by the 10/10/20 rule."),
    ] = None,
    reject: Annotated[
        list[str] | None, _make_cycles_option("reject", "Do not count this cycle")
    ] = None,
    accept: Annotated[
        list[str] | None, _make_cycles_option("accept", "Count this cycle again")
    ] = None,
    cycle: Annotated[
        list[str] | None, _make_cycles_option("cycle", "Note or label this cycle")
    ] = None,
    note: Annotated[
        str, typer.Option(help="A note on the named cycles.", rich_help_panel=_VERDICT)
    ] = "",
    product: Annotated[str, _make_payload_label_option("product")] = "",
    operator: Annotated[str, _make_payload_label_option("operator")] = "",
    truck: Annotated[str, _make_payload_label_option("truck")] = "",
    customer: Annotated[str, _make_payload_label_option("customer")] = "",
    stockpile: Annotated[str, _make_payload_label_option("stockpile")] = "",
    label: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=TOPIC:FIELD",
            help="Take a label from the logs: operator=/shift/operator:data; repeatable.",
            rich_help_panel=_VERDICT,
        ),
    ] = None,
    start: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="TIME",
            help="Apply the labels to loads dumped from this local time on (14:00).",
            rich_help_panel=_VERDICT,
        ),
    ] = "",
    end: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="TIME",
            help="Apply the labels to loads dumped before this local time.",
            rich_help_panel=_VERDICT,
        ),
    ] = "",
    author: Annotated[
        str, typer.Option(help="Name of the reviewer.", rich_help_panel=_VERDICT)
    ] = "",
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the machine file; repeatable."),
    ] = None,
    full: Annotated[
        bool,
        typer.Option("--full", help="Keep every sample and all intermediate results in shift.rrd."),
    ] = False,
    week: Annotated[
        bool, typer.Option("--week", help="Sum several reviews by day, machine and product.")
    ] = False,
    friction_limit: FrictionLimit = None,
    decimal_comma: Annotated[
        bool,
        typer.Option(
            "--decimal-comma", help="Write 1,5 for 1.5 in ledger_table.csv, and semicolons."
        ),
    ] = False,
    timing: Annotated[bool, typer.Option(help="Print the duration of each stage.")] = False,
    force: Annotated[
        bool, typer.Option(help="Replace the review of other logs in the folder.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the sums as JSON.")] = False,
) -> None:
    """Review a shift: ledger, recording and one page with tonnes, cycles and faults.

    Verdicts are added to verdicts.toml in the folder.

    Exit status 1 if no cycle counts; stderr and the page say why.
    """
    from estimators.errors import join_to_one_line
    from recordings.review.shift_facts import summarise_shift_in_line
    from replay.commands.print_tables import make_stdout_console, print_json
    from replay.commands.progress_bar import StageProgress
    from replay.machines.machine_file import load_machine
    from replay.pipeline import STAGES
    from replay.review.give_verdicts import (
        RequestedVerdicts,
        is_review_folder,
        parse_label_channel,
        read_label_spans,
        recount_review_with_verdicts,
    )
    from replay.review.review_shift import ReviewOptions, review_shift

    if week:
        _refuse_shift_options_with_week(context)
        print_week_of_reviews(logs, output, friction_limit, as_json=as_json)
        return
    if friction_limit is not None:
        raise typer.BadParameter("--friction-limit compares several days; add --week")
    labels = {
        "product": product,
        "operator": operator,
        "truck": truck,
        "customer": customer,
        "stockpile": stockpile,
    }
    given = RequestedVerdicts(
        reject or (), accept or (), cycle or (), note, labels, author, start, end
    )
    given.refuse_incomplete_verdicts()
    channels = [parse_label_channel(each) for each in label or ()]
    asked = make_calibration_request(calibration, key, is_signature_required=require_signed)
    if machine is None and output is None and len(logs) == 1 and is_review_folder(logs[0]):
        needs_logs = (asked is not None, target is not None, overrides, full, decimal_comma, label)
        if any(needs_logs):
            raise typer.BadParameter(
                "--calibration, --target, --set, --full, --decimal-comma and --label need the "
                "logs, to count the loads again; give them, with -m and -o"
            )
        made = recount_review_with_verdicts(logs[0], given)
    elif machine is None or output is None:
        raise typer.BadParameter(
            f"{logs[0]}: logs need a machine file (-m) and an output folder (-o); only the folder "
            "of a review needs neither"
        )
    else:
        if channels:
            settings = load_machine(machine, overrides or [])
            given = replace(given, spans=read_label_spans(logs, channels, settings))
        options = ReviewOptions(overrides or [], asked, target, full, decimal_comma, force)
        with StageProgress(len(STAGES) + 3, prints_stage_times=timing) as stages:
            made = review_shift(logs, machine, output, options, stages.begin_stage)
        if given:
            made = recount_review_with_verdicts(output, given)
    if as_json:
        print_json(made.to_dict())
    else:
        print_shift_review(make_stdout_console(), made)
    if made.missing_tonnes_reason:
        typer.echo(
            join_to_one_line(
                summarise_shift_in_line(made.shift, made.missing_tonnes_reason, made.state)
            ),
            err=True,
        )
        raise typer.Exit(1)


def _refuse_shift_options_with_week(context: typer.Context) -> None:
    """Raise an error for options that --week would ignore."""
    for name in context.params:
        source = context.get_parameter_source(name)
        if name in _WEEK_OPTIONS or source is None or source.name != "COMMANDLINE":
            continue
        raise typer.BadParameter(
            "--week accepts only folders of reviews, -o, --friction-limit and --json"
        )


def print_week_of_reviews(
    review_folders: list[Path],
    page_path: Path | None,
    friction_limit: float | None,
    *,
    as_json: bool,
) -> None:
    """Print the payloads of reviews, summed by day, machine and product, without a replay.

    Args:
        review_folders: folders of the reviews.
        page_path: HTML page to write, if any.
        friction_limit: viscous friction in N·s/m for which to predict the day on which it is
            reached; None for no prediction.
        as_json: whether to print JSON.
    """
    from recordings.report.shift_text import K
    from recordings.review.week_page import (
        describe_friction_trends,
        describe_week_tonnes,
        fit_friction_trends,
        read_shifts_of_reviews,
        write_week_page,
    )
    from recordings.review.week_totals import (
        GROUPS,
        read_counted_loads_of_reviews,
        sum_week,
        sum_week_parts_by_group,
    )
    from replay.commands.print_tables import make_stdout_console, print_json, print_line

    parts, shifts = (
        read_counted_loads_of_reviews(review_folders),
        read_shifts_of_reviews(review_folders),
    )
    sums = {by: sum_week_parts_by_group(parts, by) for by in GROUPS}
    whole = sum_week(parts)
    trends = {} if friction_limit is None else fit_friction_trends(shifts, friction_limit)
    if page_path is not None:
        write_week_page(parts, shifts, friction_limit, page_path)
    if as_json:
        print_json(
            {by: [each._asdict() for each in totals] for by, totals in sums.items()}
            | {"all": whole._asdict()}
            | {"friction": {name: trend._asdict() for name, trend in trends.items()}}
        )
        return
    screen = make_stdout_console()
    for by, totals in sums.items():
        for each in totals:
            t, u_t = each.payload_kg / 1e3, K * each.payload_u_kg / 1e3
            name = f"{by} {each.name or 'not named'}"
            rejected = f", {each.rejected} rejected" if each.rejected else ""
            print_line(screen, f"{name}: {each.loads} loads, {t:,.3f} ± {u_t:.3f} t{rejected}")
    print_line(screen, f"all: {describe_week_tonnes(parts)}")
    for sentence in describe_friction_trends(trends):
        print_line(screen, sentence)
    for shift in shifts:
        for sentence in shift.missing:
            print_line(screen, f"{shift.begins}: {sentence}")
    print_line(screen, "counted loads; loads in gaps and missing logs are on each review's page")
    if page_path is not None:
        print_line(screen, f"page: {page_path}")


def print_shift_review(console: "Console", review: "ShiftReview") -> None:
    """Print a review's sums, its problems and the path of its page.

    If there are no tonnes, the caller prints the reason on stderr.
    """
    from recordings.report.number_text import REMARKED
    from recordings.review.review_page import NOT_CALIBRATED, PAGE
    from recordings.review.shift_facts import (
        describe_long_gaps,
        describe_missing_loads,
        describe_truncated_logs,
        list_losses_besides_truncated_ends,
        list_shift_names_and_values,
        make_warning_of_mixed_machines,
        summarise_shift_in_line,
    )
    from replay.commands.print_tables import print_line

    state = review.state
    if not review.missing_tonnes_reason:
        print_line(console, summarise_shift_in_line(review.shift, "", state))
    if state.mixed_machines:
        print_line(console, f"warning: {make_warning_of_mixed_machines(state)}")
    holes = describe_long_gaps(review.shift, state)
    for sentence in (
        *filter(None, [holes]),
        *describe_missing_loads(review.shift),
        *describe_truncated_logs(state),
    ):
        print_line(console, sentence)
    for name, value in list_shift_names_and_values(
        review.shift, review.ledger, state, review.target
    ):
        print_line(console, f"{name}: {value}")
    if review.calibration.contradiction_text:
        print_line(console, f"{NOT_CALIBRATED}: {review.calibration.contradiction_text}")
    elif review.calibration.description:
        print_line(console, review.calibration.description)
    if failed := [check.check for check in state.mass_withholding_checks]:
        print_line(console, f"checks that failed: {', '.join(failed)}")
    if remarks := [
        f"{each.check} ({REMARKED[each.consequence]})"
        for each in state.failed_checks_that_withhold_nothing
    ]:
        print_line(console, f"checks with a remark: {', '.join(remarks)}")
    for loss in list_losses_besides_truncated_ends(state):
        print_line(console, f"lost: {loss}")
    if not review.replayed:
        print_line(console, "not replayed: logs, machine and settings are those of the last review")
    print_line(console, f"page: {review.folder / PAGE}")
