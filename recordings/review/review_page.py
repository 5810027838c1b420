"""The page of a review: one file that a person reads on a phone, at a desk or on paper."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import polars as pl

from analysis.cycles.payload_target import TargetCheck
from estimators.errors import counted
from recordings.report.number_text import SCALE_NOT_KNOWN, plus_minus
from recordings.report.render_page import page_html
from recordings.review.review_plots import pictures
from recordings.review.review_state import RECORDING, ReviewState

PAGE: Final = "review.html"
_TEMPLATE: Final = "review.html.j2"
#: A page is no list of all that may be wrong.
_MOST_FINDINGS: Final = 3
#: Nor is its headline; the table has all.
_MOST_CHECKS: Final = 3
NOT_CALIBRATED: Final = "Payloads are not calibrated"
#: Of an interval with a confidence of 95 %.
K: Final = 2.0
_NUMERIC: Final = (
    *("cycle", "from s", "payload kg", "± kg", "carried back kg", "return s", "load s"),
    *("haul s", "dump s"),
)
_HEADS: Final = (*_NUMERIC, "quality", "said", "command")


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
        ledger: its rows.
        shift: frame `shift`, with what a reviewer says.
        target: 10/10/20, where a target was given.
        changes: since the last review; None where this is the first.
        calibration: whose line the payloads are on.
        track: positions, where there are.
    """

    state: ReviewState
    ledger: pl.DataFrame
    shift: Mapping[str, Any]
    target: TargetCheck | None
    changes: list[tuple[str, str, str]] | None
    calibration: UsedCalibration
    track: pl.DataFrame | None = None


def review_html(page: ReviewPage) -> str:
    """Write the page; every text in it is escaped, and it asks nothing of anybody."""
    state, shift = page.state, page.shift
    why_not = no_tonnes(state, page.ledger)
    said = page.ledger.filter(pl.col("author") != "").height
    return page_html(
        "recordings.review",
        _TEMPLATE,
        title=f"Shift of {state.machine or 'a machine without a name'}",
        state=state,
        duration=f"{shift['duration_s'] / 3600.0:.2f} h",
        against=page.calibration.against and f"{NOT_CALIBRATED}: {page.calibration.against}.",
        headline=headline(shift, why_not),
        no_tonnes=bool(why_not),
        facts=[*facts(shift, page.target), *breakdown(page.ledger)],
        warnings=_warnings(page),
        heads=_HEADS,
        numeric=_NUMERIC,
        cycles=[_row(row) for row in page.ledger.iter_rows(named=True)],
        pictures=pictures(page.ledger, state, page.target, page.track),
        changes=page.changes,
        verdicts=f"{counted(said, 'cycle')} with a reviewer's verdict",
        calibration=page.calibration.says or "none: masses are by the machine file alone",
        friction=_friction(state),
    )


def headline(shift: Mapping[str, Any], why_not: str) -> str:
    """The answer in a line.

    Args:
        shift: frame `shift`, as reviewed.
        why_not: see `no_tonnes`.
    """
    if why_not:
        return f"No tonnes: {why_not}"
    loads = counted(shift["cycles_counted"], "load")
    answer = f"{_tonnes(shift['payload_kg'], K * shift['payload_u_kg'])} in {loads}"
    scale = f", {SCALE_NOT_KNOWN}" if shift["scale_unknown"] else ""
    if not _is_priced(shift):
        return answer + scale
    whole = _tonnes(shift["total_kg"], K * shift["total_u_kg"])
    return f"{whole} in the shift: {answer} counted{scale}"


def scale_of(shift: Mapping[str, Any]) -> str:
    """What tells the scale of the tonnes, or what does not."""
    gain = ""
    if shift["gain_1"] is not None:
        found = plus_minus(shift["gain_1"], shift["gain_u_1"])
        gain = f"; the empty machine weighs {found} times its stated mass here"
    if not shift["scale_unknown"]:
        return f"by the {shift['scale_from']}{gain}"
    # what changes with the load is left where the empty machine tells the rest
    remedy = "known loads" if gain else "a weighbridge ticket (machine.empty_mass_u_kg)"
    return (
        f"not known: the machine file gives no uncertainty of {shift['scale_unknown']}, so none is "
        f"in the ±; {remedy} or a calibration would tell it{gain}"
    )


def _is_priced(shift: Mapping[str, Any]) -> bool:
    """Whether the shift's total has more in it than the counted loads."""
    parts = ("uncounted_kg", "uncounted_u_kg", "lost_kg", "lost_u_kg")
    return any(shift[name] > 0.0 for name in parts)


def missing_loads(shift: Mapping[str, Any]) -> list[str]:
    """What the total cannot hold: loads that were seen and have no price, or are not dumped."""
    found: list[str] = []
    if shift["uncounted_cycles"] > 0.0 and not shift["cycles_counted"]:
        found.append(
            f"Not weighed: about {shift['uncounted_cycles']:.0f} cycles that digging or the boom "
            "shows; no load has a mass to price them by."
        )
    if shift["on_board_kg"] is not None:
        load = _tonnes(shift["on_board_kg"], K * shift["on_board_u_kg"])
        found.append(f"On board when the recording ends: {load}, not counted.")
    return found


def no_tonnes(state: ReviewState, ledger: pl.DataFrame) -> str:
    """Why no cycle counts; nothing where one does."""
    if ledger["counted"].any():
        return ""
    if not state.can_weigh:
        failed = [check for check in state.failed if check.consequence == "withhold"]
        more = len(failed) - _MOST_CHECKS
        names = ", ".join(check.check for check in failed[:_MOST_CHECKS])
        names += f" and {more} more" if more > 0 else ""
        why = f": {failed[0].meaning}" if len(failed) == 1 else ""
        return f"these logs cannot weigh; failed: {names}{why}"
    if ledger.is_empty():
        return state.no_cycle
    reasons = Counter(
        "rejected by a reviewer" if rejected else reason or str(quality)
        for rejected, reason, quality in ledger.select(
            "rejected", "withheld_for", "quality"
        ).iter_rows()
    )
    return "; ".join(f"{counted(n, 'cycle')}: {reason}" for reason, n in reasons.items())


def _delivered(shift: Mapping[str, Any]) -> str:
    """Whether payloads are those at the start of a haul or at its end."""
    arriving_1 = shift.get("arriving_1")
    if arriving_1 is None:
        return (
            "at the start of the haul; spillage on the way is not subtracted "
            "(machine.haul_spillage_share)"
        )
    u_1 = K * (shift["arriving_u_1"] or 0.0)
    return (
        f"at the dump: {arriving_1:.1%} ± {u_1:.1%} of what is weighed arrives, by the spillage "
        "that the machine file states"
    )


def facts(shift: Mapping[str, Any], target: TargetCheck | None) -> list[tuple[str, str]]:
    """What a reader looks for first, name and value."""
    found: list[tuple[str, str]] = []
    if shift["cycles_counted"]:
        found += [
            ("payload", _delivered(shift)),
            ("interval", "95 % (k = 2)"),
            ("repeatability", f"± {K * shift['payload_u_random_kg'] / 1e3:.3f} t"),
            (
                "systematic",
                f"± {K * shift['payload_u_common_kg'] / 1e3:.3f} t (does not average out)",
            ),
            ("scale", scale_of(shift)),
            (
                "estimated in gaps and torn files",
                f"{_number(shift['lost_cycles'], shift['lost_cycles_u'])} cycles, "
                f"{_tonnes(shift['lost_kg'], K * shift['lost_u_kg'])}",
            ),
            (
                "estimated for cycles without a mass",
                f"{_number(shift['uncounted_cycles'], shift['uncounted_cycles_u'])} cycles, "
                f"{_tonnes(shift['uncounted_kg'], K * shift['uncounted_u_kg'])}",
            ),
        ]
    found.append(
        (
            "cycles",
            f"{shift['cycles']} seen ({_seen_by(shift)}), {shift['cycles_counted']} counted, "
            f"{shift['cycles_rejected']} rejected, {shift['cycles_without_mass']} without a mass",
        )
    )
    if shift["cycles_counted"]:
        mean, std = shift["payload_mean_kg"], shift["payload_std_kg"] or 0.0
        found += [("a load", f"{mean:,.0f} kg on average, standard deviation {std:,.0f} kg")]
    if shift["carry_back_mean_kg"] is not None:
        mean, u = shift["carry_back_mean_kg"], K * (shift["carry_back_u_kg"] or 0.0)
        found += [("carried back", f"{mean:,.0f} ± {u:,.0f} kg on average")]
    found += [
        (
            "utilisation",
            f"{shift['utilisation_1']:.0%}; idle (> 30 s): {shift['idle_s'] / 60.0:.0f} min; not "
            f"recorded: {shift['gap_s'] / 60.0:.1f} min",
        )
    ]
    if target is not None:
        found.append(("10/10/20", target_sentence(target)))
    return found


def _number(cycles: float, u: float) -> str:
    return f"{cycles:.1f} ± {K * u:.1f}"


def _seen_by(shift: Mapping[str, Any]) -> str:
    boom = "no boom" if shift["boom_dumps"] is None else f"{shift['boom_dumps']} dumps of the boom"
    return f"{shift['digs']} with digging, {boom}"


def breakdown(ledger: pl.DataFrame) -> list[tuple[str, str]]:
    """What a cycle's time goes into, on average; nothing where no cycle was seen whole."""
    parts = ("return_s", "load_s", "haul_s", "dump_s")
    whole = ledger.drop_nulls(parts)
    if not whole.height:
        return []
    mean = whole.select(pl.col(parts).mean()).row(0)
    words = ", ".join(
        f"{name.removesuffix('_s')} {each:.0f} s" for name, each in zip(parts, mean, strict=True)
    )
    return [("a cycle", f"{sum(mean):.0f} s on average: {words}")]


def target_sentence(target: TargetCheck) -> str:
    """The verdict on the target in words."""
    near = (
        f"; {counted(target.near, 'load')} within the uncertainty of a limit" if target.near else ""
    )
    return (
        f"{'kept' if target.keeps else 'not kept'}: mean {target.mean_kg:,.0f} kg of "
        f"{target.target_kg:,.0f} kg, {target.above} of {target.loads} above 110 % (at most a "
        f"tenth), {target.never} above 120 % (none){near}"
    )


def _tonnes(kg: float, u_kg: float) -> str:
    digits = 1 if u_kg >= 3000.0 else 2 if u_kg >= 300.0 else 3
    return f"{kg / 1e3:,.{digits}f} ± {u_kg / 1e3:,.{digits}f} t"


def two_machines(state: ReviewState) -> str:
    """The warning that these may be logs of two machines, as a sentence."""
    return f"{state.mixed_machines[:1].upper()}{state.mixed_machines[1:]}."


def _warnings(page: ReviewPage) -> list[str]:
    state = page.state
    found = [two_machines(state)] if state.mixed_machines else []
    found += missing_loads(page.shift)
    if state.losses:
        found.append(f"Damaged or incomplete: {counted(len(state.losses), 'loss')}, listed below.")
    widened = [c.check for c in state.failed if c.consequence == "widen"]
    if widened:
        found.append(f"Checks that failed and widen the ±: {', '.join(widened)}.")
    found += [
        f"These logs show {finding}; payscope explain {RECORDING} says more."
        for finding in state.findings[:_MOST_FINDINGS]
    ]
    if page.shift["scale_unknown"]:
        found.append(f"Scale {scale_of(page.shift)}.")
    return found


def _friction(state: ReviewState) -> str:
    value, std = state.friction
    return "–" if value is None else f"{plus_minus(value, std)} N·s/m (standard uncertainty)"


def _row(row: Mapping[str, Any]) -> Mapping[str, Any]:
    names = (
        "payload_kg",
        "payload_u_kg",
        "carry_back_kg",
        "return_s",
        "load_s",
        "haul_s",
        "dump_s",
    )
    cells = [(f"{row['at_s']:,.0f}", f"{row['at_s']:.3f}")]
    for name in names:
        value = row[name]
        value = K * value if name == "payload_u_kg" and value is not None else value
        cells.append(("–", "") if value is None else (f"{value:,.0f}", f"{value:.3f}"))
    remark = [row["withheld_for"]]
    if row["author"]:
        remark.append(
            f"{'rejected, ' if row['rejected'] else ''}{row['author']}, {row['said']}"
            + "".join(f": {text}" for text in (row["product"], row["note"]) if text)
        )
    return {
        "number": row["cycle"],
        "cells": cells,
        "quality": row["quality"],
        "said": "; ".join(filter(None, remark)),
        "out": not row["counted"],
        "command": f"payscope view {RECORDING} --at {max(row['at_s'], 0.0):.1f}",
    }
