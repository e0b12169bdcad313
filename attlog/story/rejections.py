"""What the onboard estimator rejected in flight: one source for the events and for the checks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.flight.model import FlightLog, InnovationTest
from attlog.segments.airborne.grid import runs
from attlog.segments.model import Segments
from attlog.segments.spans import Span, inside
from attlog.story.event import Event

LEAST_S = 1.0
"""Rejected for this long without a break: single outliers are what the test is for."""
AFTER_S = 1.0
"""Both ends of a flight: the ground pushes there, and a blow reaches back through records of 5 Hz."""


@dataclass(frozen=True, slots=True)
class Rejection:
    """When an aid was rejected (spans of a second and more), how far beyond its gate at most, and by which record."""

    aid: str
    spans: list[Span]
    worst: float
    source: str
    seconds_flown: float

    @property
    def seconds(self) -> float:
        """In all, s."""
        return float(sum(b - a for a, b in self.spans))

    @property
    def longest(self) -> float:
        """The longest without a break, s."""
        return max((b - a for a, b in self.spans), default=0.0)

    @property
    def text(self) -> str:
        """A sentence with all of it."""
        first, last = self.spans[0][0], self.spans[-1][1]
        parts = f" in {len(self.spans)} parts of {LEAST_S:.0f} s and more ({self.longest:.0f} s on end)"
        times = parts if len(self.spans) > 1 else ""
        return (
            f"The EKF rejected its {self.aid} for {self.seconds:.0f} s of {self.seconds_flown:.0f}{times}, "
            f"{first:.1f} to {last:.1f} s, by up to {self.worst:.1f} times its limit ({self.source})."
        )


def tested(log: FlightLog, segments: Segments) -> list[Rejection]:
    """Of each aid whose ratio was logged in flight, what was rejected there (maybe nothing); never of a wreck."""
    spans = [(a + AFTER_S, b - AFTER_S) for a, b in segments.spans("airborne") if b - a > 2.0 * AFTER_S + LEAST_S]
    found = [_of(test, spans) for test in log.innovation_tests]
    return [one for one in found if one is not None]


def _of(test: InnovationTest, flown: list[Span]) -> Rejection | None:
    use = inside(test.t, flown) & np.isfinite(test.ratio)
    if np.count_nonzero(use) < 2:
        return None
    beyond = use & (test.ratio > 1.0)
    pairs = [(float(test.t[a]), float(test.t[b - 1])) for a, b in runs(beyond)]
    long = [(a, b) for a, b in pairs if b - a >= LEAST_S]
    worst = max((float(test.ratio[beyond & inside(test.t, [pair])].max()) for pair in long), default=0.0)
    return Rejection(test.aid, long, worst, test.source, float(sum(b - a for a, b in flown)))


def events(log: FlightLog, segments: Segments) -> list[Event]:
    """One event for each aid that was rejected."""
    return [
        Event("aid_rejected", r.spans[0][0], "warning", r.text, r.spans[-1][1], round(r.worst, 2), evidence=[r.source])
        for r in tested(log, segments)
        if r.spans
    ]
