"""The machine model: one machine, its motion, its sensors, and the campaign that they record.

Files follow the signal: `scenario` with its sections (what is asked for), `body` (the equations of
motion), `solve` with `driven` and `arc` (an exact trial: a `motion`) or `integrated` with `plant` (a
whole log on a straight line, where `switches` says so), `timeline` (a log in time), `sensors` with
`lag` and `streams` (what the instruments report), `recorder` (when, and what is kept), `campaign`
(loads, trials, truth).
"""

from analysis.simulation.campaign import SimulatedLog, simulate_campaign
from analysis.simulation.motion import Channels, SolvedMotion
from analysis.simulation.scenario import Scenario
from analysis.simulation.solve import solve_motion

__all__ = [
    "Channels",
    "Scenario",
    "SimulatedLog",
    "SolvedMotion",
    "simulate_campaign",
    "solve_motion",
]
