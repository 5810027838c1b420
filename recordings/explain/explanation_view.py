"""Write an explanation of a run in words, and draw it as a picture.

The words are the answer in one sentence, then the reasons line by line. The picture shows force
against acceleration, signals, and convergence of the mass.
"""

from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Final

import numpy as np
import polars as pl

from analysis.explain import DeterminedParameters, Explanation
from analysis.explain.worst_manoeuvres import GateStretch, ManoeuvreReport
from analysis.model.physical_units import NS_PER_S
from analysis.model.run_record import Run
from estimators.errors import format_count
from recordings.plots.convergence_plot import draw_convergence_of_estimates
from recordings.plots.force_acceleration_plot import draw_force_acceleration
from recordings.plots.time_panels import draw_views_over_time
from recordings.report.finding_text import (
    can_fixing_change_mass,
    describe_consequence_of_finding,
    describe_indistinguishable_causes,
    describe_mass_change_if_fixed,
    find_readable_cause_name,
    format_finding,
    format_finding_span,
    format_proposed_machine_keys,
)
from recordings.report.number_text import format_number, format_plus_minus
from recordings.report.picture import write_picture
from recordings.rrd.display_frames import find_time_span_of_grid_ns, make_display_frames
from recordings.rrd.recording_table import MOMENT
from recordings.rrd.recording_texts import format_answer_headline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DECIDES: Final = {
    "mi_x_nat": ("index", "nat"),
    "corr_x_1": ("correlation", ""),
    "noise_share_x_1": ("share of noise", ""),
}
_PARAMETERS: Final = {
    "mass_kg": "mass",
    "friction_x_N_s_m": "viscous friction",
    "coulomb_x_N": "Coulomb friction",
    "constant_force_N": "a constant force",
}
#: Standard deviations from its load's mass beyond which a manoeuvre is worth a look.
_APART: Final = 3.0
#: Size of the picture in inches, characters of a line, and number of findings that it has room for.
_SIZE_IN: Final = (12.0, 11.0)
_LINE: Final = 165
_FINDINGS: Final = 3
#: Time in s that is drawn before and after the moment.
_AROUND_S: Final = 15.0


def describe_answer_and_likeliest_cause(explanation: Explanation) -> str:
    """Describe the answer and the likeliest cause of an error, in one sentence."""
    said = format_answer_headline(explanation.answer).removesuffix(".")
    here = (
        ""
        if explanation.at_s is None
        else f"; at {explanation.at_s:g} s {_describe_moment_of_explanation(explanation)}"
    )
    found = explanation.findings
    if found is None:
        return f"{said}{here}; this recording has no findings: replay the log."
    if not found:
        return f"{said}{here}; none of the known causes of an error was detected."
    if not any(map(can_fixing_change_mass, found)):
        names = ", ".join(find_readable_cause_name(each.cause) for each in found)
        return f"{said}{here}; none of the findings is known to affect the mass: {names}."
    # in the order of the list: skipping a finding would suggest another order of likelihood
    first, others = found[0], len(found) - 1
    more = f", and {format_count(others, 'finding')} more" if others else ""
    change = describe_mass_change_if_fixed(first) or (
        "" if can_fixing_change_mass(first) else "not known to affect the mass"
    )
    return (
        f"{said}{here}; likeliest cause of an error: {find_readable_cause_name(first.cause)}"
        f"{f' ({change})' if change else ''}{more}."
    )


def _describe_moment_of_explanation(explanation: Explanation) -> str:
    stretch = next(
        (e for e in explanation.gate if e.start_s <= (explanation.at_s or 0.0) <= e.end_s), None
    )
    if stretch is None:
        return "there is no window"
    decided = _describe_time_span_of_gate_reason(stretch)
    if stretch.reason == "accepted":
        return f"the window is accepted{decided}"
    return f"the gate refuses the window for '{stretch.reason.replace('_', ' ')}'{decided}"


def _describe_time_span_of_gate_reason(reason_span: GateStretch) -> str:
    if reason_span.column is None or reason_span.value is None:
        return ""
    name, unit = _DECIDES[reason_span.column]
    value = format_number(round(reason_span.value, 3))
    return f" ({name} {value}, {reason_span.limit}{f' {unit}' if unit else ''})"


def iter_lines_of_findings(explanation: Explanation) -> Iterator[str]:
    """Yield lines on every finding by rank, with its consequence."""
    for each in explanation.findings or ():
        where = ", ".join(filter(None, (each.channel, format_finding_span(each))))
        name = find_readable_cause_name(each.cause)
        yield f"{each.rank}. {name}{f' ({where})' if where else ''}: {each.says}"
        for line in (
            each.evidence,
            describe_mass_change_if_fixed(each),
            format_proposed_machine_keys(each),
            describe_indistinguishable_causes(each),
            describe_consequence_of_finding(each),
        ):
            if line:
                yield f"   {line}"


def iter_lines_of_gate_reasons(explanation: Explanation) -> Iterator[str]:
    """Yield lines on the gate's reasons: in time around the moment, or else by share of time."""
    if explanation.at_s is not None:
        for each in explanation.gate:
            reason = each.reason.replace("_", " ")
            decision = _describe_time_span_of_gate_reason(each)
            yield f"{each.start_s:,.2f} to {each.end_s:,.2f} s: {reason}{decision}"
        return
    shares = [(name, share) for name, share in explanation.shares.items() if share >= 0.005]
    if shares:
        yield ", ".join(f"{name.replace('_', ' ')} {share:.0%}" for name, share in shares)


def iter_lines_of_determined_parameters(
    identifiability: DeterminedParameters | None,
) -> Iterator[str]:
    """Yield lines on which parameters the motion determines and which it does not."""
    if identifiability is None:
        return
    alone = ", ".join(_PARAMETERS[name] for name in identifiability.alone)
    if alone:
        yield f"determined separately: {alone}"
    for text in identifiability.combinations:
        said = text
        for name, words in _PARAMETERS.items():
            said = said.replace(name, words.removeprefix("a "))
        yield f"determined together only: {said}"
    if identifiability.lost:
        names = ", ".join(_PARAMETERS[name] for name in identifiability.lost)
        yield f"not determined: {names}; their estimates come from priors"
    for a, b, correlation in identifiability.trade_offs:
        yield (
            f"{_PARAMETERS[a]} and {_PARAMETERS[b]} trade off: their estimates are correlated by "
            f"{correlation:+.2f}"
        )


def describe_mass_of_manoeuvre(manoeuvre_report: ManoeuvreReport) -> str:
    """Describe a manoeuvre's mass and its distance from the load's, or why it has no mass."""
    span = f"{manoeuvre_report.start_s:,.1f} to {manoeuvre_report.end_s:,.1f} s"
    if manoeuvre_report.mass_kg is None:
        return f"{span}: no mass ({manoeuvre_report.reason.replace('_', ' ')})"
    mass = (
        f"{span}: {format_plus_minus(manoeuvre_report.mass_kg, manoeuvre_report.mass_std_kg)} kg "
        "on its own"
    )
    if manoeuvre_report.load_kg is None or manoeuvre_report.deviations is None:
        return mass
    apart = (
        f"{manoeuvre_report.deviations:+.1f} standard deviations from load "
        f"{manoeuvre_report.load_id}"
    )
    note = ", worth a look" if abs(manoeuvre_report.deviations) > _APART else ""
    return f"{mass}, {apart} ({format_number(manoeuvre_report.load_kg)} kg){note}"


def plot_explanation(
    run: Run, explanation: Explanation, path: Path, *, overwrites: bool = False
) -> Path:
    """Draw the picture of an explanation, and write it to a file.

    Args:
        run: explained run.
        explanation: the explanation.
        path: picture to write; the suffix sets the format.
        overwrites: whether to replace an existing file.

    Raises:
        OutputError: the picture cannot be written.
    """
    return write_picture(draw_explanation(run, explanation), path, overwrites=overwrites)


def draw_explanation(run: Run, explanation: Explanation) -> "Figure":
    """Draw the picture of `plot_explanation` without writing it."""
    from matplotlib.figure import Figure

    at_s = (
        explanation.at_s
        if explanation.at_s is not None
        else choose_moment_to_show_s(explanation, run)
    )
    near = run if at_s is None else _cut_run_around_moment(run, at_s)
    lines = wrap(describe_answer_and_likeliest_cause(explanation), _LINE)
    for each in (explanation.findings or ())[:_FINDINGS]:
        lines += wrap(f"{each.rank}. {format_finding(each)}", _LINE, subsequent_indent="   ")
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    # in inches, since the height of text is absolute
    heights = [0.2 * len(lines) + 0.15, _SIZE_IN[1]]
    head, body = figure.subfigures(2, 1, height_ratios=heights, squeeze=False)[:, 0]
    head.text(0.01, 0.95, "\n".join(lines), va="top", fontsize=9, parse_math=False)
    above, below = body.subfigures(2, 1, height_ratios=[1.0, 1.25], squeeze=False)[:, 0]
    left, right = above.subfigures(1, 2, width_ratios=[1.15, 1.0], squeeze=False)[0]
    scatter = left.subplots()
    draw_force_acceleration(scatter, run if explanation.at_s is None else near, explanation.at_s)
    left.suptitle("Force against acceleration", x=0.01, ha="left", fontsize=9)
    settles = right.subplots()
    settling = (
        run if explanation.at_s is None else _restrict_run_to_load_at_moment(run, explanation.at_s)
    )
    draw_convergence_of_estimates(settles, settling, explanation.at_s)
    right.suptitle("How the mass settles", x=0.01, ha="left", fontsize=9)
    if at_s is not None:
        which = "asked for" if explanation.at_s is not None else "which stands out most"
        title = f"The signals around {at_s:,.1f} s, {which}"
        below.suptitle(title, x=0.01, ha="left", fontsize=9)
    draw_views_over_time(below, MOMENT, near, make_display_frames(near, decimate=False), at_s)
    return figure


def choose_moment_to_show_s(explanation: Explanation, run: Run) -> float | None:
    """Choose the moment of the first finding that has one, or of the worst manoeuvre, in s.

    None, for the whole run, if the run is not much longer than the drawn stretch.
    """
    span = find_time_span_of_grid_ns(run)
    if span is None or span[1] - span[0] < 4 * _AROUND_S * NS_PER_S:
        return None
    for each in explanation.findings or ():
        if each.start_s is not None and each.end_s is not None:
            return (each.start_s + each.end_s) / 2.0
    if explanation.worst:
        return (explanation.worst[0].start_s + explanation.worst[0].end_s) / 2.0
    return None


def _cut_run_around_moment(run: Run, moment_s: float) -> Run:
    """Cut a run to the samples around a moment; frames without samples are kept whole."""
    start, end = (round((moment_s + way * _AROUND_S) * NS_PER_S) for way in (-1, 1))
    frames = {
        name: select_rows_between_times(frame, start, end) if "t_ns" in frame.columns else frame
        for name, frame in run.frames.items()
    }
    return Run(frames, run.provenance)


def select_rows_between_times(frame: pl.DataFrame, start_ns: int, end_ns: int) -> pl.DataFrame:
    """Select the samples of a stretch of a sorted frame, both ends inclusive."""
    t = frame["t_ns"].to_numpy()
    first, last = np.searchsorted(t, start_ns, "left"), np.searchsorted(t, end_ns, "right")
    return frame.slice(int(first), int(last - first))


def _restrict_run_to_load_at_moment(run: Run, moment_s: float | None) -> Run:
    """Restrict a run to the load at a moment; the whole run if there is none."""
    loads = run.frames.get("loads")
    if moment_s is None or loads is None:
        return run
    at = pl.lit(round(moment_s * NS_PER_S))
    here = loads.filter(at.is_between(pl.col("start_t_ns"), pl.col("end_t_ns")))
    if not here.height:
        return run
    load_id, start, end = here.select("load_id", "start_t_ns", "end_t_ns").row(0)
    frames = dict(run.frames)
    frames["loads"] = here
    if "manoeuvres" in frames:
        frames["manoeuvres"] = frames["manoeuvres"].filter(pl.col("load_id") == load_id)
    for name, frame in run.frames.items():
        if name.startswith("estimates/"):
            frames[name] = select_rows_between_times(frame, start, end)
    return Run(frames, run.provenance)
