"""metadata.yaml of a rosbag2 directory: the order of its files, and what was to be recorded."""

from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from estimators.errors import LogError
from replay.messages.broken import BROKEN_BYTES

METADATA: Final = "metadata.yaml"
#: A thousand topics take less.
_LARGEST_BYTES: Final = 2**20


class MetadataError(Exception):
    """Why metadata.yaml is of no use, in a line."""


@dataclass(frozen=True, slots=True)
class AnnouncedTopic:
    """A topic as metadata.yaml lists it."""

    name: str
    type: str
    encoding: str
    messages: int


@dataclass(frozen=True, slots=True)
class Metadata:
    """What metadata.yaml says."""

    names: tuple[str, ...]
    #: each message is compressed by itself
    message_zstd: bool = False
    topics: tuple[AnnouncedTopic, ...] = ()
    #: of all topics; None where it does not say
    messages: int | None = None


def read_metadata(folder: Path) -> Metadata:
    """Read metadata.yaml.

    Raises:
        MetadataError: it is damaged.
        LogError: it names files outside the folder, or the messages have a compression other than
            zstd.
    """
    path = folder / METADATA
    if not path.is_file():  # a pipe would be waited for
        raise MetadataError("it is no file")
    if path.stat().st_size > _LARGEST_BYTES:
        raise MetadataError(f"it has more than {_LARGEST_BYTES:,} bytes")
    try:
        content = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
        return _parse(content["rosbag2_bagfile_information"], folder)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = "" if mark is None else f" in line {mark.line + 1}"
        raise MetadataError(f"{error.problem or error.context}{where}") from error
    except RecursionError as error:
        raise MetadataError("it is nested too deeply") from error
    except UnicodeError as error:
        raise MetadataError("it is no UTF-8 text") from error
    except KeyError as error:
        raise MetadataError(f"it has no {error.args[0]}") from error
    except OSError as error:
        raise MetadataError(error.strerror or str(error)) from error
    except (YAMLError, AttributeError, *BROKEN_BYTES) as error:
        raise MetadataError("it is not laid out as rosbag2 does") from error


def _parse(information: dict[str, Any], folder: Path) -> Metadata:
    messages = information.get("message_count")
    mode = _text(information.get("compression_mode") or "none").lower()
    fmt = _text(information.get("compression_format") or "zstd")
    if mode != "none" and fmt != "zstd":
        raise LogError(f"{folder}: compressed with {fmt}; only zstd can be read")
    return Metadata(
        tuple(_inside(_text(name), folder) for name in information["relative_file_paths"]),
        mode == "message",
        tuple(_announced(entry) for entry in information["topics_with_message_count"]),
        None if messages is None else int(messages),
    )


def _announced(entry: dict[str, Any]) -> AnnouncedTopic:
    topic = entry["topic_metadata"]
    return AnnouncedTopic(
        _text(topic["name"]),
        _text(topic["type"]),
        _text(topic["serialization_format"]),
        int(entry["message_count"]),
    )


def _text(value: Any) -> str:
    """A value that is text: YAML also knows lists of lists of lists, and half characters."""
    if not isinstance(value, str):
        raise TypeError(f"{type(value).__name__} in the place of a text")
    value.encode()
    return value


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
