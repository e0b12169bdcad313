"""Which parameters take an offset of an accelerometer out of its values?"""

from __future__ import annotations

import numpy as np

from attlog.flight.calibration import flown
from attlog.flight.calibration.correction import CalibrationUnknownError
from attlog.flight.model import Array, FlightLog, Imu
from attlog.health.settings.proposal import Proposal, proposed


def proposal(log: FlightLog, imu: Imu, bias: Array) -> Proposal:
    """What to set where the logged accelerometer reads ``bias`` (3,) m/s^2 too much, in body axes."""
    try:
        found = flown.accelerometer(log, imu)
        if moved := flown.order_changed(log, found):
            raise CalibrationUnknownError(f"{moved[0]} was set after take-off. Reboot and fly once.")
    except CalibrationUnknownError as why:
        return Proposal(refused=str(why))
    values = found.offset_values(found.correction.offset_without(np.asarray(bias, float)))
    return proposed(log, values, found.units, found.digits)
