"""How quiet is a row? What its filter adds within 5 s: at rest, in hover, in other flight, with motors idling."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.kernels.loops import function_of
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, paragraph, per_row
from attlog.metrics.evidence import following as follow
from attlog.metrics.evidence import level, quantisation
from attlog.metrics.evidence.samples import imu_of
from attlog.metrics.evidence.settled import phase_of, phase_spans, why_none
from attlog.metrics.noise import injection, windows
from attlog.metrics.noise import loops as noise_loop
from attlog.metrics.noise.loops import AT_REST
from attlog.metrics.statistics import moderated
from attlog.metrics.statistics.moderated import Prior
from attlog.metrics.statistics.units import Ids, Summary, UnitValues, ids_of
from attlog.reference.model import Row
from attlog.segments.spans import Span

Array = NDArray[np.float64]

AXES = ("roll", "pitch", "heading", "tilt")
PRIORS = {
    "rest": Prior(0.25, 4.0),
    "onboard at rest": Prior(0.6, 4.0),
    "moving": Prior(1.0, 4.0),
    "one axis in cruise": Prior(3.0, 4.0),
}
"""Scatter of the logarithm of a window's variance, measured over logs. In cruise one axis is quiet until the vehicle
moves about it: a single window says little of the next, both axes of tilt together say more."""
UNSETTLED, MIN_LATER = 4.0, 3
"""Leading windows of a rest with more than this times the median variance of all later ones (at least 3) settle."""
SMALLEST_DEG = 1e-9
"""A variance of exactly zero (a gyro that shows one value) has no logarithm."""

_TEXT = paragraph(
    """How much the row moves by itself within 5 s, 1 sigma. At rest: rotation away from the window's mean
    attitude, about the level roll and pitch axis and the vertical, straight line removed. In hover, cruise
    (other flight) and idle (motors turning on the ground): rotation away from the gyro alone, integrated over
    the same samples, a constant offset and a constant gyro offset in body axes removed, in windows in which the
    vehicle stays within 20 deg of its mean attitude (onboard rows 10 deg). True motion and the gyro's own noise
    are in both and cancel, so that no reference is needed: what is left is what accelerometer and magnetometer
    push in. Value: exp(mean ln v / 2) over windows of 5 s with variance v = sum r^2 / (N - 2), the typical
    window; tilt: v is the mean of roll and pitch. Interval: moderated t on ln v (Smyth 2004). Left out: 10 s
    after the filter's start, 5 s after the motors stop, leading windows of a rest with more than 4 times the
    later variance. Ranked only for rows that follow motion and are corrected by gravity; at rest only above half
    the step of the logged values and above what the steps of the logged gyro can hide."""
)
_TEXT_P2P = paragraph(
    """Width of the middle 99.8 % of the same residuals, the larger of roll and pitch. A width set by the few largest
    samples of this record: shown without an interval and never ranked."""
)
METRICS: tuple[Metric, ...] = (
    Metric("noise_tilt_deg", "Noise, roll and pitch", "deg", "low", ("rest",), _TEXT),
    Metric("noise_roll_deg", "Noise, roll", "deg", "low", ("rest",), _TEXT),
    Metric("noise_pitch_deg", "Noise, pitch", "deg", "low", ("rest",), _TEXT),
    Metric("noise_heading_deg", "Noise, heading", "deg", "low", ("rest",), _TEXT),
    Metric("noise_p2p_deg", "Noise, peak to peak", "deg", "low", ("rest",), _TEXT_P2P),
)


LARGEST_DEG = 180.0
"""No angle is larger: an interval that reaches so far, as of two unlike windows, says nothing."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The windows of a row in one phase: they begin at ``t0`` (k,) s.

    ``variances`` (k, 4) deg^2 about AXES, ``seconds`` together, ``p2p`` (3,) deg the middle
    99.8 % of the residuals, ``settled_s`` how long after its start a row still settled at rest, if it did.
    """

    t0: Array
    variances: Array
    seconds: float
    p2p: Array
    settled_s: float | None


def variance(residual: Array) -> Array:
    """Variances (4,) about roll, pitch, heading and (the mean of the first two) tilt of residuals (n, 3)."""
    v = np.sum(residual**2, axis=0) / (len(residual) - 2)
    return np.array([v[0], v[1], v[2], 0.5 * (v[0] + v[1])])


def unsettled(variances: Array) -> int:
    """How many leading windows of a rest settle: variances (k, 4), tilt or heading above 4 x the later median."""
    for k in range(len(variances) - MIN_LATER):
        later = np.median(variances[k + 1 :, 2:], axis=0)
        if not (variances[k, 2:] > UNSETTLED * later).any():
            return k
    return max(0, len(variances) - MIN_LATER)


def typical(ids: Ids, values: Array, prior: Prior, correction: float, wanted: Ids) -> Summary:
    """The typical window's standard deviation and its interval from logarithms of variances (k,) on some windows.

    ``correction`` (deg^2) is the part of the variance that the step of the logged values adds.
    """
    chosen = values[np.isin(ids, wanted)]
    low, high = moderated.interval(chosen, prior)
    sigma, bottom, top = (math.sqrt(max(math.exp(x) - correction, 0.0)) for x in (float(np.mean(chosen)), low, high))
    return Summary(sigma, (bottom, top))


def measured(case: Case, row: Row, phase: str, window: str) -> Measured | None:
    """The windows of a row in a phase and their variances; None without a usable window."""
    return _in_spans(case, row, phase, phase_spans(case, phase, window))


@per_row
def _in_spans(case: Case, row: Row, phase: str, spans: list[Span]) -> Measured | None:
    known = _known(case, row, phase)
    new = [span for span in spans if span not in known]
    known |= zip(new, _of_spans(case, row, phase, new), strict=True)
    parts = [part for span in spans if (part := known[span]) is not None]
    if not parts:
        return None
    columns = np.concatenate([part.residuals for part in parts]).T
    reach = np.array([np.quantile(x, 0.999) - np.quantile(x, 0.001) for x in columns])
    t0, variances = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t0", "variances"))
    settled = [part.settled_s for part in parts if part.settled_s is not None]
    seconds = sum((length for part in parts for length in part.lengths), 0.0)
    return Measured(t0, variances, seconds, reach, settled[-1] if settled else None)


@dataclass(frozen=True, slots=True)
class Part:
    """What :class:`Measured` has of one span: the residuals (n, 3) in deg of its windows, their lengths (k) in s."""

    t0: Array
    variances: Array
    residuals: Array
    lengths: list[float]
    settled_s: float | None


@per_row
def _known(case: Case, row: Row, phase: str) -> dict[Span, Part | None]:
    """What was found in spans of a phase: the same wherever they are asked for."""
    return {}


def _of_spans(case: Case, row: Row, phase: str, spans: list[Span]) -> list[Part | None]:
    """What is in each of some spans: the windows of all of them are looked at together."""
    laid = [windows.of_span(case, row, phase, span) for span in spans]
    inside = [samples for own in laid for _, samples in own]
    left = iter(left_at_rest(row, inside) if phase == "rest" else injection.of_windows(case, row, inside))
    return [_part(row, phase, [(w, r) for w, _ in own if (r := next(left)) is not None]) for own in laid]


def left_at_rest(row: Row, inside: list[slice]) -> Iterator[Array]:
    """The residuals (n, 3) in deg of windows at rest: away from their mean attitude, without the straight line."""
    for _, at, edges in windows.together(inside):
        q, out = np.ascontiguousarray(row.q[at], np.float64), np.empty((len(at), 3))
        centre = rotation.means(q, edges)
        yaw = np.ascontiguousarray(rotation.to_euler(centre)[:, 2])
        function_of(AT_REST, noise_loop.left_at_rest)(out, row.t[at], q, centre, yaw, edges)
        yield from np.split(out, edges[1:-1])


def _part(row: Row, phase: str, windows: list[tuple[Span, Array]]) -> Part | None:
    """The windows of a span, with their residuals, without those in which the row settles."""
    found = [(window, variance(residual), residual) for window, residual in windows]
    skip = unsettled(np.array([v for _, v, _ in found])) if phase == "rest" and len(found) > MIN_LATER else 0
    kept = found[skip:]
    if not kept:
        return None
    return Part(
        np.array([w[0] for w, _, _ in kept]),
        np.array([v for _, v, _ in kept]),
        np.concatenate([r for _, _, r in kept]),
        [w[1] - w[0] for w, _, _ in kept],
        kept[0][0][0] - row.start if skip else None,
    )


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows that are not one phase of the flight."""
    phase = phase_of(case, window)
    if phase is None:
        return {}
    uncorrected = level.why_not(case, row)
    if phase != "rest" and uncorrected:
        reason = f"{uncorrected}, so nothing is added to the gyro and this noise is zero by definition"
        return {m.name: missing("not_applicable", reason, "deg", window) for m in METRICS}
    if phase != "rest" and imu_of(case, row) is None:
        reason = "the log holds no gyro to compare with"
        return {m.name: missing("not_applicable", reason, "deg", window) for m in METRICS}
    found = measured(case, row, phase, window)
    if found is None:
        absent = why_none(case, phase, window)
        return {m.name: missing(*absent, "deg", window) for m in METRICS}
    answers = {f"noise_{axis}_deg": _answer(case, row, window, phase, axis, found) for axis in AXES}
    answers["noise_p2p_deg"] = Answer(
        float(np.max(found.p2p[:2])),
        "deg",
        window,
        len(found.t0),
        found.seconds,
        None,
        "middle 99.8 % of the residuals",
        reason="set by the few largest samples of this record",
        ranked=False,
        detail={"heading_deg": float(found.p2p[2]), "windows": len(found.t0), "phase": phase},
    )
    return {m.name: answers[m.name] for m in METRICS}


def prior_of(row: Row, phase: str, axis: str) -> Prior:
    """What is known beforehand of the scatter of a row's noise in a phase about one of AXES."""
    if phase == "rest":
        return PRIORS["rest" if row.kind == "replay" else "onboard at rest"]
    return PRIORS["one axis in cruise" if phase == "cruise" and axis != "tilt" else "moving"]


def _answer(case: Case, row: Row, window: str, phase: str, axis: str, found: Measured) -> Answer:
    hidden = _hidden(case, row, axis) if phase == "rest" else 0.0
    shown = math.isfinite(hidden)
    step = row.step_deg if phase == "rest" else 0.0
    prior = prior_of(row, phase, axis)
    smallest = max(step**2 / 12.0, SMALLEST_DEG**2)
    values = np.log(np.maximum(found.variances[:, AXES.index(axis)], smallest))
    ids = ids_of(found.t0)
    whole = typical(ids, values, prior, 0.0, ids)
    correction, reason = 0.0, None
    if not shown:
        reason = "the logged gyro never changes about this axis, so its noise is not known"
    elif whole.value < hidden:
        reason = f"below the noise of {hidden:.2g} deg that the steps of the logged gyro can hide"
    elif whole.value < 0.5 * step:
        reason = f"below half the step of the logged values ({step:.3g} deg)"
    else:
        correction = step**2 / 12.0
    on = partial(typical, ids, values, prior, correction)
    told = on(ids)
    if told.ci95 is not None and told.ci95[1] > LARGEST_DEG:
        told, reason = Summary(told.value, None), "its windows differ too much to give an interval"
    if row.kind == "onboard" and phase != "rest":
        told = one_digit(told)
        reason = "of another IMU path with its own delay: known to one digit"
    detail = {"windows": len(ids), "phase": phase, "step_deg": row.step_deg}
    if found.settled_s is not None:
        detail["settled_after_s"] = found.settled_s
    answer = Answer(
        told.value,
        "deg",
        window,
        len(ids),
        found.seconds,
        told.ci95,
        f"typical of {len(ids)} windows of 5 s, moderated t",
        reason=reason,
        ranked=reason is None,
        detail=detail,
        floor=max(0.5 * step, hidden if shown else 0.0),
        units=UnitValues("log_variance", ids, values, on),
    )
    return _guarded(case, row, axis, answer)


def _guarded(case: Case, row: Row, axis: str, answer: Answer) -> Answer:
    """The answer, not ranked for rows that are quiet because they stand still or because nothing corrects them."""
    for about in ("roll", "pitch") if axis == "tilt" else (axis,):
        follow.unrank_frozen(case, row, about, answer)
    uncorrected = level.why_not(case, row)
    if answer.ranked and uncorrected:
        answer.ranked, answer.reason = False, uncorrected
    return answer


def _hidden(case: Case, row: Row, axis: str) -> float:
    """What the steps of the row's logged gyro can hide about an axis, deg; the larger of roll and pitch for tilt."""
    imu = imu_of(case, row)
    if row.kind != "replay" or imu is None:
        return 0.0
    hidden = quantisation.hidden_deg(case, next(k for k, unit in enumerate(case.log.imus) if unit.index == imu.index))
    return max(hidden[:2]) if axis == "tilt" else hidden[AXES.index(axis)]


def one_digit(told: Summary) -> Summary:
    """A value and its interval to one significant digit."""

    def rounded(x: float) -> float:
        return float(f"{x:.1g}")

    return Summary(rounded(told.value), None if told.ci95 is None else (rounded(told.ci95[0]), rounded(told.ci95[1])))
