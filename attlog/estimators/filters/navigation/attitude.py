"""From a pass to attitudes at the times they are asked for, and how sure they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.estimators.base import Array
from attlog.estimators.filters.navigation.ahead import RING
from attlog.estimators.filters.navigation.kernels import run_ahead
from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.solve import Pass

HONEST = 1.2
"""The model's own spread is that much too small (measured on flights with truth)."""
LEAST_TILT, LEAST_HEADING = np.deg2rad(0.03), np.deg2rad(0.04)
LEAST_TIME_S = 1.5e-3
BLOCK = 50_000
"""Samples worked on at once: a long log must not take many times its size."""


def node_before(found: Pass, n: int) -> NDArray[np.int64]:
    """The node (n,) at or before each of n samples."""
    return np.maximum(np.searchsorted(found.schedule.node_at, np.arange(n), side="right") - 1, 0)


def smoothed_samples(found: Pass, inputs: Inputs) -> tuple[Array, Array]:
    """Smoothed attitude (n, 4) and gyro bias (n, 3) of every sample.

    The filter's attitude, corrected by the smoothed error at the node before: corrections vary slowly, and the
    filter's own jumps cancel.
    """
    n = len(inputs.t)
    q, bias = np.empty((n, 4)), np.empty((n, 3))
    nodes, t = found.schedule.node_at, inputs.sensed_at
    for a in range(0, n, BLOCK):
        own = slice(a, min(a + BLOCK, n))
        k = np.maximum(np.searchsorted(nodes, np.arange(own.start, own.stop), side="right") - 1, 0)
        since = np.where(inputs.rest[own] == 1, 0.0, t[own] - t[nodes[k]])
        late = rotation.rotate(found.q[own], found.d[k, 3:6]) * since[:, None]
        turn = rotation.from_rotvec(found.d[k, 0:3] - late)
        q[own] = rotation.normalize(rotation.multiply(turn, found.q[own]))
        bias[own] = found.bias[k] + found.d[k, 3:6]
    return q, bias


def smoothed_nodes(found: Pass) -> Array:
    """Smoothed attitude (m, 4) at the nodes."""
    q = rotation.multiply(rotation.from_rotvec(found.d[:, 0:3]), found.q[found.schedule.node_at])
    return np.ascontiguousarray(rotation.normalize(q))


def at_stamps(inputs: Inputs, q: Array, bias: Array) -> Array:
    """Attitudes at the stamps from those at the times the samples were taken (a low-pass is late), by the gyro."""
    if inputs.lag == 0.0:
        return q
    sensed, out = inputs.sensed_at, np.empty_like(q)
    last = len(sensed) - 1
    for a in range(0, len(q), BLOCK):
        own = slice(a, a + BLOCK)
        k = np.clip(np.searchsorted(sensed, inputs.t[own], side="right") - 1, 0, last)
        turn = (inputs.gyr[np.minimum(k + 1, last)] - bias[k]) * (inputs.t[own] - sensed[k])[:, None]
        out[own] = rotation.normalize(rotation.multiply(q[k], rotation.from_rotvec(turn)))
    return out


def sigmas(inputs: Inputs, found: Pass, spread: Array) -> tuple[Array, Array]:
    """Standard deviations (n,) in rad of tilt and heading from variances (m, 3) of the attitude at the nodes."""
    at = inputs.sensed_at[found.schedule.node_at]
    rate = np.sqrt(np.sum(inputs.gyr**2, axis=1)) * LEAST_TIME_S
    three = [np.interp(inputs.t, at, np.maximum(spread[:, i], 0.0)) for i in range(3)]
    tilt = np.sqrt(HONEST**2 * (three[0] + three[1]) + LEAST_TILT**2 + rate**2)
    return tilt, np.sqrt(HONEST**2 * three[2] + LEAST_HEADING**2 + rate**2)


def test_ratios(found: Pass, n: int) -> dict[str, Array]:
    """Squared innovation over its gate (n,) of each aid, held from event to event; NaN before the first."""
    k = node_before(found, n)
    out = {}
    for i, name in enumerate(("velocity", "position", "baro", "mag")):
        column = found.ratio[:, i]
        known = np.isfinite(column)
        last = np.maximum.accumulate(np.where(known, np.arange(len(column)), -1))
        held = np.where(last >= 0, column[np.maximum(last, 0)], np.nan)
        if known.any():
            out[f"test_ratio_{name}"] = held[k]
    return out


def predicted(inputs: Inputs, q: Array, bias: Array, first_bias: Array, horizon: float) -> Array:
    """What a causal user knows at each stamp: the filter's attitude of ``horizon`` s before, carried on by the gyro.

    ``q`` (n, 4), ``bias`` (n, 3) of the filter at every sample; ``first_bias`` (3,) what was known at the start.
    """
    n, sensed = len(inputs.t), inputs.sensed_at
    then = np.maximum(np.searchsorted(sensed, inputs.t - horizon, side="right") - 1, 0)
    out, ring = np.empty((n, 4)), np.empty((int(np.max(np.arange(n) - then)) + 1, RING))
    run_ahead()(then, inputs.dt, inputs.gyr, inputs.rest, inputs.lag, q, bias, first_bias.copy(), ring, out)
    return out
