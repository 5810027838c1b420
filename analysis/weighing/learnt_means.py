"""Effect of errors of learnt means on a log's masses, and the log's estimate of them.

The error of a learnt mean is the same in all logs; in units of its standard uncertainty it is ε. A
calibration line contains the effect of ε on its own logs. In a log that is driven differently the
effect differs, and that log itself gives an estimate of ε.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.schema import MASS_KINDS, SCALE, build_frame
from analysis.model.uncertainty_sources import combine_u
from analysis.weighing.empty_states import make_mass_coefficients_of_payload
from analysis.weighing.mass_budget import make_mass_budget
from analysis.weighing.motion_samples import Floats
from analysis.weighing.weigh import Weighing
from analysis.weighing.wheel_kinematics import TERMS


@dataclass(frozen=True)
class LearntMeanErrors:
    """Errors of learnt means estimated from a log, in their standard uncertainties.

    Attributes:
        terms: terms with learnt means.
        mean: (terms,) estimate from log and calibration together; 0 if the log adds nothing.
        covariance: (terms, terms) covariance of the estimate; identity if the log adds nothing.
        mass_responses_by_fit_kg: (terms of the fit, masses) response of the masses in kg, from the
            covariance of the fit; terms of the wheels have none.
    """

    terms: tuple[str, ...]
    mean: Floats
    covariance: Floats
    mass_responses_by_fit_kg: Floats

    @classmethod
    def from_weighing(cls, weighing: Weighing) -> "LearntMeanErrors":
        """Estimate the errors from the fit whose learnt priors are as wide as their means' u.

        The deviation of a term is split between the error of its mean and the variation between
        logs, in proportion to their variances. For the terms of the wheels, which are compared with
        the accelerometer, only the calibration counts.
        """
        fit, learnt = weighing.fit_with_wide_learnt_priors, weighing.learnt
        assert fit is not None
        by_wheels = [
            term
            for term in weighing.fit.learnt_terms_and_mass_changes_per_mean_u[0]
            if term in TERMS
        ]
        known = [(k, term.name) for k, term in enumerate(fit.terms) if term.name in learnt]
        # slip that the wheels determine better has no learnt prior in the fit
        own = [(k, n) for k, n in known if fit.prior_means.mean[k] == learnt[n].mean or n == "lag"]
        mean_u = np.array([learnt[name].mean_u for _, name in own])
        std = np.array([learnt[name].std for _, name in own])
        share = mean_u / (mean_u**2 + std**2)
        at = np.array([k for k, _ in own], np.int64)
        place = at + fit.mass_count + 1
        apart = fit.theta[place] - [learnt[name].mean for _, name in own]
        found = fit.posterior_fit.covariance[np.ix_(place, place)] * np.outer(share, share)
        covariance = np.eye(len(own) + len(by_wheels))
        covariance[: len(own), : len(own)] = found + np.diag(std**2 / (mean_u**2 + std**2))
        together = -fit.posterior_fit.covariance[: fit.mass_count, place] * share
        return cls(
            (*(name for _, name in own), *by_wheels),
            np.append(-share * apart, np.zeros(len(by_wheels))),
            covariance,
            -np.asarray(
                np.linalg.solve(covariance[: len(own), : len(own)], together.T), np.float64
            ),
        )

    def compute_mass_shifts_kg(self, weighing: Weighing) -> Floats:
        """(terms, masses) shift of the masses per unit error of each learnt mean, in kg."""
        names, moved_kg = weighing.fit.learnt_terms_and_mass_changes_per_mean_u
        own = dict(zip(names, moved_kg, strict=True))
        by_fit = (
            dict(zip(self.terms, self.mass_responses_by_fit_kg, strict=False))
            if weighing.has_corrected_learnt_means
            else {}
        )
        none = np.zeros(weighing.fit.mass_count)
        return np.array([by_fit.get(term, own.get(term, none)) for term in self.terms])


def make_learnt_mean_frames(
    weighing: Weighing | None, machine: Machine, loads: pl.DataFrame, payloads: Mapping[int, Floats]
) -> dict[str, pl.DataFrame]:
    """Make the frames `responses` and `learnt_errors`, by name; empty without learnt priors.

    Args:
        weighing: the joint fit.
        machine: machine file, for the scale that a calibration line includes.
        loads: the frame `loads`, which says which states are empty.
        payloads: (masses,) weights of each cycle's payload, by the number of the cycle.
    """
    if weighing is None or weighing.fit_with_wide_learnt_priors is None:
        return {}
    fit, errors = weighing.fit, LearntMeanErrors.from_weighing(weighing)
    empty = loads.filter("empty")["load_id"].to_list()
    states = range(fit.mass_count)
    of_mass, of_payload, of_cycle = MASS_KINDS
    moved_kg = errors.compute_mass_shifts_kg(weighing)

    def make_rows_of_kind(mass_kind: str, sums: Mapping[int, Floats]) -> list[dict[str, object]]:
        return _make_mass_response_rows(mass_kind, weighing, machine, errors.terms, moved_kg, sums)

    rows = make_rows_of_kind(of_mass, {k: fit.make_mass_coefficients_of_state(k) for k in states})
    if empty:
        against = {
            k: make_mass_coefficients_of_payload(weighing, k, empty)
            for k in states
            if k not in empty
        }
        rows += make_rows_of_kind(of_payload, against)
    rows += make_rows_of_kind(of_cycle, payloads)
    known = [
        {
            "term": one,
            "other": other,
            "error_1": errors.mean[i],
            "covariance_1": value,
            "told": weighing.has_corrected_learnt_means and one not in TERMS,
        }
        for i, one in enumerate(errors.terms)
        for other, value in zip(errors.terms, errors.covariance[i].tolist(), strict=True)
    ]
    return {
        "responses": build_frame("responses", pl.DataFrame(rows).to_dict()),
        "learnt_errors": build_frame("learnt_errors", pl.DataFrame(known).to_dict()),
    }


def _make_mass_response_rows(
    mass_kind: str,
    weighing: Weighing,
    machine: Machine,
    terms: Sequence[str],
    mass_responses_kg: Floats,
    coefficients_by_sum: Mapping[int, Floats],
) -> list[dict[str, object]]:
    """Rows with the responses of sums of masses: one per term, and one for the scale."""
    if not coefficients_by_sum:
        return []
    fit = weighing.fit
    total = np.sum(list(coefficients_by_sum.values()), axis=0)
    total_kg = abs(float(total @ fit.masses_kg))
    # the same fraction of every mass
    scale_1 = (
        combine_u(make_mass_budget(weighing, machine, total), "scale") / total_kg
        if total_kg
        else 0.0
    )
    rows: list[dict[str, object]] = []
    for number, weights in coefficients_by_sum.items():
        by_term = dict(zip(terms, (mass_responses_kg @ weights).tolist(), strict=True))
        by_term[SCALE] = scale_1 * float(weights @ fit.masses_kg)
        rows += [
            dict[str, object](of=mass_kind, number=number, term=term, response_kg=value)
            for term, value in by_term.items()
        ]
    return rows
