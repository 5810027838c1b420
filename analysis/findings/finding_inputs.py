"""Inputs of the causes: the log, its verdict and its joint fit."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
import polars as pl

from analysis.diagnosis.check_inputs import CheckInputs
from analysis.diagnosis.excluded_stretches import mark_grid_rows_in_spans
from analysis.diagnosis.measured_channels import Series, Spans
from analysis.findings.finding_limits import LIMITS
from analysis.model.axes import X
from analysis.model.machine import FORCES, Machine
from analysis.model.physical_units import find_gain_and_offset_to_si
from analysis.model.schema import get_column_values
from analysis.model.verdict import Verdict
from analysis.model.windows import flag_rows_near_flagged_rows
from analysis.stages.motion.forces import compute_longitudinal_force
from analysis.stages.noise.column_noise import ColumnNoise
from analysis.stages.signals.copied_rows import Copy
from analysis.stages.signals.derive import find_unit_in_name
from analysis.weighing.joint_result import JointFit
from analysis.weighing.missing_terms import MissingTerm
from analysis.weighing.motion_samples import CachedNoise, ColumnNoiseModel, MotionSamples
from estimators.arrays import Bools, Floats, Ints
from estimators.interpreted import compiled_unless_short_log

#: Channels of the speed, as a machine file may have them.
SPEEDS: Final = ("speed_left_m_s", "speed_right_m_s", "speed_x_m_s")
ACC: Final = "specific_force_x_m_s2"
#: Channels of an accelerometer along x.
ACCELERATIONS: Final = (ACC, "acc_x_m_s2")


@dataclass(frozen=True)
class FindingInputs:
    """Frames and results of one log that the causes are searched in.

    Attributes:
        check_inputs: inputs of the checks.
        aligned: samples on the grid, before the moving mean.
        noise: noise of the columns.
        raw_frames_by_topic: frames with stamps, by topic.
        digging_stretches: stretches in which an external force opposes the machine.
        verdict_frame: the frame `verdict`.
        copied_rows_by_topic: rows of topics that repeat earlier ones, by topic.
        estimates: estimates by method.
        cache: results that one cause computes and another uses.
    """

    check_inputs: CheckInputs
    aligned: pl.DataFrame
    noise: pl.DataFrame
    raw_frames_by_topic: Mapping[str, pl.DataFrame]
    digging_stretches: pl.DataFrame
    verdict_frame: pl.DataFrame
    copied_rows_by_topic: Mapping[str, list[Copy]]
    estimates: Mapping[str, pl.DataFrame] = field(default_factory=dict)
    cache: dict[str, object] = field(default_factory=dict)

    @property
    def machine(self) -> Machine:
        """Machine file with channels and settings."""
        return self.check_inputs.machine

    @property
    def fit_without_learnt_priors(self) -> JointFit | None:
        """The joint fit without priors learnt by a calibration; None if nothing could be fitted."""
        weighing = self.check_inputs.weighing
        return None if weighing is None else weighing.fit_without_learnt_priors

    @cached_property
    def can_weigh(self) -> bool:
        """Whether no check withholds the mass."""
        return Verdict.from_frame(self.verdict_frame).can_weigh

    @cached_property
    def value_by_check(self) -> dict[str, float]:
        """Numbers of the verdict by check; NaN for checks that do not apply."""
        numbers = self.verdict_frame["value"].fill_null(np.nan).to_list()
        return dict(zip(self.verdict_frame["check"].to_list(), numbers, strict=True))

    @property
    def reportable_missing_terms(self) -> tuple[MissingTerm, ...]:
        """Terms that the model lacks and that are significant enough to be reported."""
        weighing = self.check_inputs.weighing
        found = () if weighing is None else weighing.missing_terms
        return tuple(
            each
            for each in found
            if each.is_nameable(found) and abs(each.t) >= LIMITS.named_term_min_std
        )

    @cached_property
    def column_noise(self) -> ColumnNoiseModel | None:
        """Noise of acceleration, speed and force; None if unknown."""
        found = ColumnNoise.select_axis_noise(X, self.noise, self.machine.settings.noise)
        return None if found is None else CachedNoise(found)

    @cached_property
    def is_standing_sample(self) -> Bools:
        """Whether each grid sample is at standstill, (n,)."""
        return self.check_inputs.mark_samples_in_phases("standstill")

    @cached_property
    def absolute_force_newtons(self) -> Floats:
        """Magnitude of the longitudinal force on the grid, (n,) in N."""
        return np.abs(compute_longitudinal_force(self.aligned, self.machine.machine))

    @cached_property
    def largest_force_newtons(self) -> float:
        """98 % quantile of the magnitude of the force, in N."""
        return float(np.nanquantile(self.absolute_force_newtons, 0.98))

    @property
    def idle_force_newtons(self) -> float:
        """Force in N below which the drive is idle."""
        return LIMITS.idle_force_fraction * self.largest_force_newtons

    @cached_property
    def is_idle_sample(self) -> Bools:
        """Whether each grid sample's force is small enough for an idle drive, (n,)."""
        return self.absolute_force_newtons < self.idle_force_newtons

    @cached_property
    def is_resting_sample(self) -> Bools:
        """Whether each sample is at standstill and not just before or after motion, (n,)."""
        near = ~self.is_standing_sample
        after, before = (
            round(s * self.machine.settings.align.rate_hz)
            for s in (LIMITS.stand_after_motion_s, LIMITS.stand_before_motion_s)
        )
        return ~flag_rows_near_flagged_rows(near, after, before)

    @property
    def unfiltered_readings(self) -> Mapping[str, Series]:
        """Unfiltered readings by channel: Unix stamps in ns and values in SI units."""
        signals = self.check_inputs.signals
        return {} if signals is None else signals.channels

    def select_measured_channels(self, *names: str) -> tuple[str, ...]:
        """Select the given channels that are read from the log."""
        return tuple(name for name in names if name in self.unfiltered_readings)

    @property
    def equation_channels_in_log(self) -> tuple[str, ...]:
        """The channels of the equation that are read from the log."""
        return self.select_measured_channels(*FORCES, *SPEEDS, "position_x_m", *ACCELERATIONS)

    @property
    def sensors_in_log(self) -> tuple[str, ...]:
        """Measured channels of the equation, and the single one that the force derives from."""
        signals = self.check_inputs.signals
        forces = () if signals is None else signals.force_channels
        alone = self.select_measured_channels(*forces) if len(forces) == 1 else ()
        return tuple(dict.fromkeys((*self.equation_channels_in_log, *alone)))

    def compute_median_force_newtons_in_spans(self, spans_unix_ns: Spans) -> float:
        """Median magnitude of the force on the grid in some spans, in N; NaN without samples."""
        t_ns = self.aligned["t_ns"].to_numpy() + self.check_inputs.t0_unix_ns
        inside = mark_grid_rows_in_spans({"": spans_unix_ns}, t_ns, self.machine)
        force = self.absolute_force_newtons[inside]
        return float(np.nanmedian(force)) if np.isfinite(force).any() else float("nan")

    @property
    def has_accelerometer(self) -> bool:
        """Whether an accelerometer is read from the log, rather than derived from the speed."""
        return bool(self.select_measured_channels(*ACCELERATIONS))

    @property
    def force_channel(self) -> str | None:
        """Name of the force channel or else of the first measured torque; None without either."""
        return next(
            iter(self.select_measured_channels("force_x_N", "torque_left_N_m", "torque_right_N_m")),
            None,
        )

    @property
    def speed_channels(self) -> tuple[str, ...]:
        """Names of the channels that measure the speed."""
        return self.select_measured_channels(*SPEEDS, "position_x_m")

    def find_channel_of_topic(self, topic: str) -> str | None:
        """Name of a channel of the topic, preferring one that the equation needs."""
        names = (*self.equation_channels_in_log, *self.machine.channels)
        return next((n for n in names if self.machine.channels[n].topic == topic), None)

    def convert_unix_to_aligned_ns(self, start_unix_ns: int, end_unix_ns: int) -> tuple[int, int]:
        """Convert two Unix stamps to ns since the first aligned sample."""
        t0 = self.check_inputs.t0_unix_ns
        return int(start_unix_ns) - t0, int(end_unix_ns) - t0

    def mark_moving_stamps(self, unix_ns: Ints) -> Bools:
        """Whether the machine moves at these stamps, (n,)."""
        t = self.aligned["t_ns"].to_numpy() + self.check_inputs.t0_unix_ns
        return ~self.is_standing_sample[
            np.minimum(find_insertion_indices_of_stamps(t, unix_ns), t.size - 1)
        ]

    def force_newtons_per_channel_unit(self, channel: str) -> float:
        """Longitudinal force in N per unit of a force channel, by equation (17) of the paper."""
        body = self.machine.machine
        if channel == "force_x_N":
            return 1.0 / body.force_share
        return 1.0 / (float(body.wheel_radius_m or np.nan) * body.force_share)

    def propose_scale_settings(self, names: tuple[str, ...], factor: float) -> tuple[str, str]:
        """Keys and values of the machine file that multiply channels by a factor.

        A speed without a declared unit gets a unit too, since a scale alone may be a wheel radius.
        """
        channels = self.machine.channels
        as_read = [
            n
            for n in names
            if n in SPEEDS and channels[n].unit is None and channels[n].scale == 1.0
        ]
        keys = (f"channels.{name}.scale" for name in names)
        scaled = (f"{channels[name].scale * factor:.6g}" for name in names)
        return (
            ", ".join([*keys, *(f"channels.{name}.unit" for name in as_read)]),
            ", ".join([*scaled, *('"m/s"' for _ in as_read)]),
        )

    def propose_valid_range_settings(self, name: str) -> tuple[str | None, str | None]:
        """Key and value that leave out readings far outside all others, such as error codes.

        Both are None if no reading is far outside, or if the channel is derived.
        """
        readings, channel = self.unfiltered_readings[name][1], self.machine.channels.get(name)
        middle = float(np.median(readings))
        sides = (middle - readings, readings - middle)
        edges = np.array([_find_edge_of_usual_readings(side) for side in sides])
        if channel is None or channel.field is None or np.isinf(edges).all():
            return None, None
        # a side without codes reaches as far as the other, and no reading of it is left out
        whole = np.maximum(edges.min(), [side.max() for side in sides])
        limits = middle + np.array([-1.0, 1.0]) * np.where(np.isinf(edges), whole, edges)
        gain, offset = 1.0, 0.0
        if channel.unit:
            gain, offset = find_gain_and_offset_to_si(channel.unit, find_unit_in_name(name))
        lowest, highest = sorted(
            ((limits - offset) / gain - channel.offset) / (channel.scale or 1.0)
        )
        return f"channels.{name}.valid_range", f"[{lowest:.4g},{highest:.4g}]"

    def propose_kinematic_acceleration_settings(self) -> tuple[str, str]:
        """Keys and values that declare the accelerometer's readings as free of gravity."""
        channel = self.machine.channels["specific_force_x_m_s2"].model_dump(exclude_defaults=True)
        values = {f"channels.acc_x_m_s2.{name}": value for name, value in channel.items()}
        values = {"settings.forces.acceleration": "kinematic"} | values
        texts = (json.dumps(value, separators=(",", ":")) for value in values.values())
        return ", ".join(values), ", ".join(texts)

    def propose_delay_settings(self, names: tuple[str, ...], delay_s: float) -> tuple[str, str]:
        """Keys and values of the machine file that correct a delay of channels."""
        channels = self.machine.channels
        return (
            ", ".join(f"channels.{name}.delay_s" for name in names),
            ", ".join(f"{channels[name].delay_s + delay_s:.5f}" for name in names),
        )

    def compute_mean_and_std_of_column_at_rest(self, column: str) -> tuple[float, float]:
        """Mean of a grid column at standstill and its standard deviation; NaN if never at rest."""
        if column not in self.aligned.columns:
            return float("nan"), float("nan")
        return self.compute_mean_and_std_of_signal_at_rest(get_column_values(self.aligned, column))

    def compute_mean_and_std_of_signal_at_rest(self, signal: Floats) -> tuple[float, float]:
        """Mean of (n,) values at standstill and its standard deviation, by half-second means."""
        (blocks,) = self.average_blocks_at_rest(signal)
        if blocks.size < LIMITS.stand_min_blocks:
            return float("nan"), float("nan")
        std_of_mean = float(blocks.std(ddof=1)) / float(np.sqrt(blocks.size))
        return float(np.median(blocks)), 1.2533 * std_of_mean

    def average_blocks_at_rest(self, *signals: Floats) -> list[Floats]:
        """Half-second means (blocks,) of signals (n,) at standstill, where all are finite."""
        used = self.is_resting_sample & np.logical_and.reduce([np.isfinite(x) for x in signals])
        size = max(round(LIMITS.stand_block_s * self.machine.settings.align.rate_hz), 1)
        count = int(used.sum()) // size
        return [x[used][: count * size].reshape(count, size).mean(axis=1) for x in signals]

    def look_up_mass_of_samples_kg(self, motion: MotionSamples) -> Floats:
        """Mass of the load of each sample by the joint fit, (n,) in kg."""
        fit = self.fit_without_learnt_priors
        assert fit is not None
        if fit.states is None or fit.mass_count == 1:
            return np.full(motion.force.size, fit.mass_kg)
        place = np.searchsorted(fit.states.manoeuvre_ids, motion.manoeuvre_of_sample, "right") - 1
        return fit.masses_kg[
            fit.states.state_of_manoeuvre[place.clip(0, fit.states.manoeuvre_ids.size - 1)]
        ]


@compiled_unless_short_log
def find_insertion_indices_of_stamps(sorted_stamps: Ints, stamps: Ints) -> Ints:
    """Insertion indices (n,) of stamps into `sorted_stamps`; fast for stamps mostly in order."""
    out = np.empty(stamps.size, np.int64)
    at = 0
    for k in range(stamps.size):
        while at < sorted_stamps.size and sorted_stamps[at] < stamps[k]:
            at += 1
        while at > 0 and sorted_stamps[at - 1] >= stamps[k]:
            at -= 1
        out[k] = at
    return out


def _find_edge_of_usual_readings(distances: Floats) -> float:
    """Find the edge between usual readings and error codes on one side of the middle.

    It lies in the largest gap between readings, if that is wide beside the usual ones; infinite
    otherwise.

    Args:
        distances: (n,) distances from the middle, negative on the other side.
    """
    side = distances[distances >= 0.0]
    if side.size < 2:
        return float("inf")
    ordered = np.sort(side[side >= np.quantile(side, LIMITS.error_code_searched_quantile)])
    gaps = np.diff(ordered)
    if not gaps.size:
        return float("inf")
    at = int(np.argmax(gaps))
    wide = gaps[at] > LIMITS.error_code_gap_fraction * ordered[at] > 0.0
    few = ordered.size - 1 - at < LIMITS.error_code_max_fraction * distances.size
    return float(ordered[at] + gaps[at] / 2.0) if wide and few else float("inf")
