"""What the slow sensors share: samples at their own instants out of a motion that is still growing."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.simulate.flight import Truth
from attlog.simulate.physics.streams import generator
from attlog.simulate.scenario.scenario import Scenario
from attlog.simulate.sensors.settings import Span
from attlog.simulate.sensors.timing import instants, kept

Array = NDArray[np.float64]


def at(x: Array, t: Array, period: float) -> Array:
    """Rows of ``x`` (n, ...), taken every ``period`` s from 0 on, interpolated at times ``t`` (m,) s."""
    where = t / period
    low = np.minimum(where.astype(int), len(x) - 2)
    u = (where - low).reshape(-1, *[1] * (x.ndim - 1))
    between: Array = x[low] * (1.0 - u) + x[low + 1] * u
    return between


def attitude_at(q: Array, t: Array, period: float) -> Array:
    """Attitudes (m, 4) at ``t`` (m,) s; the chord between two periods of a loop is the arc to 1e-6 rad and less."""
    return rotation.normalize(at(q, t, period))


class SlowSensor(ABC):
    """Instance ``number`` of a ``kind``: when it measures, when that arrives, what has been told."""

    def __init__(
        self,
        kind: str,
        number: int,
        scenario: Scenario,
        seed: int,
        rate_hz: float,
        jitter_s: float,
        delay_s: float,
        loss_pct: float = 0.0,
        gaps: tuple[Span, ...] = (),
        hidden_delay_s: float = 0.0,
    ) -> None:
        timing = generator(seed, kind, number, "timing")
        phase = float(timing.uniform(0.1, 1.0))
        self.instants = instants(rate_hz, scenario.seconds, jitter_s, timing, phase)
        self.due: list[float] = [*self.instants.tolist(), math.inf]
        self.kept = kept(self.instants, loss_pct, gaps, generator(seed, kind, number, "loss"))
        self.t_sample = self.instants + hidden_delay_s
        self.t = self.t_sample + delay_s
        self.period = 1.0 / scenario.loop.rate_hz
        self.scenario, self.seed, self.number = scenario, seed, number
        self.faults = [f for f in scenario.fault if f.part == kind and f.instance == number]
        self.next, self.told = 0, 0

    def advance(self, truth: Truth, now: float) -> None:
        """Measure everything whose instant is not after ``now``, the last row of ``truth`` that is there."""
        if self.due[self.next] <= now + 1e-9:
            end = int(np.searchsorted(self.instants, now + 1e-9, side="right"))
            self.measure(truth, np.arange(self.next, end))
            self.next = end

    @abstractmethod
    def measure(self, truth: Truth, k: NDArray[np.int64]) -> None:
        """Make the samples of the indices ``k`` (m,)."""

    def arrived(self, now: float) -> int | None:
        """The newest sample that arrived since it was last asked, None if there is none."""
        found = None
        while self.told < self.next and self.t[self.told] <= now + 1e-9:
            found = self.told if self.kept[self.told] else found
            self.told += 1
        return found
