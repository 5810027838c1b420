"""What errors of a calibration's learnt means do to a log's masses, and what the log says of them.

The means of learnt priors are wrong by one error in all logs, ε in their standard uncertainties. A
calibration's line has what ε did to its own logs. What it does to another log differs where that
is driven otherwise; there the log itself says what ε is.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl

from analysis.machine import Machine
from analysis.schema import MOVED, SCALE, build
from analysis.weighing.budget import budget, combined
from analysis.weighing.equation import Floats
from analysis.weighing.loads import weights_against
from analysis.weighing.weigh import Weighing


@dataclass(frozen=True)
class LearntErrors:
    """What a log says of the errors of learnt means, in their standard uncertainties.

    Attributes:
        terms: whose means they are.
        mean: (terms,) what the log says together with the calibration; 0 where it says nothing.
        covariance: (terms, terms) of that; 1 where it says nothing.
    """

    terms: tuple[str, ...]
    mean: Floats
    covariance: Floats

    @classmethod
    def of(cls, weighing: Weighing) -> "LearntErrors":
        """By the fit in which learnt priors are as wide as their means are uncertain.

        What a log finds of a term is the error of its mean and what differs from log to log, by
        their variances. Of wheels against accelerometer the calibration's word stands alone.
        """
        terms, _ = weighing.fit.of_means
        mean, covariance = np.zeros(len(terms)), np.eye(len(terms))
        fit = weighing.informed
        if fit is None:
            return cls(terms, mean, covariance)
        learnt = weighing.learnt
        names = [term.name for term in fit.terms]
        own = [k for k, name in enumerate(terms) if name in names]
        at = [names.index(terms[k]) for k in own]
        mean_u = np.array([learnt[terms[k]].mean_u for k in own])
        std = np.array([learnt[terms[k]].std for k in own])
        share = mean_u / (mean_u**2 + std**2)
        place = np.array(at, np.int64) + fit.count + 1
        apart = fit.theta[place] - fit.prior_means.mean[at]
        mean[own] = -share * apart
        found = fit.fit.covariance[np.ix_(place, place)] * np.outer(share, share)
        covariance[np.ix_(own, own)] = found + np.diag(std**2 / (mean_u**2 + std**2))
        return cls(terms, mean, covariance)


def responses(
    weighing: Weighing | None, machine: Machine, loads: pl.DataFrame, payloads: Mapping[int, Floats]
) -> dict[str, pl.DataFrame]:
    """Make `responses` and `learnt_errors`; none where no calibration learnt anything.

    Args:
        weighing: the joint fit.
        machine: for the scale, which a line takes with it as well.
        loads: the frame, for the empty ones.
        payloads: by the number of each cycle that has one, (masses,) weights of the masses in it.
    """
    if weighing is None or weighing.informed is None:
        return {}
    fit, errors = weighing.fit, LearntErrors.of(weighing)
    empty = loads.filter("empty")["load_id"].to_list()
    states = range(fit.count)
    of_mass, of_payload, of_cycle = MOVED
    rows = _rows(of_mass, weighing, machine, {k: fit.weights(k) for k in states})
    if empty:
        against = {k: weights_against(weighing, k, empty) for k in states if k not in empty}
        rows += _rows(of_payload, weighing, machine, against)
    rows += _rows(of_cycle, weighing, machine, payloads)
    known = [
        {"term": one, "other": other, "error_1": errors.mean[i], "covariance_1": value}
        for i, one in enumerate(errors.terms)
        for other, value in zip(errors.terms, errors.covariance[i].tolist(), strict=True)
    ]
    return {
        "responses": build("responses", pl.DataFrame(rows).to_dict()),
        "learnt_errors": build("learnt_errors", pl.DataFrame(known).to_dict()),
    }


def _rows(
    of: str, weighing: Weighing, machine: Machine, sums: Mapping[int, Floats]
) -> list[dict[str, object]]:
    """What moves sums of masses, by number: a row a term, and one for the scale."""
    if not sums:
        return []
    fit = weighing.fit
    terms, moved_kg = fit.of_means
    total = np.sum(list(sums.values()), axis=0)
    total_kg = abs(float(total @ fit.masses_kg))
    # the same share of all
    scale_1 = combined(budget(weighing, machine, total), "scale") / total_kg if total_kg else 0.0
    rows: list[dict[str, object]] = []
    for number, weights in sums.items():
        by_term = dict(zip(terms, (moved_kg @ weights).tolist(), strict=True))
        by_term[SCALE] = scale_1 * float(weights @ fit.masses_kg)
        rows += [
            dict[str, object](of=of, number=number, term=term, response_kg=value)
            for term, value in by_term.items()
        ]
    return rows
