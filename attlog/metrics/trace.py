"""Arrays of one row or a sensor for a figure; long ones are envelopes that keep every peak."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth, jit
from attlog.core.brief import brief
from attlog.core.jit import F2, I1, Out2
from attlog.core.sorting import median, unique
from attlog.core.spans import between, inside
from attlog.flight.model import FlightLog, Imu, Stream
from attlog.metrics.metric import Case
from attlog.metrics.windows import detrended, within
from attlog.reference import alignment
from attlog.segments.heights import height_stream, highest_level
from attlog.segments.model import Segments

Array = NDArray[np.float64]


# Samples per angle over all rows of a figure; beyond it envelopes take over.
BUDGET = 100_000
# Samples that every row keeps, however many rows there are.
MIN_SAMPLES = 2000
# What is beyond is infinite. (The question whether a number is finite would call the compiler's own library.)
LARGEST = 1e300


@dataclass(slots=True)
class Trace:
    """Arrays of one row for one figure; never in the JSON.

    ``figure`` and its ``columns`` (all (n,), degrees, NaN breaks the line):
    ``attitude``: roll pitch heading at the row's own times (the reference is drawn
    too, as ``truth`` or ``smoother`` where it is no row); ``difference``: total heading tilt roll pitch at
    the reference's times; ``sigma``: tilt and heading, how wrong a smoother says it may be itself;
    ``rest``: roll pitch heading in the longest rest, each minus its straight line; ``spread``: angle and
    share (%) of the samples of roll and pitch there, a straight line taken out of every 5 s;
    ``drift``: heading error block means and ``line`` (fit), each minus the mean of the heading, ``key`` = "rest" or the
    heading reference; ``allan``: tau (also ``t``), deviation of the averaged angle, low, high,
    ``key`` = axis; ``bias``: x y z in deg/s, of filters and of the onboard estimator; ``step``: est and ref of the
    representative event and ``set`` (set-point), t from its onset, ``key`` = "axis@onset";
    ``steps``: median low high of the error in % of the stroke over all events
    of an axis, ``ref`` the reference's median, ``key`` = "axis (events)"; ``setpoint``: roll and pitch response to a
    unit step, t from the step; ``demand`` (no row): roll pitch heading of the attitude set-point.

    Traces of sensors, the height and flight data have no row: see :func:`sensor_traces`, :func:`height_trace` and
    :mod:`attlog.metrics.flight_data`.

    Long arrays are envelopes: smallest and largest value of each bucket; ``ratio`` is
    the number of samples that one stored sample stands for. ``values`` are single
    numbers that belong to the arrays, ``units`` those of columns that are not in degrees.
    """

    figure: str
    row: str
    t: NDArray[np.float64]
    columns: dict[str, NDArray[np.float64]]
    key: str = ""
    ratio: float = 1.0
    values: dict[str, float] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    __repr__ = brief


@dataclass(slots=True)
class SampleBudget:
    """Number of samples that each row of a figure keeps, for rows that pass one by one.

    First ``replays`` replayed rows pass, then others with ``others`` samples in all. A replayed row has the share that
    it would have if all were as long: they have the samples of one unit.
    """

    replays: int = 0
    others: int = 0
    passed: int = 0

    def keep(self, n: int, replayed: bool) -> int:
        """Return how many of its n samples the next row keeps."""
        self.passed += n if replayed else 0
        total = self.others + (self.replays * n if replayed else self.passed)
        return n if total <= 1.1 * BUDGET else min(n, max(BUDGET * n // total, MIN_SAMPLES))


def envelope(t: Array, columns: Array, keep: int) -> tuple[Array, Array]:
    """Return times (m,) and columns (m, k) of (n,), (n, k) with at most ``keep`` samples: extremes of buckets.

    The two values of a bucket stand at its first and its middle time, so that all columns share the times; a peak keeps
    its height and moves by less than a bucket. A bucket with NaN in it keeps a NaN, so that a gap stays a gap.
    """
    n, buckets = len(t), max(keep // 2, 1)
    if n <= max(keep, 2):
        return t, columns
    edges = np.linspace(0, n, buckets + 1).astype(np.int64)
    first, middle = edges[:-1], (edges[:-1] + edges[1:]) // 2
    out = np.empty((2 * buckets, columns.shape[1]))
    extremes(out, np.ascontiguousarray(columns), edges)
    return np.column_stack([t[first], t[middle]]).ravel(), out


def detailed(t: Array, columns: Array, keep: int, whole: Array) -> tuple[Array, Array]:
    """Return an envelope of (n,), (n, k) that keeps every sample within spans ``whole`` (m, 2) s, in time order."""
    if len(t) <= keep or not len(whole):
        return envelope(t, columns, keep)
    edges = [0, *np.searchsorted(t, whole.ravel()).tolist(), len(t)]
    parts = []
    for k, (i, j) in enumerate(pairwise(edges)):
        if i < j:
            part = t[i:j], columns[i:j]
            parts.append(part if k % 2 else envelope(*part, max(keep * (j - i) // len(t), 2)))
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


@jit.loop("envelopes of long lines")
def extremes(out: Out2, x: F2, edges: I1) -> None:
    """Fill ``out`` (2 m, k) with both extremes of the columns of ``x`` (n, k) between ``edges`` (m + 1,), as they came.

    NaN for the second where the bucket holds a NaN, for both where it holds nothing else, and for what is infinite.
    """
    for b in range(len(edges) - 1):
        for c in range(x.shape[1]):
            low, high = math.inf, -math.inf
            at_low, at_high, gap = 0, 0, False
            for i in range(edges[b], edges[b + 1]):
                value = x[i, c]
                if value < low:
                    low, at_low = value, i
                if value > high:
                    high, at_high = value, i
                if value != value:
                    gap = True
            first, second = low, high
            if at_high < at_low:
                first, second = high, low
            if gap or not -LARGEST < second < LARGEST:
                second = math.nan
            if not -LARGEST < first < LARGEST:
                first = math.nan
            out[2 * b, c], out[2 * b + 1, c] = first, second


# Figure data of the sensors: spectra, vibration, gravity, field, bias at rest.
#
# Traces without a row:
# ``spectrum``: frequency (Hz, also ``t``), x y z amplitude density, ``key`` = gyro (deg/s/sqrt(Hz)) or accelerometer
# (m/s^2/sqrt(Hz)), values ``nyquist_hz`` and ``seconds``;
# ``vibration``: x y z standard deviation of the accelerometer (m/s^2) in windows of one second, ``clipped`` samples
# at
# the end of its range in them, values ``samples`` clipped in all;
# ``gravity``: low mean high of the specific force's size (m/s^2), value ``expected``;
# ``field``: low mean high of the field's size (uT), value ``expected`` (world magnetic model) with known place and
# date;
# ``throttle``: percent; ``rest_bias``: x y z mean rate of the gyro (deg/s) in each rest, ``t`` its middle.

G = 9.80665
# Usual full scales of accelerometers.
RANGES_M_S2 = tuple(g * G for g in (4.0, 8.0, 16.0, 32.0))
# Distance from full scale (share of it) of a clipped sample, if no sample is far beyond.
CLIPPED_SHARE = 0.01
# Samples per segment of a spectrum: at 250 Hz a resolution of 0.25 Hz.
SEGMENT_SAMPLES = 1024
MIN_SENSOR_SAMPLES = 64  # fewer resolve no spectrum
# Segments per call of the FFT.
BATCH_SEGMENTS = 16
# Largest number of averaged segments, spread evenly over the flight.
MAX_SPECTRA = 400
# Largest number of points of a line; windows grow with the log.
MAX_BUCKETS = 2000
AXES = ("x", "y", "z")


def sensor_traces(case: Case) -> list[Trace]:
    """Return all traces of the replayed IMU and the used magnetometer."""
    log = case.log
    if log.imu is None or len(log.imus[log.imu].gyro.t) < 2:
        return []
    imu = log.imus[log.imu]
    return [*spectra(case, imu), *vibration(imu), *sizes(log, imu), *throttle(log), *rest_bias(case, imu)]


def spectra(case: Case, imu: Imu) -> list[Trace]:
    """Return Welch amplitude densities in flight, else of the whole log."""
    spans = case.segments.spans("airborne") or [(float(imu.gyro.t[0]), float(imu.gyro.t[-1]))]
    segments = [p for span in spans for p in within(imu.gyro.t, span) if p.stop - p.start >= MIN_SENSOR_SAMPLES]
    if not segments:
        return []
    size = min(SEGMENT_SAMPLES, max(p.stop - p.start for p in segments))
    starts = [a for p in segments for a in range(p.start, p.stop - size + 1, size // 2)]
    step = float(median(np.diff(imu.gyro.t)))
    if not starts or step <= 0:
        return []
    chosen = [starts[k] for k in unique(np.linspace(0, len(starts) - 1, MAX_SPECTRA).round().astype(int))]
    found = []
    for key, x, unit in (("gyro", imu.gyro.x, np.degrees(1.0)), ("accelerometer", imu.acc.x, 1.0)):
        density = unit * np.sqrt(_mean_power(x, np.array(chosen), size, step))
        f = np.asarray(np.fft.rfftfreq(size, step)[1:], np.float64)
        columns = {"frequency": f} | {a: density[1:, k] for k, a in enumerate(AXES)}
        values = {
            "nyquist_hz": 0.5 / step,
            "seconds": sum(float(imu.gyro.t[p.stop - 1] - imu.gyro.t[p.start]) for p in segments),
        }
        found.append(Trace("spectrum", "", f, columns, key, values=values))
    return found


def _mean_power(x: Array, starts: NDArray[np.int64], size: int, step: float) -> Array:
    """Return the mean periodogram (size // 2 + 1, k) of segments."""
    total = np.zeros((size // 2 + 1, x.shape[1]))
    for begin in np.array_split(starts, len(starts) // BATCH_SEGMENTS + 1):
        segments = x[begin + np.arange(size)[:, None]].reshape(size, -1)
        total += periodogram(segments, step).reshape(len(total), -1, x.shape[1]).sum(axis=1)
    return total / len(starts)


def periodogram(x: Array, step: float) -> Array:
    """Return the one-sided Hann power density of samples (n, k)."""
    n = len(x)
    taper = np.hanning(n + 1)[:-1]
    flat = detrended(np.arange(n, dtype=np.float64), np.nan_to_num(x))
    found = np.fft.rfft((flat * taper[:, None]).T).T
    power = (found.real**2 + found.imag**2) * (2.0 * step / float(taper @ taper))
    power[0] *= 0.5
    if n % 2 == 0:
        power[-1] *= 0.5
    return np.asarray(power)


def vibration(imu: Imu) -> list[Trace]:
    """Return standard deviation and clipped samples of the accelerometer over time."""
    t, edges = buckets(imu.acc.t, 1.0)
    if len(t) == 0:
        return []
    first, size = edges[:-1], np.diff(edges)
    columns = {}
    for name, x in zip(AXES, imu.acc.x.T, strict=True):  # one at a time: in long logs copies add up
        away = np.nan_to_num(x)
        away -= np.repeat(np.add.reduceat(away, first) / size, size)
        away *= away
        columns[name] = np.sqrt(np.add.reduceat(away, first) / size)
    clipped = clipped_samples(imu.acc.x)
    columns["clipped"] = np.add.reduceat(clipped.astype(np.float64), first)
    return [Trace("vibration", "", t, columns, values={"samples": float(clipped.sum())})]


def clipped_samples(acc: Array) -> NDArray[np.bool_]:
    """Return which samples (n,) of ``acc`` (n, 3) m/s^2 are clipped."""
    # One axis at a time, twice: in long logs copies add up.
    largest = max(float(np.abs(np.nan_to_num(x)).max(initial=0.0)) for x in acc.T)
    full = next((r for r in RANGES_M_S2 if abs(largest / r - 1.0) <= CLIPPED_SHARE), None)
    clipped = np.zeros(len(acc), bool)
    if full is not None:
        for x in acc.T:
            clipped |= np.abs(np.nan_to_num(x)) >= (1.0 - CLIPPED_SHARE) * full
    return clipped


def sizes(log: FlightLog, imu: Imu) -> list[Trace]:
    """Return magnitudes of specific force and field, with the expected ones."""
    where = alignment.flight_place(log)
    g = G if where is None else earth.gravity(where[0], where[2])
    found = [size_of("gravity", imu.acc.t, np.sqrt(np.einsum("ij,ij->i", imu.acc.x, imu.acc.x)), {"expected": g})]
    if log.mag is not None:
        field, model = log.mags[log.mag].field, alignment.earth_field(log)
        expected = {} if model is None else {"expected": model.strength_t * 1e6}
        found.append(size_of("field", field.t, np.sqrt(np.einsum("ij,ij->i", field.x, field.x)) * 1e6, expected))
    return [trace for trace in found if len(trace.t)]


def size_of(figure: str, t: Array, size: Array, values: dict[str, float]) -> Trace:
    """Return smallest, mean and largest of a magnitude (n,) over time."""
    good = np.isfinite(size)
    t, size = t[good], size[good]
    at, edges = buckets(t, 0.5)
    if len(at) == 0:
        return Trace(figure, "", at, {}, values=values)
    first = edges[:-1]
    low, high = np.minimum.reduceat(size, first), np.maximum.reduceat(size, first)
    columns = {"low": low, "mean": np.add.reduceat(size, first) / np.diff(edges), "high": high}
    return Trace(figure, "", at, columns, values=values)


def throttle(log: FlightLog) -> list[Trace]:
    """Return the throttle in percent, the mean of windows of half a second."""
    if log.power.throttle is None or len(log.power.throttle.t) < 2:
        return []
    x = np.nan_to_num(log.power.throttle.x.reshape(len(log.power.throttle.t), -1)[:, 0])
    at, edges = buckets(log.power.throttle.t, 0.5)
    return [Trace("throttle", "", at, {"throttle": 100.0 * np.add.reduceat(x, edges[:-1]) / np.diff(edges)})]


def rest_bias(case: Case, imu: Imu) -> list[Trace]:
    """Return the mean gyro rate per rest: bias and earth rate."""
    rests = [(a, b, between(imu.gyro.t, a, b)) for a, b in case.segments.spans("rest")]
    rests = [(a, b, inside) for a, b, inside in rests if inside.stop - inside.start >= MIN_SENSOR_SAMPLES]
    if not rests:
        return []
    t = np.array([0.5 * (a + b) for a, b, _ in rests])
    rates = np.degrees([np.mean(imu.gyro.x[inside], axis=0) for _, _, inside in rests])
    return [Trace("rest_bias", "", t, {axis: rates[:, k] for k, axis in enumerate(AXES)})]


def buckets(t: Array, seconds: float) -> tuple[Array, NDArray[np.int64]]:
    """Return middles (m,) and bounds (m + 1,) of time windows.

    Of ``t`` (n,): at most MAX_BUCKETS, at least ``seconds`` long.
    """
    if len(t) < 2:
        return np.zeros(0), np.zeros(1, np.int64)
    length = max(seconds, float(t[-1] - t[0]) / MAX_BUCKETS)
    starts = np.arange(t[0], t[-1] + length, length)
    edges = unique(np.append(np.searchsorted(t, starts), len(t))).astype(np.int64)
    return 0.5 * (t[edges[:-1]] + t[edges[1:] - 1]), edges


# Height over the flight, for a strip.
#
# ``height``: ``height`` (m) above the ground, means over equal parts of the log; no row. ``top`` (m): the largest in
# flight, as in the headline, where the log shows the ground.

Span = tuple[float, float]

# Largest number of equal parts of the log.
MAX_HEIGHT_POINTS = 400
# Time before and after a flight in which the vehicle stands on the ground.
GROUND_S = 5.0
# Shortest such time: a log that ends in the air continues shortly after the last sign of flight.
MIN_GROUND_S = 0.5


def height_trace(log: FlightLog, segments: Segments) -> list[Trace]:
    """Return the height above ground over the log.

    The height of the headline; without known ground that of the barometer, else of GNSS.
    """
    air, flights = segments.air, segments.spans("airborne")
    found = None if air is None or not flights else highest_level(air.levels, inside(air.grid.t, flights))
    if air is not None and found is not None:
        level, top = found
        known = np.isfinite(level.above)
        t, means = averaged(air.grid.t[known], level.above[known])
        return [Trace("height", "", t, {"height": means}, key=level.source, values={"top": top})]
    stream = height_stream(log)
    if stream is None or len(stream.t) < 2 or stream.t[-1] <= stream.t[0]:
        return []
    above = stream.x[:, 0] - ground(stream, flights)
    t, means = averaged(stream.t, above)
    return [Trace("height", "", t, {"height": means}, key=stream.source)]


def ground(stream: Stream, flights: list[Span]) -> Array:
    """Return the height (n,) of the ground below a flight.

    Linear between that before and after each flight: a barometer drifts by metres in minutes. Without a flight the
    median, without any ground the lowest height.
    """
    t, x = stream.t, stream.x[:, 0]
    if not flights:
        return np.full(len(t), median(x))
    flying = np.zeros(len(t), bool)
    for a, b in flights:
        flying |= (t >= a) & (t <= b)
    stood = [span for a, b in flights for span in ((a - GROUND_S, a), (b, b + GROUND_S))]
    parts = [(t >= a) & (t <= b) & ~flying for a, b in stood]
    long = [part for part in parts if part.any() and np.ptp(t[part]) >= MIN_GROUND_S]
    levels = [(float(np.mean(t[part])), float(median(x[part]))) for part in long]
    if not levels:
        return np.full(len(t), np.min(x))
    at, level = np.array(sorted(levels)).T
    under: Array = np.interp(t, at, level)
    return under


def averaged(t: Array, x: Array) -> tuple[Array, Array]:
    """Return times and means (m,) of x (n,) over equal parts."""
    edges = np.linspace(t[0], t[-1], min(MAX_HEIGHT_POINTS, max(len(t) // 4, 1)) + 1)
    part = np.clip(np.searchsorted(edges, t, "right") - 1, 0, len(edges) - 2)
    count = np.bincount(part, minlength=len(edges) - 1)
    total = np.bincount(part, weights=x, minlength=len(edges) - 1)
    return 0.5 * (edges[:-1] + edges[1:]), np.where(count > 0, total / np.maximum(count, 1), np.nan)
