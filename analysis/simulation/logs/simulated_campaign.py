"""Simulated campaign: for each load one log of many trials, with the true values of each.

A trial is called a run in a scenario: one pass through the manoeuvres of `campaign.manoeuvres`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import polars as pl

from analysis.model.schema import PHASE
from analysis.simulation.motion.timeline import (
    Timeline,
    convert_to_whole_ns,
    make_continuous_timeline,
    make_timeline_of_repeated_trial,
)
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.sensors.recorder import TOPICS, compute_topic_phase_s, make_sample_times_ns
from analysis.simulation.sensors.sensors import simulate_topics_of_log
from analysis.simulation.trials.solve_trial import solve_motion
from analysis.simulation.trials.switches import find_scenario_key_needing_integration
from analysis.simulation.trials.trial_limits import refuse_undrivable_scenario
from estimators.errors import ScenarioError


@dataclass(frozen=True, eq=False)
class SimulatedLog:
    """The recorded topics of one log, and its true values.

    Attributes:
        scenario: simulated scenario.
        load_kg: the load.
        topics: frames `imu`, `torque` and `speed`, and in a shift others, by
            `simulate_topics_of_log`.
        trials: a row per trial (none in a shift): `run` (its number), the Unix times `start_ns` and
            `end_ns`, `throttle_ns`, `cruise_ns` and `braking_ns` of its first start (null without
            one), and the true `load_kg mass_kg friction_N_s_m coulomb_N rolling_N slope_deg
            inertia_z_kg_m2 com_x_m com_y_m friction_z_N_m_s coulomb_z_N_m` of machine and load,
            about the origin, when its first start (or else its first manoeuvre) begins.
        manoeuvres: a row per manoeuvre: `run`, `manoeuvre` (its number in the trial), `kind`, and
            the Unix times `start_ns drive_ns steady_ns braking_ns end_ns` (null if it has no such
            part); `load_kg mass_kg friction_N_s_m coulomb_N rolling_N` at its start, `load_end_kg`
            at its end, and for a start its `direction` and `throttle` (fraction of full throttle).
        timeline: motion without noise, at any time.
        phase_s: time of each topic's first sample since the start of the log.
        torn_share: fraction of the file that is missing at its end.
    """

    scenario: Scenario
    load_kg: float
    topics: Mapping[str, pl.DataFrame]
    trials: pl.DataFrame
    manoeuvres: pl.DataFrame
    timeline: Timeline
    phase_s: Mapping[str, float]
    torn_share: float = 0.0

    @cached_property
    def noise_free_motion(self) -> pl.DataFrame:
        """Motion without noise at `sensors.rate_hz`, from the start of the log.

        The columns are `time_ns` (Unix) and the fields of `Channels`.
        """
        time_ns = make_sample_times_ns(self.timeline, self.scenario.sensors.rate_hz, 0.0)
        now = self.timeline.sample(time_ns)
        return pl.DataFrame({"time_ns": time_ns, **now._asdict()}).with_columns(
            pl.col("phase").cast(PHASE)
        )

    @property
    def origin_unix_ns(self) -> int:
        """Unix time of the start of the campaign, from which the times in its tables count."""
        return convert_to_whole_ns(self.scenario.log.start_unix_s)


def simulate_campaign(scenario: Scenario) -> Iterator[SimulatedLog]:
    """Simulate a scenario: one log per load, in order, on one time line.

    The same scenario gives the same logs bit for bit. Slope and Coulomb friction affect the motion
    and the measurements as on site.

    Raises:
        ScenarioError: the machine cannot be driven as requested with one of the loads; raised
            before the first log.
    """
    if scenario.shift is not None:
        raise ScenarioError("shift: this scenario is a shift, not a campaign; use ShiftSimulation")
    refuse_undrivable_scenario(scenario, scenario.campaign.loads_kg)
    return _simulate_logs(scenario)


def _simulate_logs(scenario: Scenario) -> Iterator[SimulatedLog]:
    start_ns = convert_to_whole_ns(scenario.log.start_unix_s)
    for index, load_kg in enumerate(scenario.campaign.loads_kg):
        timeline = _make_timeline(scenario, load_kg, index, start_ns)
        yield SimulatedLog(
            scenario=scenario,
            load_kg=load_kg,
            topics=simulate_topics_of_log(scenario, timeline, index),
            trials=timeline.make_trial_table(scenario.terrain.slope_deg),
            manoeuvres=timeline.make_manoeuvre_table(),
            timeline=timeline,
            phase_s={topic: compute_topic_phase_s(scenario, topic, index) for topic in TOPICS},
        )
        start_ns = timeline.end_ns + convert_to_whole_ns(scenario.log.load_change_s)


def _make_timeline(scenario: Scenario, load_kg: float, index: int, start_ns: int) -> Timeline:
    """Time line of a load's log: one exact trial repeated if possible, otherwise integrated."""
    if find_scenario_key_needing_integration(scenario) is None:
        return make_timeline_of_repeated_trial(
            scenario, load_kg, solve_motion(scenario, load_kg), start_ns
        )
    from analysis.simulation.drive.log_drive import drive_trials_of_log

    whole = drive_trials_of_log(scenario, load_kg, index)
    return make_continuous_timeline(
        scenario, whole.trial_s, whole.driven, whole.sample_channels, start_ns
    )
