"""A torque chain that would explain Table 2: sensors on the front wheels, a gain and an offset.

Noise cannot flatten the line to a slope of 0.14: (19) is fitted to means, and simulated noise
leaves the slope at 1. But a load in the bucket is ahead of the front axle and unloads the rear. If
the front wheels carry drive force in proportion to weight, their force therefore grows by more than
the load; (17) has no such share. With a gain and an offset of the signal conditioning (section 4.3
suspects both) Table 2 results. This is plausible but not proven: the paper gives none of the four
numbers.
"""

from dataclasses import dataclass, replace

import polars as pl

from analysis.simulation import SimulatedLog


@dataclass(frozen=True, slots=True)
class TorqueChain:
    """Assumed transfer between the drive force and the recorded torque.

    Attributes:
        empty_fraction_1: share of the empty machine's weight on the front axle.
        load_lever_1: distance of the load from the rear axle, in wheelbases.
        gain_1: gain of the signal conditioning.
        offset_N: offset of the signal conditioning, as the force that (17) computes from both
            torques.
    """

    empty_fraction_1: float = 0.39
    load_lever_1: float = 2.55
    gain_1: float = 2.9
    offset_N: float = -3500.0

    def compute_front_axle_fraction(self, empty_kg: float, load_kg: float) -> float:
        """Fraction of the weight on the front axle with a load in the bucket."""
        front_kg = self.empty_fraction_1 * empty_kg + self.load_lever_1 * load_kg
        return front_kg / (empty_kg + load_kg)


def apply_torque_measuring_chain(simulated_log: SimulatedLog, chain: TorqueChain) -> SimulatedLog:
    """Log with the torques, and their noise, that this chain would record."""
    machine = simulated_log.scenario.machine
    share = chain.compute_front_axle_fraction(machine.mass_kg, simulated_log.load_kg)
    factor = chain.gain_1 * share / machine.force_share
    offset_N_m = chain.offset_N * machine.wheel_radius_m / 2.0
    torque = simulated_log.topics["torque"].with_columns(
        pl.col("torque_left_N_m", "torque_right_N_m") * factor + offset_N_m
    )
    return replace(simulated_log, topics={**simulated_log.topics, "torque": torque})
