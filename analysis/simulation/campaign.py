"""A campaign: for each load one log of many runs, with the truth of every run."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.schema import PHASE
from analysis.simulation.motion import Channels, Motion, solve_run
from analysis.simulation.scenario import Scenario
from analysis.simulation.sensors import Streams, measure


@dataclass(frozen=True, eq=False)
class SimulatedLog:
    """What is recorded with one load, and the truth about it.

    Attributes:
        scenario: what was asked for.
        load_kg: the load.
        topics: `imu`, `torque` and `speed`, as `measure` gives them.
        runs: a row a run: `run`, the unix times `start_ns`, `throttle_ns`, `cruise_ns`,
            `braking_ns` and `end_ns`, and the true `load_kg mass_kg friction_N_s_m coulomb_N
            slope_deg`.
        noise_free: the motion at the header stamps: `time_ns` (unix), `phase`, `speed_x_m_s`,
            `acc_x_m_s2`, `force_x_N` (all force but friction and gravity) and
            `measured_force_x_N` (the part that torque sensors on all wheels would see).
    """

    scenario: Scenario
    load_kg: float
    topics: Mapping[str, pl.DataFrame]
    runs: pl.DataFrame
    noise_free: pl.DataFrame

    @property
    def origin_unix_ns(self) -> int:
        """When the campaign began: what the time of its tables counts from."""
        return _ns(self.scenario.log.start_unix_s)


def simulate_campaign(scenario: Scenario) -> Iterator[SimulatedLog]:
    """Simulate the scenario: one log a load, in the order of the loads, on one time line.

    The same scenario gives the same logs bit for bit. Slope and Coulomb friction are in the motion
    and in the measurements as on site; what they do to an uncorrected mass is for the replay to
    find out.
    """
    start_ns = _ns(scenario.log.start_unix_s)
    for index, load_kg in enumerate(scenario.campaign.loads_kg):
        timeline = _Timeline(scenario, solve_run(scenario, load_kg), start_ns)
        stamp_ns = timeline.stamps_ns()
        now = timeline.channels(stamp_ns)
        delayed = timeline.channels(stamp_ns - _ns(scenario.sensors.force_delay_s))
        streams = Streams(scenario.sensors.seed, index, timeline.run(stamp_ns))
        yield SimulatedLog(
            scenario=scenario,
            load_kg=load_kg,
            topics=measure(scenario, streams, stamp_ns, now, delayed),
            runs=_truth(scenario, timeline, load_kg),
            noise_free=pl.DataFrame({"time_ns": stamp_ns, **now._asdict()}).with_columns(
                pl.col("phase").cast(PHASE)
            ),
        )
        start_ns = timeline.end_ns + _ns(scenario.log.load_change_s)


@dataclass(frozen=True)
class _Timeline:
    """The same run again and again, then a rest, from unix time `start_ns` on."""

    scenario: Scenario
    motion: Motion
    start_ns: int

    @property
    def period_ns(self) -> int:
        return math.ceil(self.motion.duration_s * 1e9)

    @property
    def runs(self) -> int:
        return self.scenario.campaign.runs

    @property
    def end_ns(self) -> int:
        rest_ns = _ns(self.scenario.campaign.rest_s)
        return self.start_ns + self.runs * self.period_ns + rest_ns

    def stamps_ns(self) -> NDArray[np.int64]:
        period_ns = 1e9 / self.scenario.sensors.rate_hz
        samples = math.ceil((self.end_ns - self.start_ns) / period_ns)
        return self.start_ns + np.rint(np.arange(samples) * period_ns).astype(np.int64)

    def run(self, time_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """The run at each time; the rest after the last has the next number."""
        return np.clip((time_ns - self.start_ns) // self.period_ns, 0, self.runs)

    def channels(self, time_ns: NDArray[np.int64]) -> Channels:
        run_start_ns = np.minimum(self.run(time_ns), self.runs - 1) * self.period_ns
        return self.motion.sample((time_ns - self.start_ns - run_start_ns) * np.float64(1e-9))


def _truth(scenario: Scenario, timeline: _Timeline, load_kg: float) -> pl.DataFrame:
    start_ns = timeline.start_ns + timeline.period_ns * np.arange(timeline.runs, dtype=np.int64)
    standing, _, cruising, braking = timeline.motion.phases
    return pl.DataFrame(
        {
            "run": np.arange(timeline.runs),
            "start_ns": start_ns,
            "throttle_ns": start_ns + _ns(standing.start_s),
            "cruise_ns": start_ns + _ns(cruising.start_s),
            "braking_ns": start_ns + _ns(braking.start_s),
            "end_ns": start_ns + timeline.period_ns,
        }
    ).with_columns(
        load_kg=pl.lit(load_kg),
        mass_kg=pl.lit(timeline.motion.dynamics.mass_kg),
        friction_N_s_m=pl.lit(scenario.machine.friction_N_s_m),
        coulomb_N=pl.lit(scenario.machine.coulomb_N),
        slope_deg=pl.lit(scenario.terrain.slope_deg),
    )


def _ns(seconds: float) -> int:
    return round(seconds * 1_000_000_000)
