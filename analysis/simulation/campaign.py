"""A campaign: for each load one log of many trials, with the truth of every trial.

A trial is what a scenario calls a run: the manoeuvres of `campaign.manoeuvres`, once.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.schema import PHASE
from analysis.simulation.limits import check_limits
from analysis.simulation.motion import Channels, ManoeuvreTimes, SolvedMotion
from analysis.simulation.scenario import Scenario
from analysis.simulation.sensors import Streams, measure
from analysis.simulation.solve import solve_motion


@dataclass(frozen=True, eq=False)
class SimulatedLog:
    """The recorded topics of one load, and the truth about it.

    Attributes:
        scenario: that was simulated.
        load_kg: the load.
        topics: `imu`, `torque` and `speed`, as `measure` gives them.
        trials: a row a trial: `run` (its number), the unix times `start_ns` and `end_ns`,
            `throttle_ns`, `cruise_ns` and `braking_ns` of its first start (null without one), and
            the true `load_kg mass_kg friction_N_s_m coulomb_N slope_deg inertia_z_kg_m2 com_x_m
            com_y_m friction_z_N_m_s coulomb_z_N_m`: of machine and load, about the origin.
        manoeuvres: a row a manoeuvre: `run`, `manoeuvre` (its number in the trial), `kind`, and the
            unix times `start_ns drive_ns steady_ns braking_ns end_ns` (null for what it has not).
        noise_free: the motion at the header stamps: `time_ns` (unix) and the fields of `Channels`.
    """

    scenario: Scenario
    load_kg: float
    topics: Mapping[str, pl.DataFrame]
    trials: pl.DataFrame
    manoeuvres: pl.DataFrame
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

    Raises:
        ScenarioError: the machine cannot be driven as asked with one of the loads; raised before
            the first log.
    """
    check_limits(scenario, scenario.campaign.loads_kg)
    return _logs(scenario)


def _logs(scenario: Scenario) -> Iterator[SimulatedLog]:
    start_ns = _ns(scenario.log.start_unix_s)
    for index, load_kg in enumerate(scenario.campaign.loads_kg):
        timeline = _Timeline(scenario, solve_motion(scenario, load_kg), start_ns)
        stamp_ns = timeline.stamps_ns()
        now = timeline.channels(stamp_ns)
        streams = Streams(scenario.sensors.seed, index, timeline.trial(stamp_ns))
        yield SimulatedLog(
            scenario=scenario,
            load_kg=load_kg,
            topics=measure(scenario, streams, stamp_ns, timeline.channels),
            trials=_trials(timeline, load_kg),
            manoeuvres=_manoeuvres(timeline),
            noise_free=pl.DataFrame({"time_ns": stamp_ns, **now._asdict()}).with_columns(
                pl.col("phase").cast(PHASE)
            ),
        )
        start_ns = timeline.end_ns + _ns(scenario.log.load_change_s)


@dataclass(frozen=True)
class _Timeline:
    """The same trial again and again, then a rest, from unix time `start_ns` on."""

    scenario: Scenario
    motion: SolvedMotion
    start_ns: int

    @property
    def period_ns(self) -> int:
        return math.ceil(self.motion.duration_s * 1e9)

    @property
    def trials(self) -> int:
        return self.scenario.campaign.runs

    @property
    def end_ns(self) -> int:
        rest_ns = _ns(self.scenario.campaign.rest_s)
        return self.start_ns + self.trials * self.period_ns + rest_ns

    def stamps_ns(self) -> NDArray[np.int64]:
        period_ns = 1e9 / self.scenario.sensors.rate_hz
        samples = math.ceil((self.end_ns - self.start_ns) / period_ns)
        return self.start_ns + np.rint(np.arange(samples) * period_ns).astype(np.int64)

    def trial(self, time_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """The trial at each time; the rest after the last has the next number."""
        return np.clip((time_ns - self.start_ns) // self.period_ns, 0, self.trials)

    def channels(self, time_ns: NDArray[np.int64]) -> Channels:
        trial_start_ns = np.minimum(self.trial(time_ns), self.trials - 1) * self.period_ns
        return self.motion.sample((time_ns - self.start_ns - trial_start_ns) * np.float64(1e-9))


def _trials(timeline: _Timeline, load_kg: float) -> pl.DataFrame:
    """Where each trial is, and the truth about the machine in it."""
    body = timeline.motion.body
    start_ns = timeline.start_ns + timeline.period_ns * np.arange(timeline.trials, dtype=np.int64)
    starts = (window for window in timeline.motion.manoeuvres if window.kind == "start")
    start = next(starts, ManoeuvreTimes("start", 0.0, None, None, None, 0.0))
    return pl.DataFrame(
        {
            "run": np.arange(timeline.trials),
            "start_ns": start_ns,
            "throttle_ns": _after(start_ns, start.drive_s),
            "cruise_ns": _after(start_ns, start.steady_s),
            "braking_ns": _after(start_ns, start.braking_s),
            "end_ns": start_ns + timeline.period_ns,
        }
    ).with_columns(
        load_kg=pl.lit(load_kg),
        mass_kg=pl.lit(body.mass_kg),
        friction_N_s_m=pl.lit(body.friction_x_N_s_m),
        coulomb_N=pl.lit(body.coulomb_x_N),
        slope_deg=pl.lit(timeline.scenario.terrain.slope_deg),
        inertia_z_kg_m2=pl.lit(body.inertia_z_kg_m2),
        com_x_m=pl.lit(body.com_x_m),
        com_y_m=pl.lit(body.com_y_m),
        friction_z_N_m_s=pl.lit(body.friction_z_N_m_s),
        coulomb_z_N_m=pl.lit(body.coulomb_z_N_m),
    )


def _manoeuvres(timeline: _Timeline) -> pl.DataFrame:
    """Where each manoeuvre of each trial is."""
    windows = timeline.motion.manoeuvres
    rows = [
        {
            "run": trial,
            "manoeuvre": number,
            "kind": window.kind,
            "start_ns": start_ns + _ns(window.start_s),
            "drive_ns": None if window.drive_s is None else start_ns + _ns(window.drive_s),
            "steady_ns": None if window.steady_s is None else start_ns + _ns(window.steady_s),
            "braking_ns": None if window.braking_s is None else start_ns + _ns(window.braking_s),
            "end_ns": start_ns + _ns(window.end_s),
        }
        for trial in range(timeline.trials)
        for start_ns in (timeline.start_ns + trial * timeline.period_ns,)
        for number, window in enumerate(windows)
    ]
    times = ("start_ns", "drive_ns", "steady_ns", "braking_ns", "end_ns")
    return pl.DataFrame(rows, infer_schema_length=None).cast(dict.fromkeys(times, pl.Int64))


def _after(start_ns: NDArray[np.int64], seconds: float | None) -> pl.Series:
    if seconds is None:
        return pl.Series([None] * start_ns.size, dtype=pl.Int64)
    return pl.Series(start_ns + _ns(seconds))


def _ns(seconds: float) -> int:
    return round(seconds * 1_000_000_000)
