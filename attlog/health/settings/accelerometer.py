"""Which parameters take a bias off an accelerometer?"""

from __future__ import annotations

from attlog.flight.model import Array, FlightLog, Imu
from attlog.health.settings.proposal import Proposal


def proposal(log: FlightLog, imu: Imu, bias: Array) -> Proposal:
    """Offsets of ``imu`` without ``bias`` (3,) m/s^2 in body axes, which is what it reads too much."""
    return Proposal(refused="The parameters of this accelerometer are not known.")
