"""Earth, air and wind at a scenario's place, and its random numbers.

Each random quantity has its own generator, spawned from the flight's seed by a key of names: another sensor, or more
numbers from one, changes nothing in another. Turbulence has Dryden's spectra (MIL-F-8785C) of one length and size for
all axes, as it passes at the mean wind's speed V, T = L / V: along the mean wind 1 / (1 + T s), across and down (1 +
sqrt(3) T s) / (1 + T s)^2, driven by white noise and scaled to the declared standard deviation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth, jit
from attlog.core.errors import UsageError
from attlog.core.jit import F2, Out2
from attlog.simulate.scenario import Scenario, Wind


def generator(seed: int, *key: str | int) -> np.random.Generator:
    """Return the random generator of ``("imu", 0, "gyro")`` and the like in the flight ``seed``."""
    numbers = tuple(k if isinstance(k, int) else int.from_bytes(k.encode(), "big") for k in key)
    words = tuple(w for n in numbers for w in (n.bit_length(), *_words(n)))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=words))


def _words(number: int) -> list[int]:
    """Return a number as 32-bit words, the lowest first."""
    return [(number >> shift) & 0xFFFFFFFF for shift in range(0, max(number.bit_length(), 1), 32)]


Array = NDArray[np.float64]
A_M, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)
# The standard atmosphere below 11 km (ISO 2533).
SEA_PRESSURE_PA, SEA_KELVIN, LAPSE_K_PER_M, PRESSURE_EXPONENT = 101325.0, 288.15, 0.0065, 5.255877


@dataclass(frozen=True, slots=True)
class Environment:
    """Gravity m/s^2, field (3,) T (earth axes), declination rad, air density kg/m^3 at the take-off place."""

    gravity: float
    field_t: tuple[float, float, float]
    declination: float
    density: float


def environment(scenario: Scenario) -> Environment:
    """Return the environment of a scenario's place and date. UsageError for a date without a magnetic model."""
    place = scenario.place
    field = earth.field(place.lat_deg, place.lon_deg, place.alt_m, place.unix_time)
    if field is None:
        raise UsageError(
            f"place.date: no magnetic model covers {place.date:%Y-%m-%d}; "
            f"take {earth.FIRST_YEAR} to {earth.LAST_YEAR - 1}"
        )
    kelvin = SEA_KELVIN - LAPSE_K_PER_M * place.alt_m
    return Environment(
        gravity=earth.gravity(place.lat_deg, place.alt_m),
        field_t=field.ned_t,
        declination=math.radians(field.declination_deg),
        density=float(pressure(np.array(place.alt_m))) / (287.05287 * kelvin),
    )


def field_at(scenario: Scenario, home: Environment, p: Array) -> Array:
    """Return the field (n, 3) T in earth axes at places ``p`` (n, 3) m, anomalies included."""
    field = np.tile(np.array(home.field_t), (len(p), 1))
    for iron in scenario.anomaly:
        far2 = np.sum((p - np.array(iron.ned_m)) ** 2, axis=1)
        field += np.exp(-0.5 * far2 / iron.radius_m**2)[:, None] * np.array(iron.field_ned_ut) * 1e-6
    return field


def pressure(height: Array) -> Array:
    """Return the pressure (n,) [Pa] at heights above the sea (n,) [m] in the standard atmosphere."""
    return SEA_PRESSURE_PA * (1.0 - LAPSE_K_PER_M * height / SEA_KELVIN) ** PRESSURE_EXPONENT


def height_of(pressure_pa: Array) -> Array:
    """Return heights above the sea (n,) [m] of pressures (n,) [Pa] in the standard atmosphere."""
    return SEA_KELVIN / LAPSE_K_PER_M * (1.0 - (pressure_pa / SEA_PRESSURE_PA) ** (1.0 / PRESSURE_EXPONENT))


def geodetic(scenario: Scenario, ned: Array) -> tuple[Array, Array, Array]:
    """Return latitude, longitude [deg] and height [m] of points (n, 3) m NED of the take-off place.

    By way of earth-centred coordinates on the WGS 84 ellipsoid; back by Bowring's formula, exact to a nanometre
    near the surface.
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


# Short grass, and the height from which on the declared wind blows.
ROUGHNESS_M, FULL_AT_M = 0.05, 6.0


def wind_at(wind: Wind, t: Array, seed: int) -> Array:
    """Return the velocity of the air (n, 3) m/s, earth axes, at equidistant times ``t`` (n,) s."""
    air = np.tile(np.array(wind.mean_ned_m_s), (len(t), 1))
    for gust in wind.gust:
        u = np.clip((t - gust.t) / gust.seconds, 0.0, 1.0)
        air += 0.5 * (1.0 - np.cos(2.0 * np.pi * u))[:, None] * np.array(gust.ned_m_s)
    if wind.turbulence_m_s > 0 and len(t) > 1:
        north, east = wind.mean_ned_m_s[:2]
        stays = math.exp(-(t[1] - t[0]) * max(math.hypot(north, east), wind.speed_m_s) / wind.length_m)
        noise = generator(seed, "wind", 0, "turbulence").standard_normal((len(t), 3))
        along, across, down = wind.turbulence_m_s * _dryden(noise, stays).T
        course = math.atan2(east, north)
        air[:, 0] += math.cos(course) * along - math.sin(course) * across
        air[:, 1] += math.sin(course) * along + math.cos(course) * across
        air[:, 2] += down
    return air


def share_at(height_m: float) -> float:
    """Return the share of the declared wind at a height [m]: logarithmic profile below 6 m."""
    if height_m >= FULL_AT_M:
        return 1.0
    return math.log(max(height_m, ROUGHNESS_M) / ROUGHNESS_M) / math.log(FULL_AT_M / ROUGHNESS_M)


def _dryden(noise: Array, stays: float) -> Array:
    """Return turbulence (n, 3) of standard deviation 1 from white noise (n, 3); ``stays``: remainder after a step."""
    out = np.zeros_like(noise)
    filtered(np.ascontiguousarray(noise), stays, out)
    return out


@jit.loop("wind")
def filtered(noise: F2, stays: float, out: Out2) -> None:
    """Filter noise to first order x of variance 1 in column 0, to its second-order relative in the others.

    With x' = (noise - x) / T and z' = (x - z) / T the transverse form is (sqrt(3) x + (1 - sqrt(3)) z) / sqrt(2).
    """
    root3 = math.sqrt(3.0)
    drive = math.sqrt(1.0 - stays * stays)
    for c in range(3):
        x = noise[0, c]
        z = 0.5 * x
        for k in range(len(noise)):
            if k > 0:
                fresh = stays * x + drive * noise[k, c]
                z = stays * z + (1.0 - stays) * 0.5 * (x + fresh)
                x = fresh
            out[k, c] = x if c == 0 else (root3 * x + (1.0 - root3) * z) / math.sqrt(2.0)
