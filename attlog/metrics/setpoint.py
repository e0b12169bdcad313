"""Attitude response to its set-point: causal impulse response by regularised least squares.

Changes of the attitude are a sum of earlier changes of the set-point,

    dy(t) = sum_k h_k dx(t - k dt) + noise,    0 <= k dt <= 1 s,

so that trim, wind and slow drift do not enter. The response is expected to be smooth and to die out: among those that
explain the data the one with the smallest ``h' P^-1 h`` is taken, with ``P_ij = c min(d_i, d_j)``, d falling by e every
0.25 s (the tuned/correlated kernel of Chen2012).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.spans import Span, intersect
from attlog.flight.model import Attitude
from attlog.flight.vehicle import commands_attitude
from attlog.metrics import statistics
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, missing, paragraph, per_case
from attlog.metrics.statistics import groups_of, root_mean_square
from attlog.metrics.windows import within
from attlog.reference.model import Track

Array = NDArray[np.float64]
# Evenly spaced times (n,), set-point (n, 2) and attitude (n, 2) in deg: roll and pitch.
SetpointSegment = tuple[Array, Array, Array]

MEMORY_S = 1.0  # length of the impulse response
# Prior decay time (to 1/e) of the impulse response.
DECAY_S = 0.25
# Shortest likely response: scale of the prior.
SHARP_S = 0.05
BLOCK_S = 1.0  # as long as the memory: neighbours are nearly independent
# Smallest standard deviation of the set-point in a block and the second before.
MOVING_DEG = 1.0
BAND = 0.05  # the usual 5 % band of settling
# Start of the part whose mean scales the step response.
LEVEL_S = 0.8


@dataclass(slots=True)
class ResponseEquations:
    """Normal equations of k blocks of one second.

    ``xx`` (k, m, m), ``xy`` (k, m), ``yy`` and ``count`` (k,) over m lags ``step`` s apart. ``axis`` (k,): 0 roll, 1
    pitch.
    """

    xx: Array
    xy: Array
    yy: Array
    count: Array
    axis: NDArray[np.int64]
    step: float

    def only(self, which: NDArray[np.bool_]) -> ResponseEquations:
        """Return the blocks marked by ``which`` (k,)."""
        return ResponseEquations(
            self.xx[which], self.xy[which], self.yy[which], self.count[which], self.axis[which], self.step
        )


def blocks_of(segments: list[SetpointSegment]) -> ResponseEquations | None:
    """Return the blocks in which the set-point moved, or None."""
    if not segments:
        return None
    step = float(segments[0][0][1] - segments[0][0][0])
    lags, size = round(MEMORY_S / step) + 1, max(round(BLOCK_S / step), 1)
    found: list[tuple[Array, Array, float, float, int]] = []
    for t, wanted, flown in segments:
        for axis in (0, 1):
            x, y = wanted[:, axis], flown[:, axis]
            begins = np.arange(lags, len(t) - size, size)
            if len(begins) == 0:
                continue
            moving = np.std(sliding_window_view(x, lags + size)[begins - lags], axis=1) > MOVING_DEG
            for begin in begins[moving].tolist():
                found.append((*_normal(x, y, begin, size, lags), axis))
    if not found:
        return None
    xx, xy, yy, count, axes = (np.array(v) for v in zip(*found, strict=True))
    return ResponseEquations(xx, xy, yy, count, axes.astype(np.int64), step)


def _normal(x: Array, y: Array, begin: int, size: int, lags: int) -> tuple[Array, Array, float, float]:
    dx = np.diff(x[begin - lags : begin + size])
    columns = sliding_window_view(dx, lags)[:, ::-1]
    dy = np.diff(y[begin - 1 : begin + size])[-len(columns) :]
    return columns.T @ columns, columns.T @ dy, float(dy @ dy), float(len(dy))


def step_response(blocks: ResponseEquations) -> tuple[Array, Array]:
    """Return times (m,) s and the response to a unit step.

    The step is at 0, the response scaled to 1 at its end; NaN without a level.
    """
    xx, xy, yy = blocks.xx.sum(axis=0), blocks.xy.sum(axis=0), float(blocks.yy.sum())
    prior = np.linalg.inv(_prior(len(xy), blocks.step))
    noise, h = yy / max(float(blocks.count.sum()), 1.0), np.zeros(len(xy))
    for _ in range(ROUNDS):
        h = np.linalg.solve(xx + noise * prior, xy)
        left = max(yy - 2.0 * float(h @ xy) + float(h @ xx @ h), 1e-9 * yy)
        noise = left / max(float(blocks.count.sum()), 1.0)
    t = np.asarray(blocks.step * np.arange(len(h)), np.float64)
    step = np.cumsum(h) - 0.5 * h  # a sample's impulse is centred on its time
    level = float(np.mean(step[t >= LEVEL_S]))
    return t, np.asarray(step / (level if level > LEAST_LEVEL else np.nan), np.float64)


# Iterations; the prior is weighted by the noise of the previous fit.
ROUNDS = 3
LEAST_LEVEL = 0.2  # lower levels: the attitude does not follow its set-point


def _prior(count: int, step: float) -> Array:
    """Return the prior covariance (m, m) of the impulse response."""
    decay = np.exp(-step * np.arange(count) / DECAY_S)
    return np.asarray((step / SHARP_S) ** 2 * np.minimum(decay[:, None], decay[None, :]), np.float64)


def response_features(t: Array, step: Array) -> Array:
    """Return delay, rise, peak and settling time of a step response.

    Delay to 50 %, rise from 10 to 90 %; times in s. ``t`` (m,) s, ``step`` (m,) ends at 1. NaN where a level is not
    reached.
    """

    def reached(level: float) -> float:
        above = np.flatnonzero(step >= level)
        if len(above) == 0:
            return math.nan
        i = int(above[0])
        if i == 0:
            return float(t[0])
        return float(t[i - 1] + (t[i] - t[i - 1]) * (level - step[i - 1]) / (step[i] - step[i - 1]))

    if not np.isfinite(step).all():
        return np.full(4, math.nan)
    return np.array([reached(0.5), reached(0.9) - reached(0.1), float(np.max(step)), _settled(t, step)])


def _settled(t: Array, step: Array) -> float:
    """Return the time (s) after which the response stays within 5 %."""
    outside = np.flatnonzero(np.abs(step - 1.0) > BAND)
    if len(outside) == 0:
        return 0.0
    i = int(outside[-1])
    if i == len(t) - 1:
        return float(t[-1])
    edge = 1.0 + math.copysign(BAND, step[i] - 1.0)
    return float(t[i] + (t[i + 1] - t[i]) * (edge - step[i]) / (step[i + 1] - step[i]))


# Set-point tracking: step response by a causal model, and tracking error.
#
# A property of vehicle and controller, not of a filter: for the onboard row only.

MIN_RATE_HZ = 8.0  # slower ones resolve no rise
FINEST_S = 0.01  # step of the response at most rates
# Smallest number of blocks (of roll and pitch) with a moving set-point.
MIN_BLOCKS = 8
JACKKNIFE_GROUPS = 10  # each is a tenth of the evidence

_RESPONSE = """Response of roll and pitch together to a unit step of the set-point, from a causal impulse response of
    1 s that explains the changes of the onboard attitude by earlier changes of the set-point (regularised least squares
    that expects a smooth response which dies out), divided by its level at the end (0.8 to 1 s). Only in flight, armed,
    in modes that command an attitude, in seconds in which the set-point moved by more than 1 deg. Interval: jackknife
    over groups of seconds. """
SETPOINT_METRICS: tuple[Metric, ...] = (
    Metric(
        "tracking_rms_deg",
        "Tracking error",
        "deg",
        "low",
        "RMS of the angle between the down directions of set-point and onboard attitude, in flight.",
    ),
    Metric("setpoint_delay_ms", "Set-point delay", "ms", "zero", paragraph(_RESPONSE + "Time to half of the step.")),
    Metric(
        "setpoint_rise_ms",
        "Set-point rise time",
        "ms",
        "low",
        paragraph(_RESPONSE + "Time from 10 to 90 % of the step."),
    ),
    Metric(
        "setpoint_peak_pct",
        "Set-point peak",
        "%",
        "low",
        paragraph(_RESPONSE + "Highest value in percent of the step."),
    ),
    Metric(
        "setpoint_settling_s",
        "Set-point settling time",
        "s",
        "low",
        paragraph(_RESPONSE + "Time after which it stays within 5 % of the step."),
    ),
)


def common(setpoint: Attitude, attitude: Attitude, spans: list[Span]) -> list[tuple[Array, Array, Array]]:
    """Return evenly spaced times, set-point and onboard attitudes by segment."""
    step = max(1.0 / min(setpoint.rate, attitude.rate), FINEST_S)
    found = []
    for span in spans:
        for segment in within(setpoint.t, span):
            for other in within(attitude.t, (setpoint.t[segment.start], setpoint.t[segment.stop - 1])):
                t = np.arange(attitude.t[other.start], attitude.t[other.stop - 1], step)
                q_set = rotation.slerp(setpoint.t[segment], setpoint.q[segment], t)
                q = rotation.slerp(attitude.t[other], attitude.q[other], t)
                if len(t) > 1 and np.isfinite(q_set).all() and np.isfinite(q).all():
                    found.append((t, q_set, q))
    return found


def angles(segments: list[tuple[Array, Array, Array]]) -> list[SetpointSegment]:
    """Return unwrapped roll and pitch (n, 2) of both attitudes in deg."""
    found = []
    for t, *attitudes in segments:
        wanted, flown_ = (np.degrees(np.unwrap(rotation.to_euler(q)[:, :2], axis=0)) for q in attitudes)
        found.append((t, wanted, flown_))
    return found


def commanded_angles(case: Case, window: str) -> list[Span]:
    """Return the spans of armed flight with a commanded attitude."""
    spans = case.segments.spans("airborne" if window == "all" else window)
    armed, mode = case.segments.spans("armed"), case.log.state.mode
    if armed:
        spans = intersect(spans, armed)
    if mode is None or len(mode.t) == 0:
        return spans
    edges = [-np.inf, *mode.t[1:].tolist(), np.inf]
    allowed = [(a, b) for a, b, name in zip(edges, edges[1:], mode.value, strict=False) if commands_attitude(str(name))]
    return intersect(spans, allowed)


def flown_angles(case: Case, window: str) -> tuple[list[tuple[Array, Array, Array]], tuple[str, str] | None]:
    """Return set-point and onboard attitude in flight, or code and reason."""
    log = case.log
    attitude = log.onboard_attitude
    if log.setpoints.attitude is None or len(log.setpoints.attitude.t) < 2 or attitude is None or len(attitude.t) < 2:
        return [], ("no_setpoint", "the log holds no attitude set-point beside the onboard attitude")
    if min(log.setpoints.attitude.rate, attitude.rate) < MIN_RATE_HZ:
        return [], ("rate_too_low", f"set-point and attitude are needed at {MIN_RATE_HZ:.0f} Hz or more")
    segments = _segments(case, commanded_angles(case, window))
    where = f"no attitude set-point in flight in window {window}, in a mode that commands an attitude"
    return segments, None if segments else ("not_covered", where)


@per_case
def _segments(case: Case, spans: list[Span]) -> list[tuple[Array, Array, Array]]:
    wanted, flew = case.log.setpoints.attitude, case.log.onboard_attitude
    return [] if wanted is None or flew is None else common(wanted, flew, spans)


def moved(case: Case, window: str) -> ResponseEquations | None:
    """Return the blocks of a window's flight with a moving set-point."""
    return _moved(case, commanded_angles(case, window)) if flown_angles(case, window)[0] else None


@per_case
def _moved(case: Case, spans: list[Span]) -> ResponseEquations | None:
    return blocks_of(angles(_segments(case, spans)))


def compute_setpoint(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the tracking of the set-point by the vehicle."""
    if row.name != "onboard":
        return {}
    segments, absent = flown_angles(case, window)
    if absent is not None:
        return SETPOINT.without(*absent, window)
    answers = {"tracking_rms_deg": _tracking(segments, window)}
    blocks = moved(case, window)
    count = 0 if blocks is None else len(blocks.axis)
    if blocks is None or count < MIN_BLOCKS:
        reason = f"{count} seconds in which the set-point moved; at least {MIN_BLOCKS} are needed"
        return answers | {m.name: missing("too_few_events", reason, m.unit, window) for m in SETPOINT_METRICS[1:]}
    values, others = response_features(*step_response(blocks)), _left_out(blocks)
    for metric, value, without, factor in zip(
        SETPOINT_METRICS[1:], values, others.T, (1e3, 1e3, 1e2, 1.0), strict=True
    ):
        if not np.isfinite(value):
            reason = "the attitude does not go where the set-point goes"
            answers[metric.name] = missing("did_not_move", reason, metric.unit, window)
            continue
        ci95 = statistics.jackknife_interval(float(value), without)
        answers[metric.name] = Answer(
            factor * float(value),
            metric.unit,
            window,
            count,
            float(count),
            None if ci95 is None else (factor * max(ci95[0], 0.0), factor * ci95[1]),
            f"causal response, {count} seconds",
            reason="a property of vehicle and controller",
            ranked=False,
        )
    return answers


def _left_out(blocks: ResponseEquations) -> Array:
    """Return the features (groups, 4) without each group of blocks."""
    found = []
    for group in statistics.equal_groups(len(blocks.axis), min(JACKKNIFE_GROUPS, len(blocks.axis))):
        keep = np.ones(len(blocks.axis), bool)
        keep[group] = False
        found.append(response_features(*step_response(blocks.only(keep))))
    return np.array(found)


def _tracking(segments: list[tuple[Array, Array, Array]], window: str) -> Answer:
    tilt = np.concatenate([np.degrees(rotation.tilt_angle(rotation.earth_error(q, q_set))) for _, q_set, q in segments])
    seconds = float(sum(t[-1] - t[0] for t, _, _ in segments))
    groups = groups_of(len(tilt), seconds)
    value, ci95 = root_mean_square(tilt, groups)
    return Answer(
        value,
        "deg",
        window,
        len(groups) or 1,
        seconds,
        ci95,
        "RMS of the tilt between set-point and attitude",
        reason="a property of vehicle and controller",
        ranked=False,
    )


SETPOINT = MetricGroup("set-point", "Step response", SETPOINT_METRICS, compute_setpoint, ("all", "airborne"))
METRIC_GROUPS = (SETPOINT,)
