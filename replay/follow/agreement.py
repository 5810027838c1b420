"""Compare a followed log with the replay of the finished log, bit for bit.

Digests per minute are kept instead of the rows, so that memory hardly grows with the shift. The
recording of a followed log is that of its causal replay.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.axes import (
    Axis,
    X,
    Z,
    list_axes_allowed_by_channels,
    read_parameters_and_stds,
    select_estimate_rows_of_axis,
)
from analysis.model.machine import Machine
from analysis.model.schema import REASON
from analysis.model.settings import Settings
from analysis.online.follower import FollowedRow
from analysis.stages.noise.column_noise import collect_axis_noise
from estimators.errors import DataError
from recordings import read_recording, write_recording
from recordings.report.atomic_output import refuse_input_as_output
from replay.follow.background_replay import find_path_after_closing, replay_log_so_far
from replay.follow.follow_limits import LIMITS

GATE: Final = "gate"
#: Nanoseconds of a minute.
_MINUTE_NS: Final = 60 * 10**9
_OF_SPINS: Final = " of spins"
#: Why followed results differ from the replay, where they cannot agree.
_NOISE: Final = (
    "the replay takes the noise of the whole log, which was not known while following; "
    "[settings.noise] in the machine file makes them equal"
)
_GOES_ON: Final = "the replay includes rows that were not followed"
_REASONS: Final = {name: number for number, name in enumerate(REASON.categories)}


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of the gate, or of one method, with the replay.

    Attributes:
        name: `gate` or the method, with the axis for spins.
        rows: number of followed rows.
        replayed: number of rows in the replay.
        differs_from_s: time of the first differing row; None if all rows are equal bit for bit.
        is_rounding: whether the rows differ by rounding only.
    """

    name: str
    rows: int
    replayed: int
    differs_from_s: float | None
    is_rounding: bool


@dataclass(frozen=True, slots=True)
class _MinuteDigest:
    """Digest, number and column sums of the rows of a minute."""

    digest: bytes = b""
    rows: int = 0
    sums: tuple[float, ...] = ()

    def digest_with_row(self, time_ns: int, row_numbers: NDArray[np.float64]) -> "_MinuteDigest":
        # each digest covers the row and the previous digest, so that no hash object is kept
        row = (
            np.int64(time_ns).tobytes()
            + np.where(np.isnan(row_numbers), np.nan, row_numbers).tobytes()
        )
        known = np.nan_to_num(row_numbers)
        sums = known + self.sums if self.sums else known
        digest = hashlib.sha256(self.digest + row).digest()
        return _MinuteDigest(digest, self.rows + 1, tuple(sums.tolist()))

    def has_nearly_equal_means(self, other_digest: "_MinuteDigest") -> bool:
        """Whether both have as many rows with nearly equal means."""
        return self.rows == other_digest.rows and np.allclose(
            self.sums, other_digest.sums, LIMITS.same_sum_1, 0.0
        )


@dataclass(slots=True)
class _MinuteDigests:
    """Digests of the rows of the gate or a method, by minute."""

    rows: int = 0
    minutes: dict[int, _MinuteDigest] = field(default_factory=dict)

    def add_row_to_minute(self, time_ns: int, row_numbers: NDArray[np.float64]) -> None:
        minute = time_ns // _MINUTE_NS
        self.minutes[minute] = self.minutes.get(minute, _MinuteDigest()).digest_with_row(
            time_ns, row_numbers
        )
        self.rows += 1

    def compare_with_replayed_digests(
        self, frame_name: str, replayed_digests: "_MinuteDigests"
    ) -> Agreement:
        every = sorted(self.minutes.keys() | replayed_digests.minutes.keys())
        pairs = [
            (m, self.minutes.get(m, _MinuteDigest()), replayed_digests.minutes.get(m))
            for m in every
        ]
        differing = [minute for minute, mine, theirs in pairs if mine != theirs]
        near = all(
            theirs is not None and mine.has_nearly_equal_means(theirs) for _, mine, theirs in pairs
        )
        return Agreement(
            frame_name,
            self.rows,
            replayed_digests.rows,
            differing[0] * _MINUTE_NS / 1e9 if differing else None,
            near,
        )


class FollowedDigests:
    """Digests of gate decisions and estimates, added to while a log is followed."""

    def __init__(self) -> None:
        self._minutes: dict[str, _MinuteDigests] = {}

    def add_followed_rows(self, online_rows: Iterable[FollowedRow]) -> None:
        """Add the decisions and estimates of the next rows."""
        for row in online_rows:
            for axis, gate, estimates in (
                (X, row.gate, row.estimates),
                (Z, row.spin_gate, row.spin_estimates),
            ):
                if gate is not None:
                    code = np.array([_REASONS[gate.reason]], np.float64)
                    self._find_or_add_minute_digests(
                        _make_digest_name(GATE, axis)
                    ).add_row_to_minute(row.t_ns, code)
                for method, (t_ns, estimate) in estimates.items():
                    self._find_or_add_minute_digests(
                        _make_digest_name(method, axis)
                    ).add_row_to_minute(t_ns, estimate.theta)

    def compare_with_replayed_frames(
        self, replayed_frames: Mapping[str, pl.DataFrame]
    ) -> list[Agreement]:
        """Compare the digests with the frames of a replay, for the gate and each method."""
        return [
            self._minutes.get(name, _MinuteDigests()).compare_with_replayed_digests(name, replayed)
            for name, replayed in _digest_replayed_frames(replayed_frames).items()
        ]

    def _find_or_add_minute_digests(self, name: str) -> _MinuteDigests:
        return self._minutes.setdefault(name, _MinuteDigests())


def _digest_replayed_frames(
    replayed_frames: Mapping[str, pl.DataFrame],
) -> dict[str, _MinuteDigests]:
    found: dict[str, _MinuteDigests] = {}
    for axis in list_axes_allowed_by_channels(replayed_frames["excitation"]):
        gate = replayed_frames["gate"]
        codes = gate[f"reason_{axis.letter}"].cast(pl.String)
        codes = codes.replace_strict(_REASONS, return_dtype=pl.Float64)
        found[_make_digest_name(GATE, axis)] = _digest_rows_by_minute(
            gate["t_ns"], codes.to_numpy()[:, None]
        )
        for name, frame in replayed_frames.items():
            method = name.removeprefix("estimates/")
            if method != name and axis.parameters[0][0] in frame.columns:
                rows = select_estimate_rows_of_axis(axis, frame).drop_nulls("t_ns")
                theta, _ = read_parameters_and_stds(axis, rows)
                found[_make_digest_name(method, axis)] = _digest_rows_by_minute(rows["t_ns"], theta)
    return found


def _make_digest_name(name: str, axis: Axis) -> str:
    return name if axis is X else f"{name}{_OF_SPINS}"


def _digest_rows_by_minute(t_ns: pl.Series, numbers: NDArray[np.float64]) -> _MinuteDigests:
    minutes = _MinuteDigests()
    for t, row in zip(t_ns.to_list(), np.ascontiguousarray(numbers), strict=True):
        minutes.add_row_to_minute(t, row)
    return minutes


def record_and_compare_followed_log(
    paths: Sequence[Path],
    machine: Machine,
    output: Path,
    followed_digests: FollowedDigests,
    *,
    is_growing: bool,
) -> list[Agreement]:
    """Record the causal replay of a followed log, and compare it with the followed results.

    Args:
        paths: paths of the log; a `.bag.active` is found under its final name.
        machine: the machine of the follower; its filters are made causal here.
        output: recording to write, or to replace.
        followed_digests: digests of the followed decisions and estimates.
        is_growing: whether the log may still be recorded; tables are then read up to their last
            complete line.

    Raises:
        PayscopeError: the log is invalid or gone, or there is too little data.
    """
    closed = [find_path_after_closing(path) for path in paths]
    settings = machine.settings.copy_with_changes({"filter.causal": True})
    causal = machine.model_copy(update={"settings": settings})
    refuse_input_as_output(output, (path for path in closed if path.exists()))
    try:
        result = replay_log_so_far(closed, causal, is_copied=is_growing)
    except DataError as error:
        raise DataError(f"{', '.join(map(str, closed))}: {error}") from None
    write_recording(result, output, overwrites=True)
    return followed_digests.compare_with_replayed_frames(read_recording(output).frames)


def iter_agreement_lines(
    agreements: Iterable[Agreement], settings: Settings, *, is_growing: bool
) -> Iterator[str]:
    """Yield a line per agreement; methods that differ for the same reason share a line.

    Args:
        agreements: agreements of the gate and of each method.
        settings: settings of the follower's machine.
        is_growing: as in `record_and_compare_followed_log`.
    """
    expected: dict[str, list[Agreement]] = {}
    for each in agreements:
        rows = f"{each.name}: {each.rows:,} rows"
        more = each.replayed - each.rows
        if each.differs_from_s is None:
            yield f"{rows}, as in the replay bit for bit"
        elif each.is_rounding:
            yield f"{rows}, as in the replay to nine digits"
        elif each.name.startswith(GATE) and is_growing and more > 0:
            yield (
                f"{rows}, {each.replayed:,} in the replay, which includes rows that were not "
                f"followed; they differ from {each.differs_from_s:,.0f} s onwards"
            )
        elif not does_machine_file_state_noise(settings, Z if each.name.endswith(_OF_SPINS) else X):
            expected.setdefault(_NOISE, []).append(each)
        elif is_growing:
            expected.setdefault(_GOES_ON, []).append(each)
        else:
            yield (
                f"{rows}, {each.replayed:,} in the replay; they differ from "
                f"{each.differs_from_s:,.0f} s onwards"
            )
    for reason, found in expected.items():
        from_s = min(each.differs_from_s or 0.0 for each in found)
        names = ", ".join(each.name for each in found)
        verb = "differs" if len(found) == 1 else "differ"
        yield (
            f"{names}: {verb} from the replay, from the minute at {from_s:,.0f} s on, as expected: "
            f"{reason}"
        )


def does_machine_file_state_noise(settings: Settings, axis: Axis) -> bool:
    """Whether the settings state the noise of each column of an axis."""
    return collect_axis_noise(axis, settings).moving_mean_covariance is not None
