"""The plant of the independent bench against closed forms."""

import numpy as np
import pytest

from benchmarks.independent.legs import DIG, DRIVE, MOVING, STAND, THROTTLE, WHOLE_LEG, Leg
from benchmarks.independent.machine import GRAVITY_M_S2, Plant
from benchmarks.independent.plant import STEP_S, Motion, drive

MASS_KG = 3000.0
BARE = Plant(MASS_KG, 0.0, 6000.0, drive_lag_s=0.1)
START = Leg(DRIVE, start_s=4.0, rise_s=1e-6)


def at(motion: Motion, name: str, leg: int) -> np.ndarray:
    """A channel over one leg."""
    begin, end = np.round(motion.leg_starts_s[leg : leg + 2] / STEP_S).astype(int)
    return motion.channels[name][begin:end].astype(np.float64)


def test_a_start_against_viscous_friction_follows_its_closed_form() -> None:
    motion = drive(BARE._replace(viscous_N_s_m=1500.0), [START], 4.0)
    t_s = np.arange(4000) * STEP_S
    slow_s, lag_s = MASS_KG / 1500.0, 0.1
    decay = slow_s * np.exp(-t_s / slow_s) - lag_s * np.exp(-t_s / lag_s)
    speed = 6000.0 / 1500.0 * (1.0 - decay / (slow_s - lag_s))
    assert motion.channels["speed_m_s"] == pytest.approx(speed, abs=4e-3)


def test_work_goes_into_kinetic_energy_height_and_losses() -> None:
    plant = BARE._replace(
        viscous_N_s_m=500.0,
        coulomb_N=300.0,
        rolling_1=0.02,
        rolling_far_1=0.02,
        quadratic_N_s2_m2=40.0,
        slope_rad=0.03,
        hills_rad=0.01,
        hills_length_m=11.0,
    )
    rows = drive(plant, [START], 4.0).channels
    speed, position = (rows[n].astype(np.float64) for n in ("speed_m_s", "position_m"))
    grade = plant.slope_rad + plant.hills_rad * np.sin(2.0 * np.pi * position / 11.0)
    weight_N = MASS_KG * GRAVITY_M_S2
    against_N = 500.0 * speed + 40.0 * speed**2 + 300.0 + 0.02 * weight_N * np.cos(grade)
    lifted_J = weight_N * np.trapezoid(np.sin(grade), position)
    work_J = np.trapezoid(rows["force_N"] - against_N, position)
    assert MASS_KG * speed[-1] ** 2 / 2.0 + lifted_J == pytest.approx(work_J, rel=2e-3)


def test_the_impulse_of_the_drive_is_the_momentum_of_machine_and_load_that_it_picks_up() -> None:
    leg = START._replace(load_to_kg=800.0, load_rate_kg_s=200.0, load_when=THROTTLE)
    rows = drive(BARE, [leg], 3.9).channels
    mass_kg = MASS_KG + rows["load_kg"][-1]
    impulse = float(rows["force_N"].astype(np.float64).sum()) * STEP_S
    assert mass_kg > MASS_KG + 700.0
    assert mass_kg * rows["speed_m_s"][-1] == pytest.approx(impulse, rel=2e-3)


def test_what_pours_out_takes_its_momentum_along() -> None:
    filled = Leg(STAND, duration_s=1.0, load_to_kg=500.0, load_rate_kg_s=1e3, load_when=WHOLE_LEG)
    pours = START._replace(cruise_s=1e9, load_rate_kg_s=50.0, load_when=MOVING)
    rows = drive(BARE, [filled, pours], 9.0).channels
    mass_kg = MASS_KG + rows["load_kg"].astype(np.float64)
    moving = slice(1500, 4500)
    force_N = mass_kg * rows["acceleration_m_s2"]
    assert rows["load_kg"][-1] < 200.0
    assert force_N[moving] == pytest.approx(rows["force_N"][moving], rel=1e-3)


@pytest.mark.parametrize("load_kg", [0.0, 900.0])
def test_rolling_resistance_slows_every_load_alike(load_kg: float) -> None:
    plant = BARE._replace(rolling_1=0.02, rolling_far_1=0.02)
    loaded = Leg(STAND, duration_s=1.0, load_to_kg=load_kg, load_rate_kg_s=1e3, load_when=WHOLE_LEG)
    coasts = START._replace(start_s=2.0, brake_m_s2=1e-9, seen_1=0.0, load_to_kg=load_kg)
    motion = drive(plant, [loaded, coasts], 20.0)
    # the drive's force is gone five time constants after the throttle
    slowing = at(motion, "acceleration_m_s2", 1)[3500:4500]
    assert slowing == pytest.approx(-0.02 * GRAVITY_M_S2, rel=1e-3)


def test_brakes_decelerate_as_asked_and_only_the_drive_s_share_is_seen() -> None:
    stops = START._replace(start_s=3.0, brake_m_s2=1.2, seen_1=0.25)
    motion = drive(BARE, [stops], 20.0)
    assert motion.whole
    braking = slice(-1000, -100)
    assert at(motion, "acceleration_m_s2", 0)[braking] == pytest.approx(-1.2, rel=2e-2)
    assert at(motion, "force_N", 0)[braking] == pytest.approx(-0.25 * 1.2 * MASS_KG, rel=2e-2)


def test_a_stand_on_a_slope_stands() -> None:
    motion = drive(BARE._replace(slope_rad=0.1), [Leg(STAND, duration_s=3.0)], 10.0)
    assert not motion.channels["speed_m_s"].any()
    assert motion.channels["pitch_rad"] == pytest.approx(0.1)


def test_facing_back_turns_track_and_grade_round() -> None:
    plant = BARE._replace(slope_rad=0.02)
    up, down = (drive(plant, [START._replace(facing=way)], 3.0).channels for way in (1.0, -1.0))
    assert up["position_m"][-1] > 0.0 > down["position_m"][-1]
    assert down["speed_m_s"][-1] > up["speed_m_s"][-1] > 0.0
    assert down["pitch_rad"][-1] == pytest.approx(-0.02)


def test_a_drive_stands_near_the_place_that_it_leads_to() -> None:
    plant = BARE._replace(viscous_N_s_m=900.0, rolling_1=0.02, rolling_far_1=0.02)
    motion = drive(plant, [START._replace(to_m=25.0, cruise_s=60.0, brake_m_s2=0.8)], 60.0)
    assert motion.whole
    assert motion.channels["position_m"][-1] == pytest.approx(25.0, abs=1.0)


def test_a_pile_stalls_the_machine_and_fills_the_bucket() -> None:
    plant = BARE._replace(pile_N_m=3000.0, pile_N_m2=3000.0, pile_full_m=0.8)
    digs = Leg(DIG, to_m=3.0, load_to_kg=600.0, top_m_s=2.0, duration_s=1.0)
    motion = drive(plant, [digs], 30.0)
    load_kg = motion.channels["load_kg"]
    assert motion.whole
    assert motion.channels["speed_m_s"][-500:].max() == 0.0
    # who stalls still pushes with all there is
    assert motion.channels["force_N"][-1] == pytest.approx(6000.0, rel=2e-2)
    assert (np.diff(load_kg) >= 0.0).all()
    assert load_kg[-1] == pytest.approx(600.0)
    assert load_kg[motion.channels["position_m"] < 3.0].max() == 0.0


def test_friction_that_warms_has_lost_its_share_at_the_end() -> None:
    steady = START._replace(start_s=400.0, throttle=0.5)
    plant = BARE._replace(viscous_N_s_m=1500.0, warming_share=0.25, warming_s=300.0)
    speed = drive(plant, [steady], 300.0).channels["speed_m_s"]
    assert speed[-1] == pytest.approx(3000.0 / (0.75 * 1500.0), rel=1e-2)


def test_the_body_pitches_with_the_acceleration_and_sinks_with_the_load() -> None:
    plant = BARE._replace(squat_s2_m=0.005, squat_by_mass=1.0, sag_rad_kg=1e-5)
    loaded = Leg(STAND, duration_s=5.0, load_to_kg=300.0, load_rate_kg_s=300.0, load_when=WHOLE_LEG)
    motion = drive(plant, [loaded, START._replace(load_to_kg=300.0)], 9.0)
    stand, start = (at(motion, "squat_rad", leg) for leg in (0, 1))
    assert stand[-1] == pytest.approx(-0.003, rel=1e-3)
    rate = 6000.0 / 3300.0
    assert start[2500] == pytest.approx(0.005 * 1.1 * rate - 0.003, rel=2e-2)
