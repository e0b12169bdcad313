"""Which questions a log can answer before any filter runs: the metrics, asked of the integrated gyro."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.estimators import samples
from attlog.estimators.interface import Estimate
from attlog.flight.model import Imu
from attlog.metrics import correction_noise, drift, lag
from attlog.metrics.accuracy import ERRORS
from attlog.metrics.metric import Answer, Case, MetricGroup, named, per_case
from attlog.metrics.ranking import CODE, mark_not_ranked
from attlog.metrics.windows import PHASES, row_windows, why_none
from attlog.reference import replayed
from attlog.reference.model import Row

Array = NDArray[np.float64]


# The integrated gyro has the times, restarts and gaps of every replayed filter. What the metrics refuse to it for want
# of rest, flight, steps or reference, they refuse to every filter.

# Windows in which a question is looked up, as the verdicts do.
AIR, REST = ("airborne", "all", "armed"), ("rest", "rest.long", "all")
STAND_IN = "gyro"
WHERE = {"rest": "at rest", "hover": "in hover", "cruise": "in moving flight", "idle": "with motors idling"}
ONBOARD = drift.HEADING_REFERENCES["onboard"]


@dataclass(frozen=True, slots=True)
class Availability:
    """What could be measured for a question, in words; where nothing can, why not, with the codes of the metrics."""

    found: tuple[str, ...]
    why: tuple[str, ...] = ()
    codes: tuple[str, ...] = ()

    @property
    def can(self) -> bool:
        """Whether anything can be measured."""
        return bool(self.found)


@per_case
def stand_in(case: Case) -> Row:
    """The gyro alone as a row of a case with an IMU; no compiler is loaded for it."""
    imu = case.log.replay_imu
    assert imu is not None
    row = replayed(
        case.log,
        case.segments,
        case.reference,
        integrated(imu, case.gyro_of(imu), case.reference.alignment.clock),
        name=STAND_IN,
    )
    row.imu = imu
    row.status = "ok" if row.status in ("diverged", "not_converged") else row.status
    return row


def integrated(imu: Imu, rates: Array, clock: str) -> Estimate:
    """The unit's ``rates`` (n, 3) integrated from level at each restart, at the samples that every filter uses."""
    t = imu.gyro.t_best if clock == "sample" else imu.gyro.t
    clean = samples.prepare(t, rates, imu.acc.x, dt=imu.dt, sampling=imu.gyro.sampling, lead=False, ours=True)
    angles, first = np.where(clean.substeps > 0, clean.dt, 0.0)[:, None] * clean.gyr, clean.acc[clean.begin]
    times, segment, begins = clean.t, clean.segment, clean.begin.tolist()
    del clean, rates
    turns = [rotation.from_rotvec(angles)]
    del angles  # of gigabytes each copy is one
    q = products(turns.pop())
    for begin, end, acc in zip(begins, [*begins[1:], len(q)], first, strict=True):
        level = rotation.multiply(levelled(acc), rotation.conjugate(q[begin]))
        for a in range(begin, end, rotation.BLOCK_ROWS):
            own = slice(a, min(a + rotation.BLOCK_ROWS, end))
            q[own] = rotation.multiply(level, q[own])
    return Estimate(times, q, segment=segment)


def levelled(acc: Array) -> Array:
    """The attitude (4,) without heading in which a specific force (3,) points up; level without one."""
    if not acc.any():
        return np.array([1.0, 0.0, 0.0, 0.0])
    return rotation.from_euler(np.arctan2(-acc[1], -acc[2]), np.arctan2(acc[0], np.hypot(acc[1], acc[2])), 0.0)


def products(q: Array) -> Array:
    """q[0], q[0] q[1], q[0] q[1] q[2] ... of (n, 4): in short blocks, then what stands before each."""
    n = len(q)
    size = max(2, round(n ** (1.0 / 3.0)))
    padded = np.zeros((-(-n // size) * size, 4))
    padded[:, 0] = 1.0
    padded[:n] = q
    del q
    blocks = padded.reshape(-1, size, 4)
    for k in range(1, size):
        blocks[:, k] = rotation.multiply(blocks[:, k - 1], blocks[:, k])
    if len(blocks) > 1:
        before, some = products(blocks[:-1, -1]), max(1, rotation.BLOCK_ROWS // size)
        for a in range(1, len(blocks), some):  # what is made on the way stays in the processor's cache
            own = blocks[a : a + some]
            own[:] = rotation.normalize(rotation.multiply(before[a - 1 : a - 1 + len(own), None], own))
    return padded[:n]


def ask(case: Case, question: str) -> Availability:
    """What one of ASKED finds in the stand-in: the evidence that a verdict rests on."""
    return ASKED[question](case)


def accuracy(case: Case) -> Availability:
    """Tilt errors against the reference."""
    answer = looked_up(case, ERRORS["tilt"], "tilt_rmse_deg", AIR)
    if answer.value is None:
        return refused(answer)
    return Availability((f"{answer.seconds:.0f} s to compare with {case.reference.source}",))


def noise(case: Case) -> Availability:
    """Windows of noise in each phase."""
    row = stand_in(case)
    gyro = correction_noise.GyroAttitude(row.t, row.q, row.segment)
    found = []
    for phase in PHASES:
        windows = [w for group in row_windows(case, row, phase, phase) for w in group]
        if phase != "rest":
            use = correction_noise.of_use(row.t, gyro, correction_noise.TURN_DEG, [s for _, s in windows])
            windows = [w for w, good in zip(windows, use, strict=True) if good]
        if windows:
            seconds = sum(t1 - t0 for (t0, t1), _ in windows)
            found.append(f"{seconds:.0f} s {WHERE[phase]}")
    code, why = why_none(case, "rest", "rest")
    return Availability(tuple(found)) if found else Availability((), (why,), (code,))


def step_lag(case: Case) -> Availability:
    """A lag in steps: of the gyro alone it is a pure delay wherever the reference follows the gyro."""
    answer = looked_up(case, lag.LAG, "lag_ms", AIR)
    if answer.value is None:
        return refused(answer)
    name = case.reference.name or case.reference.source
    return Availability((f"{answer.n} steps, compared with {name} at {case.reference.rate:.0f} Hz",))


def yaw_drift(case: Case) -> Availability:
    """Rests after settling, and flight against each heading reference."""
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
    nearest = next((a for a in air.values() if a.code in (CODE, "record_too_short", "not_covered")), air[ONBOARD])
    both = [refused(a) for a in (rest, nearest)]
    return Availability((), tuple(w for p in both for w in p.why), tuple(c for p in both for c in p.codes))


def looked_up(case: Case, group: MetricGroup, name: str, windows: tuple[str, ...]) -> Answer:
    """Return the gyro's answer in the first window with a value, else in the first where the metric means something."""
    metric, first = named(group.metrics, name), None
    for window in windows:
        answer = group.ask(case, stand_in(case), window).get(name)
        if answer is None:
            continue
        mark_not_ranked(metric, answer)
        if answer.value is not None:
            return answer
        first = first or answer
    assert first is not None
    return first


def refused(answer: Answer) -> Availability:
    """Why there is no value. Of the gyro alone: a filter may be off by more than its interval all the same."""
    larger = "; only a larger error would be significant" if answer.code == CODE else ""
    return Availability((), ((answer.reason or "") + larger,), (answer.code or "",))


# The questions in the order of the report.
ASKED: dict[str, Callable[[Case], Availability]] = {
    "accuracy": accuracy,
    "noise": noise,
    "lag": step_lag,
    "yaw_drift": yaw_drift,
}
