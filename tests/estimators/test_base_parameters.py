"""Least squares that gives what a motion determines and NaN for the rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators import ls, planar
from estimators.base_parameters import fit
from estimators.errors import DataError
from tests.estimators.motions import LOADER, MOTIONS, constant_arc, forces, spin

AT = {name: i for i, name in enumerate(planar.PARAMETERS)}
SIGMA = np.array([60.0, 25.0])


def fitted(motion, **options):
    return fit(planar.regressor(**motion), forces(motion), planar.PARAMETERS, **options)


@pytest.mark.parametrize("motion", MOTIONS)
def test_identifiable_parameters_are_the_truth_and_the_others_nan_never_a_number(motion):
    found = fitted(MOTIONS[motion])
    single = found.identifiability.identifiable
    np.testing.assert_allclose(found.theta[single], LOADER[single], rtol=1e-9)
    assert np.isnan(found.theta[~single]).all()
    assert np.isfinite(found.std[single]).all()
    assert np.isnan(found.std[~single]).all()
    combined = found.identifiability.combinations @ LOADER
    np.testing.assert_allclose(found.combination, combined, rtol=1e-9)


def test_an_offset_spin_tells_the_combinations():
    found = fitted(spin(-0.2))
    m, inertia, moment = LOADER[:3]
    np.testing.assert_allclose(found.combination, [m - 5 * moment, inertia - 0.2 * moment])


def test_an_arc_tells_the_first_moment_once_the_friction_is_known():
    known = {"friction_x_N_s_m": (2891.0, 50.0), "friction_z_N_m_s": (1500.0, 20.0)}
    found = fitted(constant_arc(), known=known)
    np.testing.assert_allclose(found.theta[AT["first_moment_x_kg_m"]], 500.0)
    assert np.isnan(found.theta[AT["mass_kg"]])
    np.testing.assert_allclose(found.theta[AT["friction_x_N_s_m"]], 2891.0)
    np.testing.assert_allclose(found.std[AT["friction_x_N_s_m"]], 50.0)


def test_the_error_of_what_is_known_is_an_error_of_what_is_found():
    """From f_x alone, mc_x = (v b_x - f_x) / ω²: its error is v / ω² times that of b_x."""
    arc = constant_arc()
    A = planar.regressor(**arc)[:, :1]
    f = forces(arc)[:, :1]
    found = fit(A, f, planar.PARAMETERS, known={"friction_x_N_s_m": (2891.0, 50.0)})
    i, j = AT["first_moment_x_kg_m"], AT["friction_x_N_s_m"]
    assert found.std[i] == pytest.approx(7.5 * 50.0)
    assert found.covariance[i, j] == pytest.approx(7.5 * 50.0**2)


def test_straight_spin_and_arc_together_determine_what_each_alone_does_not():
    stretches = [MOTIONS["straight"], MOTIONS["spin about the origin"], constant_arc()]
    A = np.concatenate([planar.regressor(**motion) for motion in stretches])
    f = np.concatenate([forces(motion) for motion in stretches])
    found = fit(A, f, planar.PARAMETERS, segment_id=np.repeat([4, 7, 9], 2000))
    assert found.identifiability.rank == 6
    np.testing.assert_allclose(found.theta, LOADER, rtol=1e-9)
    ratio, _ = found.quotient("first_moment_x_kg_m", "mass_kg")
    assert ratio == pytest.approx(500.0 / 3614.0)


def test_nominal_95_percent_intervals_cover_at_unequal_noise_of_the_axes_after_a_moving_mean():
    """Smoothed like the log: force noise of 60 N and 25 N·m before a mean of ten samples."""
    A = planar.regressor(**MOTIONS["joint"])
    truth = A @ LOADER
    kernel = np.ones(10) / 10
    covered, com_covered = [], []
    com = LOADER[AT["first_moment_x_kg_m"]] / LOADER[0]
    for seed in range(200):
        noise = SIGMA * np.random.default_rng(seed).normal(size=(2009, 2))
        f = truth + np.column_stack([np.convolve(x, kernel, "valid") for x in noise.T])
        found = fit(A, f, planar.PARAMETERS)
        covered.append(np.abs(found.theta - LOADER) < 1.96 * found.std)
        ratio, std = found.quotient("first_moment_x_kg_m", "mass_kg")
        com_covered.append(abs(ratio - com) < 1.96 * std)
    assert (np.mean(covered, axis=0) > 0.90).all()
    assert (np.mean(covered, axis=0) < 0.99).all()
    assert 0.90 < np.mean(com_covered) < 0.99


def test_the_axes_are_weighted_by_their_noise():
    """mc_y stands in both rows; with a useless force its value comes from the torque."""
    motion = MOTIONS["joint"]
    A, f = planar.regressor(**motion), forces(motion)
    f = f + np.random.default_rng(2).normal(size=f.shape) * [2000.0, 1.0]
    found = fit(A, f, planar.PARAMETERS)
    weighted = A / np.array([2000.0, 1.0])[:, None]
    cover = np.linalg.inv(weighted.reshape(-1, 6).T @ weighted.reshape(-1, 6))
    np.testing.assert_allclose(found.std, np.sqrt(np.diagonal(cover)), rtol=0.2)
    np.testing.assert_allclose(found.residual_rms, [2000.0, 1.0], rtol=0.1)


def test_one_axis_in_one_stretch_is_ordinary_least_squares():
    A = planar.straight(MOTIONS["straight"]["specific_force_x"], MOTIONS["straight"]["speed"])
    f = A @ [3614.0, 2891.0] + np.random.default_rng(4).normal(scale=60.0, size=2000)
    found = fit(A[:, None], f[:, None], planar.STRAIGHT_PARAMETERS)
    expected = ls.fit(A, f)
    np.testing.assert_allclose(found.theta, expected.theta, rtol=1e-9)
    np.testing.assert_allclose(found.std, expected.std, rtol=1e-6)


def test_samples_left_out_may_be_nan():
    motion = MOTIONS["joint"]
    A, f = planar.regressor(**motion), forces(motion)
    segment_id = np.where(np.arange(2000) % 50 < 5, -1, np.arange(2000) // 1000)
    A[segment_id < 0] = f[segment_id < 0] = np.nan
    found = fit(A, f, planar.PARAMETERS, segment_id=segment_id)
    np.testing.assert_allclose(found.theta, LOADER, rtol=1e-9)


@settings(deadline=None, max_examples=30)
@given(
    st.lists(st.sampled_from(sorted(MOTIONS)), min_size=1, max_size=3), st.integers(0, 2**32 - 1)
)
def test_any_sequence_of_motions_gives_truth_or_nan(chosen, seed):
    loader = LOADER * np.random.default_rng(seed).uniform(0.2, 5.0, 6)
    A = np.concatenate([planar.regressor(**MOTIONS[name]) for name in chosen])
    f = A @ loader
    found = fit(A, f, planar.PARAMETERS, np.repeat(np.arange(len(chosen)), 2000))
    single = found.identifiability.identifiable
    np.testing.assert_allclose(found.theta[single], loader[single], rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(found.theta), ~single)


@pytest.mark.parametrize("samples", [0, 100])
def test_standstill_tells_nothing_and_is_no_error(samples):
    found = fit(np.zeros((samples, 2, 6)), np.ones((samples, 2)), planar.PARAMETERS)
    assert np.isnan(found.theta).all()
    assert np.isnan(found.std).all()
    assert found.combination.size == 0


def test_what_is_wrong_is_said_in_one_line():
    A, f = np.ones((5, 2, 6)), np.ones((5, 2))
    with pytest.raises(DataError, match="did you mean 'mass_kg'"):
        fit(A, f, planar.PARAMETERS, known={"mass_k": (1.0, 0.0)})
    with pytest.raises(DataError, match=r"asks for forces \(5, 2\)"):
        fit(A, f[:, 0], planar.PARAMETERS)
    with pytest.raises(DataError, match="forces hold NaN"):
        fit(A, np.nan * f, planar.PARAMETERS)


@settings(deadline=None)
@given(st.floats(-15, 0))
def test_however_nearly_columns_depend_there_is_an_estimate_with_or_without_a_deviation(exponent):
    generator = np.random.default_rng(6)
    a, b, e = generator.normal(size=(3, 300))
    A = np.column_stack([a, a + 10.0**exponent * b])[:, None]
    found = fit(A, (A @ [3.0, 5.0]) + 1e-3 * e[:, None], ["one_1", "other_1"])
    if found.identifiability.rank == 2:
        error = np.abs(found.theta - [3.0, 5.0])
        assert np.isnan(found.std).all() or (error < 5.0 * found.std).all()
    else:
        assert np.isnan(found.theta).all()
        assert found.combination == pytest.approx([8.0], abs=1e-3)
