"""MCAP: bags of ROS 2 in their default storage, one file."""

from __future__ import annotations

from pathlib import Path

from clsim.events.formats.filesink import FlushPolicy
from clsim.events.outputs import Encoding
from clsim.events.ros.bags import LIMITS, BagSink, open_bag_source

__all__ = ["LIMITS", "open_sink", "open_source"]


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy, ros_events: Encoding = "mono") -> BagSink:
    """Open a bag; ``flush`` tells how many events, or how much time of theirs, one message holds."""
    return BagSink(path, width, height, flush, "mcap", ros_events)


open_source = open_bag_source
