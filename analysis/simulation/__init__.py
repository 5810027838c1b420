"""The machine model: one machine, its motion, its sensors, and the campaign that they record.

Files follow the signal: `scenario` with `manoeuvres` and `waveforms` (what is asked for), `body`
(the equations of motion), `solve` with `driven` and `arc` (a trial solved without noise: a
`motion`), `sensors` (what the instruments report of it), `campaign` (loads, trials, truth).
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
