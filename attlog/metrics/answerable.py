"""Metrics that a log can answer, found with the integrated gyro."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from attlog.core.brief import counted
from attlog.metrics import correction_noise, drift, lag
from attlog.metrics.accuracy import ERRORS
from attlog.metrics.metric import Answer, Case, MetricGroup, named, per_case
from attlog.metrics.ranking import TOO_UNCERTAIN, withdraw_uncertain
from attlog.metrics.windows import PHASES, reason_unavailable, row_windows
from attlog.reference import replayed
from attlog.reference.model import Track

# The integrated gyro has the times, restarts and gaps of every replayed filter. A metric without enough rest, flight,
# steps or reference for it has none for any filter.

# Windows in the order in which the verdicts use them.
AIR, REST = ("airborne", "all", "armed"), ("rest", "rest.long", "all")
STAND_IN = "gyro"
WHERE = {"rest": "at rest", "hover": "in hover", "cruise": "in moving flight", "idle": "with motors idling"}
ONBOARD = drift.HEADING_REFERENCES["onboard"]


class Availability(NamedTuple):
    """Amount of usable data for a metric, or the reasons for none."""

    found: tuple[str, ...]
    why: tuple[str, ...] = ()
    codes: tuple[str, ...] = ()

    @property
    def can(self) -> bool:
        """True if anything can be measured."""
        return bool(self.found)


@per_case
def stand_in(case: Case) -> Track:
    """Return the integrated gyro of the replayed IMU as a row."""
    imu = case.log.replay_imu
    assert imu is not None
    estimate = correction_noise.integrate_gyro(case, imu)
    row = replayed(case.log, case.segments, case.reference, estimate, name=STAND_IN)
    row.imu = imu
    row.status = "ok" if row.status in ("diverged", "not_converged") else row.status
    return row


def ask(case: Case, question: str) -> Availability:
    """Return the availability for one of the questions ASKED."""
    return ASKED[question](case)


def accuracy(case: Case) -> Availability:
    """Find tilt errors against the reference."""
    answer = looked_up(case, ERRORS["tilt"], "tilt_rmse_deg", AIR)
    if answer.value is None:
        return refused(answer)
    return Availability((f"{answer.seconds:.0f} s to compare with {case.reference.source}",))


def noise(case: Case) -> Availability:
    """Find windows of noise in each phase."""
    row = stand_in(case)
    gyro = correction_noise.gyro_alone(case, row)
    assert gyro is not None
    found = []
    for phase in PHASES:
        windows = [w for group in row_windows(case, row, phase, phase) for w in group]
        if phase != "rest":
            use = correction_noise.usable_windows(row.t, gyro, correction_noise.TURN_DEG, [s for _, s in windows])
            windows = [w for w, good in zip(windows, use, strict=True) if good]
        if windows:
            seconds = sum(t1 - t0 for (t0, t1), _ in windows)
            found.append(f"{seconds:.0f} s {WHERE[phase]}")
    code, why = reason_unavailable(case, "rest", "rest")
    return Availability(tuple(found)) if found else Availability((), (why,), (code,))


def step_lag(case: Case) -> Availability:
    """Find a lag in steps; the gyro's is a pure delay."""
    answer = looked_up(case, lag.LAG, "lag_ms", AIR)
    if answer.value is None:
        return refused(answer)
    name = case.reference.name or case.reference.source
    return Availability((f"{counted(answer.n, 'step')}, compared with {name} at {case.reference.rate:.0f} Hz",))


def yaw_drift(case: Case) -> Availability:
    """Find settled rests, and flight against each heading reference."""
    rest = looked_up(case, drift.REST_DRIFT, "drift_rest_deg_per_min", REST)
    air = {
        words: looked_up(case, drift.AIR_DRIFT, f"drift_air_deg_per_min.{name}", AIR)
        for name, words in drift.HEADING_REFERENCES.items()
    }
    found = [f"{rest.seconds:.0f} s at rest after settling"] if rest.value is not None else []
    flown = {words: a.seconds for words, a in air.items() if a.value is not None}
    if flown:
        found.append(f"{max(flown.values()):.0f} s in the air against {', '.join(flown)}")
    if found:
        return Availability(tuple(found))
    nearest = next(
        (a for a in air.values() if a.code in (TOO_UNCERTAIN, "record_too_short", "not_covered")), air[ONBOARD]
    )
    both = [refused(a) for a in (rest, nearest)]
    return Availability((), tuple(w for p in both for w in p.why), tuple(c for p in both for c in p.codes))


def looked_up(case: Case, group: MetricGroup, name: str, windows: tuple[str, ...]) -> Answer:
    """Return the gyro's answer in the first window with a value.

    Without any, that of the first window to which the metric applies.
    """
    metric, first = named(group.metrics, name), None
    for window in windows:
        answer = group.ask(case, stand_in(case), window).get(name)
        if answer is None:
            continue
        withdraw_uncertain(metric, answer)
        if answer.value is not None:
            return answer
        first = first or answer
    assert first is not None
    return first


def refused(answer: Answer) -> Availability:
    """Return the reason of an answer without a value."""
    larger = "; only a larger error would be significant" if answer.code == TOO_UNCERTAIN else ""
    return Availability((), ((answer.reason or "") + larger,), (answer.code or "",))


# Questions in the order of the report.
ASKED: dict[str, Callable[[Case], Availability]] = {
    "accuracy": accuracy,
    "noise": noise,
    "lag": step_lag,
    "yaw_drift": yaw_drift,
}
