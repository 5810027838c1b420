"""Twenty dialects drawn against a reader that was not written for them."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np

from benchmarks.dialects.dialect_file import (
    F_N,
    KMH,
    ROWS,
    SI,
    T0_NS,
    T_S,
    V_KMH,
    V_M_S,
    DialectFile,
    as_integers,
    stamps,
)

_KN: Final = 1e-3
_LBF: Final = 1 / 4.4482216152605
_MPH: Final = 1 / 0.44704


def cells(values: Iterable[Any], form: str = "{:.5f}", comma: bool = False) -> list[str]:
    """Numbers as text."""
    found = [form.format(value) for value in values]
    return [each.replace(".", ",") for each in found] if comma else found


def lines(
    head: Sequence[str], columns: Sequence[Sequence[str]], separator: str = ",", end: str = "\n"
) -> bytes:
    """Lines above, and the rows, in UTF-8."""
    rows = [separator.join(row) for row in zip(*columns, strict=True)]
    return (end.join([*head, *rows]) + end).encode()


def _thousands(values: Iterable[float], sign: str, point: str) -> list[str]:
    form = [f"{value:,.3f}" for value in values]
    return [each.replace(",", "\0").replace(".", point).replace("\0", sign) for each in form]


def _numbers() -> list[DialectFile]:
    """Headers and numbers."""
    random = np.random.default_rng(11)
    gaps = random.random(ROWS) < 0.02
    plain, speed, force = cells(T_S), cells(V_KMH), cells(F_N)
    return [
        DialectFile(
            "DIN: quantity over unit",
            lines(
                ["t/s;v/(km/h);F/kN"],
                [cells(T_S, comma=True), cells(V_KMH, comma=True), cells(F_N * _KN, comma=True)],
                ";",
            ),
            {"v": ("v/(km/h)", KMH), "F": ("F/kN", _KN)},
        ),
        DialectFile(
            "names of two lines in quotes",
            lines(
                ['"Time\n[s]","Vehicle speed\n[km/h]","Drawbar force\n[N]"'], [plain, speed, force]
            ),
            {"v": ("Vehicle speed [km/h]", KMH), "F": ("Drawbar force [N]", SI)},
        ),
        DialectFile(
            "thousands by commas in quotes",
            lines(
                ["Time (s),Speed (km/h),Force (N)"],
                [plain, speed, [f'"{c}"' for c in _thousands(F_N, ",", ".")]],
            ),
            {"v": ("Speed (km/h)", KMH), "F": ("Force (N)", SI)},
        ),
        DialectFile(
            "thousands by blanks, decimal comma",
            lines(
                ["Zeit [s];Geschwindigkeit [km/h];Kraft [N]"],
                [cells(T_S, comma=True), cells(V_KMH, comma=True), _thousands(F_N, " ", ",")],
                ";",
            ),
            {"v": ("Geschwindigkeit [km/h]", KMH), "F": ("Kraft [N]", SI)},
        ),
        DialectFile(
            "Fortran: exponents with D",
            lines(
                ["  TIME  SPEED_KMH  FORCE_N"],
                [[c.replace("E", "D") for c in cells(x, "{:16.8E}")] for x in (T_S, V_KMH, F_N)],
                " ",
            ),
            {"v": ("SPEED_KMH", KMH), "F": ("FORCE_N", SI)},
            suffix=".dat",
        ),
        DialectFile(
            "MATLAB timetable: seconds with a word",
            lines(["Time,speed_kmh,force_N"], [cells(T_S, "{:.2f} sec"), speed, force]),
            {"v": ("speed_kmh", KMH), "F": ("force_N", SI)},
        ),
        DialectFile(
            "Grafana: cells with their units",
            lines(
                ['"Time","Speed","Force"'],
                [
                    [f'"{s}"' for s in stamps("%Y-%m-%d %H:%M:%S.%3f")],
                    [f'"{c} km/h"' for c in speed],
                    [f'"{c} N"' for c in force],
                ],
            ),
            {"v": ("Speed", KMH), "F": ("Force", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "readings that are missing as ---",
            lines(
                ["Time (s);Speed (km/h);Force (N)"],
                [
                    plain,
                    [("---" if g else c) for g, c in zip(gaps, speed, strict=True)],
                    [("---" if g else c) for g, c in zip(gaps[::-1], force, strict=True)],
                ],
                ";",
            ),
            {"v": ("Speed (km/h)", KMH), "F": ("Force (N)", SI)},
        ),
        DialectFile(
            "miles and pounds",
            lines(
                ["Elapsed Time (sec),GPS Speed (mph),Load Cell (lbf)"],
                [plain, cells(V_M_S * _MPH), cells(F_N * _LBF)],
            ),
            {"v": ("GPS Speed (mph)", _MPH), "F": ("Load Cell (lbf)", _LBF)},
        ),
        DialectFile(
            "Chinese names",
            lines(["时间(s),速度(km/h),牵引力(kN)"], [plain, speed, cells(F_N * _KN)]),
            {"v": ("速度(km/h)", KMH), "F": ("牵引力(kN)", _KN)},
        ),
        DialectFile(
            "Japanese in Shift-JIS",
            lines(["時間[s],速度[km/h],荷重[kN]"], [plain, speed, cells(F_N * _KN)])
            .decode()
            .encode("cp932"),
            {"v": ("速度[km/h]", KMH), "F": ("荷重[kN]", _KN)},
            keys=("log.encoding=cp932",),
        ),
    ]


def _times() -> list[DialectFile]:
    """Times."""
    speed, force = cells(V_KMH), cells(F_N)
    back = slice(None, None, -1)
    sec = [str(T0_NS // 10**9 + int(t)) for t in T_S + 1e-6]
    nanosec = [str(round((t % 1.0) * 1e9) % 10**9) for t in T_S]
    six = stamps("%Y,%m,%d,%H,%M,%S.%3f")
    long: list[str] = []
    for t, v, f in zip(T_S, speed, force, strict=True):
        long += [f'"{t:.3f}";"Vehicle speed";"{v}";"km/h"', f'"{t:.3f}";"Force";"{f}";"N"']
    return [
        DialectFile(
            "TwinCAT Scope: a head of keys, a time to each signal",
            lines(
                [
                    "Name\tYard",
                    "File\tC:\\Scope\\yard.svdx",
                    "Starttime of export\t134000000000000000",
                    "Endtime of export\t134000000799800000",
                    "",
                    "Name\tAxis.ActVelo\tName\tAxis.ActForce",
                    "SymbolComment\t\tSymbolComment\t",
                    "Data-Type\tREAL64\tData-Type\tREAL64",
                    "SampleTime[ms]\t20\tSampleTime[ms]\t20",
                    "VariableSize\t8\tVariableSize\t8",
                    "Unit\tm/s\tUnit\tN",
                    "",
                ],
                [as_integers(T_S, 1000), cells(V_M_S), as_integers(T_S, 1000), force],
                "\t",
            ),
            {"v": ("Axis.ActVelo", SI), "F": ("Axis.ActForce", SI)},
            suffix=".txt",
            keys=(
                *("log.header_row=6", "log.units_row=11"),
                *("log.time=Name", "log.time_unit=ms"),
            ),
        ),
        DialectFile(
            "ros2 topic echo --csv: seconds and nanoseconds, no names",
            lines([], [sec, nanosec, ["base_link"] * ROWS, cells(V_M_S), force]),
            {"v": ("column 4", SI), "F": ("column 5", SI)},
            keys=("log.time=column 1", "log.time_fraction=column 2"),
            channels={"speed_x_m_s": 'field = "column 4"', "force_x_N": 'field = "column 5"'},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "a date, and seconds of the day",
            lines(
                ["Date,Time (s),Speed (km/h),Force (N)"],
                [stamps("%Y-%m-%d"), cells(T_S + 29_730, "{:.3f}"), speed, force],
            ),
            {"v": ("Speed (km/h)", KMH), "F": ("Force (N)", SI)},
            t0_ns=29_730 * 10**9,
        ),
        DialectFile(
            "time of day, and its milliseconds in a column",
            lines(
                ["Time;ms;Speed (km/h);Force (N)"],
                [stamps("%H:%M:%S"), stamps("%3f"), speed, force],
                ";",
            ),
            {"v": ("Speed (km/h)", KMH), "F": ("Force (N)", SI)},
            t0_ns=29_730 * 10**9,
        ),
        DialectFile(
            "year to second in six columns",
            lines(["year,month,day,hour,minute,second,speed_kmh,force_N"], [six, speed, force]),
            {"v": ("speed_kmh", KMH), "F": ("force_N", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "RTKLIB: one name above date and time",
            lines(
                ["% program   : rtkpost", "%  GPST                  speed(km/h)   force(N)"],
                [stamps("%Y/%m/%d %H:%M:%S.%3f"), speed, force],
                "   ",
            ),
            {"v": ("speed(km/h)", KMH), "F": ("force(N)", SI)},
            suffix=".pos",
            t0_ns=T0_NS,
        ),
        DialectFile(
            "the newest row first",
            lines(
                ["Timestamp,Speed [km/h],Force [N]"],
                [stamps("%Y-%m-%dT%H:%M:%S.%3fZ")[back], speed[back], force[back]],
            ),
            {"v": ("Speed [km/h]", KMH), "F": ("Force [N]", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "stamps to the second of fifty rows each",
            lines(
                ["Timestamp,Speed [km/h],Force [N]"], [stamps("%Y-%m-%d %H:%M:%S"), speed, force]
            ),
            {"v": ("Speed [km/h]", KMH), "F": ("Force [N]", SI)},
            keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "a row a reading: name, value, unit",
            ("\n".join(['"SECONDS";"PID";"VALUE";"UNITS"', *long]) + "\n").encode(),
            {},
        ),
    ]


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_numbers(), *_times()]
