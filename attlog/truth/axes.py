"""In which axes is a truth? Its body's by the gyro, its vertical by gravity, its north by motion or not at all."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import FlightLog, Imu
from attlog.segments import gaps

Array = NDArray[np.float64]

G = 9.80665
BLOCKS, LEAST_BLOCKS = 10, 4
BLOCK_S = 2.0
"""The mean force over so long is gravity, the bias and the change of velocity."""
BIAS_M_S2 = np.array([0.15, 0.15, 0.3])
"""One sigma of an accelerometer's bias before a flight tells it."""
SPEED_M_S, SAME_WAY, LEAST_SPEEDS = 1.0, 0.9, 20
"""Motion tells north above so much speed, where both velocities correlate by so much, by so many of them."""
LATE_S = np.arange(-0.1, 0.41, 0.02)
"""A receiver's velocity may be late by what its driver does not know; on a curve that would turn north."""
DOWN = np.array([0.0, 0.0, 1.0])
SIGNIFICANT = 3.0
"""What differs from the usual by fewer sigmas is the usual."""
USUAL = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
"""Body axes that people give: forward-right-down and forward-left-up."""


@dataclass(frozen=True, slots=True)
class Vertical:
    """Earth's down (3,) in the truth's world, its one sigma in rad, and the size of gravity found in m/s^2."""

    down: Array
    sigma: float
    gravity: float


@dataclass(frozen=True, slots=True)
class North:
    """The heading in rad that turns the levelled world north, and its one sigma."""

    heading: float
    sigma: float


def vertical(imu: Imu, t: Array, q: Array, velocity: Array | None) -> Vertical | None:
    """Down in the world of attitudes ``q`` (n, 4), body FRD to that world, at ``t`` (n,) s on the log's clock.

    Least squares over blocks: force in body = -R^T g + bias + R^T a, where ``velocity`` (n, 3) of the truth, if it
    has one, tells the acceleration a. None where less than a few blocks are covered.
    """
    at, force = gaps.rising(imu.acc.t_best, imu.acc.x)
    turned, _ = rotation.interpolated(t, q, gaps.number(t), at)
    good = rotation.finite(turned)
    if np.count_nonzero(good) < 10:
        return None
    at, force, turned = at[good], force[good], turned[good]
    block = ((at - at[0]) / BLOCK_S).astype(np.int64)
    _, first, count = np.unique(block, return_index=True, return_counts=True)
    whole = count >= 0.5 * np.median(count)
    to_world = rotation.to_matrix(turned)
    mean_turn = np.add.reduceat(to_world, first, axis=0) / count[:, None, None]
    mean_force = np.add.reduceat(rotation.rotate(turned, force), first, axis=0) / count[:, None]
    push = np.zeros_like(mean_force)
    if velocity is not None:
        ends = [np.column_stack([np.interp(x, t, v) for v in velocity.T]) for x in (at[first], at[first + count - 1])]
        push = (ends[1] - ends[0]) / np.maximum(at[first + count - 1] - at[first], 0.5)[:, None]
        whole &= rotation.finite(push)
    if np.count_nonzero(whole) < LEAST_BLOCKS:
        return None
    mean_turn, y = mean_turn[whole], (mean_force - push)[whole]
    whole_fit = _down(mean_turn, y)
    if whole_fit is None:
        return None
    parts = np.array_split(np.arange(len(y)), min(BLOCKS, len(y)))
    left = [_down(np.delete(mean_turn, p, axis=0), np.delete(y, p, axis=0)) for p in parts]
    off = np.array([one.down - whole_fit.down for one in left if one is not None])
    scatter = float(np.sqrt((len(off) - 1) / len(off) * np.sum((off - off.mean(axis=0)) ** 2)))
    return replace(whole_fit, sigma=max(whole_fit.sigma, scatter))


def _down(mean_turn: Array, y: Array) -> Vertical | None:
    """The solution for y (k, 3) = -g + mean_turn (k, 3, 3) b, b near zero; the worst blocks count less."""
    k = len(y)
    rows = np.concatenate([np.broadcast_to(-np.eye(3), (k, 3, 3)), mean_turn], axis=2)
    weight, prior = np.ones(k), np.diag(np.concatenate([np.zeros(3), BIAS_M_S2**-2.0]))
    scale = 1.0
    for _ in range(5):
        per = weight / scale**2
        information = np.einsum("k,kij,kil->jl", per, rows, rows) + prior
        x = np.linalg.solve(information, np.einsum("k,kij,ki->j", per, rows, y))
        left = np.sqrt(np.sum((y - rows @ x) ** 2, axis=1) / 3.0)
        scale = max(1.4826 * float(np.median(left)), 1e-3)
        weight = np.minimum(1.0, 2.0 * scale / np.maximum(left, 1e-9)) ** 2
    gravity = float(np.linalg.norm(x[:3]))
    if gravity < 0.5 * G:
        return None
    covariance = np.linalg.inv(information)[:3, :3]
    across = np.eye(3) - np.outer(x[:3], x[:3]) / gravity**2
    sigma = float(np.sqrt(np.trace(across @ covariance @ across))) / gravity
    return Vertical(x[:3] / gravity, sigma, gravity)


def usual(turn: Array, sigma: Array) -> Array:
    """The usual body axes where a turn (4,) of a body to FRD is no different, by ``sigma`` (3,) rad; else the turn."""
    for named in np.array(USUAL):
        apart = rotation.to_rotvec(rotation.error(turn, named))
        if np.all(np.abs(apart) <= SIGNIFICANT * sigma):
            return np.asarray(named)
    return turn


def levelled(down: Array, within: float = 0.0) -> Array:
    """The rotation (4,) of least angle from the nearest of the world's axes, that makes ``down`` (3,) the third axis.

    A world that is level but for ``within`` rad stays so: an accelerometer's bias would only tilt it.

    East-north-up becomes north-east-down; a world whose vertical is its second axis is turned onto it first.
    """
    nearest = np.zeros(3)
    axis = int(np.argmax(np.abs(down)))
    nearest[axis] = np.sign(down[axis])
    turn = np.eye(3)
    if axis == 2:
        turn = np.eye(3) if nearest[2] > 0 else np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    else:
        north = np.zeros(3)
        north[(axis + 1) % 3] = 1.0
        turn = np.array([north, np.cross(nearest, north), nearest])
    rest = turn @ down
    q = rotation.from_matrix(turn)
    bend = np.cross(rest, DOWN)
    size = float(np.linalg.norm(bend))
    if size > np.sin(within):
        q = rotation.multiply(rotation.from_rotvec(bend / size * np.arctan2(size, float(rest @ DOWN))), q)
    return np.asarray(q)


def north_by_gnss(log: FlightLog, t: Array, velocity: Array) -> North | None:
    """The heading that turns horizontal velocities (n, 3) of the levelled truth onto the GNSS velocity.

    None where it did not move enough, or the two do not go the same way.
    """
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & rotation.finite(gnss.vel_ned[:, :2])
        products = [_together(t, velocity, gnss.t[good] - late, gnss.vel_ned[good]) for late in LATE_S]
        same, product = max(products, key=lambda found: found[0])
        if same < SAME_WAY:
            continue
        heading = float(np.angle(product.sum()))
        parts = np.array([p.sum() for p in np.array_split(product, BLOCKS)])
        off = np.angle((product.sum() - parts) * np.exp(-1j * heading))
        return North(heading, float(np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((off - off.mean()) ** 2))))
    return None


def _together(t: Array, velocity: Array, at: Array, seen: Array) -> tuple[float, NDArray[np.complex128]]:
    """How well velocities (n, 3) at ``t`` and ``seen`` (m, 3) go the same way, 0 to 1, and their products (k,)."""
    inside = (at > t[0]) & (at < t[-1])
    a = np.column_stack([np.interp(at[inside], t, v) for v in velocity.T[:2]]) @ [1.0, 1j]
    b = seen[inside, :2] @ [1.0, 1j]
    fast = (np.abs(a) > SPEED_M_S) & (np.abs(b) > SPEED_M_S)
    product = np.conj(a[fast]) * b[fast]
    if len(product) < LEAST_SPEEDS:
        return 0.0, product
    size = np.sqrt(np.sum(np.abs(a[fast]) ** 2) * np.sum(np.abs(b[fast]) ** 2))
    return float(np.abs(product.sum()) / size), product


def gnss_velocity(log: FlightLog, t: Array) -> Array | None:
    """Velocity (n, 3) m/s NED at times (n,) s by the first receiver with a fix, NaN beyond it; None without one."""
    for gnss in log.gnss:
        at, v = gaps.rising(np.where(gnss.fix >= 3, gnss.t, np.nan), gnss.vel_ned)
        if len(at) > LEAST_SPEEDS:
            return np.column_stack([np.interp(t, at, x, np.nan, np.nan) for x in v.T])
    return None


def velocity_of(t: Array, position: Array | None) -> Array | None:
    """Velocities (n, 3) of positions (n, 3), over 0.2 s; None without any."""
    if position is None or not np.isfinite(position).all() or len(t) < 3 or not np.ptp(position, axis=0).any():
        return None
    half = 0.1
    ends = [np.column_stack([np.interp(np.clip(t + s, t[0], t[-1]), t, p) for p in position.T]) for s in (-half, half)]
    span = np.clip(t + half, t[0], t[-1]) - np.clip(t - half, t[0], t[-1])
    return np.asarray((ends[1] - ends[0]) / np.maximum(span, 1e-3)[:, None])
