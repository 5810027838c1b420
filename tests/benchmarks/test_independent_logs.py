"""Logs of the independent bench: what they are made with, and whether they say what is true."""

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from benchmarks.independent.machine_file import write_machine_file
from benchmarks.independent.mcap_log import layout_of, write_mcap
from benchmarks.independent.payload_plans import PLANS, SITUATIONS, PayloadLog, payload_log
from benchmarks.independent.sensors import EPOCH_NS, Instruments, Readings, measured
from benchmarks.independent.shift_logs import ShiftPlan, shift_log
from replay import load_machine, open_log

BENCH = Path(__file__).resolve().parents[2] / "benchmarks" / "independent"
PRODUCT = {"estimators", "analysis", "recordings", "replay", "payscope"}


@pytest.fixture(scope="module")
def log() -> PayloadLog:
    return payload_log(SITUATIONS["clean"], PLANS["5+5"], 3)


@pytest.mark.parametrize("path", sorted(BENCH.glob("*.py")), ids=lambda path: path.name)
def test_the_bench_imports_nothing_of_the_product(path: Path) -> None:
    imported: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(str(node.module))
    assert not {name.partition(".")[0] for name in imported} & PRODUCT
    ours = {name for name in imported if name.startswith("benchmarks")}
    assert all(name.startswith("benchmarks.independent.") for name in ours)


@pytest.mark.heavy
def test_nothing_of_the_product_is_loaded_by_making_a_log() -> None:
    code = (
        "import sys, benchmarks.independent.shift_logs as logs, benchmarks.independent.mcap_log\n"
        "import benchmarks.independent.machine_file\n"
        f"print([name for name in sys.modules if name.partition('.')[0] in {PRODUCT!r}])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_another_reader_finds_every_value_in_the_order_of_recording(
    log: PayloadLog, tmp_path: Path
) -> None:
    path = tmp_path / "log.mcap"
    write_mcap(log.topics, path)
    store = get_typestore(Stores.ROS2_HUMBLE)
    layouts = {layout_of(name, each).topic: (name, each) for name, each in log.topics.items()}
    seen = dict.fromkeys(log.topics, 0)
    last_ns = 0
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert message.log_time >= last_ns
            last_ns = message.log_time
            name, readings = layouts[channel.topic]
            row = seen[name]
            seen[name] += 1
            if row % 500:
                continue
            assert schema is not None
            content: Any = store.deserialize_cdr(message.data, schema.name)
            stamp = content.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == readings.stamp_ns[row]
            assert message.log_time == readings.log_ns[row]
            for field, values in readings.values.items():
                said: Any = content
                for part in layout_of(name, readings).fields[field].split("."):
                    said = said[int(part)] if part.isdigit() else getattr(said, part)
                assert said == values[row]
    assert seen == {name: each.stamp_ns.size for name, each in log.topics.items()}


def test_payscope_reads_all_of_it_without_a_loss(log: PayloadLog, tmp_path: Path) -> None:
    path, stated = tmp_path / "log.mcap", tmp_path / "machine.toml"
    write_mcap(log.topics, path)
    write_machine_file(stated, log.instruments, log.known)
    machine = load_machine(stated)
    assert log.known.empty_s is not None
    assert machine.settings.loads.empty_to_s == pytest.approx(log.known.empty_s[1], abs=1e-3)
    with open_log(path) as opened:
        assert sum(opened.topics()["messages"]) == sum(
            each.stamp_ns.size for each in log.topics.values()
        )
        assert not opened.losses()


def _on(times_s: np.ndarray, readings: Readings, name: str) -> np.ndarray:
    return np.interp(times_s, (readings.stamp_ns - EPOCH_NS) / 1e9, readings.values[name])


@pytest.mark.parametrize("loaded", [False, True])
def test_perfect_sensors_weigh_the_machine_and_its_load_by_newton_s_law(
    log: PayloadLog, loaded: bool
) -> None:
    seen = Instruments(two_sides=False, share=0.5, force_hz=200.0, imu_hz=200.0, speed_hz=200.0)
    truth = log.truth
    topics = measured(np.random.default_rng(1), seen, log.motion, truth.empty_kg)
    times_s = np.arange(0.5, log.motion.duration_s - 0.5, 0.01)
    force_N = _on(times_s, topics["force"], "force") / seen.share
    acc = _on(times_s, topics["imu"], "x")
    speed = _on(times_s, topics["speed"], "speed")
    part = (times_s > truth.loaded_from_s) if loaded else (times_s < truth.empty_to_s)
    # brakes are not seen: a start is where the force drives
    part &= (force_N * speed > 0.0) & (acc * speed > 0.05) & (np.abs(speed) > 0.1)
    fitted = np.linalg.lstsq(np.stack([acc, speed], 1)[part], force_N[part], rcond=None)[0]
    mass_kg = truth.empty_kg + (truth.payload_kg if loaded else 0.0)
    assert fitted[0] == pytest.approx(mass_kg, rel=2e-3)


def test_a_situation_is_in_the_log_that_it_names() -> None:
    def stand(name: str) -> tuple[float, PayloadLog]:
        made = payload_log(SITUATIONS[name], PLANS["5+5"], 3)
        return float(made.topics["imu"].values["x"][:100].mean()), made

    clean, log = stand("clean")
    assert stand("bias +0.1")[0] - clean == pytest.approx(0.1, abs=1e-6)
    assert stand("tilt 1")[0] - clean == pytest.approx(9.80665 * np.sin(np.deg2rad(1)), abs=1e-4)
    offset = stand("offset 5")[1]
    seen = offset.instruments
    said = [
        sum(values[:100].mean() for values in each.topics["force"].values.values())
        for each in (log, offset)
    ]
    shift_N = (said[1] - said[0]) / seen.share / (seen.radius_m if seen.two_sides else 1.0)
    assert abs(shift_N) == pytest.approx(0.05 * log.truth.force_N, rel=1e-6)
    fills = stand("filling")[1].truth
    assert 0.25 <= 1.0 - fills.payload_begin_kg / fills.payload_kg <= 1.0


def test_a_shift_s_truth_is_what_left_the_bucket() -> None:
    made = shift_log(2, ShiftPlan(shorter=0.15))
    truth = made.truth
    assert len(truth.dump_s) == len(truth.payload_kg) == len(truth.hidden) > 5
    assert list(truth.dump_s) == sorted(truth.dump_s)
    assert min(truth.payload_kg) > 0.02 * truth.empty_kg
    ends = [(f["force"].log_ns[0] / 1e9, f["force"].log_ns[-1] / 1e9) for f in made.files]
    for dumped_s, hidden in zip(truth.dump_s, truth.hidden, strict=True):
        assert hidden != any(begin <= dumped_s <= end for begin, end in ends)


def test_a_plan_bounds_loads_and_makes_the_machine_file_wrong() -> None:
    short = ShiftPlan(hours=0.1, load_share=(0.10, 0.30))
    right = shift_log(4, short)
    wrong = shift_log(4, short._replace(force_1=1.1, radius_1=0.95, share_1=1.1))
    assert right.truth.minutes <= 6.0
    assert 0.04 < np.mean(right.truth.payload_kg) / right.truth.empty_kg < 0.4
    assert wrong.truth == replace(right.truth, errors=wrong.truth.errors)
    assert wrong.seen.force_gain == pytest.approx(1.1 * right.seen.force_gain)
    assert wrong.stated.radius_m == pytest.approx(0.95 * right.stated.radius_m, rel=1e-4)
    # a share of all wheels cannot be larger
    assert wrong.stated.share / right.stated.share == pytest.approx(
        0.9 if right.seen.share == 1.0 else 1.1
    )


def test_the_same_seed_is_the_same_log(log: PayloadLog) -> None:
    again = payload_log(SITUATIONS["clean"], PLANS["5+5"], 3)
    for name, readings in log.topics.items():
        for field, values in readings.values.items():
            assert (again.topics[name].values[field] == values).all()
