"""How quiet is a row at rest? Standard deviation within 5 s windows, with its effective sample size."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.metrics import follow, interval
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, applies_to, paragraph, per_case, per_row
from attlog.metrics.evidence import NOISE_REST_S, REST_SETTLE_S, seconds, within
from attlog.reference.model import Row
from attlog.segments.spans import Span, intersect

Array = NDArray[np.float64]

WINDOW_S = 5.0
"""Longer swings are wander, which the Allan deviation and the drift describe."""
SETTLE_S = REST_SETTLE_S
"""Rest counts from this long after the row's own start (METRICS 2.6)."""
SHORTEST_S = NOISE_REST_S
MIN_SAMPLES = 8
STEP_SAMPLES = 20_000
"""Gyro samples of the whole log that are enough to see the step of its values."""
AXES = ("roll", "pitch", "heading")

_TEXT = paragraph(
    """While the vehicle stands still with motors off (in the window idle: motors turning), in windows of 5 s (one
    window where the rest is shorter): rotation away from the window's mean attitude, straight line removed,
    standard deviation (n - 2), pooled over windows. Interval: chi-square with 0.7 n - 2 windows degrees of freedom,
    n being the samples divided by 1 + 2 sum rho^2 of their autocorrelation; from 4 windows on a t interval on the
    logarithm of the window variances. Ranked only for rows that follow motion, and only above half the step of the
    logged values and above what the steps of the logged gyro can hide."""
)
_TEXT_P2P = paragraph(
    """Width of the middle 99.8 % of the same residuals, the larger of roll and pitch. A width set by the few largest
    samples of this record: shown without an interval and never ranked."""
)
METRICS: tuple[Metric, ...] = (
    Metric("noise_roll_deg", "Static noise, roll", "deg", "low", ("rest",), _TEXT),
    Metric("noise_pitch_deg", "Static noise, pitch", "deg", "low", ("rest",), _TEXT),
    Metric("noise_heading_deg", "Static noise, heading", "deg", "low", ("rest",), _TEXT),
    Metric("noise_p2p_deg", "Static noise, peak to peak", "deg", "low", ("rest",), _TEXT_P2P),
)


@dataclass(slots=True)
class Noise:
    """Pooled statistic of one signal: ``sigma`` in its unit, ``n`` effective samples, ``p2p`` the middle 99.8 %."""

    sigma: float
    ci95: interval.Interval
    n: float
    windows: int
    p2p: float
    method: str


def cut(t: Array, segment: slice) -> list[slice]:
    """Windows of 5 s from the start of a segment of samples; one window where it is 2 to 5 s long."""
    length = t[segment.stop - 1] - t[segment.start]
    if length < SHORTEST_S - 0.1:
        return []
    count = int((length + 0.05) // WINDOW_S)
    if count == 0:
        found = [segment]
    else:
        edges = np.searchsorted(t[segment], t[segment.start] + WINDOW_S * np.arange(count + 1))
        found = [slice(int(a) + segment.start, int(b) + segment.start) for a, b in pairwise(edges)]
    return [w for w in found if w.stop - w.start >= MIN_SAMPLES]


def windows_in(t: Array, x: Array, spans: list[Span], run: NDArray[np.int64] | None = None) -> list[slice]:
    """Windows of a signal ``x`` (n, k) at ``t`` (n,) s within spans of time: none with a gap or a value that is NaN."""
    windows = [w for span in spans for segment in within(t, span, run) for w in cut(t, segment)]
    return [w for w in windows if np.isfinite(x[w]).all()]


def detrended(t: Array, x: Array) -> Array:
    """``x`` (n,) or (n, k) without its least-squares straight line over ``t`` (n,)."""
    u = t - np.mean(t)
    centred = x - np.mean(x, axis=0)
    slope = np.tensordot(u, centred, axes=(0, 0)) / float(u @ u)
    return centred - (u[:, None] * slope if x.ndim == 2 else u * slope)


def effective_count(residuals: list[Array]) -> float:
    """Independent samples in windows of residuals: N / (1 + 2 sum rho_k^2).

    rho is the autocorrelation pooled over the windows, up to the first lag below 0.05.
    """
    total = sum(len(r) for r in residuals)
    lags = min(len(r) for r in residuals)
    covariance = np.zeros(lags)
    for r in residuals:
        size = 1 << (2 * len(r) - 1).bit_length()
        spectrum = np.fft.rfft(r, size)
        covariance += np.fft.irfft(spectrum.real**2 + spectrum.imag**2, size)[:lags]
    if covariance[0] <= 0:
        return float(total)
    rho = covariance / covariance[0]
    small = np.flatnonzero(rho < 0.05)
    end = int(small[0]) if len(small) else lags
    return total / (1.0 + 2.0 * float(np.sum(rho[1:end] ** 2)))


def pooled(residuals: list[Array]) -> Noise | None:
    """The noise of windows of detrended residuals (METRICS 3); None without windows or without any variation."""
    if not residuals:
        return None
    variances = np.array([float(r @ r) / (len(r) - 2) for r in residuals])
    variance = sum(float(r @ r) for r in residuals) / sum(len(r) - 2 for r in residuals)
    sigma = math.sqrt(variance)
    n = effective_count(residuals)
    windows = len(residuals)
    everything = np.concatenate(residuals)
    low, high = np.quantile(everything, [0.001, 0.999])
    by_log = interval.of_sigma_log(sigma, variances) if windows >= 4 else None
    if by_log is not None:
        return Noise(sigma, by_log, n, windows, float(high - low), f"{windows} windows, t interval on log variance")
    dof = max(1.0, 0.7 * n - 2.0 * windows)
    ci95 = interval.of_sigma_chi_square(sigma, dof)
    return Noise(
        sigma, ci95, n, windows, float(high - low), f"{windows} windows, chi-square with {dof:.1f} degrees of freedom"
    )


def deviations(q: Array) -> Array:
    """Small rotations (n, 4) in deg away from the mean attitude: about body x, y, z and about the vertical."""
    centre = rotation.mean(q)
    body = rotation.to_rotvec(rotation.multiply(rotation.conjugate(centre), q))
    heading = rotation.heading_angle(rotation.error(q, centre))
    return np.degrees(np.column_stack([body, heading]))


def rest_spans(case: Case, row: Row, window: str) -> list[Span]:
    """Rest (idle in the window idle) inside the window, from 5 s after the row's own start."""
    kind = window if window in ("idle", "rest.long") else "rest"
    spans = case.segments.spans(kind)
    if ":" in window:
        spans = intersect(spans, case.segments.spans(window))
    return intersect(spans, [(row.start + SETTLE_S, math.inf)])


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without rest by definition."""
    if not applies_to(window, "all", "rest", "rest.long", "idle"):
        return {}
    spans = rest_spans(case, row, window)
    windows, noises = measured(case, row, spans)
    if not windows:
        code, reason = why_no_rest(case, window, spans)
        return {m.name: missing(code, reason, "deg", window) for m in METRICS}
    roll, pitch, heading, yaw = noises
    shared = {"windows": len(windows), "body_z_deg": yaw.sigma, **input_noise(case, spans)}
    duration = seconds(row.t, windows)
    answers = {
        f"noise_{axis}_deg": _answer(case, row, window, axis, noise, duration, shared)
        for axis, noise in zip(AXES, (roll, pitch, heading), strict=True)
    }
    wider = max(roll, pitch, key=lambda n: n.p2p)
    answers["noise_p2p_deg"] = Answer(
        wider.p2p,
        "deg",
        window,
        max(1, round(wider.n)),
        duration,
        None,
        "middle 99.8 % of the residuals",
        reason="set by the few largest samples of this record",
        ranked=False,
        detail={"heading_deg": heading.p2p, "windows": len(windows)},
    )
    return answers


@per_row
def measured(case: Case, row: Row, spans: list[Span]) -> tuple[list[slice], list[Noise]]:
    """The windows of a row within spans of rest, and its noise about roll, pitch, the vertical and body z."""
    windows = windows_in(row.t, row.q, spans, row.segment)
    residuals = [detrended(row.t[w], deviations(row.q[w])) for w in windows]
    found = [pooled([r[:, axis] for r in residuals]) for axis in (0, 1, 3, 2)]
    return windows, [n for n in found if n is not None]


def _answer(
    case: Case, row: Row, window: str, axis: str, noise: Noise, duration: float, shared: dict[str, object]
) -> Answer:
    sigma, (low, high), reason = noise.sigma, noise.ci95, None
    hidden = quantisation_floor_deg(case)[AXES.index(axis)] if row.kind == "replay" else 0.0
    if math.isinf(hidden):
        reason, hidden = "the logged gyro never changes about this axis, so its noise is not known", 0.0
    elif sigma < hidden:
        reason = f"below the noise of {hidden:.2g} deg that the steps of the logged gyro can hide"
    elif sigma < 0.5 * row.step_deg:
        reason = f"below half the step of the logged values ({row.step_deg:.3g} deg)"
    elif row.step_deg > 0:
        correction = row.step_deg**2 / 12.0
        low, high = (math.sqrt(max(x**2 - correction, 0.0)) for x in (low, high))
        sigma = math.sqrt(sigma**2 - correction)
    answer = Answer(
        sigma, "deg", window, max(1, round(noise.n)), duration, (low, high), noise.method, reason=reason,
        ranked=reason is None,
        detail=shared | {"effective_samples": noise.n, "step_deg": row.step_deg},
        floor=max(row.step_deg / 2.0, hidden),
    )  # fmt: skip
    return follow.unrank_frozen(case, row, axis, answer)


@per_case
def input_noise(case: Case, spans: list[Span]) -> dict[str, list[float]]:
    """The same statistic of the replayed gyro (deg/s) and accelerometer (m/s^2) in the same windows, per body axis."""
    found: dict[str, list[float]] = {}
    if case.log.imu is None:
        return found
    imu = case.log.imus[case.log.imu]
    for name, stream, factor in (("gyro_dps", imu.gyro, np.degrees(1.0)), ("acc_m_s2", imu.acc, 1.0)):
        residuals = [detrended(stream.t[w], stream.x[w]) for w in windows_in(stream.t, stream.x, spans)]
        if residuals:
            weight = sum(len(r) - 2 for r in residuals)
            sigma = np.sqrt(sum(np.sum(r**2, axis=0) for r in residuals) / weight) * factor
            found[f"input_{name}"] = [float(s) for s in sigma]
    return found


@per_case
def quantisation_floor_deg(case: Case) -> list[float]:
    """The angle noise in deg per body axis that the steps of the replayed gyro's logged values can hide.

    White rate noise of half a step q may not show at all. Integrated every dt it walks at
    random, and a random walk of length T keeps 1/15 of its last variance about its own
    straight line: sqrt(dt T / 15) q / 2 in windows of T = 5 s. Tiny for floating-point
    logs, 0.005 deg at 10 Hz and 1 mrad/s, infinite for an axis that never changes.
    """
    gyro = None if case.log.imu is None else case.log.imus[case.log.imu].gyro
    if gyro is None or len(gyro.t) < 2:
        return [0.0] * 3
    some = np.degrees(gyro.x[:: len(gyro.t) // STEP_SAMPLES + 1])
    steps = [np.diff(np.unique(x[np.isfinite(x)])).min(initial=math.inf) for x in some.T]
    share = 0.5 * math.sqrt(float(np.median(np.diff(gyro.t))) * WINDOW_S / 15.0)
    return [share * float(step) for step in steps]


def why_no_rest(case: Case, window: str, spans: list[Span]) -> tuple[str, str]:
    """Code and reason where a row has no usable rest."""
    if window == "idle":
        return "no_rest", "the vehicle never stood with its motors turning"
    if not case.segments.spans("rest"):
        return "no_rest", "the vehicle never stood still with motors off for 2 s; record 10 s before arming"
    if window == "rest.long" and not case.segments.spans(window):
        return "no_rest", "no rest of this log is long enough to count as long; record 10 s before arming"
    if not spans:
        where = f" in {window} s" if ":" in window else ""
        return "no_rest", f"there is no rest{where} later than {SETTLE_S:.0f} s after the filter's start"
    return "rest_too_short", f"no rest of {SHORTEST_S:.0f} s holds {MIN_SAMPLES} samples of this row without a gap"
