"""The logs that are damaged: every container in every layout, and which bytes a checksum covers."""

import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import lz4.frame
import polars as pl
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from tests.replay.logs.damaged import without_bag_index, without_footer
from tests.replay.logs.fuzz.recorded import START_NS, STEP_NS, Recorded, every_encoding, ros, store

#: Small, so that damage meets many heads of records.
CHUNK_BYTES: Final = 3000


@dataclass(frozen=True)
class Guard:
    """Bytes of a file that checksums cover, and what is asked of who reads them flipped."""

    file: str
    stretches: list[range]
    #: every row that is read is as it was recorded; else it is only said that some may not be
    keeps_rows: bool = True
    #: the losses name how many messages of which topic are lost
    is_counted: bool = False


@dataclass(frozen=True)
class Source:
    """An undamaged log."""

    path: Path
    guards: tuple[Guard, ...] = ()

    @property
    def files(self) -> list[Path]:
        """Everything that can be damaged."""
        return sorted(self.path.iterdir()) if self.path.is_dir() else [self.path]


def _mcap(path: Path, recorded: Iterable[Recorded], **options: Any) -> Path:
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=CHUNK_BYTES, **options)
        writer.start(profile="ros2", library="test")
        schemas: dict[tuple[str, str], int] = {}
        channels: dict[str, int] = {}
        for r in recorded:
            kind = (r.type, r.encoding)
            if kind not in schemas:
                schemas[kind] = writer.register_schema(r.type, r.definition_format, r.definition)
            if r.topic not in channels:
                channels[r.topic] = writer.register_channel(r.topic, r.encoding, schemas[kind])
            writer.add_message(channels[r.topic], r.log_time_ns, r.data, r.log_time_ns)
        writer.finish()
    return path


def _mcap_chunks(path: Path, *, is_counted: bool) -> Guard:
    """The stored bytes of every chunk: its CRC covers what they unpack to, and nothing else."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    stretches: list[range] = []
    for chunk in summary.chunk_indexes:
        # behind opcode, length, two times, a size, the CRC, the compression and the stored size
        begin = chunk.chunk_start_offset + 9 + 8 + 8 + 8 + 4 + 4 + len(chunk.compression) + 8
        stretches.append(range(begin, begin + chunk.compressed_size))
    return Guard(path.name, stretches, is_counted=is_counted)


def _mcap_summary(path: Path) -> Guard:
    """From the summary's first record to its CRC: nothing is lost that the data do not repeat."""
    size = path.stat().st_size
    return Guard(path.name, [range(_summary_begin(path), size - 8)], is_counted=True)


def _summary_begin(path: Path) -> int:
    footer = path.read_bytes()[-8 - 4 - 8 - 8 :]
    return int.from_bytes(footer[:8], "little")


def _chunked_mcap(folder: Path, *, is_counted: bool = True, **options: Any) -> Source:
    path = _mcap(folder / "shift.mcap", every_encoding(), **options)
    return Source(path, (_mcap_chunks(path, is_counted=is_counted), _mcap_summary(path)))


def _mcap_without_footer(folder: Path) -> Source:
    path = _mcap(folder / "shift.mcap", every_encoding())
    chunks = _mcap_chunks(path, is_counted=False)
    without_footer(path)
    return Source(path, (chunks,))


def _mcap_without_crc(folder: Path) -> Source:
    return Source(_mcap(folder / "shift.mcap", every_encoding(), enable_crcs=False))


def _mcap_unchunked(folder: Path) -> Source:
    options = {"use_chunking": False, "enable_data_crcs": True}
    path = _mcap(folder / "shift.mcap", every_encoding(), **options)
    # behind the magic, up to the record that holds the CRC of all data
    data = Guard(path.name, [range(8, _summary_begin(path) - 13)], keeps_rows=False)
    return Source(path, (data, _mcap_summary(path)))


def _bag(folder: Path, compression: Writer1.CompressionFormat | None) -> Path:
    path = folder / "shift.bag"
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    if compression is Writer1.CompressionFormat.LZ4:  # as roslz4 writes it
        writer.compressor = partial(lz4.frame.compress, content_checksum=True)
    writer.chunk_threshold = CHUNK_BYTES
    with writer:
        connections: dict[str, Any] = {}
        for r in ros(ros1=True):
            if r.topic not in connections:
                types = store(ros1=True)
                connections[r.topic] = writer.add_connection(r.topic, r.type, typestore=types)
            writer.write(connections[r.topic], r.log_time_ns, r.data)
    return path


def _plain_bag(folder: Path) -> Source:
    return Source(_bag(folder, None))


def _compressed_bag(folder: Path, compression: Writer1.CompressionFormat) -> Source:
    path = _bag(folder, compression)
    with Reader1(path) as reader:
        chunks = [range(c.datapos, c.datapos + c.datasize) for c in reader.chunks.values()]
    return Source(path, (Guard(path.name, chunks, is_counted=True),))


def _crashed_bag(folder: Path) -> Source:
    path = _bag(folder, None)
    without_bag_index(path)
    return Source(path)


def _rosbag2(
    folder: Path,
    storage: StoragePlugin,
    recorded: Sequence[Recorded],
    mode: CompressionMode = CompressionMode.NONE,
) -> Path:
    path = folder / "shift"
    writer = Writer2(path, version=9, storage_plugin=storage)
    if mode != CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for r in recorded:
            if r.topic not in connections:
                types = store(ros1=False)
                connections[r.topic] = writer.add_connection(r.topic, r.type, typestore=types)
            writer.write(connections[r.topic], r.log_time_ns, r.data)
    return path


def _db3(folder: Path) -> Source:
    path = _rosbag2(folder, StoragePlugin.SQLITE3, ros(ros1=False))
    return Source(path.joinpath("shift.db3").rename(folder / "shift.db3"))


def _directory(folder: Path, storage: StoragePlugin, mode: CompressionMode) -> Source:
    return Source(_rosbag2(folder, storage, ros(ros1=False), mode))


def _split(folder: Path) -> Source:
    """A recording in three files, with the metadata of all."""
    whole = ros(ros1=False)
    path = _rosbag2(folder, StoragePlugin.MCAP, whole)
    path.joinpath("shift.mcap").unlink()
    third = len(whole) // 3
    parts = (whole[:third], whole[third : 2 * third], whole[2 * third :])
    files = [_mcap(path / f"shift_{k}.mcap", part) for k, part in enumerate(parts)]
    _rewrite(path, "- shift.mcap", "".join(f"- {file.name}\n  " for file in files).rstrip())
    chunks = [_mcap_chunks(file, is_counted=True) for file in files]
    return Source(path, (*chunks, *map(_mcap_summary, files)))


def _packed_file(folder: Path) -> Source:
    """As the command zstd packs a file: with a checksum at its end, of all of it."""
    path = _rosbag2(folder, StoragePlugin.SQLITE3, ros(ros1=False), CompressionMode.FILE)
    packed = path / "shift.db3.zstd"
    whole = zstandard.ZstdDecompressor().stream_reader(packed.read_bytes()).read()
    data = _with_checksum(whole)
    packed.write_bytes(data)
    # it is known only at the end that something was wrong
    return Source(path, (Guard(packed.name, [_behind_header(data, 0)], keeps_rows=False),))


def _packed_messages(folder: Path) -> Source:
    packed = [
        Recorded(r.topic, r.log_time_ns, _with_checksum(r.data), r.type, *_NO_DEFINITION)
        for r in ros(ros1=False)
    ]
    path = _rosbag2(folder, StoragePlugin.SQLITE3, packed)
    _rewrite(path, "compression_mode: ''", "compression_mode: message")
    _rewrite(path, "compression_format: ''", "compression_format: zstd")
    data = (path / "shift.db3").read_bytes()
    frames = [_behind_header(r.data, data.index(r.data)) for r in packed]
    return Source(path, (Guard("shift.db3", frames),))


_NO_DEFINITION: Final = ("cdr", b"", "")


def _with_checksum(data: bytes) -> bytes:
    return zstandard.ZstdCompressor(write_checksum=True).compress(data)


def _behind_header(frame: bytes, at: int) -> range:
    """What a frame's checksum covers; its header says whether there is one."""
    return range(at + zstandard.frame_header_size(frame), at + len(frame))


def _rewrite(folder: Path, old: str, new: str) -> None:
    metadata = folder / "metadata.yaml"
    text = metadata.read_text()
    assert old in text, text
    metadata.write_text(text.replace(old, new))


def _table(folder: Path, suffix: str) -> Source:
    steps = range(100)
    frame = pl.DataFrame(
        {
            "time_s": [(START_NS + step * STEP_NS) / 1e9 for step in steps],
            "force_N": [float(step % 17) for step in steps],
            "speed_m_s": [step / 100 for step in steps],
            "gear": [f"{step % 3}" if step % 5 else None for step in steps],
            "is_on": [step % 2 == 0 for step in steps],
        }
    )
    path = folder / f"shift.{suffix}"
    if suffix == "csv":
        frame.write_csv(path)
    elif suffix == "jsonl":
        frame.write_ndjson(path)
    else:
        frame.write_parquet(path, row_group_size=30)
    return Source(path)


SOURCES: Final[dict[str, Callable[[Path], Source]]] = {
    "mcap": partial(_chunked_mcap, compression=CompressionType.NONE),
    "mcap_lz4": partial(_chunked_mcap, compression=CompressionType.LZ4),
    "mcap_zstd": partial(_chunked_mcap, compression=CompressionType.ZSTD),
    "mcap_unchunked": _mcap_unchunked,
    "mcap_without_summary": _mcap_without_footer,
    "mcap_without_message_index": partial(
        _chunked_mcap, is_counted=False, index_types=IndexType.CHUNK
    ),
    "mcap_without_crc": _mcap_without_crc,
    "bag": _plain_bag,
    "bag_lz4": partial(_compressed_bag, compression=Writer1.CompressionFormat.LZ4),
    "bag_bz2": partial(_compressed_bag, compression=Writer1.CompressionFormat.BZ2),
    "bag_without_index": _crashed_bag,
    "db3": _db3,
    "rosbag2_db3": partial(_directory, storage=StoragePlugin.SQLITE3, mode=CompressionMode.NONE),
    "rosbag2_mcap": partial(_directory, storage=StoragePlugin.MCAP, mode=CompressionMode.NONE),
    "rosbag2_split": _split,
    "rosbag2_db3_file_zstd": _packed_file,
    "rosbag2_mcap_file_zstd": partial(
        _directory, storage=StoragePlugin.MCAP, mode=CompressionMode.FILE
    ),
    "rosbag2_db3_message_zstd": _packed_messages,
    "rosbag2_mcap_message_zstd": partial(
        _directory, storage=StoragePlugin.MCAP, mode=CompressionMode.MESSAGE
    ),
    "csv": partial(_table, suffix="csv"),
    "jsonl": partial(_table, suffix="jsonl"),
    "parquet": partial(_table, suffix="parquet"),
}


def copied(source: Source, folder: Path) -> Path:
    """The same log at another place."""
    target = folder / source.path.name
    if source.path.is_dir():
        shutil.copytree(source.path, target)
    else:
        shutil.copyfile(source.path, target)
    return target
