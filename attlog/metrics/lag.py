"""Lag, gain and distortion of a row in steps."""

from __future__ import annotations

import functools
import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import is_in
from attlog.estimators import is_recorded
from attlog.metrics import step_turning
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, Resolution, Wording, missing, paragraph
from attlog.metrics.statistics import Ids, Summary, UnitValues, make_ids
from attlog.metrics.step_fit import (
    MIN_EVENTS,
    Fit,
    NormalEquations,
    RowFits,
    evidence,
    first_with,
    timing,
    too_few,
    why_no_events,
)
from attlog.metrics.windows import why_no_errors, why_unproven
from attlog.reference.model import Track

Array = NDArray[np.float64]


AXES = (*step_turning.AXES, "all")
# Terms of a lag's interval beside the jackknife: error of clock and input delay (common to all rows of a log, s), share
# of the shape error, share of the delay change by aiding.
COMMON_S, PER_SHAPE, PER_MOVED = 0.0005, 0.3, 0.15
# Common error of gains by scale and low-pass of the logged gyro. Gains with the logged gyro and with one from the truth
# differ by 0.002 (median) and 0.006 (90 %); the interval of the jackknife alone (0.002) contained the gain in 60 to 70
# % of the cases.
COMMON_GAIN = 0.006
_LAG = paragraph(
    """Delay of the row in steps{axis}, positive = late. Each step (a fast attitude change: at least 5 deg, yaw 10 deg,
    within 1 s after 0.3 s of quiet) is compared from 0.5 s before its onset to 1.0 s after 90 % of the change.
    The turning rates of row and reference about the event's axis are fitted over all events at once: delay, gain, a
    constant body misalignment, one constant per event, and the turning back that accelerometer and magnetometer cause
    (from the row's own attitude and the samples it saw), so that acceleration does not pass for an early estimate. The
    known delay of the logged sensors is subtracted where the reference does not share it. Interval: root sum of squares
    of the jackknife over events, 0.5 ms for clocks, 0.3 of the shape error and 0.15 of what the aiding changes. Judged
    only with gain 0.95 to 1.05, distortion up to 15 %, aiding up to 70 % of the step's rate (25 % for rows that
    diverged, 15 % above 2 g), and not where a causal filter comes out early against truth: otherwise not a pure
    delay."""
)
_GAIN = paragraph(
    """The share of the step's rate{axis} that the row follows once the aiding is taken out, from the same fit as
    the lag. Interval: root sum of squares of the jackknife over events and 0.006 for scale and low-pass of the logged
    gyro."""
)
_DISTORTION = paragraph(
    """What delay, gain and aiding do not explain{axis}: RMS of the residual rate over the RMS of the reference's rate,
    from the same fit as the lag. A pure delay has none, a low-pass some. Interval: jackknife over events."""
)


def metric_id(kind: str, axis: str) -> str:
    """Return an id as ``lag_roll_ms``; without the axis for all events."""
    middle = "" if axis == "all" else f"_{axis}"
    return {"lag": f"lag{middle}_ms", "gain": f"step_gain{middle}", "distortion": f"distortion{middle}_pct"}[kind]


_KINDS: tuple[tuple[str, str, str, Literal["zero", "one", "low"], str], ...] = (
    ("lag", "Lag", "ms", "zero", _LAG),
    ("gain", "Step gain", "1", "one", _GAIN),
    ("distortion", "Distortion", "%", "low", _DISTORTION),
)
PURE_GAIN = (0.95, 1.05)
MAX_DISTORTION = 0.15  # a first-order lag of 50 ms has less
MAX_SHARE, MAX_SHARE_UNSOUND, MAX_SHARE_HEAVY = 0.7, 0.25, 0.15  # of the step's rate
# Share of the time above 2 g of specific force beyond which a filter follows acceleration.
HEAVY = 0.02
RESOLUTIONS = {
    # a third of the delay margin of an autopilot's attitude loop
    "lag": Resolution(50.0, "a lag of 50 ms", "steps"),
    "gain": Resolution(1.0, "whether the step is followed at all", "steps"),
}


def _wording(axis: str) -> Wording:
    """Return the words of a comparison of lags."""
    about = "" if axis == "all" else f" in {axis}"
    return Wording("lags", f"less{about}", f"more{about}", f"lag{about}", none=1.0)


LAG_METRICS: tuple[Metric, ...] = tuple(
    Metric(
        metric_id(kind, axis),
        title + ("" if axis == "all" else f", {axis}"),
        unit,
        better,
        text.format(axis=", all axes together" if axis == "all" else f" in {axis}"),
        resolution=RESOLUTIONS.get(kind),
        wording=_wording(axis) if kind == "lag" else None,
        covers=kind == "lag",
    )
    for kind, title, unit, better, text in _KINDS
    for axis in AXES
)
UNITS = {kind: unit for kind, _, unit, _, _ in _KINDS}


def input_delay(case: Case, row: Track) -> float:
    """Return the delay of the logged sensors to subtract, s.

    For replays, without what the filter corrects itself (``imu_lag_corrected_ms`` of its quality). An attitude computed
    elsewhere has the delay given by its user.
    """
    if is_recorded(row.estimator):
        return 1e-3 * float(row.parameters.get("delay", 0.0))
    if row.kind != "replay":
        return 0.0
    corrected = 1e-3 * float(row.quality.get("imu_lag_corrected_ms", 0.0))
    return max(0.0, case.reference.alignment.input_delay_s - corrected)


def common_s(case: Case) -> float:
    """Return the error common to all delays of a log, s.

    COMMON_S, and 2 sigma of an external truth's clock.
    """
    fit = case.reference.fit
    return COMMON_S if fit is None else math.hypot(COMMON_S, 2.0 * fit.offset_sigma_s)


def half_width(found: Fit, common: float = COMMON_S) -> float:
    """Return half the 95 % interval of a fitted delay, s."""
    shape, moved = PER_SHAPE * found.shape_s, PER_MOVED * found.aiding_shift_s
    return math.sqrt(found.half_width(0) ** 2 + common**2 + shape**2 + moved**2)


def lag_on_events(sums: NormalEquations, own: Ids, numbers: Ids, delay: float, common: float, ids: Ids) -> Summary:
    """Return the lag in ms on the events ``ids``.

    ``own``: ids of the events ``numbers`` of ``sums``.
    """
    found = sums.fit(numbers[is_in(own, ids)])
    lag, half = 1000 * (found.delay - delay), 1000 * half_width(found, common)
    return Summary(lag, (lag - half, lag + half) if math.isfinite(half) else None)


def compute_lag(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return lag, gain and distortion of a row, by axis."""
    found = evidence(case, row, window)
    answers: dict[str, Answer] = {}
    for axis in AXES:
        answers |= _of_axis(case, row, window, axis, found)
    return {m.name: answers[m.name] for m in LAG_METRICS}


def _of_axis(case: Case, row: Track, window: str, axis: str, seen: RowFits | None) -> dict[str, Answer]:
    names = {kind: metric_id(kind, axis) for kind in ("lag", "gain", "distortion")}
    found = None if seen is None else seen.fits.get(axis)
    if seen is None or found is None or len(found.events) < MIN_EVENTS:
        count = 0 if found is None else len(found.events)
        where = "" if axis == "all" else f" in {axis}"
        reason = too_few(count, where)
        code = "too_few_events" if count else "no_events"
        return {name: missing(code, reason, UNITS[kind], window) for kind, name in names.items()}

    def answer(value: float, kind: str, half: float) -> Answer:
        factor = 100.0 if kind == "distortion" else 1.0
        least = 0.0 if kind == "distortion" else -math.inf
        ci95 = (max(factor * (value - half), least), factor * (value + half)) if math.isfinite(half) else None
        return Answer(
            factor * value,
            UNITS[kind],
            window,
            len(found.events),
            found.seconds,
            ci95,
            f"rate fit, {len(found.events)} events, jackknife",
        )

    distortion = answer(found.distortion, "distortion", found.half_width(2))
    if not PURE_GAIN[0] <= found.gain <= PURE_GAIN[1]:
        distortion.ranked, distortion.reason = False, f"follows {100 * found.gain:.0f} % of the step"
    return {
        names["lag"]: _lag_answer(case, row, window, found, seen.events),
        names["gain"]: answer(found.gain, "gain", math.hypot(found.half_width(1), COMMON_GAIN)),
        names["distortion"]: distortion,
    }


def _lag_answer(case: Case, row: Track, window: str, found: Fit, events: list[step_turning.StepEvent]) -> Answer:
    delay = input_delay(case, row)
    common = common_s(case)
    lag, half, half_sample = found.delay - delay, half_width(found, common), 0.5 * sample_step(case, row)
    answer = functools.partial(Answer, each=[float(v) for v in 1000 * (found.each - delay)], taken_out=1000 * delay)
    if found.at_edge:
        reason = "the best fit lies at the end of the range of 250 ms: no delay explains this row"
        return answer(None, "ms", window, code="lag_at_edge", reason=reason)
    may_be_early = case.reference.kind == "onboard" or not row.causal or is_recorded(row.estimator)
    earliest = -math.inf if may_be_early else -half_sample
    why = why_no_pure_delay(found, sound=row.status == "ok", half_width=half, lag=lag, earliest=earliest)
    if why is not None:
        return answer(None, "ms", window, code="not_a_pure_delay", reason=why)
    unranked = why_unproven(case) if row.causal else "looks ahead in time: its lag is no merit"
    ids, n = make_ids([events[k].onset for k in found.events]), len(found.events)
    pseudo = 1000 * (n * lag - (n - 1) * (found.left_out[:, 0] - delay))
    return answer(
        1000 * lag,
        "ms",
        window,
        n,
        found.seconds,
        (1000 * (lag - half), 1000 * (lag + half)),
        f"rate fit, {n} events, jackknife",
        reason=unranked,
        ranked=unranked is None,
        counts_as_zero_below=1000 * half_sample,
        units=UnitValues(
            "lag_event", ids, pseudo, functools.partial(lag_on_events, found.sums, ids, found.events, delay, common)
        ),
    )


def why_no_pure_delay(found: Fit, *, sound: bool, half_width: float, lag: float, earliest: float) -> str | None:
    """Return why a fitted ``lag`` (s) is no pure delay, else None.

    ``sound``: the row neither diverged nor failed to settle. A causal filter cannot precede ``earliest`` (s) by more
    than ``half_width`` (s).
    """
    if not PURE_GAIN[0] <= found.gain <= PURE_GAIN[1]:
        return f"follows {100 * found.gain:.0f} % of the step ({PURE_GAIN[0]:.2f} to {PURE_GAIN[1]:.2f} can be judged)"
    if found.distortion > MAX_DISTORTION:
        return f"shape error {100 * found.distortion:.0f} % of the step ({100 * MAX_DISTORTION:.0f} % can be judged)"
    most, where = MAX_SHARE, ""
    if not sound:
        most, where = MAX_SHARE_UNSOUND, " in a row that diverged or did not settle"
    if found.sums.heavy >= HEAVY:
        most, where = min(most, MAX_SHARE_HEAVY), " where the specific force exceeds 2 g"
    if found.share > most:
        turned = f"accelerometer and magnetometer turn it at {100 * found.share:.0f} % of the step's rate"
        return f"{turned} ({100 * most:.0f} % can be judged{where})"
    if lag + half_width < 0.0 and lag < earliest:
        return f"comes out {-1000 * lag:.1f} ms early, which a causal filter cannot be"
    return None


def sample_step(case: Case, row: Track) -> float:
    """Return the sampling interval of the replayed IMU, else the row, s."""
    imu = case.log.replay_imu
    t = row.t if imu is None else imu.gyro.t
    return timing(case, t).step if len(t) > 1 else 0.0


LAG = MetricGroup(
    "lag",
    "Step response",
    LAG_METRICS,
    compute_lag,
    ("all", "airborne"),
    needs=(why_no_errors, why_no_events),
    rests_on=first_with,
)
METRIC_GROUPS = (LAG,)
