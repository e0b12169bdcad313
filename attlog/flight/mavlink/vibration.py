"""VIBRATION: how much the vehicle shakes, and how many accelerometer samples were at the end of their range.

``clipping_0`` to ``clipping_2`` count by unit at the sensor's full rate. The levels are ArduPilot's measure in m/s^2;
PX4's are of another kind.
"""

from __future__ import annotations

import numpy as np

from attlog.flight import physics
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.mavlink.clock import PacketClock
from attlog.flight.model import Clipping, Stream
from attlog.flight.vibration.model import OnboardVibration

UNITS = 3


def clippings(builder: LogBuilder, clock: PacketClock, instance: int) -> list[Clipping]:
    """New clipped samples of every unit over time; a counter that falls began anew."""
    table = builder.messages.tables.get(("VIBRATION", instance))
    if table is None or len(table) < 2:
        return []
    t, found = builder.seconds(clock.of(table)), []
    for unit in range(UNITS):
        counter = table[f"clipping_{unit}"].astype(np.int64)
        new = np.maximum(np.diff(counter, prepend=counter[:1]), 0)
        found.append(Clipping("accelerometer", unit, f"VIBRATION.clipping_{unit}", t, new, True))
    return found


def level(builder: LogBuilder, clock: PacketClock, instance: int) -> Stream | None:
    """ArduPilot's own level (n, 3) in m/s^2."""
    table = builder.messages.tables.get(("VIBRATION", instance))
    if table is None:
        return None
    x = columns(table, "vibration_x", "vibration_y", "vibration_z")
    return builder.stream(clock.of(table), x, "m/s^2", "VIBRATION", frame="FRD", within=physics.VIBRATION)


def levels(level_: Stream | None) -> list[OnboardVibration]:
    """The same of the worst axis; the message tells of the primary unit, here 0."""
    return [] if level_ is None else [OnboardVibration(0, "rest", level_.source, level_.t, level_.x.max(axis=1))]
