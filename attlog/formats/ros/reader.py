"""A bag as :class:`Messages`: PX4's topics by their uORB names, as in a ULog; others by their topics.

PX4's own messages (``px4_msgs``) have the fields of the topics that PX4 logs, so that whoever reads a ULog reads these.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import LogUnusable, UsageError
from attlog.formats.base import Messages, Remark, Table
from attlog.formats.ros import bag
from attlog.formats.ros.bag import BagChannel
from attlog.formats.ros.cdr import table

PX4 = "px4_msgs/msg/"
KNOWN = re.compile(
    r"sensor_msgs/msg/(Imu|MagneticField|NavSatFix)"
    r"|geometry_msgs/msg/(Pose|PoseWithCovariance|Transform|TwistWithCovariance|Twist)Stamped"
    r"|nav_msgs/msg/Odometry|mavros_msgs/msg/(State|ExtendedState)"
)
VERSION = re.compile(r"_v\d+$")
"""What PX4 writes behind the names of topics whose messages have changed."""
RECORDER = "log_time_ns"


def is_wanted(topic: str, kind: str) -> bool:
    """Whether a topic says something of a flight."""
    return kind.startswith(PX4) or bool(KNOWN.fullmatch(kind))


def read(path: Path | str, *, data: NDArray[np.uint8]) -> Messages:
    """The log as :class:`Messages`, format ``ros``; ``info["types"]`` are the types of all topics.

    LogUnusable where the bag holds nothing that is known, UsageError where a package is missing.
    """
    path = Path(path)
    found = bag.read(path, data, is_wanted)
    tables: dict[tuple[str, int], Table] = {}
    remarks: list[Remark] = []
    own, others = _of_one_vehicle(found.channels)
    if others:
        text = f"The bag holds {len(others) + 1} vehicles; this is {own or '/'}, not {', '.join(others)}."
        remarks.append(Remark("several_systems", text, count=len(others) + 1))
    for channel in found.channels:
        px4 = channel.type.startswith(PX4)
        if not channel.messages or (px4 and vehicle_of(channel.topic) != own):
            continue
        name = VERSION.sub("", channel.topic.rpartition("/")[2]) if px4 else channel.topic
        try:
            tables[name, 0] = table(name, types_of(path, channel), channel.type, channel.messages, channel.times_ns)
        except (ValueError, KeyError) as error:
            text = f"{channel.topic}: {len(channel.messages)} messages cannot be decoded ({error})."
            remarks.append(Remark("unreadable_message", text, count=len(channel.messages)))
            continue
        left = len(channel.messages) - len(tables[name, 0])
        if left:
            remarks.append(
                Remark("unreadable_message", f"{channel.topic}: left out {left} of other lengths.", count=left)
            )
    if not tables:
        what = ", ".join(sorted(set(found.types.values()))[:5]) or "no messages"
        raise LogUnusable(f"{path}: a bag without topics of PX4, IMU or pose ({what})")
    damage_bytes = sum(d.length for d in found.damage)
    messages = Messages(path, "ros", len(data), tables, info={"types": found.types}, damage=found.damage)
    messages.damage_bytes, messages.damage_places, messages.remarks = damage_bytes, len(found.damage), remarks
    return messages


def vehicle_of(topic: str) -> str:
    """The namespace of a vehicle: what stands before ``/fmu/``."""
    return topic.partition("/fmu/")[0]


def _of_one_vehicle(channels: list[BagChannel]) -> tuple[str, list[str]]:
    """The namespace with most messages of PX4, and the others."""
    count: Counter[str] = Counter()
    for channel in channels:
        if channel.type.startswith(PX4):
            count[vehicle_of(channel.topic)] += len(channel.messages)
    order = [name for name, _ in count.most_common()]
    return (order[0], order[1:]) if order else ("", [])


def types_of(path: Path, channel: BagChannel) -> dict[str, Any]:
    """The parsed definitions that a channel's type is made of. LogUnusable where the bag does not hold them."""
    try:
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    except ImportError:
        raise UsageError(f"{path}: {bag.NEEDS}") from None
    store = get_typestore(Stores.ROS2_JAZZY)
    known: dict[str, Any] = dict(store.fielddefs)
    if channel.definition and channel.encoding == "ros2idl":
        known |= get_types_from_idl(channel.definition)
    elif channel.definition:
        known |= get_types_from_msg(channel.definition, channel.type)
    if channel.type not in known:
        raise ValueError(f"the bag does not define {channel.type}; record it as MCAP")
    return known
