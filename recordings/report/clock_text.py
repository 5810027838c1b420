"""Format times in the machine's time zone, unambiguous by their offset from UTC."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final
from zoneinfo import ZoneInfo

from analysis.model.physical_units import NS
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from recordings.report.report_limits import LIMITS

#: Seconds of a minute, and of an hour.
_MINUTE_S: Final = 60
_HOUR_S: Final = 3600
#: Distances of an axis' ticks in s, of which the shortest with at most `time_max_ticks` is used.
_STEPS_S: Final = tuple(
    60 * each for each in (1, 2, 5, 10, 15, 30, 60, 120, 180, 360, 720, 1440, 2880, 10080)
)


@dataclass(frozen=True)
class ShiftClock:
    """Clock that converts times since the first sample of a shift to local times of its machine.

    Attributes:
        zone: name of the machine's time zone.
        t0_unix_ns: Unix time of the first aligned sample; before `FIRST_DATE_NS` the log has no
            date.
        duration_s: time from the first to the last aligned sample.
    """

    zone: str
    t0_unix_ns: int
    duration_s: float

    @property
    def has_date(self) -> bool:
        """Whether the log has a date."""
        return self.t0_unix_ns >= FIRST_DATE_NS

    @property
    def time_axis_label(self) -> str:
        """Label of a time axis."""
        if not self.has_date:
            return "h:min since the start"
        return (
            f"local time (UTC{self._format_utc_offset(0.0)})"
            if self._has_one_utc_offset
            else "local time, UTC±h"
        )

    def format_time(self, time_s: float) -> str:
        """Format a time in s since the first sample, with offset, and date if needed."""
        if not self.has_date:
            return _format_elapsed_time(time_s)
        local = self.to_local_datetime(time_s)
        day = "" if self._is_within_one_day else f"{local:%Y-%m-%d} "
        return f"{day}{local:%H:%M:%S} {self._format_utc_offset(time_s)}"

    def format_start_of_hour(self, time_s: float) -> str:
        """Format the start of the hour that contains a time, with offset; h:00 without a date."""
        if not self.has_date:
            return f"{int(time_s // _HOUR_S)}:00"
        local = self.to_local_datetime(time_s)
        day = "" if self._is_within_one_day else f"{local:%Y-%m-%d} "
        return f"{day}{local:%H}:00 {self._format_utc_offset(time_s)}"

    def compute_next_hour_s(self, time_s: float) -> float:
        """Compute the start of the next hour, in s since the first sample."""
        if not self.has_date:
            return _HOUR_S * (time_s // _HOUR_S + 1.0)
        local = self.to_local_datetime(time_s)
        return time_s + _HOUR_S - local.minute * _MINUTE_S - local.second

    def format_day_and_time(self, instant: datetime) -> str:
        """Format date and local time of an instant."""
        local = instant.astimezone(ZoneInfo(self.zone))
        return f"{local:%Y-%m-%d %H:%M:%S} {_format_utc_offset_of(local)}"

    def format_unix_ns(self, unix_ns: int) -> str:
        """Format a Unix time in local time."""
        return self.format_time((unix_ns - self.t0_unix_ns) / NS)

    def to_local_datetime(self, time_s: float) -> datetime:
        """Convert a time in s since the first sample to local time, rounded to a second."""
        unix_s = (self.t0_unix_ns + round(time_s * NS)) // NS
        return datetime.fromtimestamp(unix_s, UTC).astimezone(ZoneInfo(self.zone))

    def make_time_axis_ticks(self, low_s: float, high_s: float) -> list[tuple[float, str]]:
        """Choose round local times, with labels, in a range in s since the first sample.

        If the offset changes, each tick shows its own.
        """
        step_s = next(
            (s for s in _STEPS_S if (high_s - low_s) / s <= LIMITS.time_max_ticks), _STEPS_S[-1]
        )
        # from local midnight by the first offset, so that ticks are round in local time
        shift_s = 0.0
        if self.has_date:
            first = self.to_local_datetime(0.0)
            midnight_s = first.hour * _HOUR_S + first.minute * _MINUTE_S + first.second
            shift_s = midnight_s + (self.t0_unix_ns % NS) / NS
        start = int(-(-(low_s + shift_s) // step_s))
        end = int((high_s + shift_s) // step_s)
        places = [k * step_s - shift_s for k in range(start, end + 1)]
        return [(place, self._format_time_axis_tick(place)) for place in places]

    def _format_time_axis_tick(self, time_s: float) -> str:
        if not self.has_date:
            return _format_elapsed_time(time_s).removesuffix(":00")
        # rounded, since a tick may be just before its minute by float rounding
        local = self.to_local_datetime(time_s + 0.5)
        offset = "" if self._has_one_utc_offset else self._format_utc_offset(time_s + 0.5)[:3]
        return f"{local:%H:%M}{offset}"

    def _format_utc_offset(self, time_s: float) -> str:
        return _format_utc_offset_of(self.to_local_datetime(time_s))

    @property
    def _has_one_utc_offset(self) -> bool:
        return self._format_utc_offset(0.0) == self._format_utc_offset(self.duration_s)

    @property
    def _is_within_one_day(self) -> bool:
        return self.to_local_datetime(0.0).date() == self.to_local_datetime(self.duration_s).date()


def _format_utc_offset_of(local_time: datetime) -> str:
    text = f"{local_time:%z}"
    return f"{text[:3]}:{text[3:5]}"


def format_duration(duration_s: float) -> str:
    """Format a duration in a suitable unit."""
    if duration_s < 2 * _MINUTE_S:
        return f"{duration_s:.0f} s"
    if duration_s < 2 * _HOUR_S:
        return f"{duration_s / _MINUTE_S:.0f} min"
    return f"{duration_s / _HOUR_S:.1f} h"


def _format_elapsed_time(elapsed_s: float) -> str:
    sign, whole = ("-" if elapsed_s < -0.5 else ""), round(abs(elapsed_s))
    return f"{sign}{whole // _HOUR_S}:{whole // _MINUTE_S % 60:02d}:{whole % 60:02d}"
