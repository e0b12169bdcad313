"""One run of the filter over a whole log, and back: what a pass finds.

The way back needs what the way forth stored, a quarter of a megabyte per second of flight. A long log is therefore
run in parts: the filter keeps its state at the beginning of each, and each part is run again just before the way back
through it. Memory is bounded by one part, and the result is the same to the bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.jit.kernel import function_of
from attlog.estimators.filters.navigation import backward, forward
from attlog.estimators.filters.navigation.inputs import Inputs
from attlog.estimators.filters.navigation.model import (
    FROZEN,
    GROUPS,
    LIKELIHOOD,
    MEMORY,
    ROW,
    SUMS,
    WIDE,
    N,
    padded,
    square,
)
from attlog.estimators.filters.navigation.schedule import Schedule, Timetable
from attlog.estimators.filters.navigation.start import StartState
from attlog.estimators.interface import Array

PART_NODES = 20_000
"""Some 200 s of flight: 60 MB."""


@dataclass(slots=True)
class Pass:
    """``q`` (n, 4) filtered at every sample; at the nodes (m,): ``bias``, ``variance`` (m, 3), ``ratio`` (m, 4).

    After the way back also ``d`` (m, 6) smoothed error of attitude and gyro bias, ``spread`` (m, 3) smoothed variance
    of the attitude; ``score``, ``group``, ``soft`` of every scalar update; ``scores`` (2, 39) of the process noise;
    ``first`` (39,) the smoothed error of the start state, ``first_spread`` its variance.
    """

    schedule: Schedule
    q: Array
    bias: Array
    variance: Array
    ratio: Array
    memory: Array
    d: Array = field(default_factory=lambda: np.zeros((0, 6)))
    spread: Array = field(default_factory=lambda: np.zeros((0, 3)))
    score: Array = field(default_factory=lambda: np.zeros(0))
    group: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, np.int8))
    soft: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, np.int8))
    scores: Array = field(default_factory=lambda: np.zeros((2, N)))
    shocks: Array = field(default_factory=lambda: np.zeros((0, 12)))
    first: Array = field(default_factory=lambda: np.zeros(N))
    first_spread: Array = field(default_factory=lambda: np.zeros(N))

    @property
    def likelihood(self) -> float:
        """Logarithm of the likelihood of all innovations, without constants."""
        return float(self.memory[LIKELIHOOD])

    def smoothed_nodes(self) -> Array:
        """Smoothed attitude (m, 4) at the nodes."""
        q = rotation.multiply(rotation.from_rotvec(self.d[:, 0:3]), self.q[self.schedule.node_at])
        return np.ascontiguousarray(rotation.normalize(q))


class Runner:
    """Runs over one set of inputs; keeps the storage and the times that passes share."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs
        self.timetable = Timetable(inputs)
        self.store: dict[str, Array] = {}

    def forward(self, schedule: Schedule, begin: StartState, par: Array, along: Array | None = None) -> Pass:
        """The way forth alone; ``par`` (k,) see layout, ``along`` (m, 4) the trajectory of linearisation at nodes."""
        found, state = self.begun(schedule, begin)
        self.run(0, len(schedule.node_at), found, state, begin, par, along, None)
        return found

    def both(
        self, schedule: Schedule, begin: StartState, par: Array, along: Array | None = None, spread: bool = True
    ) -> Pass:
        """Forth and back. ``along`` (m, 4): attitudes at the nodes about which it is linearised.

        ``spread``: whether the smoothed variance of the attitude is asked for; else it is not found.
        """
        found, state = self.begun(schedule, begin)
        m = len(schedule.node_at)
        parts = [(a, min(a + PART_NODES, m)) for a in range(0, m, PART_NODES)]
        saved = []
        for a, b in parts:
            saved.append([x.copy() for x in state])
            if b < m:
                self.run(a, b, found, state, begin, par, along, None)
        found.d, found.spread, found.shocks = np.empty((m, 6)), np.empty((m, 3)), np.empty((m, 12))
        lam, Lam = np.zeros(ROW), np.zeros(N * ROW)
        told: list[tuple[Array, Array, Array]] = []
        for (a, b), kept in zip(reversed(parts), reversed(saved), strict=True):
            store = self._storage(schedule, a, b)
            used = self.run(a, b, found, kept, begin, par, along, store)
            if b == m:
                found.memory = kept[3]
            score = np.zeros(used)
            self._back(a, b, found, par, store, lam, Lam, score, a == 0, spread)
            told.append((score, store["group"][:used].copy(), store["soft"][:used].copy()))
        # lam and Lam now stand before the updates of the first node, whose covariance is the prior's.
        found.first = -begin.P @ lam[:N]
        found.first_spread = np.diag(begin.P) - np.einsum("ij,ij->i", begin.P @ square(Lam), begin.P)
        found.score, found.group, found.soft = (np.concatenate(x) for x in zip(*reversed(told), strict=True))
        return found

    def shocks(
        self, schedule: Schedule, begin: StartState, par: Array, state: list[Array], a: int, b: int
    ) -> tuple[Array, list[Array], Array]:
        """Scores (b - a, 12) of a shock of the gyro bias at the nodes a to b, by what came up to b alone.

        ``state`` is that before node a, which stays; returned are also the state after node b - 1 and the logarithm of
        the likelihood (8,) of the innovations of each group.
        """
        # Of a long run only these nodes' share of the memory is ever touched.
        n, m = len(self.inputs.t), len(schedule.node_at)
        q, ratio = np.empty((n, 4)), np.empty((m, 4))
        found = Pass(schedule, q, np.empty((m, 3)), np.empty((m, 3)), ratio, state[3])
        found.d, found.spread, found.shocks = np.empty((m, 6)), np.empty((m, 3)), np.empty((m, 12))
        state, store = [x.copy() for x in state], self._storage(schedule, a, b)
        used = self.run(a, b, found, state, begin, par, None, store)
        self._back(a, b, found, par, store, np.zeros(ROW), np.zeros(N * ROW), np.zeros(used), a == 0, False)
        s, nu = store["s_of"][:used], store["nu_of"][:used]
        told = store["group"][:used]
        by_group = np.array([-0.5 * np.sum((nu * nu / s + np.log(s))[told == g]) for g in range(GROUPS)])
        return found.shocks[a:b], state, by_group

    def begun(self, schedule: Schedule, begin: StartState) -> tuple[Pass, list[Array]]:
        """A pass with nothing in it yet, and the state that :meth:`run` carries on in place."""
        n, m = len(self.inputs.t), len(schedule.node_at)
        memory = np.zeros(MEMORY)
        memory[FROZEN : FROZEN + 4] = begin.q
        found = Pass(schedule, np.empty((n, 4)), np.empty((m, 3)), np.empty((m, 3)), np.full((m, 4), np.nan), memory)
        return found, [begin.q.copy(), begin.x.copy(), padded(begin.P), memory]

    def run(
        self,
        a: int,
        b: int,
        found: Pass,
        state: list[Array],
        begin: StartState,
        par: Array,
        along: Array | None,
        store: dict[str, Array] | None,
    ) -> int:
        """The way forth over the nodes a to b, which the kernel describes; returns the updates kept in ``store``."""
        s, i = found.schedule, self.inputs
        keep = store is not None
        store = self._storage(s, 0, 0) if store is None else store
        q, x, P, memory = state
        used = function_of(forward.FORWARD_KERNEL, forward.forward)(
            a,
            b,
            i.dt,
            i.gyr,
            i.acc,
            i.rest,
            s.node_at,
            s.node_event,
            s.kind,
            s.offset,
            s.z,
            s.f_mean,
            s.w_mean,
            s.sigma,
            s.jump,
            par,
            np.zeros((1, 4)) if along is None else along,
            along is not None,
            begin.x,
            q,
            x,
            P,
            memory,
            found.q,
            found.bias,
            found.variance,
            found.ratio,
            keep,
            store["P_rows"],
            store["sums"],
            store["update_of"],
            store["K"],
            store["H"],
            store["H_at"],
            store["wide_of"],
            store["s_of"],
            store["nu_of"],
            store["r_of"],
            store["group"],
            store["soft"],
        )
        return int(used)

    def _back(
        self,
        a: int,
        b: int,
        found: Pass,
        par: Array,
        store: dict[str, Array],
        lam: Array,
        Lam: Array,
        score: Array,
        gone: bool,
        wanted: bool,
    ) -> None:
        """The way back through the nodes a to b, which ``store`` holds; ``lam``, ``Lam`` are carried on in place."""
        function_of(backward.BACKWARD_KERNEL, backward.backward)(
            b - a,
            np.ascontiguousarray(found.schedule.rest_of[a:b]),
            par,
            store["P_rows"],
            store["sums"],
            store["update_of"],
            store["K"],
            store["H"],
            store["H_at"],
            store["wide_of"],
            store["s_of"],
            store["nu_of"],
            lam,
            Lam,
            found.d[a:b],
            found.spread[a:b],
            score,
            found.scores,
            found.shocks[a:b],
            gone,
            wanted,
        )

    def _storage(self, s: Schedule, a: int, b: int) -> dict[str, Array]:
        """Arrays large enough for the nodes a to b; used again."""
        nodes, updates = max(b - a, 1), max(int(s.scalars[b] - s.scalars[a]), 1)
        shapes: dict[str, tuple[tuple[int, ...], type, Callable[..., Array]]] = {
            "P_rows": ((nodes * 6 * ROW,), np.float64, np.empty),
            "sums": ((nodes, SUMS), np.float64, np.empty),
            "update_of": ((nodes + 1,), np.int64, np.zeros),
            "K": ((updates * ROW,), np.float64, np.empty),
            "H": ((updates, WIDE), np.float64, np.empty),
            "H_at": ((updates, WIDE), np.int8, np.empty),
            "wide_of": ((updates,), np.int8, np.empty),
            "s_of": ((updates,), np.float64, np.empty),
            "nu_of": ((updates,), np.float64, np.empty),
            "r_of": ((updates,), np.float64, np.empty),
            "group": ((updates,), np.int8, np.empty),
            "soft": ((updates,), np.int8, np.empty),
        }
        for name, (shape, kind, make) in shapes.items():
            have = self.store.get(name)
            if have is None or len(have) < shape[0]:
                self.store[name] = make(shape, kind)
        return self.store
