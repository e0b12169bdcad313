"""What does the onboard estimator ask of GNSS before it uses it?"""

from __future__ import annotations

from dataclasses import dataclass

from attlog.flight.model import FlightLog


@dataclass(frozen=True, slots=True)
class GnssNeeds:
    """At least so many ``satellites``, at most this dilution, accuracies of ``speed`` m/s and ``place`` m."""

    satellites: float
    hdop: float
    speed: float
    place: float
    source: str


PX4 = GnssNeeds(6, 2.5, 0.5, 3.0, "EKF2_REQ_NSATS, EKF2_REQ_PDOP, EKF2_REQ_SACC, EKF2_REQ_EPH of PX4")
OTHERS = GnssNeeds(6, 2.5, 1.0, 5.0, "calcGpsGoodToAlign of ArduPilot's EKF3")


def of_gnss(log: FlightLog) -> GnssNeeds:
    """The defaults of the firmware that flew."""
    return PX4 if log.firmware.name == "PX4" else OTHERS
