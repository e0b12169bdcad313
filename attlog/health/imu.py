"""IMU samples for checks: usable units, blocks of still time and flight, biases by the smoother."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from attlog.core.log_cache import cached_per_log
from attlog.core.spans import Span, between, seconds
from attlog.flight.model import Array, Imu, Stream, logged_rate
from attlog.health.check import HealthCase, MotionAttitude
from attlog.health.flown import EDGE_S
from attlog.health.regression import BLOCK_S
from attlog.segments import model


def dead_reason(x: Array, source: str, sensor: str) -> str:
    """Return why samples (n, 3) are those of a dead sensor: all zero, or an axis that never changes; else empty."""
    if not x.any():
        return f"{source}: all values of the {sensor} are zero."
    stuck = [axis for axis, spread in zip("xyz", map(np.ptp, x.T), strict=True) if spread == 0]
    if stuck and len(x) >= 20:
        which = f"{sensor} axis {', '.join(stuck)} is" if len(stuck) < 3 else f"all axes of the {sensor} are"
        return f"{source}: {which} constant."
    return ""


# Medians of a stream over blocks of seconds: the scatter of blocks, not of samples, gives the error of their middle.

# Of fewer samples a median and its deviation mean nothing.
MIN_BLOCK_SAMPLES = 5
# Of longer blocks the means of neighbours are sorted, at a tenth of the time.
MAX_BLOCK_SAMPLES = 250
# With fewer blocks of 5 s they are of 1 s; less time than 2 s is no phase.
MIN_LONG_BLOCKS, SHORT_BLOCK_S, MIN_BLOCK_TIME_S = 5, 1.0, 2.0
# Blocks are not independent either, so standard errors are too small by this.
STANDARD_ERRORS = 1.5
# Robust deviation of a normal distribution, and the standard error of a median over that of a mean.
MAD, MEDIAN_SD = 1.4826, 1.2533


@dataclass(frozen=True, slots=True)
class Blocks:
    """Medians ``x`` (b, k) of blocks at their middles ``t`` (b,) s, of ``samples`` in ``seconds``.

    ``spread`` (k,): robust deviation of the samples of a block.
    """

    t: Array
    x: Array
    samples: int
    seconds: float
    spread: Array

    @property
    def middle(self) -> Array:
        """Median (k,) of the blocks."""
        return np.asarray(np.median(self.x, axis=0))

    def sigma(self, floor: float) -> Array:
        """Return the error (k,) of the middle, at least ``floor``; from fewer than three blocks by their samples."""
        b = len(self.x)
        scatter = MAD * np.median(np.abs(self.x - self.middle), axis=0) if b > 2 else self.spread
        return np.asarray(np.hypot(STANDARD_ERRORS * MEDIAN_SD * scatter / np.sqrt(max(b, 1)), floor))


def blocks(t: Array, x: Array, spans: list[Span]) -> Blocks | None:
    """Return the blocks of ``x`` (n, k) at rising ``t`` (n,) s within ``spans``; None from less than 2 s."""
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
            rest_of_span = bool(medians) and j - i < 0.5 * rate * length
            if j - i < MIN_BLOCK_SAMPLES or rest_of_span:
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
    """Return at most some MAX_BLOCK_SAMPLES means of as many neighbours each, of values (n, k)."""
    each = len(x) // MAX_BLOCK_SAMPLES
    return x if each < 2 else x[: each * (len(x) // each)].reshape(-1, each, x.shape[1]).mean(axis=1)


def stream_blocks(stream: Stream, spans: list[Span]) -> Blocks | None:
    """Return the blocks of a stream's finite samples within ``spans``."""
    return blocks(*finite_samples(stream, spans), spans)


def finite_samples(stream: Stream, spans: list[Span]) -> tuple[Array, Array]:
    """Return times (n,) s and values (n, k) of the finite samples around ``spans``, in rising order."""
    n = min(len(stream.t_best), len(stream.x))
    t, x = stream.t_best[:n], stream.x[:n]
    if not spans or n == 0:
        return t[:0], x[:0]
    near = (t >= spans[0][0] - EDGE_S) & (t <= spans[-1][1] + EDGE_S)
    return model.select_rising(t[near], x[near])


@cached_per_log
def usable_imus(case: HealthCase) -> list[Imu]:
    """Return the units with live and calibrated accelerometer and gyro, the replayed one first."""

    def alive(x: Array) -> bool:
        return len(x) >= MIN_BLOCK_SAMPLES and not dead_reason(x, "", "")

    found = [imu for imu in case.log.imus if imu.calibrated and alive(imu.acc.x) and alive(imu.gyro.x)]
    return sorted(found, key=lambda imu: imu is not case.log.replay_imu)


def axes_text(vector: Array, digits: int = 2) -> str:
    """Return a vector in words: ``x +0.12, y -0.30, z +0.05``."""
    return ", ".join(f"{axis} {value:+.{digits}f}" for axis, value in zip("xyz", vector, strict=True))


# Biases of the replayed unit in flight by the smoother, with their total errors. Where a flight hardly turns, the
# horizontal accelerometer bias and the tilt cannot be separated: its sigma is then large, or, in the worst flights, the
# runs with and without the compass disagree.

Quality = Mapping[str, float | str]
# The smoother's sigma of an accelerometer bias is too small by this (24 flights with truth).
SIGMA_FACTOR = 1.5
# Tilt that no flight separates from it; along z the model of gravity and a scale error of 0.003 (0.03 m/s^2).
FLOOR_M_S2 = np.array([0.03, 0.03, 0.05])
# Largest sigma of a known bias: without a compass, and where one agrees with motion. On 24 flights with truth and 48
# planted offsets errors reach 0.9 m/s^2 beyond it, and stay within two total sigmas below it.
ALONE_M_S2, BOTH_M_S2 = 0.03, 0.045
# Joint total sigmas up to which the runs with and without the compass agree.
MAX_JOINT_SIGMAS = 2.0
# Drift of a gyro bias over a flight; a bias with a larger sigma than the second is not known.
FLOOR_DPS, SURE_DPS = 0.05, 0.3


@dataclass(frozen=True, slots=True)
class SensorBias:
    """Error of a sensor along the body's axes, ``mean`` (3,) m/s^2 or deg/s, with its ``sigma`` (3,).

    ``known`` (3,): axes whose sigma is small enough. ``n`` samples in ``seconds``; ``by``: its source in words.
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
    """Return the bias of the replayed accelerometer in m/s^2; None without a smoother with GNSS.

    It is the reference's where that is a smoother whose compass agrees with motion, else the one without a compass.
    """
    if (read := _longest_segment(case.motion)) is None:
        return None
    longest, quality = read
    names = "acc_bias_{}_m_s2", "acc_bias_{}_sigma_m_s2"
    values = _smoother_values(quality, *names)
    if values is None:
        return None
    (mean, own), sure, by, agree = values, ALONE_M_S2, "the smoother with GNSS", True
    reference = case.reference
    if reference is not None and reference.kind == "smoother" and reference.quality.get("heading_from") == "both":
        both = _smoother_values(reference.quality, *names)
        if both is not None:
            joint = np.hypot(_total_acc_sigma(own), _total_acc_sigma(both[1]))
            agree = bool(np.all(np.abs(both[0] - mean)[:2] <= MAX_JOINT_SIGMAS * joint[:2]))
            (mean, own), sure, by = both, BOTH_M_S2, "the smoother with GNSS and compass"
    level, down = agree and bool(own[:2].max() <= sure), bool(own[2] <= sure)
    return SensorBias(
        mean, _total_acc_sigma(own), (level, level, down), len(longest), float(longest[-1] - longest[0]), by
    )


def _total_acc_sigma(own: Array) -> Array:
    """Return the total error (3,) of an accelerometer bias from the smoother's sigma."""
    return np.asarray(np.hypot(SIGMA_FACTOR * own, FLOOR_M_S2))


def smoothed_gyro_bias(case: HealthCase) -> SensorBias | None:
    """Return the bias of the replayed gyro in deg/s in flight; None without a smoother with GNSS."""
    if (read := _longest_segment(case.motion)) is None:
        return None
    longest, quality = read
    values = _smoother_values(quality, "gyro_bias_{}_dps", "gyro_bias_{}_sigma_dps")
    if values is None:
        return None
    mean, own = values
    known = tuple(bool(s <= SURE_DPS) for s in own)
    sigma, seconds = np.hypot(SIGMA_FACTOR * own, FLOOR_DPS), float(longest[-1] - longest[0])
    return SensorBias(mean, sigma, (known[0], known[1], known[2]), len(longest), seconds, "the smoother")


def _longest_segment(motion: MotionAttitude | None) -> tuple[Array, Quality] | None:
    """Return the times (n,) s of the longest segment, which the smoother's biases are of, and its values."""
    if motion is None or len(motion.t) < 2:
        return None
    return motion.t[motion.segment == np.argmax(np.bincount(motion.segment))], motion.quality


def _smoother_values(quality: Quality, mean: str, sigma: str) -> tuple[Array, Array] | None:
    """Return mean and sigma (3,) of a bias from a smoother's values; None where one is missing."""
    numbers = [quality.get(name.format(axis)) for name in (mean, sigma) for axis in "xyz"]
    values = [float(x) for x in numbers if isinstance(x, float | int) and np.isfinite(x)]
    return (np.array(values[:3]), np.array(values[3:])) if len(values) == 6 else None
