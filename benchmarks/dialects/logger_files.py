"""What data loggers and spreadsheets export."""

from datetime import UTC, datetime

import numpy as np

from benchmarks.dialects.dialect_file import (
    DRIVE,
    KMH,
    ROWS,
    SI,
    T0_NS,
    DialectFile,
    Floats,
    Style,
    as_integers,
    stamps,
)


def _loggers(d: dict[str, Floats]) -> list[DialectFile]:
    kmh = d["v"] * KMH
    night = datetime(2026, 11, 13, 23, 59, 20, tzinfo=UTC)
    order = np.random.default_rng(3).permutation(ROWS)
    serial = [f"{46339 + (8 * 3600 + 15 * 60 + 30 + t) / 86400:.10f}" for t in d["t"]]
    early = datetime(2026, 4, 3, 8, 15, 30, tzinfo=UTC)
    return [
        DialectFile(
            "date and time in two columns",
            Style().table(
                [stamps("%d/%m/%Y"), stamps("%H:%M:%S.%3f"), kmh, d["F"]],
                ["Date,Time,Speed [km/h],Force [N]"],
            ),
            {"v": ("Speed [km/h]", KMH)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "day or month first, answered",
            Style().table(
                [stamps("%d/%m/%Y %H:%M:%S.%3f", early), kmh, d["F"]],
                ["Date,Speed [km/h],Force [N]"],
            ),
            {"v": ("Speed [km/h]", KMH)},
            keys=("log.day_first=true",),
            t0_ns=int(early.timestamp()) * 10**9,
        ),
        DialectFile(
            "over midnight",
            Style(";").table(
                [stamps("%H:%M:%S.%3f", night), kmh, d["F"]], ["Time;Speed [km/h];Force [N]"]
            ),
            {"v": ("Speed [km/h]", KMH)},
            t0_ns=(23 * 3600 + 59 * 60 + 20) * 10**9,
        ),
        DialectFile(
            "AM and PM",
            Style().table(
                [stamps("%m/%d/%Y %I:%M:%S.%3f %p"), kmh, d["F"]],
                ["DateTime,Speed [km/h],Force [N]"],
            ),
            {"v": ("Speed [km/h]", KMH)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "spreadsheet serials",
            Style(";", digits=4).table([serial, kmh, d["F"]], ["Time;Speed (km/h);Force (N)"]),
            {"v": ("Speed (km/h)", KMH)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "no time, a rate",
            Style().table([kmh, d["F"]], ["speed_kmh,force_N"]),
            {"F": ("force_N", SI)},
            keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "shuffled rows",
            Style().table(
                [c[order] for c in (d["t"], d["v"], d["F"])], ["Time [s],speed_m_s,force_N"]
            ),
            {"F": ("force_N", SI)},
        ),
        DialectFile(
            "units over the names",
            Style(";", ",", 4).table(
                [d["t"], kmh, d["F"]], ["s;km/h;N", "Zeit;Geschwindigkeit;Kraft"]
            ),
            {"F": ("Kraft", SI)},
        ),
        DialectFile(
            "a mark, CRLF, preamble",
            "\ufeff".encode()
            + Style(";", ",", 3, end="\r\n").table(
                [d["t"], d["F"], d["v"]],
                ["Messung 7", "Bediener: N. N.", "", "Zeit [s];Kraft [N];Tempo [m/s]"],
            ),
            {"F": ("Kraft [N]", SI)},
        ),
        DialectFile(
            "bars between",
            Style("|", digits=4).table([d["t"], d["F"], d["v"]], ["time_s|force_N|speed_m_s"]),
            {"F": ("force_N", SI)},
        ),
        DialectFile(
            "MATLAB writematrix, no names",
            Style(digits=5).table([d["t"], d["v"], d["F"]], []),
            {"F": ("column 3", SI)},
            keys=("log.time=column 1", "log.time_unit=s"),
            channels={"speed_x_m_s": 'field = "column 2"', "force_x_N": 'field = "column 3"'},
        ),
        DialectFile(
            "a thousand columns",
            Style(digits=2).table(
                [d["t"], d["F"], d["v"], *([d["v"]] * 1000)],
                ["time_s,force_N,speed_m_s," + ",".join(f"c{k}" for k in range(1000))],
            ),
            {"F": ("force_N", SI)},
        ),
        DialectFile(
            "DIAdem: names, units, tabs",
            Style("\t", ",", 4).table(
                [d["t"], d["F"] / 1000, d["v"]], ["Time\tForce\tSpeed", "s\tkN\tm/s"]
            ),
            {"F": ("Force", 1e-3)},
            suffix=".dat",
        ),
        DialectFile(
            "steps of 1000 are asked for",
            Style().table(
                [as_integers(np.arange(ROWS) * 1000.0), d["v"], d["F"]], ["Time,speed_m_s,force_N"]
            ),
            {"v": ("speed_m_s", SI)},
            keys=("log.time_unit=us",),
        ),
        DialectFile(
            "aligned by blanks",
            (
                "Time[s]    Force[N]   Speed[m/s]\n"
                + "".join(
                    f"{t:10.4f}  {f:9.3f}  {v:8.5f}\n"
                    for t, f, v in zip(d["t"], d["F"], d["v"], strict=True)
                )
            ).encode(),
            {"F": ("Force[N]", SI)},
            suffix=".txt",
        ),
    ]


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_loggers(DRIVE)]
