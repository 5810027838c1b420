"""All dialects, and what a person answers to the draft of each."""

import re
from collections.abc import Callable
from typing import Final

from benchmarks.dialects import (
    controller_files,
    drawn_anew_files,
    drawn_eighth_files,
    drawn_fifth_files,
    drawn_files,
    drawn_frozen_files,
    drawn_last_files,
    drawn_next_files,
    drawn_once_more_files,
    drawn_seventh_files,
    drawn_sixth_files,
    drawn_sixth_sites,
    later_files,
    logger_files,
    recorder_files,
)
from benchmarks.dialects.dialect_file import GEAR, NM_PER_A, POLE_PAIRS, RADIUS_M, DialectFile

#: What writes the files of each set, in the order that they were drawn in.
SETS: Final[dict[str, tuple[Callable[[], list[DialectFile]], ...]]] = {
    "written with the reader": (
        recorder_files.dialect_files,
        controller_files.dialect_files,
        logger_files.dialect_files,
    ),
    "twenty more": (later_files.dialect_files,),
    "drawn against the reader as it was": (drawn_files.dialect_files,),
    "drawn before it was mended for those": (drawn_next_files.dialect_files,),
    "drawn after the code was frozen": (drawn_last_files.dialect_files,),
    "drawn when it was frozen again": (drawn_frozen_files.dialect_files,),
    "drawn when it was frozen a third time": (drawn_once_more_files.dialect_files,),
    "drawn when it was frozen a fourth time": (drawn_anew_files.dialect_files,),
    "drawn when it was frozen a fifth time": (drawn_fifth_files.dialect_files,),
    "strangers, frozen a sixth time": (
        drawn_sixth_files.dialect_files,
        drawn_sixth_sites.dialect_files,
    ),
    "strangers, frozen a seventh time": (drawn_seventh_files.dialect_files,),
    "strangers, frozen an eighth time": (drawn_eighth_files.dialect_files,),
}
_ANSWERS: Final = {
    "GEAR": GEAR,
    "TORQUE_CONSTANT": NM_PER_A,
    "POLE_PAIRS": POLE_PAIRS,
    "EFFICIENCY": 1.0,
    "RATED_TORQUE": 23.9,
}
_ASKED: Final = re.compile(r"# \[channels\.(?P<channel>\w+)\]")
_COMMENT: Final = re.compile(r"# (?=\[channels|topic = |field = |unit = |derive = )")


#: Those whose columns are not read, by the beginning of their names: a row a reading, and names
#: within the cells, single quotes, and commas that end a cell or do not.
_UNREAD: Final = ("WinCC", "Foxglove plot", "Arduino monitor", "SQL: single", "commas between")


def files_of_set(name: str) -> list[DialectFile]:
    """The files of a set of `SETS`, which take a third of a second to write."""
    return [file for write in SETS[name] for file in write()]


def readable_files_of_set(name: str) -> list[DialectFile]:
    """Those that are read."""
    return [file for file in files_of_set(name) if not file.name.startswith(_UNREAD)]


def every_file() -> list[DialectFile]:
    """All that are read."""
    return [file for name in SETS for file in readable_files_of_set(name)]


def answered(draft: str, file: DialectFile) -> str:
    """A draft completed as a person would: numbers for its capitals, units, missing channels.

    Args:
        draft: that `init` wrote.
        file: the table, with `units` and `channels` that only its owner knows.
    """
    lines: list[str] = []
    field = ""
    is_replaced = False
    for line in draft.splitlines():
        # what is asked for may be answered by a channel of one's own
        if match := _ASKED.match(line):
            is_replaced = match["channel"] in file.channels
        if is_replaced and line:
            continue
        is_replaced = False
        line = _COMMENT.sub("", line)
        if line.startswith("field = "):
            field = line.split('"')[1]
        if line == 'unit = "?"':
            line = file.units.get(field, line)
        elif line.startswith("field = ") and file.units.get(field, "") == "scale = -1":
            line = f"{line}\nscale = -1"
        for word, number in _ANSWERS.items():
            line = line.replace(word, f"{number:g}") if line.startswith("derive") else line
        if line.startswith("# wheel_radius_m"):
            line = f"wheel_radius_m = {RADIUS_M}"
        lines.append(line)
    text = "\n".join(lines) + "\n"
    for channel, content in file.channels.items():
        if f"[channels.{channel}]" not in text:
            text += f"\n[channels.{channel}]\n{content}\n"
    return text
