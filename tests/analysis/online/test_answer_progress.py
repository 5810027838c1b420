"""How far from an answer: more starts, fewer missing; a load that changes begins anew."""

import math

import numpy as np
import pytest

from analysis.model.machine_body import Body
from analysis.online.answer_progress import (
    AnswerProgress,
    choose_target_uncertainty_kg,
    describe_missing_manoeuvres,
)


def after(masses: list[float], *, u_kg: float = 6.0, aim_kg: float | None = 3.0) -> AnswerProgress:
    progress = AnswerProgress(aim_kg)
    for mass_kg in masses:
        progress = progress.add_manoeuvre(mass_kg, u_kg, 1.0)
    return progress


def test_before_the_first_start_nobody_knows_how_many_are_missing() -> None:
    nothing = AnswerProgress(3.0)
    assert nothing.u_kg is None
    assert nothing.missing_manoeuvre_count is None
    assert nothing.information_percent == 0.0
    assert describe_missing_manoeuvres(None, None) == "a start that the gate accepts"


def test_a_start_of_twice_the_aim_needs_three_more() -> None:
    first = after([3600.0])
    assert first.u_kg == pytest.approx(6.0)
    assert first.missing_manoeuvre_count == 3
    assert first.information_percent == pytest.approx(25.0)


def test_the_uncertainty_falls_with_the_root_of_the_starts() -> None:
    masses = list(3600.0 + 6.0 * np.random.default_rng(1).standard_normal(100))
    assert after(masses).u_kg == pytest.approx(0.6, rel=0.2)
    assert after(masses).missing_manoeuvre_count == 0
    assert after(masses).information_percent == 100.0


def test_starts_that_scatter_more_than_they_say_are_believed() -> None:
    masses = list(3600.0 + 18.0 * np.random.default_rng(2).standard_normal(60))
    many = after(masses, u_kg=6.0)
    assert many.u_kg is not None
    assert many.u_kg > 2.0 * 6.0 / math.sqrt(60)


def test_another_load_begins_anew() -> None:
    progress = after([3600.0, 3605.0, 3598.0])
    loaded = progress.add_manoeuvre(3900.0, 6.0, 1.0)
    assert loaded.manoeuvre_count == 1
    assert loaded.mean_kg == 3900.0
    assert loaded.until_u_kg == 3.0


def test_what_is_missing_is_shared_out_so_that_both_directions_have_as_many() -> None:
    ahead = after([3600.0, 3603.0])
    assert ahead.missing_manoeuvre_count is not None
    assert ahead.missing_reverse_count is not None
    assert describe_missing_manoeuvres(2, 2) == "2 more starts in reverse"
    assert describe_missing_manoeuvres(3, 1) == "2 more starts forward and 1 more start in reverse"
    assert (
        ahead.forward + ahead.missing_manoeuvre_count - ahead.missing_reverse_count
        == pytest.approx(ahead.reverse + ahead.missing_reverse_count, abs=1)
    )
    back = AnswerProgress(3.0).add_manoeuvre(3600.0, 6.0, -1.0)
    assert back.reverse == 1
    assert back.missing_reverse_count == 1


def test_without_an_aim_nothing_is_missing_that_could_be_told() -> None:
    aimless = after([3600.0], aim_kg=None)
    assert aimless.information_percent is None
    assert aimless.missing_manoeuvre_count is None
    assert aimless.u_kg == pytest.approx(6.0)


def test_the_aim_is_what_somebody_says_or_a_share_of_the_empty_mass() -> None:
    body = Body(name="loader", empty_mass_kg=3600.0)
    assert choose_target_uncertainty_kg(body, None) == pytest.approx(72.0)
    assert choose_target_uncertainty_kg(body, 5.0) == 5.0
    assert choose_target_uncertainty_kg(Body(name="loader"), None) is None
