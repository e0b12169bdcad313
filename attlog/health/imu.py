"""IMU samples for checks: usable units, blocks of still time and flight, biases by the smoother."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from attlog.core.log_cache import cached_per_log
from attlog.core.spans import Span, between, complement, intersect, seconds
from attlog.flight.model import Array, Imu, Stream, logged_rate
from attlog.health.check import HealthCase, MotionAttitude
from attlog.health.flown import crash_spans
from attlog.health.regression import BLOCK_S
from attlog.segments import model
from attlog.segments.model import Segments


def dead_reason(x: Array, source: str, sensor: str) -> str:
    """Return why samples (n, 3) are those of a dead sensor: all zero, or an axis that never changes; else empty."""
    if not x.any():
        return f"{source}: all values of the {sensor} are zero."
    stuck = [axis for axis, spread in zip("xyz", map(np.ptp, x.T), strict=True) if spread == 0]
    if stuck and len(x) >= 20:
        which = f"{sensor} axis {', '.join(stuck)} is" if len(stuck) < 3 else f"all axes of the {sensor} are"
        return f"{source}: {which} constant."
    return ""


# Where does a signal stand over a phase of the flight, and how surely? Medians over blocks of seconds.
#
# Neighbouring samples err together, so the scatter of blocks tells how sure their middle is, not that of samples.

MIN_BLOCK_SAMPLES = 5
"""Samples of a block: a unit logged at 2 Hz has ten in one."""
MAX_BLOCK_SAMPLES = 250
"""Samples of a block of which a median is taken: of more the means of neighbours."""
MIN_LONG_BLOCKS, SHORT_BLOCK_S, MIN_BLOCK_TIME_S = 5, 1.0, 2.0
"""Where a phase has fewer blocks of 5 s than MANY they are of 1 s; less than LEAST_S tells nothing."""
EDGE_S = 1.0
"""Left out at both ends of a flight, where the ground pushes."""
STANDARD_ERROR_FACTOR, MAD = 1.5, 1.4826
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
        return np.asarray(np.hypot(STANDARD_ERROR_FACTOR * 1.2533 * scatter / np.sqrt(max(b, 1)), floor))


def blocks(t: Array, x: Array, spans: list[Span]) -> Blocks | None:
    """Blocks of ``x`` (n, k) at rising ``t`` (n,) s within ``spans``; None where there are less than 2 s of them."""
    times: list[float] = []
    medians: list[Array] = []
    spreads: list[Array] = []
    samples = 0
    rate = logged_rate(t)
    if rate <= 0.0:
        return None
    length = BLOCK_S if seconds(spans) >= MIN_LONG_BLOCKS * BLOCK_S else max(SHORT_BLOCK_S, MIN_BLOCK_SAMPLES / rate)
    for a, b in spans:
        own = between(t, a, b)
        mine, values = t[own], x[own]
        edges = np.searchsorted(mine, np.arange(a, b + length, length))
        for i, j in pairwise(edges):
            if j - i < MIN_BLOCK_SAMPLES or (
                medians and j - i < 0.5 * rate * length
            ):  # what is left of a span adds noise only
                continue
            own_values = _decimated(values[i:j])
            middle = np.median(own_values, axis=0)
            times.append(float(0.5 * (mine[i] + mine[j - 1])))
            medians.append(middle)
            spreads.append(MAD * np.median(np.abs(own_values - middle), axis=0))
            samples += int(j - i)
    if samples < MIN_BLOCK_TIME_S * rate:
        return None
    spread = np.asarray(np.median(np.array(spreads), axis=0))
    return Blocks(np.array(times), np.array(medians), samples, samples / rate, spread)


def _decimated(x: Array) -> Array:
    """At most some MOST means of as many neighbours each, of values (n, k); medians of all cost ten times as much."""
    each = len(x) // MAX_BLOCK_SAMPLES
    return x if each < 2 else x[: each * (len(x) // each)].reshape(-1, each, x.shape[1]).mean(axis=1)


def stream_blocks(stream: Stream, spans: list[Span]) -> Blocks | None:
    """Blocks of a stream's good samples within ``spans``."""
    return blocks(*finite_samples(stream, spans), spans)


def finite_samples(stream: Stream, spans: list[Span]) -> tuple[Array, Array]:
    """Times (n,) s and values (n, k) of the finite samples from the first span to the last, in rising order."""
    n = min(len(stream.t_best), len(stream.x))
    t, x = stream.t_best[:n], stream.x[:n]
    if not spans or n == 0:
        return t[:0], x[:0]
    near = (t >= spans[0][0] - EDGE_S) & (t <= spans[-1][1] + EDGE_S)
    return model.select_rising(t[near], x[near])


def still_spans(segments: Segments) -> tuple[list[Span], str]:
    """When the vehicle stands still on the ground, else stands with motors on; and that in words."""
    for kind, words in (("rest", "at rest"), ("idle", "on the ground with motors on")):
        if spans := spans_before_crash(segments, segments.spans(kind)):
            return spans, words
    return [], ""


def flight_spans(segments: Segments) -> list[Span]:
    """When the vehicle flies and is no wreck, without the first and last second."""
    return spans_before_crash(segments, [(a + EDGE_S, b - EDGE_S) for a, b in segments.spans("airborne")])


def spans_before_crash(segments: Segments, spans: list[Span]) -> list[Span]:
    """Of ``spans`` what lies outside crashes and wrecks, up to the first impact."""
    if not spans:
        return []
    end = min((s.t0 for s in segments.of("impact")), default=np.inf)
    clear = complement(crash_spans(segments), min(a for a, _ in spans), min(end, max(b for _, b in spans)))
    return intersect(spans, clear)


@cached_per_log
def usable_imus(case: HealthCase) -> list[Imu]:
    """The units whose accelerometer and gyro are alive and calibrated, the one that is replayed first."""
    found = [
        i
        for i in case.log.imus
        if i.calibrated and len(i.acc.x) >= MIN_BLOCK_SAMPLES and len(i.gyro.x) >= MIN_BLOCK_SAMPLES
    ]
    found = [i for i in found if not dead_reason(i.acc.x, "", "") and not dead_reason(i.gyro.x, "", "")]
    return sorted(found, key=lambda i: i is not case.log.replay_imu)


def axes_text(vector: Array, digits: int = 2) -> str:
    """A vector in words: ``x +0.12, y -0.30, z +0.05``."""
    return ", ".join(f"{axis} {value:+.{digits}f}" for axis, value in zip("xyz", vector, strict=True))


# What the smoother says of the biases of the replayed unit, in flight, with its total error.
#
# The smoother's own sigma is too small by half (flights with truth); gravity's model, a scale error of 0.003 and the
# attitude add the floors. Where a flight hardly turns, the horizontal bias and the tilt cannot be parted: its own
# sigma
# is then large, or, in the worst flights, the runs with and without the compass disagree.

Quality = Mapping[str, float | str]
SIGMA_FACTOR = 1.5
"""The smoother's own sigma of an accelerometer bias is that much too small (24 flights with truth)."""
FLOOR_M_S2 = np.array([0.03, 0.03, 0.05])
"""Tilt that no flight parts from it; along z the model of gravity and a scale error of 0.003 (0.03 m/s^2)."""
ALONE_M_S2, BOTH_M_S2 = 0.03, 0.045
"""The smoother's own sigma is believed up to here: without a compass, and where one agrees with motion. On 24 flights
with truth and 48 planted offsets: beyond it errors reach 0.9 m/s^2, below it they stay within two total sigmas."""
MAX_JOINT_SIGMAS = 2.0
"""Joint total sigmas up to which the runs with and without the compass agree."""
FLOOR_DPS = np.array([0.05, 0.05, 0.05])
SURE_DPS = 0.3


@dataclass(frozen=True, slots=True)
class SensorBias:
    """What a sensor reads too much: ``mean`` and one ``sigma`` (3,), m/s^2 or deg/s, along the body's axes.

    ``known`` (3,): of which axes it is believed. ``n`` samples in ``seconds``; ``by`` says what found it.
    """

    mean: Array
    sigma: Array
    known: tuple[bool, bool, bool]
    n: int
    seconds: float
    by: str

    @property
    def sure(self) -> bool:
        """Whether all three axes are known."""
        return all(self.known)


def smoothed_acc_bias(case: HealthCase) -> SensorBias | None:
    """The bias of the replayed accelerometer [m/s^2]; None where there is no smoother with GNSS.

    That of the reference where it is a smoother whose compass agrees with motion, else that without a compass.
    """
    if (read := _longest_segment(case.motion)) is None:
        return None
    longest, quality = read
    names = "acc_bias_{}_m_s2", "acc_bias_{}_sigma_m_s2"
    alone, sure, by, agree = _smoother_values(quality, *names), ALONE_M_S2, "the smoother with GNSS", True
    if alone is None:
        return None
    mean, own = alone
    reference = case.reference
    if reference is not None and reference.kind == "smoother" and reference.quality.get("heading_from") == "both":
        both = _smoother_values(reference.quality, *names)
        if both is not None:
            doubt = np.hypot(_total_acc_sigma(own), _total_acc_sigma(both[1]))
            agree = bool(np.all(np.abs(both[0] - mean)[:2] <= MAX_JOINT_SIGMAS * doubt[:2]))
            (mean, own), sure, by = both, BOTH_M_S2, "the smoother with GNSS and compass"
    level, down = agree and bool(own[:2].max() <= sure), bool(own[2] <= sure)
    return SensorBias(
        mean, _total_acc_sigma(own), (level, level, down), len(longest), float(longest[-1] - longest[0]), by
    )


def _total_acc_sigma(own: Array) -> Array:
    """The total error (3,) of a bias of the accelerometer by the smoother's own sigma."""
    return np.asarray(np.hypot(SIGMA_FACTOR * own, FLOOR_M_S2))


def smoothed_gyro_bias(case: HealthCase) -> SensorBias | None:
    """The bias of the replayed gyro [deg/s] in flight; None where there is no smoother with GNSS."""
    if (read := _longest_segment(case.motion)) is None:
        return None
    longest, quality = read
    told = _smoother_values(quality, "gyro_bias_{}_dps", "gyro_bias_{}_sigma_dps")
    if told is None:
        return None
    mean, own = told
    known = tuple(bool(s <= SURE_DPS) for s in own)
    sigma, seconds = np.hypot(SIGMA_FACTOR * own, FLOOR_DPS), float(longest[-1] - longest[0])
    return SensorBias(mean, sigma, (known[0], known[1], known[2]), len(longest), seconds, "the smoother")


def _longest_segment(motion: MotionAttitude | None) -> tuple[Array, Quality] | None:
    """The times (n,) s of the longest segment, of which the smoother tells, and what it tells."""
    if motion is None or len(motion.t) < 2:
        return None
    return motion.t[motion.segment == np.argmax(np.bincount(motion.segment))], motion.quality


def _smoother_values(quality: Quality, mean: str, sigma: str) -> tuple[Array, Array] | None:
    """Mean and own sigma (3,) as a smoother tells them; None where it does not."""
    numbers = [quality.get(name.format(axis)) for name in (mean, sigma) for axis in "xyz"]
    values = [float(x) for x in numbers if isinstance(x, float | int) and np.isfinite(x)]
    return (np.array(values[:3]), np.array(values[3:])) if len(values) == 6 else None
