"""Bags made by the official writers: mcap_ros2 for MCAP, rosbags for SQLite. None of our code writes here."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

reading = pytest.importorskip("mcap.reader")
writing = pytest.importorskip("mcap.writer")
decoder = pytest.importorskip("mcap_ros2.decoder")
encoder = pytest.importorskip("mcap_ros2.writer")
rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

SENSOR_COMBINED = """uint64 timestamp
int32 RELATIVE_TIMESTAMP_INVALID = 2147483647
float32[3] gyro_rad
uint32 gyro_integral_dt
int32 accelerometer_timestamp_relative
float32[3] accelerometer_m_s2
uint32 accelerometer_integral_dt
uint8 accelerometer_clipping
"""
COMBINED = "px4_msgs/msg/SensorCombined"
IMU, FIELD = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField"
START_NS = 1_750_000_000_000_000_000
Message = tuple[str, str, int, dict[str, Any]]
"""Topic, type, ns after the start, values."""


def combined(n: int = 40, topic: str = "/fmu/out/sensor_combined", seed: int = 1) -> list[Message]:
    """Messages of PX4's sensors at 250 Hz."""
    rng = np.random.default_rng(seed)
    gyro, acc = rng.normal(size=(n, 3)).astype("f4"), rng.normal(size=(n, 3)).astype("f4") - np.float32([0, 0, 9.8])
    return [
        (
            topic,
            COMBINED,
            4_000_000 * i,
            {
                "timestamp": 5_000_000 + 4000 * i,
                "gyro_rad": gyro[i].tolist(),
                "gyro_integral_dt": 4000,
                "accelerometer_timestamp_relative": -i,
                "accelerometer_m_s2": acc[i].tolist(),
                "accelerometer_integral_dt": 4000,
                "accelerometer_clipping": i % 3,
            },
        )
        for i in range(n)
    ]


def xyz(values: Sequence[float], names: str = "xyz") -> dict[str, float]:
    """A vector or quaternion as a message."""
    return dict(zip(names, map(float, values), strict=True))


def header(ns: int, frame: str) -> dict[str, Any]:
    """A header; ``ns`` after the start."""
    seconds, rest = divmod(START_NS + ns, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def definition(kind: str) -> str:
    """The definition of a type that ROS 2 brings, or of PX4's."""
    if kind == COMBINED:
        return SENSOR_COMBINED
    return typesys.get_typestore(typesys.Stores.ROS2_JAZZY).generate_msgdef(kind, ros_version=2)[0]


def write_mcap(path: Path, messages: Sequence[Message], packed: str = "ZSTD", chunk: int = 1 << 20) -> None:
    """A bag as ros2 bag records it."""
    with path.open("wb") as file:
        writer = encoder.Writer(file, chunk_size=chunk, compression=writing.CompressionType[packed])
        schemas = {kind: writer.register_msgdef(kind, definition(kind)) for kind in {m[1]: None for m in messages}}
        for topic, kind, ns, values in messages:
            writer.write_message(topic, schemas[kind], values, START_NS + ns, START_NS + ns)
        writer.finish()


def write_sqlite(folder: Path, messages: Sequence[Message]) -> Path:
    """The same as a folder of rosbag2 with a SQLite database, whose path is given back."""
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    store.register(typesys.get_types_from_msg(SENSOR_COMBINED, COMBINED))
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, ns, values in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            whole = {
                name: np.asarray(value, "f4") if isinstance(value, list) else value for name, value in values.items()
            }
            message = store.types[kind](**whole)
            writer.write(connections[topic], START_NS + ns, store.serialize_cdr(message, kind))
    return next(folder.glob("*.db3"))


def decoded(path: Path) -> list[Any]:
    """The messages of an MCAP bag as the official decoder reads them."""
    with path.open("rb") as file:
        reader = reading.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        return [message for _, _, _, message in reader.iter_decoded_messages()]
