"""Allan deviation of the heading at rest: random walk and bias instability."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import unique
from attlog.core.spans import Span
from attlog.metrics import following, statistics
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, missing, paragraph, per_row
from attlog.metrics.windows import deviations, reason_unavailable, rest_spans, within
from attlog.reference.model import Track

Array = NDArray[np.float64]

SHORTEST_S = 60.0  # averaging times of 15 s then have 4 intervals
POINTS_PER_DECADE = 12  # smooth on logarithmic axes
BLOCK = 1 << 14  # samples per block, which fits the cache
WALK_TAU_S = (0.3, 3.0)  # averaging times around 1 s, half a decade either way
# Slopes of an angle random walk: white rate noise falls as tau^-1/2.
WALK_SLOPE = (-0.7, -0.3)
# 0.664: the floor of flicker noise over its bias instability (IEEE Std 952, C.1.3).
FLICKER = math.sqrt(2.0 * math.log(2.0) / math.pi)
# Smallest ratio of the record to the averaging time of the floor.
MIN_RATIO = 10.0

_SHARED = """Overlapping Allan deviation of the rate of the row's heading in the longest rest of at least 60 s,
    averaging times from 2 samples to a quarter of it, chi-squared intervals (NIST SP 1065). """
_WALK = """Value at 1 s, where the deviation falls as tau^-1/2: how fast the heading walks away by white rate noise."""
_FLOOR = """Floor of the curve over 0.664: the drift rate that no averaging removes. Only where the rest is ten times
    longer than the averaging time of the floor."""
ALLAN_METRICS: tuple[Metric, ...] = (
    Metric(
        "allan_arw_deg_per_sqrt_h",
        "Angle random walk, heading",
        "deg/sqrt(h)",
        "low",
        paragraph(_SHARED + _WALK),
        asked="rest",
    ),
    Metric(
        "allan_bias_deg_per_h", "Bias instability, heading", "deg/h", "low", paragraph(_SHARED + _FLOOR), asked="rest"
    ),
)


@dataclass(slots=True)
class Deviation:
    """Allan deviation by averaging time ``tau`` (k,) s."""

    tau: Array
    sigma: Array
    low: Array
    high: Array
    dof: Array


def deviation(phase: Array, step: float) -> Deviation:
    """Return the overlapping Allan deviation of the rate of ``phase`` (n,).

    Samples are ``step`` s apart. NIST SP 1065 equation 11; degrees of freedom for white rate noise by equation 29
    (Howe, Allan and Barnes 1981).
    """
    n = len(phase)
    largest = (n - 1) // 4
    if largest < 2:
        return Deviation(*(np.zeros(0) for _ in range(5)))
    count = max(2, round(POINTS_PER_DECADE * math.log10(largest / 2.0)) + 1)
    m = unique(np.geomspace(2, largest, count).round().astype(int))
    sigma = np.sqrt([0.5 * _mean_square(phase, int(k)) for k in m]) / (m * step)
    dof = (3.0 * (n - 1) / (2.0 * m) - 2.0 * (n - 2) / n) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    bounds = np.array(
        [statistics.chi_square_interval(s, round(max(d, 1.0), 3)) for s, d in zip(sigma, dof, strict=True)]
    )
    return Deviation(m * step, sigma, bounds[:, 0], bounds[:, 1], dof)


def _mean_square(phase: Array, k: int) -> float:
    """Return the mean square second difference over ``k`` samples."""
    count, total = len(phase) - 2 * k, 0.0
    for a in range(0, count, BLOCK):
        b = min(a + BLOCK, count)
        d = phase[a + 2 * k : b + 2 * k] - 2.0 * phase[a + k : b + k] + phase[a:b]
        total += float(d @ d)
    return total / count


def average_deviation(angle: Array, step: float) -> Deviation:
    """Return the Allan deviation of an averaged angle (n,), in its own unit."""
    return deviation(np.concatenate([[0.0], np.cumsum(angle - np.mean(angle))]) * step, step)


def longest_rest(case: Case, row: Track, window: str) -> slice | None:
    """Return the longest finite segment at rest without a gap, or None."""
    return _longest_segment(case, row, rest_spans(case, row, window))


@per_row
def _longest_segment(case: Case, row: Track, spans: list[Span]) -> slice | None:
    segments = [p for span in spans for p in within(row.t, span, row.segment)]
    segments = [p for p in segments if p.stop - p.start > 8 and np.isfinite(row.q[p]).all()]
    return max(segments, key=lambda p: float(row.t[p.stop - 1] - row.t[p.start]), default=None)


@per_row
def rest_angles(case: Case, row: Track, segment: slice) -> Array:
    """Return the small rotations (n, 3) in deg of a row at rest from its mean attitude."""
    return deviations(row.q[segment])


@per_row
def heading_deviation(case: Case, row: Track, segment: slice) -> Deviation:
    """Return the Allan deviation of a row's heading in one segment."""
    t = row.t[segment]
    return deviation(rest_angles(case, row, segment)[:, 2], float(t[-1] - t[0]) / (len(t) - 1))


def random_walk(d: Deviation) -> tuple[float, float]:
    """Return the Allan deviation at 1 s and the slope around it."""
    near = (d.tau >= WALK_TAU_S[0]) & (d.tau <= WALK_TAU_S[1]) & (d.sigma > 0)
    if near.sum() < 3:
        return math.nan, math.nan
    slope = float(np.polyfit(np.log(d.tau[near]), np.log(d.sigma[near]), 1)[0])
    return math.exp(float(np.interp(0.0, np.log(d.tau[near]), np.log(d.sigma[near])))), slope


def compute_allan(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return random walk and bias instability of a row's heading."""
    segment = longest_rest(case, row, window)
    if segment is None:
        return ALLAN.without(*reason_unavailable(case, "rest", window), window)
    t = row.t[segment]
    length = float(t[-1] - t[0])
    if length < SHORTEST_S:
        reason = f"the longest rest is {length:.0f} s; {SHORTEST_S:.0f} s are needed"
        return ALLAN.without("rest_too_short", reason, window)
    d = heading_deviation(case, row, segment)
    found = {
        "allan_arw_deg_per_sqrt_h": _walk(d, length, window),
        "allan_bias_deg_per_h": floor_answer(d, length, window),
    }
    return {name: following.unrank_frozen(case, row, "heading", answer) for name, answer in found.items()}


def _walk(d: Deviation, length: float, window: str) -> Answer:
    value, slope = random_walk(d)
    unit = "deg/sqrt(h)"
    if not WALK_SLOPE[0] <= slope <= WALK_SLOPE[1]:
        reason = f"around 1 s the deviation goes as tau^{slope:.2f}, not tau^-0.5: this heading does not walk at random"
        return missing("not_applicable", reason, unit, window)
    at = int(np.argmin(np.abs(d.tau - 1.0)))
    low, high = statistics.chi_square_interval(60.0 * value, round(float(d.dof[at]), 3))
    return Answer(
        60.0 * value, unit, window, round(float(d.dof[at])), length, (low, high), "overlapping Allan deviation at 1 s"
    )


def floor_answer(d: Deviation, length: float, window: str) -> Answer:
    """Return the bias instability by the floor of a deviation."""
    lowest = int(np.argmin(d.sigma))
    tau, unit = float(d.tau[lowest]), "deg/h"
    if length < MIN_RATIO * tau or lowest == len(d.tau) - 1:
        needed = max(MIN_RATIO * tau, length)
        reason = f"the deviation still falls at {tau:.0f} s; a rest of more than {needed:.0f} s is needed"
        return missing("rest_too_short", reason, unit, window)
    factor = 3600.0 / FLICKER
    return Answer(
        factor * float(d.sigma[lowest]),
        unit,
        window,
        max(1, round(float(d.dof[lowest]))),
        length,
        (factor * float(d.low[lowest]), factor * float(d.high[lowest])),
        f"floor of the Allan deviation at {tau:.1f} s",
    )


ALLAN = MetricGroup("Allan deviation", "Noise", ALLAN_METRICS, compute_allan, ("all", "rest", "rest.long"))
METRIC_GROUPS = (ALLAN,)
