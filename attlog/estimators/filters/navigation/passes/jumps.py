"""Jumps of the gyro bias in flight: where the likelihood wants one, and how large it is.

A shock ``s`` of the bias at a node changes the likelihood of all that follows by ``-lam.s - s^T Lam s / 2``, so that a
jump of prior variance Q = JUMP_RAD_S^2 I there gains, by the scores that the way back has anyway (DeJongPenzer1998),

    log L gains  lam^T (Lam + Q^-1)^-1 lam / 2 - log det(I + Q Lam) / 2,   s = -(Lam + Q^-1)^-1 lam

One node after another, at the cost of a 3 x 3 solution each. Where a jump is modelled (the spread of the bias opened at
its node) its smoothed size is ``-Q lam`` with variance ``Q - Q Lam Q``, and its time is where the way forth is
likeliest: the scores of a pass that lacks the jump see it blurred.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from attlog.estimators.base import Array
from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.settings import JUMP_RAD_S
from attlog.estimators.filters.navigation.solve import Pass

GAIN, GAIN_COMPASS = 20.0, 200.0
"""Least gain in log likelihood. Without a compass sound flights stay below 5 and flights with faults of other sensors
below 15; with one that is turned or offset they reach 113."""
MOST = 4
EDGE_S = 2.0
"""So near to the ends, or to another jump, none is looked for: it could not be told from a blow."""
SMALLEST_RAD_S, LARGEST_RAD_S, LEAST_SURE_RAD_S = np.deg2rad(0.2), np.deg2rad(10.0), np.deg2rad(0.3)
"""What is smaller the bias' random walk follows; what is larger is a blow or a clipped gyro, what is less sure no step
of a constant bias."""
SIGMAS, SAME_RAD_S = 3.0, np.deg2rad(0.1)
"""Two runs agree on a jump within so many joint sigmas and this much."""
BIAS_CHANGED_DPS, REST_S = 0.5, 2.0
"""A gyro's bias drifts less in a flight, unless it jumps; each rest shows it for so long at least."""
PLACED_S = (0.4, 0.2, 0.1, 0.05)
"""Steps in s by which the time of a jump is moved while that is likelier."""
FALL, FURTHEST_S = 2.0, 26.0
"""Two sigma from its best time the logarithm of the likelihood has fallen by 2; none is looked at further away."""
Times = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Jump:
    """At ``t`` s (one sigma ``t_sigma``) the gyro bias (3,) rad/s steps by ``size`` (one sigma ``sigma``)."""

    t: float
    t_sigma: float
    size: Array
    sigma: Array

    @property
    def counts(self) -> bool:
        """Whether it is worth telling."""
        return bool(self.rate > SMALLEST_RAD_S)

    @property
    def believable(self) -> bool:
        """Whether a bias can step so."""
        return bool(self.rate < LARGEST_RAD_S and np.max(self.sigma) < LEAST_SURE_RAD_S)

    @property
    def rate(self) -> float:
        """How large it is about any axis, rad/s."""
        return float(np.sqrt(np.sum(self.size**2)))


def gains(shocks: Array) -> tuple[Array, Array]:
    """What a jump at each node (m,) would add to the logarithm of the likelihood, and its size (m, 3) in rad/s.

    ``shocks`` (m, 12) as of :class:`Pass`.
    """
    lam, Lam = shocks[:, :3], shocks[:, 3:].reshape(-1, 3, 3)
    size = -np.linalg.solve(Lam + np.eye(3) / JUMP_RAD_S**2, lam[:, :, None])[:, :, 0]
    volume = np.linalg.slogdet(np.eye(3) + JUMP_RAD_S**2 * Lam)[1]
    return -0.5 * np.sum(size * lam, axis=1) - 0.5 * volume, size


def candidate(found: Pass, when: Array, known: Times) -> tuple[float, float]:
    """Time in s of the most likely further jump, and what it would gain; ``when`` (m,) s of the nodes."""
    usable = (when > when[0] + EDGE_S) & (when < when[-1] - EDGE_S)
    for t in known:
        usable &= np.abs(when - t) > EDGE_S
    gain, size = gains(found.shocks)
    usable &= np.sum(size**2, axis=1) > SMALLEST_RAD_S**2
    if not usable.any():
        return float(when[0]), 0.0
    k = int(np.argmax(np.where(usable, gain, -np.inf)))
    return float(when[k]), float(gain[k])


def modelled(found: Pass, when: Array, times: Times, t_sigmas: Times) -> tuple[Jump, ...]:
    """The jumps that a pass was run with, at ``times`` s; ``when`` (m,) s of its nodes."""
    out = []
    nodes = np.flatnonzero(found.schedule.jump > 0.0)
    for t, t_sigma in zip(times, t_sigmas, strict=True):
        k = int(nodes[np.argmin(np.abs(when[nodes] - t))])
        variance = JUMP_RAD_S**2 - JUMP_RAD_S**4 * found.shocks[k, [3, 7, 11]]
        sigma = np.sqrt(np.maximum(variance, 0.0))
        out.append(Jump(t, t_sigma, -(JUMP_RAD_S**2) * found.shocks[k, :3], sigma))
    return tuple(out)


def placed(times: Times, likelihood: Callable[[Times], float]) -> tuple[Times, Times]:
    """Times of jumps moved to where they are likeliest, and their sigmas, s."""
    best = likelihood(times)
    sigmas = []
    for k in range(len(times)):
        for step in (sign * size for size in PLACED_S for sign in (1.0, -1.0)):
            while (value := likelihood(_moved(times, k, step))) > best:
                times, best = _moved(times, k, step), value
        far = [PLACED_S[-1], PLACED_S[-1]]
        for side, sign in enumerate((1.0, -1.0)):
            while far[side] < FURTHEST_S and likelihood(_moved(times, k, sign * far[side])) > best - FALL:
                far[side] *= 2.0
        sigmas.append(0.5 * max(far))
    return times, tuple(sigmas)


def _moved(times: Times, k: int, by: float) -> Times:
    return (*times[:k], times[k] + by, *times[k + 1 :])


def agree(found: tuple[Jump, ...], others: tuple[Jump, ...]) -> bool:
    """Whether two runs with jumps at the same times find the same sizes, as far as they can tell."""
    return all(
        np.all(np.abs(a.size - b.size) < SIGMAS * np.hypot(a.sigma, b.sigma) + SAME_RAD_S)
        for a in found
        for b in others
        if a.t == b.t
    )


def changed_at_rest(inputs: Inputs) -> bool:
    """Whether the bias that the gyro shows at rest changed by more over the run than it drifts."""
    return bias_change_dps(inputs) > BIAS_CHANGED_DPS


def bias_change_dps(inputs: Inputs) -> float:
    """By how much in deg/s the mean gyro of the last rest differs from that of the first; 0 without two rests."""
    edges = np.flatnonzero(np.diff(inputs.still.astype(np.int8), prepend=0, append=0))
    means: list[Array] = []
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        if inputs.t[b - 1] - inputs.t[a] >= REST_S:
            means.append(np.mean(inputs.gyr[a:b], axis=0))
    if len(means) < 2:
        return 0.0
    return math.degrees(float(np.sqrt(np.sum((means[-1] - means[0]) ** 2))))
