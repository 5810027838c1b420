"""Topics of other rates and phases: nine simulated starts weigh the same whatever those are."""

from functools import cache

import pytest

from analysis.stages.signals.align import list_alignment_notes
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.timestamps import assign_timestamps
from tests.analysis import phased
from tests.analysis.conftest import make_machine
from tests.twins import mark_heavy_after


def loader(**settings):
    return make_machine({"methods": ["pooled", "ls"], **settings}, **phased.CHANNELS)


@cache
def in_phase_kg(method):
    return phased.pooled(phased.raw(), loader(), method)[0]


def said(log, machine):
    return list_alignment_notes(
        derive_channels_in_si(
            read_measured_channels(assign_timestamps(log)[0], machine)[0], machine
        )[0],
        machine,
    )


@pytest.mark.parametrize("method", ["pooled", "ls"])
@pytest.mark.parametrize("topic", mark_heavy_after(1, ["force", "speed", "imu"]))
@pytest.mark.parametrize("phase_s", [0.003, 0.009])
def test_a_phase_between_topics_costs_no_mass(topic, phase_s, method):
    """9 ms of it took 29 kg off `pooled` and 48 kg off `ls` while values were held."""
    log = phased.raw(**{topic: {"phase_s": phase_s}})
    mass, _ = phased.pooled(log, loader(), method)
    assert abs(mass - in_phase_kg(method)) < 3.0
    assert said(log, loader()) == []


def test_jitter_of_every_stamp_costs_no_mass():
    log = phased.raw(**{topic: {"jitter_s": 0.002} for topic in phased.FIELDS})
    assert abs(phased.pooled(log, loader())[0] - in_phase_kg("pooled")) < 3.0


@pytest.mark.parametrize("delay_s", [0.004, 0.0137])
def test_a_delay_that_the_machine_file_gives_costs_no_mass(delay_s):
    late = {**phased.CHANNELS["force_x_N"], "delay_s": delay_s}
    told = make_machine({"methods": ["pooled"]}, **{**phased.CHANNELS, "force_x_N": late})
    mass, _ = phased.pooled(phased.raw(force={"delay_s": delay_s}), told)
    assert abs(mass - in_phase_kg("pooled")) < 3.0


@pytest.mark.parametrize("rate_hz", [90.0, 120.0, 1000.0])
@pytest.mark.parametrize("topic", ["force", "speed", "imu"])
def test_a_topic_at_nearly_the_grids_rate_or_faster_is_used_as_it_comes(topic, rate_hz):
    log = phased.raw(**{topic: {"rate_hz": rate_hz, "phase_s": 0.003}})
    mass, std = phased.pooled(log, loader())
    assert abs(mass - phased.TRUE_KG) < 5.0
    assert std < 3.0
    assert said(log, loader()) == []


@pytest.mark.parametrize("topic", ["force", "speed", "imu"])
def test_a_slow_channel_of_the_regressor_does_not_bias_the_mass_and_is_reported(topic):
    """Force at 10 Hz took 184 kg off, speed at 10 Hz put 130 kg on."""
    log = phased.raw(noise=0.01, **{topic: {"rate_hz": 10.0, "phase_s": 0.003}})
    mass, _ = phased.pooled(log, loader())
    assert abs(mass - phased.TRUE_KG) < 5.0
    (note,) = said(log, loader())
    assert "comes at 10 Hz only" in note
    assert "averaged over 0.1 s" in note
    assert note.startswith({"force": "force_x_N", "imu": "specific_force_x"}.get(topic, "speed_x"))


def test_a_slow_speed_costs_little_precision_since_faster_channels_are_averaged():
    """One sample of ten of force and accelerometer gave ± 5 kg."""
    mass, std = phased.pooled(phased.raw(speed={"rate_hz": 10.0, "phase_s": 0.003}), loader())
    assert std < 3.5
    assert abs(mass - phased.TRUE_KG) < 3 * std


DERIVED = {
    "force_x_N": phased.CHANNELS["force_x_N"],
    "speed_x_m_s": phased.CHANNELS["speed_x_m_s"],
    "specific_force_x_m_s2": None,
    "acc_x_m_s2": {"derive": "d/dt speed_x_m_s"},
}


@pytest.mark.parametrize("slow", [("speed",), ("speed", "force")])
@pytest.mark.parametrize("rate_hz", [10.0, 20.0])
def test_an_acceleration_derived_of_a_slow_speed_does_not_bias_the_mass(rate_hz, slow):
    """A difference over 200 ms put 37 kg on, beside a force that was not averaged so."""
    derived = make_machine({"methods": ["pooled"], "acceleration": "kinematic"}, **DERIVED)
    topics = {topic: {"rate_hz": rate_hz, "phase_s": 0.003} for topic in slow}
    log = phased.raw(noise=0.01, **topics)
    assert abs(phased.pooled(log, derived)[0] - phased.TRUE_KG) < 5.0
    (note,) = said(log, derived)
    assert f"averaged over {2 / rate_hz:g} s" in note
    causal = make_machine(
        {"methods": ["pooled"], "acceleration": "kinematic", "causal": True}, **DERIVED
    )
    assert abs(phased.pooled(log, causal)[0] - phased.TRUE_KG) < 5.0


def test_when_causal_phases_and_jitter_cost_no_more():
    causal = loader(causal=True)
    topics = {name: {"jitter_s": 0.002} for name in phased.FIELDS}
    topics["force"]["phase_s"] = 0.009
    assert abs(phased.pooled(phased.raw(**topics), causal)[0] - in_phase_kg("pooled")) < 3.0
