"""Which gyro bias does PX4's own estimator take off the gyro that is replayed?

``estimator_sensor_bias.gyro_bias`` (since 1.11): rad/s in body axes, to be subtracted
from the calibrated gyro. Before, ``estimator_status.states[10..12]`` holds an angle per
step of the filter; the length of that step is not logged, so no rate follows from it.
"""

from __future__ import annotations

import numpy as np

from attlog.flight import physics
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.inertial import longest_held
from attlog.flight.model import Imu, Stream
from attlog.flight.px4.imus import stamps
from attlog.formats.base import Table

TOPIC = "estimator_sensor_bias"


def gyro_bias(builder: LogBuilder, imu: Imu | None) -> Stream | None:
    """Gyro bias (n, 3) in rad/s FRD to subtract from ``imu.gyro``; None where the log does not tell.

    It is that of the instance selected longest, or of another one on the replayed gyro.
    ``vehicle_angular_velocity`` has the estimator's bias taken off already, and a gyro
    without its calibration is not the one that the estimator corrects: None.
    """
    messages = builder.messages
    found = {i: messages[TOPIC, i] for i in messages.instances(TOPIC) if "gyro_bias" in messages[TOPIC, i]}
    if imu is None or not imu.calibrated or imu.gyro.source.startswith("vehicle_angular_velocity"):
        return None
    first = selected(builder)
    for i in sorted(found, key=lambda i: (i != first, i)):
        if on_same_gyro(found[i], imu):
            table = found[i]
            return builder.stream(
                stamps(table),
                columns(table, "gyro_bias"),
                "rad/s",
                f"{TOPIC}:{i}",
                frame="FRD",
                within=physics.GYRO_BIAS,
            )
    return None


def selected(builder: LogBuilder) -> int:
    """The estimator instance that flew longest, 0 where there is no selector."""
    table = builder.messages.tables.get(("estimator_selector_status", 0))
    if table is None or "primary_instance" not in table:
        return 0
    return longest_held(stamps(table), table["primary_instance"].astype(np.int64).tolist()) or 0


def on_same_gyro(table: Table, imu: Imu) -> bool:
    """Whether an instance runs on the replayed gyro, as far as both tell their device."""
    if imu.device in (None, "", "0") or "gyro_device_id" not in table:
        return True
    ids = table["gyro_device_id"]
    return not ids.any() or str(int(np.median(ids[ids > 0]))) == imu.device
