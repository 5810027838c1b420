"""Dialects drawn while the reader was frozen at 545e9c56: units, signs and pairs of columns."""

from datetime import timedelta
from typing import Final

from benchmarks.dialects.dialect_file import (
    BEGIN,
    DRIVE,
    KMH,
    POLE_PAIRS,
    RADIUS_M,
    RATE_HZ,
    ROWS,
    SI,
    DialectFile,
    Style,
    as_integers,
    stamps,
)

_T: Final = DRIVE["t"]
_V: Final = DRIVE["v"]
_F: Final = DRIVE["F"]
_KMH: Final = _V * KMH
_HEAD: Final = "Speed (km/h),Force (N)"
_FIELDS: Final = {"F": ("Force (N)", SI)}


def _clocks() -> list[DialectFile]:
    clock = [BEGIN + timedelta(seconds=k / RATE_HZ) for k in range(ROWS)]
    irig = [f"{c:%j:%H:%M:%S}.{c.microsecond // 1000:03d}" for c in clock]
    ordinal = [f"{c:%Y-%jT%H:%M:%S}.{c.microsecond // 1000:03d}Z" for c in clock]
    return [
        DialectFile(
            "hours in decimals",
            Style().table([[f"{t / 3600:.9f}" for t in _T], _KMH, _F], ["Time [h]," + _HEAD]),
            _FIELDS,
        ),
        DialectFile(
            "hundredths of a second",
            Style().table([as_integers(_T, 100), _KMH, _F], ["Time [cs]," + _HEAD]),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "decimal days",
            Style().table([[f"{t / 86400:.11f}" for t in _T], _KMH, _F], ["Time (days)," + _HEAD]),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "IRIG: the day of the year before the clock",
            Style().table([irig, _KMH, _F], ["IRIG Time," + _HEAD]),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "ISO with the day of the year",
            Style().table([ordinal, _KMH, _F], ["time," + _HEAD]),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "a clock with hyphens",
            Style().table([stamps("%H-%M-%S.%3f"), _KMH, _F], ["time," + _HEAD]),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
    ]  # fmt: skip


def _units() -> list[DialectFile]:
    words = ["km/h"] * ROWS, ["N"] * ROWS
    torque = DRIVE["left"] * 2
    return [
        DialectFile(
            "tonnes of pull",
            Style(digits=6).table([_T, _KMH, _F / 9806.65], ["Time (s),Speed (km/h),Pull (t)"]),
            {"v": ("Speed (km/h)", KMH)},
            channels={"force_x_N": 'field = "Pull (t)"\nscale = 9806.65'},
        ),
        DialectFile(
            "wheel torque in kilogram-metres",
            Style(digits=5).table(
                [_T, _KMH, torque / 9.80665], ["Time (s),Speed (km/h),Wheel Torque (kg·m)"]
            ),
            {"v": ("Speed (km/h)", KMH)},
            channels={"wheel_torque_N_m": 'field = "Wheel Torque (kg·m)"\nscale = 9.80665',
                      "force_x_N": 'derive = "wheel_torque_N_m / wheel_radius_m"'},
        ),
        DialectFile(
            "wheel power in hp, miles an hour",
            Style(digits=5).table(
                [_T, _V / 0.44704, _F * _V / 745.69987], ["Time (s),Speed (mph),Wheel Power (hp)"]
            ),
            {"v": ("Speed (mph)", 1 / 0.44704)},
        ),
        DialectFile(
            "thousands of pounds",
            Style(digits=6).table(
                [_T, _F / 4448.2216, _V / 0.3048], ["Time (s),Drawbar (klbf),Speed (ft/s)"]
            ),
            {"v": ("Speed (ft/s)", 1 / 0.3048)},
            channels={"force_x_N": 'field = "Drawbar (klbf)"\nscale = 4448.2216'},
        ),
        DialectFile(
            "a unit in the column behind each",
            Style().table([_T, _KMH, words[0], _F, words[1]], ["time_s,Speed,Unit,Force,Unit"]),
            {"F": ("Force", SI)}, units={"Speed": 'unit = "km/h"', "Force": 'unit = "N"'},
        ),
        DialectFile(
            "speed times a hundred by its name",
            Style().table([_T, as_integers(_KMH, 100), _F], ["time_s,speed_kmh_x100,force_N"]),
            {"F": ("force_N", SI)},
            channels={"speed_x_m_s": 'field = "speed_kmh_x100"\nscale = 0.0027777778'},
        ),
        DialectFile(
            "wheel turns in Hz",
            Style(digits=6).table(
                [_T, _V / (2 * 3.141592653589793 * RADIUS_M), _F],
                ["Time (s),Wheel Frequency (Hz),Force (N)"],
            ),
            _FIELDS,
            channels={"wheel_rpm": 'field = "Wheel Frequency (Hz)"\nscale = 60.0',
                      "speed_x_m_s": 'derive = "wheel_rpm * wheel_radius_m"'},
        ),
    ]  # fmt: skip


def _pairs() -> list[DialectFile]:
    erpm = DRIVE["motor_rpm"] * POLE_PAIRS
    half = DRIVE["motor_torque"] / 2
    glued = [f"{t:8.3f}{v:10.4f}{f:10.3f}" for t, v, f in zip(_T, _V, _F, strict=True)]
    return [
        DialectFile(
            "compression is positive",
            Style().table([_T, _KMH, -_F], ["Time (s)," + _HEAD]),
            {"v": ("Speed (km/h)", KMH)}, units={"Force (N)": "scale = -1"},
        ),
        DialectFile(
            "one speed in two units",
            Style().table([_T, _V, _KMH, _F], ["Time (s),Speed (m/s)," + _HEAD]), _FIELDS,
        ),
        DialectFile(
            "a motor for each side",
            Style().table(
                [_T, _KMH, half, half],
                ["Time (s),Speed (km/h),Left Motor Torque (Nm),Right Motor Torque (Nm)"],
            ),
            {"v": ("Speed (km/h)", KMH)},
            channels={
                "motor_left_N_m": 'field = "Left Motor Torque (Nm)"',
                "motor_right_N_m": 'field = "Right Motor Torque (Nm)"',
                "force_x_N": 'derive = "(motor_left_N_m + motor_right_N_m) * 9.665'
                             ' / wheel_radius_m"',
            },
        ),
        DialectFile(
            "two VESCs",
            Style().table(
                [_T, erpm, erpm, DRIVE["current"] / 2, DRIVE["current"] / 2],
                ["time_s,erpm_1,erpm_2,current_motor_1,current_motor_2"],
            ),
            {"current": ("current_motor_1", 0.5)},
            channels={
                "motor_current_A": 'field = "current_motor_1"',
                "second_A": 'field = "current_motor_2"',
                "force_x_N": 'derive = "(motor_current_A + second_A) * 0.12 [N*m/A] * 9.665'
                             ' / wheel_radius_m"',
            },
        ),
        DialectFile(
            "groups over the names: front and rear",
            Style().table(
                [_T, _KMH, DRIVE["left"], DRIVE["right"]],
                [",,Front,Rear", "Time (s),Speed (km/h),Torque (Nm),Torque (Nm)"],
            ),
            {"v": ("Speed (km/h)", KMH)},
        ),
        DialectFile(
            "carets between", Style("^").table([_T, _KMH, _F], ["time_s^speed_kmh^force_N"]),
            {"F": ("force_N", SI)}, keys=("log.separator=^",),
        ),
        DialectFile(
            "columns that touch where a number is long",
            ("\n".join(["  TIME_S SPEED_M_S   FORCE_N", *glued]) + "\n").encode(),
            {"F": ("FORCE_N", SI)}, suffix=".txt",
        ),
    ]  # fmt: skip


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_clocks(), *_units(), *_pairs()]
