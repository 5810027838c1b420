"""Which parameters each motion determines, and which combinations of the others."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.errors import DataError
from estimators.planar import planar_rows, rigid_body
from estimators.planar.identifiability import find_identifiable_parameters
from tests.estimators.motions import LOADER, MOTIONS, channels, measured, spatial, spin, triangle

WHEELS = [rigid_body.ROWS.index(name) for name in planar_rows.ROWS]
DETERMINED = {
    "straight": (3, {"mass_kg", "first_moment_y_kg_m", "friction_x_N_s_m"}),
    "spin about the origin": (
        4,
        {
            "first_moment_x_kg_m",
            "first_moment_y_kg_m",
            "inertia_z_kg_m2",
            "friction_z_N_m_s",
        },
    ),
    "spin about an offset centre": (4, {"first_moment_y_kg_m", "friction_z_N_m_s"}),
    "one constant arc": (2, set()),
    "joint": (6, set(planar_rows.PARAMETERS)),
}


def names(found):
    return {found.parameters[i] for i in np.flatnonzero(found.identifiable)}


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_rank_and_the_identifiable_parameters_of_each_motion(motion):
    found = find_identifiable_parameters(
        planar_rows.make_planar_regressor(**MOTIONS[motion]), planar_rows.PARAMETERS
    )
    assert (found.rank, names(found)) == DETERMINED[motion]


@pytest.mark.parametrize("motion", MOTIONS)
def test_of_all_sixteen_the_wheels_rows_determine_the_same(motion):
    found = find_identifiable_parameters(spatial(MOTIONS[motion])[:, WHEELS], rigid_body.PARAMETERS)
    assert (found.rank, names(found)) == DETERMINED[motion]


def test_an_offset_spin_determines_m_minus_5_mcx_and_izz_minus_0_2_mcx():
    found = find_identifiable_parameters(
        planar_rows.make_planar_regressor(**spin(-0.2)), planar_rows.PARAMETERS
    )
    assert found.format_combinations() == [
        "mass_kg - 5 first_moment_x_kg_m",
        "inertia_z_kg_m2 - 0.2 first_moment_x_kg_m",
    ]


def test_a_constant_arc_determines_two_combinations_of_three():
    """f_x = -ω² mc_x + v b_x and τ_z = v ω mc_x + ω b_ψ, at v = 1.2 and ω = 0.4."""
    found = find_identifiable_parameters(
        planar_rows.make_planar_regressor(**MOTIONS["one constant arc"]), planar_rows.PARAMETERS
    )
    assert found.format_combinations() == [
        "first_moment_x_kg_m + 0.8333 friction_z_N_m_s",
        "friction_x_N_s_m + 0.1111 friction_z_N_m_s",
    ]


def test_triangles_in_step_determine_five_because_mass_mixes_with_the_moment_across():
    """dv/dt = k ω̇ throughout, at k = 1.5 / 0.8: m dv/dt - mc_y ω̇ is one column."""
    speed, yaw = triangle(7.0, 1.5, 0.1), triangle(7.0, 0.8, -0.2)
    found = find_identifiable_parameters(
        planar_rows.make_planar_regressor(**channels(*speed, *yaw)), planar_rows.PARAMETERS
    )
    assert found.rank == 5
    assert found.format_combinations() == [
        "mass_kg - 0.5333 first_moment_y_kg_m",
        "inertia_z_kg_m2 - 1.875 first_moment_y_kg_m",
    ]


def test_with_the_lateral_reaction_an_offset_spin_would_determine_5_and_an_arc_3():
    rows = [rigid_body.ROWS.index(name) for name in ("force_x_N", "force_y_N", "torque_z_N_m")]
    offset = spin(-0.2)
    lateral = -0.2 * offset["yaw_rate"]
    for motion, lateral_speed, rank in [
        ("straight", None, 3),
        ("spin about the origin", None, 4),
        ("spin about an offset centre", lateral, 5),
        ("one constant arc", None, 3),
        ("joint", None, 6),
    ]:
        A = spatial(MOTIONS[motion], lateral_speed)[:, rows]
        assert find_identifiable_parameters(A, rigid_body.PARAMETERS).rank == rank, motion


@settings(deadline=None)
@given(st.floats(0.05, 3.0) | st.floats(-3.0, -0.05))
def test_wherever_the_centre_of_a_spin_lies_the_combinations_name_it(origin_x):
    found = find_identifiable_parameters(
        planar_rows.make_planar_regressor(**spin(origin_x)), planar_rows.PARAMETERS
    )
    np.testing.assert_allclose(
        found.determined_combinations,
        [[1, 0, 1 / origin_x, 0, 0, 0], [0, 1, origin_x, 0, 0, 0]],
        rtol=1e-8,
    )


@settings(deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 6),
    st.integers(0, 6),
    st.lists(st.floats(-6, 6), min_size=6, max_size=6),
)
def test_what_is_determined_is_the_row_space_whatever_the_units(seed, p, rank, exponents):
    """A regressor of known rank, its columns in units that differ by up to 10¹²."""
    generator = np.random.default_rng(seed)
    rank = min(rank, p)
    rows = generator.integers(-3, 4, (rank, p)).astype(float)
    rank = int(np.linalg.matrix_rank(rows)) if rank else 0
    units = 10.0 ** np.array(exponents[:p])
    A = generator.normal(size=(50, rows.shape[0])) @ rows * units
    found = find_identifiable_parameters(A, [f"p{i}" for i in range(p)])
    assert found.rank == rank == len(found.base) == len(found.echelon)
    np.testing.assert_array_equal(found.echelon[:, found.base], np.eye(rank))
    # nothing is lost: the base columns times the echelon are the whole
    rebuilt = A[:, found.base] @ found.echelon
    np.testing.assert_allclose(rebuilt / units, A / units, atol=1e-8)
    # and a parameter is determined exactly when it adds nothing to the row space
    for i in range(p):
        unit = np.eye(p)[i]
        widened = np.linalg.matrix_rank(np.vstack([rows, unit])) if rank else 1
        assert found.identifiable[i] == (widened == rank)


def test_a_parameter_that_is_identifiable_stands_alone_in_the_echelon():
    for motion in MOTIONS.values():
        found = find_identifiable_parameters(
            planar_rows.make_planar_regressor(**motion), planar_rows.PARAMETERS
        )
        for row, i in zip(found.echelon, found.base, strict=True):
            assert (np.count_nonzero(row) == 1) == found.identifiable[i]


@pytest.mark.parametrize("motion", MOTIONS)
def test_measured_with_noise_the_same_is_determined_when_the_noise_is_told(motion):
    """Noise makes every column look excited; told of it, the ranks are those of the motion."""
    generator = np.random.default_rng(3)
    sigma = {
        "specific_force_x": 0.01,
        "specific_force_y": 0.01,
        "speed": 0.005,
        "yaw_rate": 0.002,
        "yaw_acceleration": 0.01,
    }
    A = planar_rows.make_planar_regressor(**measured(MOTIONS[motion], sigma, generator, mean=10))
    assert find_identifiable_parameters(A, planar_rows.PARAMETERS).rank == 6
    after_mean = {name: rms / np.sqrt(10.0) for name, rms in sigma.items()}
    turning = np.sqrt(np.mean(A[:, 1, planar_rows.PARAMETERS.index("friction_z_N_m_s")] ** 2))
    noise = np.sqrt(
        np.mean(planar_rows.compute_column_noise_rms(turning, **after_mean) ** 2, axis=0)
    )
    found = find_identifiable_parameters(A, planar_rows.PARAMETERS, noise)
    assert (found.rank, names(found)) == DETERMINED[motion]


def test_what_is_determined_by_itself_has_its_own_row_however_noise_tilts_the_others():
    sigma = dict(zip(MOTIONS["joint"], [0.01, 0.01, 0.005, 0.002, 0.02], strict=True))
    noise = np.sqrt(np.mean(planar_rows.compute_column_noise_rms(0.4, **sigma) ** 2, axis=0))
    for seed in range(50):
        generator = np.random.default_rng(seed)
        A = planar_rows.make_planar_regressor(**measured(spin(-0.2), sigma, generator, mean=1))
        found = find_identifiable_parameters(A, planar_rows.PARAMETERS, noise)
        assert set(np.flatnonzero(found.identifiable)) <= set(found.base)


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_triangular_factor_of_a_regressor_says_the_same_as_the_regressor(motion):
    A = planar_rows.make_planar_regressor(**MOTIONS[motion])
    noise = np.full(6, 1e-3)
    R = np.linalg.qr(A.reshape(-1, 6), mode="r")
    for told in (None, noise):
        whole = find_identifiable_parameters(A, planar_rows.PARAMETERS, told)
        factor = find_identifiable_parameters(
            R, planar_rows.PARAMETERS, told, samples=A.shape[0] * 2
        )
        assert factor.format_combinations() == whole.format_combinations()
        assert names(factor) == names(whole)
        assert factor.condition == pytest.approx(whole.condition)


def test_a_log_without_motion_determines_nothing():
    found = find_identifiable_parameters(np.zeros((100, 2, 6)), planar_rows.PARAMETERS)
    assert found.rank == 0
    assert not found.identifiable.any()
    assert found.format_combinations() == []
    assert found.condition == np.inf


def test_a_log_without_samples_determines_nothing():
    assert find_identifiable_parameters(np.empty((0, 2, 6)), planar_rows.PARAMETERS).rank == 0


def test_the_condition_number_is_that_of_the_base_columns_scaled_to_unit_norm():
    A = planar_rows.make_planar_regressor(**MOTIONS["joint"])
    rows = A.reshape(-1, 6)
    expected = np.linalg.cond(rows / np.linalg.norm(rows, axis=0))
    assert find_identifiable_parameters(A, planar_rows.PARAMETERS).condition == pytest.approx(
        expected
    )


def test_what_is_wrong_with_a_regressor_is_said_in_one_line():
    A = planar_rows.make_planar_regressor(**MOTIONS["joint"])
    with pytest.raises(DataError, match="6 columns, but 2 parameters"):
        find_identifiable_parameters(A, planar_rows.STRAIGHT_PARAMETERS)
    with pytest.raises(DataError, match="noise must hold 6 values, above zero"):
        find_identifiable_parameters(A, planar_rows.PARAMETERS, 0.0 * LOADER)
    A[3, 1, 2] = np.nan
    with pytest.raises(DataError, match="exclude these samples"):
        find_identifiable_parameters(A, planar_rows.PARAMETERS)
