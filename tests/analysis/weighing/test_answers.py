"""The joint fit on simulated logs: every fault is in the term that stands for it."""

from functools import cache

import numpy as np
import pytest

from analysis.model.prior_settings import PriorSettings
from tests.analysis.weighing.weighed import (
    FRICTION_N_S_M,
    RICH,
    Weighed,
    merged,
    simulate_and_weigh,
    weighed,
)
from tests.trials.situations import SITUATIONS
from tests.twins import mark_heavy_after

BRAKING_AS_DRIVING = "settings.gate.exclude_braking=false"


@cache
def situation(name: str, rich: bool = False) -> Weighed:
    return weighed(merged(RICH if rich else {}, SITUATIONS[name]))


@cache
def clean(*overrides: str, rich: bool = False) -> Weighed:
    return weighed(RICH if rich else {}, *overrides)


def assert_weighed(log: Weighed) -> None:
    assert not log.load["withheld"], log.load["withheld_for"]
    assert abs(log.error_u) <= 3.0, (log.load["mass_kg"], log.load["u_kg"])


class TestTerms:
    @pytest.mark.heavy
    def test_coulomb_friction_one_way_is_in_the_constant(self):
        log = situation("Coulomb friction 300 N")
        assert_weighed(log)
        assert abs(log.off("const", 300.0)) < 3.0
        assert "direction" not in log.terms

    def test_coulomb_friction_both_ways_is_in_the_direction(self):
        log = situation("Coulomb friction 300 N", rich=True)
        assert_weighed(log)
        assert abs(log.off("direction", 300.0)) < 3.0
        assert abs(log.off("const", 0.0)) < 3.0

    @pytest.mark.heavy
    def test_one_start_in_reverse_among_nine_has_friction_of_the_other_sign(self):
        """Without the term, it was forced to the same sign: 4287 ± 687 kg for 3614."""
        forwards = [{"kind": "start", "cruise_s": 6.0}] * 9
        reverse = {"kind": "start", "direction": "reverse"}
        log = weighed(
            {
                "machine": {"coulomb_N": 900.0},
                "campaign": {"runs": 1, "manoeuvres": [{"kind": "rest"}, *forwards, reverse]},
            }
        )
        assert_weighed(log)
        assert abs(log.off("direction", 900.0)) < 3.0
        assert log.load["u_kg"] < 0.02 * log.true_kg

    @pytest.mark.parametrize("rich", [False, True], ids=["one way", "both ways"])
    def test_an_offset_of_the_force_is_in_the_constant(self, rich):
        log = situation("force offset +300 N", rich=rich)
        assert_weighed(log)
        assert abs(log.off("const", 300.0)) < 3.0

    @pytest.mark.heavy
    @pytest.mark.parametrize("delay_s", mark_heavy_after(1, [0.02, 0.05]))
    def test_a_force_that_is_late_is_in_the_lag(self, delay_s):
        log = weighed(merged(RICH, {"sensors": {"force_delay_s": delay_s}}))
        assert_weighed(log)
        assert abs(log.off("lag", delay_s)) < 3.0
        assert log.terms["lag"]["posterior_std"] < 0.002

    @pytest.mark.heavy
    def test_slip_is_in_its_term_and_the_wheels_tell_its_stiffness(self):
        log = situation("slip 80 kN", rich=True)
        assert_weighed(log)
        assert abs(log.off("slip", -FRICTION_N_S_M / 80_000.0)) < 3.0
        wheels = log.weighing.fit.kinematics
        assert wheels is not None
        of_slip, std = wheels.slip_1_N
        assert abs(of_slip - 1.0 / 80_000.0) < 3.0 * std

    @pytest.mark.heavy
    def test_wheels_that_are_larger_are_seen_and_widen_until_the_truth_is_inside(self):
        """Five percent of radius are in the force; the log cannot say which of both is wrong."""
        log = situation("wheels 5 % larger", rich=True)
        assert_weighed(log)
        assert "wheel_imu_gain_error" in log.fired
        assert log.causes["gain"] == pytest.approx(0.05 * log.true_kg, rel=0.2)
        assert log.load["u_kg"] > 5.0 * clean(rich=True).load["u_kg"]
        wheels = log.weighing.fit.kinematics
        assert wheels is not None
        assert wheels.is_gain_significant
        assert abs(wheels.gain[0]) == pytest.approx(0.05, abs=0.01)

    @pytest.mark.heavy
    def test_a_speed_that_is_late_costs_nothing_beside_an_accelerometer(self):
        log = situation("speed late 30 ms", rich=True)
        assert_weighed(log)
        wheels = log.weighing.fit.kinematics
        assert wheels is not None
        delay_s, std = wheels.delay_s
        assert abs(delay_s - 0.03) < 3.0 * std

    @pytest.mark.heavy
    def test_hills_are_withheld_or_in_the_interval(self):
        log = situation("hills", rich=True)
        assert log.load["withheld"] or abs(log.error_u) <= 3.0

    @pytest.mark.heavy
    def test_a_reversal_without_a_standstill_parts_the_directions(self):
        """It is fitted through, but for the moment in which friction turns round."""
        wave = {"waveform": "triangular", "period_s": 8.0, "lowest_N": -6000.0, "highest_N": 6000.0}
        driven = {"kind": "excite", "duration_s": 30.0, "force": wave}
        log = weighed(
            {
                "machine": {"coulomb_N": 300.0},
                "campaign": {
                    "brake_measured_share": 1.0,
                    "runs": 3,
                    "manoeuvres": [{"kind": "rest"}, driven],
                },
            },
            BRAKING_AS_DRIVING,
        )
        assert_weighed(log)
        assert abs(log.off("direction", 300.0)) < 3.0
        assert log.load["manoeuvres"] == 3
        assert log.weighing.fit.motion.stretch_of_sample.max() + 1 > 2 * 3

    @pytest.mark.heavy
    def test_a_clean_log_has_no_term_that_shows(self):
        log = clean(rich=True)
        assert_weighed(log)
        assert all(abs(log.off(term, 0.0)) < 4.0 for term in log.terms)


class TestBraking:
    @pytest.mark.heavy
    def test_brakes_that_the_force_sees_in_part_are_left_out(self):
        log = weighed({"campaign": {"brake_measured_share": 0.4}}, BRAKING_AS_DRIVING)
        assert_weighed(log)
        assert log.load["braking_left_out"]
        assert "braking_bias" in log.fired
        assert log.load["mass_kg"] == pytest.approx(clean().load["mass_kg"])

    @pytest.mark.heavy
    def test_brakes_that_are_seen_whole_are_fitted_and_narrow_the_answer(self):
        log = weighed({"campaign": {"brake_measured_share": 1.0}}, BRAKING_AS_DRIVING)
        assert_weighed(log)
        assert not log.load["braking_left_out"]
        assert "braking_bias" not in log.fired
        assert log.load["u_kg"] < clean().load["u_kg"] / 2

    @pytest.mark.heavy
    def test_brakes_so_gentle_that_they_count_as_cruising_do_not_move_the_mass(self):
        unseen = {"campaign": {"braking_m_s2": 0.1, "brake_measured_share": 0.0}}
        log = weighed(unseen)
        assert_weighed(log)
        assert log.load["u_kg"] < 1.05 * clean().load["u_kg"]
        slow = {"machine": {"friction_N_s_m": 72.0}, "campaign": {"start_s": 1.0, "cruise_s": 3.0}}
        assert_weighed(weighed(merged(slow, unseen)))

    def test_where_braking_is_excluded_nothing_is_said_of_it(self):
        assert clean().check("braking_bias").passed is None
        assert not clean().load["braking_left_out"]


class TestPriors:
    @pytest.mark.heavy
    def test_a_machine_of_which_more_is_known_is_weighed_better(self):
        """One way and full throttle, load transfer and mass are nearly one."""
        known = clean("settings.priors.load_transfer_s2_m=0.001")
        assert_weighed(known)
        assert known.load["u_kg"] < clean().load["u_kg"] / 2
        assert known.causes["load_transfer"] < clean().causes["load_transfer"] / 3
        width = known.terms["load_transfer"]["prior_std"]
        assert width == pytest.approx(0.001)

    def test_the_mass_under_priors_half_and_twice_as_wide_is_told(self):
        rich, poor = clean(rich=True), clean()
        for log in (rich, poor):
            for name in ("mass_halved_priors_kg", "mass_doubled_priors_kg"):
                assert np.isfinite(log.load[name])
        moved = [
            abs(log.load["mass_doubled_priors_kg"] - log.load["mass_kg"]) for log in (rich, poor)
        ]
        assert moved[0] < rich.load["u_kg"]
        assert moved[1] > moved[0]

    def test_every_prior_is_documented_and_must_be_positive(self):
        assert PriorSettings.model_fields
        for name, field in PriorSettings.model_fields.items():
            assert field.description, name
            if name == "learnt":  # a table, whose terms have widths of their own
                assert field.default == {}
                continue
            if name in ("learnt_means", "hysteresis_share"):  # a choice; 0 where not expected
                continue
            assert field.default > 0.0, name
            with pytest.raises(ValueError, match=name):
                PriorSettings.model_validate({name: 0.0})

    def test_starts_both_ways_at_different_throttles_narrow_it_to_a_quarter(self):
        assert clean(rich=True).load["u_kg"] < clean().load["u_kg"] / 4


@pytest.mark.heavy
def test_the_same_log_has_the_same_answer():
    first, again = clean(rich=True), simulate_and_weigh(RICH)
    assert first.replayed.frames["loads"].equals(again.replayed.frames["loads"])
