"""What scopes and telemetry apps export."""

from benchmarks.dialects.dialect_file import (
    DRIVE,
    KMH,
    MIDNIGHT_NS,
    SI,
    T0_NS,
    DialectFile,
    Floats,
    Style,
    stamps,
)


def _taps(speed: str, force: str) -> dict[str, str]:
    """What the owner of a scope knows: a volt of the tacho is 10 m/s, one of the cell 1,000 N."""
    return {
        "speed_x_m_s": f'field = "{speed}"\nscale = 10.0',
        "force_x_N": f'field = "{force}"\nscale = 1000.0',
    }


def _scopes(d: dict[str, Floats]) -> list[DialectFile]:
    ch = [d["t"], d["volt"], d["F"] / 1000]
    six = Style(digits=6)
    return [
        DialectFile(
            "Keysight: two rows of head",
            six.table(ch, ["x-axis,1,2", "second,Volt,Volt"]),
            {"F": ("2", 1e-3)},
            channels=_taps("1", "2"),
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
            channels=_taps("CH1", "CH2"),
        ),
        DialectFile(
            "PicoScope: names, units, a blank line",
            six.table([d["t"] * 1000, *ch[1:]], ["Time,Channel A,Channel B", "(ms),(V),(mV)", ""]),
            {"F": ("Channel B", 1e-3)},
            channels=_taps("Channel A", "Channel B"),
        ),
        DialectFile(
            "PicoScope, German",
            Style(";", ",", 6).table(
                [d["t"] * 1000, *ch[1:]], ["Zeit;Kanal A;Kanal B", "(ms);(V);(mV)", ""]
            ),
            {"F": ("Kanal B", 1e-3)},
            channels=_taps("Kanal A", "Kanal B"),
        ),
        DialectFile(
            "Rigol: time by increments",
            six.table(ch, ["Time(s),CH1V,CH2V"]),
            {"F": ("CH2V", 1e-3)},
            channels=_taps("CH1V", "CH2V"),
        ),
        DialectFile(
            "Saleae: time in brackets",
            Style(digits=9).table(
                [d["t"], d["volt"], d["F"] / 1000], ["Time [s],Channel 0,Channel 1"]
            ),
            {"volt": ("Channel 0", SI)},
            channels=_taps("Channel 0", "Channel 1"),
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
            units={"Force": 'unit = "kN"'},
            channels={"speed_x_m_s": 'field = "Voltage"\nscale = 10.0'},
        ),
        DialectFile(
            "scope without names",
            six.table(ch, []),
            {"F": ("column 3", 1e-3)},
            keys=("log.time=column 1",),
            channels=_taps("column 2", "column 3"),
        ),
    ]


def _apps(d: dict[str, Floats]) -> list[DialectFile]:
    kmh = d["v"] * KMH
    return [
        DialectFile(
            "RaceChrono: preamble, a row of units",
            Style().table(
                [[f"{T0_NS / 1e9 + t:.3f}" for t in d["t"]], d["t"], kmh, d["a"] / 9.80665, d["F"]],
                [
                    "This file is created using an app",
                    "Format,3",
                    "",
                    "Session,Yard",
                    "timestamp,elapsed_time,speed,longitudinal_acc,drawbar",
                    "unix time,s,km/h,G,N",
                ],
            ),
            {"v": ("speed", KMH)},
            t0_ns=None,
        ),
        DialectFile(
            "Harry's: time of day in UTC",
            Style(";", ".", 4).table(
                [stamps("%H:%M:%S.%3f"), kmh, d["a"], d["F"]],
                ["UTC;Speed (km/h);Longitudinal acceleration [m/s²];Force [N]"],
            ),
            {"v": ("Speed (km/h)", KMH)},
            t0_ns=MIDNIGHT_NS,
        ),
        DialectFile(
            "phyphox: quoted names with units",
            Style(digits=9).table(
                [d["t"], d["a"], d["az"], d["v"], d["F"]],
                [
                    '"Time (s)","Acceleration x (m/s^2)","Acceleration z (m/s^2)",'
                    '"Velocity (m/s)","Force (N)"'
                ],
            ),
            {"a": ("Acceleration x (m/s^2)", SI)},
        ),
        DialectFile(
            "phyphox: semicolon and decimal comma",
            Style(";", ",", 9).table(
                [d["t"], d["a"], d["v"], d["F"]],
                ['"Time (s)";"Acceleration x (m/s^2)";"Velocity (m/s)";"Force (N)"'],
            ),
            {"a": ("Acceleration x (m/s^2)", SI)},
        ),
        DialectFile(
            "Sensor Logger: ns since 1970 and seconds",
            Style(digits=6).table(
                [[str(T0_NS + round(t * 1e9)) for t in d["t"]], d["t"], d["a"], d["v"], d["F"]],
                ["time,seconds_elapsed,x,speed_m_s,force_N"],
            ),
            {"a": ("x", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "Torque app: two times, month names",
            Style().table(
                [stamps("%d-%b-%Y %H:%M:%S.%3f"), kmh, d["F"]],
                ["Device Time,Speed (OBD)(km/h),Force(N)"],
            ),
            {"v": ("Speed (OBD)(km/h)", KMH)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "VBO: hhmmss.ss",
            Style(" ", ".", 4).table(
                [stamps("%H%M%S.%3f"), kmh, d["F"]], ["time velocity_kmh force_N"]
            ),
            {"v": ("velocity_kmh", KMH)},
            suffix=".txt",
            t0_ns=MIDNIGHT_NS,
        ),
        DialectFile(
            "GPS logger: ISO with zone",
            Style().table(
                [stamps("%Y-%m-%dT%H:%M:%S.%3fZ"), d["v"], d["F"]], ["time,speed_m_s,force_N"]
            ),
            {"v": ("speed_m_s", SI)},
            t0_ns=T0_NS,
        ),
        DialectFile(
            "app in UTF-16 with a mark",
            Style("\t", encoding="utf-16").table(
                [d["t"], kmh, d["F"]], ["Time (s)\tSpeed (km/h)\tForce (N)"]
            ),
            {"v": ("Speed (km/h)", KMH)},
            suffix=".txt",
        ),
        DialectFile(
            "app in mph with every cell quoted",
            Style(quote=True, end="\r\n").table(
                [d["t"], d["v"] / 0.44704, d["F"]], ['"Elapsed (sec)","Speed (mph)","Force (N)"']
            ),
            {"v": ("Speed (mph)", 1 / 0.44704)},
        ),
    ]


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_scopes(DRIVE), *_apps(DRIVE)]
