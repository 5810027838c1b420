"""The paper's excitation: a triangular force or torque, over and over, from standing."""

from typing import Final

import numpy as np

from analysis.reproduction.drive import PHASES, SteadyDrive
from analysis.simulation import Scenario, solve_motion
from analysis.simulation.manoeuvres import Excite
from analysis.simulation.waveforms import ForceWave, TorqueWave

#: After so many periods what the start was like is forgotten: 48 time constants m/b.
_SETTLED_PERIODS: Final = 4
#: Periods that Figures 2 to 4 show, and one more.
_PERIODS: Final = 5


def excited(scenario: Scenario, *, force: ForceWave | None, torque: TorqueWave | None) -> Scenario:
    """The scenario with one run without load, under these waveforms for five periods."""
    period_s = (force or torque or ForceWave()).period_s
    drive = Excite(duration_s=_PERIODS * period_s, force=force, torque=torque)
    campaign = scenario.campaign.model_copy(
        update={"loads_kg": (0.0,), "runs": 1, "manoeuvres": (drive,)}
    )
    return scenario.model_copy(update={"campaign": campaign})


def steady_drive(scenario: Scenario, force: ForceWave | None = None) -> SteadyDrive:
    """One period of the steady oscillation under a force, by default the paper's triangle.

    Args:
        scenario: machine and sensors' rate.
        force: the waveform.
    """
    force = force or ForceWave()
    motion = solve_motion(excited(scenario, force=force, torque=None), 0.0)
    steps = round(force.period_s * scenario.sensors.rate_hz * PHASES)
    time_s = force.period_s * (_SETTLED_PERIODS + np.arange(steps) / steps)
    true = motion.sample(time_s)
    return SteadyDrive(
        motion.body.mass_kg,
        motion.body.friction_x_N_s_m,
        np.column_stack([true.acc_x_m_s2, true.speed_x_m_s, true.force_x_N]),
    )
