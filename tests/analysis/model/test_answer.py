"""The answer in plain values, and in a sentence why there is none."""

import json

import numpy as np
import pytest

from analysis.diagnosis import CHECKS, CheckInputs, judge_log_by_checks
from analysis.model.answer import make_answer
from analysis.model.run_record import Loss, Provenance, Run
from analysis.stages.estimation.method_estimates import (
    explain_why_gate_accepted_nothing,
    summarise_masses,
    trace_estimates,
    withhold_masses,
)
from analysis.stages.gating.gate import gate_windows, mark_samples_in_accepted_windows
from tests.analysis.opinions import CANNOT_WEIGH, WEIGHS

TRIP = ("standstill", "start", "brake", "standstill")


@pytest.fixture(scope="module")
def replayed(drive, excitation_of, machine):
    def replay(opinion):
        made = machine()
        excitation = excitation_of(drive(), made)
        gated = gate_windows(excitation, made.settings)
        estimates = trace_estimates(excitation, gated, made.settings)
        return Run(
            {
                "gate": gated,
                "masses": withhold_masses(
                    summarise_masses(excitation, gated, estimates, made), opinion, ()
                ),
                "verdict": judge_log_by_checks(CheckInputs(excitation, gated, made)),
            },
            Provenance(
                settings=made.settings,
                losses=(Loss(source="stamps", topic="/imu", what="lost"),),
                notes=("a note",),
            ),
        )

    return replay


def test_the_answer_is_plain_json_by_method(replayed):
    given = make_answer(replayed(WEIGHS)).to_dict()
    assert json.loads(json.dumps(given, allow_nan=False)) == given
    methods = {"ls", "rls", "fgls", "tls", "pooled"}
    for name in ("mass_kg", "mass_std_kg", "payload_kg", "friction_x_N_s_m"):
        assert set(given[name]) == methods
    assert given["mass_kg"]["pooled"] == pytest.approx(3614.0, rel=0.03)
    assert given["verdict"]["can_weigh"]
    of_mass = [check.name for check in CHECKS if check.about == "mass"]
    assert [check["check"] for check in given["verdict"]["checks"]] == of_mass
    assert {"partial_correlation", "relative_std", "r_squared"} <= set(of_mass)
    assert given["losses"] == [{"source": "stamps", "topic": "/imu", "what": "lost"}]
    assert given["notes"] == ["a note"]


def test_the_accepted_share_counts_samples_not_windows(replayed):
    run = replayed(WEIGHS)
    inside = mark_samples_in_accepted_windows(run.frames["gate"]["accepted_x"].to_numpy(), 320)
    assert make_answer(run).accepted_share == pytest.approx(inside.mean())
    assert make_answer(run).accepted_share > run.frames["gate"]["accepted_x"].mean()


def test_a_withheld_mass_is_null_in_the_answer(replayed):
    given = make_answer(replayed(CANNOT_WEIGH)).to_dict()
    assert set(given["mass_kg"].values()) == {None}
    assert json.dumps(given, allow_nan=False)


@pytest.mark.parametrize(
    ("manoeuvres", "seconds", "changes", "why"),
    [
        (TRIP, (1.5, 5.0, 2.0, 1.5), {}, None),
        (("start",), (2.0,), {}, "the log lasts 2.00 s, a window needs 3.20 s"),
        (
            ("start",),
            (3.25,),
            {},
            "the log lasts 3.25 s, a window needs 3.20 s and the moving mean before it 0.09 s",
        ),
        (("start", "brake") * 2, (2.0, 1.0) * 2, {}, "the longest stretch without braking is 2."),
        (("standstill",), (9.0,), {}, "no window was accepted, most often for: standstill"),
        (("standstill",), (4.0,), {}, "no window was accepted, most often for: standstill"),
        (
            TRIP,
            (1.5, 5.0, 2.0, 1.5),
            {"force_x_N": lambda f: np.where(np.arange(f.size) % 200 < 10, np.nan, f)},
            "the longest stretch without a gap is 1.",
        ),
    ],
    ids=[
        "accepted",
        "short",
        "short of a mean",
        "braking",
        "standstill",
        "mostly warming up",
        "gaps",
    ],
)
def test_the_obstacle_is_named(drive, excitation_of, machine, manoeuvres, seconds, changes, why):
    settings = machine().settings
    excitation = excitation_of(drive(manoeuvres, seconds).but(**changes))
    said = explain_why_gate_accepted_nothing(
        excitation, gate_windows(excitation, settings), settings
    )
    if why is None:
        assert said is None
    else:
        assert said.startswith(why)
