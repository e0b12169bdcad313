"""Segments of a flight: what was going on when, and why we think so."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from attlog.segments import spans
from attlog.segments.airborne.in_air import InAir
from attlog.segments.crash import Ending

Array = NDArray[np.float64]

KINDS = (
    "continuous",
    "rest.long",
    "rest.short",
    "idle",
    "armed",
    "airborne",
    "hover",
    "cruise",
    "loss_of_control",
    "impact",
    "wreck",
    "reset",
    "gap",
)
WINDOWS = ("all", "rest", "rest.long", "idle", "armed", "airborne", "hover", "cruise")


@dataclass(frozen=True, slots=True)
class Segment:
    """One segment of time, seconds on the log's clock. ``why`` is a sentence with the numbers."""

    kind: str
    t0: float
    t1: float
    why: str = ""

    @property
    def seconds(self) -> float:
        """Length in s."""
        return self.t1 - self.t0


@dataclass(slots=True)
class Segments:
    """All segments of a log. ``notes`` says how flags and sensors were weighed, by kind.

    ``unknown`` names the phases (armed, airborne) that nothing in the log tells: no segment of them means nothing.
    ``air`` is what tells flight, None without sensors; ``endings`` are crashes and hard landings in time order.
    """

    segments: list[Segment] = field(default_factory=list)
    notes: dict[str, str] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()
    air: InAir | None = None
    endings: list[Ending] = field(default_factory=list)

    def seconds(self, kind: str) -> float | None:
        """Total length of a kind in s, None where the log cannot tell."""
        return None if kind in self.unknown else float(sum(s.seconds for s in self.of(kind)))

    def of(self, kind: str) -> list[Segment]:
        """Segments of a kind in time order; ``rest`` means long and short."""
        kinds = ("rest.long", "rest.short") if kind == "rest" else (kind,)
        return sorted([s for s in self.segments if s.kind in kinds], key=attrgetter("t0"))

    def spans(self, window: str) -> list[tuple[float, float]]:
        """(t0, t1) pairs of a ``--window``: a name of WINDOWS or ``T0:T1`` in s. ValueError otherwise."""
        if window == "all":
            return [(s.t0, s.t1) for s in self.of("continuous")]
        if window in WINDOWS:
            return [(s.t0, s.t1) for s in self.of(window)]
        start, colon, end = window.partition(":")
        try:
            span = (float(start), float(end)) if colon else None
        except ValueError:
            span = None
        if span is None or not -math.inf < span[0] < span[1] < math.inf:
            raise ValueError(f"window {window!r}: use {', '.join(WINDOWS)} or T0:T1 in seconds with T0 < T1")
        return [span]

    def mask(self, t: Array, window: str) -> NDArray[np.bool_]:
        """Which of the times (n,) lie inside a window."""
        return spans.inside(t, self.spans(window))
