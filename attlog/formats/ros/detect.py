"""Does a file begin as a bag of ROS 2?"""

from __future__ import annotations

MCAP = b"\x89MCAP0\r\n"
SQLITE = b"SQLite format 3\0"
"""rosbag2's older storage."""
COLUMN = b"serialization_format"
"""A column of rosbag2's table of topics; its definition stands on the first page. Other databases lack it."""


def is_bag(head: bytes) -> bool:
    """Whether these first bytes are those of an MCAP file or of rosbag2's database."""
    return head.startswith(MCAP) or (head.startswith(SQLITE) and COLUMN in head)
