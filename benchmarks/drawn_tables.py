"""Tables of finite numbers that no machine would record, drawn by a seed, with a machine file.

A drive of some manoeuvres, each with a mass of its own, is written down as some columns, and then
spoilt: columns that are zero, constant, in steps, huge or tiny, and stamps that repeat, jump or
are all the same.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from estimators.arrays import Floats

Rng = np.random.Generator

_MASSES_KG: Final = (0.0, 1e-12, 1.0, 99.0, 120.0, 3600.0, 1e12)
_RATES_HZ: Final = (1.0, 10.0, 50.0, 100.0, 1000.0)
_MANOEUVRES: Final = (0, 1, 1, 2, 3, 3, 4, 8)
#: A table is cut here, as its replay takes a time in proportion.
_MOST_ROWS: Final = 4000
#: How probable it is that a column, or the time, is spoilt.
_COLUMN_SPOILT: Final = 0.25
_TIME_SPOILT: Final = 0.35
_LARGE: Final = (1e12, 1e100, 1e300)
#: From above what a float32 holds down to what has lost its last digits.
_SMALL: Final = (1e-12, 1e-100, 1e-310)
_WHEEL_RADIUS_M: Final = 0.42
_TRACK_M: Final = 1.5
_GRAVITY_M_S2: Final = 9.80665

#: What a column is, by the name that a table gives it: the channel that it fills.
_COLUMNS: Final = {
    "force_N": "force_x_N",
    "torque_left": "torque_left_N_m",
    "torque_right": "torque_right_N_m",
    "position_m": "position_x_m",
    "speed_m_s": "speed_x_m_s",
    "speed_left": "speed_left_m_s",
    "speed_right": "speed_right_m_s",
    "acc_m_s2": "acc_x_m_s2",
    "imu_x": "specific_force_x_m_s2",
    "imu_y": "specific_force_y_m_s2",
    "imu_z": "specific_force_z_m_s2",
    "yaw_rate": "yaw_rate_rad_s",
    "pitch": "pitch_rad",
    "boom": "boom_rad",
    "bucket": "bucket_rad",
    "latitude": "latitude_deg",
    "longitude": "longitude_deg",
}
#: What machines record: names of columns, and channels that are derived.
_MACHINES: Final = (
    (("force_N", "speed_m_s", "acc_m_s2"), {}),
    (("force_N", "speed_m_s"), {"acc_x_m_s2": "d/dt speed_x_m_s"}),
    (
        ("force_N", "position_m"),
        {"speed_x_m_s": "d/dt position_x_m", "acc_x_m_s2": "d/dt speed_x_m_s"},
    ),
    (("force_N", "speed_m_s", "imu_x"), {}),
    (("force_N", "speed_m_s", "imu_x", "pitch", "boom", "bucket"), {}),
    (
        ("torque_left", "torque_right", "speed_left", "speed_right", "imu_x", "yaw_rate"),
        {"speed_x_m_s": "mean(speed_left_m_s, speed_right_m_s)"},
    ),
    (
        (
            *("torque_left", "torque_right", "speed_left", "speed_right", "imu_x", "imu_y"),
            *("imu_z", "yaw_rate", "boom", "latitude", "longitude"),
        ),
        {
            "speed_x_m_s": "mean(speed_left_m_s, speed_right_m_s)",
            "yaw_acc_rad_s2": "d/dt yaw_rate_rad_s",
        },
    ),
)


@dataclass(frozen=True)
class DrawnTable:
    """A table and its machine file.

    Attributes:
        seed: that it was drawn by.
        log: `.csv` or `.parquet`.
        machine: the machine file.
        spoilt: what is wrong with it, in words.
    """

    seed: int
    log: Path
    machine: Path
    spoilt: str


def draw(seed: int, folder: Path) -> DrawnTable:
    """Write the table and the machine file of a seed into a folder."""
    rng = np.random.default_rng([seed, 27])
    columns, derived = _MACHINES[rng.integers(len(_MACHINES))]
    rate_hz, drive, masses = _drive(rng)
    said = [f"{rate_hz:g} Hz", f"masses {', '.join(f'{kg:g}' for kg in masses)} kg"]
    table: dict[str, Floats] = {}
    for name in columns:
        table[name] = drive[name]
        if rng.random() < _COLUMN_SPOILT:
            word = str(rng.choice(list(_SPOILS)))
            table[name] = _SPOILS[word](table[name], rng)
            said.append(f"{name} {word}")
    time_s = np.arange(drive["speed_m_s"].size) / rate_hz + rng.choice([0.0, 1.7e9])
    if rng.random() < _TIME_SPOILT:
        word = str(rng.choice(list(_TIMES)))
        said.append(f"time {word}")
        time_s = _TIMES[word](time_s, rng)
    frame = pl.DataFrame({"time_s": time_s, **{n: x[: time_s.size] for n, x in table.items()}})
    assert all(frame[name].is_finite().all() for name in frame.columns), said
    log = folder / f"drawn_{seed}.{rng.choice(['csv', 'parquet'])}"
    frame.write_csv(log) if log.suffix == ".csv" else frame.write_parquet(log)
    machine = folder / f"drawn_{seed}.toml"
    machine.write_text(_machine_file(rng, columns, derived), encoding="utf-8")
    return DrawnTable(seed, log, machine, "; ".join(said))


def _drive(rng: Rng) -> tuple[float, dict[str, Floats], list[float]]:
    """Rate, every column of a drive, and the mass of each manoeuvre."""
    rate_hz = float(rng.choice(_RATES_HZ))
    masses = [float(rng.choice(_MASSES_KG)) for _ in range(rng.choice(_MANOEUVRES))]
    if rng.random() < 0.5:
        masses = masses[:1] * len(masses)
    acc, mass_kg = [np.zeros(round(2.0 * rate_hz))], [np.zeros(round(2.0 * rate_hz))]
    for mass in masses:
        top, gain, stand = rng.uniform(0.5, 3.0), rng.uniform(0.3, 2.0), rng.choice([0.0, 1.0, 4.0])
        parts = ((gain, top / gain), (0.0, rng.uniform(0.0, 4.0)), (-gain, top / gain), (0, stand))
        sign = rng.choice([1.0, -1.0])
        shape = [np.full(round(seconds * rate_hz), sign * value) for value, seconds in parts]
        acc.append(np.concatenate(shape))
        mass_kg.append(np.full(acc[-1].size, mass))
    a, m = (np.concatenate(each)[:_MOST_ROWS] for each in (acc, mass_kg))
    noise = float(rng.choice([0.0, 1e-3, 1.0]))

    def noisy(values: Floats, times: float = 1.0) -> Floats:
        return values + noise * times * rng.normal(0.0, 1.0, values.size)

    speed = np.cumsum(a) / rate_hz
    force = m * a + rng.choice([0.0, 60.0]) * speed + rng.choice([0.0, 100.0])
    yaw_rate = rng.choice([0.0, 0.5]) * np.sin(np.arange(a.size) / rate_hz)
    spin = np.gradient(yaw_rate) * rate_hz * 0.3 * m if a.size > 1 else yaw_rate
    side_N_m, side_m_s = spin * _WHEEL_RADIUS_M / _TRACK_M, yaw_rate * _TRACK_M / 2.0
    drive = {
        "force_N": noisy(force, 20.0),
        "torque_left": noisy(force * _WHEEL_RADIUS_M / 2.0 - side_N_m, 10.0),
        "torque_right": noisy(force * _WHEEL_RADIUS_M / 2.0 + side_N_m, 10.0),
        "position_m": noisy(np.cumsum(speed) / rate_hz, 1e-4),
        "speed_m_s": noisy(speed, 0.01),
        "speed_left": noisy(speed - side_m_s, 0.01),
        "speed_right": noisy(speed + side_m_s, 0.01),
        "acc_m_s2": noisy(a, 0.05),
        "imu_x": noisy(a, 0.05),
        "imu_y": noisy(speed * yaw_rate, 0.05),
        "imu_z": noisy(np.full(a.size, _GRAVITY_M_S2), 0.05),
        "yaw_rate": noisy(yaw_rate, 0.005),
        "pitch": noisy(np.zeros(a.size), 0.005),
        "boom": np.repeat(rng.uniform(-0.5, 1.0, 8), a.size // 8 + 1)[: a.size],
        "bucket": np.zeros(a.size),
        "latitude": -33.4 + np.cumsum(speed) / rate_hz * 9e-6,
        "longitude": np.full(a.size, -70.6),
    }
    return rate_hz, drive, masses


def _held(x: Floats, rng: Rng) -> Floats:
    return np.repeat(x[:: (every := int(rng.integers(2, 200)))], every)[: x.size]


def _one_of(x: Floats, rng: Rng, value: float) -> Floats:
    out = x.copy()
    out[rng.integers(x.size)] = value
    return out


def _huge(x: Floats, rng: Rng) -> Floats:
    times = float(rng.choice(_LARGE))
    return np.clip(x, -1e307 / times, 1e307 / times) * times


#: Ways to spoil a column.
_SPOILS: Final[dict[str, Callable[[Floats, Rng], Floats]]] = {
    "zero": lambda x, _: np.zeros(x.size),
    "negative zero": lambda x, _: np.full(x.size, -0.0),
    "constant": lambda x, rng: np.full(x.size, rng.choice([-1.0, 1.0, *_LARGE, *_SMALL])),
    "huge": _huge,
    "tiny": lambda x, rng: x * rng.choice(_SMALL),
    "in steps": lambda x, rng: np.round(x / (step := rng.choice([0.01, 1.0, 100.0]))) * step,
    "held": _held,
    "one spike": lambda x, rng: _one_of(x, rng, rng.choice([1e6, -1e12, 1e300])),
    "one sample": lambda x, rng: _one_of(np.zeros(x.size), rng, 1.0),
    "without sign": lambda x, _: np.abs(x),
    "reversed": lambda x, _: -x,
    "two values": lambda x, _: np.where(x > np.median(x), 1.0, 0.0),
    "alternating": lambda x, _: np.where(np.arange(x.size) % 2, 1.0, -1.0),
    "a ramp": lambda x, _: np.arange(x.size) * 1.0,
    "noise alone": lambda x, rng: rng.normal(0.0, 1.0, x.size),
}


def _with_hole(t: Floats, rng: Rng) -> Floats:
    out = t.copy()
    out[rng.integers(t.size) :] += rng.choice([1.0, 70.0, 1e5])
    return out


def _repeating(t: Floats, rng: Rng) -> Floats:
    return np.where(rng.random(t.size) < 0.3, np.roll(t, 1), t)


#: Ways to spoil the time.
_TIMES: Final[dict[str, Callable[[Floats, Rng], Floats]]] = {
    "of no row": lambda t, _: t[:0],
    "of one row": lambda t, _: t[:1],
    "of two rows": lambda t, _: t[:2],
    "of few rows": lambda t, rng: t[: rng.integers(3, 150)],
    "all equal": lambda t, _: np.full(t.size, t[0]),
    "in pairs": lambda t, _: t[np.arange(t.size) // 2 * 2],
    "repeating": _repeating,
    "with a hole": _with_hole,
    "backwards": lambda t, _: t[::-1],
    "shuffled": lambda t, rng: rng.permutation(t),
    "in whole seconds": lambda t, _: np.floor(t),
    "a thousand times faster": lambda t, _: t[0] + (t - t[0]) / 1e3,
    "a million times slower": lambda t, _: t[0] + (t - t[0]) * 1e6,
    "negative": lambda t, _: t - t[0] - 1e6,
}


def _machine_file(rng: Rng, columns: tuple[str, ...], derived: dict[str, str]) -> str:
    body = ['[machine]\nname = "drawn"\ntimezone = "UTC"']
    if rng.random() < 0.6:
        body.append(f"empty_mass_kg = {float(rng.choice([1e-12, 100.0, 3600.0, 1e12]))!r}")
        if rng.random() < 0.5:
            body.append(f"empty_mass_u_kg = {float(rng.choice([0.0, 5.0]))!r}")
    if rng.random() < 0.2:
        body.append(f"repeatability_kg = {float(rng.choice([0.0, 1e-9, 10.0]))!r}")
    if rng.random() < 0.1:
        body.append(f"rotating_mass_kg = {float(rng.choice([0.0, 50.0]))!r}")
    if "torque_left" in columns:
        body.append(f"wheel_radius_m = {_WHEEL_RADIUS_M}\ntrack_width_m = {_TRACK_M}")
        body.append(f"force_share = {rng.choice([0.5, 1.0])}")
    parts = ["\n".join(body), '[log]\ntime = "time_s"']
    parts += [f'[channels.{_COLUMNS[name]}]\nfield = "{name}"' for name in columns]
    parts += [f'[channels.{name}]\nderive = "{how}"' for name, how in derived.items()]
    kinematic = "imu_x" not in columns
    parts.append(
        f'[settings.forces]\nacceleration = "{"kinematic" if kinematic else "specific_force"}"\n'
        f"coulomb = {str(rng.random() < 0.3).lower()}"
    )
    braking = str(rng.random() < 0.5).lower()
    window = f"\nwindow_samples = {rng.choice([4, 20, 100])}" if rng.random() < 0.5 else ""
    parts.append(f"[settings.gate]\nexclude_braking = {braking}{window}")
    if rng.random() < 0.3:
        parts.append("[settings.noise]\nforce_N = 1.0\nacc_m_s2 = 0.01\nspeed_m_s = 0.0005")
    if rng.random() < 0.1:
        parts.append("[settings.filter]\ncausal = true")
    if rng.random() < 0.3:
        methods = '["ls", "rls", "fgls", "tls", "rtls", "huber", "pooled"]'
        parts.append(f"[settings.trace]\nmethods = {methods}")
    return "\n\n".join(parts) + "\n"
