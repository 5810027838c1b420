"""Explanation in words: the answer in one sentence, then the reasons line by line."""

from collections.abc import Iterator
from typing import Final

from analysis.explain import DeterminedParameters, Explanation
from analysis.explain.worst_manoeuvres import GateStretch, ManoeuvreReport
from estimators.errors import counted
from recordings.report.finding_text import (
    cause_name,
    consequence_text,
    finding_span_text,
    indistinguishable_causes_text,
    mass_change_if_fixed_text,
    may_change_mass,
    proposed_keys_text,
)
from recordings.report.number_text import format_number, format_plus_minus
from recordings.rrd.recording_texts import answer_headline

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
#: Standard deviations beyond which a manoeuvre is worth a look.
_APART: Final = 3.0


def answer_and_cause_sentence(explanation: Explanation) -> str:
    """The answer and the likeliest cause of an error, in one sentence."""
    said = answer_headline(explanation.answer).removesuffix(".")
    here = (
        ""
        if explanation.at_s is None
        else f"; at {explanation.at_s:g} s {_describe_moment(explanation)}"
    )
    found = explanation.findings
    if found is None:
        return f"{said}{here}; this recording has no findings: replay the log."
    if not found:
        return f"{said}{here}; none of the known causes of an error was detected."
    if not any(map(may_change_mass, found)):
        names = ", ".join(cause_name(each.cause) for each in found)
        return f"{said}{here}; none of the findings is known to affect the mass: {names}."
    # the list's own order: a sentence that skips would be another order of likelihood
    first, others = found[0], len(found) - 1
    more = f", and {counted(others, 'finding')} more" if others else ""
    change = mass_change_if_fixed_text(first) or (
        "" if may_change_mass(first) else "not known to affect the mass"
    )
    return (
        f"{said}{here}; likeliest cause of an error: {cause_name(first.cause)}"
        f"{f' ({change})' if change else ''}{more}."
    )


def _describe_moment(explanation: Explanation) -> str:
    stretch = next(
        (e for e in explanation.gate if e.start_s <= (explanation.at_s or 0.0) <= e.end_s), None
    )
    if stretch is None:
        return "there is no window"
    decided = _describe_gate_stretch(stretch)
    if stretch.reason == "accepted":
        return f"the window is accepted{decided}"
    return f"the gate refuses the window for '{stretch.reason.replace('_', ' ')}'{decided}"


def _describe_gate_stretch(stretch: GateStretch) -> str:
    if stretch.column is None or stretch.value is None:
        return ""
    name, unit = _DECIDES[stretch.column]
    value = format_number(round(stretch.value, 3))
    return f" ({name} {value}, {stretch.limit}{f' {unit}' if unit else ''})"


def iter_finding_lines(explanation: Explanation) -> Iterator[str]:
    """Yield lines on every finding by rank, with its consequence."""
    for each in explanation.findings or ():
        where = ", ".join(filter(None, (each.channel, finding_span_text(each))))
        yield f"{each.rank}. {cause_name(each.cause)}{f' ({where})' if where else ''}: {each.says}"
        for line in (
            each.evidence,
            mass_change_if_fixed_text(each),
            proposed_keys_text(each),
            indistinguishable_causes_text(each),
            consequence_text(each),
        ):
            if line:
                yield f"   {line}"


def iter_gate_lines(explanation: Explanation) -> Iterator[str]:
    """Yield lines on the gate's reasons: around the moment in order, otherwise by share."""
    if explanation.at_s is not None:
        for each in explanation.gate:
            reason = each.reason.replace("_", " ")
            decision = _describe_gate_stretch(each)
            yield f"{each.start_s:,.2f} to {each.end_s:,.2f} s: {reason}{decision}"
        return
    shares = [(name, share) for name, share in explanation.shares.items() if share >= 0.005]
    if shares:
        yield ", ".join(f"{name.replace('_', ' ')} {share:.0%}" for name, share in shares)


def determined_parameter_lines(identifiability: DeterminedParameters | None) -> Iterator[str]:
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


def manoeuvre_line(report: ManoeuvreReport) -> str:
    """Line on a manoeuvre's mass and that of its load, or why it has no mass."""
    span = f"{report.start_s:,.1f} to {report.end_s:,.1f} s"
    if report.mass_kg is None:
        return f"{span}: no mass ({report.reason.replace('_', ' ')})"
    mass = f"{span}: {format_plus_minus(report.mass_kg, report.mass_std_kg)} kg on its own"
    if report.load_kg is None or report.deviations is None:
        return mass
    apart = f"{report.deviations:+.1f} standard deviations from load {report.load_id}"
    note = ", worth a look" if abs(report.deviations) > _APART else ""
    return f"{mass}, {apart} ({format_number(report.load_kg)} kg){note}"
