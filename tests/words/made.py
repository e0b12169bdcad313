"""Results made by hand for sentences: rows with single answers, and what the ranking is taken to have found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from attlog.metrics.metric import Answer, missing
from attlog.result import EstimatorRow, ReferenceSummary, Result, Verdict
from attlog.words.answers import verdicts

Metrics = dict[str, dict[str, Answer]]
TILT, HEADING, NOISE = "tilt_rmse_deg", "heading_rmse_deg", "noise_tilt_deg"
LAG, STEP, STEP_PCT = "lag_ms", "step_error_deg.0.5s", "step_error_pct.0.5s"
DRIFT_REST, DRIFT_AIR = "drift_rest_deg_per_min", "drift_air_deg_per_min"


def answer(value: float, unit: str, window: str, half: float | None = None, **more: object) -> Answer:
    """A value with an interval of ``half`` on both sides."""
    ci95 = None if half is None else (value - half, value + half)
    return Answer(value, unit, window, 28, 60.0, ci95, **more)  # type: ignore[arg-type]


def merged(*parts: Metrics) -> Metrics:
    """Several answers of one row."""
    out: Metrics = {}
    for part in parts:
        for window, answers in part.items():
            out.setdefault(window, {}).update(answers)
    return out


def tilt(value: float, heading: float | None = None, window: str = "airborne", **more: object) -> Metrics:
    """Errors of one row."""
    found = {TILT: answer(value, "deg", window, value / 10, **more)}
    if heading is not None:
        found[HEADING] = answer(heading, "deg", window, heading / 10, **more)
    return {window: found}


def noise(value: float, phase: str = "rest", **more: object) -> Metrics:
    """Noise of one row in one phase."""
    return {phase: {NOISE: answer(value, "deg", phase, value / 10, **more)}}


def lag(value: float, half: float = 1.0, floor: float = 2.0) -> Metrics:
    """A lag of one row; half an IMU sample is ``floor`` ms."""
    return {"airborne": {LAG: answer(value, "ms", "airborne", half, counts_as_zero_below=floor)}}


def impure(reason: str = "follows 51 % of the step") -> Metrics:
    """A row whose movement is no pure delay."""
    return {"airborne": {LAG: missing("not_a_pure_delay", reason, "ms", "airborne")}}


def step(deg: float, percent: float) -> Metrics:
    """How far a row is off after a movement."""
    found = {STEP: answer(deg, "deg", "airborne", 0.1), STEP_PCT: answer(percent, "%", "airborne", 1.0)}
    return {"airborne": found}


def drift(value: float, half: float = 0.1, against: str = "rest", **more: object) -> Metrics:
    """A drift of one row, at rest or against a heading reference in the air."""
    window, metric = ("rest", DRIFT_REST) if against == "rest" else ("airborne", f"{DRIFT_AIR}.{against}")
    return {window: {metric: answer(value, "deg/min", window, half, **more)}}


def absent(metric: str, window: str, code: str, reason: str) -> Metrics:
    """An answer that is not there."""
    return {window: {metric: missing(code, reason, "deg", window)}}


def row(name: str, metrics: Metrics, **changes: object) -> EstimatorRow:
    """A row with these answers; onboard rows by their name."""
    kind = "onboard" if name.startswith("onboard") else "replay"
    values: dict[str, object] = {
        "name": name,
        "kind": kind,
        "estimator": name.partition("@")[0],
        "preset": name.partition("@")[2] or None,
        "parameters": {},
        "metrics": metrics,
        "skipped": {},
        "ns_per_update": None,
        "status": "ok",
        "title": "VQF" if name == "vqf" else "",
    }
    return EstimatorRow(**(values | changes))  # type: ignore[arg-type]


def result(
    rows: Sequence[EstimatorRow],
    best: Mapping[str, Sequence[str]] | None = None,
    worst: Mapping[str, str] | None = None,
    reference: str = "onboard",
    **log: object,
) -> Result:
    """A result of these rows. ``best`` and ``worst``: metric -> rows, in every window that has the metric.

    All sound replayed rows but the gyro count as compared where their answer is ranked.
    """
    summary = ReferenceSummary(reference, "ATT", 10.0, 0.0, "Agreement, not truth.")
    made = Result({}, "", {}, {"imu": {"rate_hz": 250.0}, "seconds": {"airborne": 60.0}, **log}, reference=summary)
    made.estimators = list(rows)
    for window in dict.fromkeys(w for r in rows for w in r.metrics):
        for metric in dict.fromkeys(m for r in rows for m in r.metrics.get(window, {})):
            made.ranked.setdefault(window, {})[metric] = [r.name for r in rows if _compared(r, metric, window)]
            if metric in (best or {}):
                made.best.setdefault(window, {})[metric] = list((best or {})[metric])
            if metric in (worst or {}):
                made.worst.setdefault(window, {})[metric] = [(worst or {})[metric]]
    return made


def _compared(row: EstimatorRow, metric: str, window: str) -> bool:
    found = row.metrics.get(window, {}).get(metric)
    sound = row.kind == "replay" and row.status == "ok" and row.estimator != "gyro"
    return sound and found is not None and found.value is not None and found.ranked


def verdict(question: str, made: Result) -> Verdict:
    """The verdict on one question."""
    found = {v.question: v for v in verdicts(made)}
    assert list(found) == ["accuracy", "noise", "lag", "yaw_drift"]
    return found[question]


def sentence(question: str, made: Result) -> str:
    """The sentence on one question."""
    return verdict(question, made).sentence
