"""Machines that share no code with the model: inertia and centre of mass are within their ±."""

import numpy as np
import pytest

from analysis.model.machine import Machine
from benchmarks.independent.turning_logs import FAULTS, turn_log
from benchmarks.turning import planar_of, turned
from tests.twins import mark_heavy_after

#: Logs of each fault for `make slow`; `make test` has one of two faults, of some seconds each.
SEEDS = range(3)
SLOW = pytest.mark.slow


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("fault", "quantity", "seeds"),
    mark_heavy_after(
        1,
        [
            ("IMU 5 cm off", "com_x_m", (1,)),
            # its spins creep: 15 % too heavy where their sign of speed was a direction
            ("rolling and Coulomb", "mass_kg", (610011,)),
            pytest.param("Coulomb friction of turning", "inertia_z_kg_m2", SEEDS, marks=SLOW),
            pytest.param("IMU 5 cm off", "com_x_m", SEEDS, marks=SLOW),
            pytest.param("track 1 %", "inertia_z_kg_m2", SEEDS, marks=SLOW),
            pytest.param("rolling and Coulomb", "mass_kg", range(610011, 610014), marks=SLOW),
            # tyres that scrub hold its spins, and the point that it turns about is not the origin
            pytest.param("skid-steer", "inertia_z_kg_m2", range(640000, 640004), marks=SLOW),
        ],
    ),
)
def test_what_is_said_of_a_faulty_log_is_within_three_standard_uncertainties(
    fault, quantity, seeds
):
    found = [each for seed in seeds for each in turned(fault, seed).deviations("joint", quantity)]
    assert found
    assert np.max(np.abs(found)) < 3.0


@pytest.mark.heavy
def test_what_spins_tell_an_arc_is_a_covariance_where_priors_alone_tell_terms_apart():
    """Its yaw rate's noise was more than what told quadratic from viscous friction."""
    rows = turned("slope, wheels alone", 641009).rows
    assert {"arcs", "joint"} <= {row["kind"] for row in rows}
    told = [row for row in rows if row["inertia_z_kg_m2"] is not None]
    assert told
    assert all(row["inertia_z_std_kg_m2"] > 0.0 for row in told)


@pytest.mark.heavy
def test_a_machine_file_that_states_nothing_is_told_what_is_not_in_the_uncertainty():
    for seed in SEEDS:
        said = planar_of(turn_log(FAULTS["clean"], seed, stated=False)).filter(kind="joint")
        (row,) = said.to_dicts()
        if row["com_x_m"] is not None:
            assert row["scale_unknown"] == "force_gain, wheel_radius, track_width, imu_position"
            assert "imu_position" in row["com_scale_unknown"]
            break
    else:
        pytest.fail("no log says anything")


@pytest.mark.parametrize("u_m", [-0.01, float("nan")])
def test_the_uncertainty_of_a_place_is_no_negative_length(u_m):
    content = turn_log(FAULTS["clean"], 0).machine
    content["machine"]["imu"]["position_u_m"] = u_m
    with pytest.raises(ValueError, match="position_u_m"):
        Machine.model_validate(content)
