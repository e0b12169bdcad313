"""What sums of products over step events tell: delay, gain, misalignment, aiding, and what each event changes.

The products (12, 12) of one event hold its centred columns (:mod:`attlog.metrics.steps.fit.columns`) at
the fitted delay. Any choice of events is solved from their sum: all, all but one, one
axis, or those that two rows share.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.metrics.statistics.quantiles import student
from attlog.metrics.steps.fit import aiding

Array = NDArray[np.float64]
Index = NDArray[np.int64]


Y, SLOPE, GAIN, AID = 0, 1, 2, slice(6, 12)
PLAIN = 5
"""Slope, gain and misalignment come first: a fit without aiding takes these alone."""
SCALES = np.concatenate([np.full(3, np.radians(5.0)), aiding.RIDGE])
"""Misalignment (rad) and aiding beyond these are not believed without much evidence."""
RIDGE_WEIGHT = 10.0
TINY = 1e-10
MIN_EVENTS = 3


@dataclass(slots=True)
class Fit:
    """Delay (s, positive: the estimate is late), gain and what else was fitted.

    ``distortion`` and ``share`` (of the aiding) are relative to the RMS of the reference's rate, ``shape_s`` is
    the residual over the RMS of its slope, ``moved_s`` what the aiding changes the delay by, ``plain_gain``
    the gain without it, ``leak`` (1/s) how fast gravity takes tilt back (NaN without). ``left_out`` (events, 4)
    are delay, gain, distortion and leak with one event left out each, ``each`` (events,) the delays of the
    single ones, ``events`` (events,) their numbers in ``sums``.
    """

    delay: float
    gain: float
    distortion: float
    share: float
    shape_s: float
    moved_s: float
    plain_gain: float
    leak: float
    x: Array
    left_out: Array
    each: Array
    events: Index
    seconds: float
    sums: Sums
    at_edge: bool = False

    def half_width(self, column: int) -> float:
        """Half the 95 % jackknife interval of delay (s), gain, distortion or leak; inf under 3 events."""
        values = self.left_out[:, column]
        k = len(values)
        if k < MIN_EVENTS or not np.isfinite(values).all():
            return math.inf
        return student(0.975, k - 1) * math.sqrt((k - 1) / k * float(np.sum((values - np.mean(values)) ** 2)))


@dataclass(slots=True)
class Sums:
    """Products (k, 12, 12) of k events at ``delay`` s; ``plain`` the same with the slope of the bare rate.

    ``lines`` (k,) samples and ``seconds`` (k,) of each event; ``ridge`` (11, 11) what a fit adds to the
    normal matrix; ``kept`` (11,) is set where misalignment and aiding are not free.
    """

    products: Array
    plain: Array
    lines: Index
    seconds: Array
    delay: float
    slow_row: bool
    ridge: Array
    kept: Array | None = None
    heavy: float = 0.0
    """Share of the time in which the specific force exceeds 2 g."""
    axis: Index = field(default_factory=lambda: np.zeros(0, np.int64))

    def keeping(self, x: Array) -> Sums:
        """The same sums with misalignment and aiding as they are in coefficients ``x`` (11,)."""
        return replace(self, kept=x)

    def solve(self, total: Array) -> Array:
        """Coefficients (..., 11) of slope, gain, misalignment and aiding of summed products (..., 12, 12)."""
        normal, right = total[..., 1:, 1:] + self.ridge, total[..., 1:, Y]
        if self.kept is None:
            return _solved(normal, right)
        x = np.array(np.broadcast_to(self.kept, right.shape))
        x[..., :2] = _solved(normal[..., :2, :2], right[..., :2] - normal[..., :2, 2:] @ self.kept[2:])
        return x

    def step(self, x: Array) -> Array:
        """The change of delay (...,) in s by coefficients ``x`` (..., k) of the fit: slope over gain."""
        gain = np.where(self.slow_row & (np.abs(x[..., 1]) > 0.1), x[..., 1], 1.0)
        return np.asarray(-x[..., 0] / gain)

    def without_aiding(self, number: Index) -> tuple[float, float]:
        """Delay (s) and gain of some events where nothing but gain and misalignment is fitted."""
        total = self.plain[number].sum(axis=0)
        free = PLAIN if self.kept is None else 2
        x = np.zeros(SCALES.size + 2)
        if self.kept is not None:
            x[2:PLAIN] = self.kept[2:PLAIN]
        normal = total[1:, 1:] + self.ridge
        x[:free] = np.linalg.solve(normal[:free, :free], total[1 : 1 + free, Y] - normal[:free, free:] @ x[free:])
        return self.delay + float(self.step(x)), float(x[1])

    def fit(self, number: Index) -> Fit:
        """The fit of the events with these numbers (at least one)."""
        total = self.products[number].sum(axis=0)
        x = self.solve(total)
        delay = self.delay + float(self.step(x))
        plain_delay, plain_gain = self.without_aiding(number)
        aided = float(x[PLAIN:] @ total[AID, AID] @ x[PLAIN:])
        lone = self.keeping(x)
        return Fit(
            delay,
            float(x[1]),
            float(_ratio(left(total, x), total[GAIN, GAIN])),
            float(_ratio(aided, total[GAIN, GAIN])),
            float(_ratio(left(total, x), total[SLOPE, SLOPE])),
            delay - plain_delay,
            plain_gain,
            float(_leak(total, x)),
            x,
            self._without_each(number, total),
            self.delay + lone.step(lone.solve(self.products[number])),
            number,
            float(self.seconds[number].sum()),
            self,
        )

    def _without_each(self, number: Index, total: Array) -> Array:
        """Delay, gain, distortion and leak (k, 4) of the ``total`` (12, 12) with one of the events left out each."""
        others = total - self.products[number]
        x = self.solve(others)
        distortion = _ratio(left(others, x), others[:, GAIN, GAIN])
        return np.column_stack([self.delay + self.step(x), x[:, 1], distortion, _leak(others, x)])


def ridge(total: Array, variance: float, lines: int) -> Array:
    """What is added to the normal matrix (11, 11): weights of misalignment and aiding, a trace against singularity."""
    power = float(total[GAIN, GAIN])
    weights = np.zeros(SCALES.size + 2)
    weights[2:] = RIDGE_WEIGHT * max(variance, 1e-9 * power / max(lines, 1)) / SCALES**2
    return np.diag(weights + TINY * (power + TINY))


def left(total: Array, x: Array) -> Array:
    """The squares (...) that coefficients (..., 11) leave of the row's rate, of summed products (..., 12, 12)."""
    explained = _form(total[..., 1:, 1:], x) - 2.0 * np.sum(x * total[..., 1:, Y], axis=-1)
    return np.asarray(np.maximum(total[..., Y, Y] + explained, 0.0))


def _solved(normal: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])


def _form(normal: Array, x: Array) -> Array:
    return np.asarray((x[..., None, :] @ normal @ x[..., None])[..., 0, 0])


def _ratio(squares: ArrayLike, of: ArrayLike) -> Array:
    """The root (...) of squares over others; inf where these are none."""
    part, whole = np.maximum(squares, 0.0), np.asarray(of, np.float64)
    return np.asarray(np.sqrt(np.divide(part, whole, out=np.full(np.shape(whole), math.inf), where=whole > 0)))


def _leak(total: Array, x: Array) -> Array:
    """Gravity's fitted aiding regressed on its direction form, 1/s; NaN without any. (...) of (..., 12, 12)."""
    gravity = slice(AID.start, AID.start + aiding.GRAVITY_AIDING)
    down = AID.start + aiding.NAMES.index("D")
    square = total[..., down, down]
    product = np.sum(x[..., PLAIN : PLAIN + aiding.GRAVITY_AIDING] * total[..., gravity, down], axis=-1)
    return np.asarray(np.divide(product, square, out=np.full(np.shape(square), math.nan), where=square > 1e-12))
