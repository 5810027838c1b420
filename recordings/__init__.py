from recordings.reader import read_frame, read_provenance, read_recording, stages
from recordings.writer import write_recording

__all__ = [
    "read_frame",
    "read_provenance",
    "read_recording",
    "stages",
    "write_recording",
]
