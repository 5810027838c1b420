"""Dialects of strangers, drawn while the reader was frozen at 0a84e093: scopes, phones, motors."""

from typing import Final

import numpy as np

from benchmarks.dialects.dialect_file import (
    CLOCK,
    DRIVE,
    F_N,
    GEAR,
    KMH,
    MIDNIGHT_NS,
    RADIUS_M,
    RATE_HZ,
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
_ZEROS: Final = ["0"] * ROWS


def _scopes() -> list[DialectFile]:
    """Oscilloscopes, data acquisition, testing machines."""
    volt = DRIVE["volt"]
    numbers = as_integers(np.arange(1, ROWS + 1))
    scale = {"speed_x_m_s": 'field = "CH1"\nscale = 10.0',
             "force_x_N": 'field = "CH2"\nscale = 1000.0'}  # fmt: skip
    return [
        DialectFile(
            "Siglent: keys above, Source and Second,Volt,Volt",
            Style(digits=6, end="\r\n").table(
                [T_S - 1.0, volt, F_N / 1e3],
                ["Record Length,Analog:4000", "Sample Interval,Analog:2.000000000E-02",
                 "Vertical Units,CH1:V,CH2:V", "Vertical Scale,CH1:5.00E-01,CH2:1.00E+00",
                 "Vertical Offset,CH1:0.00E+00,CH2:0.00E+00", "Horizontal Units,S",
                 "Horizontal Scale,8.00E+00", "Model Number,SDS2104X Plus",
                 "Serial Number,SDS2PDDD6R0000", "Software Version,1.3.9R10",
                 "Source,CH1,CH2", "Second,Volt,Volt"],
            ),
            {"volt": ("CH1", SI)}, t0_ns=-(10**9), channels=scale,
        ),
        DialectFile(
            "Digilent WaveForms: comments above, Channel 1 (V)",
            Style(digits=6).table(
                [T_S, volt, F_N / 1e3],
                ["#Digilent WaveForms Oscilloscope Acquisition",
                 "#Device Name: Discovery2", "#Serial Number: SN:210321A00000",
                 "#Date Time: 2026-11-13 08:15:30.001", "#Sample rate: 50Hz", "#Samples: 4000",
                 "#Trigger: Source: None Type: Edge Condition: Rising", "",
                 "Time (s),Channel 1 (V),Channel 2 (V)"],
            ),
            {"volt": ("Channel 1 (V)", SI)},
            channels={"speed_x_m_s": 'field = "Channel 1 (V)"\nscale = 10.0',
                      "force_x_N": 'field = "Channel 2 (V)"\nscale = 1000.0'},
        ),
        DialectFile(
            "dSPACE ControlDesk: each row begins with a word",
            Style(digits=5).table(
                [["trace_values"] * ROWS, T_S, V_M_S, F_N],
                ["type,dSPACE CSV", "creation_date,2026-11-13T08:15:30",
                 "path,,Model Root/Vehicle/v,Model Root/Hitch/F",
                 "trace_name,Time,v_x,F_hitch", "trace_unit,s,m/s,N"],
            ),
            {"F": ("F_hitch", SI)},
        ),
        DialectFile(
            "PASCO Capstone: Run #1 behind each name",
            Style(digits=4).table(
                [T_S, F_N, V_M_S],
                ['"Time (s) Run #1","Force (N) Run #1","Velocity (m/s) Run #1"'],
            ),
            {"F": ("Force (N) Run #1", SI)},
        ),
        DialectFile(
            "Mark-10 MESUR: reading, load in lbF, travel in inches",
            Style(digits=5, end="\r\n").table(
                [numbers, F_N / 4.4482216, DRIVE["x"] / 0.0254, T_S],
                ["MESURgauge Plus,,,", "Date: 11/13/2026,,,", "Reading,Load [lbF],Travel [in],"
                 "Time [sec]"],
            ),
            {"F": ("Load [lbF]", 1 / 4.4482216)},
        ),
        DialectFile(
            "FUTEK SENSIT: date, time, elapsed, tracking value, units",
            Style(digits=4, end="\r\n").table(
                [stamps("%m/%d/%Y"), stamps("%I:%M:%S %p"), as_integers(T_S, 1000), F_N / _G,
                 ["kg"] * ROWS, V_KMH],
                ["Serial Number,900123", "Sample Rate,50", "",
                 "Date,Time,Elapsed (ms),Tracking Value,Units,Aux Speed (km/h)"],
            ),
            {"v": ("Aux Speed (km/h)", KMH)},
            channels={"force_x_N": 'field = "Tracking Value"\nunit = "kgf"'},
        ),
        DialectFile(
            "ibaAnalyzer: names and units with tabs, dots in the date",
            Style("\t", digits=4, end="\r\n").table(
                [stamps("%d.%m.%Y %H:%M:%S.%3f000"), V_KMH, F_N / 1e3],
                ["Starttime:\t13.11.2026 08:15:30.000000", "time\t[1:0] v_ist\t[1:1] F_zug",
                 "\tkm/h\tkN"],
            ),
            {"F": ("[1:1] F_zug", 1e-3)}, suffix=".txt", t0_ns=T0_NS,
        ),
    ]  # fmt: skip


def _phones() -> list[DialectFile]:
    """Telemetry apps and phones."""
    colons = [f"{c:%Y-%m-%d %H:%M:%S}:{c.microsecond // 1000:03d}" for c in CLOCK]
    clock = [f"{c:%H:%M:%S}:{c.microsecond // 1000:03d}" for c in CLOCK]
    return [
        DialectFile(
            "AndroSensor: ms since start, YYYY-MO-DD HH-MI-SS_SSS",
            Style(";", digits=4, end="\r\n").table(
                [DRIVE["a"], V_KMH, F_N / _G, as_integers(T_S, 1000), colons],
                ["LINEAR ACCELERATION X (m/s²);LOCATION Speed ( Kmh);SCALE (kgf);"
                 "Time since start in ms ;YYYY-MO-DD HH-MI-SS_SSS"],
            ),
            {"F": ("SCALE (kgf)", 1 / _G)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Physics Toolbox: a clock with a colon before the ms, gFx",
            Style(digits=4).table(
                [clock, DRIVE["a"] / _G, _ZEROS, DRIVE["az"] / _G, V_M_S, F_N],
                ["time,gFx,gFy,gFz,Speed (m/s),Load (N)"],
            ),
            {"F": ("Load (N)", SI)}, t0_ns=MIDNIGHT_NS,
        ),
        DialectFile(
            "WinDarab: xtime [s], tabs",
            Style("\t", digits=4, end="\r\n").table(
                [T_S, V_KMH, DRIVE["left"], DRIVE["right"]],
                ["# BOSCH-DARAB", "# Created: 13.11.2026",
                 "xtime [s]\tspeed [km/h]\tMtorque_l [Nm]\tMtorque_r [Nm]"],
            ),
            {"left": ("Mtorque_l [Nm]", SI)}, suffix=".txt",
        ),
        DialectFile(
            "Cosworth Pi: braces, a block of channels",
            Style("\t", digits=4, end="\r\n").table(
                [T_S, V_KMH, F_N / 1e3],
                ["PiToolboxVersionedASCIIDataSet", "Version\t2", "", "{OutingInformation}",
                 "CarName\tLoader", "FirstLapNumber\t0", "", "{ChannelBlock}",
                 "Time\tGround Speed[km/h]\tTow Force[kN]"],
            ),
            {"F": ("Tow Force[kN]", 1e-3)}, suffix=".txt",
        ),
        DialectFile(
            "OVMS: quoted metrics by dotted names",
            Style(digits=3, quote=True).table(
                [stamps("%Y-%m-%d %H:%M:%S.%3f"), V_KMH, DRIVE["motor_rpm"],
                 F_N * V_M_S / 1e3],
                ['"timestamp","v.p.speed","v.m.rpm","v.b.power"'],
            ),
            {"motor_rpm": ("v.m.rpm", SI)}, t0_ns=T0_NS,
            channels={
                "speed_x_m_s": 'field = "v.p.speed"\nunit = "km/h"',
                "power_W": 'field = "v.b.power"\nunit = "kW"',
                "force_x_N":
                    'derive = "where(abs(speed_x_m_s) > 0.3 [m/s], power_W / speed_x_m_s)"',
            },
        ),
        DialectFile(
            "Dragy: speed, g, distance, slope",
            Style(digits=4).table(
                [T_S, V_KMH, DRIVE["a"] / _G, DRIVE["x"], _ZEROS, F_N / 10],
                ["Time(s),Speed(km/h),Accel(g),Distance(m),Slope(%),Hitch(daN)"],
            ),
            {"F": ("Hitch(daN)", 0.1)},
        ),
        DialectFile(
            "OxTS: the form of the time and of the date in their names",
            Style(digits=4).table(
                [stamps("%H:%M:%S.%3f"), stamps("%d/%m/%Y"), V_M_S, F_N],
                ["Time (hh:mm:ss.000) UTC,Date (dd/mm/yyyy),Speed2D (m/s),Load (N)"],
            ),
            {"F": ("Load (N)", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "VBOX: Time (HHMMSS.SS UTC)",
            Style(digits=4).table(
                [[f"{c:%H%M%S}.{c.microsecond // 10000:02d}" for c in CLOCK], V_KMH, F_N],
                ["Time (HHMMSS.SS UTC),Velocity (km/h),Pull (N)"],
            ),
            {"F": ("Pull (N)", SI)}, t0_ns=MIDNIGHT_NS,
        ),
        DialectFile(
            "Qstarz: UTC and local time, the milliseconds apart, units in cells",
            Style(digits=4).table(
                [as_integers(np.arange(ROWS)), ["T"] * ROWS, stamps("%Y/%m/%d"),
                 stamps("%H:%M:%S"), stamps("%Y/%m/%d"), [s.replace("08:", "10:", 1) for s in
                 stamps("%H:%M:%S")], [f"{c.microsecond // 1000:03d}" for c in CLOCK],
                 ["SPS"] * ROWS, [f"{v:.4f} km/h" for v in V_KMH], F_N],
                ["INDEX,RCR,UTC DATE,UTC TIME,LOCAL DATE,LOCAL TIME,MS,VALID,SPEED,FORCE(N)"],
            ),
            {"F": ("FORCE(N)", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Novatel Inertial Explorer: blanks, units in brackets below",
            ("\n".join([
                "Project:     loader", "Program:     Inertial Explorer Version 8.90", "",
                "    GPSTime     Speed      Load", "      (sec)     (m/s)       (N)",
                *(f"{461_730 + t:11.3f}{v:10.4f}{f:10.2f}"
                  for t, v, f in zip(T_S, V_M_S, F_N, strict=True)),
            ]) + "\n").encode(),
            {"F": ("Load", SI)}, suffix=".txt", t0_ns=461_730 * 10**9,
        ),
    ]  # fmt: skip


def _motors() -> list[DialectFile]:
    """Motor controllers and servo drives."""
    rpm, torque = DRIVE["motor_rpm"], DRIVE["motor_torque"]
    from_motor = {
        "speed_x_m_s": 'derive = "motor_rpm / 9.665 * wheel_radius_m"',
        "force_x_N": 'derive = "motor_torque_N_m * 9.665 / wheel_radius_m"',
    }
    by_current = 'derive = "motor_current_A * 0.12 [N*m/A] * 9.665 / wheel_radius_m"'
    return [
        DialectFile(
            "Elmo: counts a second, active current",
            Style(digits=4).table(
                [T_S, rpm / 60 * 8192, DRIVE["current"]],
                ["Time [sec],Velocity [cnt/sec],Active Current [A]"],
            ),
            {"current": ("Active Current [A]", SI)},
            channels={"motor_rpm": f'field = "Velocity [cnt/sec]"\nscale = {60 / 8192!r}',
                      "motor_current_A": 'field = "Active Current [A]"',
                      "speed_x_m_s": from_motor["speed_x_m_s"], "force_x_N": by_current},
        ),
        DialectFile(
            "Copley CME: msec, actual motor velocity in rpm",
            Style(digits=4).table(
                [T_S * 1000, rpm, DRIVE["current"]],
                ["Time (msec),Actual Motor Velocity (rpm),Actual Current (A)"],
            ),
            {"motor_rpm": ("Actual Motor Velocity (rpm)", SI)},
        ),
        DialectFile(
            "SEW: percent of the rated torque, 1/min",
            Style(";", ",", 3, encoding="latin-1", end="\r\n").table(
                [T_S * 1000, rpm, torque / 23.9 * 100],
                ["Zeit [ms];Istdrehzahl [1/min];Drehmoment [% Mn]"],
            ),
            {"motor_rpm": ("Istdrehzahl [1/min]", SI)},
            channels={"motor_rpm": 'field = "Istdrehzahl [1/min]"',
                      "torque_percent": 'field = "Drehmoment [% Mn]"',
                      "speed_x_m_s": from_motor["speed_x_m_s"],
                      "force_x_N":
                          'derive = "torque_percent * 23.9 [N*m] * 9.665 / wheel_radius_m"'},
        ),
        DialectFile(
            "ABB Drive Composer: parameter numbers in the names",
            Style(digits=4).table(
                [T_S, rpm, torque],
                ["Time (s),01.01 Motor speed used (rpm),01.10 Motor torque (Nm)"],
            ),
            {"motor_torque": ("01.10 Motor torque (Nm)", SI)},
        ),
        DialectFile(
            "moteus: turns a second and N·m, no unit anywhere",
            Style(", ", digits=5).table(
                [T_S + T0_NS / 1e9, V_M_S / RADIUS_M * GEAR / (2 * np.pi), torque],
                ["timestamp, velocity, torque"],
            ),
            {"motor_torque": ("torque", SI)}, t0_ns=T0_NS,
            channels={"motor_rpm": 'field = "velocity"\nscale = 60.0',
                      "motor_torque_N_m": 'field = "torque"', **from_motor},
        ),
        DialectFile(
            "SimpleFOC monitor: tabs, no names, no time",
            Style("\t", digits=4).table([V_M_S / RADIUS_M, torque], []),
            {}, suffix=".txt", keys=("log.rate_hz=50",),
            channels={"wheel_rpm": 'field = "column 1"\nunit = "rad/s"',
                      "motor_torque_N_m": 'field = "column 2"',
                      "speed_x_m_s": 'derive = "wheel_rpm * wheel_radius_m"',
                      "force_x_N": from_motor["force_x_N"]},
        ),
        DialectFile(
            "Lenze: ratio of rated torque, hundredths of a percent",
            Style(";", digits=0, end="\r\n").table(
                [as_integers(T_S, 1000), rpm, as_integers(torque / 23.9 * 10000)],
                ["Time;Actual speed;Actual torque", "ms;rpm;0.01 %"],
            ),
            {"motor_rpm": ("Actual speed", SI)},
            channels={"torque_percent": 'field = "Actual torque"\nscale = 0.01',
                      "force_x_N":
                          'derive = "torque_percent * 23.9 [N*m] * 9.665 / wheel_radius_m"'},
        ),
    ]  # fmt: skip


def dialect_files() -> list[DialectFile]:
    """The files."""
    assert RATE_HZ == 50
    return [*_scopes(), *_phones(), *_motors()]
