"""What a bag lacks has to be recorded by another topic."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.flight.advice import What, stand_still


@dataclass(frozen=True, slots=True)
class BagLogging:
    """Messages of sensors in a bag."""

    def advice(self, what: What, rate: float | None = None) -> str:
        """What would record ``what``; see :class:`attlog.flight.advice.Logging`."""
        if what == "rest":
            return stand_still("Begin the bag before arming")
        if what == "mag":
            return "Record a topic of sensor_msgs/MagneticField."
        return "Record the IMU's topic (sensor_msgs/Imu) at its full rate."
