"""Names in a recording: timelines, entities of frames, components of columns."""

from typing import Final

TIME: Final = "time"
SINCE_START: Final = "t"
ROW: Final = "row"
COMPONENT_PREFIX: Final = "payscope:"
#: Component of the text of a state: Rerun's own name, since another is added to the lane's title.
STATE: Final = "StateChange:state"


def split_frame_name_to_path(frame_name: str) -> tuple[str, ...]:
    """Split a frame's name into the parts of its entity path; a topic is one part with slashes."""
    family, _, rest = frame_name.partition("/")
    return (family, rest) if family == "raw" else tuple(frame_name.split("/"))


def make_component_name(column_name: str) -> str:
    """Make the name of the component with a column."""
    return column_name if column_name == STATE else COMPONENT_PREFIX + column_name
