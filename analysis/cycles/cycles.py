"""Frame `cycles`: a row per load that was dug, hauled and dumped, with its mass.

The payload is the dumped mass: the mass of the loaded pass minus that of the empty machine. The
empty pass after it gives the latter directly, and the empty pass before it as far as the carry-back
is the same. Their weights minimise the variance; without carry-back they are equal.

If the machine file states the mass of the empty machine with its uncertainty, the empty passes
determine the scale of the payloads.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.cycle_parts import CycleParts
from analysis.cycles.cycles_without_mass import do_digs_contradict_loaded_passes, find_cycle_parts
from analysis.cycles.empty_machine import (
    BY_EMPTY_MACHINE,
    BY_MACHINE_FILE,
    ShiftScale,
    compute_state_weights_of_passes,
    estimate_carry_back_variance_kg2,
    estimate_clean_machine_mass_and_u_kg,
    weigh_empty_machine,
)
from analysis.cycles.haul_spillage import subtract_spillage
from analysis.cycles.load_passes import NO_PASSES, LoadPasses, find_load_passes
from analysis.model.machine import Machine
from analysis.model.physical_units import NS_PER_S
from analysis.model.schema import FRAMES, build_frame
from analysis.model.uncertainty_sources import combine_u, list_scale_sources_without_u
from analysis.model.verdict import Verdict
from analysis.weighing.empty_mass_datum import EmptyDatum, EmptyMachine, list_payload_uncertainties
from analysis.weighing.fuel_on_board import FuelOnBoard
from analysis.weighing.weigh import Weighing
from estimators.arrays import Floats

_UNSEEN: Final = "dumped while nothing was recorded"
_CONTRADICTED: Final = "at many dumps of the boom the mass does not change, or not certainly"
_HAULED_TWICE: Final = "most buckets are filled once, but their masses show more than one haul each"


class LogCycles(NamedTuple):
    """Cycles of a log.

    Attributes:
        cycles: the frame `cycles`.
        sums: (masses,) weights of the fit's masses in each payload, by number of the cycle.
        scale: source of the payloads' scale.
    """

    cycles: pl.DataFrame
    sums: dict[int, Floats]
    scale: ShiftScale


@dataclass(frozen=True)
class _CommonUncertainty:
    """Uncertainty common to payloads, which does not average out.

    Attributes:
        shared_1: relative uncertainty by errors shared by all payloads, which add up over a shift.
        other_1: part of `shared_1` that is not by nuisances of the fit, such as the scale.
        factor: (terms, passes) response of each pass' mass to one standard deviation of each
            nuisance, in kg.
        covariance: (passes, passes) covariance due to noise and scatter.
        empty: (passes,) additional weight of each pass' errors per kg of payload, by the datum.
    """

    shared_1: float
    other_1: float
    factor: Floats
    covariance: Floats
    empty: Floats

    def compute_common_u_kg(self, weights: Floats, payload_kg: float) -> tuple[float, float]:
        """Common uncertainty of one payload, and the part shared by all payloads, in kg.

        Args:
            weights: (passes,) weight of each pass in the payload.
            payload_kg: the payload, uncalibrated.
        """
        weights = weights + payload_kg * self.empty
        moved = self.factor @ weights
        own = float(moved @ moved + max(weights @ self.covariance @ weights, 0.0))
        shared_kg = self.shared_1 * abs(payload_kg)
        return max(float(np.hypot(np.sqrt(own), self.other_1 * payload_kg)), shared_kg), shared_kg


def weigh_cycles(
    weighing: Weighing | None,
    frames: dict[str, pl.DataFrame],
    machine: Machine,
    verdict: Verdict,
    passes: LoadPasses | None = None,
) -> LogCycles:
    """Make `cycles`, with the weights of the masses in each payload and the source of the scale.

    Args:
        weighing: joint fit, for the uncertainty common to all payloads.
        frames: `aligned`, `excitation`, `digging`, `loads` and `manoeuvres` of a run.
        machine: machine file, for scale and fuel.
        verdict: the verdict, which may withhold quantities.
        passes: the passes, if already found.
    """
    digging, motion = frames["digging"], (frames["aligned"], frames["excitation"])
    masses = frames["loads"], frames["manoeuvres"]
    drift = None if weighing is None else weighing.significant_empty_mass_drift
    drift_1 = 0.0 if drift is None else drift.nearby_1.mean(axis=0)
    found = passes or find_load_passes(*masses, digging, *motion, drift_1) or NO_PASSES
    twice = passes is None and do_digs_contradict_loaded_passes(found, digging)
    found = NO_PASSES if twice else found
    excluded = weighing.growing_load_manoeuvres if weighing and passes is None else ()
    parts, contradicts = find_cycle_parts(found, frames, excluded, adds_boom=passes is None)
    if not parts:
        return LogCycles(_make_cycle_frame([]), {}, ShiftScale())
    withheld = ", ".join(check.check for check in verdict.list_withholding_checks("mass"))
    withheld = _CONTRADICTED if contradicts else _HAULED_TWICE if twice else withheld
    if not withheld and frames["loads"]["withheld"].any():
        withheld = str(frames["loads"].filter("withheld")["withheld_for"][0])
    fuel = FuelOnBoard.integrate_fuel_rate(machine.machine, motion[0])
    empty = weigh_empty_machine(weighing, machine, found, fuel)
    withheld = withheld or (empty.empty_mass_contradiction_text if empty else "")
    share = compute_tare_coefficient_before_each_pass(found)
    worth = compute_common_payload_u_on_own_and_empty_scale(
        weighing, machine, found, sum_pass_weights_of_payloads(found, parts, share), empty
    )
    clean = estimate_clean_machine_mass_and_u_kg(found)
    rows: list[dict[str, object]] = []
    counts = np.bincount(found.pass_of_manoeuvre)
    fit = weighing.fit if weighing and weighing.fit.states and counts.size else None
    of_states = None if fit is None else compute_state_weights_of_passes(fit, found)
    sums, ready_ns = dict[int, Floats](), int(motion[1]["t_ns"][0])
    for number, part in enumerate(parts, start=1):
        row: dict[str, object] = {"cycle": number, **_make_cycle_time_columns(part, ready_ns)}
        reason = withheld or part.missing_mass_reason
        if not reason:
            weights = part.compute_weights_of_passes_in_payload(share, found.mass_kg.size)
            row |= _make_payload_row(part, found, share, clean)
            row |= make_payload_uncertainty_columns(row, worth, weights)
            if of_states is not None:
                sums[number] = of_states @ weights
            row["manoeuvres"] = int(counts[part.loaded_pass])
        row["quality"], row["counted"] = _explain_if_payload_counts(row, part)
        row["withheld_for"] = reason or _make_cycle_note(row) or (_UNSEEN if part.unseen else "")
        rows.append(row)
        ready_ns = part.end_of_last_part_ns
    table = subtract_spillage(_make_cycle_frame(rows), parts, found, frames, machine.machine)
    return LogCycles(table, sums, worth.scale)


def _make_cycle_frame(rows: list[dict[str, object]]) -> pl.DataFrame:
    declared = FRAMES["cycles"].columns
    columns = {
        c.name: pl.Series([row.get(c.name) for row in rows], dtype=c.dtype) for c in declared
    }
    return build_frame("cycles", columns)


def _make_cycle_time_columns(cycle: CycleParts, ready_ns: int) -> dict[str, object]:
    """Times and parts of a cycle, from one dump to the next."""
    dig, haul, dump = cycle.dig_ns, cycle.haul_ns, cycle.dump_ns
    seen = [span for span in (dig, haul, dump) if span]
    return {
        "start_t_ns": min(ready_ns, seen[0][0]),
        "end_t_ns": cycle.end_of_last_part_ns if dump is None else cycle.bucket_emptied_ns,
        "dig_t_ns": dig and dig[0],
        "dump_t_ns": cycle.bucket_emptied_ns,
        "return_s": None if dig is None else max(dig[0] - ready_ns, 0) / NS_PER_S,
        "load_s": (haul[0] - dig[0]) / NS_PER_S if dig and haul else None,
        "haul_s": (dump[0] - haul[0]) / NS_PER_S if haul and dump and not cycle.unseen else None,
        "dump_s": (dump[1] - dump[0]) / NS_PER_S if dump and not cycle.unseen else None,
    }


def _make_cycle_note(cycle_row: dict[str, object]) -> str:
    return {
        "weak": "its uncertainty is above a quarter of the payload",
        "not dumped": "the recording ends before the dump",
    }.get(str(cycle_row["quality"]), "")


def _explain_if_payload_counts(cycle_row: dict[str, object], cycle: CycleParts) -> tuple[str, bool]:
    payload_kg, u_kg = cycle_row.get("payload_kg"), cycle_row.get("payload_u_kg")
    if not isinstance(payload_kg, float) or not isinstance(u_kg, float):
        return "no mass", False
    if cycle.dump_ns is None:
        return "not dumped", False
    return ("weak" if u_kg > LIMITS.doubtful_payload_u * abs(payload_kg) else "good"), True


def _make_payload_row(
    cycle: CycleParts, passes: LoadPasses, tare_coefficients: Floats, clean: tuple[float, float]
) -> dict[str, object]:
    row: dict[str, object] = {}
    for name, number in (
        ("loaded", cycle.loaded_pass),
        ("empty_before", cycle.empty_pass_before),
        ("empty_after", cycle.empty_pass_after),
    ):
        if number is not None:
            row[f"{name}_id"] = number
            row[f"{name}_kg"] = float(passes.mass_kg[number])
            row[f"{name}_u_kg"] = float(passes.u_kg[number])
    weights = cycle.compute_weights_of_passes_in_payload(tare_coefficients, passes.mass_kg.size)
    payload_kg = float(weights @ passes.mass_kg)
    carry_back_kg2 = compute_payload_variance_by_carry_back_kg2(cycle, passes, tare_coefficients)
    variance_kg2 = weights**2 @ passes.u_kg**2 + carry_back_kg2
    row |= {
        "tare_before_1": 0.0
        if cycle.empty_pass_before is None
        else -float(weights[cycle.empty_pass_before]),
        "payload_kg": payload_kg,
        "payload_u_random_kg": float(np.sqrt(variance_kg2)),
    }
    if cycle.empty_pass_after is not None:
        row["carry_back_kg"] = (
            float(passes.drift_corrected_masses_kg[cycle.empty_pass_after]) - clean[0]
        )
        row["carry_back_u_kg"] = float(np.hypot(passes.u_kg[cycle.empty_pass_after], clean[1]))
    return row


def make_payload_uncertainty_columns(
    cycle_row: dict[str, object], uncertainty: "_CommonUncertaintyByScale", coefficients: Floats
) -> dict[str, object]:
    """Columns of a payload with its random, common, shared and total uncertainty.

    A calibration needs the values on the log's own scale besides those on the empty machine's.
    """
    own_kg, random_kg = cycle_row["payload_kg"], cycle_row["payload_u_random_kg"]
    assert isinstance(own_kg, float)
    assert isinstance(random_kg, float)
    own_common_kg, own_shared_kg = uncertainty.own.compute_common_u_kg(coefficients, own_kg)
    common_kg, shared_kg = (
        uncertainty.scale_1 * u
        for u in uncertainty.on_empty_scale.compute_common_u_kg(coefficients, own_kg)
    )
    random_kg *= uncertainty.scale_1
    return {
        "scale_1": uncertainty.scale_1,
        "scale_from": uncertainty.scale.told_by,
        "payload_kg": uncertainty.scale_1 * own_kg,
        "payload_u_random_kg": random_kg,
        "payload_u_common_kg": common_kg,
        "payload_u_shared_kg": shared_kg,
        "payload_u_kg": float(np.hypot(random_kg, common_kg)),
        "own_u_common_kg": own_common_kg,
        "own_u_shared_kg": own_shared_kg,
    }


def compute_tare_coefficient_before_each_pass(passes: LoadPasses) -> Floats:
    """Minimum-variance weight of the empty pass before each loaded pass, (passes,)."""
    share = np.full(passes.mass_kg.size, 0.5)
    empties = np.flatnonzero(~passes.loaded)
    spread = 2.0 * estimate_carry_back_variance_kg2(passes)
    for loaded in np.flatnonzero(passes.loaded):
        place = int(np.searchsorted(empties, loaded))
        if 0 < place < empties.size:
            before, after = passes.u_kg[empties[place - 1]] ** 2, passes.u_kg[empties[place]] ** 2
            share[loaded] = after / (spread + before + after)
    return share


def compute_payload_variance_by_carry_back_kg2(
    cycle: CycleParts, passes: LoadPasses, carry_back_fraction: Floats
) -> float:
    """Variance of a payload by differences in carry-back between its tares, in kg²."""
    variance = 2.0 * estimate_carry_back_variance_kg2(passes)
    if cycle.loaded_pass is None:
        return 0.0
    before = (
        0.0
        if cycle.empty_pass_before is None
        else 1.0
        if cycle.empty_pass_after is None
        else carry_back_fraction[cycle.loaded_pass]
    )
    # an empty pass after the next load has the carry-back of another cycle
    own = cycle.empty_pass_after is None or cycle.empty_pass_after == cycle.loaded_pass + 1
    after = 0.0 if own else 1.0 - before
    return variance * (before**2 + after**2)


def sum_pass_weights_of_payloads(
    passes: LoadPasses, cycle_parts: list[CycleParts], tare_coefficients: Floats
) -> Floats:
    """Weights of the passes in the sum of all payloads, (passes,)."""
    count = passes.mass_kg.size
    weights = [
        part.compute_weights_of_passes_in_payload(tare_coefficients, count)
        for part in cycle_parts
        if not part.missing_mass_reason
    ]
    return np.sum([np.zeros(count), *weights], axis=0)


@dataclass(frozen=True)
class _CommonUncertaintyByScale:
    """Uncertainty common to payloads, on two scales.

    Attributes:
        own: on the log's own scale, for uncalibrated payloads.
        on_empty_scale: on the scale of the empty machine, before multiplication by `scale_1`.
        scale_1: factor of payloads by the empty machine.
        scale: source of the scale.
    """

    own: _CommonUncertainty
    on_empty_scale: _CommonUncertainty
    scale_1: float
    scale: ShiftScale


def compute_common_payload_u_on_own_and_empty_scale(
    weighing: Weighing | None,
    machine: Machine,
    passes: LoadPasses,
    coefficients: Floats,
    empty: EmptyMachine | None,
) -> _CommonUncertaintyByScale:
    """Uncertainty common to the payloads, on the log's own and on the empty machine's scale.

    Args:
        weighing: the joint fit.
        machine: machine file, for the scale.
        passes: the passes.
        coefficients: (passes,) weights in the sum of payloads.
        empty: empty machine as weighed by the empty passes.
    """
    if weighing is None or weighing.fit.states is None or empty is None or not coefficients.any():
        count = passes.mass_kg.size
        nothing = np.zeros(count)
        none = _CommonUncertainty(0.0, 0.0, np.zeros((0, count)), np.zeros((count, count)), nothing)
        return _CommonUncertaintyByScale(none, none, 1.0, ShiftScale())
    of_states = compute_state_weights_of_passes(weighing.fit, passes)
    datum = empty.make_payload_datum(of_states @ coefficients)
    own = compute_common_payload_uncertainty(weighing, machine, passes, coefficients, None)
    gain_1, gain_u_1 = empty.weighed_to_stated_ratio_and_u or (None, None)
    sources = list_payload_uncertainties(weighing, machine, datum, empty.weights)
    unknown = list_scale_sources_without_u(sources)
    told_by = "" if unknown else BY_MACHINE_FILE if datum is None else BY_EMPTY_MACHINE
    scale = ShiftScale(told_by, ", ".join(unknown), gain_1, gain_u_1)
    if datum is None:
        return _CommonUncertaintyByScale(own, own, 1.0, scale)
    return _CommonUncertaintyByScale(
        own,
        compute_common_payload_uncertainty(weighing, machine, passes, coefficients, datum),
        datum.scale_1,
        scale,
    )


def compute_common_payload_uncertainty(
    weighing: Weighing,
    machine: Machine,
    passes: LoadPasses,
    coefficients: Floats,
    datum: EmptyDatum | None,
) -> _CommonUncertainty:
    """Uncertainty common to the uncalibrated payloads, with the fit's correlations.

    For the sum of payloads it is the budget of the fit without the noise and scatter of the passes.
    A single payload also contains the effect of nuisances on its own starts.
    """
    fit = weighing.fit
    of_states = compute_state_weights_of_passes(fit, passes)
    summed = of_states @ coefficients
    sources = list_payload_uncertainties(weighing, machine, datum, summed)
    by_1 = 1.0 if datum is None else datum.scale_1
    total_kg = max(abs(float(coefficients @ passes.mass_kg)), 1e-9)
    kept = (combine_u(sources, "random") / by_1) ** 2 - float(coefficients**2 @ passes.u_kg**2)
    common = combine_u(sources, "common", "scale") / by_1
    names = {term.source or term.name for term in fit.terms}
    responses_kg = fit.mass_changes_by_one_std_of_each_term_kg
    drift = weighing.significant_empty_mass_drift
    if drift is not None:  # unlike other scales, it changes early and late payloads differently
        names.add("drifted_gain")
        responses_kg = np.vstack([responses_kg, drift.compute_mass_responses_kg(fit.masses_kg)])
    other = [s for s in sources if s.kind != "random" and s.name not in names]
    posterior, count = fit.posterior_fit, fit.mass_count
    covariance = of_states.T @ (posterior.noise + posterior.scatter)[:count, :count] @ of_states
    empty = np.zeros(passes.mass_kg.size)
    if datum is not None:
        share = passes.compute_averaging_weights_of_empty_passes(machine.machine.empty_mass_kg)
        empty = -datum.gain_per_kg * share / share.sum()
    return _CommonUncertainty(
        float(np.sqrt(common**2 + max(kept, 0.0))) / total_kg,
        combine_u(other) / by_1 / total_kg,
        responses_kg @ of_states,
        covariance - np.diag(passes.u_kg**2),
        empty,
    )
