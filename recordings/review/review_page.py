"""The page of a review: one file that a person reads on a phone, at a desk or on paper."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import polars as pl

from analysis.cycles.payload_target import TargetCheck
from analysis.cycles.shift_totals import LabelTotal
from analysis.model.physical_units import NS_PER_S
from estimators.errors import counted
from recordings.report.clock_text import duration_text
from recordings.report.number_text import REMARKED, plus_minus
from recordings.report.render_page import page_html
from recordings.report.shift_text import K, tonnes
from recordings.review.cycle_rows import DETAILS, PAYLOAD, cycle_rows
from recordings.review.energy_columns import energy_table
from recordings.review.hour_rows import HEADS, hour_rows
from recordings.review.review_plots import load_pictures, shift_pictures
from recordings.review.review_state import RECORDING, ReviewState
from recordings.review.reviewer_verdicts import (
    VERDICTS,
    CycleVerdict,
    verdict_lines,
)
from recordings.review.shift_facts import (
    facts,
    headline,
    long_holes,
    missing_loads,
    no_tonnes_reason,
    other_losses,
    scale_text,
    torn_sentences,
    two_machines,
)

PAGE: Final = "review.html"
_PACKAGE: Final = "recordings.review"
_TEMPLATE: Final = "review.html.j2"
_SCRIPTS: Final = ("find_rows.js", "verdict_buttons.js")
#: A page is no list of all that may be wrong.
_MOST_FINDINGS: Final = 3
NOT_CALIBRATED: Final = "Payloads are not calibrated"


class UsedCalibration(NamedTuple):
    """The calibration of a review.

    Attributes:
        says: what it is, in words; empty where there is none.
        against: what the logs say against it, so that it is not used; empty where nothing.
    """

    says: str = ""
    against: str = ""

    @property
    def counts(self) -> bool:
        """Whether payloads are on its line."""
        return bool(self.says) and not self.against


@dataclass(frozen=True)
class ReviewPage:
    """What a page shows.

    Attributes:
        state: of the review.
        ledger: its rows, with motion.
        shift: frame `shift`, with what a reviewer says.
        target: 10/10/20, where a target was given.
        changes: since the last review; None where this is the first.
        calibration: whose line the payloads are on.
        track: positions, where there are.
        verdicts: the file of all that reviewers said, with their comments.
        by_row: verdicts on cycles, by row of the ledger.
        totals: by label (product, operator …), where loads have one.
    """

    state: ReviewState
    ledger: pl.DataFrame
    shift: Mapping[str, Any]
    target: TargetCheck | None
    changes: list[tuple[str, str, str]] | None
    calibration: UsedCalibration
    track: pl.DataFrame | None = None
    verdicts: str = ""
    by_row: Mapping[int, CycleVerdict] = field(default_factory=dict[int, CycleVerdict])
    totals: Mapping[str, Sequence[LabelTotal]] = field(
        default_factory=dict[str, Sequence[LabelTotal]]
    )


def review_html(page: ReviewPage) -> str:
    """Write the page; every text in it is escaped, and it asks nothing of anybody."""
    state, shift = page.state, page.shift
    why_not = no_tonnes_reason(state, page.ledger)
    said = page.ledger.filter(pl.col("author") != "").height
    return page_html(
        _PACKAGE,
        _TEMPLATE,
        scripts=_SCRIPTS,
        led_to=REMARKED,
        title=f"Shift of {state.machine or 'a machine without a name'}",
        state=state,
        duration=duration_text(shift["duration_s"]),
        against=page.calibration.against and f"{NOT_CALIBRATED}: {page.calibration.against}.",
        headline=headline(shift, why_not, state),
        no_tonnes=bool(why_not),
        alarms=list(filter(None, (two_machines(state), long_holes(shift, state)))),
        facts=facts(shift, page.ledger, state, page.target),
        warnings=_warnings(page),
        payload_heads=[column.head for column in PAYLOAD],
        detail_heads=[column.head for column in DETAILS],
        cycles=cycle_rows(page.ledger, page.by_row, state.clock),
        t0_s=round(state.t0_unix_ns / NS_PER_S),
        doubted=page.ledger.filter("counted", pl.col("doubt") != "").height,
        hours=hour_rows(page.ledger, state),
        hour_heads=list(HEADS),
        load_pictures=load_pictures(page.ledger, state, page.target),
        pictures=shift_pictures(state, page.track),
        losses=[*(each.loss for each in state.torn), *other_losses(state)],
        totals={name: _total_rows(rows) for name, rows in page.totals.items()},
        changes=page.changes,
        verdicts=f"{counted(said, 'cycle')} with a reviewer's verdict",
        verdict_lines=verdict_lines(page.verdicts),
        verdict_file=VERDICTS,
        calibration=page.calibration.says or "none: masses are by the machine file alone",
        friction=_friction(state),
        energy=energy_table(state),
        energy_phases=[row.phase for row in state.energy.rows if row.cycle is None],
    )


def _total_rows(totals: Sequence[LabelTotal]) -> list[tuple[str, str, str]]:
    """A label, its loads and its tonnes."""
    return [
        (each.label or "–", f"{each.loads:,}", tonnes(each.payload_kg, K * each.payload_u_kg))
        for each in totals
    ]


def _warnings(page: ReviewPage) -> list[str]:
    state = page.state
    found = missing_loads(page.shift)
    found += torn_sentences(state)
    if losses := other_losses(state):
        found.append(f"Damaged or incomplete: {counted(len(losses), 'loss')}, listed below.")
    widened = [c.check for c in state.failed if c.consequence == "widen"]
    if widened:
        found.append(f"Checks that failed and widen the ±: {', '.join(widened)}.")
    found += [
        f"These logs show {finding}; payscope explain {RECORDING} says more."
        for finding in state.findings[:_MOST_FINDINGS]
    ]
    if page.shift["scale_unknown"]:
        found.append(f"Scale {scale_text(page.shift)}.")
    return found


def _friction(state: ReviewState) -> str:
    value, std = state.friction
    return "–" if value is None else f"{plus_minus(value, std)} N·s/m (standard uncertainty)"
