"""The tables of docs/findings.md, made of trials."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from analysis.findings import CAUSES
from benchmarks.findings_trials import BY_NAME, SEVERITIES, DelayTrial, Trial
from benchmarks.page import markdown
from tests.trials.fault_injection import FAULTS

_MOST_CONFUSED: Final = 3


def of_faults(trials: Sequence[Trial]) -> str:
    """By fault: how often it is named first, what stands in its place, and the kilograms."""
    lines: list[list[str]] = []
    for fault in FAULTS:
        mine = [each for each in trials if each.faults == (fault.name,)]
        by_severity = [[each for each in mine if each.severity == s] for s in SEVERITIES]
        worst = list(by_severity[-1])
        kind = "deviations" if fault.largest is not None else "sizes"
        lines.append(
            [
                fault.name,
                ", ".join(fault.causes),
                fault.said,
                kind,
                *(_share(part) for part in by_severity),
                f"{np.nanmedian([t.reached for t in worst]):.1f}" if _told(worst) else "–",
                _confused(mine),
                _kilograms(mine),
            ]
        )
    head = ["fault", "cause", "size 1", "1, 3, 10 are", "1", "3", "10", "reached at 10"]
    return markdown([*head, "else first", "kg hold"], lines)


def _told(trials: Iterable[Trial]) -> bool:
    return any(np.isfinite(each.reached) for each in trials)


def _share(trials: Sequence[Trial]) -> str:
    return f"{sum(each.places[0] == 1 for each in trials)} of {len(trials)}" if trials else "–"


def _confused(trials: Iterable[Trial]) -> str:
    others = Counter(each.first or "nothing" for each in trials if each.places[0] != 1)
    return ", ".join(f"{name} {n}" for name, n in others.most_common(_MOST_CONFUSED)) or "–"


def _holds(trial: Trial) -> bool | None:
    if trial.claimed is None or trial.true_kg is None:
        return None
    kg, u_kg = trial.claimed
    return abs(kg - trial.true_kg) <= 2.0 * u_kg


def _kilograms(trials: Iterable[Trial]) -> str:
    held = [each for trial in trials if (each := _holds(trial)) is not None]
    return f"{sum(held)} of {len(held)}" if held else "–"


def of_totals(trials: Sequence[Trial], pairs: Sequence[Trial]) -> str:
    """Of all faults together."""
    lines: list[list[str]] = []
    for severity in SEVERITIES:
        mine = [t for t in trials if t.severity == severity]
        first = sum(t.places[0] == 1 for t in mine)
        below = [
            name
            for name in BY_NAME
            if (part := [t for t in mine if t.faults == (name,)])
            and sum(t.places[0] == 1 for t in part) < _least(severity) * len(part)
        ]
        lines.append(
            [f"named first at {severity:g}", f"{first} of {len(mine)}", _percent(first, len(mine))]
        )
        if severity > 1.0:
            target = "45 of 50" if severity == 3.0 else "48 of 50"
            lines.append(
                [f"faults below {target} at {severity:g}", str(len(below)), ", ".join(below)]
            )
    both = sum(all(p is not None and p <= 3 for p in t.places) for t in pairs)
    lines.append(
        [
            "two at 10, both among the first three",
            f"{both} of {len(pairs)}",
            _percent(both, len(pairs)),
        ]
    )
    held = [each for trial in trials if (each := _holds(trial)) is not None]
    lines.append(
        ["kilograms within 2 u", f"{sum(held)} of {len(held)}", _percent(sum(held), len(held))]
    )
    return markdown(["all faults", "logs", "share"], lines)


def _least(severity: float) -> float:
    return {1.0: 0.0, 3.0: 45.0 / 50.0, 10.0: 48.0 / 50.0}[severity]


def _percent(part: float, whole: float) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "–"


def of_matrix(trials: Sequence[Trial]) -> str:
    """The confusion matrix at the severities 3 and 10: what is named first, by fault."""
    mine = [each for each in trials if each.severity > 1.0]
    counts = Counter((t.faults[0], _named(t)) for t in mine)
    named = [cause.key for cause in CAUSES if any(key == cause.key for _, key in counts)]
    named += ["nothing"] if any(key == "nothing" for _, key in counts) else []
    numbers = {key: str(number) for number, key in enumerate(named, 1)}
    lines = [
        [fault.name, *(str(counts[fault.name, key] or "") for key in named)]
        for fault in FAULTS
        if any(name == fault.name for name, _ in counts)
    ]
    legend = ", ".join(f"{number} {key}" for key, number in numbers.items())
    return markdown(["fault", *numbers.values()], lines) + f"\n\nNamed first: {legend}."


def _named(trial: Trial) -> str:
    """What stands first; its cause where it is named in a class."""
    if trial.places[0] == 1:
        own = BY_NAME[trial.faults[0]].causes
        return trial.first if trial.first in own else own[0]
    return trial.first or "nothing"


def of_clean(clean: Sequence[tuple[int, bool, tuple[str, ...]]]) -> str:
    """Logs without a fault: seed, whether the machine is unlike the model, findings."""
    lines: list[list[str]] = []
    for odd, name in ((False, "as the model has it"), (True, "unlike the model")):
        mine = [names for _, is_odd, names in clean if is_odd is odd]
        false = [names for names in mine if names]
        causes = Counter(name for names in false for name in names)
        lines.append(
            [
                name,
                str(len(mine)),
                str(len(false)),
                _percent(len(false), len(mine)),
                ", ".join(f"{key} {n}" for key, n in causes.most_common()) or "–",
            ]
        )
    total = sum(bool(names) for *_, names in clean)
    lines.append(["all", str(len(clean)), str(total), _percent(total, len(clean)), ""])
    return markdown(["clean machines", "logs", "with a finding", "share", "findings"], lines)


def of_delays(trials: Sequence[DelayTrial]) -> str:
    """Delays of the force and what is said of them."""
    lines: list[list[str]] = []
    for true_s in sorted({t.true_s for t in trials}):
        mine = [t for t in trials if t.true_s == true_s]
        off = np.array([t.found_s - true_s for t in mine])
        lines.append(
            [
                f"{1e3 * true_s:.0f} ms",
                str(len(mine)),
                f"{1e3 * float(np.mean(off)):+.1f} ms",
                f"{1e3 * float(np.std(off)):.1f} ms",
                _percent(float((np.abs(off) <= 5e-3).sum()), off.size),
            ]
        )
    return markdown(["delay of the force", "logs", "mean error", "scatter", "within 5 ms"], lines)


def of_needs() -> str:
    """What each cause is, and needs to be seen at all."""
    lines = [[cause.key, cause.statement, cause.needs] for cause in CAUSES]
    return markdown(["cause", "what it is", "what a log must hold"], lines)
