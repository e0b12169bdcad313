"""What a telemetry log lacks is usually in the vehicle's own log."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.flight.advice import What, stand_still

KINDS = {"PX4": ".ulg", "ArduPilot": ".bin"}


@dataclass(frozen=True, slots=True)
class TelemetryLogging:
    """Telemetry of an autopilot."""

    firmware: str

    def advice(self, what: What, rate: float | None = None) -> str:
        """What would log ``what``; see :class:`attlog.flight.advice.Logging`."""
        if what == "rest":
            return stand_still("Record telemetry before arming")
        if what == "mag":
            return "Connect and calibrate a compass."
        kind = KINDS.get(self.firmware, ".bin or .ulg")
        return f"Take the log from the vehicle's SD card ({kind}) instead of telemetry."
