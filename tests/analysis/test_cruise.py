"""Fault: one start, then 90 s at constant speed. What the gate is for, and what it cannot undo."""

import numpy as np
import pytest

from analysis.model.axes import make_straight_regressor_and_force
from analysis.stages.gating.gate import gate_windows
from estimators.methods import rls

TRUE_KG = 3614.0
SEEDS = range(10)


@pytest.fixture(scope="module")
def errors(drive, excitation_of, machine):
    """Errors in kg of the last RLS state of the cruise: (seeds,) by gated and directional."""
    settings = machine().settings
    window = settings.gate.window_samples
    found = {}
    for seed in SEEDS:
        excitation = excitation_of(
            drive(("standstill", "start", "cruise"), (5.0, 3.0, 90.0), seed=seed)
        )
        A, f = make_straight_regressor_and_force(excitation, settings)
        first = int(np.argmax(np.isfinite(A).all(axis=1)))
        every = np.arange(f.size) >= first + window - 1
        accepted = gate_windows(excitation, settings)["accepted_x"].to_numpy()
        for gated in (True, False):
            for directional in (True, False):
                options = rls.RlsOptions(settings.trace.forgetting, directional)
                traced = rls.estimate_along_log(A, f, window, accepted if gated else every, options)
                error = traced.theta[-1, 0] - TRUE_KG
                found.setdefault((gated, directional), []).append(error)
    return found


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


@pytest.mark.heavy
def test_ungated_rls_loses_the_mass_in_90_s_of_cruise_and_gated_rls_keeps_it(errors):
    assert rms(errors[True, False]) < 0.02 * TRUE_KG
    assert rms(errors[False, False]) >= 20.0 * rms(errors[True, False])


def test_directional_forgetting_keeps_the_mass_even_ungated(errors):
    assert rms(errors[False, True]) < 0.02 * TRUE_KG
    assert rms(errors[True, True]) < 0.02 * TRUE_KG
