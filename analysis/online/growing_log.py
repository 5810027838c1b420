"""Rows of `excitation` of a growing log, each once, equal to those of the causal replay.

The stages are those of the replay, applied to the newest seconds: causal stages look back no
further. Properties that the replay takes from a whole log (stamps of each topic, rate of the grid,
latency of a row) are determined from its first seconds and kept.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.machine import Machine
from analysis.model.schema import HINTS
from analysis.online.online_limits import LIMITS
from analysis.stages.motion.forces import compute_excitation_columns
from analysis.stages.motion.phases import count_rows_in_speed_rate_span
from analysis.stages.motion.smooth import smooth_columns_by_trailing_mean
from analysis.stages.signals.align import (
    GridOrigin,
    align_known_rows_on_causal_grid,
    find_origin_of_causal_grid,
)
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.filters import compute_gap_threshold_ns
from analysis.stages.signals.grid_rate import choose_grid_rate_by_log
from analysis.stages.signals.held_readings import (
    HeldReadings,
    drop_rows_with_held_readings,
    find_held_channels,
    list_held_reading_notes,
)
from analysis.stages.signals.signal_limits import LIMITS as SIGNAL_LIMITS
from analysis.stages.signals.timestamps import assign_timestamps
from estimators.errors import DataError

_STAMPS: Final = ("log_time_ns", "header_stamp_ns")


@dataclass(frozen=True, slots=True)
class LogBasis:
    """Properties fixed by the first seconds of a log.

    Attributes:
        machine: machine with grid rate, window and moving mean.
        log_time_offset_ns_by_topic: offset subtracted from the log times of each topic in ns; None
            if header stamps are used.
        stamp_label_by_topic: kind of stamp of each topic, for readers.
        origin: origin of the grid.
        held: channels whose readings are held in the first seconds.
        notes: notes on chosen settings.
    """

    machine: Machine
    log_time_offset_ns_by_topic: Mapping[str, int | None]
    stamp_label_by_topic: Mapping[str, str]
    origin: GridOrigin
    held: Mapping[str, HeldReadings]
    notes: tuple[str, ...] = ()

    @property
    def t0_unix_ns(self) -> int:
        """Unix time of the first row."""
        return self.origin.start_ns + self.origin.latency_ns


def copy_machine_with_causal_filters(machine: Machine) -> Machine:
    """The machine with causal filters and without optional channels, for following a log."""
    needed = {
        source for channel in machine.channels.values() for source in channel.direct_source_channels
    }
    channels = {
        name: channel
        for name, channel in machine.channels.items()
        if name not in HINTS or name in needed
    }
    settings = machine.settings.copy_with_changes({"filter.causal": True})
    return machine.model_copy(update={"settings": settings, "channels": channels})


@dataclass(slots=True)
class GrowingLog:
    """Newest samples of a log, from which its next rows are computed.

    Attributes:
        machine: machine from `copy_machine_with_causal_filters`.
        basis: basis; None until the first seconds are available.
        late_samples: number of samples that arrived after their rows had been computed.
    """

    machine: Machine
    basis: LogBasis | None = None
    late_samples: int = 0
    _raw: dict[str, pl.DataFrame] = field(default_factory=dict)
    #: samples not yet placed in time, which `compute_new_excitation_columns` uses next
    _new: dict[str, list[pl.DataFrame]] = field(default_factory=dict)
    _last_t_ns: int = -1
    #: time of the row from which old samples are dropped again
    _next_drop_t_ns: int = -1
    #: newest stamp of the topic that was furthest behind when rows were last computed
    _awaited_unix_ns: int = -1

    @property
    def topics(self) -> list[str]:
        """Topics of the channels."""
        read = (channel for channel in self.machine.channels.values() if channel.fields)
        return list(dict.fromkeys(channel.topic or "table" for channel in read))

    @property
    def _kept_s(self) -> float:
        """Time in s before a row from which samples are kept."""
        if not any(channel.is_derivative for channel in self.machine.channels.values()):
            return LIMITS.kept_s
        return LIMITS.kept_s + LIMITS.kept_low_pass_cycles / self.machine.settings.filter.cutoff_hz

    @property
    def kept_sample_count(self) -> int:
        """Number of samples of all topics kept for later rows."""
        return sum(frame.height for frame in self._raw.values())

    def append_topic_samples(self, topic: str, samples: pl.DataFrame) -> None:
        """Add samples of a topic: log_time_ns, header_stamp_ns (or null) and its fields."""
        if samples.height:
            self._new.setdefault(topic, []).append(samples)

    def compute_new_excitation_columns(
        self, *, is_log_complete: bool = False
    ) -> Mapping[str, NDArray[Any] | pl.Series]:
        """Compute the columns of the new rows of `excitation` that the samples so far determine.

        Args:
            is_log_complete: whether no further samples will come.

        Returns:
            Columns (rows,) of the new rows, NaN for null; empty without new ones.
        """
        if not (self._new or is_log_complete):
            return {}
        try:
            self._append_new_samples_to_kept()
            if self.basis is None and not self._determine_log_basis_if_possible(
                is_log_complete=is_log_complete
            ):
                return {}
            if self._drop_samples_while_topic_is_missing() and not is_log_complete:
                return {}
            return self._make_next_excitation_columns(is_log_complete=is_log_complete)
        except DataError:
            # too few samples, or none that is finite: more may come
            if is_log_complete and self.basis is None:
                raise
            return {}

    def _append_new_samples_to_kept(self) -> None:
        """Append the new samples to those kept."""
        for topic, parts in self._new.items():
            frame = concatenate_samples(parts)
            if self.basis is not None:
                frame = self._add_unix_stamps(topic, frame)
                self._count_samples_that_came_late(frame)
            parts.clear()
            before = self._raw.get(topic)
            kept = frame if before is None else concatenate_samples([before, frame])
            self._raw[topic] = sort_by_time(kept, "unix_ns" if self.basis else "log_time_ns")
        self._new.clear()

    def _count_samples_that_came_late(self, frame: pl.DataFrame) -> None:
        assert self.basis is not None
        if self._last_t_ns >= 0:
            known = self._last_t_ns + self.basis.t0_unix_ns
            self.late_samples += int(np.count_nonzero(frame["unix_ns"].to_numpy() <= known))

    def _add_unix_stamps(self, topic: str, frame: pl.DataFrame) -> pl.DataFrame:
        assert self.basis is not None
        behind = self.basis.log_time_offset_ns_by_topic[topic]
        stamps = frame["header_stamp_ns"] if behind is None else frame["log_time_ns"] - behind
        # column by column: for a few samples a query would cost more than everything else
        fields = [frame[name] for name in frame.columns if name not in _STAMPS]
        placed = pl.DataFrame([stamps.alias("unix_ns"), *fields])
        if stamps.null_count() or (behind is None and not stamps.to_numpy().all()):
            placed = placed.filter(stamps.is_not_null() & ((stamps != 0) | (behind is not None)))
        return placed

    def _determine_log_basis_if_possible(self, *, is_log_complete: bool) -> bool:
        """Determine stamps, rates and the grid's origin once the first seconds are available."""
        if not self._raw.keys() >= set(self.topics):
            if is_log_complete:
                missing = ", ".join(t for t in self.topics if t not in self._raw)
                raise DataError(
                    f"no message arrived on the topics {missing}; check that they are recorded, "
                    "and topic in [channels]"
                )
            newest_ns = max(int(frame["log_time_ns"][-1]) for frame in self._raw.values())
            self._drop_samples_before_last_topic(newest_ns)
            return False
        self._drop_samples_before_last_topic(
            max(int(frame["log_time_ns"][0]) for frame in self._raw.values())
        )
        head = cut_topics_to_first_seconds(self._raw)
        if head is None:
            if not is_log_complete:
                return False
            head = self._raw
        placed, labels, _ = assign_timestamps(head)
        read, _ = read_measured_channels(placed, self.machine)
        held = find_held_channels(read)
        notes = list_held_reading_notes(read, held)
        read = drop_rows_with_held_readings(read, held)
        machine, chosen = choose_grid_rate_by_log(read, self.machine)
        channels, _ = derive_channels_in_si(read, machine)
        self.basis = LogBasis(
            machine,
            {
                topic: find_log_time_minus_header_stamp_ns(frame, labels[topic])
                for topic, frame in head.items()
            },
            labels,
            find_origin_of_causal_grid(channels, machine),
            held,
            (*notes, *chosen),
        )
        self._raw = {
            t: sort_by_time(self._add_unix_stamps(t, f), "unix_ns") for t, f in self._raw.items()
        }
        return True

    def _drop_samples_before_last_topic(self, starts_ns: int) -> None:
        """Drop samples from the time before the last topic begins, except at its ends.

        Args:
            starts_ns: log time from which samples of the last topic can come.
        """
        first_ns = min(int(frame["log_time_ns"][0]) for frame in self._raw.values())
        ends_ns = round((SIGNAL_LIMITS.longest_gap_s + self._kept_s) * 1e9)
        if starts_ns - first_ns > 2 * ends_ns:
            self._drop_samples_between("log_time_ns", first_ns + ends_ns, starts_ns - ends_ns)

    def _drop_samples_while_topic_is_missing(self) -> bool:
        """Drop samples within a gap of a topic, which give no row; return whether it continues."""
        assert self.basis is not None
        newest_ns = [int(frame["unix_ns"][-1]) for frame in self._raw.values() if frame.height]
        awaited_ns = min(newest_ns)
        is_awaited, self._awaited_unix_ns = awaited_ns == self._awaited_unix_ns, awaited_ns
        # whether the topic has continued is checked first, as determining a gap costs more
        if not is_awaited or max(newest_ns) - awaited_ns <= SIGNAL_LIMITS.longest_gap_s * 1e9:
            return False
        align = self.basis.machine.settings.align
        longest_ns = max(
            compute_gap_threshold_ns(frame["unix_ns"].to_numpy(), align)
            for frame in self._raw.values()
        )
        # rows resume after at least this time, and look back over the samples that are kept
        ends_ns = round(longest_ns + (SIGNAL_LIMITS.longest_gap_s + self._kept_s) * 1e9)
        if max(newest_ns) - awaited_ns <= ends_ns:
            return False
        self._drop_samples_between("unix_ns", awaited_ns + ends_ns, max(newest_ns) - ends_ns)
        return True

    def _drop_samples_between(self, time_column: str, from_ns: int, until_ns: int) -> None:
        """Drop samples between two times, except the newest of each topic."""
        for topic, frame in self._raw.items():
            first, after = np.searchsorted(
                frame[time_column].to_numpy(), [from_ns, until_ns]
            ).tolist()
            after = min(after, frame.height - LIMITS.kept_min_samples)
            if after > first:
                self._raw[topic] = pl.concat([frame[:first], frame[after:]], rechunk=True)

    def _make_next_excitation_columns(
        self, *, is_log_complete: bool
    ) -> Mapping[str, NDArray[Any] | pl.Series]:
        assert self.basis is not None
        machine = self.basis.machine
        settings = machine.settings
        read, _ = read_measured_channels(self._raw, machine)
        channels, _ = derive_channels_in_si(
            drop_rows_with_held_readings(read, self.basis.held), machine
        )
        # moving mean, speed rate over its span, and acceleration averaged over the same span
        looks_back = settings.smooth.samples + 2 * count_rows_in_speed_rate_span(settings) + 2
        step_ns = 1e9 / settings.align.rate_hz
        after_ns = self._last_t_ns - round(looks_back * step_ns)
        aligned = align_known_rows_on_causal_grid(
            channels, machine, self.basis.origin, after_ns, is_log_complete=is_log_complete
        )
        t_ns = aligned["t_ns"]
        if not t_ns.size or t_ns[-1] <= self._last_t_ns:
            return {}
        smoothed = smooth_columns_by_trailing_mean(aligned, settings.smooth)
        columns = compute_excitation_columns(smoothed, machine)
        first = int(np.searchsorted(t_ns, self._last_t_ns, side="right"))
        self._last_t_ns = int(t_ns[-1])
        self._drop_old_samples()
        return {name: each[first:] for name, each in columns.items()}

    def _drop_old_samples(self) -> None:
        """Drop samples that no later row needs, once a few have gathered."""
        assert self.basis is not None
        if self._last_t_ns < self._next_drop_t_ns:
            return
        self._next_drop_t_ns = self._last_t_ns + round(LIMITS.dropped_s * 1e9)
        oldest = self._last_t_ns + self.basis.origin.start_ns - round(self._kept_s * 1e9)
        for topic, frame in self._raw.items():
            first = int(np.searchsorted(frame["unix_ns"].to_numpy(), oldest))
            first = max(0, min(first, frame.height - LIMITS.kept_min_samples))
            self._raw[topic] = frame[first:]


def concatenate_samples(frames: list[pl.DataFrame]) -> pl.DataFrame:
    """Concatenate frames whose columns may differ between integers and floats."""
    if len(frames) == 1:
        return frames[0]
    if any(frame.dtypes != frames[0].dtypes for frame in frames):
        return pl.concat(frames, how="vertical_relaxed")
    # for a few samples a query would cost more than everything else
    return reduce(pl.DataFrame.vstack, frames)


def sort_by_time(frame: pl.DataFrame, time_column: str) -> pl.DataFrame:
    """Sort by a time column, which is mostly sorted already."""
    return frame if frame[time_column].is_sorted() else frame.sort(time_column, maintain_order=True)


def cut_topics_to_first_seconds(
    topics: Mapping[str, pl.DataFrame],
) -> dict[str, pl.DataFrame] | None:
    """First seconds of every topic, up to a common time; None if a topic has fewer.

    The cut does not depend on how much was available, so that following the same log again starts
    from the same data.
    """
    reached: list[int] = []
    for frame in topics.values():
        times = frame["log_time_ns"].to_numpy()
        first = int(np.searchsorted(times, times[0] + round(LIMITS.head_s * 1e9)))
        if first == times.size:
            return None
        reached.append(int(times[first]))
    return {t: f.filter(f["log_time_ns"] <= max(reached)) for t, f in topics.items()}


def find_log_time_minus_header_stamp_ns(frame: pl.DataFrame, stamp_label: str) -> int | None:
    """Median delay of log time behind the header stamp in ns, to subtract from log times.

    It is 0 if header stamps are missing, zero, or a second or more off, and None if header stamps
    are used.
    """
    if stamp_label == "header":
        return None
    headers = frame["header_stamp_ns"]
    if headers.null_count() == frame.height or (headers == 0).any():
        return 0
    behind = (frame["log_time_ns"] - headers).median()
    return round(behind) if isinstance(behind, int | float) and abs(behind) < 1e9 else 0
