"""What a calibration learnt, in words."""

from typing import get_args

from analysis.calibration.use.learnt_priors import (
    LearntPriors,
    TermOfLog,
    pool_learnt_terms_over_logs,
)
from analysis.model.prior_settings import LearnableTerm
from recordings.calibration.learnt_terms_text import TERMS, make_learnt_term_rows


def test_every_term_that_can_be_learnt_has_a_meaning_and_a_unit() -> None:
    assert set(TERMS) == set(get_args(LearnableTerm))


def test_a_row_has_what_its_prior_has() -> None:
    said = tuple(
        TermOfLog(
            log=f"log-{k}",
            term="lag",
            prior_mean=0.0,
            prior_std=0.02,
            posterior=0.004,
            posterior_std=0.001,
        )
        for k in range(3)
    )
    (row,) = make_learnt_term_rows(LearntPriors(terms=pool_learnt_terms_over_logs(said), logs=said))
    assert row == {
        "term": "delay of the force",
        "unit": "s",
        "mean": "0.00401",
        "mean_u": "0.00058",
        "width": "0.0002",
        "logs": 3,
    }
    assert make_learnt_term_rows(None) == []
