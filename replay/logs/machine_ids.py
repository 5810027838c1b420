"""Find the machine's serial number in the metadata of a log."""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

from estimators.errors import join_to_one_line
from replay.logs.log_limits import LIMITS

#: Keys of a serial number in lower case, with anything but letters and digits replaced by `_`.
KEYS: Final = frozenset(
    {
        *(
            f"{whose}_{what}"
            for whose in ("machine", "vehicle")
            for what in ("id", "serial", "serial_number")
        ),
        "vin",
    }
)
_SEPARATORS: Final = re.compile(r"[^a-z0-9]+")
#: Name and value in a preamble's line: "# Machine ID: CAT262C-0042", "machine_id;CAT262C-0042;;".
_NAMED_LINE: Final = re.compile(r'^[\s#%/"]*([^:=,;\t"]{1,60}?)"?\s*[:=,;\t]\s*(.+)$')
#: Name of the metadata record in which rosbag2 keeps its metadata.yaml in an MCAP file.
_ROSBAG2: Final = "rosbag2"
_SERIALIZED: Final = "serialized_metadata"


def iter_serial_numbers_in_metadata(texts: Mapping[str, str], record: str = "") -> Iterator[str]:
    """Yield the serial numbers among metadata values, by their keys.

    Args:
        texts: metadata values by key.
        record: name of the metadata record; `id` in the record `machine` is the machine's.
    """
    for key, text in texts.items():
        names = (key, f"{record}_{key}") if record else (key,)
        said = " ".join(join_to_one_line(text).split())
        if said and any(_SEPARATORS.sub("_", name.lower()).strip("_") in KEYS for name in names):
            yield said[: LIMITS.machine_id_characters]


def iter_serial_numbers_in_preamble(lines: Iterable[str]) -> Iterator[str]:
    """Yield the serial numbers in lines of name and value above a text table."""
    for line in lines:
        named = _NAMED_LINE.match(line)
        if named is not None:
            yield from iter_serial_numbers_in_metadata({named[1]: named[2].strip(' ,;\t"')})


def read_distinct_serial_numbers(files: Iterable[Path]) -> tuple[str, ...]:
    """Distinct serial numbers in the metadata of a log's files.

    MCAP has metadata records, and rosbag2 `custom_data`, which its SQLite storage repeats since ROS
    2 Iron. A ROS 1 bag has neither.
    """
    found: list[str] = []
    for path in files:
        if path.suffix == ".mcap":
            found += _iter_serial_numbers_in_mcap(path)
        elif path.suffix == ".db3":
            found += _iter_serial_numbers_in_db3(path)
        elif path.name == "metadata.yaml":
            from replay.logs.rosbag2 import parse_custom_data

            found += iter_serial_numbers_in_metadata(parse_custom_data(path.read_bytes()))
    return tuple(dict.fromkeys(found))


def _iter_serial_numbers_in_mcap(path: Path) -> Iterator[str]:
    from replay.logs.mcap import read_metadata_records

    for name, texts in read_metadata_records(path):
        if name == _ROSBAG2 and _SERIALIZED in texts:
            from replay.logs.rosbag2 import parse_custom_data  # imports a reader of YAML

            yield from iter_serial_numbers_in_metadata(
                parse_custom_data(texts[_SERIALIZED].encode())
            )
        else:
            yield from iter_serial_numbers_in_metadata(texts, name)


def _iter_serial_numbers_in_db3(path: Path) -> Iterator[str]:
    from replay.logs.rosbag2 import parse_custom_data
    from replay.logs.sqlite import read_metadata_texts

    for text in read_metadata_texts(path):
        yield from iter_serial_numbers_in_metadata(parse_custom_data(text.encode()))
