"""Every check finds the fault that it is about, and none is raised by clean logs."""

import dataclasses
from functools import cache

import numpy as np
import polars as pl
import pytest

from analysis.diagnosis import CHECKS, CheckInputs, judge_log_by_checks
from analysis.diagnosis.fit_checks import compare_methods_with_joint_fit
from analysis.diagnosis.measured_channels import RawSignals
from analysis.model.prior_settings import PriorSettings
from analysis.stages.estimation.method_estimates import summarise_masses
from analysis.weighing.nuisances import NUISANCES
from tests.analysis.weighing.weighed import RICH, RUNS, Weighed, merged, weighed
from tests.trials.situations import SITUATIONS
from tests.twins import mark_slow_after

BRAKING_AS_DRIVING = "settings.gate.exclude_braking=false"
BRAKES_SEEN = {"campaign": {"brake_measured_share": 1.0}}
#: A load that is a little other at every start, by no pattern.
SPILLS = {"campaign": {"loads_kg": [0.0, 10.0, 55.0, 80.0, 30.0, 5.0, 65.0, 90.0, 40.0], "runs": 1}}
#: A bucket that takes up a payload of 250 kg at every start.
FILLS = {"loading": {"fill_kg_s": 50.0}, "starts": {"directions": "alternating"}}
#: An accelerometer of three axes, as an IMU has.
AXES = tuple(
    f'channels.specific_force_{axis}_m_s2={{topic="/imu",field="{axis}"}}' for axis in "yz"
)
CLEAN = {
    "one way": {},
    "both ways at several throttles": RICH,
    "stamps that jitter": {"sampling": {"stamp_jitter_s": 0.003}},
    "both ways": {"starts": {"directions": "alternating"}},
    "five starts": {"campaign": {"runs": 5}},
    "half the machine": {
        "machine": {"mass_kg": 1800.0, "friction_N_s_m": 1500.0},
        "campaign": {"throttle_force_N": 3000.0},
    },
}


@cache
def situation(name: str, rich: bool = False) -> Weighed:
    return weighed(merged(RICH if rich else {}, SITUATIONS[name]))


@cache
def clean(name: str) -> Weighed:
    return weighed(CLEAN[name], *AXES)


def turned(topics):
    """The IMU lies on its side: gravity on y."""
    upward = pl.col("specific_force_z_m_s2")
    return {
        name: frame.with_columns(
            specific_force_y_m_s2=upward, specific_force_z_m_s2=-pl.col("specific_force_y_m_s2")
        )
        if "specific_force_z_m_s2" in frame.columns
        else frame
        for name, frame in topics.items()
    }


def torques(change):
    """Topics with another torque."""
    return lambda topics: {
        name: frame.with_columns(change(pl.col("^torque_.*_N_m$")))
        for name, frame in topics.items()
    }


def backwards(topics):
    """Wheels that count the other way."""
    return {name: frame.with_columns(-pl.col("^speed_.*_m_s$")) for name, frame in topics.items()}


def swaying(topics):
    """The accelerometer hangs on a cable, and sways by 0.5 m/s² with a period of two seconds."""
    sway = pl.Series(0.5 * np.sin(np.arange(10**6) / 30.0))
    return {
        name: frame.with_columns(pl.col("specific_force_x_m_s2") + sway.head(frame.height))
        if "specific_force_x_m_s2" in frame.columns
        else frame
        for name, frame in topics.items()
    }


#: By check: a log with its fault.
#: Starts so weak, and wheels so noisy, that the derivative of their speed is mostly noise.
NOISY_WHEELS = {"campaign": {"throttle_force_N": 2000.0}, "sensors": {"speed_noise_m_s": 0.01}}
DERIVED = ("settings.forces.acceleration=kinematic", "channels.acc_x_m_s2.derive=d/dt speed_x_m_s")
FAULTS = {
    "clock_drift_s": lambda: situation("force clock +0.1 %"),
    "clipped_share": lambda: situation("force clipped"),
    "imu_tilt_deg": lambda: weighed({}, *AXES, changed=turned),
    "opposing_share": lambda: weighed(BRAKES_SEEN, changed=torques(pl.Expr.abs)),
    "raw_opposing_share": lambda: weighed(
        BRAKES_SEEN,
        "settings.forces.acceleration=kinematic",
        'channels.acc_x_m_s2.derive="d/dt speed_x_m_s"',
        "settings.filter.cutoff_hz=0.5",
        changed=torques(pl.Expr.abs),
    ),
    "force_sign": lambda: weighed({}, changed=torques(pl.Expr.neg)),
    "term_beyond_prior": lambda: weighed({"sensors": {"force_bias_N": 4000.0}}),
    "filling": lambda: weighed(FILLS),
    "friction_sign": lambda: weighed({}, changed=backwards),
    "side_difference": lambda: weighed({"defects": {"left_torque_gain": 0.9}}),
    "one_sided_torque": lambda: weighed({"defects": {"left_torque_gain": 0.5}}),
    "force_delay_s": lambda: situation("force late 150 ms"),
    "speed_delay_s": lambda: situation("IMU low-passed 200 ms"),
    "wheel_imu_gain_error": lambda: situation("wheels 5 % larger"),
    "wheel_imu_residual": lambda: weighed({}, changed=swaying),
    "force_nonlinearity": lambda: situation("brakes release in 0.5 s"),
    "common_misfit": lambda: situation("brakes release in 0.5 s"),
    "braking_bias": lambda: weighed({}, BRAKING_AS_DRIVING),
    "channel_noise": lambda: weighed(NOISY_WHEELS, *DERIVED),
    "relative_u": lambda: situation("force clipped"),
    "manoeuvre_scatter": lambda: weighed(SPILLS),
    "disagreeing_methods": lambda: situation("Coulomb friction 300 N", rich=True),
    "gating_bias": lambda: situation("speed late 30 ms"),
    "constant_force": lambda: situation("force offset +300 N", rich=True),
    "coulomb_friction": lambda: situation("Coulomb friction 300 N", rich=True),
    "quadratic_drag": lambda: situation("brakes release in 0.5 s"),
}
CONSEQUENCE = {row.name: row.consequence for row in CHECKS}


@pytest.mark.heavy
@pytest.mark.parametrize("name", FAULTS)
def test_a_check_finds_the_fault_that_it_is_about(name):
    log = FAULTS[name]()
    found = log.check(name)
    assert found.passed is False, found
    assert found.consequence == CONSEQUENCE[name]
    assert log.load["withheld"] or found.consequence != "withhold"


@pytest.mark.heavy
def test_where_the_force_is_ahead_the_remedy_is_the_delay_of_the_acceleration():
    late = weighed({"sensors": {"imu_delay_s": 0.15}}).check("force_delay_s")
    assert late.passed is False
    assert late.remedy.startswith(
        "channels.specific_force_x_m_s2.delay_s: the acceleration is late"
    )
    assert (
        situation("force late 150 ms")
        .check("force_delay_s")
        .remedy.startswith("channels.force_x_N.delay_s")
    )


def test_where_braking_counts_as_driving_the_remedy_is_to_exclude_it():
    remedy = weighed({}, BRAKING_AS_DRIVING).check("friction_sign").remedy
    assert remedy.startswith("settings.gate.exclude_braking = true, where brakes act")


@pytest.mark.heavy
def test_a_term_beyond_its_prior_is_named():
    transfer = {"machine": {"force_share": 0.5}, "defects": {"force_share_s2_m": 0.08}}
    log = weighed(merged(RICH, transfer))
    assert log.load["withheld_for"] == "term_beyond_prior"
    check = log.check("term_beyond_prior")
    assert check.meaning.endswith("(load_transfer)")
    assert check.remedy.endswith("is so large, widen settings.priors.load_transfer_s2_m")


@pytest.mark.heavy
def test_soft_ground_is_weighed_though_its_resistance_explains_most_of_the_force():
    soft = {"rolling": {"coefficient": 0.06}, "starts": {"throttle_least": 0.8}}
    log = weighed(merged(RUNS, soft))
    assert not log.load["withheld"], log.fired
    assert abs(log.error_u) <= 3.0


def test_keys_of_a_nuisance_are_settings_of_its_prior():
    assert {key for each in NUISANCES for key in each.prior_keys} <= {*PriorSettings.model_fields}
    assert all(each.prior_keys for each in NUISANCES if each.name != "offset")


def test_on_uneven_ground_the_remedy_is_a_pitch_that_is_measured():
    """The force agrees with the accelerometer there, so that the disagreement is a note."""
    check = situation("hills").check("wheel_imu_residual")
    assert check.remedy.startswith("on uneven ground, channels.pitch_rad; else ")
    assert check.consequence == "tell"
    assert "times as large" in check.meaning


@pytest.mark.heavy
@pytest.mark.parametrize("topic", mark_slow_after(1, ["IMU", "speed", "force"]))
def test_a_topic_whose_values_repeat_is_found_whichever_it_is(topic):
    log = situation(f"frozen {topic}")
    assert "frozen_s" in log.fired
    assert log.check("frozen_s").value > 2.0
    assert log.load["withheld"]


@pytest.mark.heavy
@pytest.mark.parametrize("name", mark_slow_after(3, CLEAN))
def test_clean_logs_raise_no_check_and_are_weighed(name):
    log = clean(name)
    assert log.fired == set()
    assert not log.load["withheld"]
    assert abs(log.error_u) <= 3.0


#: Checks whose fault is in `test_verdict` (of the ungated log), `test_empty_mass` or a test below.
FAULT_IN_ANOTHER_TEST = {
    "partial_correlation",
    "relative_std",
    "r_squared",
    "driving_share",
    "acceleration_gain",
    "accepted_stretches",
    "empty_mass_ratio",
    "negative_payload",
    "empty_mass",
    "frozen_s",
}


def test_every_check_of_the_mass_has_a_fault_that_it_finds():
    of_mass = {row.name for row in CHECKS if row.about == "mass"}
    tested = {*FAULTS, *FAULT_IN_ANOTHER_TEST}
    untested, unknown = sorted(of_mass - tested), sorted(tested - of_mass)
    assert not untested, (
        f"no test makes {', '.join(untested)} fail: add a log with the fault to FAULTS, or name "
        "the check in FAULT_IN_ANOTHER_TEST"
    )
    assert not unknown, f"{', '.join(unknown)}: no such check; remove it from this file"


def test_a_check_whose_limit_is_no_setting_says_where_to_add_it():
    with pytest.raises(ValueError, match="'late_max'; add it to VerdictLimits in analysis/model"):
        dataclasses.replace(CHECKS[0], maximum="late_max")


class TestConsequences:
    def test_withhold_takes_the_answer_and_every_method(self):
        log = situation("force late 150 ms")
        assert not log.verdict.can_weigh
        assert [check.check for check in log.verdict.list_withholding_checks("mass")] == [
            "force_delay_s"
        ]
        assert log.load["mass_kg"] is None
        assert log.load["withheld_for"] == "force_delay_s"
        assert log.replayed.frames["masses"]["mass_kg"].null_count() == 2

    def test_widen_leaves_the_answer_with_a_remark_and_a_part_in_the_budget(self):
        log = situation("wheels 5 % larger")
        assert log.verdict.can_weigh
        assert [check.check for check in log.verdict.failed_checks_that_withhold_nothing] == [
            "wheel_imu_gain_error"
        ]
        assert log.load["mass_kg"] is not None
        assert log.causes["gain"] > 100.0

    def test_method_takes_the_methods_that_the_answer_contradicts_alone(self):
        log = situation("Coulomb friction 300 N", rich=True)
        assert log.verdict.can_weigh
        assert log.load["mass_kg"] is not None
        shown = log.replayed.frames["masses"]
        assert shown["withheld"].any()
        assert (shown["mass_kg"].is_null() == shown["withheld"]).all()
        assert log.check("disagreeing_methods").value == shown["withheld"].sum()

    def test_tell_takes_nothing(self):
        log = situation("force offset +300 N", rich=True)
        assert [check.check for check in log.verdict.failed_checks_that_withhold_nothing] == [
            "constant_force"
        ]
        assert not log.load["withheld"]
        assert not log.replayed.frames["masses"]["withheld"].any()

    def test_a_check_that_can_be_mended_says_how(self):
        for row in CHECKS:
            if row.about == "mass" and row.consequence == "widen":
                assert row.remedy, row.name


class TestDisagreement:
    """Two methods against the answer."""

    def evidence(self, log, mass_kg, std_kg, **overrides):
        frames, machine = log.replayed.frames, log.machine
        estimates = {name: frames[f"estimates/{name}"] for name in ("pooled", "ls")}
        said = summarise_masses(
            frames["excitation"], frames["gate"], estimates, machine, frames["noise"]
        )
        said = said.with_columns(
            mass_kg=pl.Series([log.load["mass_kg"] + mass_kg] * 2), mass_std_kg=pl.lit(std_kg)
        )
        forces = machine.settings.forces.model_copy(update=overrides)
        settings = machine.settings.model_copy(update={"forces": forces})
        machine = machine.model_copy(update={"settings": settings})
        return CheckInputs(frames["excitation"], frames["gate"], machine, log.weighing, totals=said)

    def contradicted(self, *args, **kwargs):
        return {
            each.contradicted
            for each in compare_methods_with_joint_fit(self.evidence(*args, **kwargs))
        }

    def test_a_method_within_three_deviations_is_shown(self):
        assert self.contradicted(clean("both ways at several throttles"), 20.0, 5.0) == {False}

    def test_a_method_farther_off_is_not_if_it_matters(self):
        log = clean("both ways at several throttles")
        assert self.contradicted(log, 60.0, 5.0) == {True}
        # three deviations, and less than one percent
        assert self.contradicted(log, 34.0, 0.1) == {False}

    def test_where_a_term_is_found_an_interval_must_hold_the_answers(self):
        log = situation("Coulomb friction 300 N", rich=True)
        assert self.contradicted(log, 0.0, 2.0) == {True}
        assert self.contradicted(log, 0.0, 20.0) == {False}

    def test_a_method_with_the_coulomb_term_lacks_no_coulomb_term(self):
        log = situation("Coulomb friction 300 N", rich=True)
        assert self.contradicted(log, 0.0, 2.0, coulomb=True) == {False}

    def test_a_mass_without_a_deviation_is_not_shown(self):
        assert self.contradicted(clean("one way"), 0.0, None) == {True}


class TestSignals:
    """What freezes and clips, of channels made by hand."""

    T_NS = np.arange(1000) * 10_000_000

    def signals(self, **channels):
        return RawSignals({name: (self.T_NS, x) for name, x in channels.items()}, None, 10.0)

    def ramp(self):
        return np.linspace(0.0, 3.0, 1000)

    def test_a_reading_that_repeats_while_another_changes_is_frozen(self):
        force = np.random.default_rng(1).normal(0.0, 60.0, 1000)
        force[300:700] = force[300]
        found = self.signals(force_x_N=force, speed_x_m_s=self.ramp()).longest_frozen_duration_s
        assert found == pytest.approx(3.99)

    def test_a_reading_that_repeats_while_nothing_changes_is_not(self):
        force = np.random.default_rng(1).normal(0.0, 60.0, 1000)
        force[300:700] = force[300]
        still = np.where(np.arange(1000) < 800, 1.0, 2.0)
        assert self.signals(force_x_N=force, speed_x_m_s=still).longest_frozen_duration_s == 0.0

    def test_a_machine_that_stands_has_a_speed_of_zero_and_is_not_frozen(self):
        speed = np.where(np.arange(1000) < 400, 0.0, self.ramp())
        assert (
            self.signals(force_x_N=self.ramp(), speed_x_m_s=speed).longest_frozen_duration_s == 0.0
        )

    @pytest.mark.parametrize("reading", [0.0, 700.0])
    def test_a_sensor_that_never_moves_while_the_other_side_does_is_dead(self, reading):
        torques = {"torque_left_N_m": np.full(1000, reading), "torque_right_N_m": self.ramp()}
        found = self.signals(**torques, speed_x_m_s=self.ramp())
        assert found.longest_frozen_duration_s == pytest.approx(9.99)
        assert found.frozen_spans["torque_right_N_m"] == []

    def test_a_machine_that_never_drives_is_not_frozen(self):
        noise = np.random.default_rng(3).normal(0.0, 60.0, 1000)
        channels = {"force_x_N": noise, "specific_force_x_m_s2": noise}
        assert self.signals(**channels, speed_x_m_s=np.zeros(1000)).longest_frozen_duration_s == 0.0

    def test_a_quantised_reading_is_not_frozen(self):
        coarse = np.round(self.ramp() / 0.02) * 0.02
        assert (
            self.signals(force_x_N=self.ramp(), speed_x_m_s=coarse).longest_frozen_duration_s == 0.0
        )

    def test_readings_that_pile_up_at_their_extreme_are_clipped(self):
        force = np.random.default_rng(2).normal(0.0, 2000.0, 1000)
        cut = np.clip(force, None, 3000.0)
        share = (force > 3000.0).mean()
        assert self.signals(force_x_N=cut).largest_clipped_fraction == pytest.approx(share)
        assert self.signals(force_x_N=force).largest_clipped_fraction == 0.0

    def test_a_speed_at_its_extreme_is_not_what_clips(self):
        cruise = np.minimum(self.ramp(), 2.0)
        assert self.signals(speed_x_m_s=cruise).largest_clipped_fraction == 0.0


def test_frames_alone_are_judged_by_what_they_tell():
    log = clean("one way")
    frames = log.replayed.frames
    judged = judge_log_by_checks(CheckInputs(frames["excitation"], frames["gate"], log.machine))
    unknown = set(judged.filter(pl.col("passed").is_null())["check"])
    assert {"force_delay_s", "wheel_imu_gain_error", "manoeuvre_scatter"} <= unknown
    assert {"frozen_s", "disagreeing_methods", "raw_opposing_share"} <= unknown
    assert not judged["passed"].fill_null(value=True).not_().any()
