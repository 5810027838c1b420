"""What is tried of findings: a fault of the size that bends the mass by 1, 3 or 10 deviations.

The deviation is the answer's random one (`u_random_kg`), of the log without the fault. The joint
fit takes most faults out of the answer, so that none of any size would bend it by ten deviations;
the size is then set by the error of the paper's pooled estimate: the larger of both errors counts.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from benchmarks.findings_rows import AXES, Found, design, found, needed, replayed
from estimators.errors import PayscopeError
from tests.trials.drawn_designs import Sections, join_designs
from tests.trials.fault_injection import FAULTS, Fault

SEVERITIES: Final = (1.0, 3.0, 10.0)
BY_NAME: Final = {fault.name: fault for fault in FAULTS}
#: A size is found when it bends the mass by what it should within this factor.
_NEAR: Final = 1.35
_ROUNDS: Final = 7
#: So often by the secant.
_SECANTS: Final = 3
#: No error at all is taken for this.
_LEAST: Final = 0.02
_FIRST: Final = 3.0


@dataclass(frozen=True)
class Trial:
    """One log with one fault, or two.

    Attributes:
        faults: their names.
        severity: asked for; by what the larger of both errors is.
        reached: what it was.
        size: of the first fault.
        seed: of the design.
        first: what was named first, by itself.
        places: where each fault was named, None where it was not.
        claimed: of the first fault's own finding, what it says mending would do, and ± that.
        true_kg: what it does to the answer.
        names: of all findings in their order.
    """

    faults: tuple[str, ...]
    severity: float
    reached: float
    size: float
    seed: int
    first: str
    places: tuple[int | None, ...]
    claimed: tuple[float, float] | None
    true_kg: float | None
    names: tuple[str, ...]

    @property
    def is_of_its_size(self) -> bool:
        """Whether it bends the mass as was asked, where that is what its size means."""
        if BY_NAME[self.faults[0]].largest is None:
            return True
        return self.severity / 2.0 <= self.reached <= 2.0 * self.severity


def base(seed: int, faults: Sequence[Fault]) -> Sections:
    """The design of a seed in which the faults can be seen."""
    return needed(design(seed, odd=False), faults)


def clean(seed: int, faults: Sequence[Fault]) -> Found:
    """What the log without them says."""
    overrides = [override for fault in faults for override in fault.overrides]
    return _clean(json.dumps(base(seed, faults)), tuple(overrides))


@lru_cache(maxsize=8)
def _clean(sections: str, overrides: tuple[str, ...]) -> Found:
    """Most faults need nothing, so that theirs is one log."""
    return found(replayed(json.loads(sections), (), AXES, overrides))


def tried(sections: Sections, faults: Sequence[tuple[Fault, float]]) -> Found | None:
    """What the log with them says; None where no machine can drive like that."""
    try:
        return found(replayed(sections, faults))
    except PayscopeError:
        return None


def errors(without: Found, of: Found) -> float:
    """By how many deviations the answer or the pooled estimate is bent, whichever is more."""
    u_kg = without.u_random_kg or np.nan
    apart = [
        abs(bent - straight)
        for bent, straight in ((of.mass_kg, without.mass_kg), (of.pooled_kg, without.pooled_kg))
        if bent is not None and straight is not None
    ]
    return max(apart, default=np.nan) / u_kg


def trials_of(fault: Fault, seed: int) -> list[Trial]:
    """A fault in one design at all severities."""
    sections, without = base(seed, [fault]), clean(seed, [fault])
    if without.mass_kg is None or not without.u_random_kg:
        return []
    out: list[Trial] = []
    if fault.largest is None:
        for severity in SEVERITIES:
            if fault.ground is not None:
                sections = join_designs(base(seed, [fault]), fault.ground(sections, severity))
                without = found(replayed(sections))
            if out and not fault.has_size:
                out.append(replace(out[0], severity=severity, size=severity))
                continue
            of = tried(sections, [(fault, severity)])
            if of is not None:
                out.append(_trial([(fault, severity)], severity, seed, without, of))
        return out
    size = min(_FIRST, fault.largest)
    for severity in reversed(SEVERITIES):
        size, of = _sized(fault, size, severity, sections, without)
        if of is not None:
            out.append(_trial([(fault, size)], severity, seed, without, of))
        size *= 0.3
    return out


def _sized(
    fault: Fault, size: float, severity: float, sections: Sections, without: Found
) -> tuple[float, Found | None]:
    """The size that bends the mass so: by the secant through 0, then by halving."""
    assert fault.largest is not None
    of: Found | None = None
    least, most = 0.0, fault.largest
    for number in range(_ROUNDS):
        of = tried(sections, [(fault, size)])
        reached = np.inf if of is None else max(errors(without, of), _LEAST)
        if of is not None and not np.isfinite(reached):
            break
        factor = severity / reached
        if 1.0 / _NEAR < factor < _NEAR or number == _ROUNDS - 1:
            break
        if factor > 1.0:
            least = max(least, size)
        else:
            most = min(most, size)
        wanted = size * float(np.clip(factor, 0.1, 6.0))
        if not least < wanted < most or number >= _SECANTS:
            wanted = float(np.sqrt(max(least, 0.05 * most) * most))
        if most - least < 0.01 * most or abs(wanted - size) < 0.01 * size:
            break
        size = wanted
    return size, of


def pair(first: Fault, second: Fault, sizes: tuple[float, float], seed: int) -> Trial | None:
    """Two faults at once, each of the size that it has alone."""
    faults = [(first, sizes[0]), (second, sizes[1])]
    of = tried(base(seed, [first, second]), faults)
    if of is None:
        return None
    return _trial(faults, 10.0, seed, clean(seed, [first, second]), of)


def _trial(
    faults: Sequence[tuple[Fault, float]], severity: float, seed: int, without: Found, of: Found
) -> Trial:
    keys = faults[0][0].causes
    claim = next((c for c in of.changes if c[0] in keys), None)
    if claim is None:
        place = of.place(keys)
        named = None if place is None else of.causes[place - 1][0]
        claim = next((c for c in of.changes if c[0] == named), None)
    both = of.mass_kg is not None and without.mass_kg is not None
    return Trial(
        faults=tuple(fault.name for fault, _ in faults),
        severity=severity,
        reached=float(errors(without, of)),
        size=faults[0][1],
        seed=seed,
        first=of.causes[0][0] if of.causes else "",
        places=tuple(of.place(fault.causes) for fault, _ in faults),
        claimed=None if claim is None else (claim[1], claim[2]),
        true_kg=(without.mass_kg or 0.0) - (of.mass_kg or 0.0) if both else None,
        names=tuple(each[0] for each in of.causes),
    )


@dataclass(frozen=True)
class DelayTrial:
    """A delay of the force, and what the likelihood finds."""

    true_s: float
    found_s: float
    seed: int


#: Where a log's delay is put into its settings: what is proposed is what was found.
_DELAYS: Final = tuple(round(0.01 * step, 2) for step in range(9))
#: The notes' noise, on the paper's loader.
_NOTES: Final[Sections] = {
    "machine": {"mass_kg": 3614.0},
    "campaign": {"loads_kg": [0.0], "runs": 9, "throttle_force_N": 6000.0},
}


def delays(seed: int) -> list[DelayTrial]:
    """The paper's loader, nine starts, with every delay of the force."""
    out: list[DelayTrial] = []
    for true_s in _DELAYS:
        sensors = {"force_delay_s": true_s, "seed": seed}
        replay = replayed(join_designs(_NOTES, {"sensors": sensors}), (), ())
        terms = replay.frames["nuisances"].to_dicts()
        fallback = next(row["posterior"] for row in terms if row["term"] == "lag")
        named = [
            row
            for row in replay.frames["findings"].to_dicts()
            if row["cause"] == "delay" and (row["channel"] or "").startswith("torque")
        ]
        found_s = float(named[0]["value"].split(", ")[0]) if named else float(fallback)
        out.append(DelayTrial(true_s, found_s, seed))
    return out
