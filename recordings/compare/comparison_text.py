"""What differs between two replays, in Markdown, for the recording that shows both."""

from collections.abc import Iterable
from typing import Final

from analysis.compare.run_comparison import Comparison, EstimateChange, ValueChange
from recordings.report.number_text import number, plus_minus, table

#: Changes that are listed; more are counted.
_MOST: Final = 12


def comparison_text(found: Comparison, a: str, b: str) -> str:
    """Say what differs, settings first, then what they moved.

    Args:
        found: the comparison.
        a: what A is called.
        b: what B is called.
    """
    parts = [
        "# A and B" if not found.equal else "# A and B are equal",
        f"- A: {a}\n- B: {b}\n\n"
        "Times are those of A. What has no panel in any tab does not differ.",
    ]
    for title, changes in (
        ("Settings", found.settings),
        ("Checks passed", found.checks),
        ("Losses, notes and stamps", found.provenance),
    ):
        if changes:
            parts.append(f"## {title}\n\n{_values_table(changes)}")
    for title, moved in (
        ("Estimates that moved most", found.estimates),
        ("Manoeuvres that moved most", found.manoeuvres),
    ):
        if moved:
            parts.append(f"## {title}\n\n{_estimates(moved)}")
    if found.stages:
        rows = [(stage.name, ", ".join(c.name for c in stage.columns)) for stage in found.stages]
        parts.append(f"## Columns that differ\n\n{table(('stage', 'columns'), rows)}")
    return "\n\n".join(parts)


def _values_table(changes: Iterable[ValueChange]) -> str:
    return table(
        ("", "A", "B"), [(c.name, _format_value(c.a), _format_value(c.b)) for c in changes]
    )


def _format_value(value: object) -> str:
    return number(value if value is None or isinstance(value, bool | int | float) else str(value))


def _estimates(changes: tuple[EstimateChange, ...]) -> str:
    rows = [
        (
            each.about,
            each.quantity,
            plus_minus(each.a, each.a_std),
            plus_minus(each.b, each.b_std),
            number(each.change),
            number(each.stds),
        )
        for each in changes[:_MOST]
    ]
    return table(("", "quantity", "A", "B", "B − A", "in deviations"), rows)
