"""Noise of a row within 5 s: at rest, in hover, in other flight, with motors idling."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, I1, Out2
from attlog.core.sorting import is_in, median, unique
from attlog.metrics import correction_noise, following, statistics, windows
from attlog.metrics.correction_noise import DEG, Residuals, relative, vector
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, Resolution, Wording, paragraph, per_case, per_row
from attlog.metrics.statistics import Ids, Summary, UnitValues, VariancePrior, make_ids
from attlog.metrics.windows import WINDOW_S, imu_of, phase_of, phase_spans, reason_unavailable
from attlog.reference.model import Track

Array = NDArray[np.float64]
Index = NDArray[np.int64]


NOISE_AXES = ("roll", "pitch", "heading", "tilt")
# Leading windows of a rest with more than this times the median variance of all later ones (at least 3) settle.
UNSETTLED, MIN_LATER = 4.0, 3


TURN = 2.0 * math.pi


@jit.loop("the noise at rest")
def rest_residual(out: Out2, t: F1, q: F2, centre: F2, yaw: F1, edges: I1) -> None:
    """Fill ``out`` (n, 3) with the residual in deg of attitudes ``q`` (n, 4) at ``t`` (n,) about a line.

    Window k has the samples ``edges[k]`` to ``edges[k + 1]``, ``centre[k]`` is their mean attitude, ``yaw[k]`` its
    heading. The rotation from the mean: about the level roll and pitch axis and the vertical, unwrapped.
    """
    for k in range(len(yaw)):
        a, b = edges[k], edges[k + 1]
        cosine, sine = DEG * math.cos(yaw[k]), DEG * math.sin(yaw[k])
        before, middle = 0.0, 0.0
        for i in range(a, b):
            w, x, y, z = relative(q, i, centre, k)
            heading = 2.0 * math.atan2(z, w)
            heading += TURN * np.floor((before - heading) / TURN + 0.5)  # the whole turns of the sample before
            before = heading
            x, y, _ = vector(w, x, y, z)
            out[i, 0], out[i, 1], out[i, 2] = x * cosine + y * sine, y * cosine - x * sine, DEG * heading
            middle += (t[i] - t[a]) / (b - a)
        for c in range(3):
            mean = 0.0
            for i in range(a, b):
                mean += out[i, c] / (b - a)
            along, size = 0.0, 0.0
            for i in range(a, b):
                u = t[i] - t[a] - middle
                along, size = along + u * (out[i, c] - mean), size + u * u
            for i in range(a, b):
                out[i, c] -= mean + along / size * (t[i] - t[a] - middle)


class PhaseVariances(NamedTuple):
    """Windows that begin at ``t0`` (k,) s, with variances (k, 4) deg^2 about NOISE_AXES and ``seconds`` in all."""

    t0: Array
    variances: Array
    seconds: float


def variances_of(residuals: Iterable[Residuals]) -> Array:
    """Return variances (k, 4) about roll, pitch, heading and tilt (mean of the first two) of windows.

    ``residuals``: batches of windows.
    """
    found = [np.zeros((0, 3))]
    for x, edges in residuals:
        sums = [np.add.reduceat(np.ascontiguousarray(axis) ** 2, edges[:-1]) for axis in x.T]
        found.append(np.column_stack(sums) / (np.diff(edges) - 2)[:, None])
    v = np.concatenate(found)
    return np.column_stack([v, 0.5 * (v[:, 0] + v[:, 1])])


def unsettled(variances: Array) -> int:
    """Return how many leading windows settle: variances (k, 4), tilt or heading above 4 x the later median."""
    for k in range(len(variances) - MIN_LATER):
        later = median(variances[k + 1 :, 2:], axis=0)
        if not (variances[k, 2:] > UNSETTLED * later).any():
            return k
    return max(0, len(variances) - MIN_LATER)


@per_row
def phase_variances(case: Case, row: Track, phase: str, window: str) -> PhaseVariances | None:
    """Return the windows of a row in a phase and their variances; None without a usable window.

    Windows of a rest in which the row settles are left out.
    """
    spans = windows.row_windows(case, row, phase, window)
    inside = [samples for span in spans for _, samples in span]
    if phase == "rest":
        use, residuals = np.ones(len(inside), bool), residuals_at_rest(row, inside)
    else:
        use, residuals = correction_noise.window_residuals(case, row, inside)
    if not use.any():
        return None
    left, first = variances_of(residuals), 0
    begin_end = np.array([w for span in spans for w, _ in span])
    keep = np.ones(len(left), bool)
    if phase == "rest":
        for span in spans:
            if len(span) > MIN_LATER:
                keep[first : first + unsettled(left[first : first + len(span)])] = False
            first += len(span)
    t0, t1 = begin_end[use][keep].T
    return PhaseVariances(t0, left[keep], float(sum((t1 - t0).tolist())))


def residuals_at_rest(row: Track, inside: list[slice]) -> Iterator[Residuals]:
    """Yield residuals about mean attitude and a line in windows at rest, a batch at a time."""
    for _, at, edges in windows.sample_batches(inside):
        q, out = np.ascontiguousarray(row.q[at], np.float64), np.empty((len(at), 3))
        centre = rotation.group_means(q, edges)
        yaw = np.ascontiguousarray(rotation.to_euler(centre)[:, 2])
        rest_residual(out, row.t[at], q, centre, yaw, edges)
        yield Residuals(out, edges)


# Noise of the gyro itself in flight: smaller noise of filters cannot be ordered.

# A gyro that shows one value has no logarithm, deg^2.
TINY = 1e-18


@per_case
def gyro_noise_floor(case: Case, index: int, phase: str) -> list[float]:
    """Return the noise of a unit's own gyro in windows of a phase: deg about NOISE_AXES.

    Noise and motion between samples show as changes d from one sample to the next. Rate noise of variance d^2 / 2
    integrated every dt walks at random, and keeps 1/15 of its last variance about its own line: sqrt(dt T / 30) d in
    windows of T = 5 s, the typical window as for the rows. On 24 simulated flights with truth 0.4 to 2 times the wander
    of the integrated gyro in hover.
    """
    gyro, found = case.log.imus[index].gyro, []
    for span in phase_spans(case, phase, phase):
        for _, inside in windows.windows_of_times(case, gyro.t_best, phase, span):
            if inside is not None:
                step = (gyro.t_best[inside.stop - 1] - gyro.t_best[inside.start]) / (inside.stop - inside.start - 1)
                changes = np.nanmean(np.diff(np.degrees(gyro.x[inside]), axis=0) ** 2, axis=0)
                found.append(step * windows.WINDOW_S / 30.0 * changes)
    if not found:
        return [0.0] * 4
    roll, pitch, heading = np.exp(np.mean(np.log(np.maximum(found, TINY)), axis=0)).tolist()
    return [math.sqrt(v) for v in (roll, pitch, heading, 0.5 * (roll + pitch))]


# How quiet is a row? What its filter adds within 5 s: at rest, in hover, in other flight, with motors idling.

# Scatter of the logarithm of a window's variance, measured over logs. In cruise one axis is quiet until the vehicle
# moves about it: a single window says little of the next, both axes of tilt together say more.
PRIORS = {
    "rest": VariancePrior(0.25, 4.0),
    "onboard at rest": VariancePrior(0.6, 4.0),
    "moving": VariancePrior(1.0, 4.0),
    "one axis in cruise": VariancePrior(3.0, 4.0),
}
# A variance of exactly zero (a gyro that shows one value) has no logarithm.
SMALLEST_DEG = 1e-9
_TEXT = paragraph(
    """How much the row moves by itself within 5 s, 1 sigma. At rest: rotation away from the window's mean attitude,
    about the level roll and pitch axis and the vertical, straight line removed. In hover, cruise (other flight) and
    idle (motors turning on the ground): rotation away from the gyro alone, integrated over the same samples, a
    constant offset and a constant gyro offset in body axes removed, in windows in which the vehicle stays within 20
    deg of its mean attitude (onboard rows 10 deg). True motion and the gyro's own noise are in both and cancel, so
    that no reference is needed: what is left is what the filter adds. Rows whose variances differ by less than the
    gyro's own (from its changes between samples) are not ordered. Value: exp(mean ln v / 2) over windows of 5 s
    with variance v = sum r^2 / (N - 2), the typical window; tilt: v is the mean of roll and pitch. Interval:
    moderated t on ln v (Smyth 2004). Left out: 10 s after the filter's start, 5 s after the motors stop, leading
    windows of a rest with more than 4 times the later variance. Ranked only for rows that follow motion and are
    corrected by gravity; at rest only above half the step of the logged values and above what the steps of the
    logged gyro can hide."""
)
_RESOLUTION = Resolution(1.0, "its order of magnitude", "windows")


def _noise(axis: str, title: str) -> Metric:
    """Return the metric of the noise about one of NOISE_AXES."""
    about = "" if axis == "tilt" else f" in {axis}"
    return Metric(
        f"noise_{axis}_deg",
        title,
        "deg",
        "low",
        _TEXT,
        resolution=_RESOLUTION,
        wording=Wording("has", f"less noise{about}", f"more noise{about}", f"noise{about}"),
        scale="ratio",
        asked="phases",
    )


NOISE_METRICS: tuple[Metric, ...] = (
    _noise("tilt", "Noise, roll and pitch"),
    _noise("roll", "Noise, roll"),
    _noise("pitch", "Noise, pitch"),
    _noise("heading", "Noise, heading"),
)
# No angle is larger: an interval that reaches so far, as of two unlike windows, says nothing.
LARGEST_DEG = 180.0


def typical(ids: Ids, values: Array, prior: VariancePrior, correction: float, wanted: Ids) -> Summary:
    """Return the typical window's standard deviation from logarithms of variances (k,) on some windows.

    ``correction`` (deg^2) is the part of the variance that the step of the logged values adds.
    """
    chosen = values if wanted is ids else values[is_in(ids, wanted)]
    low, high = statistics.moderated_interval(chosen, prior)
    sigma, bottom, top = (math.sqrt(max(math.exp(x) - correction, 0.0)) for x in (float(np.mean(chosen)), low, high))
    return Summary(sigma, (bottom, top))


def why_no_noise(case: Case, row: Track, window: str) -> tuple[str, str] | None:
    """Return code and reason where a row has no noise in flight by definition."""
    phase = phase_of(case, window)
    if phase in ("rest", None):
        return None
    uncorrected = following.why_uncorrected(case, row)
    if uncorrected:
        return "not_applicable", f"{uncorrected}, so nothing is added to the gyro and this noise is zero by definition"
    return ("not_applicable", "the log holds no gyro to compare with") if imu_of(case, row) is None else None


def compute_noise(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the noise of one row in the phase that a window means; empty for other windows."""
    phase = phase_of(case, window)
    if phase is None:
        return {}
    found = phase_variances(case, row, phase, window)
    if found is None:
        return NOISE.without(*reason_unavailable(case, phase, window), window)
    answers = {f"noise_{axis}_deg": _answer(case, row, window, phase, axis, found) for axis in NOISE_AXES}
    return {m.name: answers[m.name] for m in NOISE_METRICS}


def spans_of_window(case: Case, row: Track, window: str) -> Hashable:
    """Return phase and spans that a window means; the window itself where its name is in the reasons."""
    phase = phase_of(case, window)
    spans = [] if phase is None else phase_spans(case, phase, window)
    return (phase, *spans) if spans and ":" not in window else window


def prior_of(row: Track, phase: str, axis: str) -> VariancePrior:
    """Return the prior scatter of a row's noise in a phase about one of NOISE_AXES."""
    if phase == "rest":
        return PRIORS["onboard at rest" if row.kind == "onboard" else "rest"]
    return PRIORS["one axis in cruise" if phase == "cruise" and axis != "tilt" else "moving"]


def _answer(case: Case, row: Track, window: str, phase: str, axis: str, found: PhaseVariances) -> Answer:
    hidden = _row_quantisation_noise_deg(case, row, axis) if phase == "rest" else 0.0
    shown = math.isfinite(hidden)
    step = row.step_deg if phase == "rest" else 0.0
    prior = prior_of(row, phase, axis)
    smallest = max(step**2 / 12.0, SMALLEST_DEG**2)
    values = np.log(np.maximum(found.variances[:, NOISE_AXES.index(axis)], smallest))
    ids = make_ids(found.t0)
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
    summary = on(ids) if correction else whole
    if summary.ci95 is not None and summary.ci95[1] > LARGEST_DEG:
        summary, reason = Summary(summary.value, None), "its windows differ too much to give an interval"
    if row.kind == "onboard" and phase != "rest":
        summary = one_digit(summary)
        reason = "of another IMU path with its own delay: known to one digit"
    answer = Answer(
        summary.value,
        "deg",
        window,
        len(ids),
        found.seconds,
        summary.ci95,
        f"typical of {len(ids)} windows of 5 s, moderated t",
        reason=reason,
        ranked=reason is None,
        floor=max(0.5 * step, hidden if shown else 0.0),
        gyro_share=_row_noise_floor(case, row, phase, axis) if phase != "rest" else 0.0,
        units=UnitValues("log_variance", ids, values, on),
    )
    return _guarded(case, row, axis, answer)


def _guarded(case: Case, row: Track, axis: str, answer: Answer) -> Answer:
    """Return the answer, not ranked for rows that are frozen or that nothing corrects."""
    for about in ("roll", "pitch") if axis == "tilt" else (axis,):
        following.unrank_frozen(case, row, about, answer)
    uncorrected = following.why_uncorrected(case, row)
    if answer.ranked and uncorrected:
        answer.ranked, answer.reason = False, uncorrected
    return answer


def _row_quantisation_noise_deg(case: Case, row: Track, axis: str) -> float:
    """Return the noise that steps of the row's logged gyro can hide about an axis, deg; for tilt the larger."""
    imu = imu_of(case, row)
    if row.kind != "replay" or imu is None:
        return 0.0
    hidden = quantisation_noise_deg(case, next(k for k, unit in enumerate(case.log.imus) if unit.index == imu.index))
    return max(hidden[:2]) if axis == "tilt" else hidden[NOISE_AXES.index(axis)]


def _row_noise_floor(case: Case, row: Track, phase: str, axis: str) -> float:
    """Return the noise of the row's gyro in a phase, deg; 0 of samples that were changed before the filter."""
    imu = imu_of(case, row)
    index = None if imu is None else next((k for k, unit in enumerate(case.log.imus) if unit.index == imu.index), None)
    return 0.0 if index is None else gyro_noise_floor(case, index, phase)[NOISE_AXES.index(axis)]


# Gyro samples of the whole log that are enough to see the step of its values.
STEP_SAMPLES = 20_000


@per_case
def quantisation_noise_deg(case: Case, index: int) -> list[float]:
    """Return the noise in deg per body axis at rest that steps of the logged gyro can hide.

    White rate noise of half a step q may not show at all. Integrated every dt it walks at random, and a random walk of
    length T keeps 1/15 of its last variance about its own line: sqrt(dt T / 15) q / 2 in windows of T = 5 s. Tiny for
    floating-point logs, 0.005 deg at 10 Hz and 1 mrad/s, infinite for an axis that never changes.
    """
    gyro = case.log.imus[index].gyro
    if len(gyro.t) < 2:
        return [0.0] * 3
    some = np.degrees(gyro.x[:: len(gyro.t) // STEP_SAMPLES + 1])
    steps = [np.diff(unique(x[np.isfinite(x)])).min(initial=math.inf) for x in some.T]
    share = 0.5 * math.sqrt(float(median(np.diff(gyro.t))) * WINDOW_S / 15.0)
    return [share * float(step) for step in steps]


def one_digit(summary: Summary) -> Summary:
    """Round a value and its interval to one significant digit."""

    def rounded(x: float) -> float:
        return float(f"{x:.1g}")

    return Summary(rounded(summary.value), summary.ci95 and (rounded(summary.ci95[0]), rounded(summary.ci95[1])))


NOISE = MetricGroup("noise", "Noise", NOISE_METRICS, compute_noise, needs=(why_no_noise,), rests_on=spans_of_window)
METRIC_GROUPS = (NOISE,)
