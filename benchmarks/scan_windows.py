"""Ten seconds of two columns out of a long log, by `scan_log`: warm, and from a fresh process.

    python -P benchmarks/scan_windows.py shift.mcap            100 drawn windows
    python -P benchmarks/scan_windows.py shift.mcap --hours 8  writes the log first

Clock and processor seconds, medians; bytes are those of the chunks that were unpacked against those
of the chunks that hold a row of the window. Another process's load lengthens the clock alone.
"""

import argparse
import random
import statistics
import subprocess
import sys
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import polars as pl

_WINDOW_NS = 10 * 10**9
_FRESH = """
from time import perf_counter, process_time
begin = perf_counter()
import payscope, polars as pl
log = payscope.scan_log({path!r}, {topic!r}, times="ns")
within = pl.col("log_time_ns").is_between({first}, {last})
log.filter(within).select({columns!r}).collect()
print(perf_counter() - begin, process_time())
"""


def medians(pairs: list[tuple[float, float]]) -> str:
    clock, processor = (statistics.median(each) for each in zip(*pairs, strict=True))
    return f"{clock:.4f} s by the clock, {processor:.4f} s by the processor"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("log", type=Path)
    parser.add_argument("--hours", type=float)
    parser.add_argument("--windows", type=int, default=100)
    parser.add_argument("--fresh", type=int, default=20)
    asked = parser.parse_args()
    if asked.hours:
        from mcap.writer import CompressionType

        from benchmarks.decode_log import write_mcap

        write_mcap(asked.log, asked.hours * 60, CompressionType.ZSTD)
    import payscope
    from replay import open_log
    from replay.logs.blocks import block_groups

    described = open_log(asked.log).topics().filter(pl.col("messages") > 0)
    row = described.sort("messages", "topic").row(-1, named=True)
    topic = row["topic"]
    columns = ["log_time_ns", *[f for f in row["fields"] if f.endswith((".x", ".y"))][:1]]
    print(
        f"{asked.log.stat().st_size / 1e6:.0f} MB, "
        f"{(row['end_ns'] - row['start_ns']) / 3.6e12:.2f} h"
    )
    print(f"{columns} of {topic}, {row['messages']:,} messages")

    unpacked: list[Any] = []
    unpack = block_groups.unpack_block_into
    block_groups.unpack_block_into = lambda block, *rest: (
        unpacked.append(block),
        unpack(block, *rest),
    )[1]
    log = payscope.scan_log(asked.log, topic, times="ns")
    draw = random.Random(1)  # noqa: S311 - windows are no secret
    begins = [
        draw.randrange(row["start_ns"], row["end_ns"] - _WINDOW_NS) for _ in range(asked.windows)
    ]
    warm: list[tuple[float, float]] = []
    ratios: list[float] = []
    for begin in begins:
        end = begin + _WINDOW_NS
        unpacked.clear()
        clock, processor = perf_counter(), process_time()
        found = log.filter(pl.col("log_time_ns").is_between(begin, end)).select(columns).collect()
        warm.append((perf_counter() - clock, process_time() - processor))
        assert abs(found.height - 1000) < 20, found.height
        holding = [b for b in unpacked if b.first_ns <= end and b.last_ns >= begin]
        ratios.append(sum(b.stored_bytes for b in unpacked) / sum(b.stored_bytes for b in holding))
    print(f"warm: {medians(warm[1:])}; bytes at most {max(ratios):.2f} × the chunks that hold it")
    fresh: list[tuple[float, float]] = []
    for begin in begins[: asked.fresh]:
        code = _FRESH.format(
            path=str(asked.log), topic=topic, first=begin, last=begin + _WINDOW_NS, columns=columns
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        clock_s, processor_s = map(float, done.stdout.split())
        fresh.append((clock_s, processor_s))
    print(f"from a fresh process, imports included: {medians(fresh)}")


if __name__ == "__main__":
    main()
