"""What a result offers to set, as the file of its ground station."""

from __future__ import annotations

from attlog.health.assessments import offered
from attlog.health.settings.file import param_file
from attlog.result.model import Result

VEHICLE = "MAV_SYS_ID"
"""PX4's own MAVLink id, which QGroundControl compares with the vehicle it is connected to."""


def parameter_file(result: Result) -> str:
    """The text of the ``.param`` file, empty where there is nothing to set."""
    firmware = str((result.log.get("firmware") or {}).get("name") or "")
    vehicle = (result.log.get("params") or {}).get(VEHICLE) or 1
    return param_file(firmware, str(result.log.get("name") or "log"), offered(result.health), int(vehicle))
