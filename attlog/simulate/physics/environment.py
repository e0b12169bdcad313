"""The earth at the scenario's place: gravity, magnetic field with its anomalies, air, geodetic position."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import earth
from attlog.base.errors import UsageError
from attlog.simulate.scenario.scenario import Scenario

Array = NDArray[np.float64]
A_M, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)
SEA_PRESSURE_PA, SEA_KELVIN, LAPSE, EXPONENT = 101325.0, 288.15, 0.0065, 5.255877
"""The standard atmosphere below 11 km (ISO 2533)."""


@dataclass(frozen=True, slots=True)
class Environment:
    """``gravity`` m/s^2, ``field_t`` (3,) T in earth axes and ``declination`` rad at the take-off place;
    ``density`` kg/m^3."""

    gravity: float
    field_t: tuple[float, float, float]
    declination: float
    density: float


def environment(scenario: Scenario) -> Environment:
    """The earth at the place and date of a scenario. UsageError for a date that no magnetic model covers."""
    place = scenario.place
    field = earth.field(place.lat_deg, place.lon_deg, place.alt_m, place.unix_time)
    if field is None:
        raise UsageError(
            f"place.date: no magnetic model covers {place.date:%Y-%m-%d}; "
            f"take {earth.FIRST_YEAR} to {earth.LAST_YEAR - 1}"
        )
    kelvin = SEA_KELVIN - LAPSE * place.alt_m
    return Environment(
        gravity=earth.gravity(place.lat_deg, place.alt_m),
        field_t=field.ned_t,
        declination=math.radians(field.declination_deg),
        density=float(pressure(np.array(place.alt_m))) / (287.05287 * kelvin),
    )


def field_at(scenario: Scenario, home: Environment, p: Array) -> Array:
    """The field (n, 3) T in earth axes at places ``p`` (n, 3) m from the take-off place, anomalies included."""
    field = np.tile(np.array(home.field_t), (len(p), 1))
    for iron in scenario.anomaly:
        far2 = np.sum((p - np.array(iron.ned_m)) ** 2, axis=1)
        field += np.exp(-0.5 * far2 / iron.radius_m**2)[:, None] * np.array(iron.field_ned_ut) * 1e-6
    return field


def pressure(height: Array) -> Array:
    """Pressure (n,) [Pa] at heights above the sea (n,) [m] in the standard atmosphere."""
    return SEA_PRESSURE_PA * (1.0 - LAPSE * height / SEA_KELVIN) ** EXPONENT


def height_of(pressure_pa: Array) -> Array:
    """Height above the sea (n,) [m] of pressures (n,) [Pa] in the standard atmosphere."""
    return SEA_KELVIN / LAPSE * (1.0 - (pressure_pa / SEA_PRESSURE_PA) ** (1.0 / EXPONENT))


def geodetic(scenario: Scenario, ned: Array) -> tuple[Array, Array, Array]:
    """Latitude, longitude [deg] and height [m], each (n,), of points (n, 3) m north-east-down of the take-off
    place.

    By way of earth-centred coordinates on the WGS 84 ellipsoid; back by Bowring's formula, which is exact to a
    nanometre near the surface.
    """
    lat, lon = math.radians(scenario.place.lat_deg), math.radians(scenario.place.lon_deg)
    sl, cl, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    normal = A_M / math.sqrt(1 - E2 * sl * sl)
    alt = scenario.place.alt_m
    home = np.array([(normal + alt) * cl * co, (normal + alt) * cl * so, (normal * (1 - E2) + alt) * sl])
    axes = np.array([[-sl * co, -sl * so, cl], [-so, co, 0.0], [-cl * co, -cl * so, -sl]])
    x, y, z = (home + ned @ axes).T
    level = np.hypot(x, y)
    b = A_M * (1 - F)
    beta = np.arctan2(A_M * z, b * level)
    phi = np.arctan2(z + E2 / (1 - E2) * b * np.sin(beta) ** 3, level - E2 * A_M * np.cos(beta) ** 3)
    curve = A_M / np.sqrt(1 - E2 * np.sin(phi) ** 2)
    height = level * np.cos(phi) + (z + E2 * curve * np.sin(phi)) * np.sin(phi) - curve
    return np.degrees(phi), np.degrees(np.arctan2(y, x)), height
