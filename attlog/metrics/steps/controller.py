"""How does the vehicle follow its attitude set-point? Step response by a causal model, and tracking error.

A property of vehicle and controller, not of a filter: answered for the onboard row only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Attitude
from attlog.flight.modes import commands_attitude
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, applies_to, paragraph, per_case
from attlog.metrics.evidence.samples import within
from attlog.metrics.statistics import intervals as interval
from attlog.metrics.statistics.angles import groups_of, root_mean_square
from attlog.metrics.steps.setpoint_response import NormalEquations, SetpointSegment, blocks_of, features, response
from attlog.reference.model import Row
from attlog.segments.spans import Span, intersect

Array = NDArray[np.float64]

MIN_RATE_HZ = 8.0
FINEST_S = 0.01
MIN_BLOCKS = 8
"""Seconds (of roll and of pitch) in which the set-point moved."""
GROUPS = 10

_RESPONSE = """Response of roll and pitch together to a unit step of the set-point, from a causal impulse response of
    1 s that explains the changes of the onboard attitude by earlier changes of the set-point (regularised least squares
    that expects a smooth response which dies out), divided by its level at the end (0.8 to 1 s). Only in flight, armed,
    in modes that command an attitude, in seconds in which the set-point moved by more than 1 deg. Interval: jackknife
    over groups of seconds. """
METRICS: tuple[Metric, ...] = (
    Metric(
        "tracking_rms_deg",
        "Tracking error",
        "deg",
        "low",
        ("setpoint",),
        "RMS of the angle between the down directions of set-point and onboard attitude, in flight.",
    ),
    Metric(
        "setpoint_delay_ms",
        "Set-point delay",
        "ms",
        "zero",
        ("setpoint",),
        paragraph(_RESPONSE + "Time to half of the step."),
    ),
    Metric(
        "setpoint_rise_ms",
        "Set-point rise time",
        "ms",
        "low",
        ("setpoint",),
        paragraph(_RESPONSE + "Time from 10 to 90 % of the step."),
    ),
    Metric(
        "setpoint_peak_pct",
        "Set-point peak",
        "%",
        "low",
        ("setpoint",),
        paragraph(_RESPONSE + "Highest value in percent of the step."),
    ),
    Metric(
        "setpoint_settling_s",
        "Set-point settling time",
        "s",
        "low",
        ("setpoint",),
        paragraph(_RESPONSE + "Time after which it stays within 5 % of the step."),
    ),
)


def common(setpoint: Attitude, attitude: Attitude, spans: list[Span]) -> list[tuple[Array, Array, Array]]:
    """Times and attitudes (set-point, onboard) of each segment, evenly spaced at the slower rate, without gaps."""
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
    """Roll and pitch (n, 2) in deg of set-point and attitude, without jumps at 180 deg."""
    found = []
    for t, *attitudes in segments:
        wanted, flown_ = (np.degrees(np.unwrap(rotation.to_euler(q)[:, :2], axis=0)) for q in attitudes)
        found.append((t, wanted, flown_))
    return found


def commanded(case: Case, window: str) -> list[Span]:
    """Where the vehicle flies, armed, in a mode that commands an attitude; modes that are not known do."""
    spans = case.segments.spans("airborne" if window == "all" else window)
    armed, mode = case.segments.spans("armed"), case.log.mode
    if armed:
        spans = intersect(spans, armed)
    if mode is None or len(mode.t) == 0:
        return spans
    edges = [-np.inf, *mode.t[1:].tolist(), np.inf]
    allowed = [(a, b) for a, b, name in zip(edges, edges[1:], mode.value, strict=False) if commands_attitude(str(name))]
    return intersect(spans, allowed)


def flown(case: Case, window: str) -> tuple[list[tuple[Array, Array, Array]], tuple[str, str] | None]:
    """Set-point and onboard attitude in flight, or code and reason where there is none."""
    log = case.log
    attitude = log.onboard_attitude
    if log.setpoints is None or len(log.setpoints.t) < 2 or attitude is None or len(attitude.t) < 2:
        return [], ("no_setpoint", "the log holds no attitude set-point beside the onboard attitude")
    if min(log.setpoints.rate, attitude.rate) < MIN_RATE_HZ:
        return [], ("rate_too_low", f"set-point and attitude are needed at {MIN_RATE_HZ:.0f} Hz or more")
    segments = _segments(case, commanded(case, window))
    where = f"no attitude set-point in flight in window {window}, in a mode that commands an attitude"
    return segments, None if segments else ("not_covered", where)


@per_case
def _segments(case: Case, spans: list[Span]) -> list[tuple[Array, Array, Array]]:
    wanted, flew = case.log.setpoints, case.log.onboard_attitude
    return [] if wanted is None or flew is None else common(wanted, flew, spans)


def moved(case: Case, window: str) -> NormalEquations | None:
    """The seconds of a window's flight in which the set-point moved; None without any."""
    return _moved(case, commanded(case, window)) if flown(case, window)[0] else None


@per_case
def _moved(case: Case, spans: list[Span]) -> NormalEquations | None:
    return blocks_of(angles(_segments(case, spans)))


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for the onboard row and windows of flight; nothing for other rows."""
    if row.name != "onboard" or not applies_to(window, "all", "airborne"):
        return {}
    segments, absent = flown(case, window)
    if absent is not None:
        return {m.name: missing(*absent, m.unit, window) for m in METRICS}
    answers = {"tracking_rms_deg": _tracking(segments, window)}
    blocks = moved(case, window)
    count = 0 if blocks is None else len(blocks.axis)
    if blocks is None or count < MIN_BLOCKS:
        reason = f"{count} seconds in which the set-point moved; at least {MIN_BLOCKS} are needed"
        return answers | {m.name: missing("too_few_events", reason, m.unit, window) for m in METRICS[1:]}
    values, others = features(*response(blocks)), _left_out(blocks)
    for metric, value, without, factor in zip(METRICS[1:], values, others.T, (1e3, 1e3, 1e2, 1.0), strict=True):
        if not np.isfinite(value):
            reason = "the attitude does not go where the set-point goes"
            answers[metric.name] = missing("did_not_move", reason, metric.unit, window)
            continue
        ci95 = interval.of_jackknife(float(value), without)
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


def _left_out(blocks: NormalEquations) -> Array:
    """The features (groups, 4) with one group of neighbouring seconds left out each."""
    found = []
    for group in interval.equal_groups(len(blocks.axis), min(GROUPS, len(blocks.axis))):
        keep = np.ones(len(blocks.axis), bool)
        keep[group] = False
        found.append(features(*response(blocks.only(keep))))
    return np.array(found)


def _tracking(segments: list[tuple[Array, Array, Array]], window: str) -> Answer:
    tilt = np.concatenate(
        [np.degrees(rotation.inclination_angle(rotation.error(q, q_set))) for _, q_set, q in segments]
    )
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
