"""What a bag holds, however it is stored: channels with their messages as bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from attlog.formats.base import Damage

WANTED = Callable[[str, str], bool]
"""Whether a channel, by topic and type, is kept."""
NEEDS = 'a ROS 2 bag needs mcap and rosbags: pip install mcap rosbags, or pip install ".[ros]" in the source folder'


@dataclass(slots=True)
class BagChannel:
    """One topic: its ``type`` as ``pkg/msg/Name``, the ``definition`` in ``encoding`` (ros2msg, ros2idl, or empty), the
    messages as bytes and when the recorder got them, ns."""

    topic: str
    type: str
    definition: str = ""
    encoding: str = ""
    messages: list[bytes] = field(default_factory=list)
    times_ns: list[int] = field(default_factory=list)


@dataclass(slots=True)
class Bag:
    """The channels that were wanted, the topics and types of all, what is broken, and whether the recorder ended it."""

    channels: list[BagChannel]
    types: dict[str, str]
    damage: list[Damage] = field(default_factory=list)
    ended: bool = True
