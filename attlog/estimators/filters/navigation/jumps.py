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
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from attlog.core.sorting import unique
from attlog.estimators.filters.navigation.inputs import JUMP_RAD_S, Inputs
from attlog.estimators.filters.navigation.model import MEM, E, Settings, State
from attlog.estimators.filters.navigation.schedule import Schedule
from attlog.estimators.filters.navigation.solve import Pass, Runner, likelihoods
from attlog.estimators.filters.navigation.start import StartState
from attlog.estimators.interface import Array

# Least gain in log likelihood. Without a compass sound flights stay below 5 and flights with faults of other sensors
# below 15; with one that is turned or offset they reach 113.
MIN_GAIN, GAIN_COMPASS = 20.0, 200.0
MAX_JUMPS = 4
# So near to the ends, or to another jump, none is looked for: a blow looks the same.
EDGE_S = 2.0
# What is smaller the bias' random walk follows; what is larger is a blow or a clipped gyro, what is less sure no step
# of a constant bias.
MIN_JUMP_RAD_S, MAX_JUMP_RAD_S, MIN_SURE_RAD_S = np.deg2rad(0.2), np.deg2rad(10.0), np.deg2rad(0.3)
# Two runs agree on a jump within so many joint sigmas and this much.
AGREE_SIGMAS, SAME_RAD_S = 3.0, np.deg2rad(0.1)
# A gyro's bias drifts less in a flight, unless it jumps; each rest shows it for so long at least.
BIAS_CHANGED_DPS, MIN_REST_S = 0.5, 2.0
# Steps in s by which the time of a jump is moved while that is likelier.
PLACED_S = (0.4, 0.2, 0.1, 0.05)
# Two sigma from its best time the logarithm of the likelihood has fallen by 2; none is looked at further away.
LOG_LIKELIHOOD_FALL, MAX_TIME_SEARCH_S = 2.0, 26.0
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
        """Return whether the jump is large enough to report."""
        return bool(self.rate > MIN_JUMP_RAD_S)

    @property
    def believable(self) -> bool:
        """Return whether a bias can step so."""
        return bool(self.rate < MAX_JUMP_RAD_S and np.max(self.sigma) < MIN_SURE_RAD_S)

    @property
    def rate(self) -> float:
        """The size about any axis, rad/s."""
        return float(np.sqrt(np.sum(self.size**2)))


def gains(shocks: Array) -> tuple[Array, Array]:
    """Return the gain in log likelihood by a jump at each node (m,), and its size (m, 3) in rad/s.

    ``shocks`` (m, 12) as of :class:`Pass`.
    """
    lam, Lam = shocks[:, :3], shocks[:, 3:].reshape(-1, 3, 3)
    size = -np.linalg.solve(Lam + np.eye(3) / JUMP_RAD_S**2, lam[:, :, None])[:, :, 0]
    volume = np.linalg.slogdet(np.eye(3) + JUMP_RAD_S**2 * Lam)[1]
    return -0.5 * np.sum(size * lam, axis=1) - 0.5 * volume, size


def candidate(found: Pass, when: Array, known: Times) -> tuple[float, float]:
    """Return time in s and gain of the most likely further jump; ``when`` (m,) s of the nodes."""
    usable = (when > when[0] + EDGE_S) & (when < when[-1] - EDGE_S)
    for t in known:
        usable &= np.abs(when - t) > EDGE_S
    gain, size = gains(found.shocks)
    usable &= np.sum(size**2, axis=1) > MIN_JUMP_RAD_S**2
    if not usable.any():
        return float(when[0]), 0.0
    k = int(np.argmax(np.where(usable, gain, -np.inf)))
    return float(when[k]), float(gain[k])


def modelled_jumps(found: Pass, when: Array, times: Times, t_sigmas: Times) -> tuple[Jump, ...]:
    """Return the jumps that a pass was run with, at ``times`` s; ``when`` (m,) s of its nodes."""
    out = []
    nodes = np.flatnonzero(found.schedule.jump > 0.0)
    for t, t_sigma in zip(times, t_sigmas, strict=True):
        k = int(nodes[np.argmin(np.abs(when[nodes] - t))])
        variance = JUMP_RAD_S**2 - JUMP_RAD_S**4 * found.shocks[k, [3, 7, 11]]
        sigma = np.sqrt(np.maximum(variance, 0.0))
        out.append(Jump(t, t_sigma, -(JUMP_RAD_S**2) * found.shocks[k, :3], sigma))
    return tuple(out)


def refine_times(times: Times, likelihood: Callable[[Times], float]) -> tuple[Times, Times]:
    """Move times of jumps to where they are likeliest; return them and their sigmas, s."""
    best = likelihood(times)
    sigmas = []
    for k in range(len(times)):
        for step in (sign * size for size in PLACED_S for sign in (1.0, -1.0)):
            while (value := likelihood(_with_moved_time(times, k, step))) > best:
                times, best = _with_moved_time(times, k, step), value
        far = [PLACED_S[-1], PLACED_S[-1]]
        for side, sign in enumerate((1.0, -1.0)):
            while (
                far[side] < MAX_TIME_SEARCH_S
                and likelihood(_with_moved_time(times, k, sign * far[side])) > best - LOG_LIKELIHOOD_FALL
            ):
                far[side] *= 2.0
        sigmas.append(0.5 * max(far))
    return times, tuple(sigmas)


def _with_moved_time(times: Times, k: int, by: float) -> Times:
    return (*times[:k], times[k] + by, *times[k + 1 :])


def agree(found: tuple[Jump, ...], others: tuple[Jump, ...]) -> bool:
    """Return whether two runs with jumps at the same times find the same sizes within their sigmas."""
    return all(
        np.all(np.abs(a.size - b.size) < AGREE_SIGMAS * np.hypot(a.sigma, b.sigma) + SAME_RAD_S)
        for a in found
        for b in others
        if a.t == b.t
    )


def changed_at_rest(inputs: Inputs) -> bool:
    """Return whether the gyro bias at rest changed by more over the run than it drifts."""
    return bias_change_dps(inputs) > BIAS_CHANGED_DPS


def bias_change_dps(inputs: Inputs) -> float:
    """Return the change in deg/s of the mean gyro from the first rest to the last; 0 without two rests."""
    edges = np.flatnonzero(np.diff(inputs.still.astype(np.int8), prepend=0, append=0))
    means: list[Array] = []
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        if inputs.t[b - 1] - inputs.t[a] >= MIN_REST_S:
            means.append(np.mean(inputs.gyr[a:b], axis=0))
    if len(means) < 2:
        return 0.0
    return math.degrees(float(np.sqrt(np.sum((means[-1] - means[0]) ** 2))))


# Jumps of the gyro bias as a filter finds them: by what came so far, and of use from then on.
#
# Each second the filter asks whether its innovations have grown. If they stay so, the scores of the last seconds (see
# :mod:`jumps`) say whether a jump of the bias explains it; where one does, these seconds are filtered again with it,
# and the filter goes on from there. Earlier attitudes stay. A compass that is turned or offset looks like a jump
# too, but such a jump worsens the fit of GNSS: then there is none.

# How often the filter asks, and how far back it looks.
EVERY_S, WINDOW_S = 1.0, 10.0
# What the way back needs is kept for so long: a window and more, 15 MB.
KEPT_S = 60.0
# Mean square, over the gate's, of the worst of three innovations of velocity or field: 0.3 where noise levels fit.
LARGE_INNOVATION = 0.5
# Seconds in a row of grown innovations before a jump is searched: half of the odd innovations last for one.
GROWN_S = 2
# Least gain in log likelihood, and what a filter that a bad compass misleads would take for a jump.
ONLINE_MIN_GAIN, ONLINE_MAX_JUMP_RAD_S = 40.0, np.deg2rad(4.0)
# Groups of GNSS velocities and positions, and what they must gain at least: -3 and more for real jumps on 24 flights (a
# plane's -12 in the first second), -6 to -32 in 11 of the 18 copies where a compass feigned one.
GNSS, GNSS_GAIN = slice(0, 4), -5.0
# How well the time of a jump is known, about.
UNSURE_S = 0.5
# So near to the end a jump looks like a single odd fix.
FRESH_S = 0.3
# Searches in vain, one a second, after which they become rare: aids that stay bad must not cost minutes.
VAIN_SEARCHES = 5
# Seconds between rare searches. Windows have to overlap by what a jump needs to show: of 300 made jumps all are found,
# with windows that only meet 64 %.
SHOWN_S = 3.0
SLOW_SEARCH_S = int(WINDOW_S - SHOWN_S)


def filtered(runner: Runner, schedule: Schedule, begin: StartState, par: Settings) -> tuple[Pass, tuple[Jump, ...]]:
    """Run forward with jumps of the gyro bias where the innovations grow; return the pass and the jumps."""
    schedule = replace(schedule, jump=schedule.jump.copy())
    found, state = runner.begun(schedule, begin)
    when = runner.inputs.sensed_at[schedule.node_at]
    bounds = unique(np.append(np.searchsorted(when, np.arange(when[0], when[-1], EVERY_S)), [0, len(when)]))
    begun: list[tuple[int, State]] = []
    accepted: list[Jump] = []
    grown, origin, end, used = 0, 0, 0, 0
    for second, (a, b) in enumerate(pairwise(bounds.tolist())):
        begun.append((a, state.copy()))
        while when[b - 1] - when[begun[0][0]] > WINDOW_S:
            begun.pop(0)
        first, before = begun[0]
        if b > end:  # of hours only some seconds are kept: the window is run again into an empty store
            origin, end = first, max(b, int(np.searchsorted(when, when[a] + KEPT_S)))
            store = runner.storage(schedule, origin, end)
            used = runner.run(origin, a, found, before.copy(), begin, par, None, store)
            run = runner.bound(found, state, begin, par, None, store)
        used = run(a, b, origin, used)
        grown = grown + 1 if innovations_grew(found.ratio[a:b]) else 0
        if grown < GROWN_S or (grown >= GROWN_S + VAIN_SEARCHES and second % SLOW_SEARCH_S):
            continue
        gain, size = gains(runner.shocks(schedule, par, store, origin, first, b))
        rate = np.sqrt(np.sum(size**2, axis=1))
        gain[(when[first:b] > when[b - 1] - FRESH_S) | (rate < MIN_JUMP_RAD_S)] = -np.inf
        k = int(np.argmax(gain))
        if gain[k] < ONLINE_MIN_GAIN or rate[k] > ONLINE_MAX_JUMP_RAD_S or len(accepted) == MAX_JUMPS:
            continue
        opened = replace(schedule, jump=schedule.jump.copy())
        opened.jump[first + k] = JUMP_RAD_S
        after, with_it = runner.run_again(opened, begin, par, before, first, b)
        if after.memory[MEM.likelihood] - state.memory[MEM.likelihood] < ONLINE_MIN_GAIN:
            continue
        without = likelihoods(store, int(store.update_of[first - origin]), used)
        if np.sum((with_it - without)[GNSS]) < GNSS_GAIN:
            continue
        for i in range(3):  # what it turned while its time is unsure
            after.P[(runner.row + 1) * (E.phi + i)] += (UNSURE_S * size[k, i]) ** 2
        for old, new in zip(state, after, strict=True):
            old[:] = new
        schedule.jump[:] = opened.jump
        begun.clear()
        grown, end = 0, 0
        accepted.append(Jump(float(when[first + k]), 0.0, size[k], np.zeros(3)))
    found.memory = state.memory
    return found, tuple(accepted)


def innovations_grew(ratio: Array) -> bool:
    """Return whether velocities or fields did not fit of late; ``ratio`` (k, 4) at some nodes, NaN without an aid."""
    for column in (0, 3):
        known = ratio[np.isfinite(ratio[:, column]), column]
        if len(known) and float(np.mean(np.minimum(known, 9.0))) > LARGE_INNOVATION:
            return True
    return False
