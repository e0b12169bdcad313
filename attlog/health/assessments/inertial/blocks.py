"""Where does a signal stand over a phase of the flight, and how surely? Medians over blocks of seconds.

Neighbouring samples err together, so the scatter of blocks tells how sure their middle is, not that of samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from attlog.flight.model import Array, Imu, Stream, logged_rate
from attlog.health.assessments.model import HealthCase
from attlog.health.fits.regression import BLOCK_S
from attlog.health.sensors.gyro import alive
from attlog.health.sound import crashed
from attlog.segments import gaps
from attlog.segments.model import Segments
from attlog.segments.once import asked_once
from attlog.segments.spans import Span, between, complement, intersect, seconds

FEWEST = 5
"""Samples of a block: a unit logged at 2 Hz has ten in one."""
MOST = 250
"""Samples of a block of which a median is taken: of more the means of neighbours."""
MANY, SHORT_S, LEAST_S = 5, 1.0, 2.0
"""Where a phase has fewer blocks of 5 s than MANY they are of 1 s; less than LEAST_S tells nothing."""
EDGE_S = 1.0
"""Left out at both ends of a flight, where the ground pushes."""
INFLATED, MAD = 1.5, 1.4826
"""Standard errors are that much too small: blocks are not independent either. MAD is the robust deviation's factor."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Medians ``x`` (b, k) of blocks at their middles ``t`` (b,) s, by ``samples`` in ``seconds``."""

    t: Array
    x: Array
    samples: int
    seconds: float
    spread: Array
    """Robust deviation (k,) of the samples of a block."""

    @property
    def middle(self) -> Array:
        """Median (k,) of the blocks."""
        return np.asarray(np.median(self.x, axis=0))

    def sigma(self, floor: float) -> Array:
        """Standard deviation (k,) of the middle, never below ``floor``; of fewer than three blocks that of samples."""
        b = len(self.x)
        scatter = MAD * np.median(np.abs(self.x - self.middle), axis=0) if b > 2 else self.spread
        return np.asarray(np.hypot(INFLATED * 1.2533 * scatter / np.sqrt(max(b, 1)), floor))


def blocks(t: Array, x: Array, spans: list[Span]) -> Blocks | None:
    """Blocks of ``x`` (n, k) at rising ``t`` (n,) s within ``spans``; None where there are less than 2 s of them."""
    times: list[float] = []
    medians: list[Array] = []
    spreads: list[Array] = []
    samples = 0
    rate = logged_rate(t)
    if rate <= 0.0:
        return None
    length = BLOCK_S if seconds(spans) >= MANY * BLOCK_S else max(SHORT_S, FEWEST / rate)
    for a, b in spans:
        own = between(t, a, b)
        mine, values = t[own], x[own]
        edges = np.searchsorted(mine, np.arange(a, b + length, length))
        for i, j in pairwise(edges):
            if j - i < FEWEST or (medians and j - i < 0.5 * rate * length):  # what is left of a span adds noise only
                continue
            own_values = averaged(values[i:j])
            middle = np.median(own_values, axis=0)
            times.append(float(0.5 * (mine[i] + mine[j - 1])))
            medians.append(middle)
            spreads.append(MAD * np.median(np.abs(own_values - middle), axis=0))
            samples += int(j - i)
    if samples < LEAST_S * rate:
        return None
    spread = np.asarray(np.median(np.array(spreads), axis=0))
    return Blocks(np.array(times), np.array(medians), samples, samples / rate, spread)


def averaged(x: Array) -> Array:
    """At most some MOST means of as many neighbours each, of values (n, k); medians of all cost ten times as much."""
    each = len(x) // MOST
    return x if each < 2 else x[: each * (len(x) // each)].reshape(-1, each, x.shape[1]).mean(axis=1)


def of_stream(stream: Stream, spans: list[Span]) -> Blocks | None:
    """Blocks of a stream's good samples within ``spans``."""
    return blocks(*good(stream, spans), spans)


def good(stream: Stream, spans: list[Span]) -> tuple[Array, Array]:
    """Times (n,) s and values (n, k) of the finite samples from the first span to the last, in rising order."""
    n = min(len(stream.t_best), len(stream.x))
    t, x = stream.t_best[:n], stream.x[:n]
    if not spans or n == 0:
        return t[:0], x[:0]
    near = (t >= spans[0][0] - EDGE_S) & (t <= spans[-1][1] + EDGE_S)
    return gaps.rising(t[near], x[near])


def still(segments: Segments) -> tuple[list[Span], str]:
    """When the vehicle stands still on the ground, else stands with motors on; and that in words."""
    for kind, words in (("rest", "at rest"), ("idle", "on the ground with motors on")):
        if spans := intact(segments, segments.spans(kind)):
            return spans, words
    return [], ""


def in_air(segments: Segments) -> list[Span]:
    """When the vehicle flies and is no wreck, without the first and last second."""
    return intact(segments, [(a + EDGE_S, b - EDGE_S) for a, b in segments.spans("airborne")])


def intact(segments: Segments, spans: list[Span]) -> list[Span]:
    """Of ``spans`` what lies outside crashes and wrecks, up to the first impact."""
    if not spans:
        return []
    end = min((s.t0 for s in segments.of("impact")), default=np.inf)
    clear = complement(crashed(segments), min(a for a, _ in spans), min(end, max(b for _, b in spans)))
    return intersect(spans, clear)


@asked_once
def usable(case: HealthCase) -> list[Imu]:
    """The units whose accelerometer and gyro are alive and calibrated, the one that is replayed first."""
    found = [i for i in case.log.imus if i.calibrated and len(i.acc.x) >= FEWEST and len(i.gyro.x) >= FEWEST]
    found = [i for i in found if not alive("", i.acc.x, "") and not alive("", i.gyro.x, "")]
    return sorted(found, key=lambda i: i is not case.log.replay_imu)


def listed(vector: Array, digits: int = 2) -> str:
    """A vector in words: ``x +0.12, y -0.30, z +0.05``."""
    return ", ".join(f"{axis} {value:+.{digits}f}" for axis, value in zip("xyz", vector, strict=True))
