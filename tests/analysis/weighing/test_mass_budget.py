"""What the uncertainty is made of, and what only the machine file can tell."""

import tomllib

import numpy as np
import pytest

from analysis.model.machine import Channel, Machine
from analysis.model.uncertainty_sources import SCALES, combine_u, list_scale_sources_without_u
from analysis.model.verdict import Verdict
from analysis.weighing.load_frames import make_load_frame, make_manoeuvre_frame
from analysis.weighing.mass_budget import make_mass_budget
from analysis.weighing.nuisance_frames import make_budget_frame, make_nuisance_frame
from tests.analysis.opinions import CANNOT_WEIGH, WEIGHS
from tests.analysis.weighing.weighed import RICH, Weighed, weighed

#: The mass of the one load.
ONE = np.ones(1)


@pytest.fixture(scope="module")
def log() -> Weighed:
    return weighed(RICH)


def with_body(log, **known):
    """The machine, of which more is known."""
    about = log.machine.machine.model_copy(update=known)
    return log.machine.model_copy(update={"machine": about})


def u_of(log, **known):
    """What each source contributes, in kg."""
    sources = make_mass_budget(log.weighing, with_body(log, **known), ONE)
    return {each.name: each.u for each in sources}


def the_load(log, verdict=WEIGHS, **known):
    machine = with_body(log, **known)
    excitation = log.replayed.frames["excitation"]
    manoeuvres = make_manoeuvre_frame(log.weighing, excitation, machine)
    frame = make_load_frame(log.weighing, excitation, manoeuvres, machine, verdict)
    return frame.row(0, named=True)


@pytest.mark.heavy
def test_of_a_gain_that_drifts_it_is_not_known_at_which_end_it_is_as_stated():
    drifting = weighed({**RICH, "defects": {"force_gain_drift": 0.05}})
    drift_kg = abs(drifting.terms["gain_drift"]["posterior"]) * drifting.load["mass_kg"]
    assert drift_kg > 0.03 * drifting.true_kg
    assert drifting.causes["drifted_gain"] == pytest.approx(drift_kg / 2.0, rel=0.01)
    # it is as stated at the beginning: half of the drift is in the mass
    assert abs(drifting.error_u) < 2.0


def test_a_gain_that_does_not_drift_costs_nothing(log):
    assert u_of(log).get("drifted_gain", 0.0) == 0.0


class TestScale:
    def test_one_percent_of_force_gain_adds_one_percent_of_the_mass_in_quadrature(self, log):
        plain, known = the_load(log), the_load(log, force_gain_u=0.01)
        assert u_of(log, force_gain_u=0.01)["force_gain"] == pytest.approx(36.0, abs=0.5)
        assert known["u_kg"] == pytest.approx(
            np.hypot(plain["u_kg"], 0.01 * log.weighing.fit.mass_kg)
        )
        assert known["mass_kg"] == plain["mass_kg"]

    def test_a_wheel_radius_is_known_to_its_share(self, log):
        found = u_of(log, wheel_radius_m=0.42, wheel_radius_u_m=0.0042)
        assert found["wheel_radius"] == pytest.approx(0.01 * log.weighing.fit.mass_kg)

    def test_tyres_that_a_load_presses_count_twice_where_wheels_tell_the_motion(self, log):
        body = {"empty_mass_kg": 3000.0, "wheel_radius_by_load_u": 0.02}
        payload_kg = log.weighing.fit.mass_kg - 3000.0
        expected = 0.02 * log.weighing.fit.mass_kg * payload_kg / 3000.0
        assert u_of(log, **body)["wheel_radius_by_load"] == pytest.approx(expected)
        forces = log.machine.settings.forces.model_copy(update={"acceleration": "kinematic"})
        settings = log.machine.settings.model_copy(update={"forces": forces})
        by_wheels = Channel(derive="d/dt speed_x_m_s")
        channels = {**log.machine.channels, "acc_x_m_s2": by_wheels}
        wheels = with_body(log, **body).model_copy(
            update={"settings": settings, "channels": channels}
        )
        found = {each.name: each.u for each in make_mass_budget(log.weighing, wheels, ONE)}
        assert found["wheel_radius_by_load"] == pytest.approx(2.0 * expected)

    def test_a_radius_counts_in_the_force_and_in_the_speed(self) -> None:
        """It was passed over where arithmetic made the force, and counted once where both do."""
        body = 'name = "m"\nwheel_radius_m = 0.5\nwheel_radius_u_m = 0.005\n'
        torque = '[channels.force_x_N]\nderive = "torque_N_m / wheel_radius_m"\n'
        torque += '[channels.torque_N_m]\nfield = "T"\n'
        of_wheel = '[channels.speed_x_m_s]\nfield = "omega"\nscale = "wheel_radius_m"\n'
        force = '[channels.force_x_N]\nfield = "F"\n'
        speed = '[channels.speed_x_m_s]\nfield = "v"\n'
        for channels, factor in (
            (torque + of_wheel, 2.0),
            (torque + speed, 1.0),
            (force + of_wheel, 1.0),
            (force + speed, None),
        ):
            machine = Machine.model_validate(
                tomllib.loads(
                    f"[machine]\n{body}{channels}"
                    '[channels.acc_x_m_s2]\nderive = "d/dt speed_x_m_s"\n'
                    '[settings.forces]\nacceleration = "kinematic"\n'
                )
            )
            (radius,) = (scale for scale in SCALES if scale.name == "wheel_radius")
            assert radius.applies(machine) is (factor is not None), channels
            if factor is not None:
                assert radius.u(machine) == pytest.approx(0.01 * factor), channels

    def test_tyres_that_a_load_presses_count_in_a_force_in_newtons_once_they_are_stated(self, log):
        channels = {"force_x_N": log.machine.channels["torque_left_N_m"], **log.machine.channels}
        by_force = log.machine.model_copy(update={"channels": channels})
        (tyres,) = (scale for scale in SCALES if scale.name == "wheel_radius_by_load")
        assert not tyres.applies(by_force)
        body = by_force.machine.model_copy(update={"wheel_radius_by_load_u": 0.02})
        assert tyres.applies(by_force.model_copy(update={"machine": body}))

    def test_a_share_of_the_force_is_known_to_its_share(self, log):
        found = u_of(log, force_share=0.5, force_share_u=0.01)
        assert found["force_share"] == pytest.approx(0.02 * log.weighing.fit.mass_kg)

    def test_what_the_machine_file_does_not_say_is_named(self, log):
        assert the_load(log)["scale_unknown"] == (
            "force_gain, force_share, force_share_by_load, wheel_radius, wheel_radius_by_load"
        )
        told = {"force_gain_u": 0.01, "force_share_u": 0.005, "force_share_by_load_u": 0.3}
        told |= {"wheel_radius_u_m": 0.001, "wheel_radius_by_load_u": 0.01}
        assert the_load(log, **told)["scale_unknown"] == ""
        some = make_mass_budget(log.weighing, with_body(log, force_gain_u=0.0), ONE)
        assert "force_gain" not in list_scale_sources_without_u(some)

    def test_a_whole_force_has_no_share_and_no_wheels_that_must_be_known(self, log):
        channels = {"force_x_N": log.machine.channels["torque_left_N_m"], **log.machine.channels}
        machine = with_body(log, force_share=1.0).model_copy(update={"channels": channels})
        assert list_scale_sources_without_u(make_mass_budget(log.weighing, machine, ONE)) == [
            "force_gain"
        ]


class TestBody:
    def test_the_payload_has_the_empty_mass_uncertainty_as_well(self, log):
        plain, weighed_before = the_load(log), the_load(log, empty_mass_u_kg=50.0)
        assert plain["payload_u_kg"] == plain["u_kg"]
        assert weighed_before["payload_u_kg"] == pytest.approx(np.hypot(plain["u_kg"], 50.0))
        assert weighed_before["u_kg"] == plain["u_kg"]
        assert plain["payload_kg"] == pytest.approx(plain["mass_kg"] - 3614.0)

    def test_without_an_empty_mass_there_is_no_payload(self, log):
        load = the_load(log, empty_mass_kg=None)
        assert load["payload_kg"] is None
        assert load["payload_u_kg"] is None
        assert load["mass_kg"] is not None

    def test_manoeuvres_are_without_what_only_turns_as_their_load_is(self, log):
        machine = with_body(log, rotating_mass_kg=150.0)
        excitation = log.replayed.frames["excitation"]
        plain = make_manoeuvre_frame(log.weighing, excitation, log.machine)["mass_kg"]
        geared = make_manoeuvre_frame(log.weighing, excitation, machine)["mass_kg"]
        assert (plain - geared).to_list() == pytest.approx([150.0] * plain.len())

    def test_what_only_turns_is_taken_off_and_its_uncertainty_added(self, log):
        plain = the_load(log)
        geared = the_load(log, rotating_mass_kg=150.0, rotating_mass_u_kg=40.0)
        for name in ("mass_kg", "mass_halved_priors_kg", "mass_doubled_priors_kg", "payload_kg"):
            assert geared[name] == pytest.approx(plain[name] - 150.0), name
        assert geared["u_kg"] == pytest.approx(np.hypot(plain["u_kg"], 40.0))


class TestFrames:
    def test_the_budget_adds_up_to_the_uncertainty_of_the_load_largest_first(self, log):
        frame = make_budget_frame(log.weighing, log.machine)
        known = frame.filter(frame["u_kg"].is_not_null())
        total = np.sqrt((known["u_kg"] ** 2).sum())
        assert total == pytest.approx(log.load["u_kg"])
        assert known["share_1"].sum() == pytest.approx(1.0)
        assert known["u_kg"].is_sorted(descending=True)
        assert frame["u_kg"].null_count() == 5
        assert frame["u_kg"][-4:].null_count() == 4
        assert all(frame["meaning"])
        assert all(frame["shrinks"])

    def test_random_and_common_parts_are_the_whole(self, log):
        load = log.load
        assert np.hypot(load["u_random_kg"], load["u_common_kg"]) == pytest.approx(load["u_kg"])
        sources = make_mass_budget(log.weighing, log.machine, ONE)
        assert combine_u(sources) == pytest.approx(load["u_kg"])
        assert {each.kind for each in sources} == {"random", "common", "scale"}

    def test_every_term_is_a_row_with_prior_and_posterior(self, log):
        frame = make_nuisance_frame(log.weighing)
        assert frame["term"].to_list()[:-3] == [term.name for term in log.weighing.fit.terms]
        assert frame["term"].to_list()[-3:] == ["wheel_slip", "gain", "speed_delay"]
        assert (frame["prior_std"] > 0.0).all()
        assert (frame["posterior_std"] > 0.0).all()
        assert frame.null_count().sum_horizontal().item() == 0

    def test_what_the_verdict_forbids_has_no_number_and_names_the_checks(self, log):
        load = the_load(log, verdict=CANNOT_WEIGH)
        assert load["withheld"]
        assert load["withheld_for"] == "r_squared"
        numbers = [name for name in load if name.endswith("_kg") or "_N_s_m" in name]
        assert numbers
        assert all(load[name] is None for name in numbers)

    def test_a_log_that_cannot_be_fitted_has_one_load_without_numbers(self, log):
        excitation = log.replayed.frames["excitation"]
        manoeuvres = make_manoeuvre_frame(None, excitation, log.machine)
        frame = make_load_frame(None, excitation, manoeuvres, log.machine, Verdict())
        assert frame.columns == log.replayed.frames["loads"].columns
        assert frame.height == 1
        assert frame["mass_kg"].null_count() == 1
        assert "informative" in frame["withheld_for"][0]
        assert make_nuisance_frame(None).is_empty()
        assert make_budget_frame(None, log.machine).is_empty()
        assert (
            make_budget_frame(None, log.machine).columns
            == make_budget_frame(log.weighing, log.machine).columns
        )
