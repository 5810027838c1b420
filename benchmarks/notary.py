"""What `payscope notarise` costs beside `sha256sum` over the same bytes, in processor time.

    python -P benchmarks/notary.py [MEGABYTES]

Logs as a recorder with a camera writes them: MCAP with messages of half a megabyte in chunks of a
megabyte, 100 MB a log. Both run as processes of their own, in turn; the least of three is printed.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

LOG_BYTES = 100 << 20
MESSAGE_BYTES = 500_000
BEGIN_NS = 1_777_636_800 * 10**9
TIMES = 3


def camera_log(path: Path, seed: int) -> None:
    """Write a log of messages that nothing compresses."""
    rng = np.random.default_rng(seed)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 20, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"uint8[] data\n")
        channel = writer.register_channel("/camera", "cdr", schema)
        for number in range(LOG_BYTES // MESSAGE_BYTES):
            at = BEGIN_NS + seed * 3600 * 10**9 + number * 10**8
            writer.add_message(channel, at, rng.bytes(MESSAGE_BYTES), at)
        writer.add_metadata("machine", {"id": "CAT262C-0042"})
        writer.finish()
    os.utime(path, ns=(BEGIN_NS, BEGIN_NS))


def processor_s(command: Sequence[str], environment: dict[str, str]) -> float:
    """Processor time of a process and its children, in s."""
    child = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(f"{command[0]} ended with {status}")
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Measure."""
    megabytes = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    with tempfile.TemporaryDirectory(prefix="payscope-notary-") as place:
        folder = Path(place) / "logs"
        folder.mkdir()
        logs = [folder / f"log-{k:03}.mcap" for k in range(max(1, megabytes // 100))]
        for seed, log in enumerate(logs):
            camera_log(log, seed)
        key = Path(place) / "key.pem"
        subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", key], check=True)
        payscope = shutil.which("payscope", path=str(Path(sys.executable).parent)) or "payscope"
        hashed, listed = [], []
        for turn in range(TIMES):
            environment = {**os.environ, "PAYSCOPE_NOTARY_STATE": f"{place}/state-{turn}"}
            hashed.append(processor_s(["sha256sum", *map(str, logs)], environment))
            kept = f"{place}/list-{turn}.jsonl"
            command = [payscope, "notarise", str(folder), "--key", str(key), "--list", kept]
            listed.append(processor_s(command, environment))
        size = sum(log.stat().st_size for log in logs)
        sha, notary = min(hashed), min(listed)
        print(f"{len(logs)} logs, {size / 1e9:.2f} GB")
        print(f"sha256sum          {sha:6.2f} s of processor, {size / sha / 1e6:6.0f} MB/s")
        print(f"payscope notarise  {notary:6.2f} s of processor, {notary / sha:.2f} times as much")


if __name__ == "__main__":
    main()
