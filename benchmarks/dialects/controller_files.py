"""What motor controllers and robot controllers export."""

import numpy as np

from benchmarks.dialects.dialect_file import (
    DRIVE,
    POLE_PAIRS,
    ROWS,
    SI,
    T0_NS,
    DialectFile,
    Floats,
    Style,
    as_integers,
    stamps,
)


def _controllers(d: dict[str, Floats]) -> list[DialectFile]:
    erpm = d["motor_rpm"] * POLE_PAIRS
    ms = [str(29_730_000 + round(t * 1000)) for t in d["t"]]
    return [
        DialectFile(
            "VESC Tool: ms_today and semicolons",
            Style(";", ".", 4).table(
                [ms, d["volt"], d["current"], erpm], ["ms_today;input_voltage;current_motor;erpm"]
            ),
            {"current": ("current_motor", SI), "motor_rpm": ("erpm", POLE_PAIRS)},
            t0_ns=29_730_000 * 10**6,
        ),
        DialectFile(
            "VESC: each row ends in a semicolon",
            Style(";", ".", 4, tail=";").table(
                [ms, d["current"], erpm], ["ms_today;current_motor;erpm;"]
            ),
            {"current": ("current_motor", SI)},
            t0_ns=29_730_000 * 10**6,
        ),
        DialectFile(
            "ODrive: seconds by the name",
            Style(digits=6).table(
                [d["t"], d["motor_rpm"], d["current"]],
                ["time_s,vel_estimate_rpm,iq_measured_A"],
            ),
            {"current": ("iq_measured_A", SI)},
        ),
        DialectFile(
            "Roboteq: milliseconds and tabs",
            Style("\t", ".", 1).table(
                [as_integers(d["t"], 1000), as_integers(d["motor_rpm"]), d["current"]],
                ["Time(ms)\tSpeed (RPM)\tMotor Amps"],
            ),
            {"motor_rpm": ("Speed (RPM)", SI)},
            suffix=".txt",
        ),
        DialectFile(
            "Curtis: day first, dots, decimal comma",
            Style(";", ",", 2).table(
                [stamps("%d.%m.%Y %H:%M:%S,%3f"), d["motor_rpm"], d["current"]],
                ["Datum Zeit;Drehzahl [1/min];Strom [A]"],
            ),
            {"motor_rpm": ("Drehzahl [1/min]", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "drive: ms without a unit, told by its steps",
            Style().table(
                [as_integers(d["t"], 1000), d["motor_torque"], d["motor_rpm"]],
                ["Time,Motor Torque [Nm],Motor Speed [rpm]"],
            ),
            {"motor_torque": ("Motor Torque [Nm]", SI), "motor_rpm": ("Motor Speed [rpm]", SI)},
        ),
        DialectFile(
            "drive: two pairs side by side",
            Style(";", ",", 4).table(
                [d["t"], d["left"], d["v"], d["t"], d["right"]],
                ["Time [s];left_Mz_Nm;speed_m_s;Time [s];right_Mz_Nm"],
            ),
            {"left": ("left_Mz_Nm", SI), "right": ("right_Mz_Nm", SI)},
            topic={"right": "table/2"},
        ),
        DialectFile(
            "Siemens trace: a comma in quotes",
            Style(",", ",", 3, quote=True).table(
                [d["t"] * 1000, d["motor_torque"], d["motor_rpm"]],
                ['"Zeit [ms]","Drehmoment [Nm]","Drehzahl [1/min]"'],
            ),
            {"motor_torque": ("Drehmoment [Nm]", SI)},
        ),
        DialectFile(
            "pump controller in Latin-1",
            Style(";", ",", 3, encoding="latin-1").table(
                [d["t"], d["a"], d["v"], d["F"]],
                ["Zeit [s];Beschleunigung längs [m/s²];Geschwindigkeit [m/s];Kraft [N]"],
            ),
            {"a": ("Beschleunigung längs [m/s²]", SI)},
        ),
    ]


def _robots(d: dict[str, Floats]) -> list[DialectFile]:
    ns = [str(T0_NS + round(t * 1e9)) for t in d["t"]]
    us = as_integers(d["t"] + 812.5, 1e6)
    return [
        DialectFile(
            "rostopic echo -p",
            Style(digits=6).table(
                [ns, ns, d["wheel"], d["left"] * 2],
                ["%time,field.header.stamp,field.velocity0,field.effort0"],
            ),
            {"wheel": ("field.velocity0", SI)},
            t0_ns=T0_NS,
            units={"field.velocity0": 'scale = "wheel_radius_m"'},
            channels={
                "wheel_torque_N_m": 'field = "field.effort0"',
                "force_x_N": 'derive = "wheel_torque_N_m / wheel_radius_m"',
            },
        ),
        DialectFile(
            "PX4: microseconds since boot by their steps",
            Style(digits=6).table(
                [us, d["a"], d["az"], d["v"], d["F"]], ["timestamp,x,z,vx_m_s,thrust_N"]
            ),
            {"a": ("x", SI)},
            t0_ns=812_500_000_000,
        ),
        DialectFile(
            "ArduPilot: TimeUS",
            Style(digits=6).table([us, d["v"], d["F"]], ["TimeUS,Spd,Thr_N"]),
            {"v": ("Spd", SI)},
            t0_ns=812_500_000_000,
            units={"Spd": 'unit = "m/s"'},
        ),
        DialectFile(
            "numpy.savetxt: a comment as head",
            Style(" ", digits=8).table([d["t"], d["v"], d["F"]], ["# t v F"]),
            {"F": ("F", SI)},
            suffix=".txt",
            channels={"speed_x_m_s": 'field = "v"', "force_x_N": 'field = "F"'},
        ),
        DialectFile(
            "UR: timestamp, blanks",
            Style(" ", digits=6).table(
                [d["t"] + 5012.25, d["F"], d["v"]],
                ["timestamp actual_force_0 actual_speed_0"],
            ),
            {"F": ("actual_force_0", SI)},
            suffix=".txt",
            t0_ns=5_012_250_000_000,
            units={"actual_force_0": 'unit = "N"', "actual_speed_0": 'unit = "m/s"'},
        ),
        DialectFile(
            "KUKA: semicolons, seconds",
            Style(";", digits=4).table(
                [d["t"], d["motor_torque"], d["motor_rpm"]],
                ["Zeit[s];Torque_A1[Nm];Speed_A1[1/min]"],
            ),
            {"motor_torque": ("Torque_A1[Nm]", SI)},
        ),
        DialectFile(
            "pandas: an index without a name",
            Style(digits=6).table(
                [as_integers(np.arange(ROWS)), d["t"], d["v"], d["F"]],
                [",time_s,speed_m_s,force_N"],
            ),
            {"v": ("speed_m_s", SI)},
        ),
        DialectFile(
            "Motive: names twice",
            Style(digits=5).table([d["t"], d["x"], d["v"], d["F"]], ["Time (s),X,X,Force (N)"]),
            {"v": ("X (2)", SI)},
            channels={"speed_x_m_s": 'field = "X (2)"'},
        ),
        DialectFile(
            "epoch in seconds with fractions",
            Style(digits=3).table(
                [[f"{T0_NS / 1e9 + t:.3f}" for t in d["t"]], d["v"], d["F"]],
                ["Timestamps,velocity_m_s,force_N"],
            ),
            {"v": ("velocity_m_s", 1)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "epoch in milliseconds",
            Style().table(
                [as_integers(d["t"] + T0_NS / 1e9, 1000), d["v"], d["F"]], ["TIMESTAMP,v,F"]
            ),
            {"v": ("v", SI)},
            t0_ns=T0_NS,
            channels={"speed_x_m_s": 'field = "v"', "force_x_N": 'field = "F"'},
        ),
    ]


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_controllers(DRIVE), *_robots(DRIVE)]
