"""Logs of a shift on one time line, with the truth about all of them."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.simulation.drive.shift_drive import BoomAngle, ShiftDriver
from analysis.simulation.logs.simulated_campaign import SimulatedLog
from analysis.simulation.motion.solved_motion import Channels
from analysis.simulation.motion.timeline import (
    DrivenManoeuvre,
    PositionBoomAndBucket,
    Timeline,
    convert_to_whole_ns,
)
from analysis.simulation.plant import plant
from analysis.simulation.plant.integrated_motion import IntegratedLog
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.scenario.shift_plan import SimulatedShift
from analysis.simulation.scenario.simulation_limits import LIMITS
from analysis.simulation.sensors.random_streams import make_random_generator
from analysis.simulation.sensors.recorder import compute_topic_phase_s, list_recorded_topics
from analysis.simulation.sensors.sensors import simulate_topics_of_log
from analysis.simulation.trials.trial_limits import refuse_undrivable_shift
from estimators.arrays import Floats


class LogSpan(NamedTuple):
    """Recorded time of a log in s since the shift began, and its torn fraction."""

    start_s: float
    end_s: float
    torn_share: float


class ShiftTruth(NamedTuple):
    """True values of a shift; times are Unix ns.

    `cycles`: a row per cycle, as in `shift_drive.Cycle`, with the numbers of the logs in which it
    begins and ends (from 0; null if not recorded); `stands`: idle stretches, breaks and refuelling;
    `logs`: begin, end and torn part of each log; `dumps`: a row for all material that left the
    bucket, as in `shift_drive.Dump`.
    """

    cycles: pl.DataFrame
    stands: pl.DataFrame
    logs: pl.DataFrame
    dumps: pl.DataFrame


@dataclass(eq=False)
class ShiftSimulation:
    """A shift that is driven while its logs are requested.

    Attributes:
        scenario: scenario with a shift.
        shift: section of the shift.

    Raises:
        ScenarioError: the machine cannot be driven as requested.
    """

    scenario: Scenario
    shift: SimulatedShift

    def __post_init__(self) -> None:
        refuse_undrivable_shift(self.scenario, self.shift)
        self._driver = ShiftDriver(self.scenario, self.shift)
        self._spans: list[LogSpan] = []

    def simulate_logs(self) -> Iterator[SimulatedLog]:
        """Simulate the logs in order; the same scenario gives the same logs bit for bit.

        Call it only once: the driver continues from where the last log ended.
        """
        start_ns = convert_to_whole_ns(self.scenario.log.start_unix_s)
        planned = _plan_spans_of_logs(self.scenario, self.shift)
        heading_rad = 0.0
        for index, span in enumerate(planned):
            is_last = index == len(planned) - 1
            self._driver.reserve_rows(max(span.end_s - self._driver.time_s, 0.0))
            while not self._driver.is_shift_over and (is_last or self._driver.time_s < span.end_s):
                self._driver.drive_cycle()
            end_s = self._driver.time_s if is_last else min(span.end_s, self._driver.time_s)
            self._spans.append(span._replace(end_s=end_s))
            heading_rad += self._driver.kept.drop_rows_before(
                span.start_s - LIMITS.sensor_look_back_s
            )
            yield self._simulate_log(index, self._spans[-1], heading_rad, start_ns)

    def collect_truth(self) -> ShiftTruth:
        """Collect the true values, once all logs have been requested."""
        start_ns = convert_to_whole_ns(self.scenario.log.start_unix_s)
        cycles = pl.DataFrame([each._asdict() for each in self._driver.cycles])
        starts = [span.start_s for span in self._spans]

        def log_index_at(time_s: float) -> int | None:
            found = bisect_right(starts, time_s) - 1
            return found if found >= 0 and time_s <= self._spans[found].end_s else None

        logs = pl.DataFrame(
            {
                "first_log": [log_index_at(each.start_s) for each in self._driver.cycles],
                "last_log": [log_index_at(each.end_s) for each in self._driver.cycles],
            },
            schema={"first_log": pl.Int64, "last_log": pl.Int64},
        )
        dumps = pl.DataFrame(
            [each._asdict() for each in self._driver.dumps], infer_schema_length=None
        )
        stands = pl.DataFrame(
            [each._asdict() for each in self._driver.stands],
            schema={"kind": pl.String, "start_s": pl.Float64, "end_s": pl.Float64},
        )
        spans = pl.DataFrame([each._asdict() for each in self._spans])
        return ShiftTruth(
            convert_to_unix_times(cycles, start_ns).hstack(logs),
            convert_to_unix_times(stands, start_ns),
            convert_to_unix_times(spans, start_ns),
            convert_to_unix_times(dumps, start_ns),
        )

    def _simulate_log(
        self, index: int, span: LogSpan, heading_rad: float, start_ns: int
    ) -> SimulatedLog:
        scenario, driver = self.scenario, self._driver
        starts = np.array([each.start_s for each in driver.cycles] + [driver.time_s])
        mine = tuple(
            each
            for each in driver.driven
            if each.times.end_s > span.start_s and each.times.start_s < span.end_s
        )
        motion = IntegratedLog(
            scenario,
            starts,
            mine,
            driver.kept.filled_rows,
            driver.kept.stage_kinds_of_rows,
            heading_rad,
        )
        timeline = Timeline(
            start_ns + convert_to_whole_ns(span.start_s),
            start_ns + convert_to_whole_ns(span.end_s),
            start_ns + np.rint(starts * 1e9).astype(np.int64),
            subtract_cycle_starts(mine, starts),
            _ShiftTimeline(motion, start_ns).sample,
            _PositionAndBoom(
                motion, tuple(driver.angles), start_ns
            ).sample_position_boom_and_bucket,
        )
        topics = list_recorded_topics(scenario)
        return SimulatedLog(
            scenario=scenario,
            load_kg=0.0,
            topics=simulate_topics_of_log(scenario, timeline, index),
            trials=pl.DataFrame(),
            manoeuvres=timeline.make_manoeuvre_table(),
            timeline=timeline,
            phase_s={topic: compute_topic_phase_s(scenario, topic, index) for topic in topics},
            torn_share=span.torn_share,
        )


class _ShiftTimeline(NamedTuple):
    """Motion by Unix time."""

    motion: IntegratedLog
    start_ns: int

    def sample(self, time_ns: NDArray[np.int64]) -> Channels:
        return self.motion.sample_channels((time_ns - self.start_ns) * np.float64(1e-9))


class _PositionAndBoom(NamedTuple):
    """Position of the machine and angles of its boom, by Unix time."""

    motion: IntegratedLog
    angles: tuple[BoomAngle, ...]
    start_ns: int

    def sample_position_boom_and_bucket(self, time_ns: NDArray[np.int64]) -> PositionBoomAndBucket:
        time_s: Floats = (time_ns - self.start_ns) * np.float64(1e-9)
        known, boom, bucket = np.array(self.angles).T
        rows = self.motion.rows
        position = np.interp(time_s, rows[:, plant.TIME], rows[:, 1 + plant.POSITION])
        return PositionBoomAndBucket(
            position, np.interp(time_s, known, boom), np.interp(time_s, known, bucket)
        )


def subtract_cycle_starts(
    manoeuvres: tuple[DrivenManoeuvre, ...], starts: Floats
) -> tuple[DrivenManoeuvre, ...]:
    """Manoeuvres with their times relative to the start of their cycle."""
    return tuple(
        each._replace(times=each.times.subtract_start_time(float(starts[each.trial])))
        for each in manoeuvres
    )


def _plan_spans_of_logs(scenario: Scenario, shift: SimulatedShift) -> list[LogSpan]:
    """Spans of the logs, with the fraction that is missing at the end of each; 0 if whole."""
    drawn = make_random_generator(scenario.sensors.seed, 0, 0, "shift_recorder")
    length_s = shift.duration_h * 3600.0 / shift.logs
    spans: list[LogSpan] = []
    start_s = 0.0
    for number in range(1, shift.logs + 1):
        end_s = length_s * (
            number + float(drawn.uniform(-LIMITS.log_unevenness, LIMITS.log_unevenness))
        )
        spans.append(LogSpan(start_s, end_s, 0.0))
        start_s = end_s + float(drawn.uniform(0.0, shift.restart_s))
    damage = make_random_generator(scenario.sensors.seed, 0, 0, "shift_damage")
    for number in damage.choice(shift.logs, shift.damaged_logs, replace=False).tolist():
        share = shift.damage_share * float(damage.uniform(LIMITS.min_damage_fraction, 1.0))
        spans[number] = spans[number]._replace(torn_share=share)
    return spans


def convert_to_unix_times(frame: pl.DataFrame, start_ns: int) -> pl.DataFrame:
    """Convert columns of seconds since the shift began to Unix ns."""
    seconds = [name for name in frame.columns if name.endswith("_s")]
    return frame.with_columns(
        (pl.col(name) * 1e9).round().cast(pl.Int64) + start_ns for name in seconds
    ).rename({name: f"{name[:-2]}_ns" for name in seconds})
