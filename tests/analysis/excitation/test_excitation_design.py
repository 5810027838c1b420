"""Excitation design: what is predicted is what Monte Carlo finds."""

from functools import cache

import numpy as np
import pytest

from analysis.excitation.error_prediction import (
    Filters,
    MeasuredSignals,
    compute_sensor_noise_stds,
    compute_true_planar_parameters,
    make_whitened_window_system,
)
from analysis.excitation.excitation_design import (
    choose_best_waveform_score,
    compute_settling_time_s,
    copy_scenario_with_manoeuvres,
    count_parameters_determined_by_motion,
    design_excitation,
    score_waveform,
)
from analysis.simulation import Scenario, solve_motion
from analysis.simulation.scenario.manoeuvres import Excite
from estimators.errors import DataError
from estimators.planar import planar_rows
from tests.twins import mark_slow_after

TRIALS = 400
#: Of a root mean square over the trials, relative: four of its standard deviations.
SAMPLING = 4.0 / np.sqrt(2.0 * TRIALS)


def scenario(**sections):
    campaign = {"loads_kg": [0.0], "runs": 1, **sections.pop("campaign", {})}
    return Scenario.model_validate({"campaign": campaign, **sections})


PLAIN = scenario()
AHEAD = scenario(machine={"com_x_m": -0.2, "com_y_m": 0.03})


@cache
def designed(drive, made=None):
    return design_excitation({None: PLAIN, "ahead": AHEAD}[made], drive)


def errors(made, drive, score, window_s, force_noise_N=None):
    """Errors of the parameters of `drive` over noisy trials of the score's own window."""
    if force_noise_N is not None:
        sensors = made.sensors.model_copy(update={"force_noise_N": force_noise_N})
        made = made.model_copy(update={"sensors": sensors})
    filters, noise = Filters(10, made.sensors.rate_hz), compute_sensor_noise_stds(made)
    samples = round(window_s * filters.rate_hz) + filters.margin_samples_of_filters
    longer = score.manoeuvre.model_copy(update={"duration_s": score.start_s + window_s + 1.0})
    motion = solve_motion(copy_scenario_with_manoeuvres(made, longer), 0.0)
    truth = MeasuredSignals.from_motion(
        motion.sample_channels(score.start_s + np.arange(samples) / filters.rate_hz)
    )
    random = np.random.default_rng(5)
    found = []
    for _ in range(TRIALS):
        raw = MeasuredSignals(
            *(
                each + float(std) * random.standard_normal(samples)
                for each, std in zip(truth, noise, strict=True)
            )
        )
        A, y = make_whitened_window_system(drive, filters, raw, noise)
        found.append(np.linalg.lstsq(A, y)[0])
    return np.array(found), motion.body


def rms(values, truth):
    return float(np.sqrt(np.mean((values - truth) ** 2)))


@pytest.mark.heavy
@pytest.mark.parametrize("index", mark_slow_after(1, range(6)))
def test_the_predicted_error_of_the_mass_is_that_of_monte_carlo_for_every_waveform(index):
    made = designed("straight")
    score = made.scores[index]
    found, body = errors(PLAIN, "straight", score, made.window_s)
    prediction = score.predictions["mass_kg"]
    assert rms(found[:, 0], body.mass_kg) == pytest.approx(
        prediction.predicted_rms_error, rel=SAMPLING
    )
    assert found[:, 0].std() == pytest.approx(prediction.predicted_error_std, rel=SAMPLING)


@pytest.mark.heavy
def test_the_predicted_error_of_the_yaw_inertia_is_that_of_monte_carlo():
    made = designed("spin")
    for score in made.scores[:2]:
        found, body = errors(PLAIN, "spin", score, made.window_s)
        prediction = score.predictions["inertia_z_kg_m2"]
        assert found[:, 0].std() == pytest.approx(prediction.predicted_error_std, rel=SAMPLING)
        bias = found[:, 0].mean() - body.inertia_z_kg_m2
        assert bias == pytest.approx(
            prediction.bias, abs=4 * prediction.predicted_error_std / np.sqrt(TRIALS)
        )


@pytest.mark.heavy
def test_the_predicted_errors_of_a_joint_excitation_are_those_of_monte_carlo():
    made = designed("joint", "ahead")
    score = made.best
    found, body = errors(AHEAD, "joint", score, made.window_s)
    moment = found[:, planar_rows.PARAMETERS.index("first_moment_x_kg_m")]
    estimates = {
        "mass_kg": found[:, 0],
        "inertia_z_kg_m2": found[:, 1],
        "com_x_m": moment / found[:, 0],
    }
    for name, values in estimates.items():
        prediction = score.predictions[name]
        assert values.std() == pytest.approx(prediction.predicted_error_std, rel=1.5 * SAMPLING), (
            name
        )
        bias = values.mean() - prediction.value
        tolerance = 0.1 * abs(prediction.bias) + 4 * prediction.predicted_error_std / np.sqrt(
            TRIALS
        )
        assert bias == pytest.approx(prediction.bias, abs=tolerance), name
    assert body.com_x_m == -0.2


@pytest.mark.heavy
def test_the_accuracy_is_reached_above_the_smallest_signal_to_noise_ratio_and_not_below():
    made = designed("straight")
    for score in (made.scores[0], made.best):
        limit_N = PLAIN.sensors.force_noise_N * score.snr / score.snr_needed
        for noise_N, reached in ((0.85 * limit_N, True), (1.15 * limit_N, False)):
            found, body = errors(PLAIN, "straight", score, made.window_s, noise_N)
            error = rms(found[:, 0], body.mass_kg) / body.mass_kg
            assert (error < made.accuracy) == reached


def test_an_accuracy_that_other_noise_forbids_has_no_signal_to_noise_ratio():
    made = designed("straight")
    asked = (made.response_s, made.window_s, 1e-4)
    score = score_waveform(PLAIN, "straight", "triangular", "both ways", *asked)
    assert made.best.snr_needed is not None
    assert score.snr_needed is None


def test_the_response_time_of_the_papers_machine_is_its_five_seconds():
    assert compute_settling_time_s(PLAIN, 0.0, "force") == pytest.approx(5.0, abs=0.1)
    assert compute_settling_time_s(PLAIN, 0.0, "torque") == pytest.approx(4 * 0.8 + 0.08, abs=0.1)


def test_period_and_window_follow_from_the_response_time():
    made = designed("straight")
    (response_s,) = made.response_s.values()
    assert made.window_s == pytest.approx(2 * response_s)
    for score in made.scores:
        assert score.manoeuvre.force.period_s == pytest.approx(3 * response_s, abs=1e-3)


@pytest.mark.heavy
@pytest.mark.parametrize(("drive", "allowed"), [("straight", 3), ("spin", 4), ("joint", 6)])
def test_each_stage_has_the_rank_that_its_motion_allows(drive, allowed):
    made = designed(drive, "ahead") if drive == "joint" else designed(drive)
    assert {score.rank for score in made.scores} == {allowed}


@pytest.mark.slow
def test_speed_and_yaw_rate_in_step_would_leave_rank_five():
    machine = {"friction_z_N_m_s": 3200.0, "inertia_z_kg_m2": 4000.0}
    alike = scenario(machine={**machine, "mass_kg": 3614.0, "friction_N_s_m": 2891.2})
    wave = {"waveform": "triangular", "period_s": 15.0}
    excite = {"kind": "excite", "force": {**wave, "highest_N": 3000.0}}
    excite["torque"] = {**wave, "highest_N_m": 2250.0}
    motion = solve_motion(copy_scenario_with_manoeuvres(alike, Excite.model_validate(excite)), 0.0)
    assert (
        count_parameters_determined_by_motion(motion.sample_channels(np.arange(15.0, 30.0, 0.01)))
        == 5
    )
    # the design puts their periods apart instead
    for score in design_excitation(alike, "joint").scores:
        assert score.rank == 6
        periods = score.manoeuvre.force.period_s, score.manoeuvre.torque.period_s
        assert max(periods) > 1.2 * min(periods)


def test_the_window_judged_is_the_worst_and_both_ways_tell_more_than_one_way():
    made = designed("straight")
    one_way, both_ways = (
        [s.relative_error for s in made.scores if s.ways == ways]
        for ways in ("one way", "both ways")
    )
    assert max(both_ways) < min(one_way)
    assert made.best.relative_error == min(both_ways)


@pytest.mark.slow
def test_a_yard_rules_out_what_drives_beyond_it():
    long = designed("straight")
    reach = sorted(score.reach_m for score in long.scores)
    made = design_excitation(PLAIN, yard_m=reach[0] + 0.1)
    assert made.best.reach_m == pytest.approx(reach[0])
    assert choose_best_waveform_score(long.scores, 0.5) is None


@pytest.mark.heavy
def test_coulomb_friction_that_the_model_leaves_out_is_part_of_the_predicted_error():
    made = scenario(machine={"coulomb_N": 300.0})
    response_s = {"force": compute_settling_time_s(made, 0.0, "force")}
    window_s = 2 * response_s["force"]
    score = score_waveform(made, "straight", "triangular", "both ways", response_s, window_s, 0.01)
    found, body = errors(made, "straight", score, window_s)
    prediction = score.predictions["mass_kg"]
    assert abs(prediction.bias) > 5 * prediction.predicted_error_std
    assert found[:, 0].mean() - body.mass_kg == pytest.approx(prediction.bias, rel=0.05)


@pytest.mark.parametrize(
    ("sections", "options", "says"),
    [
        ({"machine": {"friction_N_s_m": 0.0}}, {}, "machine.friction_N_s_m: is 0, so that a step"),
        ({"machine": {"coulomb_N": 4000.0}}, {}, "does not overcome Coulomb friction"),
        ({"sensors": {"force_noise_N": 0.0}}, {}, "sensors.force_noise_N: is 0"),
        ({}, {"window_s": 1.0}, "give one between the response time T = 4.97 s and"),
        ({}, {"window_s": 20.0}, "the period 3 T = 14.92 s"),
    ],
)
def test_what_cannot_be_designed_is_refused_with_the_reason(sections, options, says):
    with pytest.raises(DataError, match=says):
        design_excitation(scenario(**sections), **options)


def test_the_parameters_are_those_of_the_rows():
    assert compute_true_planar_parameters(solve_motion(AHEAD, 0.0).body).tolist() == pytest.approx(
        [3614.0, 4000.0, -0.2 * 3614.0, 0.03 * 3614.0, 2891.0, 5000.0]
    )
