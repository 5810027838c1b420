"""The container of a rosbag2 directory: its storage files in the order of metadata.yaml."""

import re
import shutil
from collections.abc import Callable, Collection, Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from estimators.errors import LogError
from replay.decoding.batch import RawBatch, StoredMessage, join_messages
from replay.readers.container import BROKEN_BYTES, Connection, Container, LossList, no_times
from replay.readers.db3_file import Db3File
from replay.readers.mcap_file import McapFile

METADATA: Final = "metadata.yaml"
_STORAGE: Final[dict[str, Callable[[Path], Container]]] = {".mcap": McapFile, ".db3": Db3File}


class _Metadata(NamedTuple):
    names: tuple[str, ...]
    #: each message is compressed by itself
    message_zstd: bool
    #: topics that were announced: topic, type, encoding
    topics: tuple[tuple[str, str, str], ...]


class Rosbag2Directory:
    """A rosbag2 directory. It is read without metadata.yaml too, in the order of the names."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._parts: list[Container] = []
        self._losses = LossList()
        self._unpacked = TemporaryDirectory(prefix="payscope-")
        try:
            metadata = self._metadata()
            self.files: tuple[Path, ...] = self._open_parts(metadata)
        except BaseException:
            self.close()
            raise
        self._message_zstd = metadata.message_zstd
        self._merge(metadata)

    @property
    def losses(self) -> LossList:
        """Losses of the directory, then of each file."""
        return LossList([*self._losses, *(loss for part in self._parts for loss in part.losses)])

    def _metadata(self) -> _Metadata:
        path = self._path / METADATA
        names = tuple(sorted((p.name for p in storage_files(self._path)), key=_by_number))
        if not path.exists():
            return _Metadata(names, message_zstd=False, topics=())
        try:
            content = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
            return _parse(content["rosbag2_bagfile_information"], self._path)
        except (YAMLError, *BROKEN_BYTES) as error:
            reason = " ".join(str(error).split())
            self._losses.note(path, f"cannot be read, files are taken by name: {reason}")
            return _Metadata(names, message_zstd=False, topics=())

    def _open_parts(self, metadata: _Metadata) -> tuple[Path, ...]:
        opened: list[Path] = []
        faults: list[str] = []
        for name in metadata.names:
            path = self._path / name
            try:
                self._parts.append(self._open_part(path))
                opened.append(path)
            except (LogError, OSError) as error:
                faults.append(str(error))
                self._losses.note(path, f"not read: {error}")
        if not self._parts:
            raise LogError(
                f"{self._path}: none of its bag files can be read: "
                f"{'; '.join(faults) or 'there is none'}"
            )
        yaml = self._path / METADATA
        return (yaml, *opened) if yaml.exists() else tuple(opened)

    def _open_part(self, path: Path) -> Container:
        if not path.exists():
            raise LogError(f"{METADATA} names {path.name}, which is not there")
        if path.stat().st_size == 0:
            raise LogError("the file is empty (0 bytes)")
        stored = path
        if path.suffix == ".zstd":
            stored = Path(self._unpacked.name, path.stem)
            try:
                with pa.input_stream(path, compression="zstd") as packed, stored.open("wb") as out:
                    shutil.copyfileobj(packed, out)
            except BROKEN_BYTES as error:  # what came before the fault stays
                self._losses.note(path, f"the compressed file is damaged: {error}")
        opener = _STORAGE.get(stored.suffix)
        if opener is None:
            raise LogError(f"{path.name} is neither .mcap nor .db3")
        return opener(stored)

    def _merge(self, metadata: _Metadata) -> None:
        """Number the connections of all parts in one row."""
        self._origin: list[tuple[int, int]] = []
        merged: list[Connection] = []
        for part_number, part in enumerate(self._parts):
            for c in part.connections:
                merged.append(_renumbered(c, len(merged)))
                self._origin.append((part_number, c.id))
        seen = {c.topic for c in merged}
        for topic, kind, encoding in metadata.topics:
            if topic not in seen:
                merged.append(Connection(len(merged), topic, kind, encoding, "", ""))
        self.connections: tuple[Connection, ...] = tuple(merged)

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """The log times of a connection of one of the files."""
        if connection_id >= len(self._origin):
            return no_times()
        part_number, inner = self._origin[connection_id]
        return self._parts[part_number].log_times(inner)

    def batches(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawBatch]:
        """Messages file by file."""
        for part_number, part in enumerate(self._parts):
            inner = [
                inner
                for key, (number, inner) in enumerate(self._origin)
                if number == part_number and key in connection_ids
            ]
            if not inner:
                continue
            for batch in part.batches(inner, start_ns, end_ns):
                yield from join_messages(self._unzipped(batch)) if self._message_zstd else (batch,)

    def _unzipped(self, batch: RawBatch) -> Iterator[StoredMessage]:
        for time, data in zip(batch.log_times.tolist(), batch.messages(), strict=True):
            try:
                message = pa.CompressedInputStream(pa.BufferReader(data), "zstd").read()
            except BROKEN_BYTES as error:
                self._losses.note(self._path, f"messages that cannot be decompressed: {error}")
            else:
                yield StoredMessage(time, message)

    def close(self) -> None:
        """Release the files."""
        for part in self._parts:
            part.close()
        self._unpacked.cleanup()


def storage_files(folder: Path) -> list[Path]:
    """The bag files in a folder, also those that are compressed as a whole."""
    return [p for p in folder.iterdir() if Path(p.name.removesuffix(".zstd")).suffix in _STORAGE]


def _by_number(name: str) -> list[tuple[int, str]]:
    """Put shift_10 after shift_9."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _parse(information: dict[str, Any], folder: Path) -> _Metadata:
    mode = str(information.get("compression_mode") or "none").lower()
    fmt = information.get("compression_format") or "zstd"
    if mode != "none" and fmt != "zstd":
        raise LogError(f"{folder}: compressed with {fmt}; only zstd can be read")
    return _Metadata(
        tuple(_inside(str(name), folder) for name in information["relative_file_paths"]),
        mode == "message",
        tuple(
            (topic["name"], topic["type"], topic["serialization_format"])
            for topic in (t["topic_metadata"] for t in information["topics_with_message_count"])
        ),
    )


def _inside(name: str, folder: Path) -> str:
    """The file of the folder that metadata.yaml means.

    Raises:
        LogError: for a name that leads out of the folder.
    """
    path = PurePosixPath(name)
    if path.is_absolute() or PureWindowsPath(name).drive or ".." in path.parts or "\\" in name:
        raise LogError(
            f"{folder / METADATA}: names '{name}', outside its folder; "
            "relative_file_paths may only name files beside metadata.yaml"
        )
    # before version 4 the path began with the directory's own name
    return name if (folder / name).exists() else path.name


def _renumbered(connection: Connection, key: int) -> Connection:
    c = connection
    return Connection(key, c.topic, c.type, c.encoding, c.definition, c.definition_format)
