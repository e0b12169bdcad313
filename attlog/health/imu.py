"""IMU data for checks: usable IMUs, block medians, biases by the smoother."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median
from attlog.core.spans import Span, between, seconds
from attlog.flight.model import Array, Imu, Stream, logged_rate
from attlog.health.check import HealthCase, MotionAttitude
from attlog.health.flown import EDGE_S
from attlog.health.regression import BLOCK_S
from attlog.segments import model


def dead_reason(x: Array, source: str, sensor: str) -> str:
    """Return why samples (n, 3) are dead (all zero, or a constant axis); empty where alive."""
    if not x.any():
        return f"{source}: all values of the {sensor} are zero."
    stuck = [axis for axis, spread in zip("xyz", map(np.ptp, x.T), strict=True) if spread == 0]
    if stuck and len(x) >= 20:
        which = f"{sensor} axis {', '.join(stuck)} is" if len(stuck) < 3 else f"all axes of the {sensor} are"
        return f"{source}: {which} constant."
    return ""


# Medians of a stream over blocks of seconds; the error is from the scatter of blocks, because samples are correlated.

# Minimum samples of a block.
MIN_BLOCK_SAMPLES = 5
# Above this number of samples a block is reduced by means of neighbours, for speed.
MAX_BLOCK_SAMPLES = 250
# Below this number of 5 s blocks, blocks last 1 s. Minimum total time.
MIN_LONG_BLOCKS, SHORT_BLOCK_S, MIN_BLOCK_TIME_S = 5, 1.0, 2.0
# Factor on standard errors, because blocks are correlated, too.
STANDARD_ERRORS = 1.5
# For a normal distribution: standard deviation over MAD, and standard error of a median over that of a mean.
MAD, MEDIAN_SD = 1.4826, 1.2533


class Blocks(NamedTuple):
    """Block medians ``x`` (b, k) at block centres ``t`` (b,) s.

    From ``samples`` in ``seconds``. ``spread`` (k,): robust deviation of the samples within a block.
    """

    t: Array
    x: Array
    samples: int
    seconds: float
    spread: Array

    @property
    def middle(self) -> Array:
        """Median (k,) of the blocks."""
        return np.asarray(median(self.x, axis=0))

    def sigma(self, floor: float) -> Array:
        """Return the error (k,) of ``middle``, at least ``floor``.

        From the scatter of blocks, for fewer than three from the samples.
        """
        b = len(self.x)
        scatter = MAD * median(np.abs(self.x - self.middle), axis=0) if b > 2 else self.spread
        return np.asarray(np.hypot(STANDARD_ERRORS * MEDIAN_SD * scatter / np.sqrt(max(b, 1)), floor))


def blocks(t: Array, x: Array, spans: list[Span]) -> Blocks | None:
    """Return block medians of ``x`` (n, k) within spans; None from less than 2 s.

    ``t`` (n,) s is increasing.
    """
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
            middle = median(own_values, axis=0)
            times.append(float(0.5 * (mine[i] + mine[j - 1])))
            medians.append(middle)
            spreads.append(MAD * median(np.abs(own_values - middle), axis=0))
            samples += int(j - i)
    if samples < MIN_BLOCK_TIME_S * rate:
        return None
    spread = np.asarray(median(np.array(spreads), axis=0))
    return Blocks(np.array(times), np.array(medians), samples, samples / rate, spread)


def _decimated(x: Array) -> Array:
    """Reduce values (n, k) to about MAX_BLOCK_SAMPLES means of neighbours."""
    each = len(x) // MAX_BLOCK_SAMPLES
    return x if each < 2 else x[: each * (len(x) // each)].reshape(-1, each, x.shape[1]).mean(axis=1)


def stream_blocks(stream: Stream, spans: list[Span]) -> Blocks | None:
    """Return the blocks of a stream's finite samples within ``spans``."""
    return blocks(*finite_samples(stream, spans), spans)


def finite_samples(stream: Stream, spans: list[Span]) -> tuple[Array, Array]:
    """Return times (n,) s and values (n, k) of finite samples around spans, times increasing."""
    n = min(len(stream.t_best), len(stream.x))
    t, x = stream.t_best[:n], stream.x[:n]
    if not spans or n == 0:
        return t[:0], x[:0]
    near = (t >= spans[0][0] - EDGE_S) & (t <= spans[-1][1] + EDGE_S)
    return model.select_rising(t[near], x[near])


@cached_per_log
def usable_imus(case: HealthCase) -> list[Imu]:
    """Return IMUs with live, calibrated accelerometer and gyro, the replayed one first."""

    def alive(x: Array) -> bool:
        return len(x) >= MIN_BLOCK_SAMPLES and not dead_reason(x, "", "")

    found = [imu for imu in case.log.imus if imu.calibrated and alive(imu.acc.x) and alive(imu.gyro.x)]
    return sorted(found, key=lambda imu: imu is not case.log.replay_imu)


def axes_text(vector: Array, digits: int = 2) -> str:
    """Format a vector: ``x +0.12, y -0.30, z +0.05``."""
    return ", ".join(f"{axis} {value:+.{digits}f}" for axis, value in zip("xyz", vector, strict=True))


# Biases of the replayed IMU in flight by the smoother, with total errors. Without turns the horizontal accelerometer
# bias is not separable from tilt: sigma is then large or, in the worst flights, the smoothers with and without compass
# disagree.

Quality = Mapping[str, float | str]
# Factor on the smoother's sigma of an accelerometer bias (24 flights with truth).
SIGMA_FACTOR = 1.5
# Minimum error: inseparable tilt; along z the gravity model and a scale error of 0.003 (0.03 m/s^2).
FLOOR_M_S2 = np.array([0.03, 0.03, 0.05])
# Maximum sigma of a known bias: without a compass, and with one that agrees with motion. On 24 flights with truth and
# 48 planted offsets errors are up to 0.9 m/s^2 above this limit, and within 2 total sigma below it.
ALONE_M_S2, BOTH_M_S2 = 0.03, 0.045
# Maximum difference between smoothers with and without compass, in joint total sigmas.
MAX_JOINT_SIGMAS = 2.0
# Drift of a gyro bias over a flight; maximum sigma of a known bias.
FLOOR_DPS, SURE_DPS = 0.05, 0.3


class SensorBias(NamedTuple):
    """Sensor bias ``mean`` (3,) with ``sigma`` (3,) in body axes, m/s^2 or deg/s.

    ``known`` (3,): axes with a small enough sigma. ``n`` samples in ``seconds``; ``by``: source as text.
    """

    mean: Array
    sigma: Array
    known: tuple[bool, bool, bool]
    n: int
    seconds: float
    by: str

    @property
    def sure(self) -> bool:
        """True if all three axes are known."""
        return all(self.known)


def smoothed_acc_bias(case: HealthCase) -> SensorBias | None:
    """Return the bias of the replayed accelerometer in m/s^2; None without a smoother with GNSS.

    From the reference if it is a smoother whose compass agrees with motion, else from the smoother without compass.
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
    """Return times (n,) s of the longest segment, and the smoother's values for it."""
    if motion is None or len(motion.t) < 2:
        return None
    return motion.t[motion.segment == np.argmax(np.bincount(motion.segment))], motion.quality


def _smoother_values(quality: Quality, mean: str, sigma: str) -> tuple[Array, Array] | None:
    """Return mean and sigma (3,) of a bias from a smoother's values; None if incomplete."""
    numbers = [quality.get(name.format(axis)) for name in (mean, sigma) for axis in "xyz"]
    values = [float(x) for x in numbers if isinstance(x, float | int) and np.isfinite(x)]
    return (np.array(values[:3]), np.array(values[3:])) if len(values) == 6 else None
