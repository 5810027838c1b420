"""Time line of a log: trials and manoeuvres with true values, and the motion at any time."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.simulation.motion.body import RigidBody
from analysis.simulation.motion.solved_motion import Channels, ManoeuvreTimes, SolvedMotion
from analysis.simulation.scenario.scenario import Scenario
from estimators.arrays import Floats


class DrivenManoeuvre(NamedTuple):
    """A manoeuvre as driven; times in s since its trial began.

    `body` is machine and load at its start, and `load_end_kg` the load at its end; `direction` and
    `throttle` are None except for a start.
    """

    trial: int
    number: int
    times: ManoeuvreTimes
    body: RigidBody
    load_kg: float
    load_end_kg: float
    direction: str | None
    throttle: float | None


class PositionBoomAndBucket(NamedTuple):
    """Signals of a shift besides the motion, (n,) each.

    Position along the way, and angles of boom and bucket, positive up.
    """

    position_m: Floats
    boom_rad: Floats
    bucket_rad: Floats


@dataclass(frozen=True)
class Timeline:
    """The true motion of one simulated log over Unix time.

    Attributes:
        start_ns: start of the log.
        end_ns: end of the log, including its last rest.
        trial_ns: (trials + 1,) start of each trial, and end of the last.
        driven: manoeuvres in order.
        sample: computes the motion at times (n,) in Unix ns.
        sample_position_boom_and_bucket: computes position along the way and angles of boom and
            bucket at times (n,); None in a campaign.
    """

    start_ns: int
    end_ns: int
    trial_ns: NDArray[np.int64]
    driven: tuple[DrivenManoeuvre, ...]
    sample: Callable[[NDArray[np.int64]], Channels]
    sample_position_boom_and_bucket: Callable[[NDArray[np.int64]], PositionBoomAndBucket] | None = (
        None
    )

    def assign_trial_numbers(self, time_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Trial number at each time, (n,); the rest after the last trial has the next number."""
        found = np.searchsorted(self.trial_ns, time_ns, side="right") - 1
        return np.clip(found, 0, self.trial_ns.size - 1)

    def make_trial_table(self, slope_deg: float) -> pl.DataFrame:
        """Table with a row per trial and its true values (`SimulatedLog.trials`)."""
        rows: list[dict[str, object]] = []
        for trial in range(self.trial_ns.size - 1):
            mine = [each for each in self.driven if each.trial == trial]
            start = next((each for each in mine if each.times.kind == "start"), None)
            times = start.times if start else ManoeuvreTimes("start", 0.0, None, None, None, 0.0)
            first = start or mine[0]
            body, start_ns = first.body, int(self.trial_ns[trial])
            rows.append(
                {
                    "run": trial,
                    "start_ns": start_ns,
                    "throttle_ns": _add_seconds_to_unix_ns(start_ns, times.drive_s),
                    "cruise_ns": _add_seconds_to_unix_ns(start_ns, times.steady_s),
                    "braking_ns": _add_seconds_to_unix_ns(start_ns, times.braking_s),
                    "end_ns": int(self.trial_ns[trial + 1]),
                    "load_kg": first.load_kg,
                    "mass_kg": body.mass_kg,
                    "friction_N_s_m": body.friction_x_N_s_m,
                    "coulomb_N": body.coulomb_x_N,
                    "rolling_N": body.rolling_x_N,
                    "slope_deg": slope_deg,
                    "inertia_z_kg_m2": body.inertia_z_kg_m2,
                    "com_x_m": body.com_x_m,
                    "com_y_m": body.com_y_m,
                    "friction_z_N_m_s": body.friction_z_N_m_s,
                    "coulomb_z_N_m": body.coulomb_z_N_m,
                }
            )
        times_ns = ("start_ns", "throttle_ns", "cruise_ns", "braking_ns", "end_ns")
        return pl.DataFrame(rows).cast(dict.fromkeys(times_ns, pl.Int64))

    def make_manoeuvre_table(self) -> pl.DataFrame:
        """Table with a row per manoeuvre (`SimulatedLog.manoeuvres`)."""
        rows: list[dict[str, object]] = []
        for each in self.driven:
            start_ns, times = int(self.trial_ns[each.trial]), each.times
            rows.append(
                {
                    "run": each.trial,
                    "manoeuvre": each.number,
                    "kind": times.kind,
                    "start_ns": start_ns + convert_to_whole_ns(times.start_s),
                    "drive_ns": _add_seconds_to_unix_ns(start_ns, times.drive_s),
                    "steady_ns": _add_seconds_to_unix_ns(start_ns, times.steady_s),
                    "braking_ns": _add_seconds_to_unix_ns(start_ns, times.braking_s),
                    "end_ns": start_ns + convert_to_whole_ns(times.end_s),
                    "load_kg": each.load_kg,
                    "load_end_kg": each.load_end_kg,
                    "mass_kg": each.body.mass_kg,
                    "friction_N_s_m": each.body.friction_x_N_s_m,
                    "coulomb_N": each.body.coulomb_x_N,
                    "rolling_N": each.body.rolling_x_N,
                    "direction": each.direction,
                    "throttle": each.throttle,
                }
            )
        times_ns = ("start_ns", "drive_ns", "steady_ns", "braking_ns", "end_ns")
        kinds = {
            **dict.fromkeys(times_ns, pl.Int64),
            "direction": pl.String,
            "throttle": pl.Float64,
        }
        return pl.DataFrame(rows, infer_schema_length=None).cast(kinds)  # pyright: ignore


def make_timeline_of_repeated_trial(
    scenario: Scenario, load_kg: float, motion: SolvedMotion, start_ns: int
) -> Timeline:
    """Time line of a repeated solved trial and a final rest."""
    trials = scenario.campaign.runs
    period_ns = math.ceil(motion.duration_s * 1e9)
    trial_ns = start_ns + period_ns * np.arange(trials + 1, dtype=np.int64)

    def sample_repeated_trial(time_ns: NDArray[np.int64]) -> Channels:
        trial = np.clip((time_ns - start_ns) // period_ns, 0, trials - 1)
        return motion.sample_channels((time_ns - start_ns - trial * period_ns) * np.float64(1e-9))

    starts = [
        (each.direction, each.throttle) if each.kind == "start" else (None, None)
        for each in scenario.campaign.manoeuvres_of_trial
    ]
    driven = tuple(
        DrivenManoeuvre(trial, number, times, motion.body, load_kg, load_kg, *starts[number])
        for trial in range(trials)
        for number, times in enumerate(motion.manoeuvres)
    )
    end_ns = int(trial_ns[-1]) + convert_to_whole_ns(scenario.campaign.rest_s)
    return Timeline(start_ns, end_ns, trial_ns, driven, sample_repeated_trial)


def make_continuous_timeline(
    scenario: Scenario,
    trial_s: Floats,
    manoeuvres: tuple[DrivenManoeuvre, ...],
    motion: Callable[[Floats], Channels],
    start_ns: int,
) -> Timeline:
    """Time line of a log that is solved as a whole.

    Args:
        scenario: simulated scenario.
        trial_s: (trials + 1,) start of each trial, and end of the last, since the log began.
        manoeuvres: manoeuvres in order.
        motion: computes the channels at times in s since the log began.
        start_ns: Unix time of the start of the log.
    """
    trial_ns = start_ns + np.rint(trial_s * 1e9).astype(np.int64)

    def sample_whole_log(time_ns: NDArray[np.int64]) -> Channels:
        return motion((time_ns - start_ns) * np.float64(1e-9))

    end_ns = int(trial_ns[-1]) + convert_to_whole_ns(scenario.campaign.rest_s)
    return Timeline(start_ns, end_ns, trial_ns, manoeuvres, sample_whole_log)


def _add_seconds_to_unix_ns(start_ns: int, seconds: float | None) -> int | None:
    return None if seconds is None else start_ns + convert_to_whole_ns(seconds)


def convert_to_whole_ns(seconds: float) -> int:
    """Convert seconds to whole nanoseconds."""
    return round(seconds * 1_000_000_000)
