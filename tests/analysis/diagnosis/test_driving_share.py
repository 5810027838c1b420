"""Whether the force has its sign, where gravity drives the machine as well."""

import numpy as np
import polars as pl
import pytest

from analysis.diagnosis.check_inputs import AxisMotion, CheckInputs
from analysis.diagnosis.checks import CHECKS
from estimators.arrays import Floats
from replay import load_machine


def driving_share(regressor_m_s2: Floats, force_N: Floats) -> float:
    """Number of the check for a machine that speeds up forwards throughout."""
    (check,) = (each for each in CHECKS if each.name == "driving_share")
    yes = np.ones(force_N.size, np.bool_)
    A = np.column_stack([regressor_m_s2, np.full(force_N.size, 2.0)])
    inputs = CheckInputs(pl.DataFrame(), pl.DataFrame(), load_machine("cat262c.toml"))
    return check.number(inputs, AxisMotion(A, force_N, yes, yes, ~yes, speeding=yes))


def test_a_force_that_holds_back_downhill_has_its_sign() -> None:
    uphill, downhill = np.full(10, 1.5), np.full(30, -0.9)
    force_N = np.concatenate([np.full(10, 5000.0), np.full(30, -2000.0)])
    assert driving_share(np.concatenate([uphill, downhill]), force_N) == 1.0


def test_a_machine_that_only_gravity_drives_is_judged_by_all_of_it() -> None:
    assert driving_share(np.full(30, -0.9), np.full(30, -2000.0)) == 0.0


@pytest.mark.parametrize("share", [0.5, 0.2])
def test_a_force_without_its_sign_has_none_on_the_level(share: float) -> None:
    force_N = np.where(np.arange(40) < 40 * share, 5000.0, -5000.0)
    assert driving_share(np.full(40, 0.8), force_N) == share
