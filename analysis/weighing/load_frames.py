"""The answer as frames: a row per load, and a row per manoeuvre."""

from typing import Final

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.physical_units import NS_PER_S
from analysis.model.schema import CALIBRATED, FRAMES, build_frame
from analysis.model.uncertainty_sources import (
    UncertaintySource,
    combine_u,
    list_scale_sources_without_u,
)
from analysis.model.verdict import RELATIVE_U, Verdict
from analysis.model.windows import find_flagged_runs
from analysis.weighing.empty_mass_datum import EmptyDatum, EmptyMachine
from analysis.weighing.empty_mass_step import find_empty_mass_step_of_manoeuvres
from analysis.weighing.empty_states import (
    compute_weights_of_mean_mass_over_states,
    estimate_std_of_empty_masses_kg,
    find_empty_states,
    make_mass_coefficients_of_payload,
)
from analysis.weighing.fuel_on_board import FuelOnBoard
from analysis.weighing.joint_result import JointFit
from analysis.weighing.load_changes import find_manoeuvre_of_fitted_samples
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.load_states import LoadStates
from analysis.weighing.mass_budget import compute_relative_load_mass_u, make_mass_budget
from analysis.weighing.motion_samples import Ints
from analysis.weighing.nuisance_frames import make_frame_without_rows
from analysis.weighing.weigh import NOTHING_FITTED, Weighing

#: Words before the probability where masses do not tell one load from several.
SINGLE_LOAD_PROBABILITY: Final = "a single load has a probability of"
#: Words after the number of drives that have a usable start, where most have none.
UNWEIGHED_DRIVES: Final = "drives have a usable start: the others may carry more loads"
_NOT_EMPTY: Final = (
    "settings.loads.empty_from_s and empty_to_s select none of the loads: payloads are "
    "differences to the machine's empty mass"
)


def make_load_frame(
    weighing: Weighing | None,
    excitation: pl.DataFrame,
    manoeuvres: pl.DataFrame,
    machine: Machine,
    verdict: Verdict,
    fuel: FuelOnBoard | None = None,
) -> pl.DataFrame:
    """Make `loads`: a row per load state.

    Args:
        weighing: the joint fit; None if nothing could be fitted.
        excitation: frame with the times of the rows.
        manoeuvres: the frame `manoeuvres`, by `make_manoeuvre_frame`.
        machine: machine file with empty mass, budget and limits.
        verdict: the verdict, which may withhold quantities.
        fuel: fuel over the log, if known.
    """
    if weighing is None:
        return _make_unknown_load()
    fit = weighing.fit
    times = _find_time_spans_of_states_ns(fit, excitation)
    empty = find_empty_states(weighing, times, machine)
    since_ticket_kg = average_fuel_since_ticket_and_u_kg(weighing, empty, times, fuel)
    datum, against = _choose_empty_datum_or_refusal(weighing, empty, machine, since_ticket_kg)
    empty_std_kg = estimate_std_of_empty_masses_kg(weighing, empty, machine)
    rows = [
        _make_load_row(
            weighing, state, (empty, empty_std_kg), times[state], machine, verdict, datum
        )
        for state in range(fit.mass_count)
    ]
    said = "; ".join(
        filter(
            None,
            (
                _describe_load_states(fit, machine),
                against,
                _describe_empty_mass_drift(weighing, empty),
                _describe_empty_mass_step(manoeuvres),
                _describe_manoeuvres_with_changing_load(weighing, excitation),
                _describe_drives_without_usable_start(fit, excitation),
            ),
        )
    )
    if machine.settings.loads.empty_from_s is not None and not empty:
        said = "; ".join(filter(None, (_NOT_EMPTY, said)))
    said = pl.Series("said", [said] * len(rows))
    return build_frame(
        "loads", {**pl.DataFrame(rows, infer_schema_length=None).to_dict(), "said": said}
    )


def _find_time_spans_of_states_ns(fit: JointFit, excitation: pl.DataFrame) -> list[tuple[int, int]]:
    """First and last fitted sample of each load state, in ns."""
    states = fit.states
    assert states is not None
    t_ns = excitation["t_ns"].to_numpy()[fit.motion.is_fittable]
    of = states.state_of_manoeuvre[index_manoeuvres_of_samples(fit, states)]
    spans_ns = np.full((fit.mass_count, 2), -1, np.int64)
    # if an element is assigned several times, the last value remains
    spans_ns[of[::-1], 0] = t_ns[::-1]
    spans_ns[of, 1] = t_ns
    return [(first_ns, last_ns) for first_ns, last_ns in spans_ns.tolist()]


def index_manoeuvres_of_samples(fit: JointFit, states: LoadStates) -> Ints:
    """Index of each fitted sample's manoeuvre, (n,), in `states.manoeuvre_ids`."""
    return np.searchsorted(states.manoeuvre_ids, find_manoeuvre_of_fitted_samples(fit.motion))


def find_load_change_rows(weighing: Weighing | None) -> list[int]:
    """Grid rows of the first fitted sample after each change of load."""
    if weighing is None or weighing.fit.states is None:
        return []
    fit, states = weighing.fit, weighing.fit.states
    of = states.state_of_manoeuvre[index_manoeuvres_of_samples(fit, states)]
    used = np.flatnonzero(fit.motion.is_fittable)
    return used[np.flatnonzero(np.diff(of) != 0) + 1].tolist()


def average_fuel_since_ticket_and_u_kg(
    weighing: Weighing,
    empty: list[int],
    state_spans_ns: list[tuple[int, int]],
    fuel: FuelOnBoard | None,
) -> tuple[float, float]:
    """Mean fuel mass in the empty states minus that of the ticket, and its uncertainty, in kg."""
    states = weighing.fit.states
    if fuel is None or states is None or not empty:
        return 0.0, 0.0
    count = np.bincount(states.state_of_manoeuvre)[empty]
    middles_ns = np.mean([state_spans_ns[state] for state in empty], axis=1)
    return fuel.estimate_fuel_mass_beyond_ticket_and_u_kg(middles_ns, count / count.sum())


def _choose_empty_datum_or_refusal(
    weighing: Weighing, empty: list[int], machine: Machine, fuel_kg: tuple[float, float]
) -> tuple[EmptyDatum | None, str]:
    """Datum of the empty states for payloads, or the reason why the log contradicts it."""
    fit = weighing.fit
    if not empty or len(empty) == fit.mass_count:
        return None, ""
    weights = compute_weights_of_mean_mass_over_states(fit, empty)
    found = EmptyMachine(weighing, machine, weights, fuel_kg=fuel_kg)
    if found.empty_mass_contradiction_text:
        return (
            None,
            f"{found.empty_mass_contradiction_text}: payloads are on the log's own scale",
        )
    others = [state for state in range(fit.mass_count) if state not in empty]
    payloads = np.sum(
        [make_mass_coefficients_of_payload(weighing, state, empty) for state in others], axis=0
    )
    return found.make_payload_datum(payloads), ""


def _make_load_row(
    weighing: Weighing,
    state: int,
    empty_and_std_kg: tuple[list[int], float],
    times: tuple[int, int],
    machine: Machine,
    verdict: Verdict,
    datum: EmptyDatum | None,
) -> dict[str, object]:
    fit, body, states = weighing.fit, machine.machine, weighing.fit.states
    assert states is not None
    empty, empty_std_kg = empty_and_std_kg
    sources = make_mass_budget(weighing, machine, fit.make_mass_coefficients_of_state(state))
    mass_kg = float(fit.masses_kg[state]) - body.rotating_mass_kg
    u_kg = combine_u(sources)
    withheld = [check.check for check in verdict.list_withholding_checks("mass")]
    # the check of that name judges the load with the most manoeuvres
    known = (
        compute_relative_load_mass_u(weighing, machine, state)
        <= machine.settings.verdict.relative_std_max
    )
    if not known and RELATIVE_U not in withheld:
        withheld.append(RELATIVE_U)
    payload, unknown = make_payload_columns_and_sources_without_u(
        weighing, state, empty, empty_std_kg, machine, datum
    )
    friction = fit.viscous_friction_and_std
    numbers = {
        "mass_kg": mass_kg,
        "u_kg": u_kg,
        "u_random_kg": combine_u(sources, "random"),
        "u_common_kg": combine_u(sources, "common", "scale"),
        **payload,
        "friction_x_N_s_m": friction[0],
        "friction_x_std_N_s_m": friction[1],
        "mass_halved_priors_kg": float(weighing.halved_kg[state]) - body.rotating_mass_kg,
        "mass_doubled_priors_kg": float(weighing.doubled_kg[state]) - body.rotating_mass_kg,
    }
    return {
        "load_id": state,
        "start_t_ns": times[0],
        "end_t_ns": times[1],
        "manoeuvres": int((states.state_of_manoeuvre == state).sum()),
        **{name: None if withheld else value for name, value in numbers.items()},
        "payload_to": empty[0] if empty and not withheld else None,
        "empty": state in empty,
        "scatter_kg": states.scatter_kg if states.degrees_of_freedom > 0 and not withheld else None,
        "scatter_known": states.is_scatter_estimated,
        "mean_samples": fit.samples_per_mean,
        "braking_left_out": weighing.braking_left_out,
        "scale_unknown": ", ".join(list_scale_sources_without_u(sources)),
        "payload_scale_unknown": ", ".join(unknown),
        "withheld": bool(withheld),
        "withheld_for": ", ".join(withheld),
    }


def make_payload_columns_and_sources_without_u(
    weighing: Weighing,
    state: int,
    empty: list[int],
    empty_std_kg: float,
    machine: Machine,
    datum: EmptyDatum | None,
) -> tuple[dict[str, float | None], list[str]]:
    """Payload columns of a state, and the names of its factors without a known uncertainty.

    The payload is relative to the empty states, once calibrated by the stated empty mass if there
    is one and once uncalibrated; without empty states it is relative to the stated empty mass.
    """
    fit, body = weighing.fit, machine.machine
    names = ("kg", "u_kg", "u_random_kg")
    if not empty and body.empty_mass_kg is None:
        return {f"{of}_{name}": None for of in ("payload", "own_payload") for name in names}, []
    weights = make_mass_coefficients_of_payload(weighing, state, empty)
    sources = make_mass_budget(weighing, machine, weights)
    own_kg = float(weights @ fit.masses_kg)
    other_u_kg = empty_std_kg * float(np.linalg.norm(weights[empty]))
    if not empty:
        own_kg -= body.rotating_mass_kg + (body.empty_mass_kg or 0.0)
        other_u_kg = body.empty_mass_u_kg or 0.0

    def combine_with_other_u(sources: list[UncertaintySource]) -> tuple[float, float]:
        return float(np.hypot(combine_u(sources), other_u_kg)), combine_u(sources, "random")

    own = (own_kg, *combine_with_other_u(sources))
    told = own
    if datum is not None:
        sources = datum.list_payload_sources(weights)
        told = (datum.scale_1 * own_kg, *combine_with_other_u(sources))
    found: dict[str, float | None] = {
        f"payload_{n}": value for n, value in zip(names, told, strict=True)
    }
    found |= {f"own_payload_{n}": value for n, value in zip(names, own, strict=True)}
    return found, list_scale_sources_without_u(sources)


def _describe_load_states(fit: JointFit, machine: Machine) -> str:
    """Note on the load states for readers of the answer."""
    states = fit.states
    assert states is not None
    said: list[str] = []
    if states.alternative_partition is not None:
        others = int(states.alternative_partition.state_of_manoeuvre.max()) + 1
        readings = sorted(
            [
                (fit.mass_count, states.scatter_kg),
                (others, states.alternative_partition.scatter_kg),
            ],
            key=lambda reading: reading[0],
        )
        texts = [
            f"{count} {'load' if count == 1 else 'loads'}"
            + f" with manoeuvres that scatter by {scatter_kg:.3g} kg" * (scatter_kg > 0.0)
            for count, scatter_kg in readings
        ]
        said.append(
            f"states or scatter: {texts[0]}, or {texts[1]}; {SINGLE_LOAD_PROBABILITY} "
            f"{states.single_probability:.0%}"
        )
    if states.assumes_scatter:
        said.append(
            f"repeatability assumed, {states.scatter_kg:.3g} kg: the load changes too often and by "
            "too little to estimate how the manoeuvres scatter"
        )
    elif machine.machine.repeatability_kg is None and not states.is_scatter_estimated:
        said.append("repeatability unknown: too few manoeuvres tell how they scatter")
    return "; ".join(said)


def _describe_empty_mass_drift(weighing: Weighing, empty: list[int]) -> str:
    """Note on the drift of the empty mass, which payloads follow; "" without a drift."""
    drift = weighing.significant_empty_mass_drift
    if drift is None or not empty:
        return ""
    return (
        f"the empty mass changes by {drift.change_1:+.1%} over the log: payloads are differences "
        "to the empty states before and after each"
    )


def _describe_empty_mass_step(manoeuvres: pl.DataFrame) -> str:
    """Note on a step of the empty machine's mass; "" without one."""
    step = find_empty_mass_step_of_manoeuvres(manoeuvres)
    return "" if step is None else f"{step.text}, but payloads of single loads after it include it"


def _describe_manoeuvres_with_changing_load(weighing: Weighing, excitation: pl.DataFrame) -> str:
    """Note on the manoeuvres whose load changes in motion; "" if there are none."""
    t_ns = excitation["t_ns"].to_numpy()
    told = [
        (
            f"the load changes within the manoeuvre at {t_ns[each.first] / 1e9:,.1f} s, by about "
            f"{each.load_change_kg:+,.0f} ± {each.std_kg:,.0f} kg: this manoeuvre is excluded"
            if each.is_possible
            else f"no load explains the manoeuvre at {t_ns[each.first] / 1e9:,.1f} s: this "
            "manoeuvre is excluded"
        )
        for each in weighing.growing_load_manoeuvres
    ]
    more = (
        [f"and it changes within {len(told) - LIMITS.max_named_manoeuvres} more"]
        if len(told) > LIMITS.max_named_manoeuvres
        else []
    )
    return "; ".join(told[: LIMITS.max_named_manoeuvres] + more)


def _describe_drives_without_usable_start(fit: JointFit, excitation: pl.DataFrame) -> str:
    """Note on drives from stop to stop that say nothing of their load; "" if most say it."""
    if fit.mass_count == 1:
        return ""
    t_ns = excitation["t_ns"].to_numpy()
    moves = (excitation["phase"] != "standstill").fill_null(value=False).to_numpy()
    first, last = find_flagged_runs(moves)
    is_drive = t_ns[last] - t_ns[first] > LIMITS.drive_min_s * NS_PER_S
    fitted_before = np.append(0, np.cumsum(fit.motion.is_fittable))
    fitted_s = (fitted_before[last + 1] - fitted_before[first]) / fit.motion.rate_hz
    fitted = int(np.count_nonzero(fitted_s[is_drive] >= LIMITS.usable_start_min_s))
    drives = int(is_drive.sum())
    if fitted >= LIMITS.fitted_drives_min_fraction * drives:
        return ""
    return f"only {fitted} of {drives} {UNWEIGHED_DRIVES}"


def make_manoeuvre_frame(
    weighing: Weighing | None, excitation: pl.DataFrame, machine: Machine
) -> pl.DataFrame:
    """Make `manoeuvres`: a row per fitted manoeuvre, with its own mass estimate.

    Masses exclude the rotating mass, like those of the frame `loads`.
    """
    if weighing is None or weighing.fit.states is None:
        return make_frame_without_rows("manoeuvres")
    fit, states = weighing.fit, weighing.fit.states
    t_ns = excitation["t_ns"].to_numpy()
    used = np.flatnonzero(fit.motion.is_fittable)
    place = index_manoeuvres_of_samples(fit, states)
    first = np.flatnonzero(np.append(True, np.diff(place) > 0))
    last = np.append(first[1:] - 1, place.size - 1)
    # the corrections of the answer apply to the masses of single manoeuvres as well
    shift_kg = fit.masses_kg - states.means_kg - machine.machine.rotating_mass_kg
    return build_frame(
        "manoeuvres",
        {
            "load_id": states.state_of_manoeuvre,
            "start_t_ns": t_ns[used[first]],
            "end_t_ns": t_ns[used[last]],
            "mass_kg": states.manoeuvre_mass_kg + shift_kg[states.state_of_manoeuvre],
            "mass_std_kg": states.std_kg,
        },
    )


def _make_unknown_load() -> pl.DataFrame:
    """Frame `loads` with one row, whose mass is unknown."""
    said = {
        "load_id": 0,
        "manoeuvres": 0,
        "braking_left_out": False,
        "scale_unknown": "",
        "payload_scale_unknown": "",
        "withheld": True,
        "withheld_for": NOTHING_FITTED,
        "scatter_known": False,
        "empty": False,
        "said": "",
    }
    columns = [c for c in FRAMES["loads"].columns if c.name not in CALIBRATED]
    return build_frame(
        "loads", {c.name: pl.Series([said.get(c.name)], dtype=c.dtype) for c in columns}
    )
