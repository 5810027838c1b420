"""Frames of the nuisances, prior and posterior, and of the uncertainty budget."""

from typing import Final

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.schema import FRAMES, build_frame
from analysis.model.uncertainty_sources import combine_u
from analysis.weighing.mass_budget import make_mass_budget
from analysis.weighing.weigh import Weighing
from analysis.weighing.wheel_kinematics import TERMS

#: Unit and meaning of slip, gain and delay as estimated from the wheels.
_OF_WHEELS: Final = (
    ("1/N", "slip per newton, as a share of the speed, estimated from the wheels"),
    ("1", "gain of the accelerometer minus 1, estimated from the wheels"),
    ("s", "delay of the speed behind the accelerometer, estimated from the wheels"),
)


def make_nuisance_frame(weighing: Weighing | None) -> pl.DataFrame:
    """Make `nuisances`: a row per term, with prior and posterior."""
    if weighing is None:
        return make_frame_without_rows("nuisances")
    rows = pl.concat([_make_term_rows(weighing), _make_wheel_rows(weighing)], how="diagonal")
    return build_frame("nuisances", rows.to_dict())


def _make_term_rows(weighing: Weighing) -> pl.DataFrame:
    """Rows of the terms of the fit."""
    fit, own = weighing.fit, weighing.fit_without_learnt_priors_or_none
    parts_kg = fit.compute_u_by_cause_kg(
        fit.make_mass_coefficients_of_state(fit.most_frequent_state)
    )
    prior_std, mean_u = fit.prior_std.copy(), fit.prior_means.mean_u.copy()
    columns = {
        "term": [term.name for term in fit.terms],
        "unit": [term.unit for term in fit.terms],
        "prior_mean": fit.prior_means.mean,
        "prior_std": prior_std,
        "posterior": fit.term_posteriors[0],
        "posterior_std": fit.term_posteriors[1],
        "u_kg": [parts_kg[term.name] for term in fit.terms],
        "meaning": [term.meaning for term in fit.terms],
    }
    if own is None:
        return pl.DataFrame(columns)
    learnt = weighing.learnt if weighing.has_corrected_learnt_means else {}
    for place, term in enumerate(fit.terms):
        if term.name in learnt and not fit.prior_means.mean_u[place]:
            prior_std[place] = learnt[term.name].std
            mean_u[place] = learnt[term.name].mean_u
    alone = {
        "prior_mean_u": mean_u,
        "alone": own.term_posteriors[0],
        "alone_std": own.term_posteriors[1],
        "alone_prior_mean": own.prior_means.mean,
        "alone_prior_std": own.prior_std,
    }
    return pl.DataFrame({**columns, **alone})


def _make_wheel_rows(weighing: Weighing) -> pl.DataFrame:
    """Rows of the comparison of wheels and accelerometer, if they are consistent."""
    fit, own = weighing.fit, weighing.fit_without_learnt_priors_or_none
    wheels = fit.kinematics
    if wheels is None or not wheels.is_consistent or wheels.is_gain_significant:
        return pl.DataFrame()
    parts_kg = fit.compute_u_by_cause_kg(
        fit.make_mass_coefficients_of_state(fit.most_frequent_state)
    )
    said = list(wheels.estimates_by_prior_name.values())
    rows: dict[str, object] = {
        "term": TERMS,
        "unit": [unit for unit, _ in _OF_WHEELS],
        "prior_mean": [0.0] * len(TERMS)
        if wheels.estimates_of_this_log is None
        else [mean for mean, _ in said],
        "prior_std": wheels.prior_std,
        "posterior": [value for value, _ in said],
        "posterior_std": np.hypot([std for _, std in said], wheels.mean_u),
        # the uncertainty by slip is in the term of that name
        "u_kg": [0.0, parts_kg.get("gain", 0.0), parts_kg.get("speed_delay", 0.0)],
        "meaning": [meaning for _, meaning in _OF_WHEELS],
    }
    if own is not None:
        alone = wheels if wheels.estimates_of_this_log is None else wheels.estimates_of_this_log
        rows |= {
            "prior_mean_u": wheels.mean_u,
            "alone": [value for value, _ in alone.estimates_by_prior_name.values()],
            "alone_std": [std for _, std in alone.estimates_by_prior_name.values()],
            "alone_prior_mean": [0.0] * len(TERMS),
            "alone_prior_std": alone.prior_std,
        }
    return pl.DataFrame(rows)


def make_budget_frame(weighing: Weighing | None, machine: Machine) -> pl.DataFrame:
    """Make `budget`: a row per load and source."""
    if weighing is None:
        return make_frame_without_rows("budget")
    fit = weighing.fit
    rows = [_make_source_rows(weighing, machine, state) for state in range(fit.mass_count)]
    return build_frame("budget", pl.concat(rows).to_dict())


def _make_source_rows(weighing: Weighing, machine: Machine, state: int) -> pl.DataFrame:
    """Uncertainty budget of a load, one row per source."""
    sources = make_mass_budget(
        weighing, machine, weighing.fit.make_mass_coefficients_of_state(state)
    )
    total = combine_u(sources)
    u_kg = np.array([np.nan if source.u is None else source.u for source in sources])
    return pl.DataFrame(
        {
            "load_id": np.full(u_kg.size, state),
            "cause": [source.name for source in sources],
            "kind": [source.kind for source in sources],
            "u_kg": u_kg,
            "share_1": u_kg**2 / total**2 if total else u_kg * np.nan,
            "meaning": [source.meaning for source in sources],
            "shrinks": [source.reduced_by for source in sources],
        }
    )


def make_frame_without_rows(frame_name: str) -> pl.DataFrame:
    """Frame of this name with its columns and no rows."""
    return pl.DataFrame(schema={column.name: column.dtype for column in FRAMES[frame_name].columns})
