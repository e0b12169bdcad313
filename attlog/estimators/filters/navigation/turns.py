"""Turns one after the other: a chain of them, and what a causal user knows at each stamp. Two kernels.

An attitude of some time ago is carried on by the gyro with the bias that was known then. The gyro alone gives ``G``
from the first sample on, with the bias ``b0`` that was known at the start, and the integral of its columns; what
another bias ``b`` does to the turn from ``j`` to ``k`` is ``d = -(sum over i of (I_k - I_j)_i (b - b0)_i)``, so

    q_k = q_j  G_j^-1  exp(d)  G_k  exp((w_k - b) lag)

Both are looked up as far back as an aid may be late, so that much of them is kept, in a ring.
"""

from __future__ import annotations

import math
from typing import Any

from attlog.core import jit
from attlog.core.jit import F1, F2, I1, Out1, Out2
from attlog.estimators.filters.navigation.model import Motion

# Numbers kept of a sample: G (4), the integral of its columns (9).
RING = 13


def exponential(x: float, y: float, z: float, out: Any) -> None:
    """``out`` (4,): the quaternion of a rotation vector."""
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    s = 0.5 * math.sin(half) / half if half > 1e-9 else 0.5
    out[0], out[1], out[2], out[3] = math.cos(half), s * x, s * y, s * z


def times(a: Any, b: Any, out: Any) -> None:
    """``out`` = a b; it may be one of them."""
    w = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    x = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    y = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    z = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@jit.loop("the navigation filter, ahead")
def ahead(
    lag: float,
    then: I1,
    motion: Motion,
    q: F2,
    bias: F2,
    first_bias: F1,
    ring: Out2,
    out: Out2,
    G: Out1,
    total: Out1,
    step: Out1,
    now: Out1,
) -> None:
    """Write ``out`` (n, 4) at every sample, from the attitude ``q`` (n, 4) and ``bias`` (n, 3) of sample ``then`` (n,).

    ``lag`` s from samples to stamps, ``first_bias`` (3,); ``ring`` (r, 13) is longer than any look back. Scratch: ``G``
    (4,), ``total`` (9,), ``step``, ``now`` (4,).
    """
    dt, gyr, rest = motion.dt, motion.gyr, motion.rest
    G[0], G[1], G[2], G[3] = 1.0, 0.0, 0.0, 0.0
    for i in range(9):
        total[i] = 0.0
    size = len(ring)
    for k in range(len(dt)):
        h = 0.0 if rest[k] == 1 else dt[k]
        if k > 0:
            turned = h * (gyr[k, 0] - first_bias[0]), h * (gyr[k, 1] - first_bias[1]), h * (gyr[k, 2] - first_bias[2])
            exponential(turned[0], turned[1], turned[2], step)
            times(G, step, G)
        unit = 1.0 / math.sqrt(G[0] * G[0] + G[1] * G[1] + G[2] * G[2] + G[3] * G[3])
        w, x, y, z = unit * G[0], unit * G[1], unit * G[2], unit * G[3]
        total[0] += h * (1.0 - 2.0 * (y * y + z * z))
        total[1] += h * (2.0 * (x * y + w * z))
        total[2] += h * (2.0 * (x * z - w * y))
        total[3] += h * (2.0 * (x * y - w * z))
        total[4] += h * (1.0 - 2.0 * (x * x + z * z))
        total[5] += h * (2.0 * (y * z + w * x))
        total[6] += h * (2.0 * (x * z + w * y))
        total[7] += h * (2.0 * (y * z - w * x))
        total[8] += h * (1.0 - 2.0 * (x * x + y * y))
        own = k % size
        ring[own, 0], ring[own, 1], ring[own, 2], ring[own, 3] = w, x, y, z
        for i in range(9):
            ring[own, 4 + i] = total[i]
        j = then[k]
        old = j % size
        a, b, c = bias[j, 0] - first_bias[0], bias[j, 1] - first_bias[1], bias[j, 2] - first_bias[2]
        now[0], now[1], now[2], now[3] = ring[old, 0], -ring[old, 1], -ring[old, 2], -ring[old, 3]
        times(q[j], now, now)
        dx = (total[0] - ring[old, 4]) * a + (total[3] - ring[old, 7]) * b + (total[6] - ring[old, 10]) * c
        dy = (total[1] - ring[old, 5]) * a + (total[4] - ring[old, 8]) * b + (total[7] - ring[old, 11]) * c
        dz = (total[2] - ring[old, 6]) * a + (total[5] - ring[old, 9]) * b + (total[8] - ring[old, 12]) * c
        exponential(-dx, -dy, -dz, step)
        times(now, step, now)
        times(now, ring[own], now)
        if lag != 0.0:
            a, b, c = gyr[k, 0] - bias[j, 0], gyr[k, 1] - bias[j, 1], gyr[k, 2] - bias[j, 2]
            exponential(lag * a, lag * b, lag * c, step)
            times(now, step, now)
        unit = 1.0 / math.sqrt(now[0] * now[0] + now[1] * now[1] + now[2] * now[2] + now[3] * now[3])
        for i in range(4):
            out[k, i] = unit * now[i]


@jit.loop("the navigation filter, chain")
def chain(steps: F2, q: Out2) -> None:
    """``q`` (n, 4): the products of the turns ``steps`` (n, 4) up to each row, the first of them taken as none."""
    a, b, c, d = 1.0, 0.0, 0.0, 0.0
    for k in range(len(steps)):
        if k > 0:
            w, x, y, z = steps[k, 0], steps[k, 1], steps[k, 2], steps[k, 3]
            a, b, c, d = (
                a * w - b * x - c * y - d * z,
                a * x + b * w + c * z - d * y,
                a * y - b * z + c * w + d * x,
                a * z + b * y - c * x + d * w,
            )
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = a, b, c, d
