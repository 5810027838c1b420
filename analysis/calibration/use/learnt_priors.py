"""Learnt priors: narrower priors of nuisances, from the logs of a campaign.

With wide priors each log estimates its own nuisances, whose errors scatter the masses of separate
logs. Properties that are constant for the machine are the same in every log: with one prior for all
logs their error is common, and the line absorbs it.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, get_args

import numpy as np
import polars as pl
from pydantic import BaseModel, ConfigDict, Field
from scipy.special import chdtrc

from analysis.calibration.line.procedure import PRESENT_PROCEDURE, Procedure
from analysis.calibration.line.shared_errors import RunResponse, SharedErrors
from analysis.calibration.use.use_limits import LIMITS
from analysis.model.machine import Machine
from analysis.model.prior_settings import LearnableTerm, LearntTerm
from analysis.model.strict_config import STRICT

#: Terms that change from day to day with the ground, the mounting or the temperature.
_CHANGES: Final = ("const", "direction")
_UNDETECTED: Final = (
    "no log can reveal a force gain that has changed since, and a bias, tilt or rolling resistance "
    "worth up to {:,.0f} kg cannot be distinguished from chance; an empty start, calibrate --check "
    "or evidence of several days would reveal it"
)
_NAMES: Final = get_args(LearnableTerm)


class TermOfLog(BaseModel):
    """Estimate of one term by one log, in the term's unit."""

    model_config = STRICT

    log: str = Field(max_length=200)
    term: LearnableTerm
    prior_mean: float
    prior_std: float = Field(gt=0)
    posterior: float
    posterior_std: float = Field(gt=0)


class LearntPriors(BaseModel):
    """Priors that a campaign learnt, and the logs they come from.

    Attributes:
        terms: the priors, by term.
        logs: what each log said under the machine's own priors.
        responses: what the means' errors move each run by; none in evidence of format 1.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    terms: dict[LearnableTerm, LearntTerm]
    logs: tuple[TermOfLog, ...] = Field(max_length=100_000)
    responses: tuple[RunResponse, ...] = Field(default=(), max_length=100_000)


def list_learnable_term_estimates(log_name: str, nuisances: pl.DataFrame) -> tuple[TermOfLog, ...]:
    """Estimates by a log of the terms whose priors can be learnt.

    Args:
        log_name: name of the log.
        nuisances: frame of a replay without learnt priors.
    """
    columns = ("term", "prior_mean", "prior_std", "posterior", "posterior_std")
    return tuple(
        TermOfLog(log=log_name, **row)
        for row in nuisances.select(columns).drop_nulls().to_dicts()
        if row["term"] in _NAMES and row["prior_std"] > 0.0 and row["posterior_std"] > 0.0
    )


def pool_learnt_terms_over_logs(
    log_terms: Iterable[TermOfLog], procedure: Procedure = PRESENT_PROCEDURE
) -> dict[LearnableTerm, LearntTerm]:
    """Pool the logs' estimates of each term: weighted mean, uncertainty, variation between logs.

    The variation is estimated by moments (DerSimonian and Laird 1986) if it is significant by a
    chi-square test at 5 % (for all terms together, or each, by the procedure); otherwise it is one
    hundredth of the prior. Undetected variation scatters the runs of a calibration, so that its
    intervals include it.

    Args:
        log_terms: prior and posterior of each term by each log.
        procedure: procedure of the calibration.

    Returns:
        Learnt priors by term, for terms with estimates from at least three logs.
    """
    by_term: dict[LearnableTerm, list[TermOfLog]] = {}
    for each in log_terms:
        by_term.setdefault(each.term, []).append(each)
    pooled: list[LearnableTerm] = [
        term for term in sorted(by_term) if len(by_term[term]) >= LIMITS.min_logs
    ]
    level = (
        LIMITS.variation_probability
        if procedure.terms_tested_singly
        else LIMITS.variation_probability / max(len(pooled), 1)
    )
    return {term: pool_learnt_term_over_logs(by_term[term], level) for term in pooled}


def pool_learnt_term_over_logs(
    log_terms: Sequence[TermOfLog], significance_level: float
) -> LearntTerm:
    """Learnt prior of a term from the estimates of the logs, with the old prior counted once."""
    # all floats are Python's own: evidence is written and read back to the last bit
    prior = float(max(each.prior_std for each in log_terms))
    estimates = [
        own
        for each in log_terms
        if (own := estimate_learnt_term_and_std_without_prior(each)) is not None
    ]
    value, variance = np.array([v for v, _ in estimates]), np.array([s**2 for _, s in estimates])
    between = (
        estimate_between_log_variance(value, variance, significance_level)
        if len(estimates) >= LIMITS.min_logs
        else 0.0
    )
    weight = 1.0 / (variance + between)
    # the prior counts once, not once per log
    total = float(weight.sum()) + prior**-2
    return LearntTerm(
        mean=float(weight @ value) / total,
        std=float(max(np.sqrt(between), LIMITS.min_prior_fraction * prior)),
        mean_u=total**-0.5,
    )


def estimate_learnt_term_and_std_without_prior(log_term: TermOfLog) -> tuple[float, float] | None:
    """Estimate of a term by the log alone, without the prior, and its standard deviation."""
    prior = (log_term.prior_mean, log_term.prior_std)
    return remove_normal_prior_from_posterior((log_term.posterior, log_term.posterior_std), prior)


def remove_normal_prior_from_posterior(
    posterior: tuple[float, float], prior: tuple[float, float]
) -> tuple[float, float] | None:
    """Remove a prior from a posterior (mean and deviation each); None if the log adds little."""
    (value, std), (mean, width) = posterior, prior
    if std > LIMITS.informative_posterior_fraction * width:
        return None
    information = std**-2 - width**-2
    return (value * std**-2 - mean * width**-2) / information, float(information**-0.5)


def estimate_between_log_variance(
    estimates: np.ndarray, variances: np.ndarray, significance_level: float
) -> float:
    """Variance between logs; 0 if the differences are not significant at this level."""
    weight = 1.0 / variances
    mean = float(weight @ estimates / weight.sum())
    squares, degrees_of_freedom = float(weight @ (estimates - mean) ** 2), estimates.size - 1
    if float(chdtrc(degrees_of_freedom, squares)) > significance_level:
        return 0.0
    spare = float(weight.sum() - (weight @ weight) / weight.sum())
    return max(squares - degrees_of_freedom, 0.0) / spare


def copy_machine_with_learnt_priors(
    machine: Machine, terms: Mapping[LearnableTerm, LearntTerm]
) -> Machine:
    """Copy the machine with a calibration's learnt priors; priors stated in its file are kept."""
    if not terms:
        return machine
    stated = machine.settings.priors.learnt
    learnt = {**terms, **stated}
    content = {
        "priors.learnt": {name: learnt[name].model_dump() for name in sorted(learnt)},
    }
    return machine.model_copy(update={"settings": machine.settings.copy_with_changes(content)})


def copy_machine_estimating_learnt_mean_errors(machine: Machine) -> Machine:
    """Copy the machine, set to estimate errors of learnt means from logs of several loads."""
    changes = {"priors.learnt_means": "told"}
    return machine.model_copy(update={"settings": machine.settings.copy_with_changes(changes)})


def describe_contradicted_learnt_priors(nuisances: pl.DataFrame) -> str:
    """Sentence on how a later log contradicts its learnt priors; "" if it does not.

    Args:
        nuisances: the frame `nuisances`.
    """
    worst, said = LIMITS.contradicting_std, ""
    for row, own, std in iter_log_estimates_of_learnt_terms(nuisances):
        deviations = abs(own - row["prior_mean"]) / std
        if deviations > worst:
            worst = deviations
            said = (
                f"{row['term']} is {own:.3g} {row['unit']} in this log and "
                f"{row['prior_mean']:.3g} in its calibration, {deviations:.1f} standard "
                "deviations apart: the machine or the ground has changed"
            )
    return said


def iter_log_estimates_of_learnt_terms(
    nuisances: pl.DataFrame,
) -> Iterator[tuple[dict[str, Any], float, float]]:
    """Yield each learnt term's row, its estimate by the log alone, and how far that may deviate."""
    if "alone" not in nuisances.columns:
        return
    for row in nuisances.drop_nulls("alone").to_dicts():
        own = remove_normal_prior_from_posterior(
            (row["alone"], row["alone_std"]), (row["alone_prior_mean"], row["alone_prior_std"])
        )
        if own is not None and row["prior_mean_u"]:
            std = float(np.hypot(own[1], np.hypot(row["prior_std"], row["prior_mean_u"])))
            yield row, own[0], std


def describe_undetectable_changes_by_load(
    nuisances: pl.DataFrame, shared_errors: SharedErrors | None
) -> dict[int, str]:
    """Text on the largest change since the calibration that the log would not show, by load.

    Args:
        nuisances: the frame `nuisances`.
        shared_errors: responses of the log's masses to errors of learnt means.
    """
    if shared_errors is None:
        return {}
    place = {term: k for k, term in enumerate(shared_errors.terms)}
    times = np.zeros(len(place))
    for row, _, std in iter_log_estimates_of_learnt_terms(nuisances):
        if row["term"] in place and row["term"] in _CHANGES:
            times[place[row["term"]]] = LIMITS.contradicting_std * std / row["prior_mean_u"]
    return {
        number: _UNDETECTED.format(float(np.max(np.abs(moved_kg) * times, initial=0.0)))
        for (of, number), moved_kg in shared_errors.mass_responses_kg.items()
        if of == "mass"
    }
