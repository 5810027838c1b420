"""Logs to columns: payscope against rosbags, mcap-ros2-support and -fast, Rerun, and the limit.

    make reading    # or: python -P benchmarks/decode.py [--minutes 30] [--pairs 5] [--folder KEPT]

Writes one log in every container (`decode_log.py`), then reads each with payscope and with a peer
in turn, `--pairs` times; what counts is the median of the pairs' ratios. Ours opens the log and
gives polars frames of every field of every topic; a peer's file is opened beforehand, it stops
after `--most` messages, and nothing is made of its objects (`decode_peers.py`). The limit is the
same bytes read, unpacked and summed by one thread (`decode_limit.py`); shares of it are of
processor seconds. Peak memory is that of a process of its own. Prints Markdown.
"""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Annotated

import numpy as np
import polars as pl
import typer
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Writer1

from benchmarks.decode_limit import decompressor_of, limit_of
from benchmarks.decode_log import RUN_FIELDS, write_bag, write_db3, write_mcap
from benchmarks.decode_peers import PEERS, Peer, drain
from replay import open_log

BAG = Writer1.CompressionFormat
FILES: dict[str, Callable[[Path, float], None]] = {
    **{
        f"{c.name.lower()}.mcap": partial(write_mcap, compression=c)
        for c in (CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE)
    },
    **{
        f"{name}.bag": partial(write_bag, compression=c)
        for name, c in (("none", None), ("lz4", BAG.LZ4), ("bz2", BAG.BZ2))
    },
    "log/log.db3": lambda path, minutes: write_db3(path.parent, minutes),
}
#: By peer and file: the least ratio of the clock's seconds, and of the processors'.
TARGETS = {
    **{
        ("rosbags AnyReader", name): (30.0, 20.0)
        for name in ("zstd.mcap", "lz4.mcap", "none.bag", "lz4.bag")
    },
    ("rosbags AnyReader", "log.db3"): (12.0, None),
    **{("mcap-ros2-support", f"{c}.mcap"): (50.0, None) for c in ("zstd", "lz4", "none")},
    **{("Rerun McapReader", f"{c}.mcap"): (1.0, None) for c in ("zstd", "lz4", "none")},
}


@dataclass(frozen=True)
class Took:
    """Seconds of the clock and of all processors, a message."""

    wall: float
    cpu: float

    def over(self, other: "Took") -> tuple[float, float]:
        """How many times as long."""
        return self.wall / other.wall, self.cpu / other.cpu


def timed(work: Callable[[], int]) -> Took:
    wall, cpu = perf_counter(), process_time()
    messages = work()
    return Took((perf_counter() - wall) / messages, (process_time() - cpu) / messages)


def read_all(path: Path) -> dict[str, pl.DataFrame]:
    with open_log(path) as log:
        topics = log.topics()
        return log.read_many(dict(zip(topics["topic"], topics["fields"], strict=True)))


def everything(path: Path) -> int:
    return sum(frame.height for frame in read_all(path).values())


def channels(path: Path) -> int:
    """What `run` reads; a ratio of whole logs, so that the log's messages count."""
    with open_log(path) as log:
        log.read_many(RUN_FIELDS)
        return int(log.topics()["messages"].sum())


def by_peer(peer: Peer, path: Path, most: int | None) -> Took:
    with peer(path) as items:
        return timed(lambda: drain(items, most))


def by_rerun(peer: Peer, path: Path, messages: int) -> Took:
    """It gives whole chunks, so it goes through the file."""

    def work() -> int:
        with peer(path) as items:
            drain(items, None)
        return messages

    return timed(work)


def peak(path: Path) -> None:
    """In a process of its own: what reading adds to the memory that the libraries take, in MB."""
    (small,) = path.parent.glob("first.mcap")
    everything(small)  # loads the libraries and what is compiled
    before = most_mb()
    frames = read_all(path)
    after = most_mb()
    output = sum(frame.estimated_size() for frame in frames.values()) / 1e6
    print(f"{output:.0f} {after - before:.0f} {after:.0f}")


def most_mb() -> float:
    """The most memory that this process had; getrusage counts in what started it."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1.024e-3


def row(*cells: str) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def rate(messages_per_s: float) -> str:
    return f"{messages_per_s / 1e6:.2f}"


def against_peers(path: Path, pairs: int, most: int, messages: int) -> None:
    for name, (peer, kinds) in PEERS.items():
        if path.suffix not in kinds:
            continue
        is_rerun = name.startswith("Rerun")
        theirs = (
            partial(by_rerun, peer, path, messages)
            if is_rerun
            else partial(by_peer, peer, path, most)
        )
        theirs()
        found = [(timed(lambda: everything(path)), theirs()) for _ in range(pairs)]
        wall, cpu = np.median([other.over(ours) for ours, other in found], axis=0)
        wanted = TARGETS.get((name, path.name), (None, None))
        least = ", ".join(
            f"{what} ≥ {value:g}×"
            for what, value in zip(("wall", "CPU"), wanted, strict=True)
            if value
        )
        reached = all(
            value is None or got >= value for got, value in zip((wall, cpu), wanted, strict=True)
        )
        row(
            path.name,
            name,
            rate(1 / np.median([ours.wall for ours, _ in found])),
            rate(1 / np.median([other.wall for _, other in found])),
            f"{wall:.1f}×",
            f"{cpu:.1f}×",
            least or "–",
            ("yes" if reached else "no") if least else "–",
        )


def against_limit(path: Path, pairs: int, messages: int) -> None:
    limit = limit_of(path)

    def bare() -> int:
        limit()
        return messages

    bare()
    channels(path)
    found = [
        (timed(lambda: everything(path)), timed(lambda: channels(path)), timed(bare))
        for _ in range(pairs)
    ]
    columns = np.array([[each.cpu for each in three] for three in found])
    whole, run, least = np.median(columns, axis=0) * messages
    shares = np.median(columns[:, 2:] / columns[:, :2], axis=0)
    script = [sys.executable, __file__, "--peak", str(path)]
    output, added, total = subprocess.run(
        script, capture_output=True, text=True, check=True
    ).stdout.split()
    row(
        path.name,
        f"{path.stat().st_size / 1e6:.0f}",
        f"{least:.3f}",
        f"{whole:.3f}",
        f"{shares[0]:.0%}",
        f"{run:.3f}",
        f"{shares[1]:.0%}",
        output,
        added,
        total,
    )


def against_decompressor(path: Path, pairs: int, messages: int) -> None:
    unpack = decompressor_of(path)

    def bare() -> int:
        unpack()
        return messages

    found = [(timed(lambda: everything(path)), timed(bare)) for _ in range(pairs)]
    wall, cpu = np.median([bare.over(ours) for ours, bare in found], axis=0)
    print(
        f"\n{path.name}: {wall:.0%} of its decompressor's speed by the clock (≥ 90 %), "
        f"{cpu:.0%} by processor seconds: chunks are unpacked in several threads."
    )


def main(
    minutes: float = 30,
    pairs: int = 5,
    most: int = 100_000,
    folder: Path | None = None,
    peak_of: Annotated[Path | None, typer.Option("--peak", hidden=True)] = None,
) -> None:
    if peak_of is not None:
        peak(peak_of)
        return
    with TemporaryDirectory() as scratch:
        home = folder or Path(scratch)
        paths = [written(home / name, write, minutes) for name, write in FILES.items()]
        for place in {path.parent for path in paths}:
            written(place / "first.mcap", FILES["zstd.mcap"], 0.1)
        messages = everything(paths[0])
        columns = sum(frame.width for frame in read_all(paths[0]).values())
        print(f"{messages:,} messages, {columns} columns, median of {pairs} pairs\n")
        row("log", "peer", "ours M/s", "peer M/s", "wall", "CPU", "target", "reached")
        row(*["---"] * 8)
        for path in paths:
            everything(path)
            against_peers(path, pairs, most, messages)
        print()
        heads = ("limit CPU s", "ours CPU s", "of limit", "for run CPU s", "of limit")
        row("log", "MB", *heads, "output MB", "peak MB added", "peak MB")
        row(*["---"] * 10)
        for path in paths:
            against_limit(path, pairs, messages)
        for path in paths:
            if path.name == "bz2.bag":
                against_decompressor(path, pairs, messages)


def written(path: Path, write: Callable[[Path, float], None], minutes: float) -> Path:
    """The log, written unless it is there."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".db3":
            path.parent.rmdir()
        write(path, minutes)
    return path


if __name__ == "__main__":
    typer.run(main)
