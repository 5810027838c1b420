"""Dialects drawn while the reader was frozen at 545e9c56: units, signs and pairs of columns."""

from typing import Final

from benchmarks.dialects.dialect_file import (
    CLOCK,
    DRIVE,
    F_N,
    KMH,
    POLE_PAIRS,
    RADIUS_M,
    ROWS,
    SI,
    T_S,
    V_KMH,
    V_M_S,
    DialectFile,
    Style,
    as_integers,
    stamps,
)

_HEAD: Final = "Speed (km/h),Force (N)"
_FIELDS: Final = {"F": ("Force (N)", SI)}


def _clocks() -> list[DialectFile]:
    irig = [f"{c:%j:%H:%M:%S}.{c.microsecond // 1000:03d}" for c in CLOCK]
    ordinal = [f"{c:%Y-%jT%H:%M:%S}.{c.microsecond // 1000:03d}Z" for c in CLOCK]
    return [
        DialectFile(
            "hours in decimals",
            Style().table([[f"{t / 3600:.9f}" for t in T_S], V_KMH, F_N], ["Time [h]," + _HEAD]),
            _FIELDS,
        ),
        DialectFile(
            "hundredths of a second",
            Style().table([as_integers(T_S, 100), V_KMH, F_N], ["Time [cs]," + _HEAD]),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "decimal days",
            Style().table(
                [[f"{t / 86400:.11f}" for t in T_S], V_KMH, F_N], ["Time (days)," + _HEAD]
            ),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "IRIG: the day of the year before the clock",
            Style().table([irig, V_KMH, F_N], ["IRIG Time," + _HEAD]),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "ISO with the day of the year",
            Style().table([ordinal, V_KMH, F_N], ["time," + _HEAD]),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "a clock with hyphens",
            Style().table([stamps("%H-%M-%S.%3f"), V_KMH, F_N], ["time," + _HEAD]),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
    ]  # fmt: skip


def _units() -> list[DialectFile]:
    words = ["km/h"] * ROWS, ["N"] * ROWS
    torque = DRIVE["left"] * 2
    return [
        DialectFile(
            "tonnes of pull",
            Style(digits=6).table([T_S, V_KMH, F_N / 9806.65], ["Time (s),Speed (km/h),Pull (t)"]),
            {"v": ("Speed (km/h)", KMH)},
            channels={"force_x_N": 'field = "Pull (t)"\nscale = 9806.65'},
        ),
        DialectFile(
            "wheel torque in kilogram-metres",
            Style(digits=5).table(
                [T_S, V_KMH, torque / 9.80665], ["Time (s),Speed (km/h),Wheel Torque (kg·m)"]
            ),
            {"v": ("Speed (km/h)", KMH)},
            channels={"wheel_torque_N_m": 'field = "Wheel Torque (kg·m)"\nscale = 9.80665',
                      "force_x_N": 'derive = "wheel_torque_N_m / wheel_radius_m"'},
        ),
        DialectFile(
            "wheel power in hp, miles an hour",
            Style(digits=5).table(
                [T_S, V_M_S / 0.44704, F_N * V_M_S / 745.69987],
                ["Time (s),Speed (mph),Wheel Power (hp)"],
            ),
            {"v": ("Speed (mph)", 1 / 0.44704)},
        ),
        DialectFile(
            "thousands of pounds",
            Style(digits=6).table(
                [T_S, F_N / 4448.2216, V_M_S / 0.3048], ["Time (s),Drawbar (klbf),Speed (ft/s)"]
            ),
            {"v": ("Speed (ft/s)", 1 / 0.3048)},
            channels={"force_x_N": 'field = "Drawbar (klbf)"\nscale = 4448.2216'},
        ),
        DialectFile(
            "a unit in the column behind each",
            Style().table([T_S, V_KMH, words[0], F_N, words[1]], ["time_s,Speed,Unit,Force,Unit"]),
            {"F": ("Force", SI)}, units={"Speed": 'unit = "km/h"', "Force": 'unit = "N"'},
        ),
        DialectFile(
            "speed times a hundred by its name",
            Style().table([T_S, as_integers(V_KMH, 100), F_N], ["time_s,speed_kmh_x100,force_N"]),
            {"F": ("force_N", SI)},
            channels={"speed_x_m_s": 'field = "speed_kmh_x100"\nscale = 0.0027777778'},
        ),
        DialectFile(
            "wheel turns in Hz",
            Style(digits=6).table(
                [T_S, V_M_S / (2 * 3.141592653589793 * RADIUS_M), F_N],
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
    glued = [f"{t:8.3f}{v:10.4f}{f:10.3f}" for t, v, f in zip(T_S, V_M_S, F_N, strict=True)]
    return [
        DialectFile(
            "compression is positive",
            Style().table([T_S, V_KMH, -F_N], ["Time (s)," + _HEAD]),
            {"v": ("Speed (km/h)", KMH)}, units={"Force (N)": "scale = -1"},
        ),
        DialectFile(
            "one speed in two units",
            Style().table([T_S, V_M_S, V_KMH, F_N], ["Time (s),Speed (m/s)," + _HEAD]), _FIELDS,
        ),
        DialectFile(
            "a motor for each side",
            Style().table(
                [T_S, V_KMH, half, half],
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
                [T_S, erpm, erpm, DRIVE["current"] / 2, DRIVE["current"] / 2],
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
                [T_S, V_KMH, DRIVE["left"], DRIVE["right"]],
                [",,Front,Rear", "Time (s),Speed (km/h),Torque (Nm),Torque (Nm)"],
            ),
            {"v": ("Speed (km/h)", KMH)},
        ),
        DialectFile(
            "carets between", Style("^").table([T_S, V_KMH, F_N], ["time_s^speed_kmh^force_N"]),
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
