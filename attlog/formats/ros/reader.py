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

from attlog.core.errors import LogUnusable, UsageError
from attlog.formats.ros import bag
from attlog.formats.ros.bag import MISSING_PACKAGES, Bag, BagChannel
from attlog.formats.ros.cdr import decode_table
from attlog.formats.table import Messages, ReaderBarrier, Remark, Table

PX4_PACKAGE = "px4_msgs/msg/"
KNOWN_TYPES = re.compile(
    r"sensor_msgs/msg/(Imu|MagneticField|NavSatFix)"
    r"|geometry_msgs/msg/(Pose|PoseWithCovariance|Transform|TwistWithCovariance|Twist)Stamped"
    r"|nav_msgs/msg/Odometry|mavros_msgs/msg/(State|ExtendedState)"
)
# What PX4 writes behind the names of topics whose messages have changed.
VERSION_SUFFIX = re.compile(r"_v\d+$")
TRAILING_NUMBER = re.compile(r"\d+$")
METADATA_NAME, MAX_METADATA_BYTES = "metadata.yaml", 1 << 20
# The files of a bag in what rosbag2 writes beside them.
BAG_FILES = re.compile(rb"^\s*-\s*\S+\.(?:mcap|db3)\S*\s*$", re.MULTILINE)


def is_wanted(topic: str, kind: str) -> bool:
    """Whether a topic says something of a flight."""
    return kind.startswith(PX4_PACKAGE) or bool(KNOWN_TYPES.fullmatch(kind))


def table_name(topic: str, kind: str) -> str:
    """The name of a topic's table."""
    return VERSION_SUFFIX.sub("", topic.rpartition("/")[2]) if kind.startswith(PX4_PACKAGE) else topic


def vehicle_namespace(topic: str) -> str:
    """The namespace of a vehicle with PX4: what stands before ``/fmu/``."""
    return topic.partition("/fmu/")[0]


def system_number(vehicle: str) -> int:
    """What ``--system`` calls a vehicle: the number at the end of its namespace, 0 without."""
    number = TRAILING_NUMBER.search(vehicle)
    return int(number[0]) if number else 0


def read_ros(path: Path | str, system: int | None = None, *, data: NDArray[np.uint8]) -> Messages:
    """The log as :class:`Messages`, format ``ros``; ``info["types"]`` are the types of all topics.

    ``system``: the vehicle whose namespace ends with this number, else the one with most messages. LogUnusable where
    the bag holds nothing that is known, UsageError for a system that it does not hold and where a package is missing.
    """
    path = Path(path)
    found = bag.read_bag(path, data, is_wanted)
    remarks = _file_remarks(path, found)
    own = _choose_vehicle(path, found, system, remarks)
    tables: dict[tuple[str, int], Table] = {}
    for channel in found.channels:
        px4 = channel.type.startswith(PX4_PACKAGE)
        name = table_name(channel.topic, channel.type)
        if channel.messages and (not px4 or vehicle_namespace(channel.topic) == own) and (name, 0) not in tables:
            made = _channel_table(path, name, channel, remarks)
            if made is not None:
                tables[name, 0] = made
    if not tables:
        what = ", ".join(sorted(set(found.types.values()))[:5]) or "no messages"
        why = next((f"; {r.text}" for r in remarks if r.code == "unreadable_message"), "")
        raise LogUnusable(f"{path}: a bag without readable topics of PX4, IMU or pose ({what}){why}")
    messages = Messages(path, "ros", len(data), tables, info={"types": found.types}, damage=found.damage)
    messages.damage_bytes = sum(d.length for d in found.damage)
    messages.damage_places, messages.remarks = len(found.damage), remarks
    return messages


def _file_remarks(path: Path, found: Bag) -> list[Remark]:
    """What is to be said of the file: it has no end, or is one of several."""
    remarks = []
    if not found.ended and not found.damage:
        remarks.append(Remark("cut_at_end", "The bag has no end: its recorder was interrupted, the last seconds lack."))
    beside = path.with_name(METADATA_NAME)
    if beside.is_file() and beside.stat().st_size < MAX_METADATA_BYTES:
        files = len(BAG_FILES.findall(beside.read_bytes()))
        if files > 1:
            text = f"This is one of the {files} files of the bag; each is a log of its own."
            remarks.append(Remark("split_bag", text, count=files))
    return remarks


def _choose_vehicle(path: Path, found: Bag, system: int | None, remarks: list[Remark]) -> str:
    """The namespace of the vehicle that is read; ``remarks`` gets a word if there are others."""
    count: Counter[str] = Counter()
    for channel in found.channels:
        if channel.type.startswith(PX4_PACKAGE):
            count[vehicle_namespace(channel.topic)] += len(channel.messages)
    order = [name for name, _ in count.most_common()]
    chosen = [name for name in order if system is None or system_number(name) == system]
    if order and not chosen:
        held = ", ".join(f"{system_number(name)} ({name or '/'})" for name in order)
        raise UsageError(f"{path}: there is no system {system}; the bag holds {held}")
    own = chosen[0] if chosen else ""
    if len(order) > 1:
        others = ", ".join(str(system_number(name)) for name in order if name != own)
        text = f"The bag holds {len(order)} vehicles; this is {own or '/'}. --system chooses another ({others})."
        remarks.append(Remark("several_systems", text, count=len(order)))
    return own


def _channel_table(path: Path, name: str, channel: BagChannel, remarks: list[Remark]) -> Table | None:
    """The messages of a channel, None where none can be decoded; what is left out goes to ``remarks``."""
    count = len(channel.messages)
    made: Table | None = None
    reason = ""
    with ReaderBarrier(remarks).around(channel.topic, "its messages", None):
        try:
            types = channel_types(path, channel)
            made = decode_table(name, types, channel.type, channel.messages, channel.times_ns)
        except (ValueError, KeyError, RecursionError) as error:
            reason = str(error)
    left = count - (0 if made is None else len(made))
    if left:
        text = f"{channel.topic}: {left} of {count} messages cannot be decoded{f' ({reason})' if reason else ''}."
        remarks.append(Remark("unreadable_message", text, count=left))
    return made


def channel_types(path: Path, channel: BagChannel) -> dict[str, Any]:
    """The parsed definitions that a channel's type is made of. ValueError where nobody defines it or it is no text of
    definitions, UsageError where the package is missing."""
    try:
        from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
    except ImportError:
        raise UsageError(f"{path}: {MISSING_PACKAGES}") from None
    known: dict[str, Any] = {}
    try:
        if channel.definition and channel.encoding == "ros2idl":
            known = dict(get_types_from_idl(channel.definition))
        elif channel.definition:
            known = dict(get_types_from_msg(channel.definition, channel.type))
    except TypesysError as error:
        raise ValueError(f"its definition cannot be read: {str(error)[:100]}") from None
    known = {**get_typestore(Stores.ROS2_JAZZY).fielddefs, **known}
    if channel.type not in known:
        raise ValueError("the bag does not define its type; record it as MCAP")
    return known
