"""Twenty more dialects, drawn before the reader was mended for the twenty before."""

import gzip
import io
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq
import xlsxwriter

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
from benchmarks.dialects.drawn_files import cells, lines

_KN: Final = 1e-3


def _parquet() -> bytes:
    fields = [
        pa.field("elapsed", pa.float64(), metadata={"unit": "s"}),
        pa.field("speed", pa.float32(), metadata={"unit": "km/h"}),
        pa.field("force", pa.float32(), metadata={"unit": "kN"}),
    ]
    table = pa.Table.from_arrays([pa.array(T_S), pa.array(V_KMH), pa.array(F_N * _KN)], names=[
        field.name for field in fields
    ]).cast(pa.schema(fields))  # fmt: skip
    file = io.BytesIO()
    pq.write_table(table, file)
    return file.getvalue()


def _workbook() -> bytes:
    file = io.BytesIO()
    with xlsxwriter.Workbook(file, {"in_memory": True}) as book:
        sheet = book.add_worksheet("Messung")
        sheet.write_row(0, 0, ["Yard, loader 3"])
        sheet.write_row(2, 0, ["Zeit", "Geschwindigkeit", "Zugkraft"])
        sheet.write_row(3, 0, ["s", "km/h", "kN"])
        for k in range(ROWS):
            sheet.write_row(k + 4, 0, [float(T_S[k]), float(V_KMH[k]), float(F_N[k] * _KN)])
    return file.getvalue()


def _names() -> list[DialectFile]:
    """Headers and files."""
    plain, speed, force = cells(T_S), cells(V_KMH), cells(F_N)
    gear = ["2"] * ROWS
    comma = cells(T_S, comma=True), cells(V_KMH, comma=True)
    return [
        DialectFile(
            "PlotJuggler: __time and paths",
            lines(["__time,/odom/speed_m_s,/drawbar/force_N"], [plain, cells(V_M_S), force]),
            {"v": ("/odom/speed_m_s", SI), "F": ("/drawbar/force_N", SI)},
        ),
        DialectFile(
            "lines of an old Mac",
            lines(["time_s,speed_kmh,force_N"], [plain, speed, force], end="\r"),
            {"v": ("speed_kmh", KMH), "F": ("force_N", SI)},
        ),
        DialectFile(
            "Parquet with units in its metadata",
            _parquet(),
            {"v": ("speed", KMH), "F": ("force", _KN)},
            suffix=".parquet",
        ),
        DialectFile(
            "Excel: a title, names and units in German",
            _workbook(),
            {"v": ("Geschwindigkeit", KMH), "F": ("Zugkraft", _KN)},
            suffix=".xlsx",
        ),
        DialectFile(
            "aligned columns, names of two words",
            lines(
                [
                    "     Run Time   Ground Speed      Pull Force",
                    "            s           km/h               N",
                ],
                [cells(x, "{:>14.4f}") for x in (T_S, V_KMH, F_N)],
                "",
            ),
            {"v": ("Ground Speed", KMH), "F": ("Pull Force", SI)},
            suffix=".prn",
        ),
        DialectFile(
            "tabs, thousands by commas",
            lines(
                ["Time [ms]\tSpeed [m/s]\tForce [N]"],
                [cells(T_S * 1000, "{:,.0f}"), cells(V_M_S), cells(F_N, "{:,.2f}")],
                "\t",
            ),
            {"v": ("Speed [m/s]", SI), "F": ("Force [N]", SI)},
            suffix=".tsv",
        ),
        DialectFile(
            "a head of keys = values",
            lines(
                [
                    *("[Recorder]", "Rate = 50", "Start = 13.11.2026", "[Data]"),
                    *("Time;Speed;Force", "[s];[km/h];[N]"),
                ],
                [plain, speed, force],
                ";",
            ),
            {"v": ("Speed", KMH), "F": ("Force", SI)},
        ),
        DialectFile(
            "a counter before the time",
            lines(
                ["Index,Timestamp [ms],Speed [km/h],Force [kN]"],
                [as_integers(T_S, 50), as_integers(T_S, 1000), speed, cells(F_N * _KN)],
            ),
            {"v": ("Speed [km/h]", KMH), "F": ("Force [kN]", _KN)},
        ),
        DialectFile(
            "French names and decanewtons",
            lines(
                ["Temps (s);Vitesse (km/h);Effort de traction (daN)"],
                [*comma, cells(F_N / 10, comma=True)],
                ";",
            ),
            {"v": ("Vitesse (km/h)", KMH), "F": ("Effort de traction (daN)", 0.1)},
        ),
        DialectFile(
            "groups over the names",
            lines(
                ["Clock,Machine,,", "Time (s),Speed (km/h),Force (N),Gear"],
                [plain, speed, force, gear],
            ),
            {"v": ("Speed (km/h)", KMH), "F": ("Force (N)", SI)},
        ),
        DialectFile(
            "packed with gzip",
            gzip.compress(lines(["time_s,speed_kmh,force_N"], [plain, speed, force])),
            {"v": ("speed_kmh", KMH), "F": ("force_N", SI)},
            suffix=".csv.gz",
        ),
    ]  # fmt: skip


def _times() -> list[DialectFile]:
    """Times."""
    speed, force = cells(V_KMH), cells(F_N)
    week = ["2444"] * ROWS
    head = "Speed [km/h],Force [N]"
    fields = {"v": ("Speed [km/h]", KMH), "F": ("Force [N]", SI)}
    minutes = [f"{int(t // 3600)}:{int(t // 60):02d}:{t % 60:06.3f}" for t in T_S]
    floats = [f"{T0_NS + t * 1e9:.8e}" for t in T_S]
    return [
        DialectFile(
            "the form of the time in its name",
            lines(["Time (hh:mm:ss.sss)," + head], [stamps("%H:%M:%S.%3f"), speed, force]),
            fields,
            t0_ns=29_730 * 10**9,
        ),
        DialectFile(
            "microseconds since 1970",
            lines(["epoch," + head], [as_integers(T_S + T0_NS / 1e9, 1e6), speed, force]),
            fields,
            t0_ns=T0_NS,
        ),
        DialectFile(
            "from before the trigger",
            lines(["Time (s)," + head], [cells(T_S - 2.0), speed, force]),
            fields,
            t0_ns=-2 * 10**9,
        ),
        DialectFile(
            "elapsed hours, minutes, seconds",
            lines(["Elapsed," + head], [minutes, speed, force]),
            fields,
        ),
        DialectFile(
            "ISO with a comma before the fraction",
            lines(
                ["Timestamp;Speed [km/h];Force [N]"],
                [stamps("%Y-%m-%dT%H:%M:%S,%3f"), speed, force],
                ";",
            ),
            fields,
            t0_ns=T0_NS,
        ),
        DialectFile(
            "nanoseconds since 1970 in nine digits",
            lines(["timestamp," + head], [floats, speed, force]),
            fields,
            keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "ISO durations",
            lines(["time," + head], [cells(T_S, "PT{:.2f}S"), speed, force]),
            fields,
            keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "a counter of milliseconds of sixteen bits",
            lines(["Time [ms]," + head], [as_integers((T_S * 1000) % 65536), speed, force]),
            fields,
        ),
        DialectFile(
            "week and seconds of GPS",
            lines(["GPSWeek,GPSTime," + head], [week, cells(T_S + 461_730), speed, force]),
            fields,
            t0_ns=461_730 * 10**9,
        ),
    ]  # fmt: skip


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_names(), *_times()]
