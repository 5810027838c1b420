"""What the answer is worth, in lines: mass and payload, other priors, where the uncertainty is."""

from collections.abc import Mapping
from typing import Any, Final

from analysis.answer import Answer
from recordings.wording import number, plus_minus

#: Characters of the longest bar.
_BAR: Final = 24
#: Smaller shares of the variance are not listed.
_SMALL: Final = 0.005
#: A normal distribution's 95 %.
_COVERAGE: Final = 1.96


def load_lines(load: Mapping[str, Any]) -> list[str]:
    """Mass, payload and their sensitivity to the priors; or the reason why there is none."""
    if load.get("mass_kg") is None:
        return [f"no mass: {load.get('withheld_for') or 'nothing was fitted'}"]
    mass, u = load["mass_kg"], load["u_kg"]
    low, high = mass - _COVERAGE * u, mass + _COVERAGE * u
    lines = [
        f"mass {plus_minus(mass, u)} kg (standard uncertainty), 95 %: "
        f"{number(low)} to {number(high)} kg, from {load['manoeuvres']} "
        f"{'stretch' if load['manoeuvres'] == 1 else 'stretches'}"
    ]
    if load["payload_kg"] is not None:
        lines.append(f"payload {plus_minus(load['payload_kg'], load['payload_u_kg'])} kg")
    lines.append(
        f"with priors half as wide {number(load['mass_halved_priors_kg'])} kg, "
        f"twice as wide {number(load['mass_doubled_priors_kg'])} kg"
    )
    if load["scale_unknown"]:
        lines.append(
            f"scale not known: the machine file gives no uncertainty of {load['scale_unknown']}, "
            "so none is in the ±"
        )
    if load["braking_left_out"]:
        lines.append("braking and driving disagree about the mass, and braking was left out")
    return lines


def budget_rows(said: Answer, mark: str = "█") -> list[tuple[str, str, str, str, str]]:
    """Source, kind, u in kg, a bar of its share of the variance, and what would shrink it."""
    rows: list[tuple[str, str, str, str, str]] = []
    for source in said.budget:
        share = source["share_1"]
        if source["u_kg"] is None:
            rows.append((source["cause"], source["kind"], "not known", "", source["shrinks"]))
        elif share is not None and share >= _SMALL:
            bar = mark * max(1, round(share * _BAR))
            cells = (f"{bar} {share:.0%}", source["shrinks"])
            rows.append((source["cause"], source["kind"], f"{source['u_kg']:.3g}", *cells))
    return rows


def advice(said: Answer) -> str | None:
    """What would shrink the uncertainty most; None without an answer."""
    known = [source for source in said.budget if source["u_kg"]]
    if not known or not any(load["mass_kg"] is not None for load in said.loads):
        return None
    most = known[0]
    said_of_it = f"{most['cause']} ({most['meaning']})"
    return f"most of it is {said_of_it}; it would shrink with: {most['shrinks']}"
