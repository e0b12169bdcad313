"""How does the vehicle follow its attitude set-point? Step response by Wiener deconvolution, and tracking error.

A property of vehicle and controller, not of a filter: answered for the onboard row only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.flight.model import Attitude
from attlog.metrics import interval, rmse
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, applies_to, paragraph
from attlog.metrics.evidence import within
from attlog.reference.model import Row

Array = NDArray[np.float64]

WINDOW_S = 2.0
BEFORE_S, RESPONSE_S = 0.3, 1.0
REGULARISED = 0.05
"""METRICS 4, "Controller"."""
MIN_RATE_HZ = 8.0
MIN_WINDOWS = 8
MOVING_DEG = 1.0
"""Windows whose set-point varies less tell nothing about the response."""
BLOCKS = 10
BAND = 0.05

_RESPONSE = """Response of roll and pitch together to a unit step of the set-point: Wiener deconvolution of set-point
    and onboard attitude in windows of 2 s (Hann, half overlapping), regularised at 5 % of the peak input power, windows
    weighted by their input power, divided by its level at the end (0.8 to 1 s). Flight only. Interval: jackknife over
    blocks of windows. """
METRICS: tuple[Metric, ...] = (
    Metric(
        "tracking_rms_deg", "Tracking error", "deg", "low", ("setpoint",),
        "RMS of the angle between the down directions of set-point and onboard attitude, in flight.",
    ),
    Metric(
        "setpoint_delay_ms", "Set-point delay", "ms", "zero", ("setpoint",),
        paragraph(_RESPONSE + "Time to half of the step."),
    ),
    Metric(
        "setpoint_rise_ms", "Set-point rise time", "ms", "low", ("setpoint",),
        paragraph(_RESPONSE + "Time from 10 to 90 % of the step."),
    ),
    Metric(
        "setpoint_peak_pct", "Set-point peak", "%", "low", ("setpoint",),
        paragraph(_RESPONSE + "Highest value in percent of the step."),
    ),
    Metric(
        "setpoint_settling_s", "Set-point settling time", "s", "low", ("setpoint",),
        paragraph(_RESPONSE + "Time after which it stays within 5 % of the step."),
    ),
)  # fmt: skip


@dataclass(slots=True)
class Windows:
    """Pieces of set-point and attitude (k, n) in deg, every ``step`` s; ``axis`` (k,) is 0 for roll, 1 for pitch."""

    setpoint: Array
    attitude: Array
    axis: NDArray[np.int64]
    step: float


def response(windows: Windows) -> tuple[Array, Array]:
    """Times (m,) from -0.3 to 1 s and the response to a unit step at 0, scaled to 1 at its end.

    The regularisation smooths to both sides of 0; starting before it keeps the half of
    the step in place.
    """
    n = windows.setpoint.shape[1]
    taper = np.hanning(n)
    x = np.fft.rfft(windows.setpoint * taper, 2 * n, axis=1)
    y = np.fft.rfft(windows.attitude * taper, 2 * n, axis=1)
    power = np.sum(np.abs(x) ** 2, axis=0)
    impulse = np.fft.irfft(np.sum(np.conj(x) * y, axis=0) / (power + REGULARISED * np.max(power)), 2 * n)
    first, last = -round(BEFORE_S / windows.step), round(RESPONSE_S / windows.step)
    t = np.asarray(windows.step * np.arange(first, last + 1), np.float64)
    step = np.cumsum(np.roll(impulse, -first)[: len(t)])
    step -= 0.5 * np.roll(impulse, -first)[: len(t)]  # a sample's impulse is centred on its time
    level = float(np.mean(step[t >= 0.8 * RESPONSE_S]))
    return t, np.asarray(step / (level if level > 0 else np.nan), np.float64)


def features(t: Array, step: Array) -> Array:
    """Delay (s), rise time (s), peak, settling time (s) of a step response that ends at 1.

    ``t`` (m,) s, ``step`` (m,); NaN where it never gets there.
    """

    def reached(level: float) -> float:
        above = np.flatnonzero(step >= level)
        if len(above) == 0 or above[0] == 0:
            return math.nan
        i = int(above[0])
        return float(t[i - 1] + (t[i] - t[i - 1]) * (level - step[i - 1]) / (step[i] - step[i - 1]))

    outside = np.flatnonzero(np.abs(step - 1.0) > BAND)
    settled = float(t[min(outside[-1] + 1, len(t) - 1)]) if len(outside) else 0.0
    return np.array([reached(0.5), reached(0.9) - reached(0.1), float(np.max(step)), settled])


def common(
    setpoint: Attitude, attitude: Attitude, spans: list[tuple[float, float]]
) -> list[tuple[Array, Array, Array]]:
    """Times and attitudes (set-point, onboard) of each segment, evenly spaced at the slower rate, without gaps."""
    step = 1.0 / min(setpoint.rate, attitude.rate)
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


def windows_of(pieces: list[tuple[Array, Array, Array]]) -> Windows | None:
    """Windows of 2 s, half overlapping, in which the set-point of an axis moved; None without any."""
    cuts: list[tuple[Array, Array, int]] = []
    for t, q_set, q in pieces:
        n = round(WINDOW_S / float(t[1] - t[0]))
        wanted, flown = (np.degrees(rotation.to_euler(a)) for a in (q_set, q))
        for begin in range(0, len(t) - n + 1, max(n // 2, 1)):
            for axis in (0, 1):
                x, y = wanted[begin : begin + n, axis], flown[begin : begin + n, axis]
                if np.std(x) > MOVING_DEG and np.max(np.abs(np.diff(x))) < 180 and np.max(np.abs(np.diff(y))) < 180:
                    cuts.append((x - np.mean(x), y - np.mean(x), axis))
    size = min((len(c[0]) for c in cuts), default=0)
    if not cuts or size < 8:
        return None
    first = pieces[0][0]
    return Windows(
        np.array([c[0][:size] for c in cuts]), np.array([c[1][:size] for c in cuts]), np.array([c[2] for c in cuts]),
        float(first[1] - first[0]),
    )  # fmt: skip


def without(windows: Windows, part: slice) -> Windows:
    """All windows but a part."""
    keep = np.ones(len(windows.axis), bool)
    keep[part] = False
    return Windows(windows.setpoint[keep], windows.attitude[keep], windows.axis[keep], windows.step)


def flown(case: Case, window: str) -> tuple[list[tuple[Array, Array, Array]], tuple[str, str] | None]:
    """Set-point and onboard attitude in flight, or code and reason where there is none."""
    log = case.log
    attitude = log.attitudes.get(log.onboard or "")
    if log.setpoints is None or len(log.setpoints.t) < 2 or attitude is None or len(attitude.t) < 2:
        return [], ("no_setpoint", "the log holds no attitude set-point beside the onboard attitude")
    if min(log.setpoints.rate, attitude.rate) < MIN_RATE_HZ:
        return [], ("rate_too_low", f"set-point and attitude are needed at {MIN_RATE_HZ:.0f} Hz or more")
    spans = case.segments.spans("airborne" if window == "all" else window)
    pieces = common(log.setpoints, attitude, spans)
    return pieces, None if pieces else ("not_covered", f"no set-point in flight in window {window}")


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for the onboard row and windows of flight; nothing for other rows."""
    if row.name != "onboard" or not applies_to(window, "all", "airborne"):
        return {}
    pieces, absent = flown(case, window)
    if absent is not None:
        return {m.name: missing(*absent, m.unit, window) for m in METRICS}
    answers = {"tracking_rms_deg": _tracking(pieces, window)}
    windows = windows_of(pieces)
    count = 0 if windows is None else len(windows.axis)
    if windows is None or count < MIN_WINDOWS:
        reason = f"{count} windows in which the set-point moved; at least {MIN_WINDOWS} are needed"
        return answers | {m.name: missing("too_few_events", reason, m.unit, window) for m in METRICS[1:]}
    values = features(*response(windows))
    blocks = interval.equal_groups(count, min(BLOCKS, count))
    left_out = np.array([features(*response(without(windows, b))) for b in blocks])
    seconds = count * WINDOW_S / 2
    for metric, value, others, factor in zip(METRICS[1:], values, left_out.T, (1e3, 1e3, 1e2, 1.0), strict=True):
        ci95 = interval.of_jackknife(float(value), others)
        if not np.isfinite(value):
            answers[metric.name] = missing(
                "not_a_pure_delay", "the response does not reach its level", metric.unit, window
            )
            continue
        answers[metric.name] = Answer(
            factor * float(value), metric.unit, window, count, seconds,
            None if ci95 is None else (factor * ci95[0], factor * ci95[1]), f"Wiener deconvolution of {count} windows",
            reason="a property of vehicle and controller", ranked=False,
        )  # fmt: skip
    return answers


def _tracking(pieces: list[tuple[Array, Array, Array]], window: str) -> Answer:
    tilt = np.concatenate([np.degrees(rotation.inclination_angle(rotation.error(q, q_set))) for _, q_set, q in pieces])
    seconds = float(sum(t[-1] - t[0] for t, _, _ in pieces))
    groups = rmse.groups_of(len(tilt), seconds)
    value, ci95 = rmse.root_mean_square(tilt, groups)
    return Answer(
        value, "deg", window, len(groups) or 1, seconds, ci95, "RMS of the tilt between set-point and attitude",
        reason="a property of vehicle and controller", ranked=False,
    )  # fmt: skip
