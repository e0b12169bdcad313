"""The wind of a flight: mean, single gusts, turbulence.

Turbulence has Dryden's spectra (MIL-F-8785C) of one length and size for all axes, as it passes at the mean wind's
speed V, T = L / V: along the mean wind 1 / (1 + T s), across and down (1 + sqrt(3) T s) / (1 + T s)^2, driven by
white noise and scaled to the declared standard deviation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.physics.kernel import function_of, kernel_of
from attlog.simulate.physics.streams import generator
from attlog.simulate.scenario.place import Wind

Array = NDArray[np.float64]
ROUGHNESS_M, FULL_AT_M = 0.05, 6.0
"""Short grass, and the height from which on the declared wind blows."""


def wind_at(wind: Wind, t: Array, seed: int) -> Array:
    """Velocity of the air (n, 3) m/s, earth axes, at equidistant times ``t`` (n,) s."""
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
    """The share (0 to 1) of the declared wind at a height [m] above the ground: logarithmic profile below 6 m."""
    if height_m >= FULL_AT_M:
        return 1.0
    return math.log(max(height_m, ROUGHNESS_M) / ROUGHNESS_M) / math.log(FULL_AT_M / ROUGHNESS_M)


def _dryden(noise: Array, stays: float) -> Array:
    """Turbulence (n, 3) of standard deviation 1 from white noise (n, 3); ``stays``: what is left after one step."""
    out = np.zeros_like(noise)
    function_of(KERNEL, filtered)(np.ascontiguousarray(noise), stays, out)
    return out


def filtered(noise: Any, stays: float, out: Any) -> None:
    """First-order noise x of variance 1 in column 0; in the others its second-order relative of variance 1.

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


KERNEL = kernel_of(filtered, "void(f8[:, ::1], f8, f8[:, ::1])", "wind")
