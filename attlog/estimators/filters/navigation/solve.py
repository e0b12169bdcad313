"""One pass: the filter forward over a whole log, and back.

The way back needs what the way forth stored, a quarter of a megabyte per second of flight. A long log is therefore
run in parts: the filter keeps its state at the beginning of each, and each part is run again just before the way back
through it. Memory is bounded by one part, and the result is the same to the bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.jit import aligned_zeros
from attlog.estimators.filters.navigation import backward, forward
from attlog.estimators.filters.navigation.inputs import Inputs
from attlog.estimators.filters.navigation.model import (
    GROUPS,
    MAG,
    MEM,
    MEMORY,
    ROW,
    SUMS,
    WIDE,
    WITHOUT_COMPASS,
    Filtered,
    Kept,
    N,
    Nodes,
    Settings,
    State,
    padded,
    square,
)
from attlog.estimators.filters.navigation.schedule import Schedule, Timetable
from attlog.estimators.filters.navigation.start import StartState
from attlog.estimators.interface import Array

# Some 200 s of flight: 60 MB.
PART_NODES = 20_000


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
        """Log likelihood of all innovations, without constants."""
        return float(self.memory[MEM.likelihood])

    def smoothed_nodes(self) -> Array:
        """Return smoothed attitude (m, 4) at the nodes."""
        q = rotation.multiply(rotation.from_rotvec(self.d[:, 0:3]), self.q[self.schedule.node_at])
        return np.ascontiguousarray(rotation.normalize(q))


class Runner:
    """Runs over one set of inputs; keeps the storage and the times that passes share."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs
        self.timetable = Timetable(inputs)
        self.store: Kept | None = None
        compass = inputs.mag is not None
        self.states, self.row = (N, ROW) if compass else (WITHOUT_COMPASS["N"], WITHOUT_COMPASS["ROW"])
        self.forward_loop = forward.forward if compass else forward.forward_without_compass
        self.backward_loop = backward.backward if compass else backward.backward_without_compass

    def forward(self, schedule: Schedule, begin: StartState, par: Settings, along: Array | None = None) -> Pass:
        """Run forward alone; ``along`` (m, 4) is the trajectory of linearisation at nodes."""
        found, state = self.begun(schedule, begin)
        self.run(0, len(schedule.node_at), found, state, begin, par, along, None)
        return found

    def both(
        self, schedule: Schedule, begin: StartState, par: Settings, along: Array | None = None, spread: bool = True
    ) -> Pass:
        """Run forward and back. ``along`` (m, 4): attitudes at the nodes about which it is linearised.

        ``spread``: whether the smoothed variance of the attitude is asked for; else it is not found.
        """
        found, state = self.begun(schedule, begin)
        m = len(schedule.node_at)
        parts = [(a, min(a + PART_NODES, m)) for a in range(0, m, PART_NODES)]
        saved = []
        for a, b in parts:
            saved.append(state.copy())
            if b < m:
                self.run(a, b, found, state, begin, par, along, None)
        found.d, found.spread, found.shocks = np.empty((m, 6)), np.empty((m, 3)), np.empty((m, 12))
        adjoint = backward.Adjoint(aligned_zeros(self.row), aligned_zeros(self.states * self.row))
        outputs: list[tuple[NDArray[Any], ...]] = []
        for (a, b), kept in zip(reversed(parts), reversed(saved), strict=True):
            store = self.storage(schedule, a, b)
            used = self.run(a, b, found, kept, begin, par, along, store)
            if b == m:
                found.memory = kept.memory
            score = np.zeros(used)
            self._back(a, b, found, par, store, adjoint, score, spread)
            outputs.append((score, store.group[:used].copy(), store.soft[:used].copy()))
        # The adjoint is now that before the updates of the first node, whose covariance is the prior's.
        found.first = -begin.P[:, : self.states] @ adjoint.lam[:-1]
        found.first_spread = np.diag(begin.P) - np.einsum(
            "ij,ij->i", begin.P @ square(adjoint.Lam, self.states), begin.P
        )
        found.score, found.group, found.soft = (np.concatenate(x) for x in zip(*reversed(outputs), strict=True))
        return found

    def shocks(self, schedule: Schedule, par: Settings, store: Kept, origin: int, a: int, b: int) -> Array:
        """Return scores (b - a, 12) of a shock of the gyro bias at the nodes a to b, from data up to b alone.

        ``store`` holds them, counted from the node ``origin``.
        """
        at, count = a - origin, b - a
        used = int(store.update_of[b - origin])
        shocks = np.empty((count, 12))
        out = backward.Smoothed(np.empty((count, 6)), np.empty((count, 3)), np.empty(used), np.zeros((2, N)), shocks)
        adjoint = backward.Adjoint(aligned_zeros(self.row), aligned_zeros(self.states * self.row))
        own = store._replace(
            P_rows=store.P_rows[6 * self.row * at :], sums=store.sums[at:], update_of=store.update_of[at:]
        )
        rest_of = np.ascontiguousarray(schedule.rest_of[a:b])
        self.backward_loop(a == 0, False, par, rest_of, own, adjoint, out, backward.new_work())
        return shocks

    def run_again(
        self, schedule: Schedule, begin: StartState, par: Settings, before: State, a: int, b: int
    ) -> tuple[State, Array]:
        """Run the nodes a to b from the state ``before``, which stays; return the state after and the likelihoods."""
        found, state = self.begun(schedule, begin)[0], before.copy()
        store = empty_store(b - a, int(schedule.scalars[b] - schedule.scalars[a]), self.row)
        used = self.run(a, b, found, state, begin, par, None, store)
        return state, likelihoods(store, 0, used)

    def begun(self, schedule: Schedule, begin: StartState) -> tuple[Pass, State]:
        """Return an empty pass, and the state that :meth:`run` carries on in place."""
        # Machine code would write the compass's states beyond a covariance that lacks them.
        assert self.states == N or not (schedule.events.kind == MAG).any()
        n, m = len(self.inputs.t), len(schedule.node_at)
        memory = np.zeros(MEMORY)
        memory[MEM.frozen : MEM.frozen + 4] = begin.q
        found = Pass(schedule, np.empty((n, 4)), np.empty((m, 3)), np.empty((m, 3)), np.full((m, 4), np.nan), memory)
        return found, State(begin.q.copy(), begin.x.copy(), padded(begin.P, self.states), memory)

    def run(
        self,
        a: int,
        b: int,
        found: Pass,
        state: State,
        begin: StartState,
        par: Settings,
        along: Array | None,
        store: Kept | None,
    ) -> int:
        """Run forward over the nodes a to b; return how many updates are in ``store``."""
        run = self.bound(found, state, begin, par, along, store)
        return run(a, b, -1 if store is None else a, 0)

    def bound(
        self, found: Pass, state: State, begin: StartState, par: Settings, along: Array | None, store: Kept | None
    ) -> Callable[[int, int, int, int], int]:
        """Return the run forward as a function of first and last node, the store's first, and updates in the store."""
        s = found.schedule
        return self.forward_loop.bound(
            ...,
            ...,
            ...,
            ...,
            along is not None,
            par,
            begin.x,
            self.inputs.motion,
            Nodes(s.node_at, s.node_event, s.jump, np.zeros((1, 4)) if along is None else along),
            s.events,
            state,
            Filtered(found.q, found.bias, found.variance, found.ratio),
            self.storage(s, 0, 0) if store is None else store,
            forward.new_row(),
            forward.new_work(),
        )

    def _back(
        self,
        a: int,
        b: int,
        found: Pass,
        par: Settings,
        store: Kept,
        adjoint: backward.Adjoint,
        score: Array,
        wanted: bool,
    ) -> None:
        """Go back through the nodes a to b, which ``store`` holds; ``adjoint`` is carried on in place."""
        rest_of = np.ascontiguousarray(found.schedule.rest_of[a:b])
        out = backward.Smoothed(found.d[a:b], found.spread[a:b], score, found.scores, found.shocks[a:b])
        self.backward_loop(a == 0, wanted, par, rest_of, store, adjoint, out, backward.new_work())

    def storage(self, s: Schedule, a: int, b: int) -> Kept:
        """Return arrays large enough for the nodes a to b; used again."""
        nodes, updates = max(b - a, 1), max(int(s.scalars[b] - s.scalars[a]), 1)
        have = self.store
        if have is None or len(have.sums) < nodes or len(have.s_of) < updates:
            if have is not None:
                nodes, updates = max(nodes, len(have.sums)), max(updates, len(have.s_of))
            self.store = have = None  # before the larger one: memory
            self.store = have = empty_store(nodes, updates, self.row)
        return have


def empty_store(nodes: int, updates: int, row: int) -> Kept:
    """Return arrays for what the way back needs of so many nodes and updates, with rows of so many numbers."""
    small = [np.empty(updates, np.int8) for _ in range(3)]
    return Kept(
        np.empty(nodes * 6 * row),
        np.empty((nodes, SUMS)),
        np.zeros(nodes + 1, np.int64),
        np.empty(updates * row),
        np.empty((updates, WIDE)),
        np.empty((updates, WIDE), np.int8),
        small[0],
        np.empty(updates),
        np.empty(updates),
        np.empty(updates),
        small[1],
        small[2],
    )


def likelihoods(store: Kept, a: int, b: int) -> Array:
    """Return the log likelihood (8,) of the updates a to b of each group."""
    s, nu, group = store.s_of[a:b], store.nu_of[a:b], store.group[a:b]
    return np.array([-0.5 * np.sum((nu * nu / s + np.log(s))[group == g]) for g in range(GROUPS)])
