"""ROS 1 bags (version 2.0)."""

from replay.logs.bag.bag_file import BagFile
from replay.logs.bag.bag_tail import BagTail

__all__ = ["BagFile", "BagTail"]
