"""The loops behind :mod:`attlog.segments.increments`: prefix sums of a gyro, and its rotation between two times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.kernels.loops import kernel_of
from attlog.kernels.search import before

Array = NDArray[np.float64]

SOURCES = ("segments/increments_loop.py", "kernels")
SUMMED_SIGNATURE = "void(f8[:, ::1], (f8[::1]), (f8[:, ::1]), i8)"
BETWEEN_SIGNATURE = "void(f8[:, ::1], (f8[::1]), (f8[:, ::1]), (f8[::1]), (f8[::1]))"


def summed_gyro(out: Array, t: Array, rate: Array, interval: int) -> None:
    """Fill ``out`` (n, 6) with sums of the angle increments of ``rate`` (n, 3) at ``t`` (n,) and of their coning term.

    Sample k acts since the one before, without ``interval`` its mean with that one.
    """
    ax, ay, az, cx, cy, cz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(t)):
        if i > 0:
            h = t[i] - t[i - 1]
            x, y, z = rate[i, 0], rate[i, 1], rate[i, 2]
            if interval == 0:
                x, y, z = 0.5 * (rate[i - 1, 0] + x), 0.5 * (rate[i - 1, 1] + y), 0.5 * (rate[i - 1, 2] + z)
            x, y, z = x * h, y * h, z * h
            cx, cy, cz = cx + ay * z - az * y, cy + az * x - ax * z, cz + ax * y - ay * x
            ax, ay, az = ax + x, ay + y, az + z
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4], out[i, 5] = ax, ay, az, cx, cy, cz


def sum_at(sums: Array, column: int, i: int, share: float) -> float:
    """A sum (n, 6) so far beyond sample i."""
    return float(sums[i, column] + share * (sums[i + 1, column] - sums[i, column]))


def gyro_between(out: Array, t: Array, sums: Array, start: Array, end: Array) -> None:
    """Fill ``out`` (m, 3) with rotation vectors from ``start`` (m,) to ``end`` (m,) by ``sums`` (n, 6) at ``t`` (n,).

    Linear between samples, two at least; outside the gyro stands still. Times that ascend are found by walking on.
    """
    i, j, last_but_one, first, last = 0, 0, len(t) - 2, t[0], t[len(t) - 1]
    for k in range(len(start)):
        a, b = start[k], end[k]
        a = first if a < first else last if a > last else a
        b = first if b < first else last if b > last else b
        i, j = before(t, a, i, last_but_one), before(t, b, j, last_but_one)
        p, r = (a - t[i]) / (t[i + 1] - t[i]), (b - t[j]) / (t[j + 1] - t[j])
        ax, ay, az = sum_at(sums, 0, i, p), sum_at(sums, 1, i, p), sum_at(sums, 2, i, p)
        x, y, z = sum_at(sums, 0, j, r) - ax, sum_at(sums, 1, j, r) - ay, sum_at(sums, 2, j, r) - az
        cx = sum_at(sums, 3, j, r) - sum_at(sums, 3, i, p) - (ay * z - az * y)
        cy = sum_at(sums, 4, j, r) - sum_at(sums, 4, i, p) - (az * x - ax * z)
        cz = sum_at(sums, 5, j, r) - sum_at(sums, 5, i, p) - (ax * y - ay * x)
        out[k, 0], out[k, 1], out[k, 2] = x + 0.5 * cx, y + 0.5 * cy, z + 0.5 * cz


SUMMED = kernel_of(summed_gyro, SUMMED_SIGNATURE, "segments", "the sums of a gyro", SOURCES)
BETWEEN = kernel_of(gyro_between, BETWEEN_SIGNATURE, "segments", "the rotation between two times", SOURCES)
