"""Declination: where magnetic north lies at the place and date of the flight."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.base import earth, rotation
from attlog.base.errors import UsageError
from attlog.flight.model import FlightLog
from attlog.reference.compare import interpolate
from attlog.reference.model import AlignmentStep, Reference

Array = NDArray[np.float64]


def place(log: FlightLog) -> tuple[float, float, float] | None:
    """Median latitude (deg), longitude (deg), altitude (m) of the first receiver with a 3D fix, None without one."""
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & np.isfinite(gnss.lat) & np.isfinite(gnss.lon)
        good &= (np.abs(gnss.lat) <= 90) & (np.abs(gnss.lon) <= 180) & ((gnss.lat != 0) | (gnss.lon != 0))
        if np.count_nonzero(good):
            altitude = gnss.alt[good]
            altitude = altitude[np.isfinite(altitude)]
            height = float(np.median(altitude)) if len(altitude) else 0.0
            return float(np.median(gnss.lat[good])), earth.middle_longitude(gnss.lon[good]), height
    return None


def model(log: FlightLog) -> earth.MagneticField | None:
    """The earth's field at the flight's place and date; None without a place."""
    where = place(log)
    if where is None:
        return None
    dated = earth.field(*where, log.utc_offset) if log.utc_offset is not None else None
    return dated or earth.field(*where, None)


def step(log: FlightLog, option: str | float) -> tuple[float | None, AlignmentStep]:
    """The declination in deg (None if unknown), and the step with both the model's and the parameter's in the text."""
    if option not in ("auto", "model", "param"):
        try:
            given = float(option)
        except ValueError:
            raise UsageError(f"declination {option!r}: use auto, model, param or degrees") from None
        return given, AlignmentStep(
            "declination", "given by the user", given, "deg", "option", option="config: declination"
        )
    field, set_deg = model(log), log.declination_param
    by_model = "no position, so no model" if field is None else f"{field.declination_deg:.1f} deg by {field.model}"
    by_param = (
        "no declination parameter that is set" if set_deg is None else f"{set_deg:.1f} deg by {log.declination_source}"
    )
    text = f"{by_model}; {by_param}"
    value, source = None, ""
    if field is not None and option != "param":
        value, source = field.declination_deg, field.model
    elif set_deg is not None and option != "model":
        value, source = set_deg, log.declination_source
    if value is not None:
        return value, AlignmentStep("declination", text, value, "deg", source, option="config: declination")
    text += "; unknown, so headings are magnetic and compared with their offset removed"
    return None, AlignmentStep("declination", text, None, "deg", "", False, "config: declination")


def measured_deg(log: FlightLog, reference: Reference) -> float | None:
    """Direction in deg in which the reference, turning the measured field to earth, sees magnetic north.

    The circular median over the log, outside unscored time. With truth as the
    reference it is the field's own declination plus the magnetometer's faults.
    None without magnetometer or reference.
    """
    if log.mag is None or len(reference.t) == 0:
        return None
    field = log.mags[log.mag].field
    q, _ = interpolate(reference.t, reference.q, reference.segment, field.t_best)
    good = rotation.finite(q) & rotation.finite(field.x)
    good &= (field.t_best >= reference.scoring_start) & (field.t_best <= reference.end)
    if np.count_nonzero(good) < 10:
        return None
    north = rotation.rotate(q[good], field.x[good])
    direction = np.arctan2(north[:, 1], north[:, 0])
    middle = math.atan2(float(np.mean(np.sin(direction))), float(np.mean(np.cos(direction))))
    return math.degrees(float(rotation.wrap(middle + np.median(rotation.wrap(direction - middle)))))
