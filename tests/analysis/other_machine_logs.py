"""Logs of the simulator's other machines as one table each: force and speed at the same stamps."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import polars as pl

from analysis.model.run_record import Run
from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from replay import open_log, run
from replay.logs import TimeAxis
from tests.analysis.kinematic_machine import kinematic_machine


def table_of(log: SimulatedLog) -> pl.DataFrame:
    """Its time from 0 on, the force at the wheels, and their speed."""
    torque, speed = log.topics["torque"], log.topics["speed"]
    return pl.DataFrame(
        {
            "t": (torque["header_stamp_ns"] - int(log.trials["start_ns"][0])) * 1e-9,
            "force": (torque["torque_left_N_m"] + torque["torque_right_N_m"])
            / log.scenario.machine.wheel_radius_m,
            "speed": speed.select(pl.mean_horizontal("speed_left_m_s", "speed_right_m_s"))
            .to_series()
            .head(torque.height),
        }
    )


def replayed(scenario: Scenario, folder: Path, order: Sequence[int] = (0,)) -> Run:
    """Replay the scenario's logs, a file each, in an order."""
    tables = [table_of(log) for log in simulate_campaign(scenario)]
    with ExitStack() as stack:
        logs = []
        for place in order:
            path = folder / f"{place}.parquet"
            tables[place].write_parquet(path)
            logs.append(stack.enter_context(open_log(path, time=TimeAxis("t"))))
        cutoff_hz = min(20.0, 0.4 * scenario.sensors.rate_hz)
        machine = kinematic_machine("simulated", scenario.machine.mass_kg, cutoff_hz)
        return run(logs, machine)
