"""Does the reference plainly turn as the gyro does in steps? Then their lag can be measured, without the fit.

The fit of the lag (:mod:`attlog.metrics.step_fit`) also tells aiding, misalignment and intervals. It takes compiled
loops, and to load them costs more than all that ``attlog info`` does with a log. Here two rates about each event's axis
are compared at the delay of their largest correlation, which is enough where the answer is clear.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.estimators import samples
from attlog.estimators.interface import Estimate
from attlog.flight.model import Imu
from attlog.metrics import accuracy as rmse
from attlog.metrics import correction_noise, lag
from attlog.metrics import drift as drift_air
from attlog.metrics import drift as drift_rest
from attlog.metrics.lag import input_delay, sample_step
from attlog.metrics.metric import Answer, Case, Metric, named, per_case
from attlog.metrics.ranking import CODE, mark_not_ranked
from attlog.metrics.step_fit import COARSE_S, MIN_EVENTS, RANGE_S, events_in, reference_turning, timing, why_no_events
from attlog.metrics.step_products import MARGIN_S, SPAN_S, STRIDE_S, axis_of
from attlog.metrics.step_turning import SummedTurning, around
from attlog.metrics.windows import PHASES, row_windows, why_no_errors, why_none
from attlog.reference import replayed
from attlog.reference.model import Row

Array = NDArray[np.float64]


MOST_GAIN_ERROR, MOST_DISTORTION = 0.03, 0.08
"""Half of what :mod:`attlog.metrics.lag` allows: between the two the fit decides."""
FINE = 5


def plain_lag_events(case: Case, row: Row, window: str) -> int | None:
    """How many events of a window the reference follows as the row does, some time apart; None where the fit decides.

    ``row``: the gyro alone.
    """
    if why_no_errors(case, row) is not None or why_no_events(case, row, window) is not None:
        return None
    ref, track = reference_turning(case), SummedTurning(row.t, row.q, row.segment, timing(case, row.t))
    span = max(2, round(SPAN_S / ref.step))
    x: list[Array] = []
    y: list[Array] = []
    at: list[Array] = []
    fast_t: list[Array] = []
    for event, a, b in zip(
        (events := events_in(case, row, window)), around(track, events, MARGIN_S), around(ref, events, 0.0), strict=True
    ):
        axis = None if a is None or b is None else axis_of(ref, event)
        if axis is None or a is None or b is None or b.stop - b.start <= span:
            continue
        offset = STRIDE_S * len(at) - event.begin
        fast_t.append(track.t[a] + offset)
        y.append((track.turned[a] - track.turned[a.start]) @ axis)
        at.append(ref.t[b] + offset)
        x.append((ref.turned[b] - ref.turned[b.start]) @ axis)
    if len(at) < MIN_EVENTS:
        return None
    rates = Rates(at, x, np.concatenate(fast_t), np.concatenate(y), span)
    delay = rates.best()
    gain, distortion = rates.compared(delay)
    lag, earliest = delay - input_delay(case, row), -0.5 * sample_step(case, row)
    early = case.reference.kind != "onboard" and lag < 0.5 * earliest
    edge = abs(delay) > RANGE_S - COARSE_S
    clear = abs(gain - 1.0) <= MOST_GAIN_ERROR and distortion <= MOST_DISTORTION and not early and not edge
    return len(at) if clear else None


class Rates:
    """The turning ``x`` of the reference at ``at``, event by event, and ``y`` of the row at ``t`` on one time axis."""

    def __init__(self, at: list[Array], x: list[Array], t: Array, y: Array, span: int) -> None:
        self.begin = np.concatenate([k[:-span] for k in at])
        self.end = np.concatenate([k[span:] for k in at])
        self.first = np.cumsum([0, *(len(k) - span for k in at)])
        self.t, self.y = t, y
        self.x = self._centred((np.concatenate([k[span:] - k[:-span] for k in x])) / (self.end - self.begin))

    def best(self) -> float:
        """The delay (s) of the row with the largest correlation: on a grid, a finer one, and between its points."""
        coarse = np.arange(-RANGE_S, RANGE_S + 1e-9, COARSE_S)
        middle = coarse[int(np.argmax([self._correlation(d) for d in coarse]))]
        step = COARSE_S / FINE
        fine = middle + step * np.arange(-FINE, FINE + 1)
        found = [self._correlation(d) for d in fine]
        k = min(max(int(np.argmax(found)), 1), len(fine) - 2)
        before, here, after = found[k - 1 : k + 2]
        bend = before - 2.0 * here + after
        return float(fine[k] + (0.5 * step * (before - after) / bend if bend < 0 else 0.0))

    def compared(self, delay: float) -> tuple[float, float]:
        """Gain of the row against the reference, and what that leaves of its rate, as a share of the reference's."""
        row, power = self._row(delay), float(self.x @ self.x)
        if power <= 0.0:
            return 0.0, np.inf
        gain = float(row @ self.x) / power
        left = row - gain * self.x
        return gain, float(np.sqrt(left @ left / power))

    def _correlation(self, delay: float) -> float:
        row = self._row(delay)
        size = float(np.sqrt((row @ row) * (self.x @ self.x)))
        return float(row @ self.x) / size if size > 0.0 else 0.0

    def _row(self, delay: float) -> Array:
        """The row's rate, so much later."""
        turned = np.interp(self.end + delay, self.t, self.y) - np.interp(self.begin + delay, self.t, self.y)
        return self._centred(turned / (self.end - self.begin))

    def _centred(self, rate: Array) -> Array:
        counts = np.diff(self.first)
        return np.asarray(rate - np.repeat(np.add.reduceat(rate, self.first[:-1]) / counts, counts))


# Which questions can a log answer, before any filter runs? The metrics themselves, asked of a stand-in.
#
# The stand-in is the gyro alone, integrated with numpy: it has the times, restarts and gaps
# that every replayed filter has. What the metrics refuse to it for want of rest, flight,
# steps or reference, they refuse to every filter.

AIR, REST = ("airborne", "all", "armed"), ("rest", "rest.long", "all")
"""Windows in which a question is looked up, as the verdicts do."""
STAND_IN = "gyro"
WHERE = {"rest": "at rest", "hover": "in hover", "cruise": "in moving flight", "idle": "with motors idling"}
ONBOARD = drift_air.HEADING_REFERENCES["onboard"]
Compute = Callable[[Case, Row, str], dict[str, Answer]]


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
        case.log, case.segments, case.reference, integrated(imu, case.gyro_of(imu), case.reference.clock), name=STAND_IN
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
    answer = looked_up(case, rmse.compute_rmse, named(rmse.RMSE_METRICS, "tilt_rmse_deg"), AIR)
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
    count = plain_lag_events(case, stand_in(case), AIR[0])
    if count is None:
        answer = looked_up(case, lag.compute_lag, named(lag.LAG_METRICS, lag.metric_id("lag", "all")), AIR)
        if answer.value is None:
            return refused(answer)
        count = answer.n
    name = case.reference.name or case.reference.source
    return Availability((f"{count} steps, compared with {name} at {case.reference.rate:.0f} Hz",))


def yaw_drift(case: Case) -> Availability:
    """Rests after settling, and flight against each heading reference."""
    rest = looked_up(case, drift_rest.compute_rest_drift, drift_rest.REST_DRIFT_METRICS[0], REST)
    air = {
        words: looked_up(case, drift_air.compute_air_drift, metric, AIR)
        for metric, words in zip(drift_air.AIR_DRIFT_METRICS, drift_air.HEADING_REFERENCES.values(), strict=True)
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


def looked_up(case: Case, compute: Compute, metric: Metric, windows: tuple[str, ...]) -> Answer:
    """The stand-in's answer in the first window that has a value, else in the first that the metric is about."""
    first: Answer | None = None
    for window in windows:
        answer = compute(case, stand_in(case), window).get(metric.name)
        if answer is not None:
            mark_not_ranked(metric, answer)
        if answer is not None and answer.value is not None:
            return answer
        first = first or answer
    assert first is not None
    return first


def refused(answer: Answer) -> Availability:
    """Why there is no value. Of the gyro alone: a filter may be off by more than its interval all the same."""
    larger = "; only a larger error would be significant" if answer.code == CODE else ""
    return Availability((), ((answer.reason or "") + larger,), (answer.code or "",))


ASKED: dict[str, Callable[[Case], Availability]] = {
    "accuracy": accuracy,
    "noise": noise,
    "lag": step_lag,
    "yaw_drift": yaw_drift,
}
"""The questions in the order of the report."""
