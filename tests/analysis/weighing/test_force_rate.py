"""The rate of a noisy force, which slip needs where the force changes slowly as well."""

import numpy as np
import pytest

from analysis.weighing.fit_columns import differentiate_force
from analysis.weighing.motion_samples import Floats

RATE_HZ = 50.0
NOISE_N = 260.0
#: A throttle that opens within 0.3 s and closes over 4 s, between stands and at a steady force.
SLOW_N_S = -6e3
PARTS_N = {
    "stands": np.zeros(500),
    "opens": np.linspace(0.0, 30e3, 15),
    "closes": 30e3 + SLOW_N_S * np.arange(200) / RATE_HZ,
    "steady": np.full(500, 6e3),
}


@pytest.fixture(scope="module")
def force() -> Floats:
    force = np.concatenate(list(PARTS_N.values()))
    return force + np.random.default_rng(6).normal(0.0, NOISE_N, force.size)


def rate_in(part: str, force: Floats, *, keep_small: bool) -> Floats:
    """Rate within a part, without the rows at its ends that see another."""
    rate = differentiate_force(force, RATE_HZ, NOISE_N, keep_small=keep_small)
    names = list(PARTS_N)
    begin = sum(PARTS_N[name].size for name in names[: names.index(part)])
    return rate[begin + 12 : begin + PARTS_N[part].size - 12]


def test_a_throttle_that_closes_slowly_is_no_noise_where_slip_needs_it(force: Floats) -> None:
    assert rate_in("closes", force, keep_small=True).mean() == pytest.approx(SLOW_N_S, rel=0.05)
    assert np.mean(rate_in("closes", force, keep_small=False) != 0.0) < 0.1


def test_its_noise_is_a_tenth_of_it_then(force: Floats) -> None:
    rate = differentiate_force(force, RATE_HZ, NOISE_N, keep_small=True)
    noise_N_s = rate_in("stands", force, keep_small=True).std()
    assert 0.0 < noise_N_s < 0.1 * np.sqrt(np.mean(rate**2))


def test_a_force_that_is_noise_has_no_rate() -> None:
    noise = np.random.default_rng(7).normal(0.0, NOISE_N, 3000)
    assert np.mean(differentiate_force(noise, RATE_HZ, NOISE_N, keep_small=True) != 0.0) < 0.01
