"""Was the autopilot told the right declination?"""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.flight.model import FlightLog
from attlog.flight.parameters.history import looks_up_declination
from attlog.health.model import Check, graded
from attlog.reference import declination

NAME = "declination set"
LIMIT = "ok within 4 deg of the model, fault above 15 deg"


def checks(log: FlightLog) -> list[Check]:
    """The parameter against the world magnetic model; nothing where it is not set or not used, or no place is known."""
    told, model = log.declination_param, declination.model(log)
    if told is None or model is None or looks_up_declination(log):
        return []
    off = abs(float(np.degrees(rotation.wrap(np.radians(told - model.declination_deg)))))
    text = f"{log.declination_source} says {told:.1f} deg; the model says {model.declination_deg:.1f} deg."
    return [Check(NAME, graded(off, 4.0, 15.0), text, round(told, 2), "deg", LIMIT)]
