"""Least-squares fit of delay, gain, misalignment and aiding over step events.

Each event contributes a matrix (12, 12): products of its centred columns (:mod:`attlog.metrics.step_products`) at the
fitted delay. Their sum solves any choice of events: all, all but one, one axis, or those common to two rows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.metrics import step_products, step_sensors, step_turning
from attlog.metrics.metric import Case, per_case, per_object, per_row
from attlog.metrics.statistics import student
from attlog.metrics.step_products import EventBatches
from attlog.metrics.step_sensors import RowSensors, seen_by
from attlog.metrics.step_turning import AXES, SummedTurning, Timing
from attlog.metrics.windows import why_never_airborne
from attlog.reference.model import Track

Array = NDArray[np.float64]
Index = NDArray[np.int64]


Y, SLOPE, GAIN, AID = 0, 1, 2, slice(6, 12)
# Number of leading coefficients in a fit without aiding: slope, gain, misalignment.
PLAIN = 5
# Prior sigma of misalignment (rad) and aiding.
SCALES = np.concatenate([np.full(3, np.radians(5.0)), step_sensors.RIDGE])
RIDGE_WEIGHT = 10.0  # weight of the prior in samples
TINY = 1e-10  # share of the power, against singularity
MIN_EVENTS = 3  # a jackknife of fewer has no interval


@dataclass(slots=True)
class Fit:
    """Fitted delay (s, positive: late), gain and further parameters.

    ``distortion`` and ``share`` (of the aiding) are relative to the RMS of the reference's rate. ``shape_s``: residual
    over the RMS of the rate's slope. ``aiding_shift_s``: change of the delay by the aiding; ``plain_gain``: gain
    without aiding. ``coefficients`` (11,). ``left_out`` (events, 3): delay, gain and distortion without
    each event; ``each`` (events,): delay of each event alone; ``events`` (events,): their numbers in ``sums``.
    """

    delay: float
    gain: float
    distortion: float
    share: float
    shape_s: float
    aiding_shift_s: float
    plain_gain: float
    coefficients: Array
    left_out: Array
    each: Array
    events: Index
    seconds: float
    sums: NormalEquations
    at_edge: bool = False

    def half_width(self, column: int) -> float:
        """Return half a column's 95 % jackknife interval; infinite under 3 events."""
        values = self.left_out[:, column]
        k = len(values)
        if k < MIN_EVENTS or not np.isfinite(values).all():
            return math.inf
        return student(0.975, k - 1) * math.sqrt((k - 1) / k * float(np.sum((values - np.mean(values)) ** 2)))


@dataclass(slots=True)
class NormalEquations:
    """Products (k, 12, 12) of k events at ``delay`` s.

    ``plain``: products with the slope of the bare rate. ``lines`` (k,): samples of each event; ``seconds`` (k,): its
    duration. ``ridge`` (11, 11) is added to the normal matrix. ``kept`` (11,): coefficients, set if misalignment and
    aiding are fixed.
    """

    products: Array
    plain: Array
    lines: Index
    seconds: Array
    delay: float
    slow_row: bool
    ridge: Array
    kept: Array | None = None
    # Share of the time in which the specific force exceeds 2 g.
    heavy: float = 0.0
    axis: Index = field(default_factory=lambda: np.zeros(0, np.int64))

    def keeping(self, x: Array) -> NormalEquations:
        """Return the equations with misalignment and aiding fixed at ``x`` (11,)."""
        return replace(self, kept=x)

    def solve(self, total: Array) -> Array:
        """Return slope, gain, misalignment, aiding (..., 11) for products (..., 12, 12)."""
        normal, right = total[..., 1:, 1:] + self.ridge, total[..., 1:, Y]
        if self.kept is None:
            return _solved(normal, right)
        x = np.array(np.broadcast_to(self.kept, right.shape))
        x[..., :2] = _solved(normal[..., :2, :2], right[..., :2] - normal[..., :2, 2:] @ self.kept[2:])
        return x

    def step(self, x: Array) -> Array:
        """Return the change of delay (...,) in s: slope over gain."""
        gain = np.where(self.slow_row & (np.abs(x[..., 1]) > 0.1), x[..., 1], 1.0)
        return np.asarray(-x[..., 0] / gain)

    def without_aiding(self, number: Index) -> tuple[float, float]:
        """Return delay (s) and gain of events, fitted without aiding."""
        total = self.plain[number].sum(axis=0)
        free = PLAIN if self.kept is None else 2
        x = np.zeros(SCALES.size + 2)
        if self.kept is not None:
            x[2:PLAIN] = self.kept[2:PLAIN]
        normal = total[1:, 1:] + self.ridge
        x[:free] = np.linalg.solve(normal[:free, :free], total[1 : 1 + free, Y] - normal[:free, free:] @ x[free:])
        return self.delay + float(self.step(x)), float(x[1])

    def fit(self, number: Index) -> Fit:
        """Return the fit of the events ``number`` (at least one)."""
        total = self.products[number].sum(axis=0)
        x = self.solve(total)
        delay = self.delay + float(self.step(x))
        plain_delay, plain_gain = self.without_aiding(number)
        aided = float(x[PLAIN:] @ total[AID, AID] @ x[PLAIN:])
        lone = self.keeping(x)
        return Fit(
            delay,
            float(x[1]),
            float(_ratio(residual_squares(total, x), total[GAIN, GAIN])),
            float(_ratio(aided, total[GAIN, GAIN])),
            float(_ratio(residual_squares(total, x), total[SLOPE, SLOPE])),
            delay - plain_delay,
            plain_gain,
            x,
            self._without_each(number, total),
            self.delay + lone.step(lone.solve(self.products[number])),
            number,
            float(self.seconds[number].sum()),
            self,
        )

    def _without_each(self, number: Index, total: Array) -> Array:
        """Return delay, gain and distortion (k, 3) without each event."""
        others = total - self.products[number]
        x = self.solve(others)
        distortion = _ratio(residual_squares(others, x), others[:, GAIN, GAIN])
        return np.column_stack([self.delay + self.step(x), x[:, 1], distortion])


def ridge(total: Array, variance: float, lines: int) -> Array:
    """Return the ridge (11, 11) of the normal matrix."""
    power = float(total[GAIN, GAIN])
    weights = np.zeros(SCALES.size + 2)
    weights[2:] = RIDGE_WEIGHT * max(variance, 1e-9 * power / max(lines, 1)) / SCALES**2
    return np.diag(weights + TINY * (power + TINY))


def residual_squares(total: Array, x: Array) -> Array:
    """Return the sum of squared residuals (...) for coefficients (..., 11)."""
    explained = _form(total[..., 1:, 1:], x) - 2.0 * np.sum(x * total[..., 1:, Y], axis=-1)
    return np.asarray(np.maximum(total[..., Y, Y] + explained, 0.0))


def _solved(normal: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])


def _form(normal: Array, x: Array) -> Array:
    return np.asarray((x[..., None, :] @ normal @ x[..., None])[..., 0, 0])


def _ratio(squares: ArrayLike, of: ArrayLike) -> Array:
    """Return the root (...) of a ratio of squares; infinite over zero."""
    part, whole = np.maximum(squares, 0.0), np.asarray(of, np.float64)
    return np.asarray(np.sqrt(np.divide(part, whole, out=np.full(np.shape(whole), math.inf), where=whole > 0)))


# Fit of a row's turning to the reference's over all events together.
#
# Body rates w are summed increments of attitude over a span h; u is the event's axis.
# Minimised over delay tau, gain k, body misalignment phi, aiding gains a_j
# (:mod:`attlog.metrics.step_sensors`) and one constant c per event:
#
#     sum ( u.w_est(t + tau) - k u.w_ref(t) - phi.(w_ref x u) - sum_j a_j u.n_j(t + tau) - c )^2
#
# Gauss-Newton in tau; everything else is linear.

# Searched range of delays, either way, and its coarse grid.
RANGE_S, COARSE_S = 0.25, 0.025
SLOPE_S, LARGEST_STEP_S = 0.008, 0.020  # half span of the slope, largest Gauss-Newton step
ENOUGH_S, MOST_STEPS = 3e-5, 20  # step that ends the iteration, largest number of steps


def fit(groups: EventBatches) -> dict[str, Fit]:
    """Return the fit of all events (``all``) and of each axis.

    Those of an axis keep the misalignment and aiding of ``all``.
    """
    delay, at_edge = _start(groups)
    sums = _sums(groups, delay, None)
    for _ in range(MOST_STEPS):
        total = sums.products.sum(axis=0)
        x = sums.solve(total)
        step = float(np.clip(sums.step(x), -LARGEST_STEP_S, LARGEST_STEP_S))
        delay = float(np.clip(delay + step, -RANGE_S, RANGE_S))
        sums = _sums(groups, delay, (x, float(residual_squares(total, x))))
        if abs(step) < ENOUGH_S or abs(delay) >= RANGE_S:
            break
    at_edge = at_edge or abs(delay) > RANGE_S - 1e-3
    sums.plain, _ = groups.products(delay, SLOPE_S, np.zeros(len(step_sensors.NAMES)))
    present = np.flatnonzero(sums.lines)
    if len(present) == 0:
        return {}
    fits = {"all": sums.fit(present)}
    kept = sums.keeping(fits["all"].coefficients)
    for axis, name in enumerate(AXES):
        own = present[sums.axis[present] == axis]
        if len(own):
            fits[name] = kept.fit(own)
    for found in fits.values():
        found.at_edge = at_edge or abs(found.delay) > RANGE_S - 1e-3
    return fits


def _start(groups: EventBatches) -> tuple[float, bool]:
    """Return the coarse-grid delay of largest correlation, and whether at an end."""
    grid = np.arange(-RANGE_S, RANGE_S + 1e-9, COARSE_S)
    best = int(np.argmax(groups.correlations(grid)))
    return float(grid[best]), best in (0, len(grid) - 1)


def _sums(groups: EventBatches, delay: float, last: tuple[Array, float] | None) -> NormalEquations:
    """Return the normal equations at a delay.

    ``last``: coefficients and squared residuals of the previous iteration.
    """
    aids = np.zeros(len(step_sensors.NAMES)) if last is None else last[0][PLAIN:]
    products, count = groups.products(delay, SLOPE_S, aids)
    total, lines = products.sum(axis=0), max(int(count.sum()), 1)
    squares = total[Y, Y] - total[Y, GAIN] ** 2 / max(total[GAIN, GAIN], 1e-30) if last is None else last[1]
    return NormalEquations(
        products,
        products,
        count,
        np.array([e.end - e.begin for e in groups.events]),
        delay,
        groups.slow_row,
        ridge(total, float(max(squares, 0.0)) / lines, lines),
        heavy=groups.heavy,
        axis=np.array([e.axis for e in groups.events], np.int64),
    )


MIN_REFERENCE_HZ = 5.0  # slower ones resolve no step of 0.2 s


def fits(case: Case, row: Track, window: str) -> dict[str, Fit]:
    """Return a row's fits in a window, per axis and ``all``."""
    found = evidence(case, row, window)
    return {} if found is None else found.fits


@dataclass(slots=True)
class RowFits:
    """Fits of a row per axis and ``all``, with their events."""

    fits: dict[str, Fit]
    events: list[step_turning.StepEvent]


def evidence(case: Case, row: Track, window: str) -> RowFits | None:
    """Return the fits of a row in a window; None without events."""
    return _evidence(case, row, first_with(case, row, window)) if events_in(case, row, window) else None


def first_with(case: Case, row: Track, window: str) -> str:
    """Return ``all`` if it has the same events, else the window."""
    return "all" if events_in(case, row, window) == events_in(case, row, "all") else window


@per_row
def events_in(case: Case, row: Track, window: str) -> list[step_turning.StepEvent]:
    """Return the events of a window in which this row is scored."""
    return step_turning.steps_in_window(case, scored_events(case, row), window)


@per_row
def _evidence(case: Case, row: Track, window: str) -> RowFits | None:
    track = SummedTurning(row.t, row.q, row.segment, timing(case, row.t))
    seen = seen_by(case, row)
    sensors = None if seen is None else RowSensors(case, row, track, seen)
    groups = step_products.event_batches(track, reference_turning(case), events_in(case, row, window), sensors)
    return None if groups is None else RowFits(fit(groups), groups.events)


@per_object
def timing(case: Case, t: Array) -> Timing:
    """Return :class:`Timing` of times (n,)."""
    return Timing.of(t)


@per_case
def reference_turning(case: Case) -> SummedTurning:
    """Return the reference's attitude as summed turning."""
    return SummedTurning(case.reference.t, case.reference.q, case.reference.segment)


def scored_events(case: Case, row: Track) -> list[step_turning.StepEvent]:
    """Return the reference's events in which this row is scored."""
    errors = row.errors
    if errors is None or len(errors.t) == 0:
        return []
    events = step_turning.reference_steps(case)
    at = np.clip(np.searchsorted(errors.t, [e.onset for e in events]), 0, len(errors.t) - 1)
    return [e for e, i in zip(events, at, strict=True) if errors.scored[i]]


def why_no_events(case: Case, row: Track, window: str) -> tuple[str, str] | None:
    """Return code and reason if a row has no events, else None."""
    rate = case.reference.rate
    if rate < MIN_REFERENCE_HZ:
        return (
            "reference_too_slow",
            f"the reference comes at {rate:.1f} Hz; {MIN_REFERENCE_HZ:.0f} Hz are needed for steps",
        )
    if not events_in(case, row, window):
        where = {"all": "in this log", "airborne": "in flight"}.get(window, f"in {window}")
        if window == "airborne" and not case.segments.spans("airborne"):
            return "no_events", why_never_airborne(case)
        sizes = (
            f"{step_turning.SMALLEST_DEG[0]:.0f} deg in roll or pitch or {step_turning.SMALLEST_DEG[2]:.0f} deg in yaw"
        )
        start = f"from {case.reference.scoring.start:.0f} s on"
        return "no_events", f"no step {where} {start}; turns of {sizes} within 1 s are needed"
    return None


def too_few(count: int, where: str = "") -> str:
    """Return the reason for fewer than MIN_EVENTS."""
    return f"{count} step{'' if count == 1 else 's'}{where}; at least {MIN_EVENTS} are needed"
