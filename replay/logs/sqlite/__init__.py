"""The SQLite storage of rosbag2 (`.db3`): pages are read directly, unusual ones by SQLite."""

from replay.logs.sqlite.db3_tail import Db3Tail
from replay.logs.sqlite.sqlite_file import Db3File, read_metadata_texts

__all__ = ["Db3File", "Db3Tail", "read_metadata_texts"]
