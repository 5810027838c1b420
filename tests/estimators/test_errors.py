"""The exception tree, and the hint at a misspelt word."""

import inspect
import pickle

import pytest

from estimators import errors
from tests.one_line import assert_one_line


def test_every_error_is_a_payscope_error_with_a_docstring():
    found = [
        c for _, c in inspect.getmembers(errors, inspect.isclass) if c.__module__ == errors.__name__
    ]
    assert len(found) == 13
    for error in found:
        assert issubclass(error, errors.PayscopeError)
        assert error.__doc__


def test_an_error_is_one_line_also_where_it_quotes_what_is_none():
    error = errors.LogError("a.csv: no topic '/a\n\x1b[2J\u2028\x0c\ud800ü🚜'")
    assert str(error) == "a.csv: no topic '/a �[2J  �ü🚜'"


@pytest.mark.parametrize("text", ["a.csv: 2 faults\n- a\n- b", "a.csv: Traceback (most recent"])
def test_what_an_error_was_given_is_kept_so_that_a_report_of_many_lines_shows(text):
    error = errors.LogError(text)
    assert "\n" not in str(error)
    assert pickle.loads(pickle.dumps(error)).args == (text,)
    with pytest.raises(AssertionError):
        assert_one_line(error)


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("treshold_nat", "did you mean 'threshold_nat'?"),
        ("window_sample", "did you mean 'window_samples'?"),
        ("zzz", "known: threshold_nat, window_samples"),
        ("", "known: threshold_nat, window_samples"),
    ],
)
def test_a_misspelt_word_gets_the_nearest_choice_or_all_of_them(word, hint):
    assert errors.suggest_choice(word, {"window_samples", "threshold_nat"}) == hint


def test_no_choices_are_said_to_be_none():
    assert errors.suggest_choice("word", []) == "known: none"
    assert errors.suggest_choice("word", (c for c in ["words"])) == "did you mean 'words'?"
