"""Eighteen more faults, listed before any detector was written, which none is made for.

The record docs/decisions/0062 has the list; `causes` are keys that would name it rightly.
"""

from typing import Final

import numpy as np
import polars as pl

from benchmarks.unlisted_rows import (
    SPEEDS,
    TORQUES,
    Column,
    DrawnLog,
    Frames,
    Unlisted,
    X,
    Y,
    late,
    over_log,
    slipping,
    times,
)
from estimators.arrays import Floats

_Dice = np.random.Generator


def _unsigned(x: Floats, _: DrawnLog, __: float, ___: _Dice) -> Floats:
    return np.abs(x)


def _dead_band(x: Floats, log: DrawnLog, size: float, _: _Dice) -> Floats:
    band = size * log.full_torque
    return np.sign(x) * np.maximum(np.abs(x) - band, 0.0)


def _held(log: DrawnLog, size: float, _: _Dice) -> Frames:
    """A new value so many times a second, in messages at the old rate."""
    torque = log.topics["torque"]
    t = torque["header_stamp_ns"].to_numpy()
    number = ((t - t[0]) * 1e-9 * size).astype(np.int64)
    first = np.searchsorted(number, number)
    changed = [pl.Series(name, torque[name].to_numpy()[first]) for name in TORQUES]
    return {**log.topics, "torque": torque.with_columns(changed)}


def _turned(log: DrawnLog, size: float, _: _Dice) -> Frames:
    imu, angle = log.topics["imu"], np.deg2rad(size)
    x = pl.col(X)
    y = pl.col(Y) if Y in imu.columns else pl.lit(0.0)
    turned = [(x * np.cos(angle) + y * np.sin(angle)).alias(X)]
    if Y in imu.columns:
        turned.append((y * np.cos(angle) - x * np.sin(angle)).alias(Y))
    return {**log.topics, "imu": imu.with_columns(turned)}


def _clipped(x: Floats, _: DrawnLog, size: float, __: _Dice) -> Floats:
    limit = size * float(np.quantile(np.abs(x), 0.999))
    return np.clip(x, -limit, limit)


def _dropped(log: DrawnLog, size: float, dice: _Dice) -> Frames:
    speed = log.topics["speed"]
    kept = dice.random(speed.height) >= size
    changed = [pl.Series(name, speed[name].to_numpy() * kept) for name in SPEEDS]
    return {**log.topics, "speed": speed.with_columns(changed)}


def _bursts(x: Floats, log: DrawnLog, size: float, dice: _Dice) -> Floats:
    t = log.topics["torque"]["header_stamp_ns"].to_numpy() * 1e-9
    inside = (t - t[0]) % 5.0 < 1.0
    return x + inside * dice.normal(0.0, size * log.full_torque, x.size)


def _bunched(log: DrawnLog, size: float, _: _Dice) -> Frames:
    torque = log.topics["torque"]
    names = ("header_stamp_ns", "log_time_ns")
    bunch = round(size * 1e9)
    begin = int(torque[names[0]][0])
    t = torque[names[0]].to_numpy()
    arrives = begin + ((t - begin) // bunch + 1) * bunch
    # messages of a bunch follow each other by 0.1 ms
    place = np.arange(t.size) - np.searchsorted(arrives, arrives)
    stamps = arrives + place * 100_000
    changed = [pl.Series(name, stamps) for name in names]
    return {**log.topics, "torque": torque.with_columns(changed)}


def _soft(x: Floats, log: DrawnLog, size: float, _: _Dice) -> Floats:
    limit = size * log.full_torque
    return limit * np.tanh(x / limit)


def _averaged(log: DrawnLog, size: float, _: _Dice) -> Frames:
    speed = log.topics["speed"]
    t = speed["header_stamp_ns"].to_numpy()
    count = max(int(size * 1e9 / float(np.median(np.diff(t)))), 1)
    changed: list[pl.Series] = []
    for name in SPEEDS:
        x = speed[name].to_numpy()
        summed = np.cumsum(np.concatenate([np.full(count, x[0]), x]))
        changed.append(pl.Series(name, (summed[count:] - summed[:-count]) / count))
    return {**log.topics, "speed": speed.with_columns(changed)}


MORE: Final = (
    Unlisted(
        "left torque late", ("delay", "unlike_sides"), (0.05, 0.1, 0.2), late("torque", TORQUES[0])
    ),
    Unlisted(
        "torque with a dead band",
        ("offset", "coulomb"),
        (0.05, 0.1, 0.2),
        Column("torque", TORQUES, _dead_band),
    ),
    Unlisted("torque held", ("frozen", "delay"), (5.0, 3.0, 1.0), _held),
    Unlisted("IMU turned far", ("imu_misaligned",), (60.0, 75.0, 90.0), _turned),
    Unlisted(
        "accelerometer clipped", ("saturated",), (0.6, 0.4, 0.2), Column("imu", (X,), _clipped)
    ),
    Unlisted(
        "speed without its sign",
        ("unsigned", "sign_flipped"),
        (1.0, 1.0, 1.0),
        Column("speed", SPEEDS, _unsigned),
        both_ways=True,
    ),
    Unlisted("encoder drops to zero", ("spikes",), (0.05, 0.1, 0.2), _dropped),
    Unlisted(
        "empty mass wrong",
        ("wrong_scale",),
        (0.8, 0.6, 0.4),
        body=lambda size: {"empty_mass_kg": size},
    ),
    Unlisted(
        "force share wrong",
        ("wrong_scale",),
        (0.7, 0.6, 0.5),
        Column("torque", TORQUES, lambda x, _, size, __: x * size),
    ),
    Unlisted(
        "both wheels slip in hard starts",
        ("slip",),
        (0.1, 0.2, 0.4),
        slipping(*SPEEDS, from_share=0.7),
    ),
    Unlisted(
        "bursts of noise",
        ("heteroscedastic", "spikes"),
        (0.05, 0.15, 0.5),
        Column("torque", TORQUES, _bursts),
    ),
    Unlisted(
        "zero of the torque drifts",
        ("offset", "gain_drift"),
        (0.03, 0.06, 0.12),
        Column(
            "torque",
            TORQUES,
            over_log(lambda x, along, log, size: x + size * log.full_torque * along),
        ),
    ),
    Unlisted(
        "zero of the accelerometer drifts",
        ("imu_bias", "imu_misaligned"),
        (0.1, 0.2, 0.4),
        Column("imu", (X,), over_log(lambda x, along, _, size: x + size * along)),
    ),
    Unlisted(
        "torque stamped in bunches", ("irregular_sampling", "delay"), (0.1, 0.2, 0.5), _bunched
    ),
    Unlisted(
        "torque saturates softly",
        ("driveline", "saturated"),
        (1.5, 1.0, 0.7),
        Column("torque", TORQUES, _soft),
    ),
    Unlisted(
        "left torque without its sign",
        ("unsigned", "unlike_sides"),
        (1.0, 1.0, 1.0),
        Column("torque", TORQUES[:1], _unsigned),
        both_ways=True,
    ),
    Unlisted("speed averaged", ("delay",), (0.3, 0.6, 1.0), _averaged),
    Unlisted(
        "accelerometer small", ("wheel_radius", "wrong_unit"), (0.95, 0.85, 0.7), times("imu", X)
    ),
)
