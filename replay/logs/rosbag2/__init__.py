"""rosbag2 directories: storage files and metadata.yaml."""

from replay.logs.rosbag2.rosbag2_directory import Rosbag2Directory, storage_files
from replay.logs.rosbag2.rosbag2_metadata import METADATA

__all__ = ["METADATA", "Rosbag2Directory", "storage_files"]
