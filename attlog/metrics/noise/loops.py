"""The loops behind :mod:`attlog.metrics.noise.added`.

What is left of a row in windows, at rest and beside the gyro alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.kernels.loops import kernel_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Three = tuple[float, float, float]

DEG, TURN = math.degrees(1.0), 2.0 * math.pi
SOURCES = ("metrics/noise/loops.py", "kernels")
AT_REST_SIGNATURE = "void(f8[:, ::1], (f8[::1]), (f8[:, ::1]), (f8[:, ::1]), (f8[::1]), (i8[::1]))"
PUSHED_SIGNATURE = (
    "void(f8[:, ::1], (f8[::1]), (f8[:, ::1]), (f8[:, ::1]), (f8[:, ::1]), (f8[::1]), (i8[::1]), f8[:, ::1])"
)


def apart(q: Array, i: int, c: Array, k: int) -> tuple[float, float, float, float]:
    """The rotation ``q_i c_k*`` of unit quaternions (n, 4), (m, 4)."""
    w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
    e, f, g, h = c[k, 0], -c[k, 1], -c[k, 2], -c[k, 3]
    return (
        w * e - x * f - y * g - z * h,
        w * f + x * e + y * h - z * g,
        w * g - x * h + y * e + z * f,
        w * h + x * g - y * f + z * e,
    )


def vector(w: float, x: float, y: float, z: float) -> Three:
    """The rotation vector in rad of a unit quaternion."""
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0
    if w < 0.0:
        factor = -factor
    return factor * x, factor * y, factor * z


def left_at_rest(out: Array, t: Array, q: Array, centre: Array, yaw: Array, edges: Index) -> None:
    """Fill ``out`` (n, 3) with what attitudes ``q`` (n, 4) at ``t`` (n,) turn in deg away from their window's line.

    Window k has the samples ``edges[k]`` to ``edges[k + 1]``, ``centre[k]`` is their mean attitude, ``yaw[k]`` its
    heading. The rotation from the mean: about the level roll and pitch axis and the vertical, unwrapped.
    """
    for k in range(len(yaw)):
        a, b = edges[k], edges[k + 1]
        cosine, sine = DEG * math.cos(yaw[k]), DEG * math.sin(yaw[k])
        before, middle = 0.0, 0.0
        for i in range(a, b):
            w, x, y, z = apart(q, i, centre, k)
            heading = 2.0 * math.atan2(z, w)
            heading += TURN * np.floor((before - heading) / TURN + 0.5)  # the whole turns of the sample before
            before = heading
            x, y, _ = vector(w, x, y, z)
            out[i, 0], out[i, 1], out[i, 2] = x * cosine + y * sine, y * cosine - x * sine, DEG * heading
            middle += (t[i] - t[a]) / (b - a)
        for c in range(3):
            mean = 0.0
            for i in range(a, b):
                mean += out[i, c] / (b - a)
            along, size = 0.0, 0.0
            for i in range(a, b):
                u = t[i] - t[a] - middle
                along, size = along + u * (out[i, c] - mean), size + u * u
            for i in range(a, b):
                out[i, c] -= mean + along / size * (t[i] - t[a] - middle)


def turned_to_earth(q: Array, i: int, m: Array) -> None:
    """Fill ``m`` (9,) with the rotation matrix of an attitude, row by row."""
    w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
    m[0], m[1], m[2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    m[3], m[4], m[5] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    m[6], m[7], m[8] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


def integrated(out: Array, t: Array, q: Array, a: int, b: int, now: Array, before: Array) -> None:
    """Fill rows a to b of ``out`` (n, 9) with the integral of R(q) over time, trapezoid, centred."""
    for c in range(9):
        out[a, c] = 0.0
    turned_to_earth(q, a, before)
    for i in range(a + 1, b):
        turned_to_earth(q, i, now)
        for c in range(9):
            out[i, c] = out[i - 1, c] + 0.5 * (t[i] - t[i - 1]) * (now[c] + before[c])
            before[c] = now[c]
    for c in range(9):
        mean = 0.0
        for i in range(a, b):
            mean += out[i, c] / (b - a)
        for i in range(a, b):
            out[i, c] -= mean


def fitted(x: Array, turned: Array, a: int, b: int, g: Array, h: Array) -> None:
    """Take the least-squares fit of ``turned`` (n, 9) times a constant vector from rows a to b of ``x`` (n, 3)."""
    for r in range(3):
        for c in range(3):
            g[3 * r + c], h[c] = 0.0, 0.0
    for i in range(a, b):
        for r in range(3):
            for c in range(3):
                h[c] += turned[i, 3 * r + c] * x[i, r]
                for d in range(c, 3):
                    g[3 * c + d] += turned[i, 3 * r + c] * turned[i, 3 * r + d]
    a00, a01, a02 = g[4] * g[8] - g[5] * g[5], g[2] * g[5] - g[1] * g[8], g[1] * g[5] - g[2] * g[4]
    a11, a12, a22 = g[0] * g[8] - g[2] * g[2], g[1] * g[2] - g[0] * g[5], g[0] * g[4] - g[1] * g[1]
    size = g[0] * a00 + g[1] * a01 + g[2] * a02
    if size > 0.0:
        sx = (a00 * h[0] + a01 * h[1] + a02 * h[2]) / size
        sy = (a01 * h[0] + a11 * h[1] + a12 * h[2]) / size
        sz = (a02 * h[0] + a12 * h[1] + a22 * h[2]) / size
        for i in range(a, b):
            for r in range(3):
                x[i, r] -= turned[i, 3 * r] * sx + turned[i, 3 * r + 1] * sy + turned[i, 3 * r + 2] * sz


def left_of_pushed(
    out: Array,
    t: Array,
    q: Array,
    pushed: Array,
    centre: Array,
    yaw: Array,
    edges: Index,
    turned: Array,
    now: Array,
    before: Array,
    g: Array,
    h: Array,
) -> None:
    """Fill ``out`` (n, 3) with what is pushed into attitudes ``q`` (n, 4) at ``t`` (n,), in deg, without the fit.

    ``pushed`` (n, 4) is the rotation beside the gyro alone. Window k has the samples ``edges[k]`` to ``edges[k + 1]``,
    ``centre[k]`` is the mean of what is pushed, ``yaw[k]`` the heading of the mean attitude: about the level roll and
    pitch axis and the vertical. The fit: an offset, and R(q) integrated times a constant. ``turned`` (n, 9) is room.
    """
    for k in range(len(yaw)):
        a, b = edges[k], edges[k + 1]
        integrated(turned, t, q, a, b, now, before)
        mx, my, mz = 0.0, 0.0, 0.0
        for i in range(a, b):
            w, x, y, z = apart(pushed, i, centre, k)
            out[i, 0], out[i, 1], out[i, 2] = vector(w, x, y, z)
            mx, my, mz = mx + out[i, 0] / (b - a), my + out[i, 1] / (b - a), mz + out[i, 2] / (b - a)
        for i in range(a, b):
            out[i, 0], out[i, 1], out[i, 2] = out[i, 0] - mx, out[i, 1] - my, out[i, 2] - mz
        fitted(out, turned, a, b, g, h)
        cosine, sine = DEG * math.cos(yaw[k]), DEG * math.sin(yaw[k])
        for i in range(a, b):
            x, y = out[i, 0], out[i, 1]
            out[i, 0], out[i, 1], out[i, 2] = x * cosine + y * sine, y * cosine - x * sine, DEG * out[i, 2]


AT_REST = kernel_of(left_at_rest, AT_REST_SIGNATURE, "metrics", "the noise at rest", SOURCES)
PUSHED = kernel_of(
    left_of_pushed,
    PUSHED_SIGNATURE,
    "metrics",
    "the noise in flight",
    SOURCES,
    (("f8", (9,)), ("f8", (9,)), ("f8", (9,)), ("f8", (3,))),
)
