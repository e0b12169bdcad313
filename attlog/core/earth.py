"""Gravity, magnetic field and rotation of the earth at a place.

Gravity is the closed form of the WGS 84 ellipsoid. The magnetic field is the World Magnetic Model of the log's own
epoch, computed by ``pygeomag``: a newer model extrapolated back is off by up to 1.5 deg in declination, the right
epoch by 0.6.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import median

TESLA_PER_GAUSS, TESLA_PER_MILLIGAUSS, GAUSS_PER_TESLA = 1e-4, 1e-7, 1e4
# WGS 84.
ROTATION_RATE_RAD_S = 7.292115e-5
# From WMM-2010 to the end of WMM-2025's life span.
FIRST_YEAR, LAST_YEAR = 2010, 2030
# For logs without a date: declination changes by 0.13 deg a year (rms over the earth).
UNKNOWN_DATE_YEAR = 2025.0


class MagneticField(NamedTuple):
    """The earth's field at a place; ``model`` names model and date."""

    declination_deg: float
    inclination_deg: float
    strength_t: float
    model: str

    @property
    def ned_t(self) -> tuple[float, float, float]:
        """The field vector in T, north-east-down."""
        dip, declination = math.radians(self.inclination_deg), math.radians(self.declination_deg)
        level = self.strength_t * math.cos(dip)
        return level * math.cos(declination), level * math.sin(declination), self.strength_t * math.sin(dip)


def gravity(lat_deg: float, alt_m: float = 0.0) -> float:
    """Return normal gravity in m/s^2 at a geodetic latitude and ellipsoidal height.

    Somigliana's closed form and the second-order height term: NIMA TR8350.2 (2000), equations 4-1 and 4-3.
    """
    a, flattening, m = 6378137.0, 1 / 298.257223563, 0.00344978650684
    sin2 = math.sin(math.radians(lat_deg)) ** 2
    surface = 9.7803253359 * (1 + 0.00193185265241 * sin2) / math.sqrt(1 - 0.00669437999013 * sin2)
    return surface * (1 - 2 / a * (1 + flattening + m - 2 * flattening * sin2) * alt_m + 3 * (alt_m / a) ** 2)


def middle_longitude(lon_deg: NDArray[np.float64]) -> float:
    """Return the median of longitudes (n,) in deg, also over the date line."""
    if float(lon_deg.max()) - float(lon_deg.min()) <= 180.0:
        return float(median(lon_deg))
    return (float(median(lon_deg % 360.0)) + 180.0) % 360.0 - 180.0


def heading_turn(lat_deg: float) -> float:
    """Return the heading rate in deg/min of a perfect gyro at rest.

    The gyro senses the earth's rotation, whose down component is ``-Omega sin(lat)``. The integrated heading falls on
    the northern hemisphere by up to 0.25 deg/min.
    """
    return -math.degrees(ROTATION_RATE_RAD_S) * 60.0 * math.sin(math.radians(lat_deg))


@lru_cache(maxsize=64)  # several checks ask for the same place and day; each call reads the model's file
def field(lat: float, lon: float, alt_m: float, unix_time: float | None) -> MagneticField | None:
    """Return the field at a place and Unix time, None if unknown.

    Place in deg, deg, m. None outside 2010 to 2030 and for an invalid place. Without a time the first day of the newest
    model is used, and ``model`` reports it.
    """
    if not (math.isfinite(lat) and math.isfinite(lon) and abs(lat) <= 90 and abs(lon) <= 180):
        return None
    year = UNKNOWN_DATE_YEAR if unix_time is None else decimal_year(unix_time)
    if year is None or not FIRST_YEAR <= year < LAST_YEAR:
        return None
    from pygeomag import GeoMag

    model = GeoMag(base_year=int(year))
    altitude_km = alt_m / 1000.0 if math.isfinite(alt_m) else 0.0
    result = model.calculate(glat=lat, glon=lon, alt=altitude_km, time=year)
    when = "date unknown" if unix_time is None else f"{year:.2f}"
    return MagneticField(float(result.d), float(result.i), float(result.f) * 1e-9, f"{model.model} ({when})")


def decimal_year(unix_time: float) -> float | None:
    """Return a date as decimal year, None for an invalid time."""
    try:
        date = datetime.fromtimestamp(unix_time, UTC)
        start = datetime(date.year, 1, 1, tzinfo=UTC)
        end = datetime(date.year + 1, 1, 1, tzinfo=UTC)
    except (OverflowError, OSError, ValueError):
        return None
    return date.year + (date - start) / (end - start)
