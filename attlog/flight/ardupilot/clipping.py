"""ArduPilot's counts of accelerometer samples at the end of their range: VIBE, at the sensor's full rate.

``Clip0`` to ``Clip2`` (3.4 to 4.0) count by unit in one record, ``Clip`` (4.1 on) in one record for each unit. Before
3.4 nothing tells, and the logged IMU at 25 Hz never reaches the limit.
"""

from __future__ import annotations

import numpy as np

from attlog.flight.ardupilot.clock import Clock
from attlog.flight.ardupilot.imus import units
from attlog.flight.builder import LogBuilder
from attlog.flight.model import Clipping


def clippings(builder: LogBuilder, clock: Clock) -> list[Clipping]:
    """New clipped samples of every unit over time."""
    found = []
    have = {imu for imu in units(builder.messages, "IMU")}
    for instance, table in units(builder.messages, "VIBE").items():
        if len(table) < 2:
            continue
        named = [(instance, "Clip")] if "Clip" in table else [(k, f"Clip{k}") for k in range(3)]
        for unit, column in named:
            if column in table and (column == "Clip" or unit in have):
                counter = table[column].astype(np.int64)
                new = np.maximum(np.diff(counter, prepend=counter[:1]), 0)
                source = f"VIBE:{unit}.Clip" if column == "Clip" else f"VIBE.{column}"
                found.append(Clipping("accelerometer", unit, source, builder.seconds(clock.of(table)), new, True))
    return found
