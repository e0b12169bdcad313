"""Turns one after the other: a chain of them, and what a causal user knows at each stamp. Two kernels.

An attitude of some time ago is carried on by the gyro with the bias that was known then. The gyro alone gives ``G``
from the first sample on, with the bias ``b0`` that was known at the start, and the integral of its columns; what
another bias ``b`` does to the turn from ``j`` to ``k`` is ``d = -(sum over i of (I_k - I_j)_i (b - b0)_i)``, so

    q_k = q_j  G_j^-1  exp(d)  G_k  exp((w_k - b) lag)

Both are looked up as far back as an aid may be late, so that much of them is kept, in a ring.
"""

from __future__ import annotations

import math

from attlog.core import jit
from attlog.core.jit import F1, F2, I1, Out1, Out2
from attlog.estimators.filters.navigation.model import Motion
from attlog.estimators.vectors import exponential, matrix, multiplied, quaternion

# Numbers kept of a sample: G (4), the integral of its columns (9).
RING = 13


@jit.loop("the navigation filter, ahead")
def ahead(
    lag: float, then: I1, motion: Motion, q: F2, bias: F2, first_bias: F1, ring: Out2, out: Out2, total: Out1
) -> None:
    """Write ``out`` (n, 4) at every sample, from the attitude ``q`` (n, 4) and ``bias`` (n, 3) of sample ``then`` (n,).

    ``lag`` s from samples to stamps, ``first_bias`` (3,); ``ring`` (r, 13) is longer than any look back; ``total`` (9,)
    is scratch.
    """
    dt, gyr, rest = motion.dt, motion.gyr, motion.rest
    g0, g1, g2, g3 = 1.0, 0.0, 0.0, 0.0
    for i in range(9):
        total[i] = 0.0
    size = len(ring)
    for k in range(len(dt)):
        h = 0.0 if rest[k] == 1 else dt[k]
        if k > 0:
            x, y, z = h * (gyr[k, 0] - first_bias[0]), h * (gyr[k, 1] - first_bias[1]), h * (gyr[k, 2] - first_bias[2])
            s0, s1, s2, s3 = exponential(x, y, z)
            g0, g1, g2, g3 = multiplied(g0, g1, g2, g3, s0, s1, s2, s3)
        unit = 1.0 / math.sqrt(g0 * g0 + g1 * g1 + g2 * g2 + g3 * g3)
        own, j = ring[k % size], then[k]
        own[0], own[1], own[2], own[3] = unit * g0, unit * g1, unit * g2, unit * g3
        R = matrix(own, 0)
        for i in range(9):
            total[i] += h * R[3 * (i % 3) + i // 3]
            own[4 + i] = total[i]
        old = ring[j % size]
        a, b, c = bias[j, 0] - first_bias[0], bias[j, 1] - first_bias[1], bias[j, 2] - first_bias[2]
        q0, q1, q2, q3 = quaternion(q[j], 0)
        n0, n1, n2, n3 = multiplied(q0, q1, q2, q3, old[0], -old[1], -old[2], -old[3])
        dx = (total[0] - old[4]) * a + (total[3] - old[7]) * b + (total[6] - old[10]) * c
        dy = (total[1] - old[5]) * a + (total[4] - old[8]) * b + (total[7] - old[11]) * c
        dz = (total[2] - old[6]) * a + (total[5] - old[9]) * b + (total[8] - old[12]) * c
        s0, s1, s2, s3 = exponential(-dx, -dy, -dz)
        n0, n1, n2, n3 = multiplied(n0, n1, n2, n3, s0, s1, s2, s3)
        n0, n1, n2, n3 = multiplied(n0, n1, n2, n3, own[0], own[1], own[2], own[3])
        if lag != 0.0:
            a, b, c = gyr[k, 0] - bias[j, 0], gyr[k, 1] - bias[j, 1], gyr[k, 2] - bias[j, 2]
            s0, s1, s2, s3 = exponential(lag * a, lag * b, lag * c)
            n0, n1, n2, n3 = multiplied(n0, n1, n2, n3, s0, s1, s2, s3)
        unit = 1.0 / math.sqrt(n0 * n0 + n1 * n1 + n2 * n2 + n3 * n3)
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = unit * n0, unit * n1, unit * n2, unit * n3


@jit.loop("the navigation filter, chain")
def chain(steps: F2, q: Out2) -> None:
    """Write the products of the turns ``steps`` (n, 4) up to each row to ``q`` (n, 4); the first is taken as none."""
    a, b, c, d = 1.0, 0.0, 0.0, 0.0
    for k in range(len(steps)):
        if k > 0:
            w, x, y, z = quaternion(steps[k], 0)
            a, b, c, d = multiplied(a, b, c, d, w, x, y, z)
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = a, b, c, d
