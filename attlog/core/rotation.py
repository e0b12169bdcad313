"""Quaternions, Euler angles and attitude errors on whole arrays.

Conventions everywhere in attlog: scalar first, Hamilton product, ``q`` rotates body (FRD) vectors into earth (NED),
Euler angles are roll, pitch, yaw in the order z-y-x. Arrays are (..., 4) and (..., 3); all functions broadcast. Angles
come from ``atan2`` of the vector part, never from ``acos`` of the scalar part, whose rounding is 0.06 deg in float32.
Long arrays are worked through in blocks, and short rows summed column by column, because numpy is several times slower
otherwise.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any, ParamSpec, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import jit
from attlog.core.jit import F1, F2, I1, IOut1, Out2, last_before

Array = NDArray[np.float64]
P = ParamSpec("P")

# Rows per pass: intermediate arrays stay in the processor's cache.
BLOCK_ROWS = 4096
# Half turns between east-north-up and north-east-down, and between forward-left-up and forward-right-down.
ENU, FLU = np.array([0.0, 0.5**0.5, 0.5**0.5, 0.0]), np.array([0.0, 1.0, 0.0, 0.0])


def _by_blocks(*shape: int) -> Callable[[Callable[P, Array]], Callable[P, Array]]:
    """Decorate a function of rows to work in blocks of rows."""

    def of(function: Callable[P, Array]) -> Callable[P, Array]:
        @functools.wraps(function)
        def blocked(*args: P.args, **named: P.kwargs) -> Array:
            given: tuple[Any, ...] = args
            n = max([len(x) for x in given if isinstance(x, np.ndarray) and x.ndim == 2], default=0)
            if n <= BLOCK_ROWS or named or any(np.ndim(x) > 2 or (np.ndim(x) == 2 and len(x) != n) for x in given):
                return function(*args, **named)
            out, rows = np.empty((n, *shape)), cast(Callable[..., Array], function)
            for a in range(0, n, BLOCK_ROWS):
                out[a : a + BLOCK_ROWS] = rows(*(x[a : a + BLOCK_ROWS] if np.ndim(x) == 2 else x for x in given))
            return out

        return blocked

    return of


@_by_blocks(4)
def normalize(q: ArrayLike) -> Array:
    """Return unit quaternions (n, 4) or (4,); NaN for zero or infinite length."""
    q = np.asarray(q, np.float64)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        norm = np.asarray(length(q))
        return np.asarray(q / np.where((norm > 0) & (norm < np.inf), norm, np.nan)[..., None])


def finite_rows(x: Array) -> NDArray[np.bool_]:
    """Select the rows (n,) of finite numbers in (n, k).

    Mostly all are, and then their sum is finite. A product of the array with itself would go to several threads, which
    wait for each other on a busy machine.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        if np.isfinite(x.sum()):
            return np.ones(len(x), bool)
        return np.isfinite(x @ np.ones(x.shape[-1]))


def length(x: Array) -> Array:
    """Return the lengths (n,) of vectors (n, k)."""
    square = x[..., 0] * x[..., 0]
    for k in range(1, x.shape[-1]):
        square = square + x[..., k] * x[..., k]
    return np.asarray(np.sqrt(square))


def conjugate(q: ArrayLike) -> Array:
    """Return the inverse rotations of unit quaternions (n, 4) or (4,)."""
    inverse: Array = np.asarray(q, np.float64) * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


@_by_blocks(4)
def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the Hamilton product (n, 4): the rotation ``b``, then ``a``."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    a0, a1, a2, a3 = (a[..., k] for k in range(4))
    b0, b1, b2, b3 = (b[..., k] for k in range(4))
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3
    out[..., 1] = a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2
    out[..., 2] = a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1
    out[..., 3] = a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0
    return out


@_by_blocks(3)
def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Rotate vectors (n, 3) by quaternions (n, 4), body to earth.

    Either may be single.
    """
    q = np.asarray(q, np.float64)
    v = np.asarray(v, np.float64)
    w, x, y, z = (q[..., k] for k in range(4))
    vx, vy, vz = (v[..., k] for k in range(3))
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    out = np.empty((*np.broadcast_shapes(q.shape[:-1], v.shape[:-1]), 3))
    out[..., 0] = vx + w * tx + (y * tz - z * ty)
    out[..., 1] = vy + w * ty + (z * tx - x * tz)
    out[..., 2] = vz + w * tz + (x * ty - y * tx)
    return out


def rotate_inverse(q: ArrayLike, v: ArrayLike) -> Array:
    """Rotate vectors (n, 3) by inverse quaternions, earth to body.

    Either may be single.
    """
    return rotate(conjugate(q), v)


@_by_blocks(4)
def from_rotvec(v: ArrayLike) -> Array:
    """Return the quaternions (n, 4) or (4,) of rotation vectors in rad."""
    v = np.asarray(v, np.float64)
    half = 0.5 * length(v)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.where(half > 1e-9, 0.5 * np.sin(half) / half, 0.5)
    out = np.empty((*v.shape[:-1], 4))
    out[..., 0] = np.cos(half)
    out[..., 1:] = factor[..., None] * v
    return out


@_by_blocks(3)
def to_rotvec(q: ArrayLike) -> Array:
    """Return rotation vectors (n, 3) in rad, length 0 to pi."""
    q = np.asarray(q, np.float64)
    w, s = q[..., 0], length(q[..., 1:])
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.where(s > 1e-12, 2.0 * np.arctan2(s, np.abs(w)) / s, 2.0)
    return np.asarray(np.where(w < 0, -factor, factor)[..., None] * q[..., 1:])


def increments(q: Array) -> Array:
    """Return rotation vectors (n - 1, 3) between successive attitudes, body axes.

    In rad, of attitudes (n, 4).
    """
    return relative_rotvecs(q[:-1], q[1:])


def relative_rotvecs(before: Array, after: Array) -> Array:
    """Return rotation vectors (n, 3) in rad of ``before^* after``, body axes."""
    out = np.empty((len(before), 3))
    for a in range(0, len(out), BLOCK_ROWS):
        (w, x, y, z), (e, f, g, h) = before[a : a + BLOCK_ROWS].T, after[a : a + BLOCK_ROWS].T
        turn = np.empty((3, len(w)))
        turn[0] = w * f - x * e - y * h + z * g
        turn[1] = w * g + x * h - y * e - z * f
        turn[2] = w * h - x * g + y * f - z * e
        cosine, sine = w * e + x * f + y * g + z * h, np.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
        factor = np.full(len(w), 2.0)
        np.divide(2.0 * np.arctan2(sine, np.abs(cosine)), sine, out=factor, where=sine > 1e-12)
        out[a : a + BLOCK_ROWS] = (turn * np.where(cosine < 0, -factor, factor)).T
    return out


def from_euler(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> Array:
    """Return the quaternions (n, 4) or (4,) of roll, pitch, yaw in rad."""
    r, p, y = (0.5 * np.asarray(x, np.float64) for x in (roll, pitch, yaw))
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


@_by_blocks(3)
def to_euler(q: ArrayLike) -> Array:
    """Return roll, pitch, yaw (n, 3) in rad; yaw in (-pi, pi]."""
    q = np.asarray(q, np.float64)
    w, x, y, z = (q[..., k] for k in range(4))
    out = np.empty((*q.shape[:-1], 3))
    out[..., 0] = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    out[..., 1] = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    out[..., 2] = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return out


@_by_blocks(3, 3)
def to_matrix(q: ArrayLike) -> Array:
    """Return rotation matrices (n, 3, 3), body to earth."""
    q = np.asarray(q, np.float64)
    w, x, y, z = (q[..., k] for k in range(4))
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = 2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = 2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)
    return out


def from_matrix(m: Array) -> Array:
    """Return the quaternion (4,) of a rotation matrix (3, 3)."""
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    k = int(np.argmax([trace, m[0, 0], m[1, 1], m[2, 2]]))
    if k == 0:
        q = np.array([1.0 + trace, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    else:
        i = k - 1
        j, n = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[0] = m[n, j] - m[j, n]
        q[1 + i] = 1.0 + m[i, i] - m[j, j] - m[n, n]
        q[1 + j] = m[j, i] + m[i, j]
        q[1 + n] = m[n, i] + m[i, n]
    return normalize(q)


def product(q: Array) -> Array:
    """Return the product (4,) of successive rotations (n, 4), by halves."""
    while len(q) > 1:
        pairs = multiply(q[0 : len(q) - 1 : 2], q[1::2])
        q = np.concatenate([pairs, q[-1:]]) if len(q) % 2 else pairs
    return np.asarray(q[0])


def nearest_rotation(b: Array) -> Array:
    """Return the rotation matrix R that maximises trace(R^T B).

    Wahba's problem [Markley1988]. With B = sum a b^T it rotates vectors b onto vectors a (Kabsch1976).
    """
    u, _, v = np.linalg.svd(b)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)


def slerp(t: ArrayLike, q: ArrayLike, at: ArrayLike) -> Array:
    """Interpolate attitudes (n, 4) at times along the shortest arc.

    NaN outside ascending ``t`` (n,). The caller decides whether interpolation across a gap is valid.
    """
    return slerp_in_segments(t, q, None, at)[0]


def slerp_in_segments(
    t: ArrayLike, q: ArrayLike, segment: NDArray[np.int64] | None, at: ArrayLike
) -> tuple[Array, NDArray[np.int64]]:
    """Return :func:`slerp` within segments, and the sample before each time.

    NaN and -1 across segments (n,) and outside ``t``.
    """
    t, q = np.ascontiguousarray(t, np.float64), np.ascontiguousarray(q, np.float64)
    at = np.ascontiguousarray(np.atleast_1d(at), np.float64)
    own = np.zeros(len(t), np.int64) if segment is None else np.ascontiguousarray(segment, np.int64)
    out, where = np.empty((len(at), 4)), np.empty(len(at), np.int64)
    slerp_loop(out, where, t, q, own, at)
    return out, where


def mean(q: ArrayLike) -> Array:
    """Return the mean attitude (4,) of (n, 4).

    Largest eigenvector of sum q q^T (Markley et al. 2007). Rows with NaN or zero length do not count; NaN without any
    row.
    """
    q = np.asarray(q, np.float64).reshape(-1, 4)
    return np.asarray(group_means(q, np.array([0, len(q)]))[0])


def group_means(q: Array, edges: NDArray[np.int64]) -> Array:
    """Return the mean attitudes (k, 4) of groups between ``edges`` (k + 1,)."""
    q = normalize(q)
    good = finite_rows(q)
    if not good.all():
        edges = np.concatenate([[0], np.cumsum(good)])[edges]
        q = q[good]
    groups = [q[a:b] for a, b in pairwise(edges.tolist())]
    _, vectors = np.linalg.eigh(np.array([group.T @ group for group in groups]))
    best = np.where(vectors[:, :1, -1] < 0, -vectors[:, :, -1], vectors[:, :, -1])
    return np.where((np.diff(edges) > 0)[:, None], best, np.nan)


def earth_error(q_est: ArrayLike, q_ref: ArrayLike) -> Array:
    """Return the error quaternions q_est q_ref^* (n, 4) in earth axes.

    See ``docs/metrics.md``.
    """
    return multiply(q_est, conjugate(q_ref))


def total_angle(e: ArrayLike) -> Array:
    """Return the total error (n,) in rad, 0 to pi: 2 atan2(|e_vec|, |e0|)."""
    e = np.asarray(e, np.float64)
    angle: Array = 2.0 * np.arctan2(length(e[..., 1:]), np.abs(e[..., 0]))
    return angle


def heading_angle(e: ArrayLike) -> Array:
    """Return the heading error (n,) in rad: 2 atan2(e3, e0), wrapped."""
    e = np.asarray(e, np.float64)
    return wrap(2.0 * np.arctan2(e[..., 3], e[..., 0]))


def tilt_angle(e: ArrayLike) -> Array:
    """Return the tilt error (n,) in rad.

    2 atan2(hypot(e1, e2), hypot(e0, e3)), 0 to pi.
    """
    e = np.asarray(e, np.float64)
    angle: Array = 2.0 * np.arctan2(length(e[..., 1:3]), length(e[..., ::3]))
    return angle


def wrap(angle: ArrayLike) -> Array:
    """Wrap angles (n,) in rad to [-pi, pi)."""
    return (np.asarray(angle, np.float64) + np.pi) % (2 * np.pi) - np.pi


def unwrap(angle: Array, period: float = 2 * np.pi) -> Array:
    """Return :func:`numpy.unwrap` of angles (n,), quickly where no angle jumps."""
    return angle.copy() if (np.abs(np.diff(angle)) < 0.5 * period).all() else np.unwrap(angle, period=period)


def turn_about_down(q: ArrayLike, angle: ArrayLike) -> Array:
    """Rotate attitudes (n, 4) by an angle about the down axis.

    ``angle`` (n,) or one, in rad.
    """
    q, half = np.asarray(q, np.float64), 0.5 * np.asarray(angle, np.float64)
    out = np.empty((*np.broadcast_shapes(q.shape[:-1], half.shape), 4))
    if q.ndim == 2 and len(q) > BLOCK_ROWS and half.shape in ((), (len(q),)):
        for a in range(0, len(q), BLOCK_ROWS):
            part = half[a : a + BLOCK_ROWS] if half.ndim else half
            out[a : a + BLOCK_ROWS] = turn_about_down(q[a : a + BLOCK_ROWS], 2.0 * part)
        return out
    cosine, sine = np.cos(half), np.sin(half)
    w, x, y, z = (q[..., k] for k in range(4))
    out[..., 0], out[..., 1] = cosine * w - sine * z, cosine * x - sine * y
    out[..., 2], out[..., 3] = cosine * y + sine * x, cosine * z + sine * w
    return out


# Squared sine of half an angle (0.1 rad between neighbours) below which the series are exact to the last digit.
MAX_SERIES_SINE_SQUARED = 0.0025


def small_arcsine(s: float) -> float:
    """Return the angle in rad of a sine up to 0.05."""
    x = s * s
    return s * (1.0 + x * (1.0 / 6.0 + x * (3.0 / 40.0 + x * (5.0 / 112.0 + x * (35.0 / 1152.0 + x * 63.0 / 2816.0)))))


def small_sine(y: float) -> float:
    """Return the sine of an angle up to 0.11 rad."""
    x = y * y
    return y * (1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0))))


@jit.loop("the interpolation of attitudes")
def slerp_loop(out: Out2, where: IOut1, t: F1, q: F2, segment: I1, at: F1) -> None:
    """Fill attitudes at times, and the sample before each.

    ``out`` (m, 4), ``where`` (m,) at ``at`` (m,). NaN and -1 outside ``t``, and between two samples of different
    ``segment`` (n,). ``t`` (n,) ascending, ``q`` (n, 4). Ascending times are found by walking on.
    """
    i, last = 0, len(t) - 1
    for k in range(len(at)):
        x = at[k]
        for c in range(4):
            out[k, c] = math.nan
        where[k] = -1
        if not (last >= 0 and t[0] <= x <= t[last]):
            continue
        i = last_before(t, x, i, last)
        if x == t[i]:
            where[k] = i
            for c in range(4):
                out[k, c] = q[i, c]
            continue
        if segment[i] != segment[i + 1]:
            continue
        where[k] = i
        share = (x - t[i]) / (t[i + 1] - t[i])
        dot = 0.0
        for c in range(4):
            dot += q[i, c] * q[i + 1, c]
        sign = -1.0 if dot < 0.0 else 1.0
        apart, along = 0.0, 0.0
        for c in range(4):
            minus, plus = sign * q[i + 1, c] - q[i, c], sign * q[i + 1, c] + q[i, c]
            apart, along = apart + minus * minus, along + plus * plus
        square = apart / (apart + along) if apart + along > 0.0 else math.nan
        first, second = 1.0 - share, share
        if square < MAX_SERIES_SINE_SQUARED:
            angle = 2.0 * small_arcsine(math.sqrt(square))
            if angle > 0.0:
                whole = small_sine(angle)
                first, second = small_sine(first * angle) / whole, small_sine(share * angle) / whole
        else:
            angle = 2.0 * math.atan2(math.sqrt(apart), math.sqrt(along))
            whole = math.sin(angle)
            first, second = math.sin(first * angle) / whole, math.sin(share * angle) / whole
        for c in range(4):
            out[k, c] = first * q[i, c] + second * sign * q[i + 1, c]
