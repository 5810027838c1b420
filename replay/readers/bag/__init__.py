"""ROS 1 bags (version 2.0)."""

from replay.readers.bag.file import BagFile

__all__ = ["BagFile"]
