"""When the filter stops to look: nodes and the events at each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.dataclass import dataclass
from attlog.estimators.base import Array
from attlog.estimators.filters.navigation.layout import BARO, MAG, NO_RATE, POSITION, STILL, VELOCITY
from attlog.estimators.filters.navigation.measured import Inputs, Running
from attlog.estimators.filters.navigation.settings import NODE_S, REST_EVERY_S, REST_MEAN_S, Tuned

FORCE_S, RATE_S = 0.05, 0.03
"""Half widths of the centred means in an event's rows."""
NEAR_S, NEAR_M_S = 0.5, 1.0
"""Without GNSS: the vehicle stays near, told as a velocity of zero with this spread, so that gravity shows the tilt."""
TIE_S = 1e-6
SETTLE_MORE, SETTLE_S = 10.0, 3.0
Ints = NDArray[np.int64]


@dataclass(slots=True)
class Schedule:
    """Nodes and events as :func:`forward.forward` takes them; ``rest_of`` (m,) of the interval before each node."""

    node_at: Ints
    node_event: Ints
    kind: Ints
    offset: Array
    z: Array
    f_mean: Array
    w_mean: Array
    sigma: Array
    rest_of: NDArray[np.int8]
    scalars: Ints
    """(m + 1,) how many scalar updates the events before each node can make."""


def scheduled(inputs: Inputs, tuned: Tuned, settling: bool = False) -> Schedule:
    """Every aid at the sample next to when it was true, and nodes between them at least every 20 ms.

    ``settling``: aids count less in the first seconds, for a filter that starts degrees off would else be sure of
    what it linearised there.
    """
    t = inputs.sensed_at
    parts = []
    r = tuned.r
    if inputs.velocity is not None:
        m = inputs.velocity
        assert m.sigma is not None
        parts.append((VELOCITY, m.t - tuned.gnss_delay, m.x, m.sigma[:, :1] * [r[0], r[0], r[1]]))
    if inputs.position is not None:
        m = inputs.position
        assert m.sigma is not None
        s = np.column_stack([m.sigma[:, 0], m.sigma[:, 0], m.sigma[:, 1]]) * [r[2], r[2], r[3]]
        parts.append((POSITION, m.t - tuned.gnss_delay, m.x, s))
    if inputs.velocity is None and inputs.position is None:
        slow = np.arange(t[0] + NEAR_S, t[-1], NEAR_S)
        parts.append((VELOCITY, slow, np.zeros((len(slow), 3)), np.full((len(slow), 3), NEAR_M_S)))
    if inputs.baro is not None:
        m = inputs.baro
        parts.append((BARO, m.t, _wide(m.x), np.tile([r[4], 0.0, 0.0], (len(m.t), 1))))
    if inputs.mag is not None:
        m = inputs.mag
        parts.append((MAG, m.t - tuned.mag_delay, m.x, np.full((len(m.t), 3), r[5])))
    looks = rest_times(inputs)
    if len(looks):
        rate = Running(t, inputs.gyr).mean(looks - REST_MEAN_S, looks)
        parts.append((STILL, looks, np.zeros((len(looks), 3)), np.full((len(looks), 3), r[7])))
        parts.append((NO_RATE, looks, rate, np.full((len(looks), 3), r[6])))
    kind = np.concatenate([np.full(len(p[1]), p[0]) for p in parts]) if parts else np.zeros(0, np.int64)
    when = np.concatenate([p[1] for p in parts]) if parts else np.zeros(0)
    z = np.concatenate([p[2] for p in parts]) if parts else np.zeros((0, 3))
    sigma = np.concatenate([p[3] for p in parts]) if parts else np.zeros((0, 3))
    sigma = np.where(np.isfinite(z), sigma, 0.0)
    if settling:
        sigma = sigma * (1.0 + SETTLE_MORE * np.exp(-(when - t[0]) / SETTLE_S))[:, None]
    inside = (when >= t[0]) & (when <= t[-1])
    at = np.searchsorted(t, when)
    at = np.clip(at, 1, max(len(t) - 1, 1))
    # Of two samples as near the earlier one, whatever rounding says.
    at = np.where((when - t[at - 1]) < (t[np.minimum(at, len(t) - 1)] - when) + TIE_S, at - 1, at)
    order = np.flatnonzero(inside)
    order = order[np.lexsort((kind[order], at[order]))]
    kind, when, z, sigma, at = kind[order], when[order], np.nan_to_num(z[order]), sigma[order], at[order]
    offset = when - t[at]
    nodes = _nodes(t, inputs.rest, at)
    first = np.searchsorted(at, nodes)
    f_mean, w_mean = np.zeros((len(when), 3)), np.zeros((len(when), 3))
    if len(when) and len(t) > 1:
        centre = t[at]
        f_mean = Running(t, inputs.acc).mean(centre - FORCE_S, centre + FORCE_S)
        w_mean = Running(t, inputs.gyr).mean(centre - RATE_S, centre + RATE_S)
    scalars = np.concatenate([[0], np.cumsum(np.where(kind == BARO, 1, 3))])
    node_event = np.append(first, len(when)).astype(np.int64)
    return Schedule(
        nodes, node_event, kind.astype(np.int64), np.ascontiguousarray(offset), np.ascontiguousarray(z),
        np.ascontiguousarray(f_mean), np.ascontiguousarray(w_mean), np.ascontiguousarray(sigma),
        np.ascontiguousarray(inputs.rest[nodes]), scalars[node_event].astype(np.int64),
    )  # fmt: skip


def rest_times(inputs: Inputs) -> Array:
    """Times at rest, five a second, at which the vehicle is told to stand."""
    t = inputs.sensed_at
    at = np.flatnonzero(inputs.rest == 1)
    if len(at) == 0:
        return np.zeros(0)
    slot = np.floor((t[at] - t[0]) / REST_EVERY_S).astype(np.int64)
    last = at[np.flatnonzero(np.r_[np.diff(slot) > 0, True])]
    whole: Array = t[last][t[last] - t[0] >= REST_MEAN_S]
    return whole


def _nodes(t: Array, rest: NDArray[np.int8], at: Ints) -> Ints:
    """Samples with events, the ends, where rest begins and ends, and enough others."""
    change = np.flatnonzero(np.diff(rest) != 0)
    fixed = np.unique(np.concatenate([at, change, [0, len(t) - 1]]))
    slot = np.floor((t - t[0]) / NODE_S + 1e-6).astype(np.int64)
    # Whatever the events, a sample ends each slot of 20 ms that holds no event itself.
    last = np.flatnonzero(np.r_[np.diff(slot) > 0, True])
    free = last[~np.isin(slot[last], slot[fixed])]
    return np.union1d(fixed, free).astype(np.int64)


def _wide(x: Array) -> Array:
    return np.column_stack([x, np.zeros((len(x), 2))])
