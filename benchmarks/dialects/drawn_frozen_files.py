"""Twenty more dialects, drawn while the reader was frozen: whole exports as tools write them."""

from typing import Final

import numpy as np

from benchmarks.dialects.dialect_file import (
    CLOCK,
    DRIVE,
    F_N,
    KMH,
    RATE_HZ,
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

_MOTOR: Final = 'derive = "motor_current_A * 0.12 [N*m/A] * 9.665 / wheel_radius_m"'


def _loggers() -> list[DialectFile]:
    hobo = [f"{c:%m/%d/%y %I:%M:%S}.{c.microsecond // 1000:03d} {c:%p}" for c in CLOCK]
    ticks = 621_355_968_000_000_000 + T0_NS // 100
    zone = [s.replace("Z", "+01:00") for s in stamps("%Y-%m-%dT%H:%M:%S.%3fZ")]
    numbers = as_integers(np.arange(1, ROWS + 1))
    return [
        DialectFile(
            "HOBO: unit after a comma, year of two digits, serial numbers, trailing marks",
            ("\ufeff" + Style(digits=3, end="\r\n", tail=",,").table(
                [numbers, hobo, V_KMH, F_N / 1e3],
                ['"Plot Title: yard"',
                 '"#","Date Time, GMT+00:00","Speed, km/h (LGR S/N: 2090, SEN S/N: 201)",'
                 '"Pull, kN (LGR S/N: 2090, SEN S/N: 202)","Host Connected (LGR S/N: 2090)",'
                 '"End Of File (LGR S/N: 2090)"'],
            ).decode()).encode(),
            {"v": ("Speed, km/h (LGR S/N: 2090, SEN S/N: 201)", KMH)}, t0_ns=T0_NS,
            keys=("log.day_first=false",),
        ),
        DialectFile(
            "OpenLog Artemis: rtcDate, rtcTime, ground speed in mm/s without a unit",
            Style(digits=2, end="\r\n", tail=",").table(
                [stamps("%m/%d/%Y"), [s[:-1] for s in stamps("%H:%M:%S.%3f")],
                 as_integers(V_M_S, 1000), F_N, ["50.000"] * ROWS, numbers],
                ["rtcDate,rtcTime,gps_GroundSpeed,weight(N),output_Hz,count,"],
            ),
            {"F": ("weight(N)", SI)}, suffix=".TXT", t0_ns=T0_NS,
            units={"gps_GroundSpeed": 'unit = "mm/s"'},
            channels={"force_x_N": 'field = "weight(N)"',
                      "speed_x_m_s": 'field = "gps_GroundSpeed"\nunit = "mm/s"'},
        ),
        DialectFile(
            "PicoLog 6: times without a name, an offset of an hour",
            Style(digits=4).table([zone, F_N / 1e3, V_M_S], ['"",Pull Ave. (kN),Speed Ave. (m/s)']),
            {"F": ("Pull Ave. (kN)", 1e-3)}, t0_ns=T0_NS - 3600 * 10**9,
        ),
        DialectFile(
            "C#: DateTime.Ticks",
            Style(digits=4).table(
                [[str(ticks + k * 200_000) for k in range(ROWS)], V_KMH, F_N],
                ["Timestamp,Speed_kmh,Force_N"],
            ),
            {"F": ("Force_N", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "LabVIEW: seconds since 1904, tabs, decimal comma",
            Style("\t", ",", 3, end="\r\n").table(
                [T_S + T0_NS / 1e9 + 2_082_844_800, F_N, V_M_S], ["Time\tForce (N)\tSpeed (m/s)"]
            ),
            {"F": ("Force (N)", SI)}, suffix=".txt", t0_ns=T0_NS,
        ),
        DialectFile(
            "InfluxDB: annotations, start and stop beside the time",
            Style(end="\r\n").table(
                [[""] * ROWS, ["_result"] * ROWS, ["0"] * ROWS,
                 ["2026-11-13T00:00:00Z"] * ROWS, ["2026-11-14T00:00:00Z"] * ROWS,
                 [s.replace(".000Z", "Z") for s in stamps("%Y-%m-%dT%H:%M:%S.%3fZ")],
                 ["loader"] * ROWS, F_N, V_M_S],
                ["#group,false,false,true,true,false,true,false,false",
                 "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,"
                 "string,double,double",
                 "#default,_result,,,,,,,",
                 ",result,table,_start,_stop,_time,machine,force_N,speed_m_s"],
            ),
            {"F": ("force_N", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "tension link: the unit in a column of its own",
            Style(digits=3, end="\r\n").table(
                [numbers, stamps("%d/%m/%Y"), stamps("%H:%M:%S.%3f"), F_N / 9.80665,
                 ["kgf"] * ROWS, V_KMH],
                ["Crosby Straightpoint Data Log", "Serial No,61234", "",
                 "Reading,Date,Time,Load,Units,Speed (km/h)"],
            ),
            {"v": ("Speed (km/h)", KMH)}, t0_ns=T0_NS,
            units={"Load": 'unit = "kgf"'}, channels={"force_x_N": 'field = "Load"\nunit = "kgf"'},
        ),
    ]  # fmt: skip


def _engines() -> list[DialectFile]:
    half = DRIVE["motor_torque"]
    sparse_speed = [f"{v:.4f}" if k % 2 == 0 else "" for k, v in enumerate(V_KMH)]
    sparse_force = [f"{f:.2f}" if k % 2 else "" for k, f in enumerate(F_N)]
    return [
        DialectFile(
            "TunerStudio: two lines of head, tabs, units below, marks between",
            Style("\t", digits=3).table(
                [T_S, DRIVE["motor_rpm"], half, ["0"] * ROWS],
                ['"MS3 Format 0524.01"', '"Capture Date: Fri Nov 13 08:15:30 UTC 2026"',
                 "Time\tRPM\tTorque\tSecL", "s\tRPM\tNm\tsec"],
            ).replace(b"\n10.000\t", b'\nMARK 000 - "Manual" - Fri Nov 13 08:15:40\n10.000\t'),
            {"motor_torque": ("Torque", SI)}, suffix=".msl",
        ),
        DialectFile(
            "HP Tuners: names and units above [Channel Data]",
            Style(digits=3, end="\r\n").table(
                [T_S, V_KMH, DRIVE["left"] * 2],
                ["HP Tuners CSV Log File", "Version: 1.0", "", "[Log Information]",
                 "Creation Time: 11/13/2026 8:15:30 AM", "Notes: ", "", "[Channel Information]",
                 "0,2317,4134", "Offset,Vehicle Speed (SAE),Axle Torque", "s,km/h,Nm", "",
                 "[Channel Data]"],
            ),
            {"v": ("Vehicle Speed (SAE)", KMH)},
        ),
        DialectFile(
            "Scan My Tesla: ms as Time, each row one reading",
            Style(end="\r\n", tail=",").table(
                [as_integers(T_S, 1000), sparse_speed, sparse_force],
                ["Time,Speed (km/h),Drive force (N),"],
            ),
            {},
        ),
        DialectFile(
            "Russian: unit after a comma, cp1251",
            Style(";", ",", 4, encoding="cp1251", end="\r\n").table(
                [T_S, V_KMH, F_N / 1e3], ["Время, с;Скорость, км/ч;Усилие, кН"]
            ),
            {"v": ("Скорость, км/ч", KMH)}, keys=("log.encoding=cp1251",),
        ),
        DialectFile(
            "Turkish: sn, km/sa, kilos of force, cp1254",
            Style(";", ",", 4, encoding="cp1254", end="\r\n").table(
                [T_S, V_KMH, F_N / 9.80665], ["Zaman (sn);Hız (km/sa);Kuvvet (kgf)"]
            ),
            {"F": ("Kuvvet (kgf)", 1 / 9.80665)},
            channels={"speed_x_m_s": 'field = "Hız (km/sa)"\nunit = "km/h"',
                      "force_x_N": 'field = "Kuvvet (kgf)"\nunit = "kgf"'},
        ),
        DialectFile(
            "GoldenCheetah: secs, kph, nm, watts",
            Style(digits=4).table(
                [T_S, ["0"] * ROWS, ["0"] * ROWS, DRIVE["x"] / 1e3, V_KMH, half, F_N * V_M_S],
                ["secs,cad,hr,km,kph,nm,watts"],
            ),
            {"v": ("kph", KMH)},
        ),
    ]  # fmt: skip


def _motors() -> list[DialectFile]:
    current, rpm = DRIVE["current"], DRIVE["motor_rpm"]
    battery: Floats = current * 0.6
    zeros = ["0"] * ROWS
    speed = {"speed_x_m_s": 'derive = "motor_rpm / 9.665 * wheel_radius_m"'}
    wincc: list[str] = []
    for k, stamp in enumerate(stamps("%d.%m.%Y %H:%M:%S")):
        serial = 46339.0 + (29_730 + k / RATE_HZ) / 86_400
        for name, value in (("Geschwindigkeit", V_KMH[k]), ("Kraft", F_N[k])):
            number = f"{value:.4f}".replace(".", ",")
            time = f"{serial * 1e6:.6f}".replace(".", ",")
            wincc.append(f'"{name}";"{stamp}";{number};1;{time}')
    return [
        DialectFile(
            "Betaflight: time (us), blanks behind commas, amperes of the battery",
            Style(", ", digits=4).table(
                [as_integers(np.arange(ROWS)), as_integers(T_S + 83.2, 1e6), battery,
                 DRIVE["a"] / 9.80665 * 2048, V_M_S, F_N],
                ["loopIteration, time (us), amperageLatest (A), accSmooth[0], GPS_speed (m/s), "
                 "tether_force (N)"],
            ),
            {"v": ("GPS_speed (m/s)", SI)}, t0_ns=83_200_000_000,
            units={"accSmooth[0]": "scale = 0.0047884"},
        ),
        DialectFile(
            "Simulink Data Inspector: rows of types, units and paths",
            Style(digits=6).table(
                [T_S, V_M_S, F_N],
                ["time,speed,force", ",Type: double,Type: double", ",Unit: m/s,Unit: N",
                 ",Interp: linear,Interp: linear", ",Block Path: plant/v,Block Path: plant/F"],
            ),
            {"v": ("speed", SI)},
            units={"speed": 'unit = "m/s"', "force": 'unit = "N"'},
        ),
        DialectFile(
            "Float Control: I-Battery, I-Motor, ERPM, Speed(km/h)",
            Style(digits=3).table(
                [T_S, V_M_S * 10, ["63.0"] * ROWS, battery, current, zeros, rpm * 7, V_KMH],
                ["Time(s),Duty%,Voltage,I-Battery,I-Motor,Motor-Fault,ERPM,Speed(km/h)"],
            ),
            {"current": ("I-Motor", SI)},
            channels={"motor_current_A": 'field = "I-Motor"', "force_x_N": _MOTOR},
        ),
        DialectFile(
            "Cycle Analyst: tabs, letters, no time, amperes of the battery",
            Style("\t", digits=3).table(
                [T_S / 100, ["51.8"] * ROWS, battery, V_KMH, DRIVE["x"] / 1e3, ["25"] * ROWS,
                 F_N, zeros],
                ["Ah\tV\tA\tS\tD\tDeg\tN\tFlgs"],
            ),
            {}, suffix=".txt", keys=("log.rate_hz=50",),
            channels={"speed_x_m_s": 'field = "S"\nunit = "km/h"', "force_x_N": 'field = "N"'},
        ),
        DialectFile(
            "maxon EPOS Studio: mNm, rpm, ms",
            Style("\t", digits=2, end="\r\n").table(
                [T_S * 1000, rpm, DRIVE["motor_torque"] * 1000],
                ["Time [ms]\tVelocity actual value averaged [rpm]\tTorque actual value [mNm]"],
            ),
            {"motor_torque": ("Torque actual value [mNm]", 1000)}, suffix=".txt",
            channels={
                "motor_rpm": 'field = "Velocity actual value averaged [rpm]"', **speed,
                "motor_torque_N_m": 'field = "Torque actual value [mNm]"\nunit = "mN*m"',
                "force_x_N": 'derive = "motor_torque_N_m * 9.665 / wheel_radius_m"',
            },
        ),
        DialectFile(
            "two drives, the right one mounted mirrored",
            Style(digits=4).table(
                [T_S, DRIVE["left"], -DRIVE["right"], V_M_S, -V_M_S],
                ["time_s,left_torque_Nm,right_torque_Nm,left_speed_m_s,right_speed_m_s"],
            ),
            {"left": ("left_torque_Nm", SI)},
            units=dict.fromkeys(["right_torque_Nm", "right_speed_m_s"], "scale = -1"),
        ),
        DialectFile(
            "WinCC Comfort: a row a reading, Time_ms in millionths of a day",
            ("\n".join(
                ['"VarName";"TimeString";"VarValue";"Validity";"Time_ms"', *wincc]
            ) + '\n"$RT_COUNT$";8000;"";"";""\n').encode(),
            {},
        ),
    ]  # fmt: skip


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_loggers(), *_engines(), *_motors()]
