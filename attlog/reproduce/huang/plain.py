"""Mahony's filter and an EKF with 7 states as plain numpy arrays: what interpreted code costs.

The EKF is the textbook's, dense: attitude and gyro bias, X = [q, b],

    q'  = q (x) (0, w - b)/2,  F = [[I + dt Omega(w - b)/2, -dt Xi(q)/2], [0, I]]
    z   = [-f/|f|, m/|m|],     h = [R^T e_z, R^T m_n],  m_n the field's direction in earth axes

and P = F P F^T + Q, K = P H^T (H P H^T + R)^-1, P = (I - K H) P. Mahony's filter is that of ``mahony_dcm@huang``.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.estimators.engine.start import start_attitude
from attlog.reproduce.cost import RATE_HZ, ROUNDS, CostSamples, swing

Array = NDArray[np.float64]
DT = 1.0 / RATE_HZ
KP, KI = 0.3, 0.01
GYRO, BIAS, VECTORS = 0.02, 1e-5, 0.3
"""Noise of the EKF per sample: rad/s, rad/s, 1."""
DOWN = np.array([0.0, 0.0, 1.0])


def skew(v: Array) -> Array:
    """[v]x (3, 3) of a vector (3,)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def mahony(s: CostSamples, q0: Array) -> Array:
    """Huang 2.3.2 from ``q0`` (4,): the rotation matrix, body to earth, after every sample, (n, 3, 3)."""
    r, bias, found = rotation.to_matrix(q0), np.zeros(3), np.empty((len(s.t), 3, 3))
    for k, (gyr, acc, mag) in enumerate(zip(s.gyr, s.acc, s.mag, strict=True)):
        field = r @ (mag / np.linalg.norm(mag))
        e = np.cross(-acc / np.linalg.norm(acc), r[2]) - field[1] * r[2]
        bias = bias - KI * DT * e
        r = orthonormal(r + DT * r @ skew(gyr - bias + KP * e))
        found[k] = r
    return found


def orthonormal(r: Array) -> Array:
    """A matrix (3, 3) after the renormalisation of Huang 2.3.1."""
    half = 0.5 * (r[0] @ r[1])
    x, y = r[0] - half * r[1], r[1] - half * r[0]
    x, y = 0.5 * (3.0 - x @ x) * x, 0.5 * (3.0 - y @ y) * y
    return np.array([x, y, np.cross(x, y)])


def ekf(s: CostSamples, q0: Array) -> Array:
    """The EKF from ``q0`` (4,): its states [q, b] after every sample, (n, 7)."""
    x, p = np.concatenate([q0, np.zeros(3)]), np.diag([1e-2] * 4 + [1e-4] * 3)
    north = rotation.rotate(q0, s.mag[0] / np.linalg.norm(s.mag[0]))
    h, f, noise = np.zeros((6, 7)), np.eye(7), VECTORS**2 * np.eye(6)
    walk = np.diag([(0.5 * DT * GYRO) ** 2] * 4 + [BIAS**2] * 3)
    found = np.empty((len(s.t), 7))
    for k, (gyr, acc, mag) in enumerate(zip(s.gyr, s.acc, s.mag, strict=True)):
        turn = 0.5 * DT * (gyr - x[4:])
        f[0, 1:4], f[1:4, 0], f[1:4, 1:4] = -turn, turn, np.eye(3) - skew(turn)
        f[0, 4:], f[1:4, 4:] = 0.5 * DT * x[1:4], -0.5 * DT * (x[0] * np.eye(3) + skew(x[1:4]))
        x[:4] = f[:4, :4] @ x[:4]
        p = f @ p @ f.T + walk
        seen, h[:3, :4] = turned_back(x[:4], DOWN)
        level, h[3:, :4] = turned_back(x[:4], north)
        z = np.concatenate([-acc / np.linalg.norm(acc), mag / np.linalg.norm(mag)])
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + noise)
        x = x + gain @ (z - np.concatenate([seen, level]))
        p = (np.eye(7) - gain @ h) @ p
        x[:4] /= np.linalg.norm(x[:4])
        found[k] = x
    return found


def turned_back(q: Array, v: Array) -> tuple[Array, Array]:
    """R^T v (3,) of a vector (3,) in earth axes, and its derivative by ``q`` (3, 4)."""
    w, u = q[0], q[1:]
    across = skew(u) @ v
    turned = (w * w - u @ u) * v + 2.0 * (u @ v) * u - 2.0 * w * across
    by_u = 2.0 * ((u @ v) * np.eye(3) + np.outer(u, v) - np.outer(v, u) + w * skew(v))
    return turned, np.column_stack([2.0 * (w * v - across), by_u])


def nanoseconds(rounds: int = ROUNDS, updates: int = 400, repeats: int = 3) -> tuple[list[float], list[float]]:
    """Nanoseconds per update of Mahony's filter and of the EKF, ``rounds`` times in turn, best of ``repeats``."""
    s = swing(updates)
    q0 = start_attitude(s.acc[0], s.mag[0])
    spent: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for times, one in zip(spent, (mahony, ekf), strict=True):
            clocks = []
            for _ in range(repeats):
                clock = time.thread_time()
                one(s, q0)
                clocks.append(time.thread_time() - clock)
            times.append(1e9 * min(clocks) / updates)
    return spent
