"""A CSV of a gigabyte: how long its columns take beside polars alone, and in how much memory.

    python -P benchmarks/large_table.py [GIGABYTES] [FOLDER]

Each measurement is a process of its own, ours and polars' in turn. What is read: the time and three
columns (what a replay asks for), and every column. Prints seconds, the ratio, and peak memory.
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import polars as pl

COLUMNS = 20
ROUNDS = 3
_BLOCK_ROWS = 200_000
_KINDS = {"four columns": ["c0", "c1", "c2"], "every column": [f"c{k}" for k in range(COLUMNS)]}


def write(path: Path, size: float) -> int:
    """Write rows until the file has `size` bytes; how many there are."""
    random = np.random.default_rng(1)
    block = {f"c{k}": np.round(random.normal(0, 100, _BLOCK_ROWS), 4) for k in range(COLUMNS)}
    rows = 0
    with path.open("wb") as file:
        while file.tell() < size:
            t = np.round((rows + np.arange(_BLOCK_ROWS)) / 1000, 3)
            pl.DataFrame({"time_s": t, **block}).write_csv(file, include_header=rows == 0)
            rows += _BLOCK_ROWS
    return rows


def read_ours(path: Path, names: list[str]) -> int:
    """Rows, by a log."""
    from replay.logs import open_log

    with open_log(path) as log:
        return log.read("table", names).height


def read_polars(path: Path, names: list[str]) -> int:
    """Rows, by polars alone: the same columns."""
    columns = ["time_s", *names]
    return pl.scan_csv(path).select(columns).collect(engine="streaming").height


def measure(who: str, path: Path, kind: str) -> dict[str, float]:
    """Seconds of a process that has its imports, and its peak memory in MB."""
    code = (
        "import json, resource, sys, time\n"
        "import replay.logs.table_log\n"
        "from pathlib import Path\n"
        "from benchmarks.large_table import read_ours, read_polars, _KINDS\n"
        "begin, cpu = time.perf_counter(), time.process_time()\n"
        f"rows = read_{who}(Path({str(path)!r}), _KINDS[{kind!r}])\n"
        "seconds = time.perf_counter() - begin\n"
        "cpu = time.process_time() - cpu\n"
        "used = resource.getrusage(resource.RUSAGE_SELF)\n"
        "print(json.dumps({'rows': rows, 's': seconds, 'cpu_s': cpu,"
        " 'mb': used.ru_maxrss / 1e3}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=_REPO
    )
    return json.loads(done.stdout)


_REPO = Path(__file__).resolve().parent.parent


def main(gigabytes: float, folder: str | None) -> None:
    """Print a row a kind of reading."""
    with tempfile.TemporaryDirectory(dir=folder) as made:
        path = Path(made) / "large.csv"
        begin = time.perf_counter()
        rows = write(path, gigabytes * 1e9)
        size = path.stat().st_size
        print(f"{size / 1e9:.2f} GB, {rows:,} rows, written in {time.perf_counter() - begin:.0f} s")
        for kind in _KINDS:
            found: dict[str, list[dict[str, float]]] = {"ours": [], "polars": []}
            for turn in range(ROUNDS):
                for who in ("ours", "polars") if turn % 2 else ("polars", "ours"):
                    found[who].append(measure(who, path, kind))
            ratios = [a["s"] / b["s"] for a, b in zip(found["ours"], found["polars"], strict=True)]
            cpu = [
                a["cpu_s"] / b["cpu_s"] for a, b in zip(found["ours"], found["polars"], strict=True)
            ]
            for who, each in found.items():
                seconds = statistics.median(one["s"] for one in each)
                peak = max(one["mb"] for one in each)
                print(
                    f"{kind}: {who} {seconds:.2f} s, peak {peak:,.0f} MB, {each[0]['rows']:,} rows"
                )
            print(
                f"{kind}: ratio of the pairs {statistics.median(ratios):.2f} "
                f"({min(ratios):.2f} to {max(ratios):.2f}), of processor time "
                f"{statistics.median(cpu):.2f}",
                flush=True,
            )


if __name__ == "__main__":
    size = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    main(size, sys.argv[2] if len(sys.argv) > 2 else None)
