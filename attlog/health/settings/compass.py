"""Which parameters take an offset of a compass, or the motors' field in it, out of its values?

The parameters are those of the device, whichever slot holds it; what the firmware did to the logged values, and so the
signs, stands in ``flight/calibration``.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from attlog.flight.calibration import flown
from attlog.flight.calibration.correction import CalibrationUnknownError
from attlog.flight.model import Array, FlightLog, Mag
from attlog.health.settings.proposal import Proposal, proposed


def proposal(
    log: FlightLog,
    mag: Mag,
    offset_t: Array,
    motor_t: Array | None = None,
    power: Literal["current", "throttle"] = "current",
) -> Proposal:
    """What to set where the logged field reads ``offset_t`` (3,) too much, and ``motor_t`` (3,) times the power.

    Both in tesla and body axes (forward, right, down), ``motor_t`` per ampere, or per unit of throttle (0 to 1).
    Offsets and motor values are set together: each is right only with the other.
    """
    try:
        found = flown.compass(log, mag)
        if moved := flown.order_changed(log, found):
            raise CalibrationUnknownError(f"{moved[0]} was set after take-off. Reboot and fly once.")
        error = np.asarray(offset_t, float) - flown.learnt_bias(log, mag, found)
        values, units = found.offset_values(found.correction.offset_without(error)), found.units
        if motor_t is not None:
            typed = flown.motor_type(log, mag, power)
            kind = flown.compass(log, mag, {**flown.values(log), **typed})
            values |= kind.motor_values(found.correction.motor - np.asarray(motor_t, float)) | typed
            units = kind.units
    except CalibrationUnknownError as why:
        return Proposal(refused=str(why))
    return proposed(log, values, units, found.digits)
