"""rosbag2 directories: storage files and metadata.yaml."""

from replay.logs.rosbag2.rosbag2_directory import Rosbag2Directory, list_storage_files
from replay.logs.rosbag2.rosbag2_metadata import METADATA, parse_custom_data

__all__ = ["METADATA", "Rosbag2Directory", "list_storage_files", "parse_custom_data"]
