"""Read metadata.yaml of a rosbag2 directory: the order of its files, and its topics."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from estimators.errors import LogError
from replay.logs.messages.broken_bytes import BROKEN_BYTES, BrokenBytesError

METADATA: Final = "metadata.yaml"
_HEADING: Final = "rosbag2_bagfile_information"
#: Most bytes of the file; a thousand topics take less.
_LARGEST_BYTES: Final = 2**20


class MetadataError(Exception):
    """Raised if metadata.yaml cannot be used; one line with the reason."""


@dataclass(frozen=True, slots=True)
class AnnouncedTopic:
    """A topic as metadata.yaml lists it."""

    name: str
    type: str
    encoding: str
    messages: int


@dataclass(frozen=True, slots=True)
class Metadata:
    """Content of metadata.yaml."""

    names: tuple[str, ...]
    #: whether each message is compressed by itself
    message_zstd: bool = False
    topics: tuple[AnnouncedTopic, ...] = ()
    #: number of messages of all topics; None if not stated
    messages: int | None = None


def read_metadata(folder: Path) -> Metadata:
    """Read metadata.yaml.

    Raises:
        MetadataError: it is damaged.
        LogError: it names files outside the folder, or a compression other than zstd.
    """
    path = folder / METADATA
    if not path.is_file():  # reading a pipe would block
        raise MetadataError("it is not a file")
    if path.stat().st_size > _LARGEST_BYTES:
        raise MetadataError(f"it has more than {_LARGEST_BYTES:,} bytes")
    try:
        return _parse_metadata(load_metadata_yaml(path), folder)
    except BrokenBytesError as error:
        raise MetadataError(str(error)) from error


def parse_custom_data(data: bytes) -> Mapping[str, str]:
    """Parse the `custom_data` of a metadata.yaml: texts given by the recorder, by name.

    Empty if it has none or is damaged; `read_metadata` reports the error.
    """
    if len(data) > _LARGEST_BYTES:
        return {}
    try:
        content = parse_yaml_text(data.decode())
        # the copy in an MCAP file lacks the top-level key
        information = content.get(_HEADING, content) if isinstance(content, dict) else None
        custom = _require_value_of_key(information, "custom_data")
    except (BrokenBytesError, UnicodeError):
        return {}
    texts = custom.items() if isinstance(custom, dict) else ()
    return {key: text for key, text in texts if isinstance(key, str) and isinstance(text, str)}


def load_metadata_yaml(path: Path) -> Any:
    """Load the file's content.

    Raises:
        BrokenBytesError: it is not YAML, or cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeError as error:
        raise BrokenBytesError("it is not UTF-8 text") from error
    except OSError as error:
        raise BrokenBytesError(error.strerror or error) from error
    return parse_yaml_text(text)


def parse_yaml_text(text: str) -> Any:
    """Parse YAML.

    Raises:
        BrokenBytesError: it is not YAML.
    """
    try:
        return YAML(typ="safe").load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = "" if mark is None else f" on line {mark.line + 1}"
        raise BrokenBytesError(f"{error.problem or error.context}{where}") from error
    except RecursionError as error:
        raise BrokenBytesError("it is nested too deeply") from error
    except (YAMLError, AttributeError, *BROKEN_BYTES) as error:
        raise _make_metadata_layout_error() from error


def _make_metadata_layout_error() -> BrokenBytesError:
    return BrokenBytesError("its layout is not that of rosbag2")


def _parse_metadata(content: Any, folder: Path) -> Metadata:
    information = _require_value_of_key(content, _HEADING)
    if not isinstance(information, dict):
        raise _make_metadata_layout_error()
    messages = information.get("message_count")
    mode = require_text(information.get("compression_mode") or "none").lower()
    fmt = require_text(information.get("compression_format") or "zstd")
    if mode != "none" and fmt != "zstd":
        raise LogError(
            f"{folder}: compressed with {fmt}, but only zstd can be read; unpack it first"
        )
    return Metadata(
        tuple(
            require_path_inside_folder(require_text(name), folder)
            for name in _require_yaml_list(
                _require_value_of_key(information, "relative_file_paths")
            )
        ),
        mode == "message",
        tuple(
            _parse_topic_entry(entry)
            for entry in _require_yaml_list(
                _require_value_of_key(information, "topics_with_message_count")
            )
        ),
        None if messages is None else require_message_count(messages),
    )


def _parse_topic_entry(entry: Any) -> AnnouncedTopic:
    topic = _require_value_of_key(entry, "topic_metadata")
    return AnnouncedTopic(
        require_text(_require_value_of_key(topic, "name")),
        require_text(_require_value_of_key(topic, "type")),
        require_text(_require_value_of_key(topic, "serialization_format")),
        require_message_count(_require_value_of_key(entry, "message_count")),
    )


def _require_value_of_key(mapping: Any, key: str) -> Any:
    if not isinstance(mapping, dict):
        raise _make_metadata_layout_error()
    if key not in mapping:
        raise BrokenBytesError(f"the key '{key}' is missing")
    return mapping[key]


def _require_yaml_list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise _make_metadata_layout_error()
    return value


def require_message_count(value: Any) -> int:
    """Return a number of messages as an integer; YAML may also have text or infinity there."""
    try:
        return int(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise _make_metadata_layout_error() from error


def require_text(value: Any) -> str:
    """Return a text if it is one; YAML may also have lists, or unpaired surrogates, there."""
    if not isinstance(value, str):
        raise _make_metadata_layout_error()
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise BrokenBytesError("it is not UTF-8 text") from error
    return value


def require_path_inside_folder(name: str, folder: Path) -> str:
    """Return the path, relative to the folder, of a file named in metadata.yaml.

    Raises:
        LogError: the name leads out of the folder.
    """
    path = PurePosixPath(name)
    if path.is_absolute() or PureWindowsPath(name).drive or ".." in path.parts or "\\" in name:
        raise LogError(
            f"{folder / METADATA}: names '{name}', outside its folder; "
            "relative_file_paths may only name files beside metadata.yaml"
        )
    # before version 4 the path began with the directory's own name
    return name if (folder / name).exists() else path.name
