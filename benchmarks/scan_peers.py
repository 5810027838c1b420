"""Frames of a log: `scan_log` against Rerun's reader, roboto-mcap-codec and rosbags, in one run.

    python -P benchmarks/scan_peers.py [--minutes 10] [--pairs 3] [--most 50000] [--folder KEPT]

Writes one log in every container (`decode_log.py`) and reads it with ours and a peer in turn; what
counts is the median of the pairs' ratios, by the clock and by the processors. Ours gives polars
frames of every field, of one topic (`scan_log`) or in one pass of all (`Log.scan_many`, which
`convert` uses). Rerun's reader gives Arrow batches of the same in one pass, roboto-mcap-codec a
topic at a time; rosbags stops after `--most` messages, and nothing is made of its objects. The
first frame is of a fresh process, imports included, by what a user writes in three lines. Prints
Markdown.
"""

import argparse
import statistics
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import payscope
from benchmarks.decode import FILES
from benchmarks.decode_limit import decompressor_of
from benchmarks.decode_log import TOPICS
from benchmarks.decode_peers import drain, rosbags

TOPIC = "/imu"
#: By container: the least ratio against rosbags by the clock and by the processors.
AGAINST_ROSBAGS = {
    "lz4.mcap": (30, 20),
    "none.mcap": (30, 20),
    "lz4.bag": (30, 20),
    "none.bag": (30, 20),
    "zstd.mcap": (25, 16),
    "log.db3": (18, 13),
}
_FIRST = {
    "payscope": "import payscope\nf = payscope.scan_log({path!r}, {topic!r}).head(100).collect()",
    "Rerun": (
        "from rerun.chunk import McapReader\n"
        "s = McapReader({path!r}, decoders=['ros2_reflection']).stream()\n"
        "f = next(c for c in s if c.entity_path == {topic!r}).to_record_batch()"
    ),
    "roboto-mcap-codec": (
        "import mcap_codec as m; from pathlib import Path; p = Path({path!r}); b = p.open('rb')\n"
        "def at(o, n): b.seek(o); return b.read(n)\n"
        "f = next(iter(m.open_mcap_file(at, p.stat().st_size, channel=m.TopicName({topic!r}), "
        "timestamp={timestamp})))"
    ),
    "rosbags": (
        "from rosbags.highlevel import AnyReader; from pathlib import Path\n"
        "r = AnyReader([Path({path!r})]).__enter__()\n"
        "f = [r.deserialize(d, c.msgtype) for (c, _, d), _ in "
        "zip(r.messages([c for c in r.connections if c.topic == {topic!r}]), range(100))]"
    ),
}
TIMESTAMP = "m.TimestampSource('message_log_time')"


def timed(work: Callable[[], int]) -> tuple[float, float]:
    """Seconds of the clock and of the processors, a message."""
    wall, cpu = perf_counter(), process_time()
    messages = work()
    return (perf_counter() - wall) / messages, (process_time() - cpu) / messages


def ours(path: Path, topics: list[str]) -> int:
    if len(topics) > 1:
        return all_at_once(path)
    from replay.frames import topic_source as logs

    logs._opened.clear()  # noqa: SLF001 - the index is read anew
    return payscope.scan_log(path, topics[0]).collect().height


def by_rerun(path: Path, topics: list[str]) -> int:
    from rerun.chunk import McapReader

    stream = McapReader(path, decoders=["ros2_reflection"]).stream()
    if len(topics) == 1:
        stream = stream.filter(content=topics[0])
    return sum(c.to_record_batch().num_rows for c in stream if c.entity_path in topics)


def by_roboto(path: Path, topics: list[str]) -> int:
    import mcap_codec as m

    rows = 0
    for topic in topics:
        with path.open("rb") as file:

            def at(offset: int, length: int, file=file) -> bytes:  # noqa: ANN001
                file.seek(offset)
                return file.read(length)

            rows += sum(
                batch.num_rows
                for batch in m.open_mcap_file(
                    at,
                    path.stat().st_size,
                    channel=m.TopicName(topic),
                    timestamp=m.TimestampSource("message_log_time"),
                )
            )
    return rows


def by_rosbags(path: Path, topics: list[str], most: int) -> Callable[[], int]:
    def work() -> int:
        with rosbags(path) as items:
            return drain(items, most)

    assert len(topics) > 1
    return work


def median_ratio(
    mine: Callable[[], int], theirs: Callable[[], int], pairs: int
) -> tuple[float, float]:
    ratios = []
    for _ in range(pairs):
        own, other = timed(mine), timed(theirs)
        ratios.append((other[0] / own[0], other[1] / own[1]))
    clock, processor = zip(*ratios, strict=True)
    return statistics.median(clock), statistics.median(processor)


def row(*cells: str) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def first_frame(path: Path, name: str, times: int) -> tuple[float, float]:
    code = _FIRST[name].format(path=str(path), topic=TOPIC, timestamp=TIMESTAMP)
    code = (
        "from time import perf_counter, process_time\nbegin = perf_counter()\n"
        f"{code}\nprint(perf_counter() - begin, process_time())"
    )
    took = []
    for _ in range(times):
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        took.append(tuple(map(float, done.stdout.split())))
    clock, processor = zip(*took, strict=True)
    return statistics.median(clock), statistics.median(processor)


def compare(folder: Path, asked: argparse.Namespace) -> None:
    row("container", "topics", "against", "clock", "processor", "asked (clock, processor)")
    row(*["---"] * 6)
    for name, write in FILES.items():
        path = folder / name
        if not path.exists():
            write(path, asked.minutes)
        everything = list(TOPICS)
        if path.suffix == ".mcap":
            for label, theirs, least in (
                ("Rerun", by_rerun, "–, 3"),
                ("roboto-mcap-codec", by_roboto, "–, 2.5"),
            ):
                for what, topics in ((TOPIC, [TOPIC]), ("all", everything)):
                    clock, processor = median_ratio(
                        partial(ours, path, topics), partial(theirs, path, topics), asked.pairs
                    )
                    row(path.name, what, label, f"{clock:.1f}", f"{processor:.1f}", least)
        if path.name == "bz2.bag":
            messages, unpack = all_at_once(path), decompressor_of(path)
            clock, processor = median_ratio(
                partial(all_at_once, path), partial(bare, unpack, messages), asked.pairs
            )
            row(path.name, "all", "its decompressor", f"{clock:.2f}", f"{processor:.2f}", "–, 0.85")
            continue
        clock, processor = median_ratio(
            partial(all_at_once, path), by_rosbags(path, everything, asked.most), asked.pairs
        )
        least = ", ".join(map(str, AGAINST_ROSBAGS[path.name]))
        row(path.name, "all", "rosbags", f"{clock:.1f}", f"{processor:.1f}", least)


def all_at_once(path: Path) -> int:
    """Every topic in one pass, as `convert` goes through a log."""
    from replay import open_log

    with open_log(path) as log:
        described = log.topics()
        fields = dict(zip(described["topic"], described["fields"], strict=True))
        return sum(rows.height for _, rows in log.scan_many(fields, {}))


def bare(unpack: Callable[[], object], messages: int) -> int:
    """The decompressor alone; per message of the log."""
    unpack()
    return messages


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--most", type=int, default=50_000)
    parser.add_argument("--fresh", type=int, default=5)
    parser.add_argument("--folder", type=Path)
    asked = parser.parse_args()
    with TemporaryDirectory(prefix="payscope-") as made:
        folder = asked.folder or Path(made)
        folder.mkdir(exist_ok=True)
        compare(folder, asked)
        print()
        row("first 100 rows of a topic, fresh process", "clock s", "processor s")
        row(*["---"] * 3)
        small = folder / "small.mcap"
        if not small.exists():
            FILES["zstd.mcap"](small, 0.5)
        for path in (small, folder / "zstd.mcap"):
            for name in _FIRST:
                clock, processor = first_frame(path, name, asked.fresh)
                size = path.stat().st_size / 1e6
                row(f"{name}, {size:.1f} MB of MCAP", f"{clock:.2f}", f"{processor:.2f}")


if __name__ == "__main__":
    main()
