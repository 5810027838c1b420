"""One drive as scopes, apps, motor controllers, robots and loggers write it: a file a dialect.

Written from what is known of these formats; no file is copied. Every file holds the same drive, so
that what a reader takes from it can be compared with what was driven.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RATE_HZ: Final = 50.0
ROWS: Final = 4000
MASS_KG: Final = 1200.0
RADIUS_M: Final = 0.35
GEAR: Final = 9.665
NM_PER_A: Final = 0.12
POLE_PAIRS: Final = 7
#: Friday, the day is beyond 12.
BEGIN: Final = datetime(2026, 11, 13, 8, 15, 30, tzinfo=UTC)


def _drive() -> dict[str, Floats]:
    """Starts and stops along a straight line, and what sensors would show."""
    random = np.random.default_rng(7)
    t = np.arange(ROWS) / RATE_HZ
    lap = t % 16.0
    top = 2.0 + 1.5 * np.sin(0.7 * (t // 16.0))
    ramp = np.clip(lap - 2.0, 0, 4) - np.clip(lap - 8.0, 0, 4)
    v = top * (ramp / 4.0) ** 2 * (3 - 2 * ramp / 4.0)
    a = np.gradient(v, t)
    force = MASS_KG * a + 90.0 * v + 120.0 * np.sign(v) * (v > 0.01)
    force = force + random.normal(0, 4.0, ROWS)
    torque = force * RADIUS_M
    wheel = v / RADIUS_M
    return {
        "t": t,
        "v": v,
        "a": a + random.normal(0, 0.02, ROWS),
        "F": force,
        "x": np.cumsum(v) / RATE_HZ,
        "left": torque / 2,
        "right": torque / 2,
        "motor_torque": torque / GEAR,
        "motor_rpm": wheel * GEAR * 60 / (2 * np.pi),
        "current": torque / GEAR / NM_PER_A,
        "wheel": wheel,
        "az": 9.80665 + random.normal(0, 0.02, ROWS),
        "volt": 48.0 - 0.01 * torque,
    }


DRIVE: Final = _drive()


@dataclass(frozen=True)
class DialectFile:
    """A file of the drive.

    Attributes:
        name: of the dialect.
        data: its bytes.
        suffix: of its name.
        fields: by quantity of the drive: the field, and by what the drive's numbers are multiplied.
        keys: answers to what its reader has to ask, as `--set` takes them.
        t0: log time of its first row in ns; None where it only counts.
    """

    name: str
    data: bytes
    fields: dict[str, tuple[str, float]]
    suffix: str = ".csv"
    keys: tuple[str, ...] = ()
    t0_ns: int | None = None
    topic: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Style:
    """How cells and lines are written."""

    separator: str = ","
    decimal: str = "."
    digits: int = 5
    end: str = "\n"
    quote: bool = False
    tail: str = ""
    encoding: str = "utf-8"

    def cell(self, value: Any) -> str:
        """A cell."""
        text = value if isinstance(value, str) else f"{value:.{self.digits}f}"
        if not isinstance(value, str):
            text = text.replace(".", self.decimal)
        return f'"{text}"' if self.quote else text

    def table(self, columns: Sequence[Any], head: Sequence[str]) -> bytes:
        """Lines above, and the rows."""
        rows = [
            self.separator.join(map(self.cell, row)) + self.tail
            for row in zip(*columns, strict=True)
        ]
        return (self.end.join([*head, *rows]) + self.end).encode(self.encoding)


def stamps(form: str, begin: datetime = BEGIN) -> list[str]:
    """The rows' times as text; `%3f` has milliseconds."""
    found: list[str] = []
    for k in range(ROWS):
        moment = begin + timedelta(seconds=k / RATE_HZ)
        milli = f"{moment.microsecond // 1000:03d}"
        found.append(moment.strftime(form.replace("%3f", milli)))
    return found


def whole(values: NDArray[Any], scale: float = 1.0) -> list[str]:
    """Integers as text."""
    return [str(round(float(x) * scale)) for x in values]


T0_NS: Final = int(BEGIN.timestamp()) * 10**9
MIDNIGHT_NS: Final = (8 * 3600 + 15 * 60 + 30) * 10**9
SI: Final = 1.0
KMH: Final = 3.6


def _scopes(d: dict[str, Floats]) -> list[DialectFile]:
    ch = [d["t"], d["volt"], d["F"] / 1000]
    six = Style(digits=6)
    return [
        DialectFile(
            "Keysight: two rows of head",
            six.table(ch, ["x-axis,1,2", "second,Volt,Volt"]),
            {"F": ("2", 1e-3)},
            keys=("log.time=x-axis",),
        ),
        DialectFile(
            "Tektronix: preamble of keys and values",
            six.table(
                ch,
                [
                    "Model,MSO44",
                    "Firmware Version,1.2",
                    "",
                    "Waveform Type,ANALOG",
                    "Horizontal Units,s",
                    "Sample Interval,0.02",
                    "Record Length,4000",
                    "",
                    "TIME,CH1,CH2",
                ],
            ),
            {"F": ("CH2", 1e-3)},
        ),
        DialectFile(
            "PicoScope: names, units, a blank line",
            six.table([d["t"] * 1000, *ch[1:]], ["Time,Channel A,Channel B", "(ms),(V),(mV)", ""]),
            {"F": ("Channel B", 1e-3)},
        ),
        DialectFile(
            "PicoScope, German",
            Style(";", ",", 6).table(
                [d["t"] * 1000, *ch[1:]], ["Zeit;Kanal A;Kanal B", "(ms);(V);(mV)", ""]
            ),
            {"F": ("Kanal B", 1e-3)},
        ),
        DialectFile(
            "Rigol: time by increments", six.table(ch, ["Time(s),CH1V,CH2V"]), {"F": ("CH2V", 1e-3)}
        ),
        DialectFile(
            "Saleae: time in brackets",
            Style(digits=9).table([d["t"], d["volt"]], ["Time [s],Channel 0"]),
            {"volt": ("Channel 0", SI)},
        ),
        DialectFile(
            "LabVIEW .lvm: tabs, a head of sections",
            Style("\t", ".", 6).table(
                ch,
                [
                    "LabVIEW Measurement\t",
                    "Writer_Version\t2",
                    "Separator\tTab",
                    "Date\t2026/11/13",
                    "***End_of_Header***\t",
                    "\t",
                    "Channels\t2\t\t",
                    "X_Value\tVoltage\tForce\t",
                ],
            ),
            {"F": ("Force", 1e-3)},
            suffix=".txt",
        ),
        DialectFile(
            "scope without names",
            six.table(ch, []),
            {"F": ("column 3", 1e-3)},
            keys=("log.time=column 1",),
        ),
    ]


def _apps(d: dict[str, Floats]) -> list[DialectFile]:
    kmh = d["v"] * KMH
    return [
        DialectFile(
            "RaceChrono: preamble, a row of units",
            Style().table(
                [[f"{T0_NS / 1e9 + t:.3f}" for t in d["t"]], d["t"], kmh, d["a"] / 9.80665],
                [
                    "This file is created using an app",
                    "Format,3",
                    "",
                    "Session,Yard",
                    "timestamp,elapsed_time,speed,longitudinal_acc",
                    "unix time,s,km/h,G",
                ],
            ),
            {"v": ("speed", KMH)},
            t0_ns=None,
        ),
        DialectFile(
            "Harry's: time of day in UTC",
            Style(";", ".", 4).table(
                [stamps("%H:%M:%S.%3f"), kmh, d["a"]],
                ["UTC;Speed (km/h);Longitudinal acceleration [m/s²]"],
            ),
            {"v": ("Speed (km/h)", KMH)},
            t0_ns=MIDNIGHT_NS,
        ),
        DialectFile(
            "phyphox: quoted names with units",
            Style(digits=9).table(
                [d["t"], d["a"], d["az"]],
                ['"Time (s)","Acceleration x (m/s^2)","Acceleration z (m/s^2)"'],
            ),
            {"a": ("Acceleration x (m/s^2)", SI)},
        ),
        DialectFile(
            "phyphox: semicolon and decimal comma",
            Style(";", ",", 9).table([d["t"], d["a"]], ['"Time (s)";"Acceleration x (m/s^2)"']),
            {"a": ("Acceleration x (m/s^2)", SI)},
        ),
        DialectFile(
            "Sensor Logger: ns since 1970 and seconds",
            Style(digits=6).table(
                [[str(T0_NS + round(t * 1e9)) for t in d["t"]], d["t"], d["a"]],
                ["time,seconds_elapsed,x"],
            ),
            {"a": ("x", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "Torque app: two times, month names",
            Style().table(
                [stamps("%d-%b-%Y %H:%M:%S.%3f"), kmh], ["Device Time,Speed (OBD)(km/h)"]
            ),
            {"v": ("Speed (OBD)(km/h)", KMH)},
            keys=("log.time=Device Time",),
            t0_ns=T0_NS,
        ),
        DialectFile(
            "VBO: hhmmss.ss",
            Style(" ", ".", 4).table([stamps("%H%M%S.%3f"), kmh], ["time velocity_kmh"]),
            {"v": ("velocity_kmh", KMH)},
            suffix=".txt",
            t0_ns=MIDNIGHT_NS,
        ),
        DialectFile(
            "GPS logger: ISO with zone",
            Style().table([stamps("%Y-%m-%dT%H:%M:%S.%3fZ"), d["v"]], ["time,speed_m_s"]),
            {"v": ("speed_m_s", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "app in UTF-16 with a mark",
            Style("\t", encoding="utf-16").table([d["t"], kmh], ["Time (s)\tSpeed (km/h)"]),
            {"v": ("Speed (km/h)", KMH)},
            suffix=".txt",
        ),
        DialectFile(
            "app in mph with every cell quoted",
            Style(quote=True, end="\r\n").table(
                [d["t"], d["v"] / 0.44704], ['"Elapsed (sec)","Speed (mph)"']
            ),
            {"v": ("Speed (mph)", 1 / 0.44704)},
        ),
    ]


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
                [d["t"], d["wheel"] / 2 / np.pi, d["current"]],
                ["time_s,vel_estimate,iq_measured_A"],
            ),
            {"current": ("iq_measured_A", SI)},
        ),
        DialectFile(
            "Roboteq: milliseconds and tabs",
            Style("\t", ".", 1).table(
                [whole(d["t"], 1000), whole(d["motor_rpm"]), d["current"]],
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
            keys=("log.time=Datum Zeit",),
            t0_ns=T0_NS,
        ),
        DialectFile(
            "drive: ms without a unit, told by its steps",
            Style().table(
                [whole(d["t"], 1000), d["motor_torque"], d["motor_rpm"]],
                ["Time,Motor Torque [Nm],Motor Speed [rpm]"],
            ),
            {"motor_torque": ("Motor Torque [Nm]", SI), "motor_rpm": ("Motor Speed [rpm]", SI)},
        ),
        DialectFile(
            "drive: two pairs side by side",
            Style(";", ",", 4).table(
                [d["t"], d["left"], d["t"], d["right"]],
                ["Time [s];left_Mz_Nm;Time [s];right_Mz_Nm"],
            ),
            {"left": ("left_Mz_Nm", SI), "right": ("right_Mz_Nm", SI)},
            topic={"right": "table/2"},
        ),
        DialectFile(
            "Siemens trace: a comma in quotes",
            Style(",", ",", 3, quote=True).table(
                [d["t"] * 1000, d["motor_torque"]], ['"Zeit [ms]","Drehmoment [Nm]"']
            ),
            {"motor_torque": ("Drehmoment [Nm]", SI)},
        ),
        DialectFile(
            "pump controller in Latin-1",
            Style(";", ",", 3, encoding="latin-1").table(
                [d["t"], d["a"]], ["Zeit [s];Beschleunigung längs [m/s²]"]
            ),
            {"a": ("Beschleunigung längs [m/s²]", SI)},
        ),
    ]


def _robots(d: dict[str, Floats]) -> list[DialectFile]:
    ns = [str(T0_NS + round(t * 1e9)) for t in d["t"]]
    us = whole(d["t"] + 812.5, 1e6)
    return [
        DialectFile(
            "rostopic echo -p",
            Style(digits=6).table(
                [ns, ns, d["wheel"]], ["%time,field.header.stamp,field.velocity0"]
            ),
            {"wheel": ("field.velocity0", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "PX4: microseconds since boot by their steps",
            Style(digits=6).table([us, d["a"], d["az"]], ["timestamp,x,z"]),
            {"a": ("x", SI)},
            t0_ns=812_500_000_000,
        ),
        DialectFile(
            "ArduPilot: TimeUS",
            Style(digits=6).table([us, d["v"]], ["TimeUS,Spd"]),
            {"v": ("Spd", SI)},
            t0_ns=812_500_000_000,
        ),
        DialectFile(
            "numpy.savetxt: a comment as head",
            Style(" ", digits=8).table([d["t"], d["v"], d["F"]], ["# t v F"]),
            {"F": ("F", SI)},
            suffix=".txt",
        ),
        DialectFile(
            "UR: timestamp, blanks",
            Style(" ", digits=6).table([d["t"] + 5012.25, d["F"]], ["timestamp actual_force_0"]),
            {"F": ("actual_force_0", SI)},
            suffix=".txt",
            t0_ns=5_012_250_000_000,
        ),
        DialectFile(
            "KUKA: semicolons, seconds",
            Style(";", digits=4).table([d["t"], d["left"]], ["Zeit[s];Torque_A1[Nm]"]),
            {"left": ("Torque_A1[Nm]", SI)},
        ),
        DialectFile(
            "pandas: an index without a name",
            Style(digits=6).table([whole(np.arange(ROWS)), d["t"], d["v"]], [",time_s,speed_m_s"]),
            {"v": ("speed_m_s", SI)},
        ),
        DialectFile(
            "Motive: names twice",
            Style(digits=5).table([d["t"], d["x"], d["v"]], ["Time (s),X,X"]),
            {"v": ("X (2)", SI)},
        ),
        DialectFile(
            "epoch in seconds with fractions",
            Style(digits=3).table(
                [[f"{T0_NS / 1e9 + t:.3f}" for t in d["t"]], d["v"]], ["Timestamps,velocity_m_s"]
            ),
            {"v": ("velocity_m_s", 1)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "epoch in milliseconds",
            Style().table([whole(d["t"] + T0_NS / 1e9, 1000), d["v"]], ["TIMESTAMP,v"]),
            {"v": ("v", SI)},
            t0_ns=T0_NS,
        ),
    ]


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
                [stamps("%d/%m/%Y"), stamps("%H:%M:%S.%3f"), kmh], ["Date,Time,Speed [km/h]"]
            ),
            {"v": ("Speed [km/h]", KMH)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "day or month first, answered",
            Style().table([stamps("%d/%m/%Y %H:%M:%S.%3f", early), kmh], ["Date,Speed [km/h]"]),
            {"v": ("Speed [km/h]", KMH)},
            keys=("log.day_first=true",),
            t0_ns=int(early.timestamp()) * 10**9,
        ),
        DialectFile(
            "over midnight",
            Style(";").table([stamps("%H:%M:%S.%3f", night), kmh], ["Time;Speed [km/h]"]),
            {"v": ("Speed [km/h]", KMH)},
            t0_ns=(23 * 3600 + 59 * 60 + 20) * 10**9,
        ),
        DialectFile(
            "AM and PM",
            Style().table([stamps("%m/%d/%Y %I:%M:%S.%3f %p"), kmh], ["DateTime,Speed [km/h]"]),
            {"v": ("Speed [km/h]", KMH)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "spreadsheet serials",
            Style(";", digits=4).table([serial, kmh], ["Time;Speed (km/h)"]),
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
                [d["t"], d["F"]], ["Messung 7", "Bediener: N. N.", "", "Zeit [s];Kraft [N]"]
            ),
            {"F": ("Kraft [N]", SI)},
        ),
        DialectFile(
            "bars between",
            Style("|", digits=4).table([d["t"], d["F"]], ["time_s|force_N"]),
            {"F": ("force_N", SI)},
        ),
        DialectFile(
            "MATLAB writematrix, no names",
            Style(digits=5).table([d["t"], d["v"], d["F"]], []),
            {"F": ("column 3", SI)},
            keys=("log.time=column 1", "log.time_unit=s"),
        ),
        DialectFile(
            "a thousand columns",
            Style(digits=2).table(
                [d["t"][:1000], d["F"][:1000], *([d["v"][:1000]] * 1000)],
                ["time_s,force_N," + ",".join(f"c{k}" for k in range(1000))],
            ),
            {"F": ("force_N", SI)},
        ),
        DialectFile(
            "DIAdem: names, units, tabs",
            Style("\t", ",", 4).table([d["t"], d["F"] / 1000], ["Time\tForce", "s\tkN"]),
            {"F": ("Force", 1e-3)},
            suffix=".dat",
        ),
        DialectFile(
            "steps of 1000 are asked for",
            Style().table([whole(np.arange(ROWS) * 1000.0), d["v"]], ["Time,speed_m_s"]),
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


_MAKERS: Final[tuple[Callable[[dict[str, Floats]], list[DialectFile]], ...]] = (
    _scopes,
    _apps,
    _controllers,
    _robots,
    _loggers,
)


def dialect_files() -> list[DialectFile]:
    """Every file of the table of dialects."""
    return [file for make in _MAKERS for file in make(DRIVE)]
