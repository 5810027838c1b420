"""What following costs: the share of a processor at 100 Hz, and the latency from disk to estimate.

    python -P benchmarks/follow_live.py [--seconds 40] [--speed 1] [--replay-share 0.1]
                                        [--chunk-kib 0]

A recorder in a process of its own writes simulated starts in real time (or `--speed` times as
fast), a tick of 10 ms at a time, each message on disk at once; or in chunks of so many KiB, packed
with lz4, as recorders write unless told otherwise. A row could be estimated when the sample that
completes it was written; the latency is from then to the return of its step. With a share, the log
so far is replayed in the background as `payscope follow` does it.
"""

import json
import multiprocessing
import resource
import struct
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import typer
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from analysis.model.axes import X
from analysis.model.methods import METHODS
from analysis.online.follower import FollowedRow
from analysis.simulation import Scenario
from analysis.stages.noise.column_noise import collect_axis_noise
from benchmarks.page import markdown
from replay import load_machine
from replay.follow.background_replay import BackgroundReplays
from replay.follow.follow_logs import FollowedLogState, follow_logs
from replay.simulation.simulate_logs import simulate_scenario_to_logs

TICK_NS = 10_000_000
#: What a row may be late by.
LATE_MS = 50.0
HEADER_STAMP = struct.Struct("<iI")
NOISE = [
    "settings.noise.force_N=60.0",
    "settings.noise.acc_m_s2=0.01",
    "settings.noise.speed_m_s=0.005",
]


def record(
    source: Path, target: Path, times: Path, seconds: float, speed: float, chunk_kib: int
) -> None:
    """Write the messages when they are due.

    `times` gets of each write the header stamp that every topic has reached, and its wall time.
    """
    written_at: list[tuple[int, float]] = []
    with source.open("rb") as read, target.open("wb") as file:
        writer = Writer(
            file,
            compression=CompressionType.LZ4 if chunk_kib else CompressionType.NONE,
            use_chunking=bool(chunk_kib),
            chunk_size=chunk_kib * 1024,
        )
        writer.start("ros2", "benchmark")
        channels: dict[int, int] = {}
        first, began, tick = None, time.monotonic(), 0
        reached: dict[int, int] = {}
        written = 0
        for schema, channel, message in make_reader(read).iter_messages():
            first = message.log_time if first is None else first
            due = message.log_time - first
            if due > seconds * 1e9:
                break
            if due // TICK_NS > tick:
                tick = due // TICK_NS
                time.sleep(max(0.0, began + tick * TICK_NS / 1e9 / speed - time.monotonic()))
            if channel.id not in channels:
                assert schema is not None
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, known
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
            # behind the four bytes that say how it is encoded, a message begins with its header
            seconds_1970, rest_ns = HEADER_STAMP.unpack_from(message.data, 4)
            reached[channel.id] = seconds_1970 * 10**9 + rest_ns
            if file.tell() > written:
                file.flush()
                written = file.tell()
                written_at.append((min(reached.values()), time.monotonic()))
        writer.finish()
    times.write_text(json.dumps(written_at))


def followed(
    folder: Path, seconds: float, speed: float, replay_share: float, chunk_kib: int
) -> list[str]:
    """A row of the table."""
    runs = int(seconds // 10) + 1
    plan = Scenario.model_validate({"campaign": {"loads_kg": [150], "runs": runs}})
    (source,) = simulate_scenario_to_logs(plan, folder / "source.mcap")
    target, times = folder / "live.mcap", folder / "times.json"
    machine = load_machine("cat262c.toml", NOISE)
    _warm(source, machine)
    seen: list[tuple[int, float]] = []
    replays = BackgroundReplays([target], machine, print, share=replay_share)
    replay_mb: list[float] = [0.0]

    def on_rows(following: FollowedLogState, rows: list[FollowedRow]) -> None:
        if any(report.event == "manoeuvre" for row in rows for report in row.reports):
            replays.request_replay_of_log_so_far()
        if (report := replays.take_result_and_start_next()) and replays.process_id:
            replay_mb.append(resident_mb(replays.process_id))
            print(f"replayed up to {report.t_s:.0f} s, {report.processor_s:.1f} s of a processor")
        if rows:
            basis = following.follower.log.basis
            assert basis is not None
            now = time.monotonic()
            seen.extend((basis.t0_unix_ns + row.t_ns, now) for row in rows if row.gate)

    recorder = multiprocessing.Process(
        target=record, args=(source, target, times, seconds, speed, chunk_kib)
    )
    recorder.start()
    while not target.exists():
        time.sleep(0.01)
    began, spent = time.monotonic(), time.process_time()
    with replays:
        follow_logs([target], machine, on_rows, idle_s=60.0)
    took_s = time.monotonic() - began
    share = (time.process_time() - spent) / took_s
    recorder.join()
    stamps, walls = np.array(json.loads(times.read_text())).T
    rows, when = np.array(seen).T
    # a row is known with the first tick whose last sample is no earlier
    at = np.minimum(np.searchsorted(stamps, rows), stamps.size - 1)
    late_ms = 1e3 * (when - walls[at])
    steady = late_ms[rows > stamps[0] + 5e9]
    most_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return [
        f"{speed:g}×, {f'chunks of {chunk_kib} KiB' if chunk_kib else 'no chunks'}",
        f"{100 * share:.1f} %",
        f"{np.median(steady):.0f}",
        f"{100 * np.mean(steady > LATE_MS):.0f} %",
        f"{np.quantile(steady, 0.99):.0f}",
        f"{steady.max():.0f}",
        f"{most_mb:.0f}",
        f"{100 * replays.processor_s / took_s:.1f} %",
        f"{max(replay_mb):.0f}",
    ]


def resident_mb(process: int) -> float:
    """Resident memory of a process."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def _warm(source: Path, machine: Any) -> None:
    """Compile, and import what is imported late."""
    follow_logs([source], machine, lambda _following, _rows: None, idle_s=0.1)


def steps(machine: Any) -> str:
    """Microseconds of the parts of a step on board."""
    from estimators.methods import incremental, rls

    rng = np.random.default_rng(0)
    window = incremental.make_empty_window(2, 320)
    samples = rng.normal(size=(5000, 3))
    for sample in samples[:640]:
        window = incremental.advance_window(window, sample)
    state = rls.start(samples[:320, :2], samples[:320, 2])
    settings = machine.settings.copy_with_changes({"trace.methods": ("ls",)})
    ls_method = METHODS["ls"]
    options = ls_method.options(settings.trace, collect_axis_noise(X, settings))
    calls: dict[str, Callable[[Any], object]] = {
        "sums of the window: index (11), OLS": lambda row: incremental.advance_window(window, row),
        "OLS from them, with its deviation": lambda _row: ls_method.step(window, 10, options),
        "RLS, one sample, (12) to (15)": lambda row: rls.step(state, row[:2], float(row[2])),
    }
    rows: list[list[str]] = []
    for name, call in calls.items():
        began = time.perf_counter()
        for sample in samples[:2000]:
            call(sample)
        rows.append([name, f"{1e6 * (time.perf_counter() - began) / 2000:.0f}"])
    return markdown(["part of a step", "µs"], rows)


def main(
    seconds: float = 40.0, speed: float = 1.0, replay_share: float = 0.0, chunk_kib: int = 0
) -> None:
    machine = load_machine("cat262c.toml", NOISE)
    print(steps(machine))
    with TemporaryDirectory() as name:
        row = followed(Path(name), seconds, speed, replay_share, chunk_kib)
    head = [
        "speed, recorder",
        "of a processor",
        "latency ms: median",
        "above 50",
        "99 %",
        "worst",
        "memory, MB",
        "replays, of a processor",
        "their memory, MB",
    ]
    print(markdown(head, [row]))


if __name__ == "__main__":
    typer.run(main)
