"""The script that a user would write: rosbags to read, pandas to align, statsmodels to fit.

    python benchmarks/review_script.py BAG...

It prints the mass of every start and the tonnes of the loads: no gate, no nuisances, no check.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import statsmodels.api as sm
from rosbags.highlevel import AnyReader

RADIUS_M = 0.42
FORCE_SHARE = 0.5
GRAVITY_M_S2 = 9.80665
MOVES_M_S = 0.2
FEWEST = 100


def messages(paths: list[Path]) -> dict[str, pd.DataFrame]:
    """Every message of the topics in use."""
    rows: dict[str, list[tuple[Any, ...]]] = {
        "/wheels/torque": [],
        "/wheels/speed": [],
        "/imu/data": [],
    }
    with AnyReader(paths) as reader:
        wanted = [each for each in reader.connections if each.topic in rows]
        for connection, stamp, data in reader.messages(wanted):
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == "/wheels/torque":
                of = dict(zip(message.name, message.effort, strict=False))
                rows[connection.topic].append((stamp, of["front_left"] + of["front_right"]))
            elif connection.topic == "/wheels/speed":
                of = dict(zip(message.name, message.velocity, strict=False))
                both = (of["front_left"] + of["front_right"]) / 2.0
                rows[connection.topic].append((stamp, both * RADIUS_M))
            else:
                q, a = message.orientation, message.linear_acceleration
                pitch = np.arcsin(np.clip(2.0 * (q.w * q.y - q.z * q.x), -1.0, 1.0))
                rows[connection.topic].append((stamp, a.x, pitch))
    names = {
        "/wheels/torque": ["stamp", "torque"],
        "/wheels/speed": ["stamp", "speed"],
        "/imu/data": ["stamp", "acc", "pitch"],
    }
    return {topic: pd.DataFrame(found, columns=names[topic]) for topic, found in rows.items()}


def main(paths: list[Path]) -> None:
    """Weigh every start."""
    by_topic = messages(paths)
    log = by_topic["/imu/data"].sort_values("stamp")
    for topic in ("/wheels/torque", "/wheels/speed"):
        log = pd.merge_asof(
            log, by_topic[topic].sort_values("stamp"), on="stamp", direction="nearest"
        )
    log["force"] = log["torque"] / RADIUS_M / FORCE_SHARE
    mean = log[["acc", "speed", "force"]].rolling(20).mean()
    starts = (mean["speed"].abs() > MOVES_M_S).astype(int)
    number = (starts.diff() == 1).cumsum()[starts == 1]
    masses: list[float] = []
    for _, rows in mean[starts == 1].groupby(number):
        rows = rows.dropna()
        if len(rows) > FEWEST:
            fitted = sm.OLS(rows["force"], sm.add_constant(rows[["acc", "speed"]])).fit()
            masses.append(float(fitted.params["acc"]))
    found = pd.Series(masses)
    empty = found.quantile(0.1)
    loads = found[found > empty + 200.0] - empty
    print(f"{len(found)} starts, {loads.sum() / 1000.0:.1f} t in {len(loads)} loaded starts")


if __name__ == "__main__":
    main([Path(each) for each in sys.argv[1:]])
