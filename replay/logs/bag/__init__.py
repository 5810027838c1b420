"""ROS 1 bags (version 2.0)."""

from replay.logs.bag.bag_file import BagFile

__all__ = ["BagFile"]
