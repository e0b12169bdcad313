"""Does a file begin as a bag of ROS 2?"""

from __future__ import annotations

MCAP = b"\x89MCAP0\r\n"
SQLITE = b"SQLite format 3\0"
"""rosbag2's older storage; whether its tables are those of a bag shows when it is read."""


def is_bag(head: bytes) -> bool:
    """Whether these first bytes are those of an MCAP file or of a SQLite database."""
    return head.startswith((MCAP, SQLITE))
