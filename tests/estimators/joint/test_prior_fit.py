"""Least squares under priors: coverage, the parts of the covariance, and what widens it."""

from functools import cache

import numpy as np
import pytest

from estimators.joint.prior_fit import Grouping, fit
from estimators.joint.random_intercepts import RandomIntercepts
from estimators.numerics.group_sums import NoiseMoments, sum_noise_moments

FREE = np.inf
TRUTH = np.array([3600.0, 2900.0])
#: Of the two nuisances.
WIDTHS = np.array([200.0, 300.0])
STARTS, SAMPLES = 6, 120
SIGMA = 60.0
GROUP = np.repeat(np.arange(STARTS), SAMPLES)


def columns(generator):
    """Acceleration and speed of starts of different strength, a constant, speed squared."""
    t = np.tile(np.linspace(0.0, 3.0, SAMPLES), STARTS)
    strength = np.repeat(generator.uniform(0.5, 1.0, STARTS), SAMPLES)
    acceleration = 1.5 * strength * np.exp(-t)
    speed = 1.5 * strength * (1.0 - np.exp(-t))
    return np.column_stack([acceleration, speed, np.ones(t.size), speed**2])


def prior(*widths):
    std = np.array(widths)
    return np.zeros(std.size), std


def drawn(seed, widths=WIDTHS, sigma=SIGMA):
    """Columns, force and the parameters, the nuisances drawn from their priors."""
    generator = np.random.default_rng(seed)
    A = columns(generator)
    theta = np.concatenate([TRUTH, generator.normal(0.0, widths)])
    return A, A @ theta + generator.normal(0.0, sigma, len(A)), theta


@cache
def fits(draws=300):
    made = [drawn(seed) for seed in range(draws)]
    return [(fit(A, f, GROUP, None, *prior(FREE, FREE, *WIDTHS)), theta) for A, f, theta in made]


class TestWhatItSays:
    @pytest.mark.heavy
    def test_its_intervals_hold_the_truth_as_often_as_they_say(self):
        held = [
            np.abs(found.theta - theta) < 1.96 * found.parameter_stds for found, theta in fits()
        ]
        assert 0.93 < np.mean(held) < 0.97
        # the mass alone: 300 draws tell a coverage to ± 1.3 %
        assert 0.92 < np.mean(held, axis=0)[0] < 0.98

    def test_its_estimates_have_no_bias(self):
        errors = np.array([found.theta - theta for found, theta in fits()])
        of_mean = errors.std(axis=0) / np.sqrt(len(errors))
        assert (np.abs(errors.mean(axis=0)) < 3.0 * of_mean).all()

    def test_it_is_ordinary_least_squares_where_nothing_is_believed_and_residuals_are_white(self):
        A, f, _ = drawn(1)
        flat = fit(A, f, GROUP, None, *prior(FREE, FREE, FREE, FREE))
        theta, squares, *_ = np.linalg.lstsq(A, f, rcond=None)
        np.testing.assert_allclose(flat.theta, theta, rtol=1e-9)
        textbook = np.sqrt(np.diag(np.linalg.inv(A.T @ A)) * squares[0] / (len(A) - 4))
        np.testing.assert_allclose(flat.parameter_stds, textbook, rtol=0.15)
        np.testing.assert_allclose(flat.residual, f - A @ theta, atol=1e-6)
        assert flat.noise_share == 0.0
        assert not flat.responses.any()

    def test_priors_that_are_exact_are_kept_and_wide_ones_are_not_felt(self):
        A, f, theta = drawn(2)
        exact = fit(A, f, GROUP, None, np.append(np.zeros(2), theta[2:]), [FREE, FREE, 1e-6, 1e-6])
        np.testing.assert_allclose(exact.theta[2:], theta[2:], atol=1e-4)
        wide = fit(A, f, GROUP, None, *prior(FREE, FREE, 1e9, 1e9))
        flat = fit(A, f, GROUP, None, *prior(FREE, FREE, FREE, FREE))
        np.testing.assert_allclose(wide.theta, flat.theta, rtol=1e-6)

    def test_a_response_is_what_a_prior_moved_by_its_deviation_moves_the_estimates_by(self):
        A, f, _ = drawn(3)
        mean, std = prior(FREE, FREE, *WIDTHS)
        found = fit(A, f, GROUP, None, mean, std)
        for j in (2, 3):
            shifted = mean.copy()
            shifted[j] += std[j]
            moved = fit(A, f, GROUP, None, shifted, std).theta - found.theta
            np.testing.assert_allclose(found.responses[j], moved, rtol=0.1, atol=0.5)
        assert not found.responses[:2].any()

    @pytest.mark.parametrize("widened", ["scatter", "misfit"])
    def test_its_parts_add_up_to_its_covariance(self, widened):
        A, f, _ = drawn(4)
        missed = {
            "scatter": np.repeat([-800.0, 800.0] * (STARTS // 2), SAMPLES) * A[:, 0],
            "misfit": np.tile(80.0 * np.sin(np.linspace(0.0, 9.0, SAMPLES)), STARTS),
        }
        noise = white_noise(A, 0.02)
        found = fit(A, f + missed[widened], GROUP, noise, *prior(FREE, FREE, *WIDTHS))
        assert getattr(found, widened)[0, 0] > 0.0
        assert found.doubt[0] != 0.0
        of_priors = sum(np.outer(each, each) for each in found.responses)
        doubted = np.outer(found.doubt, found.doubt)
        parts = found.noise + of_priors + found.scatter + found.misfit + doubted
        np.testing.assert_allclose(found.covariance, parts, rtol=1e-12)
        np.testing.assert_array_equal(found.parameter_stds, np.sqrt(np.diag(found.covariance)))

    def test_a_column_of_zeros_is_left_to_its_prior(self):
        A, f, _ = drawn(5)
        with_none = np.column_stack([A[:, :3], np.zeros(len(A))])
        found = fit(with_none, f, GROUP, None, np.array([0, 0, 0, 7.0]), [FREE, FREE, 200.0, 3.0])
        assert found.theta[3] == pytest.approx(7.0)
        assert found.parameter_stds[3] == pytest.approx(3.0)
        alone = fit(A[:, :3], f, GROUP, None, *prior(FREE, FREE, 200.0))
        np.testing.assert_allclose(found.theta[:3], alone.theta, rtol=1e-4)

    def test_rows_of_no_group_are_not_looked_at(self):
        A, f, _ = drawn(6)
        fewer = np.where(GROUP == 2, -1, GROUP)
        out = np.where(GROUP == 2, 1e9, f)
        kept = GROUP != 2
        whole = fit(A, out, fewer, None, *prior(FREE, FREE, *WIDTHS))
        part = fit(A[kept], f[kept], GROUP[kept], None, *prior(FREE, FREE, *WIDTHS))
        np.testing.assert_allclose(whole.theta, part.theta, rtol=1e-9)
        np.testing.assert_allclose(whole.parameter_stds, part.parameter_stds, rtol=1e-9)
        assert not whole.residual[~kept].any()

    def test_too_few_samples_give_nothing(self):
        A, f, _ = drawn(7)
        found = fit(A[:4], f[:4], GROUP[:4], None, *prior(FREE, FREE, *WIDTHS))
        assert np.isnan(found.theta).all()
        assert np.isnan(found.parameter_stds).all()

    def test_noise_that_lasts_is_known_from_the_residuals(self):
        """Neighbouring residuals of one sign tell as much as one of them."""
        kernel = np.full(10, 1.0 / np.sqrt(10.0))
        errors, said = [], []
        for seed in range(100):
            A, f, theta = drawn(seed, sigma=0.0)
            lasting = np.convolve(np.random.default_rng(seed).normal(0, SIGMA, len(A) + 9), kernel)
            found = fit(A, f + lasting[9 : 9 + len(A)], GROUP, None, *prior(FREE, FREE, *WIDTHS))
            errors.append((found.theta - theta) / found.parameter_stds)
            said.append(found.parameter_stds[0])
        assert 0.8 < np.sqrt(np.mean(np.square(errors))) < 1.1
        white = np.median([found.parameter_stds[0] for found, _ in fits()])
        assert np.median(said) > 1.5 * white


def white_noise(A, sigma, group=GROUP):
    """What white noise of the acceleration adds."""
    counts = np.bincount(group)
    gram = np.zeros((counts.size, A.shape[1], A.shape[1]))
    gram[:, 0, 0] = counts * sigma**2
    return NoiseMoments(gram, np.zeros((counts.size, A.shape[1])))


class TestErrorsInVariables:
    STD = 0.15

    def noisy(self, seed, shared=0.0):
        """Acceleration with noise; some of it in the force as well."""
        A, f, theta = drawn(seed, WIDTHS * 0.0)
        noise = np.random.default_rng([seed, 9]).normal(0.0, self.STD, len(A))
        noisy = A.copy()
        noisy[:, 0] += noise
        return noisy, f + shared * noise, theta

    @pytest.mark.heavy
    def test_noise_in_a_column_biases_least_squares_and_is_taken_off_here(self):
        plain, clean = [], []
        for seed in range(60):
            A, f, theta = self.noisy(seed)
            flat = prior(FREE, FREE, 1e-3, 1e-3)
            plain.append(fit(A, f, GROUP, None, *flat).theta[0] - theta[0])
            clean.append(fit(A, f, GROUP, white_noise(A, self.STD), *flat).theta[0] - theta[0])
        of_mean = np.std(clean) / np.sqrt(60)
        assert np.mean(plain) < -100.0
        assert abs(np.mean(clean)) < 3.0 * of_mean
        assert of_mean < 15.0

    def test_noise_that_a_column_shares_with_the_force_is_taken_off_as_well(self):
        errors = []
        for seed in range(60):
            A, f, theta = self.noisy(seed, shared=4000.0)
            noise = white_noise(A, self.STD)
            cross = noise.cross.copy()
            cross[:, 0] = 4000.0 * SAMPLES * self.STD**2
            found = fit(A, f, GROUP, NoiseMoments(noise.gram, cross), *prior(FREE, FREE, 1, 1))
            errors.append(found.theta[0] - theta[0])
        assert abs(np.mean(errors)) < 3.0 * np.std(errors) / np.sqrt(60)

    def test_the_doubt_is_at_least_what_a_quarter_of_the_correction_is_worth(self):
        A, f, theta = self.noisy(1)
        flat = prior(FREE, FREE, 1e-3, 1e-3)
        taken = fit(A, f, GROUP, white_noise(A, self.STD), *flat)
        more = fit(A, f, GROUP, white_noise(A, self.STD * np.sqrt(1.25)), *flat)
        assert abs(taken.doubt[0]) > abs(more.theta[0] - taken.theta[0])
        assert 0.0 < taken.noise_share < 0.5
        assert abs(taken.theta[0] - theta[0]) < 3.0 * taken.parameter_stds[0]

    @pytest.mark.parametrize("starts", [6, 60])
    def test_more_of_the_same_does_not_outvote_a_prior_by_the_error_of_the_correction(self, starts):
        """Half of what parts acceleration and constant is noise: the prior of 20 N knows more."""
        group = np.repeat(np.arange(starts), SAMPLES)
        generator = np.random.default_rng(starts)
        acceleration = 1.0 + 0.06 * np.sin(np.arange(group.size) / 20.0)
        f = 120.0 * acceleration + 10.0 + generator.normal(0.0, 1.0, group.size)
        noisy = np.column_stack([acceleration, np.ones(group.size)])
        noisy[:, 0] += generator.normal(0.0, 0.05, group.size)
        found = fit(noisy, f, group, white_noise(noisy, 0.05, group), *prior(FREE, 20.0))
        assert abs(found.theta[0] - 120.0) < 2.0 * found.parameter_stds[0]
        assert found.parameter_stds[0] < 20.0

    def test_a_column_that_is_all_noise_has_a_share_near_one_and_a_wide_answer(self):
        generator = np.random.default_rng(3)
        A, f, _ = drawn(3)
        nothing = A.copy()
        nothing[:, 0] = generator.normal(0.0, 0.2, len(A))
        found = fit(nothing, f, GROUP, white_noise(A, 0.2), *prior(FREE, FREE, *WIDTHS))
        assert found.noise_share > 0.8
        assert np.isfinite(found.parameter_stds).all()


class TestWhatWidens:
    def test_starts_that_disagree_widen_by_their_scatter(self):
        """Six starts that scatter tell little of how much they do: not quite 95 %."""
        errors, said, without = [], [], []
        for seed in range(60):
            A, f, theta = drawn(seed)
            own = np.random.default_rng([seed, 1]).normal(0.0, 1600.0, STARTS)
            found = fit(A, f + own[GROUP] * A[:, 0], GROUP, None, *prior(FREE, FREE, *WIDTHS))
            errors.append(abs(found.theta[0] - theta[0]))
            said.append(found.parameter_stds[0])
            without.append(np.sqrt(found.covariance[0, 0] - found.scatter[0, 0]))
        held, narrow = (np.mean(errors < 1.96 * np.array(each)) for each in (said, without))
        assert held > 0.85
        assert narrow < 0.7

    def test_scatter_is_found_in_a_log_of_two_loads(self):
        A, f, _ = drawn(8)
        ratios = []
        for load_kg in (0.0, 100.0, 500.0):
            loaded = np.where(GROUP >= 3, load_kg, 0.0)
            found = fit(A, f + loaded * A[:, 0], GROUP, None, *prior(FREE, FREE, *WIDTHS))
            ratios.append(found.scatter_ratio)
            assert bool(found.scatter.any()) == (load_kg > 0.0)
            assert found.groups == STARTS
        assert ratios[0] < ratios[1] < ratios[2]

    def test_starts_that_differ_by_noise_alone_widen_nothing(self):
        false = np.mean([bool(found.scatter.any()) for found, _ in fits()])
        assert false < 0.05
        assert np.median([found.scatter_ratio for found, _ in fits()]) < 1.2

    def test_what_all_starts_miss_alike_widens_so_that_the_truth_is_inside(self):
        held, narrow = [], []
        for seed in range(60):
            A, f, theta = drawn(seed)
            generator = np.random.default_rng([seed, 2])
            slow = np.convolve(generator.normal(0.0, 1.0, SAMPLES + 19), np.ones(20) / 20, "valid")
            pattern = 60.0 * slow / slow.std()
            found = fit(A, f + np.tile(pattern, STARTS), GROUP, None, *prior(FREE, FREE, *WIDTHS))
            assert found.misfit[0, 0] > 0.0
            assert found.misfit_ratio > 2.0
            error = abs(found.theta[0] - theta[0])
            held.append(error < 1.96 * found.parameter_stds[0])
            narrow.append(error < 1.96 * np.sqrt(found.covariance[0, 0] - found.misfit[0, 0]))
        assert np.mean(held) > 0.85
        assert np.mean(narrow) < 0.8

    def test_a_misfit_that_alternates_from_sample_to_sample_has_a_deviation(self):
        """Correlations that are estimated may add up to a negative variance."""
        for seed in range(20):
            A, f, _ = drawn(seed)
            quick = np.random.default_rng([seed, 2]).normal(0.0, 1.0, SAMPLES + 4)
            pattern = 60.0 * np.convolve(quick, np.ones(5) / np.sqrt(5.0), "valid")
            found = fit(A, f + np.tile(pattern, STARTS), GROUP, None, *prior(FREE, FREE, *WIDTHS))
            assert np.isfinite(found.parameter_stds).all()

    def test_a_pattern_that_turns_round_with_the_direction_is_seen_by_the_direction(self):
        A, f, _ = drawn(9)
        sign = np.where(GROUP % 2 == 0, 1.0, -1.0)
        shape = np.tile(60.0 * np.sin(np.linspace(0.0, 12.0, SAMPLES)), STARTS)
        believed = prior(FREE, FREE, *WIDTHS)
        A, f = A * sign[:, None], f * sign + sign * shape
        seen = fit(A, f, GROUP, None, *believed, Grouping(direction=sign))
        unseen = fit(A, f, GROUP, None, *believed)
        assert seen.misfit.any()
        assert seen.misfit_ratio > 2.0 > unseen.misfit_ratio

    def test_what_all_starts_miss_alike_is_in_both_of_two_levels_and_not_in_their_difference(self):
        A, f, _ = drawn(9)
        shape = np.tile(60.0 * np.sin(np.linspace(0.0, 12.0, SAMPLES)), STARTS)
        level = np.arange(STARTS) % 2
        # half of the starts have a column of their own, with its sign turned in the others
        own = np.where(level[GROUP] == 1, 1.0, -1.0) * A[:, 2]
        believed = prior(FREE, FREE, *WIDTHS, 100.0)
        grouping = Grouping(levels=RandomIntercepts(level, np.arange(STARTS)))
        found = fit(np.column_stack([A, own]), f + shape, GROUP, None, *believed, grouping)
        of_one = found.misfit[0, 0]
        of_difference = found.misfit[0, 0] + found.misfit[1, 1] - 2.0 * found.misfit[0, 1]
        assert of_one > 0.0
        assert of_difference < 0.1 * of_one

    def test_noise_is_hardly_ever_taken_for_a_common_misfit(self):
        assert np.mean([bool(found.misfit.any()) for found, _ in fits()]) < 0.02

    def test_two_starts_tell_nothing_of_what_they_miss_alike(self):
        A, f, _ = drawn(10)
        two = fit(A, f, np.repeat([0, 1], len(A) // 2), None, *prior(FREE, FREE, FREE, FREE))
        assert np.isnan(two.misfit_ratio)
        assert two.groups == 2

    def test_two_starts_know_how_far_a_noise_that_lasts_has_led_them(self):
        """What the fit takes out of the residuals of two is put back."""
        smooth = np.ones(15) / np.sqrt(15.0)
        ratios: list[float] = []
        for seed in range(150):
            A, f, theta = drawn(seed, sigma=0.0)
            noise = np.convolve(
                np.random.default_rng(seed).normal(0.0, SIGMA, len(A)), smooth, "same"
            )
            part = slice(0, 2 * SAMPLES)
            found = fit(A[part], (f + noise)[part], GROUP[part], None, *prior(FREE, FREE, *WIDTHS))
            ratios.append((found.theta[0] - theta[0]) / found.parameter_stds[0])
        assert 0.8 < np.sqrt(np.mean(np.square(ratios))) < 1.15

    def test_stretches_too_short_to_tell_are_fitted_and_not_counted(self):
        A, f, _ = drawn(11)
        found = fit(A, f, GROUP, None, *prior(FREE, FREE, *WIDTHS), Grouping(shortest=SAMPLES + 1))
        assert found.groups == 0
        assert not found.scatter.any()
        assert np.isfinite(found.parameter_stds).all()


def test_noise_moments_are_the_plain_sum():
    generator = np.random.default_rng(12)
    n, p, q, groups = 60, 4, 3, 5
    slopes = generator.normal(size=(n, p, q))
    # not every column depends on every channel
    slopes[:, 1, 0] = slopes[:, 3, 1:] = 0.0
    root = generator.normal(size=(2, q, q))
    covariances = root @ root.transpose(0, 2, 1)
    which = generator.integers(0, 2, n)
    group = np.sort(generator.integers(0, groups, n))
    places = np.array([(i, x) for i in range(p) for x in range(q) if slopes[:, i, x].any()])
    some = np.stack([slopes[:, i, x] for i, x in places])
    gram, cross = sum_noise_moments(some, places, covariances, which, group, (groups, p))
    for g in range(groups):
        each = [slopes[k] @ covariances[which[k]] for k in np.flatnonzero(group == g)]
        with_response = [part[:, -1] for part in each]
        of_group = slopes[group == g]
        squares = [part @ slope.T for part, slope in zip(each, of_group, strict=True)]
        np.testing.assert_allclose(gram[g], np.sum(squares, axis=0), rtol=1e-12)
        np.testing.assert_allclose(cross[g], np.sum(with_response, axis=0), rtol=1e-12)
