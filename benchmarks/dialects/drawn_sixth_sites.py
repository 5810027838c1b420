"""Dialects of strangers, drawn while the reader was frozen at 0a84e093: buses, plants, sheets."""

from typing import Final

import numpy as np

from benchmarks.dialects.dialect_file import (
    CLOCK,
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

_KN: Final = 1e-3


def _buses() -> list[DialectFile]:
    """Loggers of CAN buses."""
    return [
        DialectFile(
            "CANedge: pandas index, names of signals without units",
            Style(digits=4).table(
                [stamps("%Y-%m-%d %H:%M:%S.%3f000+00:00"), V_KMH, F_N],
                ["TimeStamp,WheelBasedVehicleSpeed,DrawbarForce"],
            ),
            {"F": ("DrawbarForce", SI)}, t0_ns=T0_NS,
            units={"WheelBasedVehicleSpeed": 'unit = "km/h"', "DrawbarForce": 'unit = "N"'},
        ),
        DialectFile(
            "CANoe graphics: message::signal [unit], each row one of them",
            Style(";", digits=4, end="\r\n").table(
                [T_S, V_KMH, F_N],
                ["Time [s];EBC2::FrontAxleSpeed [km/h];Hitch::DraftForce [N]"],
            ),
            {"F": ("Hitch::DraftForce [N]", SI)},
        ),
        DialectFile(
            "IPEmotion: Name and Einheit before the names and units",
            Style(";", ",", 4, encoding="latin-1", end="\r\n").table(
                [[""] * ROWS, T_S, V_KMH, F_N / 1e3],
                ["Messung;M_0001;;", "Datum;13.11.2026;;", "Uhrzeit;08:15:30;;",
                 "Name;Time;v_Fzg;F_Zug", "Einheit;s;km/h;kN"],
            ),
            {"F": ("F_Zug", _KN)},
        ),
        DialectFile(
            "Kvaser: the start of the measurement above, quoted names",
            Style(",", digits=4, end="\r\n").table(
                [T_S, V_KMH, DRIVE["left"] + DRIVE["right"]],
                ['"Kvaser CanKing"', '"Start of measurement","2026-11-13 08:15:30"',
                 '"Time [s]","VehicleSpeed [km/h]","AxleTorque [Nm]"'],
            ),
            {"v": ("VehicleSpeed [km/h]", KMH)},
        ),
        DialectFile(
            "BUSMASTER signals: stars above, HH:MM:SS:mmmm",
            Style(",", digits=4, end="\r\n").table(
                [[f"{c:%H:%M:%S}:{c.microsecond // 100:04d}" for c in CLOCK], V_KMH, F_N],
                ["***BUSMASTER Ver 3.2.2***", "***START DATE AND TIME 13:11:2026 8:15:30:000***",
                 "Time,VehSpeed(km/h),Pull(N)"],
            ),
            {"F": ("Pull(N)", SI)}, t0_ns=MIDNIGHT_NS,
        ),
    ]  # fmt: skip


def _plants() -> list[DialectFile]:
    """Trends of programmable controllers, historians."""
    rockwell = [f"{c:%H:%M:%S};{c.microsecond // 1000:03d}" for c in CLOCK]
    return [
        DialectFile(
            "Siemens S7 data log: UTC Time to the second, //END",
            Style(digits=4, end="\r\n").table(
                [as_integers(np.arange(1, ROWS + 1)), stamps("%m/%d/%Y"), stamps("%H:%M:%S"),
                 V_KMH, F_N],
                ["Record,Date,UTC Time,Speed (km/h),Force (N)"],
            ) + b"//END,,,,\r\n",
            {"F": ("Force (N)", SI)}, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "Studio 5000 trend: Data: before each row, a semicolon before the ms",
            Style(digits=4, end="\r\n").table(
                [['"Data:"'] * ROWS, [f'"{d}"' for d in stamps("%m/%d/%Y")],
                 [f'"{r}"' for r in rockwell], V_KMH, F_N],
                ['"Controller Name:","Loader"', '"Trend Name:","Drive"', '"Trend Tags:",2',
                 '"Sample Period:",20,ms', '"Description:",""',
                 '"Start Time:","11/13/2026","08:15:30;000"',
                 '"Header:","Date","Time","Program:Main.Speed_kmh","Program:Main.Force_N"'],
            ),
            {"F": ("Program:Main.Force_N", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Ignition: t_stamp",
            Style(digits=4).table(
                [stamps("%Y-%m-%d %H:%M:%S.%3f"), V_KMH, F_N],
                ['"t_stamp","Speed_kmh","Force_N"'],
            ),
            {"F": ("Force_N", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "OSIsoft PI: 13-Nov-26 and five digits of a second",
            Style(digits=4).table(
                [stamps("%d-%b-%y %H:%M:%S.%3f00"), V_KMH, F_N],
                ["Timestamp,LDR1:SPEED.PV (km/h),LDR1:PULL.PV (N)"],
            ),
            {"F": ("LDR1:PULL.PV (N)", SI)}, t0_ns=T0_NS, keys=("log.day_first=true",),
        ),
        DialectFile(
            "CODESYS trace: microseconds since the start by their name",
            Style(";", digits=4, end="\r\n").table(
                [as_integers(np.arange(ROWS)), as_integers(T_S + 12.345678, 1e6), V_M_S, F_N],
                ["Index;Timestamp [µs];Application.PLC_PRG.rSpeed [m/s];"
                 "Application.PLC_PRG.rForce [N]"],
            ),
            {"F": ("Application.PLC_PRG.rForce [N]", SI)}, t0_ns=12_345_678_000,
        ),
        DialectFile(
            "Schneider Vijeo: date, time and ms between semicolons",
            Style(";", ",", 4, end="\r\n").table(
                [stamps("%d.%m.%Y"), stamps("%H:%M:%S"),
                 [str(c.microsecond // 1000) for c in CLOCK], V_KMH, F_N],
                ["Date;Time;Msec;Vitesse (km/h);Effort (N)"],
            ),
            {"v": ("Vitesse (km/h)", KMH)}, t0_ns=T0_NS,
        ),
    ]  # fmt: skip


def _sheets() -> list[DialectFile]:
    """Spreadsheets of other locales."""
    hungarian = [f"{c:%Y. %m. %d.} {c.hour}:{c:%M:%S},{c.microsecond // 1000:03d}" for c in CLOCK]
    arabic = str.maketrans("0123456789.", "٠١٢٣٤٥٦٧٨٩٫")
    lakh = [_in_lakhs(f * 1000) for f in F_N]
    swiss = [f"{f:,.2f}".replace(",", "\u2019") for f in F_N * 10]
    return [
        DialectFile(
            "Polish in cp1250",
            Style(";", ",", 4, encoding="cp1250", end="\r\n").table(
                [T_S, V_KMH, F_N], ["Czas [s];Prędkość [km/h];Siła [N]"]
            ),
            {"F": ("Si³a [N]", SI)},
        ),
        DialectFile(
            "Czech: čas, rychlost, síla",
            Style(";", ",", 4).table([T_S, V_KMH, F_N], ["Čas (s);Rychlost (km/h);Síla (N)"]),
            {"F": ("Síla (N)", SI)},
        ),
        DialectFile(
            "Korean: units by their words",
            Style(digits=4).table([T_S, V_KMH, F_N], ["시간(초),속도(km/h),견인력(N)"]),
            {"F": ("견인력(N)", SI)},
        ),
        DialectFile(
            "Hungarian: blanks in the date",
            Style(";", ",", 4).table(
                [hungarian, V_KMH, F_N / 1e3], ["Idő;Sebesség (km/h);Vonóerő (kN)"]
            ),
            {"F": ("Vonóerő (kN)", _KN)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Dutch: km/u",
            Style(";", ",", 4).table(
                [T_S, V_KMH, F_N], ["Tijd (s);Snelheid (km/u);Trekkracht (N)"]
            ),
            {"F": ("Trekkracht (N)", SI)},
        ),
        DialectFile(
            "Danish: km/t",
            Style(";", ",", 4).table([T_S, V_KMH, F_N], ["Tid [s];Hastighed [km/t];Kraft [N]"]),
            {"F": ("Kraft [N]", SI)},
        ),
        DialectFile(
            "Indian: digits in lakhs",
            Style(digits=4, quote=True).table(
                [T_S, V_KMH, lakh], ['"Time (s)","Speed (km/h)","Pull (mN)"']
            ),
            {"v": ("Speed (km/h)", KMH)},
            channels={"force_x_N": 'field = "Pull (mN)"\nscale = 0.001'},
        ),
        DialectFile(
            "Swiss: typographic apostrophes, semicolons, points",
            Style(";", digits=4).table(
                [stamps("%d.%m.%Y %H:%M:%S.%3f"), V_KMH, swiss],
                ["Zeit;Geschwindigkeit (km/h);Zugkraft (dN)"],
            ),
            {"v": ("Geschwindigkeit (km/h)", KMH)}, t0_ns=T0_NS,
            channels={"force_x_N": 'field = "Zugkraft (dN)"\nscale = 0.1'},
        ),
        DialectFile(
            "Arabic digits and decimal sign",
            Style(";").table(
                [[f"{x:.4f}".translate(arabic) for x in each] for each in (T_S, V_KMH, F_N)],
                ["Time (s);Speed (km/h);Force (N)"],
            ),
            {"F": ("Force (N)", SI)},
        ),
        DialectFile(
            "Ukrainian: с, км/год, Н",
            Style(";", ",", 4).table([T_S, V_KMH, F_N], ["Час, с;Швидкість, км/год;Сила, Н"]),
            {"F": ("Сила, Н", SI)},
        ),
        DialectFile(
            "Japanese: 時刻, 車速, けん引力",
            Style(digits=4).table(
                [stamps("%Y/%m/%d %H:%M:%S.%3f"), V_KMH, F_N], ["時刻,車速[km/h],けん引力[N]"]
            ),
            {"F": ("けん引力[N]", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Vietnamese: m/giây",
            Style(digits=4).table(
                [T_S, V_M_S, F_N], ["Thời gian (s),Vận tốc (m/giây),Lực kéo (N)"]
            ),
            {"F": ("Lực kéo (N)", SI)},
        ),
        DialectFile(
            "Romanian: viteză in km/h, the time as 0:00:01,02",
            Style(";", ",", 4).table(
                [[f"0:{int(t // 60):02d}:{t % 60:05.2f}".replace(".", ",") for t in T_S],
                 V_KMH, F_N],
                ["Timp;Viteză (km/h);Forță (N)"],
            ),
            {"F": ("Forță (N)", SI)},
        ),
    ]  # fmt: skip


def _in_lakhs(value: float) -> str:
    """12,34,567.8: three digits, then two by two."""
    sign, text = "-" if value < 0 else "", f"{abs(value):.1f}"
    whole, _, rest = text.partition(".")
    head, last = whole[:-3], whole[-3:]
    pairs = [head[max(0, k - 2) : k] for k in range(len(head), 0, -2)][::-1]
    return f"{sign}{','.join([*pairs, last])}.{rest}"


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_buses(), *_plants(), *_sheets()]
