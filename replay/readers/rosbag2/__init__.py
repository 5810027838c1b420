"""rosbag2 directories: storage files and metadata.yaml."""

from replay.readers.rosbag2.directory import Rosbag2Directory, storage_files
from replay.readers.rosbag2.metadata import METADATA

__all__ = ["METADATA", "Rosbag2Directory", "storage_files"]
