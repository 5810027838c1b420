"""Stage 2: yaw inertia and friction from spins, gated and judged on the yaw axis."""

import numpy as np
import polars as pl
import pytest

from analysis.model.machine_body import ImuMounting
from analysis.model.windows import mark_samples_in_accepted_windows
from analysis.stages.estimation.method_estimates import list_reasons_for_no_answer
from tests.analysis.plane_drives import (
    LOADER,
    braked,
    hold,
    machine,
    replayed,
    sensors,
    spin,
    spins,
    start,
    starts,
    to,
)

INERTIA_KG_M2, FRICTION_N_M_S = LOADER[1], LOADER[5]


@pytest.fixture(scope="module")
def stages():
    """Three straight starts, then four spins, each from and braked to a standstill."""
    return replayed(sensors(starts() + spins()))


def pooled(stages):
    return stages["masses"].row(by_predicate=pl.col("method") == "pooled", named=True)


def reasons(stages):
    return stages["gate"]["reason_z"].cast(pl.String).to_numpy()


def flags(stages, phase):
    return (stages["excitation"]["phase"] == phase).fill_null(False).to_numpy()


@pytest.mark.parametrize("method", ["ls", "rls", "fgls", "tls", "pooled"])
def test_every_method_finds_inertia_within_two_percent_and_mass_beside_it(stages, method):
    found = stages["masses"].row(by_predicate=pl.col("method") == method, named=True)
    assert found["inertia_z_kg_m2"] == pytest.approx(INERTIA_KG_M2, rel=0.02)
    assert found["friction_z_N_m_s"] == pytest.approx(FRICTION_N_M_S, rel=0.04)
    assert found["mass_kg"] == pytest.approx(LOADER[0], rel=0.015)
    assert found["rows"]
    assert found["rows_z"]


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["left", "right"])
def test_spins_to_either_side_tell_the_same(sign):
    manoeuvre = spin(sign)
    drive = [hold(1.5), manoeuvre, to(1.5, manoeuvre), hold(1.5)] * 3
    said = sensors(drive)
    assert pooled(replayed(said))["inertia_z_kg_m2"] == pytest.approx(INERTIA_KG_M2, rel=0.02)


def test_a_row_of_an_estimate_is_of_one_axis_and_rows_are_in_order_of_time(stages):
    for method in ("ls", "rls", "fgls", "tls", "pooled"):
        frame = stages[f"estimates/{method}"]
        assert frame["t_ns"].is_sorted()
        x, z = frame.filter(axis="x"), frame.filter(axis="z")
        assert x.height
        assert z.height
        for columns in ("inertia_z_kg_m2", "friction_z_N_m_s", "residual_rms_N_m"):
            assert x[columns].null_count() == x.height
        for columns in ("mass_kg", "friction_x_N_s_m", "residual_rms_N"):
            assert z[columns].null_count() == z.height


def test_what_spins_add_does_not_change_the_mass(stages):
    """The same starts without spins after them, and without the channels of the yaw axis."""
    without = machine(without=("torque_z_N_m",))
    plain = pooled(replayed(sensors(starts() + spins()), without))
    assert plain["mass_kg"] == pooled(stages)["mass_kg"]
    assert plain["mass_std_kg"] == pooled(stages)["mass_std_kg"]
    assert "inertia_z_kg_m2" not in plain


def test_an_accepted_window_of_spins_holds_spins_and_standstill_alone(stages):
    accepted = stages["gate"]["accepted_z"].to_numpy()
    inside = mark_samples_in_accepted_windows(accepted, 320)
    held = stages["excitation"]["phase"].filter(pl.Series(inside)).unique().to_list()
    assert sorted(held) == ["spinning", "standstill"]
    assert stages["gate"].filter("accepted_z")["mi_z_nat"].min() >= 0.7


def test_a_window_that_travels_is_refused_as_translating(stages):
    why = reasons(stages)
    driving = flags(stages, "accelerating") | flags(stages, "cruising")
    assert set(why[driving]) <= {"translating", "warming_up"}


def test_a_spin_that_slows_down_is_refused_as_braking_unless_braking_counts(stages):
    assert "braking" in reasons(stages)
    welcome = replayed(sensors(starts() + spins()), machine(exclude_braking=False))
    assert "braking" not in reasons(welcome)
    assert welcome["gate"]["accepted_z"].sum() > stages["gate"]["accepted_z"].sum()
    assert pooled(welcome)["inertia_z_kg_m2"] == pytest.approx(INERTIA_KG_M2, rel=0.02)


def test_a_lost_sample_refuses_its_windows_as_a_gap_and_the_rest_still_tells():
    said = sensors(spins()).with_row_index()
    holed = replayed(said.filter(~pl.col("index").is_between(450, 490)).drop("index"))
    assert "gap" in reasons(holed)
    assert pooled(holed)["inertia_z_kg_m2"] == pytest.approx(INERTIA_KG_M2, rel=0.02)


def test_a_yaw_torque_at_its_sensors_end_is_saturated():
    said = sensors(spins()).with_columns(pl.col("torque_z_N_m").clip(-3000.0, 3000.0))
    clipped = replayed(said, machine(saturation_torque_z_N_m=3000.0))
    assert "saturated" in reasons(clipped)


@pytest.mark.parametrize(
    ("settings", "column", "better"),
    [
        ({"index": "ksg", "threshold_nat": 1.0}, "ksg_z_nat", 1),
        ({"index": "variance", "threshold_std_kg_m2": 25.0}, "predicted_std_z", -1),
    ],
    ids=["ksg", "variance"],
)
def test_another_gate_decides_by_its_own_column(settings, column, better):
    judged = replayed(sensors(spins()), machine(**settings))["gate"]
    limit = settings.get("threshold_nat", settings.get("threshold_std_kg_m2"))
    number, accepted = judged[column].to_numpy(), judged["accepted_z"].to_numpy()
    low = (judged["reason_z"] == "low_information").to_numpy()
    assert accepted.any()
    assert (better * number[accepted] >= better * limit).all()
    assert (better * number[low] < better * limit).all()


def test_a_spin_is_a_manoeuvre_with_its_own_inertia(stages):
    table = stages["segments"].filter(phase="spinning")
    told = table.filter(pl.col("inertia_z_kg_m2").is_not_null())
    assert told.height == 4
    assert told["reason"].unique().to_list() == ["accepted"]
    assert told["mass_kg"].null_count() == 4
    z = (told["inertia_z_kg_m2"] - INERTIA_KG_M2) / told["inertia_z_std_kg_m2"]
    assert z.abs().max() < 4
    assert (told["samples_accepted"] > 200).all()


def test_a_yaw_torque_without_sign_withholds_the_inertia_and_leaves_the_mass():
    said = sensors(starts() + spins()).with_columns(pl.col("torque_z_N_m").abs())
    unsigned = replayed(said)
    failed = unsigned["verdict"].filter(~pl.col("passed"))
    assert "spin_driving_share" in failed["check"].to_list()
    assert failed["about"].unique().to_list() == ["inertia"]
    assert pooled(unsigned)["inertia_z_kg_m2"] is None
    assert pooled(unsigned)["withheld_z"] is True
    assert pooled(unsigned)["mass_kg"] == pytest.approx(LOADER[0], rel=0.015)


def test_a_force_without_sign_withholds_the_inertia_as_well():
    said = sensors(braked(start(), start()) + spins()).with_columns(pl.col("force_x_N").abs())
    unsigned = replayed(said)
    failed = unsigned["verdict"].filter(~pl.col("passed"))
    assert failed["about"].unique().to_list() == ["mass"]
    assert pooled(unsigned)["inertia_z_kg_m2"] is None


def test_spins_about_a_point_off_the_origin_are_found_and_withheld():
    """They tell Izz - 0.2 mc_x: a number that looks fine and is none."""
    off = replayed(sensors(starts() + spins(), origin_x_m=-0.2))
    check = off["verdict"].row(by_predicate=pl.col("check") == "spin_centre_m", named=True)
    assert check["value"] == pytest.approx(0.2, abs=0.01)
    assert check["passed"] is False
    assert pooled(off)["inertia_z_kg_m2"] is None
    assert pooled(off)["mass_kg"] is not None


def test_a_log_of_spins_alone_tells_inertia_and_no_mass():
    alone = pooled(replayed(sensors(spins())))
    assert alone["inertia_z_kg_m2"] == pytest.approx(INERTIA_KG_M2, rel=0.02)
    assert alone["mass_kg"] is None


def test_a_log_that_does_not_spin_has_no_check_of_an_inertia():
    straight = replayed(sensors(starts()))
    assert straight["verdict"]["about"].unique().to_list() == ["mass"]
    assert pooled(straight)["withheld_z"] is True
    assert not straight["gate"]["accepted_z"].any()


@pytest.mark.parametrize("missing", ["torque_z_N_m", "yaw_acc_rad_s2"])
def test_without_a_channel_there_is_no_yaw_axis_and_a_note_names_it(missing):
    loader = machine(without=(missing,))
    stages = replayed(sensors(starts() + spins()), loader)
    for name in ("gate", "masses", "segments", "estimates/ls"):
        assert not [c for c in stages[name].columns if "_z" in c or c == "axis"]
    (note,) = list_reasons_for_no_answer(stages["excitation"], stages["gate"], loader.settings)
    assert note.startswith("the log has spins, but the inertia needs ")
    assert f"channels.{missing}" in note
    turned = replayed(sensors(starts()), loader)
    assert list_reasons_for_no_answer(turned["excitation"], turned["gate"], loader.settings) == []


@pytest.mark.heavy
@pytest.mark.parametrize(
    # fewer than 4 of 6 logs hold once in 450 times
    ("logs", "least"),
    [(6, 0.66), pytest.param(100, 0.90, marks=pytest.mark.slow)],
)
def test_intervals_of_every_method_cover_the_inertia_however_it_takes_the_noise_of_its_columns(
    logs, least
):
    """Logs of different noise, nominal 95 %: what noise draws least squares by is inside."""
    methods = ("ls", "rls", "fgls", "tls", "pooled")
    inside = []
    for seed in range(logs):
        total = replayed(sensors(spins(), seed=seed), machine(methods=methods))["masses"]
        error = total["inertia_z_kg_m2"].to_numpy() - INERTIA_KG_M2
        inside.append(np.abs(error) < 1.96 * total["inertia_z_std_kg_m2"].to_numpy())
    covered = dict(zip(methods, np.mean(inside, axis=0), strict=True))
    assert all(share >= least for share in covered.values()), covered


def test_windows_that_keep_the_noise_of_their_columns_say_so_in_their_deviation(stages):
    """Their scatter is a third of what the noise of a derived yaw acceleration draws them by."""
    quiet = machine(yaw_acc_rad_s2=1e-9, yaw_rate_rad_s=1e-9)
    blind = replayed(sensors(starts() + spins()), quiet)
    for method in ("ls", "fgls"):
        knows, does_not = (
            each["masses"].row(by_predicate=pl.col("method") == method, named=True)
            for each in (stages, blind)
        )
        short = INERTIA_KG_M2 - does_not["inertia_z_kg_m2"]
        assert short > 1.96 * does_not["inertia_z_std_kg_m2"]
        assert 0 < INERTIA_KG_M2 - knows["inertia_z_kg_m2"] < 1.96 * knows["inertia_z_std_kg_m2"]
        assert knows["mass_std_kg"] == does_not["mass_std_kg"]


def test_a_tilted_imu_tells_the_same_inertia_as_a_level_one(stages):
    """The gyroscope is turned before its yaw acceleration is derived."""
    tilt = ImuMounting(roll_deg=20.0, pitch_deg=-15.0, yaw_deg=30.0)
    tilted = replayed(sensors(starts() + spins(), imu=tilt), machine(imu=tilt))
    found, level = pooled(tilted), pooled(stages)
    assert found["inertia_z_kg_m2"] == pytest.approx(INERTIA_KG_M2, rel=0.02)
    assert found["inertia_z_std_kg_m2"] == pytest.approx(level["inertia_z_std_kg_m2"], rel=0.2)
    derived = tilted["aligned"]["yaw_acc_rad_s2"].to_numpy()
    np.testing.assert_allclose(
        derived[1:-1], np.gradient(tilted["aligned"]["yaw_rate_rad_s"], 0.01)[1:-1], atol=1e-6
    )


def test_a_start_between_spins_keeps_windows_apart():
    """A window never mixes what one axis refuses with what the other takes."""
    mixed = replayed(sensors([hold(1.5), start(), *spins()]))
    both = mixed["gate"].filter(pl.col("accepted_x") & pl.col("accepted_z"))
    assert both.is_empty()
