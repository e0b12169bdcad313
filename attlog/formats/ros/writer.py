"""Write recordings as MCAP bags with PX4's messages, as PX4's bridge to ROS 2 publishes them.

Types are made of the columns, so that a bag defines what it holds. They have PX4's names where topic and type differ.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import UsageError
from attlog.core.files import open_atomic
from attlog.core.own_files import SIMULATED_LOG, FileKind
from attlog.formats.recording import Columns, Recording, require_only
from attlog.formats.ros.bag import MISSING_PACKAGES
from attlog.formats.ros.cdr import NUMBER_TYPES

ROS_TYPES = {code: name for name, code in NUMBER_TYPES.items()} | {"b1": "bool"}
TYPE_OF_TOPIC = {
    "vehicle_gps_position": "SensorGps",
    "vehicle_attitude_groundtruth": "VehicleAttitude",
    "vehicle_local_position_groundtruth": "VehicleLocalPosition",
    "vehicle_mocap_odometry": "VehicleOdometry",
    "vehicle_visual_odometry": "VehicleOdometry",
}
TOPIC_PREFIX, FIELD_NAME = "/fmu/out/", re.compile(r"[a-z]\w*")
CLOCK_COLUMN = "timestamp"
# CDR, little endian.
CDR_HEADER = b"\x00\x01\x00\x00"
POSE_TYPE = "geometry_msgs/msg/PoseStamped"
FRAME_NAME = "map"
# Start of the recorder's clock, which knows the date.
RECORDER_START_NS = 1_700_000_000_000_000_000
# Delay of a message from the autopilot to the recorder.
RECORDER_DELAY_NS = 2_000_000
# Bytes per chunk.
CHUNK_BYTES = 1 << 20


def write_mcap(path: Path, recording: Recording, replaces: FileKind = SIMULATED_LOG) -> None:
    """Write an MCAP bag; messages are numbered in the order of their times.

    A message whose name begins with a slash is a pose with columns ``q`` (n, 4) and ``p`` (n, 3) in axes of its own,
    stamped by the recorder's clock. UsageError for what a bag cannot hold and where a package is missing.
    """
    try:
        from mcap.writer import CompressionType, Writer
    except ImportError:
        raise UsageError(MISSING_PACKAGES) from None  # whatever the file is called while it is written
    start_us = recording.checked(CLOCK_COLUMN)
    require_only("parameters", [p.name for p in recording.params], ())
    require_only("texts", [t.text for t in recording.texts], ())
    with open_atomic(path, replaces) as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="attlog")
        times: list[NDArray[np.int64]] = []
        payloads: list[list[bytes]] = []
        channels: list[int] = []
        for (name, instance), columns in recording.messages.items():
            if instance:
                continue  # PX4's bridge publishes the first instance of a topic
            kind, definition, rows = (
                _pose_messages(columns, start_us) if name.startswith("/") else _topic_messages(name, columns)
            )
            schema = writer.register_schema(kind, "ros2msg", definition.encode())
            topic = name if name.startswith("/") else TOPIC_PREFIX + name
            channels.append(writer.register_channel(topic, "cdr", schema))
            times.append(_recorder_times(np.asarray(columns[CLOCK_COLUMN]), start_us))
            payloads.append(rows)
        which = np.concatenate([np.full(len(t), k) for k, t in enumerate(times)])
        within = np.concatenate([np.arange(len(t)) for t in times])
        at = np.concatenate(times)
        for number, i in enumerate(np.argsort(at, kind="stable")):
            k, time = int(which[i]), int(at[i])
            writer.add_message(channels[k], time, payloads[k][within[i]], time, number)
        writer.finish()  # type: ignore[no-untyped-call]


def _recorder_times(t_us: NDArray[Any], start_us: int) -> NDArray[np.int64]:
    """Return when the recorder gets a message of the autopilot's time."""
    return np.asarray(RECORDER_START_NS + RECORDER_DELAY_NS + (t_us.astype(np.int64) - start_us) * 1000, np.int64)


def _topic_messages(name: str, columns: Columns) -> tuple[str, str, list[bytes]]:
    """Return type, definition and messages of a PX4 topic."""
    kind = TYPE_OF_TOPIC.get(name, "".join(part.capitalize() for part in name.split("_")))
    flat = {column: np.asarray(x) for column, x in columns.items()}
    for column, x in flat.items():
        if x.dtype.kind not in "buif" or not FIELD_NAME.fullmatch(column):
            raise UsageError(f"{name}.{column}: a bag is written of numbers, not of texts and nested messages")
    lines = []
    for column, x in flat.items():
        of = ROS_TYPES[x.dtype.newbyteorder("=").str[1:]]
        lines.append(f"{of}{f'[{x.shape[1]}]' if x.ndim == 2 else ''} {column}")
    return f"px4_msgs/msg/{kind}", "\n".join(lines), _encode_cdr(flat)


def _encode_cdr(columns: Columns) -> list[bytes]:
    """Return messages of columns (n,) or (n, k) in CDR. Each number is aligned to its size."""
    places, at = [], 0
    for x in columns.values():
        at += -at % x.dtype.itemsize
        places.append(at)
        at += x.dtype.itemsize * (x.shape[1] if x.ndim == 2 else 1)
    count = len(next(iter(columns.values())))
    rows = np.zeros((count, len(CDR_HEADER) + at), np.uint8)
    rows[:, : len(CDR_HEADER)] = np.frombuffer(CDR_HEADER, np.uint8)
    for place, x in zip(places, columns.values(), strict=True):
        raw = np.ascontiguousarray(x.astype(x.dtype.newbyteorder("<"))).view(np.uint8).reshape(count, -1)
        rows[:, len(CDR_HEADER) + place : len(CDR_HEADER) + place + raw.shape[1]] = raw
    return [row.tobytes() for row in rows]


def _pose_messages(columns: Columns, start_us: int) -> tuple[str, str, list[bytes]]:
    """Return type, definition and messages of a pose. Columns ``q``, scalar first, and ``p``."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    text, _ = store.generate_msgdef(POSE_TYPE, ros_version=2)
    stamp = np.asarray(columns[CLOCK_COLUMN]).astype(np.int64) * 1000 - start_us * 1000 + RECORDER_START_NS
    q, p = (np.asarray(columns[name], np.float64) for name in ("q", "p"))
    frame = np.frombuffer(FRAME_NAME.encode() + b"\0", np.uint8)
    flat: dict[str, NDArray[Any]] = {
        "sec": (stamp // 1_000_000_000).astype(np.int32),
        "nanosec": (stamp % 1_000_000_000).astype(np.uint32),
        "length": np.full(len(stamp), len(frame), np.uint32),
        "frame": np.tile(frame, (len(stamp), 1)),
        "position": p,
        "orientation": q[:, [1, 2, 3, 0]],
    }
    return POSE_TYPE, text, _encode_cdr(flat)
