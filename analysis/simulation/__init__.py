"""The machine model: one machine, its motion, its sensors, and the campaign that they record.

Files follow the signal: `scenario` with its sections (what is asked for), `body` (the equations of
motion), `solve` with `driven` and `arc` (an exact trial: a `motion`), or, where `switches` says so,
`log_drive` with `plant` (an `integrated` log on a straight line), `timeline` (a log in time),
`sensors` with `lag` and `streams` (what the instruments report), `recorder` (when, and what is
kept), `campaign` (loads, trials, truth).
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
