"""The joint fit works on a log in pieces, and finds what it finds in the whole."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.weighing import motion_samples
from analysis.weighing.fit_columns import PreviousEstimates, average_and_weight_fit_columns
from tests.analysis.weighing.weighed import RICH, weighed

#: Of what earlier rounds find, everything reaches to other samples or other columns.
FOUND = PreviousEstimates(
    force_delay_s=0.13,
    slip_1_N=1e-5,
    load_transfer_s2_m=0.02,
    offset_N=40.0,
    slip_s_m=-0.03,
    speed_delay_s=0.07,
    motion_gain=0.01,
)


@pytest.mark.parametrize("found", [PreviousEstimates(), FOUND], ids=["at first", "later"])
@pytest.mark.parametrize("samples", [5, 40])
def test_columns_of_pieces_are_those_of_the_whole(found, samples, monkeypatch):
    log = weighed(RICH)
    fit = log.weighing.fit
    noise = _White()
    of_whole = average_and_weight_fit_columns(fit.motion, noise, fit.terms, samples, found)
    monkeypatch.setattr(motion_samples, "_PIECE", 200)
    motion = replace(fit.motion)  # which has not been cut yet
    assert len(motion.pieces_split_between_stretches) > 5
    of_pieces = average_and_weight_fit_columns(motion, noise, fit.terms, samples, found)
    np.testing.assert_array_equal(of_pieces.group, of_whole.group)
    for mine, whole in (
        (of_pieces.A, of_whole.A),
        (of_pieces.f, of_whole.f),
        (of_pieces.noise.gram, of_whole.noise.gram),
        (of_pieces.noise.cross, of_whole.noise.cross),
    ):
        np.testing.assert_allclose(mine, whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max())


class _White:
    """Noise of three columns that averages out."""

    def compute_covariance_of_means(self, samples):
        return np.diag([0.04, 0.0009, 2500.0]) / samples
