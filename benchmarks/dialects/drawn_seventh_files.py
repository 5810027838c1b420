"""Dialects of strangers, drawn while the reader was frozen at e6cd918e: things beside the drive."""

from typing import Final

import numpy as np

from benchmarks.dialects.dialect_file import (
    CLOCK,
    DRIVE,
    F_N,
    KMH,
    ROWS,
    SI,
    T0_NS,
    T_S,
    V_KMH,
    V_M_S,
    DialectFile,
    Floats,
    Style,
    as_integers,
    stamps,
)

_RANDOM: Final = np.random.default_rng(71)


def _about(mean: float, width: float) -> Floats:
    """Readings that wander about a mean: wind, brakes, a winch."""
    return mean + width * np.sin(T_S / 7.0) + _RANDOM.normal(0, width / 20, ROWS)


def _exports() -> list[DialectFile]:
    """Exporters that no earlier set has."""
    nanoseconds = [str(T0_NS + k * 20_000_000) for k in range(ROWS)]
    return [
        DialectFile(
            "Tektronix MSO: Labels above TIME,CH1,CH2",
            Style(digits=6).table(
                [T_S, DRIVE["volt"], F_N / 1e3],
                ["Model,MSO58,", "Firmware Version,2.6.42", "", "Waveform Type,ANALOG,",
                 "Point Format,Y,", "Horizontal Units,s,", "Sample Interval,2.0E-2,",
                 "Record Length,4000,", "Zero Index,0,", "Vertical Units,V,V", "", "Labels,,",
                 "TIME,CH1,CH2"],
            ),
            {"volt": ("CH1", SI)},
            channels={"speed_x_m_s": 'field = "CH1"\nscale = 10.0',
                      "force_x_N": 'field = "CH2"\nscale = 1000.0'},
        ),
        DialectFile(
            "AirData: time(millisecond), datetime(utc), speed(mph)",
            Style(digits=4).table(
                [as_integers(T_S, 1000), stamps("%Y-%m-%d %H:%M:%S"), V_M_S / 0.44704, F_N],
                ["time(millisecond),datetime(utc),speed(mph),tow_force(N)"],
            ),
            {"F": ("tow_force(N)", SI)},
        ),
        DialectFile(
            "Influx CLI: name, time in ns",
            Style(digits=4).table(
                [["loader"] * ROWS, nanoseconds, F_N, V_KMH],
                ["name,time,force_N,speed_kmh"],
            ),
            {"F": ("force_N", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "AdvantageScope: paths of a robot's table",
            Style(digits=4).table(
                [T_S + 3.2, V_M_S, F_N],
                ["Timestamp,/Drive/SpeedMetersPerSec,/Drive/ForceNewtons"],
            ),
            {"F": ("/Drive/ForceNewtons", SI)}, t0_ns=3_200_000_000,
            units={"/Drive/SpeedMetersPerSec": 'unit = "m/s"', "/Drive/ForceNewtons": 'unit = "N"'},
        ),
        DialectFile(
            "ThingSpeak: created_at to the second, field1, field2",
            Style(digits=4).table(
                [stamps("%Y-%m-%d %H:%M:%S UTC"), as_integers(np.arange(ROWS)), V_KMH, F_N],
                ["created_at,entry_id,field1,field2"],
            ),
            {"F": ("field2", SI)}, keys=("log.rate_hz=50",),
            channels={"speed_x_m_s": 'field = "field1"\nunit = "km/h"',
                      "force_x_N": 'field = "field2"'},
        ),
        DialectFile(
            "Node-RED: payload.ts in ms since 1970",
            Style(digits=4).table(
                [as_integers(T_S + T0_NS / 1e9, 1000), V_KMH, F_N],
                ["payload.ts,payload.speed_kmh,payload.pull_N"],
            ),
            {"F": ("payload.pull_N", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Greek", Style(";", ",", 4).table(
                [T_S, V_KMH, F_N], ["Χρόνος (s);Ταχύτητα (km/h);Δύναμη (N)"]
            ),
            {"F": ("Δύναμη (N)", SI)},
        ),
        DialectFile(
            "Indonesian: detik, km/jam",
            Style(";", ",", 4).table(
                [T_S, V_KMH, F_N], ["Waktu (detik);Kecepatan (km/jam);Gaya (N)"]
            ),
            {"F": ("Gaya (N)", SI)},
            channels={"speed_x_m_s": 'field = "Kecepatan (km/jam)"\nunit = "km/h"',
                      "force_x_N": 'field = "Gaya (N)"'},
        ),
        DialectFile(
            "Croatian: vrijeme, brzina, sila; the day before the time, a dot behind the year",
            Style(";", ",", 4).table(
                [[f"{c:%d.%m.%Y.} {c:%H:%M:%S},{c.microsecond // 1000:03d}" for c in CLOCK],
                 V_KMH, F_N],
                ["Vrijeme;Brzina (km/h);Sila (N)"],
            ),
            {"F": ("Sila (N)", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Bulgarian in cp1251",
            Style(";", ",", 4, encoding="cp1251").table(
                [T_S, V_KMH, F_N], ["Време (с);Скорост (км/ч);Сила (Н)"]
            ),
            {"F": ("Сила (Н)", SI)}, keys=("log.encoding=cp1251",),
        ),
        DialectFile(
            "full-width digits in Shift-JIS",
            Style(encoding="cp932").table(
                [[f"{x:.4f}".translate(_WIDE) for x in each] for each in (T_S, V_KMH, F_N)],
                ["時間(秒),速度(km/h),けん引力(N)"],
            ),
            {"F": ("けん引力(N)", SI)}, keys=("log.encoding=cp932",),
        ),
    ]  # fmt: skip


_WIDE: Final = {ord(c): chr(ord(c) + 0xFEE0) for c in "0123456789.-"}


def _others() -> list[DialectFile]:
    """A quantity that is not the machine's own stands beside what is."""
    torque, rpm = DRIVE["motor_torque"], DRIVE["motor_rpm"]
    head = "Time [s],Motor torque [Nm],Motor speed [rpm]"

    def beside(name: str, column: str, values: Floats) -> DialectFile:
        return DialectFile(
            f"beside a motor's torque and turns: {name}",
            Style(digits=4).table([T_S, torque, rpm, values], [f"{head},{column}"]),
            {"motor_torque": ("Motor torque [Nm]", SI)},
        )  # fmt: skip

    return [
        beside("the wind's speed", "Wind speed [m/s]", _about(4.0, 2.0)),
        beside("the brakes' force", "Brake force [kN]", _about(2.0, 1.5)),
        beside("a wheel's load", "Wheel load [kN]", _about(12.0, 1.0)),
        beside("a hoist's speed", "Hoist speed [m/min]", _about(3.0, 3.0)),
        beside("the force at a pedal", "Pedal force (N)", _about(40.0, 30.0)),
        beside("the cylinder's force", "Cylinder force [kN]", _about(30.0, 20.0)),
        beside("the steering's torque", "Steering torque [Nm]", _about(0.0, 5.0)),
        beside("the belt's speed", "Conveyor belt speed [m/s]", _about(1.2, 0.1)),
        beside("a fan's turns", "Fan speed [rpm]", _about(1800.0, 200.0)),
        beside("vertical speed", "Vertical speed [m/s]", _about(0.0, 0.1)),
        beside("side force", "Lateral force [N]", _about(0.0, 300.0)),
        beside("the accelerator", "Accelerator pedal [%]", _about(40.0, 30.0)),
        beside("grip", "Gripper force [N]", _about(60.0, 10.0)),
        beside("a pump's turns", "Pump speed [1/min]", _about(2000.0, 100.0)),
    ]


def _doubts() -> list[DialectFile]:
    """Statements that contradict each other, or that are none."""
    third = DRIVE["left"] * 2 / 3
    return [
        DialectFile(
            "kilograms of pull",
            Style(digits=4).table(
                [T_S, V_KMH, F_N / 9.80665], ["Time (s),Speed (km/h),Pull (kg)"]
            ),
            {"v": ("Speed (km/h)", KMH)},
            channels={"force_x_N": 'field = "Pull (kg)"\nscale = 9.80665'},
        ),
        DialectFile(
            "the name's unit is not that of the row of units",
            Style(";", digits=5).table(
                [T_S, V_M_S, F_N], ["time_s;speed_kmh;force_N", "s;m/s;N"]
            ),
            {"F": ("force_N", SI)}, keys=("log.units_row=2",),
        ),
        DialectFile(
            "a right wheel alone, by one letter",
            Style(digits=4).table(
                [T_S, V_M_S, F_N], ["Time (s),v_R (m/s),F (N)"],
            ),
            {"F": ("F (N)", SI)}, channels={"speed_x_m_s": 'field = "v_R (m/s)"'},
        ),
        DialectFile(
            "three wheels' torques",
            Style(digits=4).table(
                [T_S, V_KMH, third, third, third],
                ["Time (s),Speed (km/h),Torque FL (Nm),Torque FR (Nm),Torque rear (Nm)"],
            ),
            {"v": ("Speed (km/h)", KMH)},
            channels={
                "fl_N_m": 'field = "Torque FL (Nm)"', "fr_N_m": 'field = "Torque FR (Nm)"',
                "rear_N_m": 'field = "Torque rear (Nm)"',
                "force_x_N": 'derive = "(fl_N_m + fr_N_m + rear_N_m) / wheel_radius_m"',
            },
        ),
        DialectFile(
            "ticks of a tenth of a millisecond, beside an accelerometer",
            Style(digits=4).table(
                [as_integers(T_S, 10_000), V_M_S, DRIVE["a"], F_N],
                ["Time,Speed (m/s),Acceleration X (m/s²),Force (N)"],
            ),
            {"F": ("Force (N)", SI)}, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "seconds by the name, milliseconds by the numbers, beside an accelerometer",
            Style(digits=4).table(
                [as_integers(T_S, 1000), V_M_S, DRIVE["a"], F_N],
                ["time_s,speed_m_s,Longitudinal acceleration (m/s²),force_N"],
            ),
            {"F": ("force_N", SI)}, keys=("log.time=time_s", "log.time_unit=ms"),
        ),
    ]  # fmt: skip


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_exports(), *_others(), *_doubts()]
