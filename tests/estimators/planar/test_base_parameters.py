"""Least squares that gives what a motion determines and NaN for the rest."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.errors import DataError
from estimators.methods import ls
from estimators.planar import blockwise_qr, planar_rows
from estimators.planar.base_estimate import Prior
from estimators.planar.base_parameters import fit
from tests.estimators.motions import LOADER, MOTIONS, constant_arc, forces, measured, spin

AT = {name: i for i, name in enumerate(planar_rows.PARAMETERS)}
SIGMA = np.array([60.0, 25.0])


def known(axes=2, **told):
    """A prior of value and standard deviation."""
    values, stds = np.transpose(list(told.values()))
    mean = np.zeros((axes, len(told)))
    mean[0] = values
    return Prior(tuple(told), mean, np.diag(np.square(stds)))


def fitted(motion, **options):
    return fit(
        planar_rows.make_planar_regressor(**motion),
        forces(motion),
        planar_rows.PARAMETERS,
        **options,
    )


@pytest.mark.parametrize("motion", MOTIONS)
def test_identifiable_parameters_are_the_truth_and_the_others_nan_never_a_number(motion):
    found = fitted(MOTIONS[motion])
    single = found.identifiability.identifiable
    np.testing.assert_allclose(found.theta[single], LOADER[single], rtol=1e-9)
    assert np.isnan(found.theta[~single]).all()
    assert np.isfinite(found.parameter_stds[single]).all()
    assert np.isnan(found.parameter_stds[~single]).all()
    combined = found.identifiability.determined_combinations @ LOADER
    np.testing.assert_allclose(found.combination, combined, rtol=1e-9)


def test_an_offset_spin_tells_the_combinations():
    found = fitted(spin(-0.2))
    m, inertia, moment = LOADER[:3]
    np.testing.assert_allclose(found.combination, [m - 5 * moment, inertia - 0.2 * moment])


def noisy_arc():
    """Regressor and force; the force has the noise of its sensors, which weighs it."""
    arc = constant_arc()
    noise = SIGMA * np.random.default_rng(5).normal(size=(2000, 2))
    return planar_rows.make_planar_regressor(**arc), forces(arc) + noise


def test_an_arc_tells_the_first_moment_once_the_friction_is_known():
    A, f = noisy_arc()
    prior = known(friction_x_N_s_m=(2891.0, 50.0), friction_z_N_m_s=(1500.0, 20.0))
    found = fit(A, f, planar_rows.PARAMETERS, prior=prior)
    moment, friction = AT["first_moment_x_kg_m"], AT["friction_x_N_s_m"]
    assert abs(found.theta[moment] - 500.0) < 3.0 * found.parameter_stds[moment]
    assert np.isnan(found.theta[AT["mass_kg"]])
    # by the yaw torque mc_x = (τ_z - ω b_ψ) / (ω v), whose error is that of b_ψ over v
    assert found.parameter_stds[moment] == pytest.approx(20.0 / 1.2, rel=0.05)
    # and what mc_x leaves of the force is friction: it is better known than before
    assert found.parameter_stds[friction] == pytest.approx(20.0 / 1.2 * 0.4**2 / 1.2, rel=0.3)


def test_the_error_of_what_is_known_is_an_error_of_what_is_found():
    """From f_x alone, mc_x = (v b_x - f_x) / ω²: its error is v / ω² times that of b_x."""
    A, f = noisy_arc()
    prior = known(1, friction_x_N_s_m=(2891.0, 50.0))
    found = fit(A[:, :1], f[:, :1], planar_rows.PARAMETERS, prior=prior)
    i, j = AT["first_moment_x_kg_m"], AT["friction_x_N_s_m"]
    assert found.parameter_stds[i] == pytest.approx(7.5 * 50.0, rel=0.01)
    assert found.covariance[i, j] == pytest.approx(7.5 * 50.0**2, rel=0.01)
    assert abs(found.responses[0, i]) == pytest.approx(7.5 * 50.0, rel=0.01)


def test_an_uncertainty_that_no_residual_shows_is_added_to_what_follows_the_parameter():
    """As in the arc above: a u of 100 N·s/m more of the friction is one of 750 kg·m."""
    A, f = noisy_arc()
    prior = known(1, friction_x_N_s_m=(2891.0, 50.0))
    before = fit(A[:, :1], f[:, :1], planar_rows.PARAMETERS, prior=prior)
    found = before.copy_with_parameter_uncertainty("friction_x_N_s_m", 100.0)
    i, j = AT["first_moment_x_kg_m"], AT["friction_x_N_s_m"]
    assert found.parameter_stds[j] == pytest.approx(np.hypot(before.parameter_stds[j], 100.0))
    assert found.parameter_stds[i] == pytest.approx(
        np.hypot(before.parameter_stds[i], 750.0), rel=0.01
    )
    assert found.responses[-1, [i, j]] == pytest.approx([750.0, 100.0], rel=0.01)
    np.testing.assert_array_equal(found.theta, before.theta)


@pytest.mark.heavy
@pytest.mark.parametrize(
    # 30 trials tell a share of 0.95 to within 0.04 (one sigma)
    ("trials", "least"),
    [(30, 0.82), pytest.param(200, 0.90, marks=pytest.mark.slow)],
)
def test_intervals_cover_with_a_term_of_which_only_the_size_is_known(trials, least):
    """A torque against the direction of turning: 200 N·m, give or take."""
    plain = planar_rows.make_planar_regressor(**MOTIONS["joint"])
    opposing = np.zeros((plain.shape[0], 2, 1))
    opposing[:, 1, 0] = np.sign(MOTIONS["joint"]["yaw_rate"])
    A = np.concatenate([plain, opposing], axis=-1)
    names = (*planar_rows.PARAMETERS, "coulomb_z_N_m")
    covered, left_out = [], []
    for seed in range(trials):
        dice = np.random.default_rng(seed)
        f = A @ np.append(LOADER, dice.normal(0.0, 200.0)) + SIGMA * dice.normal(size=(2000, 2))
        found = fit(A, f, names, prior=Prior.make_zero_mean({"coulomb_z_N_m": 200.0}, 2))
        covered.append(np.abs(found.theta[:6] - LOADER) < 1.96 * found.parameter_stds[:6])
        without = fit(plain, f, planar_rows.PARAMETERS)
        left_out.append(np.abs(without.theta - LOADER) < 1.96 * without.parameter_stds)
    assert (np.mean(covered, axis=0) > least).all()
    assert np.mean(left_out, axis=0)[AT["friction_z_N_m_s"]] < 0.5


def test_the_axes_add_up_and_a_gain_of_one_acts_on_its_own_share():
    A, f = noisy_arc()
    prior = known(friction_x_N_s_m=(2891.0, 50.0), friction_z_N_m_s=(1500.0, 20.0))
    found = fit(A, f, planar_rows.PARAMETERS, prior=prior)
    moment = AT["first_moment_x_kg_m"]
    assert found.by_axis[:, moment].sum() == pytest.approx(found.theta[moment])
    stronger = fit(A, f * [1.0, 1.001], planar_rows.PARAMETERS, prior=prior)
    change = stronger.theta[moment] - found.theta[moment]
    assert change == pytest.approx(0.001 * found.by_axis[1, moment], rel=0.05)


def test_straight_spin_and_arc_together_determine_what_each_alone_does_not():
    stretches = [MOTIONS["straight"], MOTIONS["spin about the origin"], constant_arc()]
    A = np.concatenate([planar_rows.make_planar_regressor(**motion) for motion in stretches])
    f = np.concatenate([forces(motion) for motion in stretches])
    found = fit(A, f, planar_rows.PARAMETERS, stretch_of_sample=np.repeat([4, 7, 9], 2000))
    assert found.identifiability.rank == 6
    np.testing.assert_allclose(found.theta, LOADER, rtol=1e-9)
    ratio, _ = found.ratio_and_std("first_moment_x_kg_m", "mass_kg")
    assert ratio == pytest.approx(500.0 / 3614.0)


@pytest.mark.parametrize(
    # 30 trials tell a share of 0.95 to within 0.04 (one sigma)
    ("trials", "least", "most"),
    [(30, 0.82, 1.01), pytest.param(200, 0.90, 0.99, marks=pytest.mark.slow)],
)
def test_nominal_95_percent_intervals_cover_at_unequal_noise_of_the_axes_after_a_moving_mean(
    trials, least, most
):
    """Smoothed like the log: force noise of 60 N and 25 N·m before a mean of ten samples."""
    A = planar_rows.make_planar_regressor(**MOTIONS["joint"])
    truth = A @ LOADER
    kernel = np.ones(10) / 10
    covered, com_covered = [], []
    com = LOADER[AT["first_moment_x_kg_m"]] / LOADER[0]
    for seed in range(trials):
        noise = SIGMA * np.random.default_rng(seed).normal(size=(2009, 2))
        f = truth + np.column_stack([np.convolve(x, kernel, "valid") for x in noise.T])
        found = fit(A, f, planar_rows.PARAMETERS)
        covered.append(np.abs(found.theta - LOADER) < 1.96 * found.parameter_stds)
        ratio, std = found.ratio_and_std("first_moment_x_kg_m", "mass_kg")
        com_covered.append(abs(ratio - com) < 1.96 * std)
    assert (np.mean(covered, axis=0) > least).all()
    assert (np.mean(covered, axis=0) < most).all()
    assert least < np.mean(com_covered) < most


#: An inertia is drawn by (0.02 / 0.32)² = 0.4 %.
NOISE = {
    "specific_force_x": 0.01,
    "specific_force_y": 0.01,
    "speed": 0.005,
    "yaw_rate": 0.002,
    "yaw_acceleration": 0.02,
}


def noisy(motion, seed, mean=1):
    """The regressor with noise on every channel, the true force with noise, noise of columns."""
    generator = np.random.default_rng(seed)
    A = planar_rows.make_planar_regressor(**measured(motion, NOISE, generator, mean))
    f = forces(motion)[mean - 1 :] + SIGMA / 10 * generator.normal(size=(A.shape[0], 2))
    turning = float(np.sqrt(np.mean(motion["yaw_rate"] ** 2)))
    return A, f, planar_rows.compute_column_noise_rms(turning, **NOISE)


@pytest.mark.parametrize(
    # 20 trials tell a share of 0.95 to within 0.05, a mean to within 0.22 deviations (one sigma)
    ("trials", "least", "most_left"),
    [(20, 0.75, 0.5), pytest.param(100, 0.90, 0.2, marks=pytest.mark.slow)],
)
def test_known_noise_of_the_columns_draws_nothing_and_nominal_95_percent_intervals_cover(
    trials, least, most_left
):
    covered, errors, drawn = [], [], []
    for seed in range(trials):
        A, f, noise = noisy(MOTIONS["joint"], seed)
        found = fit(A, f, planar_rows.PARAMETERS, noise=noise)
        covered.append(np.abs(found.theta - LOADER) < 1.96 * found.parameter_stds)
        errors.append(found.theta - LOADER)
        drawn.append(fit(A, f, planar_rows.PARAMETERS).theta - LOADER)
    assert (np.mean(covered, axis=0) >= least).all()
    inertia = AT["inertia_z_kg_m2"]
    bias, before = np.mean(errors, axis=0)[inertia], np.mean(drawn, axis=0)[inertia]
    assert before < -0.003 * LOADER[inertia]
    assert abs(bias) < most_left * abs(before)


def test_noise_is_taken_off_combinations_alike():
    """A spin about a point 0.2 m off tells Izz - 0.2 mc_x, in the column of Izz."""
    truth = LOADER[1] - 0.2 * LOADER[2]
    found, drawn = [], []
    for seed in range(30):
        A, f, noise = noisy(spin(-0.2), seed)
        told = fit(A, f, planar_rows.PARAMETERS, noise=noise)
        assert told.identifiability.format_combinations()[-1].startswith("inertia_z_kg_m2 - ")
        assert abs(told.combination[-1] - truth) < 4 * told.combination_std[-1]
        found.append(told.combination[-1])
        plain = fit(A[..., [1, 5]], f, ["inertia_z_kg_m2", "friction_z_N_m_s"])
        drawn.append(plain.theta[0])
    assert np.mean(drawn) < 0.998 * truth
    assert np.mean(found) == pytest.approx(truth, rel=0.001)


def test_what_a_known_one_errs_by_is_passed_on_through_the_columns_without_their_noise():
    A, f, noise = noisy(MOTIONS["joint"], 1)
    at, off = (
        fit(
            A,
            f,
            planar_rows.PARAMETERS,
            prior=known(friction_z_N_m_s=(1500.0 + d, 10.0)),
            noise=noise,
        )
        for d in (0.0, 1.0)
    )
    i = AT["inertia_z_kg_m2"]
    # the weights of the axes move a little with the known one
    assert off.theta[i] - at.theta[i] == pytest.approx(at.responses[0, i] / 10.0, rel=0.05)


def test_a_log_of_many_blocks_is_fitted_as_one_and_blocks_need_not_be_an_array(monkeypatch):
    A, f, noise = noisy(MOTIONS["joint"], 2, mean=10)
    stretch_of_sample = np.where(np.arange(1991) % 700 < 30, -1, np.arange(1991) // 700)
    whole = fit(A, f, planar_rows.PARAMETERS, stretch_of_sample, noise=noise)
    monkeypatch.setattr(blockwise_qr, "BLOCK", 137)
    channels = measured(MOTIONS["joint"], NOISE, np.random.default_rng(2), 10)
    parts = fit(
        planar_rows.PlanarRegressor(**channels),
        f,
        planar_rows.PARAMETERS,
        stretch_of_sample,
        noise=noise,
    )
    np.testing.assert_allclose(parts.theta, whole.theta, rtol=1e-10)
    np.testing.assert_allclose(parts.covariance, whole.covariance, rtol=1e-8)


def test_a_long_log_is_never_held_as_one_regressor():
    """Whose 96 bytes a sample, and copies of it, are gigabytes a shift."""
    channels = {name: np.tile(x, 300) for name, x in MOTIONS["joint"].items()}
    f = np.tile(forces(MOTIONS["joint"]), (300, 1)) + np.random.default_rng(1).normal(
        size=(600_000, 2)
    )
    tracemalloc.start()
    try:
        found = fit(planar_rows.PlanarRegressor(**channels), f, planar_rows.PARAMETERS)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    np.testing.assert_allclose(found.theta, LOADER, rtol=1e-3)
    assert peak / 600_000 < 120.0


def test_the_axes_are_weighted_by_their_noise():
    """mc_y stands in both rows; with a useless force its value comes from the torque."""
    motion = MOTIONS["joint"]
    A, f = planar_rows.make_planar_regressor(**motion), forces(motion)
    f = f + np.random.default_rng(2).normal(size=f.shape) * [2000.0, 1.0]
    found = fit(A, f, planar_rows.PARAMETERS)
    weighted = A / np.array([2000.0, 1.0])[:, None]
    cover = np.linalg.inv(weighted.reshape(-1, 6).T @ weighted.reshape(-1, 6))
    np.testing.assert_allclose(found.parameter_stds, np.sqrt(np.diagonal(cover)), rtol=0.2)
    np.testing.assert_allclose(found.residual_rms, [2000.0, 1.0], rtol=0.1)


def test_one_axis_in_one_stretch_is_ordinary_least_squares():
    A = planar_rows.make_straight_regressor(
        MOTIONS["straight"]["specific_force_x"], MOTIONS["straight"]["speed"]
    )
    f = A @ [3614.0, 2891.0] + np.random.default_rng(4).normal(scale=60.0, size=2000)
    found = fit(A[:, None], f[:, None], planar_rows.STRAIGHT_PARAMETERS)
    expected = ls.fit(A, f)
    np.testing.assert_allclose(found.theta, expected.theta, rtol=1e-9)
    np.testing.assert_allclose(found.parameter_stds, expected.std, rtol=1e-6)


def test_samples_left_out_may_be_nan():
    motion = MOTIONS["joint"]
    A, f = planar_rows.make_planar_regressor(**motion), forces(motion)
    stretch_of_sample = np.where(np.arange(2000) % 50 < 5, -1, np.arange(2000) // 1000)
    A[stretch_of_sample < 0] = f[stretch_of_sample < 0] = np.nan
    found = fit(A, f, planar_rows.PARAMETERS, stretch_of_sample=stretch_of_sample)
    np.testing.assert_allclose(found.theta, LOADER, rtol=1e-9)


@settings(deadline=None, max_examples=30)
@given(
    st.lists(st.sampled_from(sorted(MOTIONS)), min_size=1, max_size=3), st.integers(0, 2**32 - 1)
)
def test_any_sequence_of_motions_gives_truth_or_nan(chosen, seed):
    loader = LOADER * np.random.default_rng(seed).uniform(0.2, 5.0, 6)
    A = np.concatenate([planar_rows.make_planar_regressor(**MOTIONS[name]) for name in chosen])
    f = A @ loader
    found = fit(A, f, planar_rows.PARAMETERS, np.repeat(np.arange(len(chosen)), 2000))
    single = found.identifiability.identifiable
    np.testing.assert_allclose(found.theta[single], loader[single], rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(found.theta), ~single)


@pytest.mark.parametrize("samples", [0, 100])
def test_standstill_tells_nothing_and_is_no_error(samples):
    found = fit(np.zeros((samples, 2, 6)), np.ones((samples, 2)), planar_rows.PARAMETERS)
    assert np.isnan(found.theta).all()
    assert np.isnan(found.parameter_stds).all()
    assert found.combination.size == 0


def test_what_is_wrong_is_said_in_one_line():
    A, f = np.ones((5, 2, 6)), np.ones((5, 2))
    with pytest.raises(DataError, match="did you mean 'mass_kg'"):
        fit(A, f, planar_rows.PARAMETERS, prior=known(mass_k=(1.0, 1.0)))
    with pytest.raises(DataError, match=r"needs forces of shape \(5, 2\)"):
        fit(A, f[:, 0], planar_rows.PARAMETERS)
    with pytest.raises(DataError, match="forces hold NaN"):
        fit(A, np.nan * f, planar_rows.PARAMETERS)


@settings(deadline=None)
@given(st.floats(-15, 0))
def test_however_nearly_columns_depend_there_is_an_estimate_with_or_without_a_deviation(exponent):
    generator = np.random.default_rng(6)
    a, b, e = generator.normal(size=(3, 300))
    A = np.column_stack([a, a + 10.0**exponent * b])[:, None]
    found = fit(A, (A @ [3.0, 5.0]) + 1e-3 * e[:, None], ["one_1", "other_1"])
    if found.identifiability.rank == 2:
        error = np.abs(found.theta - [3.0, 5.0])
        assert np.isnan(found.parameter_stds).all() or (error < 5.0 * found.parameter_stds).all()
    else:
        assert np.isnan(found.theta).all()
        assert found.combination == pytest.approx([8.0], abs=1e-3)
