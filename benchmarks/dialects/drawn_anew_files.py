"""Dialects drawn while the reader was frozen at 81a16b31: several columns of one quantity."""

from typing import Final

import numpy as np

from benchmarks.dialects.dialect_file import (
    CLOCK,
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
    Floats,
    Style,
    as_integers,
    stamps,
)

_KN: Final = 1e-3
_HEAD: Final = "Speed (km/h),Force (N)"
_FIELDS: Final = {"F": ("Force (N)", SI)}


def _earlier(values: Floats, seconds: float) -> Floats:
    """What is wanted comes before what is."""
    return np.interp(T_S + seconds, T_S, values)


def _clocks() -> list[DialectFile]:
    """Times."""
    milli = [f"{c.microsecond // 1000:03d}" for c in CLOCK]
    spanish = [f"{c:%d/%m/%Y %I:%M:%S},{ms} a. m." for c, ms in zip(CLOCK, milli, strict=True)]
    chinese = [
        f"{c.year}年{c.month}月{c.day}日 {c:%H:%M:%S}.{ms}"
        for c, ms in zip(CLOCK, milli, strict=True)
    ]
    kibana = [f'"{c:%b %d, %Y @ %H:%M:%S}.{ms}"' for c, ms in zip(CLOCK, milli, strict=True)]
    postgres = [s.rstrip("0").rstrip(".") + "+00" for s in stamps("%Y-%m-%d %H:%M:%S.%3f")]
    deltas = [f"0 days 00:{int(t // 60):02d}:{t % 60:09.6f}" for t in T_S]
    days = T0_NS / 86_400e9 + 25_569
    return [
        DialectFile(
            "GoPro: cts beside an ISO date",
            Style(digits=4).table(
                [[f"{t * 1000:.3f}" for t in T_S], stamps("%Y-%m-%dT%H:%M:%S.%3fZ"), V_M_S, F_N],
                ['"cts","date","GPS (2D speed) [m/s]","Tow bar [N]"'],
            ),
            {"F": ("Tow bar [N]", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "the time before the day in one cell",
            Style(";").table(
                [stamps("%H:%M:%S.%3f %d/%m/%Y"), V_KMH, F_N], ["Fecha;Speed (km/h);Force (N)"]
            ),
            _FIELDS, t0_ns=T0_NS,
        ),
        DialectFile(
            "u-blox: iTOW and gSpeed",
            Style(digits=3).table(
                [as_integers(T_S + 461_730, 1000), V_M_S * 1000, F_N],
                ["iTOW [ms],gSpeed [mm/s],Pull [N]"],
            ),
            {"F": ("Pull [N]", SI)}, t0_ns=461_730 * 10**9,
        ),
        DialectFile(
            "PostgreSQL: an offset of two digits, fractions without their zeros",
            Style().table([postgres, V_KMH, F_N], ["ts," + _HEAD]), _FIELDS, t0_ns=T0_NS,
        ),
        DialectFile(
            "pandas: timedelta", Style().table([deltas, V_KMH, F_N], ["time," + _HEAD]), _FIELDS,
        ),
        DialectFile(
            "Kibana: month, day, year @ time",
            Style().table([kibana, V_KMH, F_N], ["@timestamp," + _HEAD]), _FIELDS, t0_ns=T0_NS,
        ),
        DialectFile(
            "Spanish spreadsheet: a. m.",
            Style(";", ",").table(
                [spanish, V_KMH, F_N], ["Fecha y hora;Velocidad (km/h);Fuerza (N)"]
            ),
            {"F": ("Fuerza (N)", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Chinese: year, month and day by their signs",
            Style().table([chinese, V_KMH, F_N], ["时间,速度(km/h),牵引力(N)"]),
            {"F": ("牵引力(N)", SI)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "a spreadsheet's day and fraction of the day in two columns",
            Style(";").table(
                [[str(int(days))] * ROWS, [f"{days % 1 + t / 86_400:.10f}" for t in T_S],
                 V_KMH, F_N],
                ["Date;Time;Speed (km/h);Force (N)"],
            ),
            _FIELDS, keys=("log.rate_hz=50",),
        ),
        DialectFile(
            "SQL: single quotes",
            Style(digits=4).table(
                [[f"'{s}'" for s in stamps("%Y-%m-%d %H:%M:%S.%3f")], V_KMH, F_N],
                ["'created_at','speed_kmh','force_N'"],
            ),
            {"F": ("'force_N'", SI)}, t0_ns=T0_NS,
        ),
    ]  # fmt: skip


def _shapes() -> list[DialectFile]:
    """Cells and rows."""
    rows = Style(digits=4).table([T_S, V_KMH, F_N], ["Time (s)," + _HEAD]).decode().splitlines()
    repeated = [
        line
        for k, row in enumerate(rows)
        for line in ([rows[0], row] if k > 1 and k % 1000 == 1 else [row])
    ]
    scaled = [f"{x / 1000:.3f} kN" if abs(x) >= 1000 else f"{x:.1f} N" for x in F_N]
    short = [f"{x / 1000:.3f} K" if abs(x) >= 1000 else f"{x:.1f}" for x in F_N]
    part = ROWS - 500
    second = [f"{x:.4f}" for x in V_M_S[:part]] + [""] * 500
    second_t = [f"{x:.4f}" for x in T_S[:part]] + [""] * 500
    return [
        DialectFile(
            "two pairs, one of which ends before the other",
            Style(";", digits=4).table(
                [T_S, F_N, second_t, second], ["Time [s];Force [N];Time [s];Speed [m/s]"]
            ),
            {"F": ("Force [N]", SI)},
        ),
        DialectFile(
            "TwinCAT: EOF in the last line",
            ("\n".join([*rows, "EOF"]) + "\n").encode(), _FIELDS,
        ),
        DialectFile(
            "names again after each thousand rows", ("\n".join(repeated) + "\n").encode(), _FIELDS,
        ),
        DialectFile(
            "Grafana: N or kN, as large as the cell is",
            Style().table(
                [stamps("%Y-%m-%d %H:%M:%S.%3f"), [f"{x:.4f} km/h" for x in V_KMH], scaled],
                ["Time,Speed,Force"],
            ),
            {"v": ("Speed", KMH)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "Grafana: K for thousands",
            Style().table(
                [stamps("%Y-%m-%d %H:%M:%S.%3f"), V_KMH, short], ["Time," + _HEAD]
            ),
            {"v": ("Speed (km/h)", KMH)}, t0_ns=T0_NS,
        ),
        DialectFile(
            "commas between the cells and in them",
            Style(",", ",", 3).table([T_S, F_N, V_M_S], ["Zeit (s),Kraft (N),Tempo (m/s)"]),
            {"F": ("Kraft (N)", SI)},
        ),
    ]  # fmt: skip


def _several() -> list[DialectFile]:
    """Several columns of one quantity, of which one alone is not the answer."""
    quarter = DRIVE["left"] / 2
    sides = {
        f"torque_{side}_N_m": f'derive = "{side}_front_N_m + {side}_rear_N_m"'
        for side in ("left", "right")
    }
    corners = {
        f"{side}_{end}_N_m": f'field = "Wheel Torque {code} (Nm)"'
        for side, end, code in (
            ("left", "front", "FL"), ("right", "front", "FR"),
            ("left", "rear", "RL"), ("right", "rear", "RR"),
        )
    }  # fmt: skip
    return [
        DialectFile(
            "four wheel motors",
            Style(digits=4).table(
                [T_S, V_KMH, quarter, quarter, quarter, quarter],
                ["Time (s),Speed (km/h)," + ",".join(
                    f"Wheel Torque {code} (Nm)" for code in ("FL", "FR", "RL", "RR"))],
            ),
            {"v": ("Speed (km/h)", KMH)}, channels=corners | sides,
        ),
        DialectFile(
            "a motor at each axle",
            Style(digits=4).table(
                [T_S, V_KMH, DRIVE["motor_torque"] * 0.6, DRIVE["motor_torque"] * 0.4],
                ["Time (s),Speed (km/h),Front Motor Torque (Nm),Rear Motor Torque (Nm)"],
            ),
            {"v": ("Speed (km/h)", KMH)},
            channels={
                "motor_torque_N_m": 'field = "Front Motor Torque (Nm)"',
                "motor_rear_N_m": 'field = "Rear Motor Torque (Nm)"',
                "force_x_N": 'derive = "(motor_torque_N_m + motor_rear_N_m) * 9.665'
                             ' / wheel_radius_m"',
            },
        ),
        DialectFile(
            "two load cells that share the pull",
            Style(digits=3).table(
                [T_S, V_KMH, F_N * 0.55, F_N * 0.45],
                ["Time (s),Speed (km/h),Load cell 1 (N),Load cell 2 (N)"],
            ),
            {"v": ("Speed (km/h)", KMH)},
            channels={
                "cell_1_N": 'field = "Load cell 1 (N)"', "cell_2_N": 'field = "Load cell 2 (N)"',
                "force_x_N": 'derive = "cell_1_N + cell_2_N"',
            },
        ),
        DialectFile(
            "wanted and actual, soll and ist",
            Style(";", ",").table(
                [T_S, _earlier(V_M_S, 0.4), V_M_S, _earlier(F_N, 0.4) * 1.1, F_N],
                ["Zeit [s];v_soll [m/s];v_ist [m/s];F_soll [N];F_ist [N]"],
            ),
            {"F": ("F_ist [N]", SI)},
            channels={"speed_x_m_s": 'field = "v_ist [m/s]"', "force_x_N": 'field = "F_ist [N]"'},
        ),
        DialectFile(
            "setpoint and feedback",
            Style().table(
                [T_S, _earlier(V_M_S, 0.4), V_M_S, _earlier(F_N, 0.4) * 1.1, F_N],
                ["time_s,speed_setpoint_m_s,speed_feedback_m_s,force_command_N,force_feedback_N"],
            ),
            {"F": ("force_feedback_N", SI)},
            channels={"speed_x_m_s": 'field = "speed_feedback_m_s"',
                      "force_x_N": 'field = "force_feedback_N"'},
        ),
        DialectFile(
            "least, largest and mean of each interval",
            Style(digits=3).table(
                [T_S, F_N - 80 - 0.1 * np.abs(F_N), F_N + 80 + 0.1 * np.abs(F_N), F_N, V_KMH],
                ["Time (s),Force Min (N),Force Max (N),Force Avg (N),Speed (km/h)"],
            ),
            {"F": ("Force Avg (N)", SI)}, channels={"force_x_N": 'field = "Force Avg (N)"'},
        ),
        DialectFile(
            "a limit before the force",
            Style(digits=3).table(
                [T_S, np.full(ROWS, 2500.0), np.full(ROWS, 40.0), F_N, V_KMH],
                ["Time (s),Force limit (N),Speed limit (km/h),Force (N),Speed (km/h)"],
            ),
            {"F": ("Force (N)", SI)},
            channels={"force_x_N": 'field = "Force (N)"',
                      "speed_x_m_s": 'field = "Speed (km/h)"\nunit = "km/h"'},
        ),
        DialectFile(
            "speed in tenths of km/h, torque in inch-pounds",
            Style(digits=2).table(
                [T_S, as_integers(V_KMH, 10), DRIVE["motor_torque"] / 0.1129848],
                ["Time (s),Speed (0.1 km/h),Motor Torque (in-lb)"],
            ),
            {"motor_torque": ("Motor Torque (in-lb)", 1 / 0.1129848)},
            channels={
                "motor_torque_N_m": 'field = "Motor Torque (in-lb)"\nscale = 0.1129848',
                "force_x_N": 'derive = "motor_torque_N_m * 9.665 / wheel_radius_m"',
                "speed_x_m_s": 'field = "Speed (0.1 km/h)"\nscale = 0.027777778',
            },
        ),
    ]  # fmt: skip


def dialect_files() -> list[DialectFile]:
    """The files."""
    return [*_clocks(), *_shapes(), *_several()]
