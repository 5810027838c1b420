"""The machine model: one machine, its motion, its sensors, and the campaign that they record.

The folders follow the signal: `scenario` says what is simulated; `motion` and `trials` solve a
trial exactly, and `plant` with `drive` integrates a log in time where friction, slope or driveline
need it (`trials.switches` decides); `sensors` adds instruments and recorder; `logs` joins trials
and drives to campaigns and shifts, with their true values.
"""

from analysis.simulation.logs.simulated_campaign import SimulatedLog, simulate_campaign
from analysis.simulation.motion.solved_motion import Channels, SolvedMotion
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.trials.solve_trial import solve_motion

__all__ = [
    "Channels",
    "Scenario",
    "SimulatedLog",
    "SolvedMotion",
    "simulate_campaign",
    "solve_motion",
]
