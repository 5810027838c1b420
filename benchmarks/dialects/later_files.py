"""Twenty more dialects, drawn when the reader read all of the first."""

import io
from datetime import UTC, datetime
from typing import Final

import numpy as np
import polars as pl

from benchmarks.dialects.dialect_file import (
    BEGIN,
    DRIVE,
    KMH,
    MIDNIGHT_NS,
    ROWS,
    SI,
    T0_NS,
    DialectFile,
    Style,
    as_integers,
    stamps,
)

_D: Final = DRIVE


def _feather() -> bytes:
    file = io.BytesIO()
    frame = pl.DataFrame({"time_s": _D["t"], "force_N": _D["F"], "speed_m_s": _D["v"]})
    frame.write_ipc(file, compat_level=pl.CompatLevel.oldest())
    return file.getvalue()


def dialect_files() -> list[DialectFile]:
    """The files."""
    t, v, f = _D["t"], _D["v"], _D["F"]
    kmh = v * KMH
    winter = datetime(2026, 1, 31, 8, 15, 30, tzinfo=UTC)
    return [
        DialectFile(
            "INCA: time in the second row of units",
            Style("\t", ".", 6).table(
                [t, kmh, f], ["time\tvVeh\tFdrv", "s\tkm/h\tN", "f8\tf8\tf8"]
            ),
            {"F": ("Fdrv", SI)},
            suffix=".txt",
        ),
        DialectFile(
            "CANalyzer: upper case with dots",
            Style(";", ".", 6).table([t, kmh, f], ["Time[s];ESP_v.VehicleSpeed[km/h];Fx[N]"]),
            {"v": ("ESP_v.VehicleSpeed[km/h]", KMH)},
        ),
        DialectFile(
            "HBM catman: head of twelve lines, tabs, decimal comma",
            Style("\t", ",", 5).table(
                [t, f / 1000, v],
                [
                    "CATMAN",
                    "12",
                    "Kanäle:\t2",
                    "",
                    "T0 = 13.11.2026 08:15:30",
                    "Zeit\tKraft\tGeschwindigkeit",
                    "s\tkN\tm/s",
                ],
            ),
            {"F": ("Kraft", 1e-3)},
            suffix=".asc",
        ),
        DialectFile(
            "Dewesoft: names in brackets, comma in quotes",
            Style(",", ".", 5).table([t, f, v], ['"Time (s)","AI 1/Force (N)","AI 2/Speed (m/s)"']),
            {"F": ("AI 1/Force (N)", SI)},
        ),
        DialectFile(
            "CR1000 TOA5: four lines of head, quoted stamps",
            Style().table(
                [
                    [f'"{s}"' for s in stamps("%Y-%m-%d %H:%M:%S.%3f")],
                    as_integers(np.arange(ROWS)),
                    f,
                    v,
                ],
                [
                    '"TOA5","logger","CR1000"',
                    '"TIMESTAMP","RECORD","Force","Speed"',
                    '"TS","RN","N","m/s"',
                    '"","","Smp","Smp"',
                ],
            ),
            {"F": ("Force", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "AiM: quoted, preamble, units below, blank line",
            Style(quote=True).table(
                [t, kmh, f],
                [
                    '"Format","AiM CSV File"',
                    '"Session","Yard"',
                    "",
                    '"Time","GPS Speed","Pull"',
                    '"s","km/h","N"',
                    "",
                ],
            ),
            {"v": ("GPS Speed", KMH)},
        ),
        DialectFile(
            "MoTeC: blank lines about the units",
            Style(quote=True).table(
                [t, kmh, f],
                [
                    *('"Format","MoTeC CSV File"', "", '"Time","Ground Speed","Drive Force"'),
                    *('"s","km/h","N"', "", ""),
                ],
            ),
            {"v": ("Ground Speed", KMH)},
        ),
        DialectFile(
            "Excel with sep=",
            Style(";", ",", 4).table(
                [t, f, v], ["sep=;", "Zeit [s];Kraft [N];Geschwindigkeit [m/s]"]
            ),
            {"F": ("Kraft [N]", SI)},
        ),
        DialectFile(
            "UTF-16 without a mark",
            Style("\t", encoding="utf-16-le").table(
                [t, f, v], ["Time [s]\tForce [N]\tSpeed [m/s]"]
            ),
            {"F": ("Force [N]", SI)},
            suffix=".txt",
        ),
        DialectFile(
            "rows of CRCRLF",
            Style(end="\r\r\n").table([t, f, v], ["time_s,force_N,speed_m_s"]),
            {"F": ("force_N", SI)},
        ),
        DialectFile(
            "stamps with an offset",
            Style().table(
                [stamps("%Y-%m-%d %H:%M:%S.%3f+00:00"), f, v], ["Timestamp,Force (N),Speed (m/s)"]
            ),
            {"F": ("Force (N)", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "American dates by the day beyond 12",
            Style().table(
                [stamps("%m/%d/%Y %H:%M:%S.%3f", winter), f, v], ["timestamp,force_N,speed_m_s"]
            ),
            {"F": ("force_N", SI)},
            t0_ns=int(winter.timestamp()) * 10**9,
        ),
        DialectFile(
            "microseconds in the name",
            Style().table([as_integers(t, 1e6), f, v], ["t_us,force_N,speed_m_s"]),
            {"F": ("force_N", SI)},
        ),
        DialectFile(
            "time at the end",
            Style().table([f, v, t], ["force_N,speed_m_s,Time (s)"]),
            {"F": ("force_N", SI)},
        ),
        DialectFile(
            "numbers with a plus and an exponent",
            Style(separator=" ", digits=0).table(
                [[f"{x:+.7E}" for x in each] for each in (t, f, v)], ["% Time Force Speed"]
            ),
            {"F": ("Force", SI)},
            suffix=".dat",
            units={"Force": 'unit = "N"', "Speed": 'unit = "m/s"'},
        ),
        DialectFile(
            "time of day to the minute and seconds apart",
            Style(";").table([stamps("%H:%M:%S:%3f"), f, v], ["Uhrzeit;Kraft [N];Tempo [m/s]"]),
            {"F": ("Kraft [N]", SI)},
            t0_ns=MIDNIGHT_NS,
        ),
        DialectFile(
            "minutes as numbers",
            Style(digits=8).table([t / 60, f, v], ["Time [min],Force [N],Speed [m/s]"]),
            {"F": ("Force [N]", SI)},
        ),
        DialectFile(
            "a footer of sums",
            Style().table([t, f, v], ["time_s,force_N,speed_m_s"]) + b"Sum,,\nEnd of file\n",
            {"F": ("force_N", SI)},
        ),
        DialectFile("Feather", _feather(), {"F": ("force_N", SI)}, suffix=".feather"),
        DialectFile(
            "a column of text before the time",
            Style().table(
                [["RUN"] * ROWS, [str(BEGIN.date())] * ROWS, stamps("%H:%M:%S.%3f"), f, v],
                ["state,Date,Time,force [N],speed [m/s]"],
            ),
            {"F": ("force [N]", SI)},
            t0_ns=T0_NS,
        ),
    ]
