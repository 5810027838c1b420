"""Frame `cycles`: a row a load that was dug, hauled and dumped, and what it weighs.

The payload is what was dumped: the loaded pass less the empty one. Both empty passes beside it tell
that: the one after by itself, the one before as far as what is carried back is alike. Their weights
are those of the smallest variance; where nothing is carried back, it is their mean.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.check import Verdict
from analysis.cycles.empty_machine import contradicted_empty_mass, states_of_passes
from analysis.cycles.parts import CycleParts, cycle_parts, dump_times
from analysis.cycles.passes import NO_PASSES, Passes, passes
from analysis.cycles.witnessed import digging_contradicts, with_witnessed
from analysis.machine import Machine
from analysis.schema import FRAMES, build
from analysis.uncertainty import combined
from analysis.weighing.budget import budget
from analysis.weighing.weigh import Weighing

Floats = NDArray[np.float64]

_NS: Final = 1e9
#: A payload is doubted when its standard uncertainty is this share of it.
_WEAK: Final = 0.25
#: The cleanest bucket is this quantile of the empty passes: the least of many is the noisiest.
_CLEANEST: Final = 0.1
_UNSEEN: Final = "dumped while nothing was recorded"
_CONTRADICTED: Final = "the boom dumps where no load is dumped by its mass"
_HAULED_TWICE: Final = "most buckets are filled once, and hauled more than once by their masses"
#: So few empty passes do not tell how what is carried back differs.
_FEWEST: Final = 4


@dataclass(frozen=True)
class _Common:
    """What is common to payloads: it does not average out.

    Attributes:
        shared_1: of all payloads together, as a share of them: it adds up over a shift.
        other_1: the part of it that is no nuisance of the fit, such as the scale.
        factor: (terms, passes) what a deviation of each nuisance moves each pass' mass by, in kg.
        covariance: (passes, passes) of what noise and scatter do to all of them.
    """

    shared_1: float
    other_1: float
    factor: Floats
    covariance: Floats

    def of(self, weights: Floats, payload_kg: float) -> tuple[float, float]:
        """Of one payload: all that is common, and how much of that is alike in all.

        Args:
            weights: (passes,) of each pass in it.
            payload_kg: what it is.
        """
        moved = self.factor @ weights
        own = float(moved @ moved + max(weights @ self.covariance @ weights, 0.0))
        shared_kg = self.shared_1 * abs(payload_kg)
        return max(float(np.hypot(np.sqrt(own), self.other_1 * payload_kg)), shared_kg), shared_kg


def cycles(
    weighing: Weighing | None,
    frames: dict[str, pl.DataFrame],
    machine: Machine,
    verdict: Verdict,
    known: Passes | None = None,
) -> pl.DataFrame:
    """Make `cycles`.

    See `cycles_and_weights`.
    """
    return cycles_and_weights(weighing, frames, machine, verdict, known)[0]


def cycles_and_weights(
    weighing: Weighing | None,
    frames: dict[str, pl.DataFrame],
    machine: Machine,
    verdict: Verdict,
    known: Passes | None = None,
) -> tuple[pl.DataFrame, dict[int, Floats]]:
    """Make `cycles`, and say of which masses each payload is a sum.

    Args:
        weighing: the joint fit, for what is common to all payloads.
        frames: `aligned`, `excitation`, `digging`, `loads` and `manoeuvres` of a run.
        machine: for the scale.
        verdict: what it forbids is withheld.
        known: the passes, where they are not to be looked for.

    Returns:
        The frame, and by the number of each cycle with a payload (masses,) weights of the fit's.
    """
    digs = frames["digging"]
    motion = frames["aligned"], frames["excitation"]
    found = known or passes(frames["loads"], frames["manoeuvres"], digs, *motion) or NO_PASSES
    twice = known is None and digging_contradicts(found, digs)
    found = NO_PASSES if twice else found
    parts = cycle_parts(found, digs)
    dump_times(parts, found, *motion)
    contradicts = False
    if known is None:
        parts, contradicts = with_witnessed(parts, found, digs, *motion)
    if not parts:
        return _frame([]), {}
    withheld = ", ".join(check.check for check in verdict.failed("mass"))
    withheld = _CONTRADICTED if contradicts else _HAULED_TWICE if twice else withheld
    if not withheld and frames["loads"]["withheld"].any():
        withheld = str(frames["loads"].filter("withheld")["withheld_for"][0])
    withheld = withheld or contradicted_empty_mass(weighing, machine, found)
    share = _tare_share(found)
    common = _common(weighing, machine, found, parts, share)
    cleanest = _cleanest(found)
    rows: list[dict[str, object]] = []
    known_sums = weighing is not None and weighing.fit.states is not None and bool(found.of.size)
    of_states = states_of_passes(weighing.fit, found) if weighing and known_sums else None
    sums: dict[int, Floats] = {}
    ready_ns = int(frames["excitation"]["t_ns"][0])
    counts = np.bincount(found.of)
    for number, part in enumerate(parts, start=1):
        row: dict[str, object] = {"cycle": number, **_times(part, ready_ns)}
        reason = withheld or _reason(part)
        if not reason:
            weights = pass_weights(part, share, found.mass_kg.size)
            row |= _masses(part, found, share, cleanest)
            row |= _uncertainty(row, common, weights)
            if of_states is not None:
                sums[number] = of_states @ weights
            row["manoeuvres"] = int(counts[part.loaded])
        row["quality"], row["counted"] = _quality(row, part)
        row["withheld_for"] = reason or _remark(row) or (_UNSEEN if part.unseen else "")
        rows.append(row)
        ready_ns = _ready_ns(part)
    return _frame(rows), sums


def _frame(rows: list[dict[str, object]]) -> pl.DataFrame:
    declared = FRAMES["cycles"].columns
    columns = {
        c.name: pl.Series([row.get(c.name) for row in rows], dtype=c.dtype) for c in declared
    }
    return build("cycles", columns)


def _times(part: CycleParts, ready_ns: int) -> dict[str, object]:
    """From one dump to the next, and what it is made of."""
    dig, haul, dump = part.dig_ns, part.haul_ns, part.dump_ns
    seen = [span for span in (dig, haul, dump) if span]
    return {
        "start_t_ns": min(ready_ns, seen[0][0]),
        "end_t_ns": seen[-1][1] if dump is None else part.dumped_ns,
        "dig_t_ns": dig and dig[0],
        "dump_t_ns": part.dumped_ns,
        "return_s": None if dig is None else max(dig[0] - ready_ns, 0) / _NS,
        "load_s": (haul[0] - dig[0]) / _NS if dig and haul else None,
        "haul_s": (dump[0] - haul[0]) / _NS if haul and dump and not part.unseen else None,
        "dump_s": (dump[1] - dump[0]) / _NS if dump and not part.unseen else None,
    }


def _ready_ns(part: CycleParts) -> int:
    """When the machine is through with a cycle."""
    seen = [span for span in (part.dig_ns, part.haul_ns, part.dump_ns) if span]
    return seen[-1][1]


def _reason(part: CycleParts) -> str:
    """Why a cycle has no mass, nothing where it has one."""
    if part.loaded is None:
        return "no start with this load tells a mass"
    if part.before is None and part.after is None:
        return "no empty pass to compare with"
    return ""


def _remark(row: dict[str, object]) -> str:
    return {
        "weak": "uncertain: more than a quarter of the payload",
        "not dumped": "the recording ends before it is dumped",
    }.get(str(row["quality"]), "")


def _quality(row: dict[str, object], part: CycleParts) -> tuple[str, bool]:
    payload_kg, u_kg = row.get("payload_kg"), row.get("payload_u_kg")
    if not isinstance(payload_kg, float) or not isinstance(u_kg, float):
        return "no mass", False
    if part.dump_ns is None:
        return "not dumped", False
    return ("weak" if u_kg > _WEAK * abs(payload_kg) else "good"), True


def _masses(
    part: CycleParts, found: Passes, share: Floats, cleanest: tuple[float, float]
) -> dict[str, object]:
    row: dict[str, object] = {}
    for name, number in (
        ("loaded", part.loaded),
        ("empty_before", part.before),
        ("empty_after", part.after),
    ):
        if number is not None:
            row[f"{name}_id"] = number
            row[f"{name}_kg"] = float(found.mass_kg[number])
            row[f"{name}_u_kg"] = float(found.u_kg[number])
    weights = pass_weights(part, share, found.mass_kg.size)
    payload_kg = float(weights @ found.mass_kg)
    random_kg = float(np.sqrt(weights**2 @ found.u_kg**2 + _carried_kg2(part, found, share)))
    row |= {
        "tare_before_1": 0.0 if part.before is None else -float(weights[part.before]),
        "payload_kg": payload_kg,
        "payload_u_random_kg": random_kg,
    }
    if part.after is not None:
        row["carry_back_kg"] = float(found.mass_kg[part.after]) - cleanest[0]
        row["carry_back_u_kg"] = float(np.hypot(found.u_kg[part.after], cleanest[1]))
    return row


def _uncertainty(row: dict[str, object], common: _Common, weights: Floats) -> dict[str, object]:
    """What a payload has in common with others, how much of it with all of them, and the whole."""
    payload_kg, random_kg = row["payload_kg"], row["payload_u_random_kg"]
    assert isinstance(payload_kg, float)
    assert isinstance(random_kg, float)
    common_kg, shared_kg = common.of(weights, payload_kg)
    return {
        "payload_u_common_kg": common_kg,
        "payload_u_shared_kg": shared_kg,
        "payload_u_kg": float(np.hypot(random_kg, common_kg)),
    }


def pass_weights(part: CycleParts, share: Floats, count: int) -> Floats:
    """(passes,) of each pass' mass in the payload.

    Args:
        part: the cycle.
        share: (passes,) weight of the empty pass before it, if there is one after it as well.
        count: passes.
    """
    weights = np.zeros(count)
    assert part.loaded is not None
    weights[part.loaded] = 1.0
    before, after = part.before, part.after
    if before is not None and after is not None:
        weights[before] -= share[part.loaded]
        weights[after] -= 1.0 - share[part.loaded]
    else:
        weights[after if before is None else before] = -1.0
    return weights


def _carried_variance(found: Passes) -> float:
    """Variance of what is carried back, in kg²: what empty passes differ by beyond their noise."""
    mass, u = found.mass_kg[~found.loaded], found.u_kg[~found.loaded]
    if mass.size < _FEWEST:
        return 0.0
    # neighbours, since fuel is burnt
    return max(float(np.mean(np.diff(mass) ** 2 - u[1:] ** 2 - u[:-1] ** 2)) / 2.0, 0.0)


def _tare_share(found: Passes) -> Floats:
    """(passes,) the weight of the empty pass before each loaded one: the smallest variance."""
    share = np.full(found.mass_kg.size, 0.5)
    empties = np.flatnonzero(~found.loaded)
    spread = 2.0 * _carried_variance(found)
    for loaded in np.flatnonzero(found.loaded):
        place = int(np.searchsorted(empties, loaded))
        if 0 < place < empties.size:
            before, after = found.u_kg[empties[place - 1]] ** 2, found.u_kg[empties[place]] ** 2
            share[loaded] = after / (spread + before + after)
    return share


def _carried_kg2(part: CycleParts, found: Passes, share: Floats) -> float:
    """What a payload is off since another load was carried back before, as a variance."""
    variance = 2.0 * _carried_variance(found)
    if part.loaded is None:
        return 0.0
    before = 0.0 if part.before is None else 1.0 if part.after is None else share[part.loaded]
    # an empty pass beyond the next load has another cycle's
    own = part.after is None or part.after == part.loaded + 1
    after = 0.0 if own else 1.0 - before
    return variance * (before**2 + after**2)


def _cleanest(found: Passes) -> tuple[float, float]:
    """The mass of the machine with a clean bucket, and its uncertainty.

    The spread of empty passes is more than that of what they carry: quantiles are drawn towards the
    mean by the share of the variance that is noise.
    """
    mass, u = found.mass_kg[~found.loaded], found.u_kg[~found.loaded]
    if not mass.size:
        return float("nan"), float("nan")
    noise = float(np.mean(u**2))
    true = _carried_variance(found)
    kept = float(np.sqrt(true / (true + noise))) if true + noise > 0 else 0.0
    middle = float(np.mean(mass))
    least = middle + kept * (float(np.quantile(mass, _CLEANEST)) - middle)
    return least, float(np.sqrt(noise / mass.size + true * (1.0 - kept)))


def _common(
    weighing: Weighing | None,
    machine: Machine,
    found: Passes,
    parts: list[CycleParts],
    tare: Floats,
) -> _Common:
    """Find it with the fit's own correlations.

    Of all payloads together it is what the fit's budget has besides what the passes' own noise and
    scatter add up to. One payload also has what nuisances do to its own starts and not to others'.
    """
    count = found.mass_kg.size
    nothing = _Common(0.0, 0.0, np.zeros((0, count)), np.zeros((count, count)))
    whole = [p for p in parts if p.loaded is not None and (p.before, p.after) != (None, None)]
    if weighing is None or weighing.fit.states is None or not whole:
        return nothing
    fit = weighing.fit
    of_states = states_of_passes(fit, found)
    weights = np.sum([pass_weights(part, tare, count) for part in whole], axis=0)
    sources = budget(weighing, machine, of_states @ weights)
    total_kg = max(abs(float(weights @ found.mass_kg)), 1e-9)
    kept = combined(sources, "random") ** 2 - float(weights**2 @ found.u_kg**2)
    common = combined(sources, "common", "scale")
    names = {term.source or term.name for term in fit.terms}
    other = [s for s in sources if s.kind != "random" and s.name not in names]
    masses = slice(0, fit.count)
    covariance = of_states.T @ (fit.fit.noise + fit.fit.scatter)[masses, masses] @ of_states
    return _Common(
        float(np.sqrt(common**2 + max(kept, 0.0))) / total_kg,
        combined(other) / total_kg,
        fit.term_responses @ of_states,
        covariance - np.diag(found.u_kg**2),
    )
