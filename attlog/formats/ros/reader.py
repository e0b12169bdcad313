"""Read a ROS 2 bag as :class:`Messages`: PX4's topics under uORB names as in a ULog, others under topic names.

PX4's own messages (``px4_msgs``) have the fields of the topics that PX4 logs, so readers of a ULog read them too.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import counted
from attlog.core.errors import LogUnusable, UsageError
from attlog.formats.ros.bag import MISSING_PACKAGES, Bag, BagChannel, read_bag
from attlog.formats.ros.cdr import decode_table
from attlog.formats.table import Messages, Table

PX4_PACKAGE = "px4_msgs/msg/"
KNOWN_TYPES = re.compile(
    r"sensor_msgs/msg/(Imu|MagneticField|NavSatFix)"
    r"|geometry_msgs/msg/(Pose|PoseWithCovariance|Transform|TwistWithCovariance|Twist)Stamped"
    r"|nav_msgs/msg/Odometry|mavros_msgs/msg/(State|ExtendedState)"
)
# PX4's suffix of topics whose messages have changed.
VERSION_SUFFIX = re.compile(r"_v\d+$")
TRAILING_NUMBER = re.compile(r"\d+$")
# rosbag2's list of the files of a bag.
METADATA_NAME, MAX_METADATA_BYTES = "metadata.yaml", 1 << 20
BAG_FILES = re.compile(rb"^\s*-\s*\S+\.(?:mcap|db3)\S*\s*$", re.MULTILINE)


def is_wanted(topic: str, kind: str) -> bool:
    """Return whether a topic is read: PX4's topics and supported sensor messages."""
    return kind.startswith(PX4_PACKAGE) or bool(KNOWN_TYPES.fullmatch(kind))


def table_name(topic: str, kind: str) -> str:
    """Return the name of a topic's table."""
    return VERSION_SUFFIX.sub("", topic.rpartition("/")[2]) if kind.startswith(PX4_PACKAGE) else topic


def vehicle_namespace(topic: str) -> str:
    """Return the namespace of a PX4 vehicle: the part before ``/fmu/``."""
    return topic.partition("/fmu/")[0]


def system_number(vehicle: str) -> int:
    """Return the number that ``--system`` uses: the end of the namespace, 0 without."""
    number = TRAILING_NUMBER.search(vehicle)
    return int(number[0]) if number else 0


def read_ros(path: Path | str, system: int | None = None, *, data: NDArray[np.uint8]) -> Messages:
    """Return the log, format ``ros``; ``info["types"]`` are the types of all topics.

    ``system``: the vehicle whose namespace ends with this number, else the one with most messages. LogUnusable for a
    bag without known topics, UsageError for an unknown system and where a package is missing.
    """
    path = Path(path)
    bag = read_bag(path, data, is_wanted)
    _report_file(path, bag)
    own = _choose_vehicle(path, bag, system)
    tables: dict[tuple[str, int], Table] = {}
    for channel in bag.channels:
        px4 = channel.type.startswith(PX4_PACKAGE)
        name = table_name(channel.topic, channel.type)
        if channel.messages and (not px4 or vehicle_namespace(channel.topic) == own) and (name, 0) not in tables:
            table = _channel_table(path, name, channel, bag)
            if table is not None:
                tables[name, 0] = table
    if not tables:
        what = ", ".join(sorted(set(bag.types.values()))[:5]) or "no messages"
        reasons = [r.text for r in bag.losses.remarks if r.code == "unreadable_message"]
        reasons += [f"{damage.lost} at byte {damage.offset}" for damage in bag.losses.listed]
        why = f"; {reasons[0]}" if reasons else ""
        raise LogUnusable(f"{path}: a bag without readable topics of PX4, IMU or pose ({what}){why}")
    return Messages(path, "ros", len(data), tables, info={"types": bag.types}, losses=bag.losses)


def _report_file(path: Path, bag: Bag) -> None:
    """Report a bag without end, or one of several files."""
    if not bag.ended and not bag.losses.places:
        text = "The bag has no end: its recorder was interrupted, the last seconds lack."
        bag.losses.add_remark("cut_at_end", text)
    beside = path.with_name(METADATA_NAME)
    if beside.is_file() and beside.stat().st_size < MAX_METADATA_BYTES:
        files = len(BAG_FILES.findall(beside.read_bytes()))
        if files > 1:
            text = f"This is one of the {files} files of the bag; each is a log of its own."
            bag.losses.add_remark("split_bag", text, count=files)


def _choose_vehicle(path: Path, bag: Bag, system: int | None) -> str:
    """Return the namespace of the vehicle to read, and report others."""
    count: Counter[str] = Counter()
    for channel in bag.channels:
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
        bag.losses.add_remark("several_systems", text, count=len(order))
    return own


def _channel_table(path: Path, name: str, channel: BagChannel, bag: Bag) -> Table | None:
    """Return a channel's table, None where nothing can be decoded. Messages left out are reported."""
    count = len(channel.messages)
    table: Table | None = None
    reason = ""
    with bag.losses.around(channel.topic, "its messages", None):
        try:
            types = channel_types(path, channel)
            table = decode_table(name, types, channel.type, channel.messages, channel.times_ns)
        except KeyError:
            reason = " (a type of its fields is not defined)"
        except RecursionError:
            reason = " (its definition is nested too deeply)"
        except ValueError as error:
            reason = f" ({error})"
    left = count - (0 if table is None else len(table))
    if left:
        text = f"{channel.topic}: {left:,} of {counted(count, 'message')} cannot be decoded{reason}."
        bag.losses.add_remark("unreadable_message", text, count=left)
    return table


def channel_types(path: Path, channel: BagChannel) -> dict[str, Any]:
    """Return the parsed definitions of a channel's type.

    ValueError where the type is not defined or its definition cannot be parsed, UsageError where the package is
    missing.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    except ImportError:
        raise UsageError(f"{path}: {MISSING_PACKAGES}") from None
    known: dict[str, Any] = {}
    try:
        if channel.definition and channel.encoding == "ros2idl":
            known = dict(get_types_from_idl(channel.definition))
        elif channel.definition:
            known = dict(get_types_from_msg(channel.definition, channel.type))
    except Exception:  # whatever the library raises for a damaged definition
        raise ValueError("its definition cannot be read") from None
    known = {**get_typestore(Stores.ROS2_JAZZY).fielddefs, **known}
    if channel.type not in known:
        raise ValueError("the bag does not define its type; record it as MCAP")
    return known
