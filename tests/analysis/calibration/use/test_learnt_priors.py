"""What the logs of a campaign say together of nuisances, and what a later log contradicts."""

import numpy as np
import polars as pl
import pytest

from analysis.calibration.line.procedure import PROCEDURES, Procedure
from analysis.calibration.use.learnt_priors import (
    TermOfLog,
    copy_machine_with_learnt_priors,
    describe_contradicted_learnt_priors,
    pool_learnt_terms_over_logs,
    remove_normal_prior_from_posterior,
)
from replay.machines.machine_file import load_machine

PRIOR = 0.015


def said(values, own_std, term="load_transfer", prior=PRIOR, mean=0.0):
    """What logs say whose own data alone says `values` ± `own_std`."""
    information = own_std**-2 + prior**-2
    return [
        TermOfLog(
            log=f"{number}.bag",
            term=term,
            prior_mean=mean,
            prior_std=prior,
            posterior=(value * own_std**-2 + mean * prior**-2) / information,
            posterior_std=information**-0.5,
        )
        for number, value in enumerate(values)
    ]


def test_a_prior_is_taken_off_what_a_log_says():
    (one,) = said([0.01], 0.02, mean=0.004)
    value, std = remove_normal_prior_from_posterior(
        (one.posterior, one.posterior_std), (0.004, PRIOR)
    )
    assert (value, std) == pytest.approx((0.01, 0.02))
    assert remove_normal_prior_from_posterior((0.0, PRIOR), (0.0, PRIOR)) is None


def test_the_prior_counts_once_and_not_once_a_log():
    values = np.array([0.004, 0.006, 0.005, 0.007, 0.003, 0.005])
    found = pool_learnt_terms_over_logs(said(values, 0.02))["load_transfer"]
    total = 6 / 0.02**2 + PRIOR**-2
    assert found.mean == pytest.approx(values.sum() / 0.02**2 / total)
    assert found.mean_u == pytest.approx(total**-0.5)
    assert found.std == pytest.approx(PRIOR / 100)


def test_what_differs_between_logs_beyond_chance_is_the_width():
    dice = np.random.default_rng(5)
    found = pool_learnt_terms_over_logs(said(dice.normal(0.0, 100.0, 60), 20.0, "const", 466.0))[
        "const"
    ]
    assert found.std == pytest.approx(100.0, rel=0.2)
    assert found.mean_u == pytest.approx(np.hypot(100.0, 20.0) / np.sqrt(60), rel=0.2)


@pytest.mark.heavy
def test_chance_makes_one_campaign_in_twenty_vary_not_one_in_three():
    dice = np.random.default_rng(8)
    own = {"const": 40.0, "direction": 40.0, "lag": 1e-3, "load_transfer": 0.02}
    own |= {"quadratic": 8.0, "slip": 2e-3, "speed_delay": 2e-3, "gain": 2e-3}

    def varies(procedure: Procedure, logs: list[TermOfLog]) -> bool:
        found = pool_learnt_terms_over_logs(logs, procedure)
        return any(found[name].std > 0.5 * std for name, std in own.items())

    campaigns = [
        [
            log_term
            for name, std in own.items()
            for log_term in said(dice.normal(0.0, std, 6), std, name, 10.0 * std)
        ]
        for _ in range(400)
    ]
    shares = {
        number: np.mean([varies(procedure, logs) for logs in campaigns])
        for number, procedure in PROCEDURES.items()
    }
    assert shares[2] < 0.08
    assert shares[1] > 0.25


def test_two_logs_teach_nothing():
    assert pool_learnt_terms_over_logs(said([0.0, 0.01], 0.02)) == {}


def test_logs_that_know_nothing_leave_the_prior():
    found = pool_learnt_terms_over_logs(said([0.0] * 4, 1e4))["load_transfer"]
    assert (found.mean, found.mean_u) == pytest.approx((0.0, PRIOR))


def test_what_a_machine_file_states_stays():
    stated = load_machine(
        "cat262c.toml",
        ["settings.priors.learnt.load_transfer={mean = 0.1, std = 0.2, mean_u = 0.3}"],
    )
    machine = copy_machine_with_learnt_priors(
        stated,
        pool_learnt_terms_over_logs(said([0.0] * 3, 0.02) + said([5.0] * 3, 9.0, "const", 50.0)),
    )
    terms = machine.settings.priors.learnt
    assert list(terms) == ["const", "load_transfer"]
    assert terms["load_transfer"].mean == 0.1
    assert copy_machine_with_learnt_priors(stated, {}) is stated


def test_a_later_log_contradicts_from_four_deviations_on():
    def nuisances(alone):
        information = 40.0**-2 + 466.0**-2
        return pl.DataFrame(
            {
                "term": ["const"],
                "unit": ["N"],
                "prior_mean": [0.0],
                "prior_std": [5.0],
                "prior_mean_u": [16.0],
                "alone": [alone * 40.0**-2 / information],
                "alone_std": [information**-0.5],
                "alone_prior_mean": [0.0],
                "alone_prior_std": [466.0],
            }
        )

    limit = 4.0 * np.sqrt(40.0**2 + 5.0**2 + 16.0**2)
    assert describe_contradicted_learnt_priors(nuisances(limit - 1.0)) == ""
    assert (
        "const is 200 N in this log and 0 in its calibration"
        in describe_contradicted_learnt_priors(nuisances(200.0))
    )
    assert describe_contradicted_learnt_priors(nuisances(200.0).select("term", "unit")) == ""
