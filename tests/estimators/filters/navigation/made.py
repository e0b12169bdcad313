"""Flights whose truth is known in closed form: positions are sums of sines, sensors have declared faults."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from attlog.core import rotation
from attlog.estimators import Aids, Measurements
from attlog.estimators.filters.navigation.model import SUM, E, N, forward_rows, matrices, padded, square
from attlog.testing.motions import FIELD_T, Array, Motion, Noise, motion

PLACE = (47.0, 8.0, 500.0)
"""Latitude, longitude in deg and altitude in m of the origin."""
AMPLITUDE, RATE, PHASE = (12.0, 9.0, 3.0), (0.35, 0.45, 0.3), (0.0, 1.0, 2.0)


@dataclass(frozen=True)
class Made:
    """Truth and what is given to an estimator."""

    motion: Motion
    aids: Aids


def ramp(t: Array, still: float) -> Array:
    """0 at rest, then smoothly to 1 within 3 s."""
    u = np.clip((t - still) / 3.0, 0.0, 1.0)
    return u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)


def position(t: Array, still: float) -> Array:
    """Metres (n, 3) NED."""
    columns = [a * (np.sin(w * (t - still) + p) - np.sin(p)) for a, w, p in zip(AMPLITUDE, RATE, PHASE, strict=True)]
    return np.stack(columns, axis=-1) * ramp(t, still)[:, None]


def derivative(t: Array, still: float, order: int) -> Array:
    """Velocity (1) or acceleration (2) of :func:`position`, by central differences of a smooth closed form."""
    h = 1e-3
    if order == 1:
        return (position(t + h, still) - position(t - h, still)) / (2.0 * h)
    return (position(t + h, still) - 2.0 * position(t, still) + position(t - h, still)) / h**2


def flight(
    seconds: float = 90.0,
    still: float = 20.0,
    delay: float = 0.1,
    mag_delay: float = 0.0,
    gyro_bias: tuple[float, float, float] = (0.004, -0.003, 0.002),
    acc_bias: tuple[float, float, float] = (0.05, -0.08, 0.04),
    hard: tuple[float, float, float] = (0.4e-6, -0.6e-6, 0.5e-6),
    gyro: float = 4e-4,
    acc: float = 0.02,
    velocity: float = 0.08,
    metres: float = 0.5,
    seed: int = 0,
    rate: float = 100.0,
    reach: float = 1.0,
) -> Made:
    """Rest for ``still`` s, then a flight that leans, climbs and yaws. Densities, 1 sigma of GNSS, delays in s.

    ``reach`` scales how far it moves and leans: 0.01 is a hover that yaws.
    """

    def angles(t: Array) -> tuple[Array, Array, Array]:
        move = ramp(t, still)
        lean = reach * move
        return 0.3 * np.sin(0.8 * t) * lean, 0.25 * np.sin(0.6 * t + 1.0) * lean, 1.0 + 1.5 * np.sin(0.2 * t) * move

    # Twice the rate, then means over two intervals, as an autopilot logs them.
    noise = Noise(gyro=gyro, acc=acc, bias=gyro_bias)
    m = motion(
        angles, seconds, 2.0 * rate, acceleration=lambda t: reach * derivative(t, still, 2), noise=noise, seed=seed
    )
    even = np.arange(2, len(m.t), 2)
    gyr = np.vstack([m.gyr[:1], 0.5 * (m.gyr[even] + m.gyr[even - 1])])
    force = np.vstack([m.acc[:1], 0.25 * m.acc[even - 2] + 0.5 * m.acc[even - 1] + 0.25 * m.acc[even]])
    even = np.r_[0, even]
    field_at = motion(angles, seconds, 2.0 * rate, noise=Noise(mag=0.3e-6), seed=seed + 1)
    shift = round(2.0 * rate * mag_delay)
    mag = np.full((len(even), 3), np.nan)
    for k in range(0, len(even), max(int(rate / 20), 1)):
        mag[k] = field_at.mag[max(even[k] - shift, 0)] + np.array(hard)
    kept = Motion(m.t[even], m.q[even], gyr, force + np.array(acc_bias), mag)
    random = np.random.default_rng(seed + 2)
    fixes = np.arange(0.5, seconds - 0.2, 0.2)
    v = reach * derivative(fixes - delay, still, 1) + velocity * random.standard_normal((len(fixes), 3))
    p = reach * position(fixes - delay, still) + metres * random.standard_normal((len(fixes), 3))
    lat = PLACE[0] + np.degrees(p[:, 0] / 6_367_800.0)
    lon = PLACE[1] + np.degrees(p[:, 1] / (6_389_600.0 * np.cos(np.radians(PLACE[0]))))
    heights = np.arange(0.3, seconds - 0.1, 0.05)
    baro = -reach * position(heights, still)[:, 2] + 0.15 * random.standard_normal(len(heights)) + 30.0
    aids = Aids(
        position=Measurements(fixes, np.column_stack([lat, lon, PLACE[2] - p[:, 2]]), np.full((len(fixes), 2), metres)),
        velocity=Measurements(fixes, v, np.full(len(fixes), velocity)),
        baro=Measurements(heights, baro),
        at_rest=np.array([[0.0, still - 0.3]]) if still > 1.0 else np.zeros((0, 2)),
        field=np.array(FIELD_T),
    )
    return Made(kept, aids)


def without(aids: Aids, *names: str) -> Aids:
    """The aids without some of them."""
    nothing: dict[str, Any] = dict.fromkeys(names)
    return replace(aids, **nothing)


def off(q: Array, truth: Array) -> tuple[Array, Array]:
    """Tilt and heading errors (n,) in rad."""
    e = rotation.earth_error(q, truth)
    return rotation.tilt_angle(e), rotation.heading_angle(e)


# The transition of the smoother's states as a matrix, which its kernels never form.


def transition_matrix(sums: Any, rest: int, tau: float) -> Any:
    """The dense Phi (39, 39) over a node's ``sums``; ``tau`` s: how long the position error of GNSS wanders."""
    M, Phi = np.zeros((5, 3, 3)), padded(np.eye(N))
    matrices(sums, rest, M[0], M[1], M[2], M[3], M[4])
    forward_rows(Phi, sums[SUM.t], M, rest)
    dense = square(Phi)
    dense[E.wander : E.wander + 3] *= math.exp(-sums[SUM.t] / tau)
    return dense
