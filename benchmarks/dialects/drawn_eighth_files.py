"""Dialects of strangers, drawn while the reader was frozen at c194f680."""

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
    Style,
    as_integers,
    stamps,
)

_G: Final = 9.80665
_BY_MOTOR: Final = {
    "speed_x_m_s": 'derive = "motor_rpm / 9.665 * wheel_radius_m"',
    "force_x_N": 'derive = "torque_percent * 23.9 [N*m] * 9.665 / wheel_radius_m"',
}


def _instruments() -> list[DialectFile]:
    """Scopes, loggers, buses."""
    return [
        DialectFile(
            "Micsig: Time(S), CH1(V)",
            Style(digits=6).table(
                [T_S, DRIVE["volt"], F_N / 1e3], ["Time(S),CH1(V),CH2(V)"]
            ),
            {"volt": ("CH1(V)", SI)},
            channels={"speed_x_m_s": 'field = "CH1(V)"\nscale = 10.0',
                      "force_x_N": 'field = "CH2(V)"\nscale = 1000.0'},
        ),
        DialectFile(
            "SignalExpress: Time (s) - Speed, Amplitude - Speed",
            Style(digits=5).table(
                [T_S, V_M_S, T_S, F_N],
                ["Time (s) - Speed (m/s),Amplitude - Speed (m/s),Time (s) - Force (N),"
                 "Amplitude - Force (N)"],
            ),
            {"F": ("Amplitude - Force (N)", SI)}, topic={"F": "table/2"},
        ),
        DialectFile(
            "CANape: names, units, a row of groups",
            Style(";", digits=4, end="\r\n").table(
                [T_S, V_KMH, F_N], ["time;VehSpd;DrwbrF", "s;km/h;N", "XCP:1;XCP:1;XCP:1"]
            ),
            {"F": ("DrwbrF", SI)},
        ),
        DialectFile(
            "German exponents with a comma",
            ("\r\n".join([
                "Zeit [s]\tGeschw. [km/h]\tKraft [kN]",
                *(f"{t:.5E}\t{v:.5E}\t{f / 1e3:.5E}".replace(".", ",")
                  for t, v, f in zip(T_S, V_KMH, F_N, strict=True)),
            ]) + "\r\n").encode(),
            {"v": ("Geschw. [km/h]", KMH)}, suffix=".txt",
        ),
        DialectFile(
            "SparkFun: year to second, nanoseconds apart",
            Style(digits=4).table(
                [[f"{c.year}" for c in CLOCK], [f"{c.month}" for c in CLOCK],
                 [f"{c.day}" for c in CLOCK], [f"{c.hour}" for c in CLOCK],
                 [f"{c.minute}" for c in CLOCK], [f"{c.second}" for c in CLOCK],
                 [f"{c.microsecond * 1000}" for c in CLOCK], V_M_S * 1000, F_N],
                ["Year,Month,Day,Hour,Minute,Second,Nano,gSpeed (mm/s),Load (N)"],
            ),
            {"F": ("Load (N)", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "lap time beside the time",
            Style(digits=4).table(
                [T_S, T_S % 16.0, V_KMH, F_N], ["Time (s),Lap Time (s),Speed (km/h),Pull (N)"]
            ),
            {"F": ("Pull (N)", SI)},
        ),
        DialectFile(
            "tracks",
            Style(digits=4).table(
                [T_S, V_M_S, V_M_S, DRIVE["left"], DRIVE["right"]],
                ["Time (s),Left Track Speed (m/s),Right Track Speed (m/s),"
                 "Left Sprocket Torque (Nm),Right Sprocket Torque (Nm)"],
            ),
            {"left": ("Left Sprocket Torque (Nm)", SI)},
        ),
    ]  # fmt: skip


def _apps() -> list[DialectFile]:
    """Apps and trackers."""
    gps = [f"{c:%a %b %d %H:%M:%S} GMT+00:00 {c.year}" for c in CLOCK]
    zeros = ["0"] * ROWS
    return [
        DialectFile(
            "Torque: GPS Time, Device Time, Meters/second, G(x)",
            Style(digits=4).table(
                [gps, stamps("%d-%b-%Y %H:%M:%S.%3f"), V_M_S, DRIVE["a"] / _G, zeros,
                 DRIVE["az"] / _G, V_KMH, F_N],
                ["GPS Time, Device Time, GPS Speed (Meters/second), G(x), G(y), G(z), "
                 "Speed (OBD)(km/h), Tow(N)"],
            ),
            {"F": ("Tow(N)", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "RaceBox: keys above, GForceX, a speed without a unit",
            Style(digits=4).table(
                [as_integers(np.arange(1, ROWS + 1)), stamps("%Y-%m-%dT%H:%M:%S.%3fZ"), V_KMH,
                 DRIVE["a"] / _G, zeros, DRIVE["az"] / _G, F_N],
                ["Format,RaceBox CSV", "Data Source,RaceBox Mini 1234567890", "Track,Test track",
                 "", "Record,Time,Speed,GForceX,GForceY,GForceZ,Pull (N)"],
            ),
            {"F": ("Pull (N)", SI)}, t0_ns=T0_NS, units={"Speed": 'unit = "km/h"'},
        ),
        DialectFile(
            "Chronograf: means of a field",
            Style(digits=4).table(
                [[s.replace(".000Z", "Z") for s in stamps("%Y-%m-%dT%H:%M:%S.%3fZ")], V_KMH, F_N],
                ['"time","loader.mean_speed_kmh","loader.mean_force_N"'],
            ),
            {"F": ("loader.mean_force_N", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Numbers: the table's name above",
            Style(";", ",", 4).table(
                [T_S, V_KMH, F_N], ["Tabelle 1", "Zeit (s);Tempo (km/h);Zugkraft (N)"]
            ),
            {"F": ("Zugkraft (N)", SI)},
        ),
    ]  # fmt: skip


def _drives() -> list[DialectFile]:
    """Servo drives and controllers."""
    rpm, percent = DRIVE["motor_rpm"], DRIVE["motor_torque"] / 23.9 * 100
    return [
        DialectFile(
            "Control Techniques: DIN slashes, feedback, %",
            Style(";", ",", 3).table(
                [T_S * 1000, rpm, percent], ["Time/ms;Speed Feedback/rpm;Torque Feedback/%"]
            ),
            {"motor_rpm": ("Speed Feedback/rpm", SI)},
        ),
        DialectFile(
            "SigmaWin: min-1, a torque reference alone",
            Style(digits=3, end="\r\n").table(
                [T_S * 1000, rpm, percent],
                ["Time[ms],Feedback Speed[min-1],Torque Reference[%]"],
            ),
            {"motor_rpm": ("Feedback Speed[min-1]", SI)},
            channels={"torque_percent": 'field = "Torque Reference[%]"',
                      "motor_rpm": 'field = "Feedback Speed[min-1]"', **_BY_MOTOR},
        ),
        DialectFile(
            "ASDA: no time, its period above",
            Style(digits=3, end="\r\n").table(
                [as_integers(np.arange(1, ROWS + 1)), rpm, percent],
                ["Sampling Period,20,ms", "No,Ch1:Motor Speed[rpm],Ch2:Torque[%]"],
            ),
            {"motor_rpm": ("Ch1:Motor Speed[rpm]", SI)}, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "Sysmac: axis variables",
            Style(digits=4).table(
                [T_S * 1000, V_M_S * 1000, percent],
                ["Time(ms),MC_Axis000.Act.Vel(mm/s),MC_Axis000.Act.Trq(%)"],
            ),
            {}, channels={"torque_percent": 'field = "MC_Axis000.Act.Trq(%)"',
                          "force_x_N": _BY_MOTOR["force_x_N"]},
        ),
        DialectFile(
            "InTouch: $Date, $Time, tags",
            Style(digits=4, end="\r\n").table(
                [stamps("%m/%d/%Y"), stamps("%H:%M:%S.%3f"), V_KMH, F_N],
                ["$Date,$Time,LDR_SPEED_KMH,LDR_PULL_N"],
            ),
            {"F": ("LDR_PULL_N", SI)}, t0_ns=T0_NS,
        ),
    ]  # fmt: skip


def _sheets() -> list[DialectFile]:
    """Spreadsheets of other locales."""
    clock = [f"0:{int(t // 60):02d}:{t % 60:06.3f}".replace(".", ",") for t in T_S]
    thousands = [f"{f:,.0f}".replace(",", ".") for f in F_N * 1000]
    return [
        DialectFile(
            "Italian: forza di traino",
            Style(";", ",", 4).table(
                [T_S, V_KMH, F_N], ["Tempo (s);Velocità (km/h);Forza di traino (N)"]
            ),
            {"F": ("Forza di traino (N)", SI)},
        ),
        DialectFile(
            "Norwegian: fart",
            Style(";", ",", 4).table([T_S, V_KMH, F_N], ["Tid (s);Fart (km/t);Kraft (N)"]),
            {"F": ("Kraft (N)", SI)},
        ),
        DialectFile(
            "Slovak: 0:00:01,020",
            Style(";", ",", 4).table(
                [clock, V_KMH, F_N], ["Čas;Rýchlosť (km/h);Ťahová sila (N)"]
            ),
            {"F": ("Ťahová sila (N)", SI)},
        ),
        DialectFile(
            "Hebrew", Style(digits=4).table([T_S, V_KMH, F_N], ["זמן (s),מהירות (km/h),כוח (N)"]),
            {"F": ("כוח (N)", SI)},
        ),
        DialectFile(
            "Portuguese of Brazil: millinewtons by thousands with points",
            Style(";", ",", 4).table(
                [T_S, V_KMH, thousands], ["Tempo (s);Velocidade (km/h);Força (mN)"]
            ),
            {"v": ("Velocidade (km/h)", KMH)},
            channels={"force_x_N": 'field = "Força (mN)"\nscale = 0.001'},
        ),
        DialectFile(
            "pounds of pull",
            Style(digits=4).table(
                [T_S, V_M_S / 0.44704, F_N / 4.4482216], ["Time (sec),Speed (MPH),Pull (lbs)"]
            ),
            {"v": ("Speed (MPH)", 1 / 0.44704)},
            channels={"force_x_N": 'field = "Pull (lbs)"\nunit = "lbf"'},
        ),
    ]  # fmt: skip


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_instruments(), *_apps(), *_drives(), *_sheets()]
