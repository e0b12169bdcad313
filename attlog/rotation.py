"""Quaternions, Euler angles and attitude errors on whole arrays.

Conventions everywhere in attlog: scalar first, Hamilton product, ``q`` turns body
(FRD) vectors into earth (NED) vectors, Euler angles are roll, pitch, yaw in the
order z-y-x. Arrays are (..., 4) and (..., 3); all functions broadcast. Angles
come from ``atan2`` of the vector part, never from ``acos`` of the scalar part: in
float32 the latter turns rounding into 0.06 deg.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def normalize(q: ArrayLike) -> Array:
    """Unit quaternions (..., 4); a quaternion of zero length becomes NaN."""
    q = np.asarray(q, np.float64)
    norm = np.sqrt(np.sum(q * q, axis=-1, keepdims=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(norm > 0, q / norm, np.nan)


def finite(x: Array) -> NDArray[np.bool_]:
    """Which rows (n,) of quaternions or vectors (n, k) hold finite numbers alone; many times faster than ``all``."""
    with np.errstate(invalid="ignore"):
        return np.isfinite(x @ np.ones(x.shape[-1]))


def conjugate(q: ArrayLike) -> Array:
    """The inverse rotation of unit quaternions (..., 4)."""
    inverse: Array = np.asarray(q, np.float64) * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product a (x) b: first b, then a."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    a0, a1, a2, a3 = (a[..., k] for k in range(4))
    b0, b1, b2, b3 = (b[..., k] for k in range(4))
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3
    out[..., 1] = a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2
    out[..., 2] = a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1
    out[..., 3] = a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0
    return out


def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Vectors v (..., 3) turned by q: body to earth."""
    q = np.asarray(q, np.float64)
    v = np.asarray(v, np.float64)
    u = q[..., 1:]
    t = 2.0 * np.cross(u, v)
    return v + q[..., :1] * t + np.cross(u, t)


def rotate_inverse(q: ArrayLike, v: ArrayLike) -> Array:
    """Vectors v (..., 3) turned back by q: earth to body."""
    return rotate(conjugate(q), v)


def from_rotvec(v: ArrayLike) -> Array:
    """Quaternion of a rotation vector (..., 3) in rad."""
    v = np.asarray(v, np.float64)
    half = 0.5 * np.sqrt(np.sum(v * v, axis=-1, keepdims=True))
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * v], axis=-1)


def to_rotvec(q: ArrayLike) -> Array:
    """Rotation vector (..., 3) in rad, length 0 to pi."""
    q = np.asarray(q, np.float64)
    q = np.where(q[..., :1] < 0, -q, q)
    s = np.sqrt(np.sum(q[..., 1:] ** 2, axis=-1, keepdims=True))
    angle = 2.0 * np.arctan2(s, q[..., :1])
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.where(s > 1e-12, angle / s, 2.0)
    return factor * q[..., 1:]


def from_euler(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> Array:
    """Quaternions (..., 4) of roll, pitch, yaw in rad (order z-y-x)."""
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


def to_euler(q: ArrayLike) -> Array:
    """Roll, pitch, yaw (..., 3) in rad; yaw in (-pi, pi]."""
    w, x, y, z = np.moveaxis(np.asarray(q, np.float64), -1, 0)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=-1)


def to_matrix(q: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3), body to earth."""
    w, x, y, z = np.moveaxis(np.asarray(q, np.float64), -1, 0)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        axis=-2,
    )


def slerp(t: ArrayLike, q: ArrayLike, at: ArrayLike) -> Array:
    """Attitudes interpolated at times ``at`` along the shortest arc; NaN outside ``t``.

    ``t`` (n,) ascending, ``q`` (n, 4). The caller decides whether interpolating
    across a gap is honest.
    """
    t = np.asarray(t, np.float64)
    q = np.asarray(q, np.float64)
    at = np.atleast_1d(np.asarray(at, np.float64))
    if len(t) < 2:
        out = np.full((len(at), 4), np.nan)
        if len(t) == 1:
            out[at == t[0]] = q[0]
        return out
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    span = t[i + 1] - t[i]
    with np.errstate(invalid="ignore", divide="ignore"):
        u = np.where(span > 0, (at - t[i]) / span, 0.0)
    step = to_rotvec(multiply(conjugate(q[i]), q[i + 1]))
    out = multiply(q[i], from_rotvec(u[:, None] * step))
    out[(at < t[0]) | (at > t[-1])] = np.nan
    return out


def mean(q: ArrayLike) -> Array:
    """The mean attitude (4,) of (n, 4): largest eigenvector of sum q q^T (Markley et al. 2007).

    Rows with NaN and of zero length do not count; NaN where none is left.
    """
    q = normalize(np.asarray(q, np.float64).reshape(-1, 4))
    q = q[np.isfinite(q).all(axis=1)]
    if len(q) == 0:
        return np.full(4, np.nan)
    _, vectors = np.linalg.eigh(q.T @ q)
    best = vectors[:, -1]
    return best if best[0] >= 0 else -best


def error(q_est: ArrayLike, q_ref: ArrayLike) -> Array:
    """e = q_est (x) conj(q_ref): the error seen in earth axes (``docs/metrics.md``)."""
    return multiply(q_est, conjugate(q_ref))


def total_angle(e: ArrayLike) -> Array:
    """Total error in rad, 0 to pi: 2 atan2(|e_vec|, |e0|)."""
    e = np.asarray(e, np.float64)
    angle: Array = 2.0 * np.arctan2(np.sqrt(np.sum(e[..., 1:] ** 2, axis=-1)), np.abs(e[..., 0]))
    return angle


def heading_angle(e: ArrayLike) -> Array:
    """Heading error in rad, -pi to pi: 2 atan2(e3, e0), wrapped."""
    e = np.asarray(e, np.float64)
    return wrap(2.0 * np.arctan2(e[..., 3], e[..., 0]))


def inclination_angle(e: ArrayLike) -> Array:
    """Tilt error in rad, 0 to pi: 2 atan2(hypot(e1, e2), hypot(e0, e3))."""
    e = np.asarray(e, np.float64)
    angle: Array = 2.0 * np.arctan2(np.hypot(e[..., 1], e[..., 2]), np.hypot(e[..., 0], e[..., 3]))
    return angle


def wrap(angle: ArrayLike) -> Array:
    """Angles in rad wrapped to [-pi, pi)."""
    return (np.asarray(angle, np.float64) + np.pi) % (2 * np.pi) - np.pi


def turn_about_down(q: ArrayLike, angle: ArrayLike) -> Array:
    """Attitudes turned by ``angle`` rad about the earth's down axis (adds to the heading)."""
    half = 0.5 * np.asarray(angle, np.float64)
    zero = np.zeros_like(half)
    return multiply(np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1), q)
