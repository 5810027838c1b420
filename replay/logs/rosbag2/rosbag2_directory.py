"""Container of a rosbag2 directory: its storage files in the order of metadata.yaml.

The files, or single messages, may be compressed by zstd. Declared sizes are not trusted.
"""

import re
import shutil
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

import numpy as np
import zstandard
from numpy.typing import NDArray

from analysis.model.loss import Loss
from estimators.errors import LogError
from replay.logs.mcap import McapFile
from replay.logs.messages.raw_batch import BATCH_BYTES, RawBatch, make_batch_of_messages
from replay.logs.rosbag2.rosbag2_metadata import METADATA, Metadata, MetadataError, read_metadata
from replay.logs.sqlite import Db3File
from replay.logs.storage import (
    END_NS,
    LARGEST_BYTES,
    UNKNOWN_NS,
    BatchGroup,
    Connection,
    Container,
    LossList,
    make_empty_log_times,
    prefetch_items_in_thread,
)

#: Time in ns by which parts of a split recording may overlap.
_OVERLAP_NS: Final = 1_000_000_000
_STORAGE: Final[dict[str, Callable[[Path], Container]]] = {".mcap": McapFile, ".db3": Db3File}
#: Largest ratio of unpacked to compressed bytes of a file or message.
_MOST_GROWTH: Final = 200
#: Unpacked bytes of a message that are allowed at any ratio: a black image compresses to almost
#: nothing.
_ANY_MESSAGE: Final = 64 * 2**20
#: bytes of a frame that are unpacked at once; zstd compresses at most 128 KiB into 4 bytes
_FEW_BYTES: Final = 256
_STEP: Final = 2**20


class Rosbag2Directory:
    """A rosbag2 directory; without metadata.yaml, its files are read in order of their names."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._parts: list[Container] = []
        self._losses = LossList()
        self._scratch = TemporaryDirectory(prefix="payscope-")
        try:
            metadata = self._read_metadata_or_note_damage()
            self.files: tuple[Path, ...] = self._open_storage_files(metadata)
        except BaseException:
            self.close()
            raise
        self._metadata = metadata
        self._is_compared = False
        self._number_connections_of_all_files(metadata)

    @property
    def losses(self) -> Sequence[Loss]:
        """Losses of the directory, then of each file."""
        return [*self._losses, *(loss for part in self._parts for loss in part.losses)]

    def _read_metadata_or_note_damage(self) -> Metadata:
        names = tuple(
            sorted((p.name for p in list_storage_files(self._path)), key=_make_part_sort_key)
        )
        # a recorder killed while compressing leaves both files; the uncompressed one is complete
        names = tuple(n for n in names if n.removesuffix(".zstd") == n or n[:-5] not in names)
        if not (self._path / METADATA).exists():
            what = (
                "is missing, so the recorder did not finish or files were left behind: the files "
                "found are read in the order of their names, and others may be missing"
            )
            self._losses.add_loss(self._path / METADATA, what)
            return Metadata(names)
        try:
            metadata = read_metadata(self._path)
        except MetadataError as error:
            what = f"cannot be read, so the files are read in the order of their names: {error}"
            self._losses.add_loss(self._path / METADATA, what)
            return Metadata(names)
        self._note_wrong_file_names(metadata.names, names)
        return metadata

    def _note_wrong_file_names(
        self, expected_names: Sequence[str], existing_names: Sequence[str]
    ) -> None:
        """Note files that metadata.yaml names more than once or not at all, as losses."""
        for name, times in Counter(expected_names).items():
            if times > 1:
                what = f"names {name} {times:,} times; it is read once"
                self._losses.add_loss(self._path / METADATA, what)
        known = {name.removesuffix(".zstd") for name in expected_names}
        for name in existing_names:
            if name.removesuffix(".zstd") not in known:
                self._losses.add_loss(self._path / name, f"not read: {METADATA} does not name it")

    def _open_storage_files(self, metadata: Metadata) -> tuple[Path, ...]:
        opened: list[Path] = []
        faults: list[str] = []
        for name in dict.fromkeys(metadata.names):
            path = self._path / name
            try:
                self._parts.append(self._open_storage_file(path))
                opened.append(path)
            except (LogError, OSError) as error:
                # an unpacked file is reported by its name in the directory
                fault = str(getattr(error, "strerror", None) or error).replace(
                    f"{self._scratch.name}/", ""
                )
                faults.append(fault)
                self._losses.add_loss(path, f"not read: {fault}")
        if not self._parts:
            reasons = [str(loss) for loss in self._losses] or faults
            raise LogError(
                f"{self._path}: none of its bag files can be read: "
                f"{'; '.join(reasons) or 'there is no storage file'}"
            )
        yaml = self._path / METADATA
        return (yaml, *opened) if yaml.exists() else tuple(opened)

    def _open_storage_file(self, path: Path) -> Container:
        if not path.exists():
            raise LogError(
                f"{METADATA} names {path.name}, which is missing from the folder; copy it there"
            )
        if path.stat().st_size == 0:
            raise LogError("the file is empty (0 bytes); copy it again")
        stored = path
        if path.suffix == ".zstd":
            stored = Path(self._scratch.name, path.stem)
            fault = decompress_file_or_describe_fault(path, stored)
            if fault:
                what = f"the compressed file is damaged; the part before that is read: {fault}"
                self._losses.add_loss(path, what)
        opener = _STORAGE.get(stored.suffix)
        if opener is None:
            raise LogError(f"{path.name} is neither .mcap nor .db3, the formats that are read")
        return opener(stored)

    def _number_connections_of_all_files(self, metadata: Metadata) -> None:
        """Number the connections of all files consecutively."""
        self._origin: list[tuple[int, int]] = []
        merged: list[Connection] = []
        for part_number, part in enumerate(self._parts):
            for c in part.connections:
                merged.append(replace(c, id=len(merged)))
                self._origin.append((part_number, c.id))
        seen = {c.topic for c in merged}
        for topic in metadata.topics:
            if topic.name not in seen:
                merged.append(
                    Connection(len(merged), topic.name, topic.type, topic.encoding, "", "")
                )
        self.connections: tuple[Connection, ...] = tuple(merged)

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """Log times of a connection in ns, (n,)."""
        self._note_wrong_message_counts()
        if connection_id >= len(self._origin):
            return make_empty_log_times()
        part_number, inner = self._origin[connection_id]
        return self._parts[part_number].log_times(inner)

    def message_count(self, connection_id: int) -> int:
        """Number of messages of a connection."""
        self._note_wrong_message_counts()
        if connection_id >= len(self._origin):
            return 0
        part_number, inner = self._origin[connection_id]
        return self._parts[part_number].message_count(inner)

    def iter_batch_groups(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[BatchGroup]:
        """Read messages file by file."""
        later = [part.log_time_lower_bound_ns() for part in self._parts[1:]]
        for part_number, part in enumerate(self._parts):
            behind = min(later[part_number:], default=END_NS)
            outer = {
                inner: key
                for key, (number, inner) in enumerate(self._origin)
                if number == part_number and key in connection_ids
            }
            if not outer:
                continue
            stored = part.iter_batch_groups(list(outer), start_ns, end_ns)
            if self._metadata.message_zstd:
                stored = prefetch_items_in_thread(self._decompress_messages_of_part(part, stored))
            for batches, floor_ns in stored:
                renamed = [replace(b, connection_id=outer[b.connection_id]) for b in batches]
                yield BatchGroup(renamed, min(floor_ns, behind))

    def _decompress_messages_of_part(
        self, container: Container, stored_groups: Iterator[BatchGroup]
    ) -> Iterator[BatchGroup]:
        lost: Counter[int] = Counter()
        floor_ns = UNKNOWN_NS
        for batches, next_floor_ns in stored_groups:
            for unpacked, damaged in chain.from_iterable(map(iter_decompressed_messages, batches)):
                lost[unpacked.connection_id] += damaged
                yield BatchGroup([unpacked], floor_ns)
            floor_ns = next_floor_ns
        topics = {c.id: c.topic for c in container.connections}
        for key, count in lost.items():
            if count:
                self._losses.add_loss(
                    container.files[0], f"{count:,} messages cannot be decompressed", topics[key]
                )

    def _note_wrong_message_counts(self) -> None:
        """Note as losses where message counts in metadata.yaml differ from those of the files."""
        if self._is_compared:
            return
        self._is_compared = True
        self._add_losses_for_files_overlapping_in_time()
        held: Counter[str] = Counter()
        for connection, (part_number, inner) in zip(self.connections, self._origin, strict=False):
            held[connection.topic] += self._parts[part_number].log_times(inner).size
        for topic in self._metadata.topics:
            if topic.messages != held[topic.name]:
                self._losses.add_loss(
                    self._path / METADATA,
                    f"counts {topic.messages:,} messages, but {held[topic.name]:,} were found",
                    topic.name,
                )
        counted, total = self._metadata.messages, held.total()
        if counted not in (None, total):
            self._losses.add_loss(
                self._path / METADATA,
                f"counts {counted:,} messages in all, but {total:,} were found",
            )

    def _add_losses_for_files_overlapping_in_time(self) -> None:
        """Add a loss for files that overlap in time, since parts of one recording do not."""
        spans: list[tuple[int, int, str]] = []
        for part in self._parts:
            times = np.concatenate(
                [make_empty_log_times(), *(part.log_times(c.id) for c in part.connections)]
            )
            if times.size:
                spans.append((int(times.min()), int(times.max()), part.files[0].name))
        for (_, end, first), (start, _, second) in pairwise(sorted(spans)):
            if end - start > _OVERLAP_NS:
                self._losses.add_loss(
                    self._path / second,
                    f"begins {(end - start) / 1e9:.3f} s before {first} ends, so they may not be "
                    "parts of one recording: messages in both count twice; give only one of them",
                )

    def log_time_lower_bound_ns(self) -> int:
        """Lower bound of the log times of all files."""
        return min((part.log_time_lower_bound_ns() for part in self._parts), default=END_NS)

    def check_whole_file_and_count_valid_crcs(self) -> int:
        """Check every file; see `Container.check_whole_file_and_count_valid_crcs`."""
        self._note_wrong_message_counts()
        return sum(part.check_whole_file_and_count_valid_crcs() for part in self._parts)

    def close(self) -> None:
        """Release the files."""
        for part in self._parts:
            part.close()
        self._scratch.cleanup()


def list_storage_files(folder: Path) -> list[Path]:
    """List the storage files in a folder, including compressed ones."""
    return [p for p in folder.iterdir() if Path(p.name.removesuffix(".zstd")).suffix in _STORAGE]


def _make_part_sort_key(name: str) -> list[tuple[int, str]]:
    """Make a sort key by which shift_10 follows shift_9."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def decompress_file_or_describe_fault(compressed_file: Path, target: Path) -> str | None:
    """Decompress a file; if it is damaged, keep the part before that and return the reason."""
    import pyarrow as pa  # slow to import, and few logs are compressed by file

    # half of the free space is left to other programs
    free = shutil.disk_usage(target.parent).free // 2
    room = min(_MOST_GROWTH * compressed_file.stat().st_size + _STEP, free)
    try:
        with (
            pa.input_stream(compressed_file, compression="zstd") as source,
            target.open("wb") as out,
        ):
            while step := source.read(_STEP):
                room -= len(step)
                if room < 0:
                    return f"it grows beyond {out.tell():,} bytes"
                out.write(step)
    except (OSError, pa.ArrowException) as error:
        return " ".join(str(error).split())
    return None


class DecompressedBatch(NamedTuple):
    """Decompressed messages, and how many could not be decompressed."""

    batch: RawBatch
    failures: int


def iter_decompressed_messages(batch: RawBatch) -> Iterator[DecompressedBatch]:
    """Decompress the messages of a batch, in batches of bounded size."""
    unpacker = zstandard.ZstdDecompressor()
    messages: list[bytes] = []
    times: list[int] = []
    failed = size = 0
    for time, packed in zip(batch.log_times.tolist(), batch.iter_messages(), strict=True):
        try:
            message = _decompress_file(unpacker, packed)
        except (zstandard.ZstdError, MemoryError):
            failed += 1
            continue
        messages.append(message)
        times.append(time)
        size += len(message)
        if size >= BATCH_BYTES:
            yield DecompressedBatch(
                make_batch_of_messages(batch.connection_id, times, messages), failed
            )
            messages, times, failed, size = [], [], 0, 0
    yield DecompressedBatch(make_batch_of_messages(batch.connection_id, times, messages), failed)


def _decompress_file(unpacker: zstandard.ZstdDecompressor, compressed: bytes) -> bytes:
    room = min(_MOST_GROWTH * len(compressed) + _ANY_MESSAGE, LARGEST_BYTES)
    declared = zstandard.frame_content_size(compressed)
    if declared > room:
        raise zstandard.ZstdError(f"it would decompress to more than {room:,} bytes")
    if declared >= 0:
        return unpacker.decompress(compressed, max_output_size=room)
    return _decompress_frame_of_unknown_size(unpacker, compressed, room)


def _decompress_frame_of_unknown_size(
    unpacker: zstandard.ZstdDecompressor, compressed: bytes, max_bytes: int
) -> bytes:
    """Decompress a frame of unknown size step by step, at most to `max_bytes`."""
    stream = unpacker.decompressobj()
    parts: list[bytes] = []
    room = max_bytes
    for at in range(0, len(compressed), _FEW_BYTES):
        parts.append(stream.decompress(compressed[at : at + _FEW_BYTES]))
        room -= len(parts[-1])
        if room < 0:
            raise zstandard.ZstdError(f"it would decompress to more than {max_bytes:,} bytes")
        if stream.eof:
            return b"".join(parts)
    raise zstandard.ZstdError("it is truncated")
