"""The boot clock of telemetry is the autopilot's, whatever else speaks under the vehicle's number."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from attlog.formats.base import Messages
from attlog.formats.mavlink.clock import timeline


class Told(SimpleNamespace):
    """A table of one clock message."""

    def __getitem__(self, column: str) -> np.ndarray:
        return np.asarray(self.columns[column])


def test_a_camera_that_booted_later_does_not_turn_the_vehicles_clock_back() -> None:
    """Component 1 is the autopilot, 154 a gimbal with the same system number; another vehicle has number 2."""
    senders = {(1, 1): ([10, 30], [70_000, 71_000]), (1, 154): ([20, 40], [500, 1_500]), (2, 1): ([5, 35], [9, 10])}
    tables: Any = {}
    for (system, component), (offsets, boot_ms) in senders.items():
        instance = system << 8 | component
        tables["ATTITUDE", instance] = Told(
            instance=instance, offsets=np.array(offsets), columns={"time_boot_ms": np.array(boot_ms, np.uint32)}
        )
    messages = Messages(Path("x.tlog"), "tlog", 100, tables)
    messages.info["systems"] = {1: {"component": 1}, 2: {}}
    at, time = timeline(messages, 1)
    assert (at.tolist(), time.tolist()) == ([10, 30], [70_000_000, 71_000_000])
