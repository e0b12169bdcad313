"""Nodes of the filter and the events at each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.filters.navigation.inputs import (
    JUMP_RAD_S,
    NODE_S,
    REST_EVERY_S,
    REST_MEAN_S,
    Inputs,
    NoiseLevels,
    RunningMean,
)
from attlog.estimators.filters.navigation.model import BARO, MAG, NO_RATE, POSITION, STILL, VELOCITY, Events
from attlog.estimators.interface import Array

# Half widths of the centred means in an event's rows.
FORCE_S, RATE_S = 0.05, 0.03
TIE_S = 1e-6
SETTLE_MORE, SETTLE_S = 10.0, 3.0
Ints = NDArray[np.int64]


@dataclass(slots=True)
class Schedule:
    """Nodes (m,) and their events: sample and first event (m + 1,) of each node, rest in the interval before it.

    ``scalars`` (m + 1,): how many scalar updates the events before each node can make; ``jump`` (m,) rad/s by which the
    gyro bias may jump there, one sigma.
    """

    node_at: Ints
    node_event: Ints
    events: Events
    rest_of: NDArray[np.int8]
    scalars: Ints
    jump: Array

    def nodes(self) -> Schedule:
        """Return the nodes without the events, where nothing runs again."""
        no_events = Events._make(x[:0].copy() for x in self.events)
        return replace(self, node_event=0 * self.node_event, events=no_events, scalars=0 * self.scalars)


@dataclass(slots=True)
class PlacedEvents:
    """Events of one kind at their samples: ``at`` (e,), ``offset`` (e,) s, ``z`` (e, 3).

    ``shape`` (e, 3) of the noise around one, 0 for a missing component; centred means ``force``, ``rate`` (e, 3), 0
    where no row needs them.
    """

    kind: int
    when: Array
    at: Ints
    offset: Array
    z: Array
    shape: Array
    force: Array
    rate: Array


class Timetable:
    """The schedules of one run. What they share is made once: of a search for a delay only the fixes move."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs
        self.t = inputs.sensed_at
        self.looks = rest_times(inputs)
        self.force = RunningMean(self.t, inputs.acc)
        self.rate = RunningMean(self.t, inputs.gyr)
        self.resting_rate = self.rate.mean(self.looks - REST_MEAN_S, self.looks)
        self.kept: dict[int, tuple[float, PlacedEvents]] = {}
        self.jumps: tuple[float, ...] = ()

    def scheduled(
        self,
        tuned: NoiseLevels,
        settling: bool = False,
        within: tuple[float, float] | None = None,
        every: float = NODE_S,
        once: bool = False,
    ) -> Schedule:
        """Place every aid at the sample next to its time, with nodes at least ``every`` s.

        ``settling``: aids count less in the first seconds, for a filter that starts degrees off would else be sure of
        what it linearised there. ``within``: of the fixes only those stamped in this span. ``once``: nothing will be
        asked any more, so that what is made goes as it is used: of hours as much as the schedule.
        """
        placed = self._placed(tuned, within)
        if once:
            self.kept.clear()
            del self.force, self.rate
        ends = np.cumsum([0, *(len(p.at) for p in placed)])
        place = np.empty(ends[-1], np.int64)
        place[np.argsort(np.concatenate([np.zeros(0, np.int64), *(p.at for p in placed)]), kind="stable")] = np.arange(
            ends[-1]
        )

        def gathered(name: str, *shape: int, dtype: type = np.float64) -> NDArray[Any]:
            """Gather a column of all events in order; with ``once`` it is dropped from the kinds."""
            out: NDArray[Any] = np.empty((len(place), *shape), dtype)
            for p, a, b in zip(placed, ends[:-1], ends[1:], strict=True):
                out[place[a:b]] = getattr(p, name)
                if once:
                    delattr(p, name)
            return out

        levels = _noise_by_event(tuned)
        kind, at = gathered("kind", dtype=np.int64), gathered("at", dtype=np.int64)
        sigma = gathered("shape", 3)
        for one, level in levels.items():
            sigma[kind == one] *= level
        if settling:
            sigma *= (1.0 + SETTLE_MORE * np.exp(-(gathered("when") - self.t[0]) / SETTLE_S))[:, None]
        nodes = self._nodes(at, every)
        scalars = np.concatenate([[0], np.cumsum(np.where(kind == BARO, 1, 3))])
        node_event = np.append(np.searchsorted(at, nodes), len(at)).astype(np.int64)
        return Schedule(
            nodes,
            node_event,
            Events(kind, gathered("offset"), gathered("z", 3), gathered("force", 3), gathered("rate", 3), sigma),
            np.ascontiguousarray(self.inputs.rest[nodes]),
            scalars[node_event].astype(np.int64),
            self.jumps_at(nodes, self.jumps),
        )

    def _placed(self, tuned: NoiseLevels, within: tuple[float, float] | None) -> list[PlacedEvents]:
        """Return the events of each kind, in order of the kinds."""
        i = self.inputs
        out = []
        for kind, m, columns in ((VELOCITY, i.velocity, [0, 0, 0]), (POSITION, i.position, [0, 0, 1])):
            m = m if m is None or within is None else m.between(*within)
            if m is not None:
                assert m.sigma is not None
                out.append(self._place(kind, m.t - tuned.gnss_delay, m.x, m.sigma[:, columns]))
        if i.baro is not None:
            m = i.baro
            out.append(self._once(BARO, 0.0, m.t, _wide(m.x), _same([1.0, 0.0, 0.0], len(m.t))))
        if i.mag is not None:
            out.append(self._once(MAG, tuned.mag_delay, i.mag.t, i.mag.x, _same([1.0, 1.0, 1.0], len(i.mag.t))))
        if len(self.looks):
            ones = _same([1.0, 1.0, 1.0], len(self.looks))
            out.append(self._once(STILL, 0.0, self.looks, 0.0 * ones, ones))
            out.append(self._once(NO_RATE, 0.0, self.looks, self.resting_rate, ones))
        return out

    def _once(self, kind: int, delay: float, when: Array, z: Array, shape: Array) -> PlacedEvents:
        """Return events that move only with their delay."""
        if kind not in self.kept or self.kept[kind][0] != delay:
            self.kept[kind] = delay, self._place(kind, when - delay, z, shape)
        return self.kept[kind][1]

    def _place(self, kind: int, when: Array, z: Array, shape: Array) -> PlacedEvents:
        t = self.t
        missing = ~np.isfinite(z)
        if missing.any():
            shape, z = np.where(missing, 0.0, shape), np.where(missing, 0.0, z)
        inside = (when >= t[0]) & (when <= t[-1])
        if not inside.all():
            when, z, shape = when[inside], z[inside], shape[inside]
        at = np.clip(np.searchsorted(t, when), 1, max(len(t) - 1, 1))
        # Of two samples as near the earlier one, whatever rounding says.
        at = np.where((when - t[at - 1]) < (t[np.minimum(at, len(t) - 1)] - when) + TIE_S, at - 1, at)
        if (np.diff(at) < 0).any():
            order = np.argsort(at, kind="stable")
            when, at, z, shape = when[order], at[order], z[order], shape[order]
        centre, some, none = t[at], len(t) > 1, _same([0.0, 0.0, 0.0], len(at))
        force = self.force.mean(centre - FORCE_S, centre + FORCE_S) if kind == VELOCITY and some else none
        rate = self.rate.mean(centre - RATE_S, centre + RATE_S) if kind in (VELOCITY, MAG) and some else none
        return PlacedEvents(kind, when, at, when - centre, z, shape, force, rate)

    def jumps_at(self, nodes: Ints, jumps: tuple[float, ...]) -> Array:
        """Return how far the gyro bias may jump at each node (m,), the first at or after each time ``jumps`` in s."""
        out = np.zeros(len(nodes))
        at = np.searchsorted(self.t[nodes], np.array(jumps) - TIE_S)
        out[at[at < len(nodes)]] = JUMP_RAD_S
        return out

    def _nodes(self, at: Ints, every: float) -> Ints:
        """Select samples with events, the ends, where rest begins and ends, and enough others."""
        rest = self.inputs.rest
        node = np.zeros(len(self.t), bool)
        node[at] = True
        node[:-1] |= rest[1:] != rest[:-1]
        node[[0, -1]] = True
        # Whatever the events, a sample ends each slot of time that holds no event itself.
        number = np.floor((self.t - self.t[0]) / every + 1e-6)
        ends = np.append(np.flatnonzero(np.diff(number) > 0), len(number) - 1)
        nodes_before = np.concatenate([[0], np.cumsum(node)])
        begins = np.append(0, ends[:-1] + 1)
        node[ends[nodes_before[ends + 1] == nodes_before[begins]]] = True
        return np.flatnonzero(node)


def scheduled(inputs: Inputs, tuned: NoiseLevels, settling: bool = False) -> Schedule:
    """Return the schedule of a run that needs only one."""
    return Timetable(inputs).scheduled(tuned, settling)


def _noise_by_event(tuned: NoiseLevels) -> dict[int, Array]:
    """Return the noise (3,) of each kind of events."""
    r = tuned.r
    return {
        VELOCITY: r[[0, 0, 1]],
        POSITION: r[[2, 2, 3]],
        BARO: np.full(3, r[4]),
        MAG: np.full(3, r[5]),
        STILL: np.full(3, r[7]),
        NO_RATE: np.full(3, r[6]),
    }


def rest_times(inputs: Inputs) -> Array:
    """Return times at rest, five a second, of zero-velocity updates."""
    t = inputs.sensed_at
    at = np.flatnonzero(inputs.rest == 1)
    if len(at) == 0:
        return np.zeros(0)
    slot = np.floor((t[at] - t[0]) / REST_EVERY_S).astype(np.int64)
    last = at[np.flatnonzero(np.r_[np.diff(slot) > 0, True])]
    whole: Array = t[last][t[last] - t[0] >= REST_MEAN_S]
    return whole


def _same(row: list[float], n: int) -> Array:
    """Repeat one row (3,) n times, to be read."""
    return np.broadcast_to(row, (n, 3))


def _wide(x: Array) -> Array:
    return np.column_stack([x, np.zeros((len(x), 2))])
