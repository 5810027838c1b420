"""Dialects drawn while the reader was frozen at b98fc684: recorders, plants, robots, phones."""

from typing import Final

import numpy as np

from benchmarks.dialects.dialect_file import (
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

_KN: Final = 1e-3
_KNOTS: Final = V_M_S * 3600 / 1852
_TAPS: Final = {
    "speed_x_m_s": 'field = "CH1"\nscale = 10.0',
    "force_x_N": 'field = "CH2"\nscale = 1000.0',
}


def _recorders() -> list[DialectFile]:
    """Memory recorders and loggers."""
    volts = [T_S, DRIVE["volt"], F_N * _KN]
    return [
        DialectFile(
            "Hioki: words before the names and the units",
            Style(digits=6, end="\r\n").table(
                volts,
                ['"COMMENT","yard"', '"DATE","11-13-2026"', '"TIME","08:15:30"', '"NUM_SIGS",3',
                 '"INTERVAL",2.000E-02', '"HORZ_UNITS","S"', '"VERT_UNITS","S","V","V"',
                 '"SIGNAL","TIME","CH1","CH2"', '"DATA"'],
            ),
            {"F": ("CH2", _KN)}, channels=_TAPS,
        ),
        DialectFile(
            "Yokogawa DLM: no time, its rate above",
            Style(digits=6, end="\r\n", tail=",").table(
                [[""] * ROWS, *volts[1:]],
                ['"Header Size",9,,', '"Model Name","DLM3024",,', '"BlockNumber",1,,',
                 '"TraceName","CH1","CH2",', '"BlockSize",4000,4000,', '"VUnit","V","V",',
                 '"SampleRate",50.0,50.0,', '"HUnit","s","s",', ",,,"],
            ),
            {"F": ("CH2", _KN)}, keys=("log.rate_hz=50",), channels=_TAPS,
        ),
        DialectFile(
            "LabVIEW .lvm: a time to each channel, a comment behind",
            Style("\t", digits=6, end="\r\n", tail="\t").table(
                [T_S, F_N, T_S, V_M_S],
                ["LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2",
                 "Separator\tTab", "Decimal_Separator\t.", "Multi_Headings\tNo",
                 "X_Columns\tMulti", "Time_Pref\tRelative", "Operator\tyard",
                 "Date\t2026/11/13", "Time\t08:15:30.0", "***End_of_Header***\t", "\t",
                 "Channels\t2\t\t\t", "Samples\t4000\t\t4000\t", "Date\t2026/11/13\t\t2026/11/13\t",
                 "Time\t08:15:30.0\t\t08:15:30.0\t", "Y_Unit_Label\tN\t\tm/s\t",
                 "X_Dimension\tTime\t\tTime\t", "X0\t0.0E+0\t\t0.0E+0\t",
                 "Delta_X\t0.020000\t\t0.020000\t", "***End_of_Header***\t\t\t\t",
                 "X_Value\tForce\tX_Value\tSpeed\tComment"],
            ),
            {"F": ("Force", SI)}, suffix=".lvm", topic={"v": "table/2"},
            units={"Force": 'unit = "N"', "Speed": 'unit = "m/s"'},
        ),
        DialectFile(
            "imc FAMOS: the time has a unit and no name",
            Style("\t", ",", 5).table(
                [T_S, F_N * _KN, V_KMH], ["\tZugkraft\tGeschwindigkeit", "[s]\t[kN]\t[km/h]"]
            ),
            {"F": ("Zugkraft", _KN)}, suffix=".asc",
        ),
        DialectFile(
            "time in tenths of a millisecond",
            Style(";", ",", 3).table(
                [as_integers(T_S, 10_000), F_N, V_M_S],
                ["Zeit [0.1 ms];Kraft [N];Geschwindigkeit [m/s]"],
            ),
            {"F": ("Kraft [N]", SI)}, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "Instron: seconds, displacement in mm, kN, every cell in quotes",
            Style(quote=True, digits=5, end="\r\n").table(
                [T_S, DRIVE["x"] * 1000, F_N * _KN],
                ['"Specimen label","yard"', "", '"Time","Displacement","Force"',
                 '"(s)","(mm)","(kN)"'],
            ),
            {"x": ("Displacement", 1000.0)},
            channels={"position_x_m": 'field = "Displacement"\nunit = "mm"',
                      "speed_x_m_s": 'derive = "d/dt position_x_m"'},
        ),
        DialectFile(
            "Vicon Nexus: a word and a rate above, frames and no time",
            Style(digits=4).table(
                [as_integers(np.arange(1, ROWS + 1)), ["0"] * ROWS, F_N, V_M_S * 1000],
                ["Devices", "50", ",,Load cell - Force,Cart - Velocity", "Frame,Sub Frame,Fx,Vx",
                 ",,N,mm/s"],
            ),
            {"F": ("Fx", SI)}, keys=("log.rate_hz=50",),
            channels={"speed_x_m_s": 'field = "Vx"', "force_x_N": 'field = "Fx"'},
        ),
    ]  # fmt: skip


def _plants() -> list[DialectFile]:
    """Controllers of plants, and what spreadsheets make of their files."""
    whole = stamps("%H:%M:%S")
    filetime = [str(116_444_736_000_000_000 + T0_NS // 100 + k * 200_000) for k in range(ROWS)]
    compact = stamps("%Y%m%d%H%M%S%3f")
    return [
        DialectFile(
            "FactoryTalk: date, time, and the milliseconds in Millitm",
            Style().table(
                [stamps("%m/%d/%Y"), whole, [str(int(m)) for m in stamps("%3f")], V_KMH, F_N],
                ["Date,Time,Millitm,Speed [km/h],Force [N]"],
            ),
            {"F": ("Force [N]", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "TwinCAT 3: FILETIME, tabs, decimal comma",
            Style("\t", ",", 4).table(
                [filetime, V_KMH, F_N], ["Timestamp\tv_ist [km/h]\tF_ist [N]"]
            ),
            {"F": ("F_ist [N]", SI)}, suffix=".txt", t0_ns=T0_NS,
        ),
        DialectFile(
            "Mitsubishi GOT: whole seconds and an index",
            Style(digits=3).table(
                [stamps("%Y/%m/%d %H:%M:%S"), as_integers(np.arange(ROWS)), V_KMH, F_N],
                ["[LOGGING],GT27,1,2,3", "DATETIME[YYYY/MM/DD hh:mm:ss],INDEX,FLOAT,FLOAT",
                 "TIME,INDEX,Speed[km/h],Force[N]"],
            ),
            {"F": ("Force[N]", SI)}, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "all upper case: MS, KMH, KN",
            Style(";").table(
                [as_integers(T_S, 1000), V_KMH, F_N * _KN], ["TIME [MS];V [KM/H];F [KN]"]
            ),
            {"F": ("F [KN]", _KN)},
            units={"F [KN]": 'unit = "kN"', "V [KM/H]": 'unit = "km/h"'},
            channels={"speed_x_m_s": 'field = "V [KM/H]"\nunit = "km/h"',
                      "force_x_N": 'field = "F [KN]"\nunit = "kN"'},
        ),
        DialectFile(
            "a stamp of digits alone: YYYYMMDDhhmmssfff",
            Style().table([compact, V_KMH, F_N], ["timestamp,speed_kmh,force_N"]),
            {"F": ("force_N", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "a spreadsheet's mm:ss.0",
            Style(end="\r\n").table(
                [[s[:-1] for s in stamps("%M:%S.%3f")], V_KMH, F_N],
                ["Time,Speed (km/h),Force (N)"],
            ),
            {"F": ("Force (N)", SI)}, t0_ns=930 * 10**9,
        ),
        DialectFile(
            "names 'quantity in unit', month in German",
            Style(";", ",", 3).table(
                [[s.replace("Nov", "Okt") for s in stamps("%d. %b %Y %H:%M:%S,%3f")], V_KMH, F_N],
                ["Zeitpunkt;Geschwindigkeit in km/h;Kraft in N"],
            ),
            {"F": ("Kraft in N", SI)}, t0_ns=T0_NS - 31 * 86_400 * 10**9,
        ),
    ]  # fmt: skip


def _signs() -> list[DialectFile]:
    """Signs and units that are easily taken wrongly."""
    wheel_torque = np.round(DRIVE["left"] * 2)
    wrapped = [str(int(x) % 65536) for x in wheel_torque]
    braking = ["1" if x < 0 else "0" for x in F_N]
    signed = (
        'derive = "where(braking_1 > 0.5, -motor_torque_N_m, motor_torque_N_m)'
        ' * 9.665 / wheel_radius_m"'
    )
    return [
        DialectFile(
            "NMEA logger: knots as kn beside kN",
            Style(digits=4).table(
                [stamps("%Y-%m-%dT%H:%M:%S.%3fZ"), _KNOTS, F_N * _KN], ["time,SOG [kn],Pull [kN]"]
            ),
            {"F": ("Pull [kN]", _KN)}, t0_ns=T0_NS,
            channels={"speed_x_m_s": 'field = "SOG [kn]"\nunit = "kn"'},
        ),
        DialectFile(
            "hanging scale: pounds, miles",
            Style(digits=3).table(
                [T_S, F_N / 4.4482216, V_M_S / 0.44704], ["Time (s),Tension (lb),Speed (mph)"]
            ),
            {"F": ("Tension (lb)", 1 / 4.4482216)}, units={"Tension (lb)": 'unit = "lbf"'},
            channels={"force_x_N": 'field = "Tension (lb)"\nunit = "lbf"'},
        ),
        DialectFile(
            "load cell on a microcontroller: millis, kilograms",
            Style(";", digits=3).table(
                [as_integers(T_S, 1000), F_N / 9.80665, V_KMH], ["millis;Load [kg];Speed [km/h]"]
            ),
            {"v": ("Speed [km/h]", KMH)}, units={"Load [kg]": 'unit = "kgf"'},
            channels={"force_x_N": 'field = "Load [kg]"\nunit = "kgf"'},
        ),
        DialectFile(
            "torque without a sign, and whether it brakes",
            Style(digits=4).table(
                [T_S, np.abs(DRIVE["motor_torque"]), braking, DRIVE["motor_rpm"]],
                ["Time (s),Motor Torque (Nm),Regen,Motor Speed (rpm)"],
            ),
            {"motor_rpm": ("Motor Speed (rpm)", SI)},
            channels={
                "motor_torque_N_m": 'field = "Motor Torque (Nm)"',
                "braking_1": 'field = "Regen"',
                "motor_rpm": 'field = "Motor Speed (rpm)"',
                "speed_x_m_s": 'derive = "motor_rpm * wheel_radius_m / 9.665"',
                "force_x_N": signed,
            },
        ),
        DialectFile(
            "CANopen: a signed torque in 16 bits without a sign",
            Style(digits=4).table(
                [as_integers(T_S, 1000), wrapped, V_M_S],
                ["Time [ms],Wheel Torque [Nm],Vehicle Speed [m/s]"],
            ),
            {"v": ("Vehicle Speed [m/s]", SI)},
        ),
        DialectFile(
            "ODrive: turns a second, amperes of Iq",
            Style(digits=6).table(
                [T_S, DRIVE["motor_rpm"] / 60, DRIVE["current"]],
                ["time,axis0.encoder.vel_estimate,axis0.motor.current_control.Iq_measured"],
            ),
            {"current": ("axis0.motor.current_control.Iq_measured", SI)},
            channels={
                "motor_rpm": 'field = "axis0.encoder.vel_estimate"\nscale = 60.0',
                "speed_x_m_s": 'derive = "motor_rpm * wheel_radius_m / 9.665"',
            },
        ),
    ]  # fmt: skip


def _robots_and_phones() -> list[DialectFile]:
    """Robots, cars and phones."""
    epoch = [f"{T0_NS / 1e9 + t:.6f}" for t in T_S]
    ns = [str(T0_NS + k * 20_000_000) for k in range(ROWS)]
    names = ["/odom.speed_m_s", "/cell.force_N"]
    long = [
        f"{t:.3f},{T0_NS / 1e9 + t:.3f},{names[k]},{x:.5f}"
        for t, *pair in zip(T_S, V_M_S, F_N, strict=True)
        for k, x in enumerate(pair)
    ]
    fit = [
        f'Data,0,record,timestamp,"{1_163_059_200 + k // 50}",s,speed,"{v:.4f}",m/s,'
        f'power,"{round(f * v)}",watts'
        for k, (v, f) in enumerate(zip(V_M_S, F_N, strict=True))
    ]
    arrows = [
        f"{s} -> speed:{v:.4f},force:{f:.3f}"
        for s, v, f in zip(stamps("%H:%M:%S.%3f"), V_M_S, F_N, strict=True)
    ]
    return [
        DialectFile(
            "mavlogdump: seconds since 1970 beside TimeUS",
            Style(digits=5).table(
                [epoch, as_integers(T_S + 83.2, 1e6), ["0"] * ROWS, ["3"] * ROWS, V_M_S, F_N],
                ["timestamp,TimeUS,I,Status,Spd,Tether_N"],
            ),
            {"F": ("Tether_N", SI)}, t0_ns=T0_NS,
            channels={"speed_x_m_s": 'field = "Spd"\nunit = "m/s"'},
            units={"Spd": 'unit = "m/s"'},
        ),
        DialectFile(
            "rosbag_to_csv: rosbagTimestamp, secs, nsecs",
            Style(digits=5).table(
                [ns, [""] * ROWS, as_integers(np.arange(ROWS)), [""] * ROWS,
                 [each[:10] for each in ns], [str(int(each[10:])) for each in ns],
                 ['"base_link"'] * ROWS, V_M_S, F_N],
                ["rosbagTimestamp,header,seq,stamp,secs,nsecs,frame_id,speed,force"],
            ),
            {"F": ("force", SI)}, t0_ns=T0_NS,
            units={"speed": 'unit = "m/s"', "force": 'unit = "N"'},
        ),
        DialectFile(
            "Foxglove plot: a row a value, its name in a column",
            ("\n".join(["elapsed time,receive time,topic,value", *long]) + "\n").encode(),
            {"F": ("/cell.force_N", SI)}, t0_ns=None,
        ),
        DialectFile(
            "Torque Pro: two clocks, dashes where there is nothing, torque of the motor",
            Style(digits=4, end="\r\n").table(
                [stamps("%a %b %d %H:%M:%S GMT+00:00 %Y"), stamps("%d-%b-%Y %H:%M:%S.%3f"),
                 V_M_S, ["-" if k % 5 else "0.3" for k in range(ROWS)], DRIVE["a"] / 9.80665,
                 V_KMH, DRIVE["motor_torque"]],
                ["GPS Time, Device Time, GPS Speed (Meters/second), Altitude, G(x), "
                 "Speed (OBD)(km/h),Torque(Nm)"],
            ),
            {"motor_torque": ("Torque(Nm)", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "FIT: field, value and unit side by side",
            ("\n".join(["Type,Local Number,Message,Field 1,Value 1,Units 1,Field 2,Value 2,"
                        "Units 2,Field 3,Value 3,Units 3", *fit]) + "\n").encode(),
            {"v": ("Value 2", SI)}, keys=("log.rate_hz=50",),
            channels={"speed_x_m_s": 'field = "Value 2"', "power_W": 'field = "Value 3"',
                      "force_x_N": 'derive = "where(abs(speed_x_m_s) > 0.3 [m/s], '
                                   'power_W / speed_x_m_s)"'},
        ),
        DialectFile(
            "Arduino monitor: a stamp, an arrow, names before the values",
            ("\n".join(arrows) + "\n").encode(), {"F": ("force", SI)}, suffix=".txt",
        ),
        DialectFile(
            "asammdf: timestamps, units in a row of brackets",
            Style(quote=False, digits=5).table(
                [epoch, V_KMH, DRIVE["left"], DRIVE["right"]],
                ["timestamps,VehSpd,TqWhlLe,TqWhlRi", "[s],[km/h],[Nm],[Nm]"],
            ),
            {"left": ("TqWhlLe", SI)}, t0_ns=T0_NS,
        ),
    ]  # fmt: skip


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_recorders(), *_plants(), *_signs(), *_robots_and_phones()]
