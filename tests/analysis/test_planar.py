"""Stage 3 and joint motion: the centre of mass, and null for what the motion does not determine."""

import re

import numpy as np
import polars as pl
import pytest

from analysis.model.schema import FRAMES
from estimators.planar.planar_rows import PARAMETERS
from tests.analysis.plane_drives import (
    LOADER,
    arc,
    arcs,
    hold,
    joint,
    machine,
    replayed,
    sensors,
    spins,
    starts,
)
from tests.twins import mark_heavy_after

COM_X_M, COM_Y_M = LOADER[2] / LOADER[0], LOADER[3] / LOADER[0]
TOLD = (*PARAMETERS, "com_x_m", "com_x_std_m", "com_y_m", "com_y_std_m")
ABOUT_Z = {"inertia_z_kg_m2": "inertia_z_std_kg_m2", "friction_z_N_m_s": "friction_z_std_N_m_s"}
POOLED = {"methods": ("pooled",)}


def whole(seed=1, **changes):
    """Starts, spins, three arcs."""
    return replayed(sensors(starts() + spins() + arcs(), seed=seed, **changes), machine(**POOLED))


def only(stages, kind):
    return stages["planar"].filter(kind=kind).to_dicts()


def agrees(row, name, std, truth):
    """Whether a number is within two of its standard uncertainties of the truth."""
    return abs(row[name] - truth) <= 2.0 * row[std]


@pytest.fixture(scope="module")
def stages():
    return whole()


@pytest.mark.heavy
def test_the_centre_of_mass_is_found_from_arcs_and_from_all_motion(stages):
    kinds = stages["planar"]["kind"].to_list()
    assert kinds == ["arc", "arc", "arc", "arcs", "joint"]
    for kind in ("arcs", "joint"):
        (row,) = only(stages, kind)
        assert row["reason"] == "accepted"
        assert row["com_x_m"] == pytest.approx(COM_X_M, rel=0.1)
        assert agrees(row, "com_x_m", "com_x_std_m", COM_X_M)
        assert agrees(row, "first_moment_x_kg_m", "first_moment_x_std_kg_m", LOADER[2])


def test_one_arc_is_hardly_told_from_the_coulomb_friction_that_a_machine_may_have(stages):
    """150 N along a slow arc look like 0.4 m of centre of mass."""
    rows = only(stages, "arc")
    for row in rows:
        if row["com_x_m"] is None:
            assert row["reason"] in ("low_information", "ill_conditioned")
        else:
            assert agrees(row, "com_x_m", "com_x_std_m", COM_X_M)
            assert row["com_x_std_m"] > 0.25 * COM_X_M
    assert sum(row["com_x_m"] is None for row in rows) >= 2


def test_all_motion_together_determines_all_six(stages):
    (row,) = only(stages, "joint")
    assert row["rank"] == 6
    assert row["identifiable"] == ", ".join(PARAMETERS)
    assert row["combinations"] == ""
    for name, truth in zip(PARAMETERS, LOADER, strict=True):
        if name in ABOUT_Z:
            # spins at one throttle tell them to a twentieth beside tyres that may scrub
            assert agrees(row, name, ABOUT_Z[name], truth)
            assert row[ABOUT_Z[name]] < 0.08 * truth
        else:
            assert row[name] == pytest.approx(truth, rel=0.02 if abs(truth) > 100 else 0.2)


def test_clean_joint_motion_without_any_straight_start_tells_inertia_and_centre_of_mass():
    found = replayed(sensors([joint()]), machine(**POOLED))
    (row,) = found["planar"].to_dicts()
    assert row["rank"] == 6
    assert row["inertia_z_kg_m2"] == pytest.approx(LOADER[1], rel=0.02)
    assert row["first_moment_x_kg_m"] == pytest.approx(LOADER[2], rel=0.1)
    assert agrees(row, "first_moment_x_kg_m", "first_moment_x_std_kg_m", LOADER[2])
    assert agrees(row, "mass_kg", "mass_std_kg", LOADER[0])
    assert row["mass_std_kg"] < 0.15 * LOADER[0]


def test_v_and_omega_in_step_mix_mass_and_inertia_with_the_lateral_moment():
    v, _ = joint()
    in_step = replayed(sensors([(v, 0.3 + 0.3 * v)]), machine(exclude_braking=False, **POOLED))
    (row,) = in_step["planar"].to_dicts()
    assert row["rank"] == 5
    first, second = row["combinations"].split("; ")
    assert re.match(r"mass_kg - 0\.(29|30)\d* first_moment_y_kg_m$", first)
    assert second.startswith("inertia_z_kg_m2 - 3.3")
    for name in ("mass_kg", "inertia_z_kg_m2", "first_moment_y_kg_m", "com_x_m"):
        assert row[name] is None
    # ω² is a sum of 1, v and v²: friction and a constant force make it uncertain
    assert agrees(row, "first_moment_x_kg_m", "first_moment_x_std_kg_m", LOADER[2])
    assert row["first_moment_x_std_kg_m"] > 0.2 * LOADER[2]


@pytest.mark.heavy
@pytest.mark.parametrize(
    # fewer than 4 of 6 logs hold once in 450 times
    ("logs", "least"),
    [(6, 0.66), pytest.param(100, 0.90, marks=pytest.mark.slow)],
)
def test_nominal_95_percent_intervals_cover_over_logs_of_different_noise(logs, least):
    std = {"mass_kg": "mass_std_kg", "inertia_z_kg_m2": "inertia_z_std_kg_m2"}
    inside = {name: [] for name in ("inertia, pooled", "arcs", "joint")}
    inside |= {"mass_kg": [], "inertia_z_kg_m2": []}
    for seed in range(logs):
        stages = whole(seed)
        total = stages["masses"].row(0, named=True)
        error = total["inertia_z_kg_m2"] - LOADER[1]
        assert abs(error) < 0.02 * LOADER[1]
        inside["inertia, pooled"].append(abs(error) < 1.96 * total["inertia_z_std_kg_m2"])
        for row in stages["planar"].to_dicts():
            # one arc hardly tells it: too few are told for a share
            if row["com_x_m"] is None or row["kind"] == "arc":
                continue
            error = row["com_x_m"] - COM_X_M
            assert abs(error) < 4.0 * row["com_x_std_m"]
            inside[row["kind"]].append(abs(error) < 1.96 * row["com_x_std_m"])
            if row["kind"] == "joint":
                for (name, deviation), truth in zip(std.items(), LOADER, strict=False):
                    inside[name].append(abs(row[name] - truth) < 1.96 * row[deviation])
    covered = {name: np.mean(each) for name, each in inside.items()}
    assert all(share >= least for share in covered.values()), covered


def test_one_arc_alone_determines_none():
    alone = replayed(sensors([hold(1.5), *arc(1.2, 0.5)]), machine(**POOLED))
    (row,) = only(alone, "arc")
    assert row["reason"] == "ill_conditioned"
    assert row["identifiable"] == ""
    assert "first_moment_x_kg_m" in row["combinations"]
    assert all(row[name] is None for name in TOLD)


def test_arcs_without_spins_use_the_force_alone():
    no_spins = replayed(sensors(starts() + arcs()), machine(**POOLED))
    (row,) = only(no_spins, "arcs")
    assert row["residual_rms_N_m"] is None
    assert row["com_x_m"] == pytest.approx(COM_X_M, rel=0.05)


def test_arcs_need_no_yaw_torque():
    loader = machine(without=("torque_z_N_m",), **POOLED)
    blind = replayed(sensors(starts() + arcs()), loader)
    assert blind["planar"]["kind"].unique(maintain_order=True).to_list() == ["arc", "arcs"]
    (row,) = only(blind, "arcs")
    assert row["com_x_m"] == pytest.approx(COM_X_M, rel=0.05)


def test_spins_about_an_offset_centre_give_combinations_and_no_number():
    off = replayed(sensors(spins(), origin_x_m=-0.2), machine(**POOLED))
    (row,) = off["planar"].to_dicts()
    assert row["rank"] == 4
    assert row["identifiable"] == "first_moment_y_kg_m, friction_z_N_m_s"
    first, second = row["combinations"].split("; ")
    assert first.startswith("mass_kg - 5")
    assert first.endswith("first_moment_x_kg_m")
    assert second.startswith("inertia_z_kg_m2 - 0.2")
    assert row["com_x_m"] is None
    assert row["inertia_z_kg_m2"] is None


def test_spins_about_the_origin_determine_four_and_no_centre_of_mass():
    (row,) = replayed(sensors(spins()), machine(**POOLED))["planar"].to_dicts()
    assert row["rank"] == 4
    assert row["mass_kg"] is None
    assert row["com_x_m"] is None
    # spins at one throttle do not tell inertia from friction that is not viscous
    assert agrees(row, "inertia_z_kg_m2", "inertia_z_std_kg_m2", LOADER[1])
    assert 0.05 * LOADER[1] < row["inertia_z_std_kg_m2"] < 0.25 * LOADER[1]


def test_an_arc_shorter_than_a_window_has_no_row():
    short = replayed(sensors(starts() + arc(1.2, 0.5, seconds=2.0)), machine(**POOLED))
    assert only(short, "arc") == []


@pytest.mark.heavy
def test_an_arc_that_promises_too_little_is_refused_with_its_promise():
    strict = machine(threshold_std_com_m=1e-4, **POOLED)
    refused = replayed(sensors(starts() + spins() + arcs()), strict)
    for row in only(refused, "arcs"):
        assert row["reason"] == "low_information"
        assert row["predicted_std_com_m"] > 1e-4
        assert all(row[name] is None for name in TOLD)


@pytest.mark.heavy
def test_a_log_that_cannot_weigh_tells_no_centre_of_mass():
    said = sensors(starts() + spins() + arcs()).with_columns(pl.col("force_x_N").abs())
    table = replayed(said, machine(**POOLED))["planar"]
    assert table["withheld"].all()
    for name in TOLD:
        assert table[name].null_count() == table.height


@pytest.mark.heavy
def test_a_yaw_torque_that_is_noise_withholds_the_joint_fit_and_not_the_arcs():
    generator = np.random.default_rng(3)
    said = sensors(starts() + spins() + arcs())
    noise = generator.normal(0.0, 2000.0, said.height)
    broken = replayed(said.with_columns(torque_z_N_m=noise), machine(**POOLED))
    (row,) = only(broken, "joint")
    assert row["withheld"] is True
    assert row["com_x_m"] is None
    (row,) = only(broken, "arcs")
    assert agrees(row, "com_x_m", "com_x_std_m", COM_X_M)


@pytest.mark.heavy
def test_a_gap_in_an_arc_splits_it():
    said = sensors(starts() + spins() + arc(1.2, 0.5, seconds=12.0)).with_row_index()
    middle = said.height - 100 - 200 - 600
    holed = said.filter(~pl.col("index").is_between(middle, middle + 40)).drop("index")
    stages = replayed(holed, machine(**POOLED))
    assert len(only(stages, "arc")) == 2
    assert len(only(stages, "arcs")) == 1


def test_a_log_that_does_not_turn_has_no_row():
    straight = replayed(sensors(starts()), machine(**POOLED))["planar"]
    assert straight.is_empty()
    assert straight.columns == [column.name for column in FRAMES["planar"].columns]


#: The place of the IMU is measured.
SURVEYED = {"track_width_m": 1.5, "imu": {"position_u_m": 0.005}}


def drive_with_spin_centre(ahead_m):
    return sensors(starts() + spins() + arcs(), origin_x_m=-ahead_m)


@pytest.mark.heavy
def test_all_motion_is_told_about_an_origin_that_spins_do_not_turn_about():
    """The first moments are part of its fit, unlike of spins alone."""
    off = replayed(drive_with_spin_centre(0.15), machine(body=SURVEYED, **POOLED))
    check = off["verdict"].row(by_predicate=pl.col("check") == "spin_centre_m", named=True)
    assert check["passed"] is False
    assert off["masses"]["inertia_z_kg_m2"].to_list() == [None]
    (row,) = only(off, "joint")
    assert agrees(row, "first_moment_x_kg_m", "first_moment_x_std_kg_m", LOADER[2])
    assert agrees(row, "inertia_z_kg_m2", "inertia_z_std_kg_m2", LOADER[1])


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("ahead_m", "body"),
    mark_heavy_after(1, [(0.15, {}), (0.15, {"track_width_m": 1.5}), (0.6, SURVEYED)]),
)
def test_an_imu_that_may_be_elsewhere_than_stated_withholds_all_motion(ahead_m, body):
    """It shows what a machine does that turns about another point than the origin."""
    off = replayed(drive_with_spin_centre(ahead_m), machine(body=body, **POOLED))
    (row,) = only(off, "joint")
    assert row["withheld"]
    assert row["com_x_m"] is None
