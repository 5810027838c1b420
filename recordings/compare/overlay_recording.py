"""Record two replays: A and B overlaid, B minus A below, and the differences in words.

The viewer shows one recording at a time, so both are drawn into a third one, which keeps no frames.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import polars as pl

from analysis.compare.run_alignment import shift_run_b_to_time_of_a, subtract_runs_in_common_rows
from analysis.compare.run_comparison import Comparison, EstimateChange, ValueChange
from analysis.model.run_record import Run
from recordings.report import colours
from recordings.report.number_text import format_markdown_table, format_number, format_plus_minus
from recordings.rrd.blueprint import Page, Panel, find_unix_span_of_grid_ns, lay_out_pages_as_tabs
from recordings.rrd.display_frames import (
    ROOT,
    DisplayColumn,
    choose_axis_range_without_outliers,
    list_displayed_columns,
    make_display_frames,
)
from recordings.rrd.recording_table import TABS
from recordings.rrd.recording_views import View, ViewKind
from recordings.rrd.writer import Scene, write_recording_with_scene

#: Name of the text beside the first tab.
COMPARED: Final = "compared"
_A, _B, _LESS = "A", "B", "B_less_A"
_CONTEXT: Final = ("Speed",)
#: Number of differing views up to which all are on the first page.
_FEW: Final = 3
#: Most changes that are listed; further ones are counted.
_MOST: Final = 12


@dataclass(frozen=True)
class _OverlaidRun:
    """One of the overlaid runs, with its name in the recording, and the drawn columns."""

    name: str
    run: Run
    drawn_frames: Mapping[str, pl.DataFrame]

    def list_columns_drawn_in_view(self, view: View) -> tuple[DisplayColumn, ...]:
        return list_displayed_columns(view, self.run, self.drawn_frames)

    def make_frames_by_entity(self) -> dict[str, pl.DataFrame]:
        return {
            make_entity_path_of_side(self.name, frame): rows
            for frame, rows in self.drawn_frames.items()
        }


def write_overlay_recording(
    run_a: Run,
    run_b: Run,
    path: str | Path,
    comparison_markdown: str,
    *,
    is_same_log: bool,
    overwrites: bool = False,
) -> Path:
    """Write a recording of two overlaid runs, and of B minus A.

    Views without differences are omitted, except for the speed.

    Args:
        run_a: reference run, of which only the drawn columns are needed.
        run_b: other run.
        path: the `.rrd` file to write.
        comparison_markdown: differences, in Markdown.
        is_same_log: whether both replay the same log; otherwise manoeuvres are matched in order.
        overwrites: whether to replace an existing file.

    Raises:
        OutputError: as from `write_recording`.
    """
    moved = shift_run_b_to_time_of_a(run_a, run_b, is_same_log=is_same_log)
    about = run_a.provenance.model_copy(
        update={"notes": ("two replays overlaid; see the tab Compared",), "losses": ()}
    )

    def make_overlay_scene(_: Run) -> Scene:
        sides = [
            _OverlaidRun(name, run, make_display_frames(run))
            for name, run in (
                (_A, run_a),
                (_B, moved),
                (_LESS, subtract_runs_in_common_rows(run_a, moved)),
            )
        ]
        return Scene(
            name="A and B",
            frames={
                name: rows for side in sides for name, rows in side.make_frames_by_entity().items()
            },
            layout=lay_out_pages_as_tabs(
                _make_overlay_pages(*sides), find_unix_span_of_grid_ns(run_a)
            ),
            texts={COMPARED: comparison_markdown},
        )

    return write_recording_with_scene(
        Run({}, about), make_overlay_scene, path, overwrites=overwrites
    )


def _make_overlay_pages(
    run_a: _OverlaidRun, run_b: _OverlaidRun, difference: _OverlaidRun
) -> list[Page]:
    first, *rest = [tab for tab in TABS if tab.views]
    panels: list[Panel | None] = []
    elsewhere = {view for tab in rest for view in tab.views}
    moved = [view for view in first.views if does_view_differ_between_runs(view, run_a, run_b)]
    for view in first.views:
        if view in moved:
            # beside a text there is room for few views; those of intermediates are in other tabs
            led = view.kind is ViewKind.LINES and view.name not in _CONTEXT and view in elsewhere
            if led and len(moved) > _FEW:
                continue
            over = make_overlaid_panel(view, run_a, run_b)
            panels.append(over)
            if view.kind is ViewKind.BANDS:  # differences of intermediates are in the other tabs
                panels.append(make_difference_panel(view, difference, over))
        elif view.name in _CONTEXT:
            panels.append(make_panel_of_unchanged_view(view, run_a))
    pages = [Page("Compared", tuple(filter(None, panels)), (COMPARED,))]
    for tab in rest:
        differ = [
            view
            for view in tab.views
            if not (view.kind is ViewKind.STATES and view in first.views)
            and does_view_differ_between_runs(view, run_a, run_b)
        ]
        # the speed is only context, and not what the tab is about
        if all(view.name in _CONTEXT for view in differ):
            continue
        found: list[Panel | None] = []
        for view in differ:
            over = make_overlaid_panel(view, run_a, run_b)
            found += [over, make_difference_panel(view, difference, over)]
        pages.append(Page(tab.name, tuple(filter(None, found))))
    return pages


def make_panel_of_unchanged_view(view: View, run_a: _OverlaidRun) -> Panel | None:
    """Make the panel, from A, of a view that is the same in both runs; None if it is empty."""
    drawn = tuple(
        replace(each, frame=make_entity_path_of_side(_A, each.frame))
        for each in run_a.list_columns_drawn_in_view(view)
    )
    return (
        Panel(view.title, view.kind, drawn, choose_axis_range_without_outliers(view, run_a.run))
        if drawn
        else None
    )


def does_view_differ_between_runs(view: View, run_a: _OverlaidRun, run_b: _OverlaidRun) -> bool:
    """Whether anything that a view draws differs between A and B."""
    mine, theirs = run_a.list_columns_drawn_in_view(view), run_b.list_columns_drawn_in_view(view)
    if [(each.frame, each.column) for each in mine] != [(o.frame, o.column) for o in theirs]:
        return True
    return any(
        not run_a.drawn_frames[each.frame]
        .select(names)
        .equals(run_b.drawn_frames[each.frame].select(names))
        for each in mine
        for names in [["t_ns", each.column, *([each.variance] if each.variance else [])]]
    )


def make_overlaid_panel(view: View, run_a: _OverlaidRun, run_b: _OverlaidRun) -> Panel | None:
    """Make a panel of both runs: lines overlaid, lanes of states one below the other."""
    mine, theirs = run_a.list_columns_drawn_in_view(view), run_b.list_columns_drawn_in_view(view)
    if not (mine or theirs):
        return None
    one_line_each = max(count_lines_with_own_name(mine), count_lines_with_own_name(theirs)) == 1
    alike = (
        set()
        if view.kind is ViewKind.STATES
        else _find_labels_common_to_runs(mine, theirs, has_one_line_per_run=one_line_each)
    )
    drawn = [
        *style_lines_of_run(mine, _A, alike, has_one_line_per_run=one_line_each),
        *style_lines_of_run(theirs, _B, alike, has_one_line_per_run=one_line_each),
    ]
    title = f"{view.title}: A strong, B pale" if alike and not one_line_each else view.title
    if view.kind is ViewKind.STATES:
        drawn = sorted(drawn, key=lambda each: each.label)
    ends = [
        each
        for side in (run_a, run_b)
        if (each := choose_axis_range_without_outliers(view, side.run)) is not None
    ]
    bulk = (min(low for low, _ in ends), max(high for _, high in ends)) if ends else None
    return Panel(title, view.kind, tuple(drawn), bulk)


def _find_labels_common_to_runs(
    labels_a: Sequence[DisplayColumn],
    labels_b: Sequence[DisplayColumn],
    *,
    has_one_line_per_run: bool,
) -> set[str]:
    """Find the labels common to A and B, which are shown without the name of the run."""
    both = {each.label for each in labels_a} & {each.label for each in labels_b}
    return {
        each.label for each in labels_a if not has_one_line_per_run or each.column == "threshold"
    } & both


def make_difference_panel(
    view: View, difference: _OverlaidRun, overlaid_panel: Panel | None
) -> Panel | None:
    """Make a panel of B minus A; None for states, or if no number differs."""
    if view.kind is ViewKind.STATES:
        return None
    plain = replace(
        view, series=tuple(replace(each, std_column=None) for each in view.series), threshold=None
    )
    drawn = [
        each
        for each in difference.list_columns_drawn_in_view(plain)
        if (difference.drawn_frames[each.frame][each.column].fill_null(0.0) != 0.0).any()
    ]
    if not drawn:
        return None
    named = tuple(
        replace(each, frame=make_entity_path_of_side(_LESS, each.frame)) for each in drawn
    )
    above = set() if overlaid_panel is None else {each.label for each in overlaid_panel.columns}
    return Panel(
        f"B − A: {view.title}",
        ViewKind.LINES,
        named,
        choose_axis_range_without_outliers(plain, difference.run),
        shares_legend_of_panel_above=above.issuperset(each.label for each in named),
    )


def count_lines_with_own_name(display_columns: Sequence[DisplayColumn]) -> int:
    """Count the lines with a name of their own, which are neither extremes nor thresholds."""
    return sum(not each.faint and each.column != "threshold" for each in display_columns)


def style_lines_of_run(
    display_columns: Sequence[DisplayColumn],
    side: str,
    common_labels: set[str],
    *,
    has_one_line_per_run: bool,
) -> list[DisplayColumn]:
    """Style A with the usual colours and wide lines, visible under B; B with other colours."""
    found: list[DisplayColumn] = []
    for each in display_columns:
        colour = each.colour
        if side == _B and colour:
            other = has_one_line_per_run and each.column != "threshold"
            colour = (
                colours.choose_line_colour(1) if other else colours.mix_colour_with_white(colour)
            )
        found.append(
            replace(
                each,
                frame=make_entity_path_of_side(side, each.frame),
                label=each.label if each.label in common_labels else f"{side} {each.label}".strip(),
                colour=colour,
                wide=side == _A and not each.faint,
            )
        )
    return found


def make_entity_path_of_side(run_side: str, frame_name: str) -> str:
    """Make the entity path of a frame of a run: `A/gate` for `display/gate`."""
    return f"{run_side}/{frame_name.removeprefix(f'{ROOT}/')}"


def format_comparison_markdown(comparison: Comparison, run_a: str, run_b: str) -> str:
    """Format the differences as text, first of settings, then of results.

    Args:
        comparison: the comparison.
        run_a: name of A.
        run_b: name of B.
    """
    parts = [
        "# A and B" if not comparison.is_equal else "# A and B are equal",
        f"- A: {run_a}\n- B: {run_b}\n\nTimes are those of A. Columns without a panel in any tab "
        "do not "
        "differ.",
    ]
    for title, changes in (
        ("Settings", comparison.settings),
        ("Checks passed", comparison.checks),
        ("Losses, notes and stamps", comparison.provenance),
    ):
        if changes:
            parts.append(f"## {title}\n\n{_format_changed_values_markdown(changes)}")
    for title, moved in (
        ("Estimates that moved most", comparison.estimates),
        ("Manoeuvres that moved most", comparison.manoeuvres),
    ):
        if moved:
            parts.append(f"## {title}\n\n{_format_changed_estimates_markdown(moved)}")
    if comparison.stages:
        rows = [
            (stage.name, ", ".join(c.name for c in stage.columns)) for stage in comparison.stages
        ]
        parts.append(
            f"## Columns that differ\n\n{format_markdown_table(('stage', 'columns'), rows)}"
        )
    return "\n\n".join(parts)


def _format_changed_values_markdown(changes: Iterable[ValueChange]) -> str:
    return format_markdown_table(
        ("", "A", "B"),
        [(c.name, _format_changed_value(c.a), _format_changed_value(c.b)) for c in changes],
    )


def _format_changed_value(value: object) -> str:
    return format_number(
        value if value is None or isinstance(value, bool | int | float) else str(value)
    )


def _format_changed_estimates_markdown(changes: tuple[EstimateChange, ...]) -> str:
    rows = [
        (
            each.about,
            each.quantity,
            format_plus_minus(each.a, each.a_std),
            format_plus_minus(each.b, each.b_std),
            format_number(each.value_change),
            format_number(each.change_in_stds),
        )
        for each in changes[:_MOST]
    ]
    return format_markdown_table(("", "quantity", "A", "B", "B − A", "in deviations"), rows)
