"""The boot clock of a vehicle in telemetry: which messages tell it."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from attlog.formats.base import Messages, Table
from attlog.formats.clock import Timeline, in_file_order

CLOCK_MESSAGES = ("ATTITUDE", "ATTITUDE_QUATERNION", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "SYSTEM_TIME")
"""Messages whose ``time_boot_ms`` is the autopilot's clock at the moment of sending; they show restarts."""


def of_system(messages: Messages, name: str, system: int) -> list[Table]:
    """A message's tables from all components of one system."""
    return [messages[name, i] for i in messages.instances(name) if i >> 8 == system]


def timeline(messages: Messages, system: int) -> Timeline:
    """Offset and boot time (us) of the clock messages of a system's autopilot, in file order."""
    component = messages.info["systems"].get(system, {}).get("component")
    found = []
    for table in (t for name in CLOCK_MESSAGES for t in of_system(messages, name, system)):
        if component is None or table.instance & 0xFF == component:
            with suppress(KeyError):  # a column that could not be decoded is told among the remarks
                found.append((table.offsets, table["time_boot_ms"].astype(np.int64) * 1000))
    at, time = in_file_order(found)
    told = time > 0  # SYSTEM_TIME of a ground station that answers under the vehicle's id is zero
    return at[told], time[told]
