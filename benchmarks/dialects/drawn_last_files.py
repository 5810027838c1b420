"""Twenty more dialects, drawn against the reader after it was mended for all those before."""

import io
import json
from datetime import UTC, datetime
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.feather as feather
import pyarrow.parquet as pq

from benchmarks.dialects.dialect_file import (
    BEGIN,
    DRIVE,
    F_N,
    KMH,
    MIDNIGHT_NS,
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

_MPH: Final = V_M_S / 0.44704
_LBF: Final = F_N / 4.4482216
_SIX: Final = Style(digits=6)


def _arrow(write: str) -> bytes:
    """Columns without units in their names: one attribute of the file has them."""
    units = {"elapsed": "s", "v": "km/h", "pull": "kN"}
    attributes = {"PANDAS_ATTRS": json.dumps({"units": units})}
    schema = pa.schema([pa.field(name, pa.float64()) for name in units], metadata=attributes)
    table = pa.table([pa.array(T_S), pa.array(V_KMH), pa.array(F_N / 1e3)], schema=schema)
    file = io.BytesIO()
    if write == "parquet":
        pq.write_table(table, file)
    else:
        feather.write_feather(table, file)
    return file.getvalue()


def _scopes() -> list[DialectFile]:
    taps = {
        "speed_x_m_s": 'field = "C1"\nscale = 10.0',
        "force_x_N": 'field = "C2"\nscale = 1000.0',
    }
    volts = [T_S, DRIVE["volt"], F_N / 1e3]
    begin = BEGIN.strftime("%d-%b-%Y %H:%M:%S")
    return [
        DialectFile(
            "LeCroy: segments above, Time,Ampl",
            _SIX.table(
                volts,
                ["LECROYWS3024,52,Waveform", "Segments,1,SegmentSize,4000",
                 "Segment,TrigTime,TimeSinceSegment1", f"#1,{begin},0", "Time,C1,C2"],
            ),
            {"F": ("C2", 1e-3)}, channels=taps,
        ),
        DialectFile(
            "Rohde & Schwarz RTB: in s, CH1 in V",
            _SIX.table(volts, ["in s,C1 in V,C2 in V"]),
            {"F": ("C2 in V", 1e-3)},
            channels={
                "speed_x_m_s": 'field = "C1 in V"\nscale = 10.0',
                "force_x_N": 'field = "C2 in V"\nscale = 1000.0',
            },
        ),
        DialectFile(
            "Yokogawa: a head in quotes, blank first cells",
            Style(digits=6, end="\r\n").table(
                [[""] * ROWS, *volts],
                ['"Model","DL850E"', '"BlockNumber",1', '"SampleRate",50', '"Time unit","s"',
                 '"","Time","C1","C2"', '"","s","V","V"'],
            ),
            {"F": ("C2", 1e-3)}, channels=taps,
        ),
    ]  # fmt: skip


def _apps() -> list[DialectFile]:
    return [
        DialectFile(
            "OBD Fusion: commented start, mph and lbf",
            Style(end="\r\n").table(
                [T_S, _MPH, _LBF],
                ["# StartTime = 11/13/2026 08:15:30.0000 AM",
                 "Time (sec), Vehicle speed (MPH), Pull (lbf)"],
            ),
            {"F": ("Pull (lbf)", 1 / 4.4482216)},
        ),
        DialectFile(
            "Car Scanner: quoted, semicolons, seconds of the day",
            Style(";", quote=True, digits=3).table(
                [T_S + MIDNIGHT_NS / 1e9, V_KMH, F_N], ['"SECONDS";"Speed (km/h)";"Force (N)"']
            ),
            {"v": ("Speed (km/h)", KMH)}, t0_ns=MIDNIGHT_NS,
        ),
        DialectFile(
            "TrackAddict: comments, UTC time beside elapsed",
            Style(digits=3).table(
                [T_S, [f"{T0_NS / 1e9 + t:.3f}" for t in T_S], _MPH, F_N],
                ["# RaceRender Data: TrackAddict 4.6", "# Vehicle: loader", "#",
                 '"Time","UTC Time","Speed (MPH)","Force (N)"'],
            ),
            {"v": ("Speed (MPH)", 1 / 0.44704)}, t0_ns=None,
        ),
        DialectFile(
            "Portuguese spreadsheet: hora, velocidade, força",
            Style(";", ",", 3, encoding="cp1252").table(
                [stamps("%d/%m/%Y %H:%M:%S,%3f"), V_KMH, F_N / 1e3],
                ["Data/Hora;Velocidade (km/h);Força (kN)"],
            ),
            {"F": ("Força (kN)", 1e-3)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Swedish: tid, hastighet, kraft, blanks in thousands",
            Style("\t", ",", 4, encoding="utf-16").table(
                [T_S, V_KMH, [f"{x:,.1f}".replace(",", " ").replace(".", ",") for x in F_N]],
                ["Tid (s)\tHastighet (km/h)\tKraft (N)"],
            ),
            {"v": ("Hastighet (km/h)", KMH)}, suffix=".txt",
        ),
    ]  # fmt: skip


def _controllers() -> list[DialectFile]:
    motor = {"current": ("Motor Current [A]", SI)}
    return [
        DialectFile(
            "Kelly: HH:MM:SS:mmm, motor amps and rpm",
            Style().table(
                [stamps("%H:%M:%S:%3f"), DRIVE["motor_rpm"], DRIVE["current"]],
                ["Time,Motor Speed [rpm],Motor Current [A]"],
            ),
            motor, t0_ns=MIDNIGHT_NS,
        ),
        DialectFile(
            "Sevcon: a tick of 20 ms",
            Style(";").table(
                [as_integers(np.arange(ROWS)), V_M_S, F_N], ["Sample;Speed [m/s];Force [N]"]
            ),
            {"v": ("Speed [m/s]", SI)}, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "VESC: erpm and both currents",
            Style(";").table(
                [as_integers(T_S, 1000), DRIVE["current"] * 0.6, DRIVE["current"],
                 DRIVE["motor_rpm"] * 7],
                ["ms_today;input_current;motor_current;erpm"],
            ),
            {"current": ("motor_current", SI)},
        ),
        DialectFile(
            "Parker: drive torque in %, rpm",
            Style("\t", digits=4).table(
                [T_S * 1000, DRIVE["motor_torque"] / 20 * 100, DRIVE["motor_rpm"]],
                ["Time [ms]\tTorque [%]\tSpeed [rpm]"],
            ),
            {"motor_rpm": ("Speed [rpm]", SI)}, suffix=".txt",
            channels={
                "torque_percent": 'field = "Torque [%]"',
                "force_x_N": 'derive = "torque_percent * 20 [N*m] * 9.665 / wheel_radius_m"',
            },
        ),
        DialectFile(
            "battery monitor: power in kW",
            Style().table(
                [stamps("%Y-%m-%d %H:%M:%S.%3f"), F_N * V_M_S / 1e3, V_KMH],
                ["timestamp,Power [kW],Speed [km/h]"],
            ),
            {"v": ("Speed [km/h]", KMH)}, t0_ns=T0_NS,
        ),
    ]  # fmt: skip


def _robots() -> list[DialectFile]:
    return [
        DialectFile(
            "Fanuc: percent signs over the names",
            Style(" ", digits=5).table(
                [T_S, V_M_S, F_N], ["% Data sampling: 20 ms", "% Time[s] Vel[m/s] Force[N]"]
            ),
            {"F": ("Force[N]", SI)}, suffix=".dat",
        ),
        DialectFile(
            "ABB: log of signals with @ and tabs",
            Style("\t", digits=5).table([T_S, V_M_S, F_N], ["@time_s\t@tcp_speed_m_s\t@force_N"]),
            {"F": ("@force_N", SI)}, suffix=".log",
        ),
        DialectFile(
            "Foxglove: log time as ISO with nanoseconds",
            Style().table(
                [stamps("%Y-%m-%dT%H:%M:%S.%3f000000Z"), V_M_S, F_N],
                ["log_time,/odom.speed_m_s,/cell.force_N"],
            ),
            {"v": ("/odom.speed_m_s", SI)}, t0_ns=T0_NS,
        ),
    ]  # fmt: skip


def _loggers() -> list[DialectFile]:
    evening = datetime(2026, 11, 13, 23, 59, 30, tzinfo=UTC)
    return [
        DialectFile(
            "Graphtec: number, date and time in a cell, ms apart, signs with a blank",
            Style(digits=3).table(
                [as_integers(np.arange(1, ROWS + 1)), stamps("%Y/%m/%d %H:%M:%S"), stamps("%3f"),
                 [f"{'+' if x >= 0 else '-'} {abs(x):.3f}" for x in V_M_S],
                 [f"{'+' if x >= 0 else '-'} {abs(x):.1f}" for x in F_N]],
                ["Vendor,GRAPHTEC", "Model,GL840", "Number,Date&Time,ms,CH1,CH2",
                 "NO.,Time,ms,m/s,N"],
            ),
            {"F": ("CH2", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "12-hour clock over midnight",
            Style().table(
                [stamps("%I:%M:%S.%3f %p", evening), V_KMH, F_N], ["Time,Speed [km/h],Force [N]"]
            ),
            {"v": ("Speed [km/h]", KMH)}, t0_ns=86_370 * 10**9,
        ),
        DialectFile(
            "Parquet: units in the frame's attributes", _arrow("parquet"), {"F": ("pull", 1e-3)},
            suffix=".parquet",
        ),
        DialectFile(
            "Feather: units in the frame's attributes", _arrow("feather"), {"F": ("pull", 1e-3)},
            suffix=".feather",
        ),
    ]  # fmt: skip


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_scopes(), *_apps(), *_controllers(), *_robots(), *_loggers()]
