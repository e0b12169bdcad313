"""How late is a row in quick movements? Lag, step gain and distortion, judged or called bent."""

from __future__ import annotations

import math

import numpy as np

from attlog.metrics import angle_fit, steps
from attlog.metrics.angle_fit import Fit
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, applies_to, paragraph, per_case, per_row
from attlog.metrics.event_pairs import Track
from attlog.metrics.evidence import STEP_EVENTS, STEP_REFERENCE_HZ
from attlog.metrics.rmse import why_never_airborne, why_no_errors
from attlog.reference.model import Row

AXES = (*steps.AXES, "all")
MIN_EVENTS = STEP_EVENTS
MIN_REFERENCE_HZ = STEP_REFERENCE_HZ
GAIN = (0.95, 1.05)
MAX_DISTORTION = 0.05
MAX_RESIDUAL_DEG = 0.5
"""METRICS 4, "When a lag may be judged": other shapes give a delay that depends on the movement, not on the filter."""

_LAG = paragraph(
    """How late the row follows quick movements{axis}, positive = late. Each event (a stroke of at least 5 deg, yaw 10
    deg, within 1 s after 0.3 s of quiet) is compared from 0.5 s before to 1.0 s after it; both attitudes are taken
    relative to their own attitude at mid-step, a constant body misalignment of the log is removed, and delay, gain
    and one offset per event are fitted by least squares over all events. Interval: jackknife over events. The known
    delay of the logged sensors is subtracted where the reference does not share it. Judged only with gain 0.95 to
    1.05 and distortion up to 5 % (or residual up to 0.5 deg), and not where a causal filter comes out early against
    truth: otherwise bent."""
)
_GAIN = paragraph(
    """The share of the movement{axis} that the row follows: k in th_est(t + lag) = c + k th_ref(t), from the same fit
    as the lag. Interval: jackknife over events."""
)
_DISTORTION = paragraph(
    """What delay and gain do not explain{axis}: residual RMS over the RMS of the reference's excursion, from the same
    fit as the lag. A pure delay has none, a low-pass some."""
)


def metric_id(kind: str, axis: str) -> str:
    """``lag_roll_ms``, ``step_gain_roll``, ``distortion_roll_pct``; without an axis for all events together."""
    middle = "" if axis == "all" else f"_{axis}"
    return {"lag": f"lag{middle}_ms", "gain": f"step_gain{middle}", "distortion": f"distortion{middle}_pct"}[kind]


METRICS: tuple[Metric, ...] = tuple(
    Metric(
        metric_id(kind, axis), title + ("" if axis == "all" else f", {axis}"), unit, better, ("reference", "events"),
        text.format(axis=", all axes together" if axis == "all" else f" in {axis}"),
    )
    for kind, title, unit, better, text in (
        ("lag", "Lag", "ms", "zero", _LAG),
        ("gain", "Step gain", "1", "one", _GAIN),
        ("distortion", "Distortion", "%", "low", _DISTORTION),
    )
    for axis in AXES
)  # fmt: skip


def fits(case: Case, row: Row, window: str) -> dict[str, Fit]:
    """The fits of a row over the events of a window: per axis and ``all``; shared by everything that looks at steps."""
    events = steps.in_window(case, scored_events(case, row), window)
    if not events:
        return {}
    return fits_of(case, row, events)


@per_row
def fits_of(case: Case, row: Row, events: list[steps.Event]) -> dict[str, Fit]:
    """The fits of a row over these events, per axis and ``all``."""
    return angle_fit.by_axis(Track(row.t, row.q, row.segment), reference_track(case), events)


@per_case
def reference_track(case: Case) -> Track:
    """The reference as what all rows are compared with."""
    return Track(case.reference.t, case.reference.q, case.reference.segment)


def scored_events(case: Case, row: Row) -> list[steps.Event]:
    """The events of the reference for which this row is scored (after a restart it settles first)."""
    errors = row.errors
    if errors is None or len(errors.t) == 0:
        return []
    events = steps.of_reference(case)
    at = np.clip(np.searchsorted(errors.t, [e.onset for e in events]), 0, len(errors.t) - 1)
    return [e for e, i in zip(events, at, strict=True) if errors.scored[i]]


def input_delay(case: Case, row: Row) -> float:
    """The delay of the logged sensors (s) to subtract: of replays, where the reference does not share it."""
    shared = case.reference.input_delay_shared or row.kind != "replay"
    return 0.0 if shared else case.reference.input_delay_s


def bent(found: Fit, lag: float, earliest: float) -> str | None:
    """Why a lag (s) may not be judged, else None; a causal filter cannot come before ``earliest`` (s)."""
    if not GAIN[0] <= found.gain <= GAIN[1]:
        return f"follows {100 * found.gain:.0f} % of the movement ({GAIN[0]:.2f} to {GAIN[1]:.2f} can be judged)"
    if found.distortion > MAX_DISTORTION and found.residual_deg > MAX_RESIDUAL_DEG:
        shape = f"{100 * found.distortion:.0f} %, {found.residual_deg:.1f} deg RMS"
        return f"shape error {shape} (5 % or 0.5 deg can be judged)"
    low, high = found.delay_ci95 or (found.delay, found.delay)
    if lag + 0.5 * (high - low) < 0.0 and lag < earliest:
        return f"comes out {-1000 * lag:.0f} ms early, which a causal filter cannot be: acceleration bends it"
    return None


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without movements by definition."""
    if not applies_to(window, "all", "airborne"):
        return {}
    absent = why_no_errors(case, row) or why_no_events(case, row, window)
    if absent is not None:
        return {m.name: missing(*absent, m.unit, window) for m in METRICS}
    found = fits(case, row, window)
    answers: dict[str, Answer] = {}
    for axis in AXES:
        answers |= _of_axis(case, row, window, axis, found.get(axis))
    return {m.name: answers[m.name] for m in METRICS}


def why_no_events(case: Case, row: Row, window: str) -> tuple[str, str] | None:
    """Code and reason where a window has no events at all for a row, else None."""
    rate = case.reference.rate
    if rate < MIN_REFERENCE_HZ:
        return (
            "reference_too_slow",
            f"the reference comes at {rate:.1f} Hz; {MIN_REFERENCE_HZ:.0f} Hz are needed for steps",
        )
    if not steps.in_window(case, scored_events(case, row), window):
        where = {"all": "in this log", "airborne": "in flight"}.get(window, f"in {window}")
        if window == "airborne" and not case.segments.spans("airborne"):
            return "no_events", why_never_airborne(case)
        sizes = f"{steps.SMALLEST_DEG[0]:.0f} deg in roll or pitch or {steps.SMALLEST_DEG[2]:.0f} deg in yaw"
        start = f"from {case.reference.scoring_start:.0f} s on"
        return "no_events", f"no quick movement {where} {start}; turns of {sizes} within 1 s are needed"
    return None


def _of_axis(case: Case, row: Row, window: str, axis: str, found: Fit | None) -> dict[str, Answer]:
    names = {kind: metric_id(kind, axis) for kind in ("lag", "gain", "distortion")}
    units = {"lag": "ms", "gain": "1", "distortion": "%"}
    if found is None or found.events < MIN_EVENTS:
        count = 0 if found is None else found.events
        where = "" if axis == "all" else f" in {axis}"
        reason = f"{count} quick movements{where}; at least {MIN_EVENTS} are needed"
        code = "too_few_events" if count else "no_events"
        return {names[kind]: missing(code, reason, units[kind], window) for kind in names}
    method = f"angle fit, {found.events} events, jackknife"
    detail = {
        "gain": found.gain, "distortion_pct": 100 * found.distortion, "residual_deg": found.residual_deg,
        "shape_ms": 1000 * found.shape_s, "misalignment_deg": [float(x) for x in np.degrees(found.body)],
    }  # fmt: skip

    def answer(value: float, unit: str, ci95: tuple[float, float] | None, factor: float) -> Answer:
        scaled = None if ci95 is None else (factor * ci95[0], factor * ci95[1])
        return Answer(factor * value, unit, window, found.events, found.seconds, scaled, method, detail=dict(detail))

    distortion = answer(found.distortion, "%", found.distortion_ci95, 100.0)
    if not GAIN[0] <= found.gain <= GAIN[1]:
        distortion.ranked, distortion.reason = False, bent(found, 0.0, 0.0)
    return {
        names["lag"]: _lag_answer(case, row, window, found, method, detail),
        names["gain"]: answer(found.gain, "1", found.gain_ci95, 1.0),
        names["distortion"]: distortion,
    }


def _lag_answer(case: Case, row: Row, window: str, found: Fit, method: str, shared: dict[str, object]) -> Answer:
    delay = input_delay(case, row)
    lag = found.delay - delay
    half_sample = 0.5 * sample_step(case, row)
    detail = shared | {"fitted_ms": 1000 * found.delay, "input_delay_ms": 1000 * delay}
    each = [1000 * float(x - delay) for x in found.each]
    if found.at_edge:
        reason = "the best fit lies at the end of the range of 250 ms: no delay explains this row"
        return Answer(None, "ms", window, code="lag_at_edge", reason=reason, detail=detail, each=each)
    may_be_early = case.reference.kind == "onboard" or not row.causal
    why = bent(found, lag, -math.inf if may_be_early else -half_sample)
    if why is not None:
        return Answer(None, "ms", window, code="not_a_pure_delay", reason=why, detail=detail, each=each)
    low, high = found.delay_ci95 or (found.delay, found.delay)
    reason = None if row.causal else "looks ahead in time: its lag is no merit"
    return Answer(
        1000 * lag, "ms", window, found.events, found.seconds, (1000 * (low - delay), 1000 * (high - delay)), method,
        reason=reason, ranked=reason is None, detail=detail, each=each,
        counts_as_zero_below=1000 * half_sample, resolution=1000 * found.shape_s,
    )  # fmt: skip


def sample_step(case: Case, row: Row) -> float:
    """The time between samples of the replayed IMU, s; of the row itself where no IMU is there."""
    imu = case.log.imu
    t = row.t if imu is None else case.log.imus[imu].gyro.t
    return float(np.median(np.diff(t))) if len(t) > 1 else 0.0
