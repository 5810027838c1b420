"""The machine model: one machine, its motion, its sensors, and the campaign that they record.

Files follow the signal: `scenario` (what is asked for), `motion` (the equation of motion, solved
without noise), `sensors` (what the instruments report of it), `campaign` (loads, runs, truth).
"""

from analysis.simulation.campaign import SimulatedLog, simulate_campaign
from analysis.simulation.scenario import Scenario

__all__ = ["Scenario", "SimulatedLog", "simulate_campaign"]
