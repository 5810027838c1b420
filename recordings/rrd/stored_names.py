"""Names in a recording: timelines, entities of frames, components of columns."""

from typing import Final

TIME: Final = "time"
SINCE_START: Final = "t"
ROW: Final = "row"
COMPONENT_PREFIX: Final = "payscope:"
#: The text of a lane of states: Rerun's own name, or the viewer adds ours to the lane's title.
STATE: Final = "StateChange:state"


def split_frame_name_to_path(frame_name: str) -> tuple[str, ...]:
    """Parts of a frame's entity path; a topic is one part, including its slashes."""
    family, _, rest = frame_name.partition("/")
    return (family, rest) if family == "raw" else tuple(frame_name.split("/"))


def make_component_name(column_name: str) -> str:
    """Component that holds a column."""
    return column_name if column_name == STATE else COMPONENT_PREFIX + column_name
