"""Print checks, as `run` and `explain` do, with number, limit, meaning and remedy."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from replay.commands.print_tables import make_plain_table, print_line, print_table_uncut

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from analysis.model.verdict import Check


def make_table_of_checks(checks: Sequence["Check"]) -> "Table":
    """Make a table with a row per check: number, limit, consequence and meaning."""
    from recordings.report.number_text import format_check_outcome

    table = make_plain_table("check", "value", "limit")
    table.add_column("")
    table.add_column("meaning", overflow="fold")
    for check in checks:
        value = "–" if check.value is None else f"{check.value:.3g}"
        passed = "near" if check.is_near_limit else "ok"
        state = format_check_outcome(check, passed=passed, failed="[red]failed[/]", absent="n/a")
        table.add_row(check.check, value, check.limit_text, state, check.meaning)
    return table


def print_remedies_with_checks(console: "Console", failed_checks: Sequence["Check"]) -> None:
    """Print each remedy once, with the names of its failed checks that have a value."""
    names: dict[str, list[str]] = {}
    for check in failed_checks:
        if check.remedy and check.value is not None:
            names.setdefault(check.remedy, []).append(check.check)
    for remedy, checks in names.items():
        print_line(console, f"{', '.join(checks)}: {remedy}")


def print_failed_checks(console: "Console", failed_checks: Sequence["Check"]) -> None:
    """Print failed checks as a table, then their remedies."""
    print_table_uncut(console, make_table_of_checks(failed_checks))
    print_remedies_with_checks(console, failed_checks)
