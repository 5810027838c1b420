"""Write the files of a review from the cycles of a shift and its verdicts."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis.cycles.payload_target import TargetCheck, compare_payloads_with_target
from analysis.cycles.shift_totals import LabelTotal, recompute_shift_totals, sum_cycles_by_label
from analysis.model.fingerprint import digest_frame
from recordings.review.energy_columns import convert_shift_energy_to_dict
from recordings.review.ledger_table import (
    TABLE_CSV,
    XLSX,
    write_ledger_as_spreadsheet_csv,
    write_ledger_as_xlsx,
)
from recordings.review.review_page import PAGE, ReviewPage, UsedCalibration, render_review_html
from recordings.review.review_state import STATE, ChangedSetting, ReviewState
from recordings.review.reviewer_verdicts import (
    LABELS,
    CycleVerdict,
    assign_verdicts_to_rows,
    parse_verdicts,
)
from recordings.review.shift_facts import explain_why_no_cycle_is_counted
from recordings.review.shift_ledger import (
    CSV,
    PARQUET,
    add_motion_columns,
    make_cycle_ids,
    make_cycles_frame,
    make_ledger_frame,
    write_ledger_parquet_and_csv,
)

#: Files that a review writes besides its recording.
OUTPUTS: Final = (PARQUET, CSV, XLSX, TABLE_CSV, PAGE, STATE)
#: Points that the track of positions is thinned to.
_TRACK_POINTS: Final = 400


@dataclass(frozen=True)
class ShiftReview:
    """Result of a review.

    Attributes:
        folder: folder of the review.
        ledger: rows of the ledger.
        shift: frame `shift`, after verdicts.
        state: inputs of the review.
        calibration: calibration of the payloads, if any.
        target: result of the 10/10/20 rule if a target was given.
        replayed: whether the logs were replayed, rather than an unchanged replay reused.
    """

    folder: Path
    ledger: pl.DataFrame
    shift: dict[str, Any]
    state: ReviewState
    calibration: UsedCalibration
    target: TargetCheck | None
    replayed: bool

    @property
    def missing_tonnes_reason(self) -> str:
        """Reason why no cycle is counted; empty if at least one is."""
        return explain_why_no_cycle_is_counted(self.state, self.ledger)

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain JSON values."""
        return {
            "folder": str(self.folder),
            "shift": self.shift,
            "target": None if self.target is None else self.target._asdict(),
            "no_tonnes": self.missing_tonnes_reason,
            "can_weigh": self.state.can_weigh,
            "losses": list(self.state.losses),
            "warnings": [self.state.mixed_machines] if self.state.mixed_machines else [],
            "calibration": self.calibration._asdict(),
            "energy": convert_shift_energy_to_dict(self.ledger, self.shift, self.state),
            "replayed": self.replayed,
        }

    @classmethod
    def from_replay(
        cls, folder: Path, page: ReviewPage, *, is_newly_replayed: bool
    ) -> "ShiftReview":
        """Make the result of a review from the contents of its page."""
        shown = (page.state, page.calibration, page.target)
        return cls(folder, page.ledger, dict(page.shift), *shown, is_newly_replayed)


@dataclass(frozen=True)
class ShiftCount:
    """Cycles of a shift and their sums, with verdicts applied.

    Attributes:
        rows: the ledger, without motion.
        shift: frame `shift`, one row.
        verdicts: file of all verdicts.
        by_row: verdicts on cycles, by row.
        totals: totals by label, if loads have labels.
    """

    rows: pl.DataFrame
    shift: Mapping[str, Any]
    verdicts: str
    by_row: Mapping[int, CycleVerdict]
    totals: Mapping[str, list[LabelTotal]]

    @classmethod
    def count_cycles_with_verdicts(
        cls,
        cycles: pl.DataFrame,
        summary: pl.DataFrame,
        t0_unix_ns: int,
        verdict_text: str,
        folder: Path,
    ) -> "ShiftCount":
        """Count the cycles of a shift with verdicts applied.

        Args:
            cycles: frame `cycles`, calibrated if there is a calibration.
            summary: frame `shift` of the replay.
            t0_unix_ns: origin of times.
            verdict_text: text of the file of verdicts.
            folder: folder of that file, for error messages.

        Raises:
            ReviewError: the file of verdicts is invalid, or a verdict names a cycle that is absent.
        """
        verdicts = parse_verdicts(verdict_text, folder)
        by_row = assign_verdicts_to_rows(verdicts, make_cycle_ids(cycles, t0_unix_ns), folder)
        rejected = [int(cycles["cycle"][row]) for row, each in by_row.items() if each.reject]
        rows = make_ledger_frame(cycles, t0_unix_ns, by_row, verdicts.find_labels_at_dump)
        totals = {
            name: sum_cycles_by_label(cycles, rows[name].to_list(), rejected) for name in LABELS
        }
        return cls(
            rows,
            recompute_shift_totals(summary, cycles, rejected).row(0, named=True),
            verdict_text,
            by_row,
            {name: sums for name, sums in totals.items() if sums},
        )

    def make_review_page(
        self,
        state: ReviewState,
        input_changes: list[ChangedSetting] | None,
        track: pl.DataFrame | None,
    ) -> ReviewPage:
        """Make the page of the review; arguments as for `ReviewPage`."""
        target_kg = state.resolved["target_kg"]
        counted = self.rows.filter("counted")
        return ReviewPage(
            state,
            add_motion_columns(self.rows, state),
            self.shift,
            None if target_kg is None else compare_payloads_with_target(counted, target_kg),
            input_changes,
            UsedCalibration(*state.calibration),
            track,
            self.verdicts,
            self.by_row,
            self.totals,
        )


def write_review_files(review_page: ReviewPage, folder: Path) -> None:
    """Write ledger, page and state of a review."""
    write_ledger_parquet_and_csv(review_page.ledger, folder)
    clock = review_page.state.clock
    write_ledger_as_xlsx(review_page.ledger, clock, folder / XLSX)
    comma = bool(review_page.state.resolved.get("decimal_comma", False))
    write_ledger_as_spreadsheet_csv(
        review_page.ledger, clock, folder / TABLE_CSV, has_decimal_comma=comma
    )
    (folder / PAGE).write_text(render_review_html(review_page), encoding="utf-8")
    cycles = make_cycles_frame(review_page.ledger, review_page.state.t0_unix_ns)
    state = review_page.state.model_copy(update={"cycles_sha256": digest_frame(cycles)})
    (folder / STATE).write_text(state.model_dump_json(indent=1) + "\n", encoding="utf-8")


def decimate_position_track(aligned: pl.DataFrame) -> pl.DataFrame | None:
    """Thin the positions of the frame `aligned` to a track; None if it has no positions."""
    names = ("latitude_deg", "longitude_deg")
    if not set(names) <= set(aligned.columns):
        return None
    known = aligned.select(names).drop_nulls()
    return known.gather_every(max(known.height // _TRACK_POINTS, 1))
