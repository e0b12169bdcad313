"""Which PX4 counts of samples at the end of a sensor's range mean what they say, by field and version.

``vehicle_imu_status`` counts every sample of every unit (1.11 on; the gyro's from 1.14), from any number on.
``sensor_combined.accelerometer_clipping`` (1.11 on) is a mask of three bits for the selected unit alone.
``sensor_combined.gyro_clipping`` and ``vehicle_imu.delta_angle_clipping`` are unset memory in 1.13 beta and in 10 of 11
logs of 1.14: they count from 1.15 on, where no value is above the mask, and where a counter of ``vehicle_imu_status``
moved or the gyro was near its range.
``sensor_accel.clip_counter`` holds 1 where the others hold thousands, and is not read.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.flight.builder import LogBuilder
from attlog.flight.clock.timing import stamps_of
from attlog.flight.model import Clipping, Problem
from attlog.formats.base import Table

SOUND_FROM = 1 << 24 | 15 << 16
"""The first ``ver_sw_release`` whose gyro masks are set."""
MASK = 7
NEAR_RANGE_RAD_S = 0.8 * np.radians(2000.0)
"""Of the usual range, 2,000 deg/s: slower turns clip nothing."""


def clippings(builder: LogBuilder) -> list[Clipping]:
    """New clipped samples over time: the counters of every unit, then the masks of the selected one."""
    found = []
    for unit in builder.messages.instances("vehicle_imu_status"):
        table = builder.messages["vehicle_imu_status", unit]
        for sensor, column in (("accelerometer", "accel_clipping"), ("gyro", "gyro_clipping")):
            if column in table and len(table) > 1:
                counter = table[column].astype(np.int64).reshape(len(table), -1)
                new = np.maximum(np.diff(counter, axis=0, prepend=counter[:1]), 0).sum(axis=1)
                found.append(_clipping(builder, table, sensor, unit, new, True, column))
    table_of_one = builder.messages.tables.get(("sensor_combined", 0))
    column = "accelerometer_clipping"
    if table_of_one is not None and column in table_of_one and len(table_of_one):
        new = (table_of_one[column] > 0).astype(np.int64)
        found.append(_clipping(builder, table_of_one, "accelerometer", None, new, False, column))
    return found


def _clipping(
    builder: LogBuilder, table: Table, sensor: str, unit: int | None, new: NDArray[np.int64], whole: bool, column: str
) -> Clipping:
    source = f"{table.name}:{table.instance}.{column}" if whole else f"{table.name}.{column}"
    return Clipping(sensor, unit, source, builder.seconds(stamps_of(table, "timestamp")), new, whole)


def gyro_mask_problem(
    builder: LogBuilder, source: str, table: Table, column: str, rate: NDArray[np.float64]
) -> list[Problem]:
    """What the masks say of the gyro at the end of its range, a problem or none; ``rate`` (n, 3) rad/s beside them."""
    release: Any = builder.messages.info.get("ver_sw_release")
    if column not in table or not isinstance(release, (int, np.integer)) or int(release) < SOUND_FROM:
        return []
    mask = table[column].astype(np.int64)
    if not mask.any() or mask.max() > MASK:
        return []
    counted = any(c.sensor == "gyro" and c.whole and c.new.any() for c in clippings(builder))
    if not counted and not np.nanmax(np.abs(rate), initial=0.0) > NEAR_RANGE_RAD_S:
        return []
    count = int(np.count_nonzero(mask))
    text = f"{source}: the gyro was at the end of its range in {count} samples ({column})."
    cause = "A blow, vibration, or a range that is set too small."
    return [Problem("gyro_clipped", "warning", text, count=count, cause=cause)]
