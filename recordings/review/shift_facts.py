"""Describe the facts of a shift in names and sentences, the same on page and terminal."""

import re
from collections.abc import Mapping
from typing import Any, Final

import polars as pl

from analysis.cycles.cycle_limits import LIMITS as CYCLE_LIMITS
from analysis.cycles.payload_target import TargetCheck
from estimators.errors import format_count, join_first_names
from recordings.report.clock_text import format_duration
from recordings.report.number_text import format_plus_minus
from recordings.report.shift_text import (
    K,
    describe_min_detectable_load,
    describe_shift_payload,
    format_tonnes,
)
from recordings.review.energy_columns import list_energy_names_and_values
from recordings.review.review_limits import LIMITS
from recordings.review.review_state import ReviewState
from recordings.review.truncated_logs import find_truncated_last_log

#: Seconds of an hour.
_HOUR_S: Final = 3600.0
#: km/h per m/s.
_KM_H: Final = 3.6
_NUMBER: Final = re.compile(r"\d[\d.,]*")


def summarise_shift_in_line(
    shift: Mapping[str, Any], missing_tonnes_reason: str, state: ReviewState
) -> str:
    """Summarise the answer of a shift in one line.

    Args:
        shift: frame `shift` after verdicts.
        missing_tonnes_reason: see `explain_why_no_cycle_is_counted`.
        state: state of the review; if its last log is truncated, the end is unknown.
    """
    answer = (
        f"No tonnes: {missing_tonnes_reason}"
        if missing_tonnes_reason
        else describe_shift_payload(shift)
    )
    end = find_truncated_last_log(state.torn)
    if end is None or missing_tonnes_reason:
        return answer
    return (
        f"{answer}; until {state.clock.format_time(end.ends_s)}, the rest of the shift is unknown"
    )


def explain_why_no_cycle_is_counted(state: ReviewState, ledger: pl.DataFrame) -> str:
    """Reason why no cycle is counted in the shift; empty if at least one is."""
    if ledger["counted"].any():
        return ""
    if not state.can_weigh:
        failed = state.mass_withholding_checks
        names = join_first_names([check.check for check in failed], LIMITS.headline_max_checks)
        why = f": {failed[0].meaning}" if len(failed) == 1 else ""
        return f"these logs cannot weigh; failed: {names}{why}"
    if ledger.is_empty():
        return state.no_cycle
    alike: dict[str, list[str]] = {}
    rows = ledger.select("rejected", "withheld_for", "quality").iter_rows()
    for rejected, withheld_for, quality in rows:
        reason = "rejected by a reviewer" if rejected else withheld_for or str(quality)
        # reasons that differ only in their numbers
        alike.setdefault(_NUMBER.sub("", reason), []).append(reason)
    return "; ".join(
        f"{format_count(len(each), 'cycle')}{', such as' if len({*each}) > 1 else ''}: {each[0]}"
        for each in alike.values()
    )


def describe_missing_loads(shift: Mapping[str, Any]) -> list[str]:
    """Describe loads that are missing from the total: not weighed, or not dumped yet."""
    found: list[str] = []
    if shift["uncounted_cycles"] > 0.0 and not shift["cycles_counted"]:
        found.append(
            f"Not weighed: about {shift['uncounted_cycles']:.0f} cycles detected; no load has a "
            "mass from which to estimate theirs."
        )
    if shift["on_board_kg"] is not None:
        load = format_tonnes(shift["on_board_kg"], K * shift["on_board_u_kg"])
        found.append(f"On board when the recording ends: {load}, not counted.")
    return found


def describe_long_gaps(shift: Mapping[str, Any], state: ReviewState) -> str:
    """Describe gaps of minutes and the work in them; empty if there are none."""
    spans = format_spans_of_recording_gaps(state)
    if not spans:
        return ""
    price = "the loads of that time are unknown"
    if shift["lost_cycles"] > 0.0:
        ends_shift = any(e - s > CYCLE_LIMITS.break_max_s for s, e in state.gaps_s)
        price = (
            f"estimated for {'gaps that end no shift' if ends_shift else 'all gaps'}: "
            f"{_format_cycle_count(shift['lost_cycles'], shift['lost_cycles_u'])} loads, "
            f"{format_tonnes(shift['lost_kg'], K * shift['lost_u_kg'])}"
        )
    return f"Readings are missing {spans}; {price}."


def format_spans_of_recording_gaps(state: ReviewState) -> str:
    """Format the gaps of minutes; empty if there are none."""
    clock = state.clock
    return "; ".join(
        f"from {clock.format_time(s)} to {clock.format_time(e)} ({format_duration(e - s)})"
        for s, e in state.gaps_s
        if e - s > LIMITS.headline_gap_s
    )


def describe_truncated_logs(state: ReviewState) -> list[str]:
    """Describe truncated logs and the minutes that they lack."""
    return [each.describe_missing_time(state.clock) for each in state.torn]


def list_losses_besides_truncated_ends(state: ReviewState) -> list[str]:
    """List the losses other than truncated ends of logs."""
    torn = {text for each in state.torn for text in each.losses}
    return [text for text in state.losses if text not in torn]


def list_shift_names_and_values(
    shift: Mapping[str, Any],
    ledger: pl.DataFrame,
    state: ReviewState,
    payload_target: TargetCheck | None,
) -> list[tuple[str, str]]:
    """List facts as pairs of name and value: first the work, then the uncertainty of the tonnes."""
    found = [
        *_list_work_names_and_values(shift, ledger),
        *_list_time_names_and_values(shift, ledger, state),
    ]
    if state.unweighed_drives:
        found.append(("not weighed", state.unweighed_drives))
    found += list_energy_names_and_values(ledger, shift, state)
    if payload_target is not None:
        found.append(("10/10/20", describe_target_check(payload_target)))
    if shift["cycles_counted"]:
        found += _list_payload_names_and_values(shift, state)
    return found


def _list_work_names_and_values(
    shift: Mapping[str, Any], ledger: pl.DataFrame
) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    recorded_h = (shift["duration_s"] - shift["gap_s"]) / _HOUR_S
    if recorded_h > 0.0 and shift["cycles"]:
        per_hour = [f"{shift['cycles'] / recorded_h:.1f} cycles"]
        if shift["cycles_counted"]:
            t_h = format_tonnes(
                shift["payload_kg"] / recorded_h, K * shift["payload_u_kg"] / recorded_h
            )
            per_hour.insert(0, t_h)
        found.append(("per hour", f"{', '.join(per_hour)} (of recorded time)"))
    found.append(("cycles", _describe_cycle_counts(shift, ledger)))
    doubted = ledger.filter("counted", pl.col("doubt") != "")["cycle"].to_list()
    if doubted:
        numbers = ", ".join(map(str, doubted))
        found.append(("worth a second look", f"{format_count(len(doubted), 'load')}: {numbers}"))
    if shift["cycles_counted"]:
        found.append(("a load", _format_mean_payload(shift)))
    back_kg, back_u_kg = shift["carry_back_mean_kg"], K * (shift["carry_back_u_kg"] or 0.0)
    # stated only if it is significantly different from zero
    if back_kg is not None and abs(back_kg) > back_u_kg:
        found.append(("carried back", f"{back_kg:,.0f} ± {back_u_kg:,.0f} kg on average"))
    return found


def _describe_cycle_counts(shift: Mapping[str, Any], ledger: pl.DataFrame) -> str:
    """Say how many cycles were detected, and how many were counted, rejected or not weighed."""
    rejected = ledger.filter("rejected").height
    others = ledger.filter(~pl.col("counted"), ~pl.col("rejected"))
    weighed = others.filter(pl.col("payload_kg").is_not_null())
    on_board = weighed.filter(pl.col("quality") == _ON_BOARD).height
    parts = [
        f"{ledger.filter('counted').height} counted",
        f"{rejected} rejected",
        f"{others.height - weighed.height} without a mass",
    ]
    if on_board:
        parts.append(f"{on_board} still on board at the end")
    if weighed.height > on_board:
        parts.append(f"{weighed.height - on_board} not counted for another reason")
    return f"{shift['cycles']} detected ({_format_recorded_time(shift)}), {', '.join(parts)}"


def _format_mean_payload(shift: Mapping[str, Any]) -> str:
    """Format the mean payload and its standard deviation."""
    mean = f"{shift['payload_mean_kg']:,.0f} kg"
    if shift["cycles_counted"] == 1:
        return mean
    return f"{mean} on average, standard deviation {shift['payload_std_kg'] or 0.0:,.0f} kg"


def _list_time_names_and_values(
    shift: Mapping[str, Any], ledger: pl.DataFrame, state: ReviewState
) -> list[tuple[str, str]]:
    found = list_mean_phase_durations(ledger)
    motion = state.motion
    if motion.distance_m is not None and motion.top_speed_m_s is not None:
        haul_m = ledger["haul_m"].mean()
        haul = f"haul {haul_m:,.0f} m on average, " if isinstance(haul_m, float) else ""
        found.append(
            (
                "driving",
                f"{haul}{motion.distance_m / 1e3:,.1f} km in all, at most "
                f"{_KM_H * motion.top_speed_m_s:.1f} km/h; "
                f"moving {format_duration(motion.moving_s)},"
                f" standing {format_duration(motion.standing_s)}",
            )
        )
    longest = sorted(state.idle_s, key=lambda span: span[0] - span[1])[: LIMITS.max_stands]
    stands = "; longest: " + ", ".join(
        f"{state.clock.format_time(start)} ({format_duration(end - start)})"
        for start, end in longest
    )
    found.append(
        (
            "utilisation",
            f"{shift['utilisation_1']:.0%}; idle (> 30 s): {format_duration(shift['idle_s'])}"
            f"{stands if longest else ''}; not recorded: {format_duration(shift['gap_s'])}",
        )
    )
    return found


def _list_payload_names_and_values(
    shift: Mapping[str, Any], state: ReviewState
) -> list[tuple[str, str]]:
    return [
        ("payload", describe_where_payload_was_weighed(shift)),
        ("interval", "95 % (k = 2)"),
        ("repeatability", f"± {K * shift['payload_u_random_kg'] / 1e3:.3f} t"),
        ("systematic", f"± {K * shift['payload_u_common_kg'] / 1e3:.3f} t (does not average out)"),
        ("scale", describe_source_of_mass_scale(shift)),
        *((("sensitivity", least),) if (least := describe_min_detectable_load(shift)) else ()),
        ("estimated where nothing was recorded", _describe_lost_recording_time(shift, state)),
        (
            "estimated for cycles without a mass",
            format_cycles_and_mass(
                (shift["uncounted_cycles"], shift["uncounted_cycles_u"]),
                (shift["uncounted_kg"], shift["uncounted_u_kg"]),
            ),
        ),
    ]


def describe_where_payload_was_weighed(shift: Mapping[str, Any]) -> str:
    """Say whether payloads were measured at the start or at the end of hauls."""
    arriving_1 = shift.get("arriving_1")
    if arriving_1 is None:
        return (
            "at the start of the haul; spillage on the way is not subtracted "
            "(machine.haul_spillage_share)"
        )
    u_1 = K * (shift["arriving_u_1"] or 0.0)
    return (
        f"at the dump: {arriving_1:.1%} ± {u_1:.1%} of the weighed load arrives, by the spillage "
        "in the machine file"
    )


def _describe_lost_recording_time(shift: Mapping[str, Any], state: ReviewState) -> str:
    lost = format_cycles_and_mass(
        (shift["lost_cycles"], shift["lost_cycles_u"]), (shift["lost_kg"], shift["lost_u_kg"])
    )
    unknown = [
        f"unknown from {state.clock.format_time(s)} to {state.clock.format_time(e)}"
        for s, e in state.gaps_s
        if e - s > CYCLE_LIMITS.break_max_s
    ]
    if end := find_truncated_last_log(state.torn):
        unknown.append(f"unknown after {state.clock.format_time(end.ends_s)}")
    return "; ".join([lost] * (lost != _NOTHING or not unknown) + unknown)


_NOTHING: Final = "nothing"
#: Quality of a load that is not dumped when the recording ends.
_ON_BOARD: Final = "not dumped"


def format_cycles_and_mass(
    cycles_with_u: tuple[float, float], mass_with_u_kg: tuple[float, float]
) -> str:
    """Format a number of cycles and their mass, each given with its standard uncertainty."""
    if not any((*cycles_with_u, *mass_with_u_kg)):
        return _NOTHING
    return (
        f"{_format_cycle_count(*cycles_with_u)} cycles, "
        f"{format_tonnes(mass_with_u_kg[0], K * mass_with_u_kg[1])}"
    )


def describe_source_of_mass_scale(shift: Mapping[str, Any]) -> str:
    """Say what determines the scale of the tonnes, or which sources of error are unknown."""
    gain = ""
    if shift["gain_1"] is not None:
        found = format_plus_minus(shift["gain_1"], shift["gain_u_1"])
        gain = f"; the empty machine weighs {found} times its stated mass here"
    if not shift["scale_unknown"]:
        return f"by the {shift['scale_from']}{gain}"
    # if the empty mass determines the gain, only errors that change with the load are left
    remedy = "known loads" if gain else "a weighbridge ticket (machine.empty_mass_u_kg)"
    return (
        f"not known: the machine file gives no uncertainty of {shift['scale_unknown']}, so the ± "
        f"does not include it; {remedy} or a calibration would determine it{gain}"
    )


def list_mean_phase_durations(ledger: pl.DataFrame) -> list[tuple[str, str]]:
    """List the mean duration of each phase of a cycle; empty if no cycle is complete.

    Cycles with a gap, or rejected by a reviewer, are left out of the means.
    """
    parts = ("return_s", "load_s", "haul_s", "dump_s")
    whole = ledger.drop_nulls(parts).filter(
        pl.col("hole_s").fill_null(0.0) <= LIMITS.cycle_gap_s, ~pl.col("rejected")
    )
    if not whole.height:
        return []
    mean = whole.select(pl.col(parts).mean()).row(0)
    whole_cycles = format_count(whole.height, "whole cycle")
    words = ", ".join(
        f"{name.removesuffix('_s')} {each:.0f} s" for name, each in zip(parts, mean, strict=True)
    )
    return [("a cycle", f"{sum(mean):.0f} s on average over {whole_cycles}: {words}")]


def describe_target_check(payload_target: TargetCheck) -> str:
    """Describe the result of the target check."""
    near = (
        f"; {format_count(payload_target.near, 'load')} within the uncertainty of a limit"
        if payload_target.near
        else ""
    )
    return (
        f"{'kept' if payload_target.keeps else 'not kept'}: mean {payload_target.mean_kg:,.0f} kg "
        f"of {payload_target.target_kg:,.0f} kg, {payload_target.above} of {payload_target.loads} "
        "above 110 % (at most a "
        f"tenth), {payload_target.never} above 120 % (none){near}"
    )


def make_warning_of_mixed_machines(state: ReviewState) -> str:
    """Warn of logs that may be of two machines, or of one that changes; else empty."""
    said = state.mixed_machines
    return f"{said[:1].upper()}{said[1:]}." if said else ""


def _format_cycle_count(cycles: float, cycles_u: float) -> str:
    return f"{cycles:.1f} ± {K * cycles_u:.1f}"


def _format_recorded_time(shift: Mapping[str, Any]) -> str:
    boom = "no boom" if shift["boom_dumps"] is None else f"{shift['boom_dumps']} dumps of the boom"
    return f"{shift['digs']} with digging, {boom}"
