"""How quiet is a row? What its filter adds within 5 s: at rest, in hover, in other flight, with motors idling."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, Resolution, Wording, paragraph, per_case
from attlog.metrics.evidence.phases import phase_of, why_none
from attlog.metrics.evidence.samples import imu_of
from attlog.metrics.noise.gyro_share import gyro_share
from attlog.metrics.noise.variances import AXES, PhaseVariances, measured
from attlog.metrics.noise.windows import SECONDS
from attlog.metrics.ranking import following
from attlog.metrics.statistics import intervals as interval
from attlog.metrics.statistics.intervals import VariancePrior
from attlog.metrics.statistics.units import Ids, Summary, UnitValues, ids_of
from attlog.metrics.trials import still
from attlog.reference.model import Row

Array = NDArray[np.float64]


PRIORS = {
    "rest": VariancePrior(0.25, 4.0),
    "onboard at rest": VariancePrior(0.6, 4.0),
    "moving": VariancePrior(1.0, 4.0),
    "one axis in cruise": VariancePrior(3.0, 4.0),
}
"""Scatter of the logarithm of a window's variance, measured over logs. In cruise one axis is quiet until the vehicle
moves about it: a single window says little of the next, both axes of tilt together say more."""
SMALLEST_DEG = 1e-9
"""A variance of exactly zero (a gyro that shows one value) has no logarithm."""
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
_TEXT_P2P = paragraph(
    """Width of the middle 99.8 % of the same residuals, the larger of roll and pitch. A width set by the few largest
    samples of this record: shown without an interval and never ranked."""
)
_RESOLUTION = Resolution(1.0, "its order of magnitude", "windows")


def _noise(axis: str, title: str) -> Metric:
    """The metric of the noise about one of AXES."""
    about = "" if axis == "tilt" else f" in {axis}"
    return Metric(
        f"noise_{axis}_deg",
        title,
        "deg",
        "low",
        ("rest",),
        _TEXT,
        resolution=_RESOLUTION,
        wording=Wording("has", f"less noise{about}", f"more noise{about}", f"noise{about}"),
        scale="ratio",
        asked="phases",
    )


METRICS: tuple[Metric, ...] = (
    _noise("tilt", "Noise, roll and pitch"),
    _noise("roll", "Noise, roll"),
    _noise("pitch", "Noise, pitch"),
    _noise("heading", "Noise, heading"),
    Metric(
        "noise_p2p_deg",
        "Noise, peak to peak",
        "deg",
        "low",
        ("rest",),
        _TEXT_P2P,
        resolution=_RESOLUTION,
        asked="phases",
    ),
)
LARGEST_DEG = 180.0
"""No angle is larger: an interval that reaches so far, as of two unlike windows, says nothing."""


def typical(ids: Ids, values: Array, prior: VariancePrior, correction: float, wanted: Ids) -> Summary:
    """The typical window's standard deviation and its interval from logarithms of variances (k,) on some windows.

    ``correction`` (deg^2) is the part of the variance that the step of the logged values adds.
    """
    chosen = values[np.isin(ids, wanted)]
    low, high = interval.of_moderated(chosen, prior)
    sigma, bottom, top = (math.sqrt(max(math.exp(x) - correction, 0.0)) for x in (float(np.mean(chosen)), low, high))
    return Summary(sigma, (bottom, top))


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows that are not one phase of the flight."""
    phase = phase_of(case, window)
    if phase is None:
        return {}
    uncorrected = still.why_uncorrected(case, row)
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


def prior_of(row: Row, phase: str, axis: str) -> VariancePrior:
    """What is known beforehand of the scatter of a row's noise in a phase about one of AXES."""
    if phase == "rest":
        return PRIORS["rest" if row.kind == "replay" else "onboard at rest"]
    return PRIORS["one axis in cruise" if phase == "cruise" and axis != "tilt" else "moving"]


def _answer(case: Case, row: Row, window: str, phase: str, axis: str, found: PhaseVariances) -> Answer:
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
    summary = on(ids)
    if summary.ci95 is not None and summary.ci95[1] > LARGEST_DEG:
        summary, reason = Summary(summary.value, None), "its windows differ too much to give an interval"
    if row.kind == "onboard" and phase != "rest":
        summary = one_digit(summary)
        reason = "of another IMU path with its own delay: known to one digit"
    detail = {"windows": len(ids), "phase": phase, "step_deg": row.step_deg}
    if found.settled_s is not None:
        detail["settled_after_s"] = found.settled_s
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
        detail=detail,
        floor=max(0.5 * step, hidden if shown else 0.0),
        gyro_share=_gyro_share(case, row, phase, axis) if phase != "rest" else 0.0,
        units=UnitValues("log_variance", ids, values, on),
    )
    return _guarded(case, row, axis, answer)


def _guarded(case: Case, row: Row, axis: str, answer: Answer) -> Answer:
    """The answer, not ranked for rows that are quiet because they stand still or because nothing corrects them."""
    for about in ("roll", "pitch") if axis == "tilt" else (axis,):
        following.unrank_frozen(case, row, about, answer)
    uncorrected = still.why_uncorrected(case, row)
    if answer.ranked and uncorrected:
        answer.ranked, answer.reason = False, uncorrected
    return answer


def _hidden(case: Case, row: Row, axis: str) -> float:
    """What the steps of the row's logged gyro can hide about an axis, deg; the larger of roll and pitch for tilt."""
    imu = imu_of(case, row)
    if row.kind != "replay" or imu is None:
        return 0.0
    hidden = hidden_deg(case, next(k for k, unit in enumerate(case.log.imus) if unit.index == imu.index))
    return max(hidden[:2]) if axis == "tilt" else hidden[AXES.index(axis)]


def _gyro_share(case: Case, row: Row, phase: str, axis: str) -> float:
    """What the row's gyro itself wanders by in a phase, deg; 0 of samples that were changed before the filter."""
    imu = imu_of(case, row)
    index = None if imu is None else next((k for k, unit in enumerate(case.log.imus) if unit.index == imu.index), None)
    return 0.0 if index is None else gyro_share(case, index, phase)[AXES.index(axis)]


STEP_SAMPLES = 20_000
"""Gyro samples of the whole log that are enough to see the step of its values."""


@per_case
def hidden_deg(case: Case, index: int) -> list[float]:
    """The angle noise in deg per body axis at rest that the steps of the logged gyro of unit ``index`` can hide.

    White rate noise of half a step q may not show at all. Integrated every dt it walks at
    random, and a random walk of length T keeps 1/15 of its last variance about its own
    straight line: sqrt(dt T / 15) q / 2 in windows of T = 5 s. Tiny for floating-point
    logs, 0.005 deg at 10 Hz and 1 mrad/s, infinite for an axis that never changes.
    """
    gyro = case.log.imus[index].gyro
    if len(gyro.t) < 2:
        return [0.0] * 3
    some = np.degrees(gyro.x[:: len(gyro.t) // STEP_SAMPLES + 1])
    steps = [np.diff(np.unique(x[np.isfinite(x)])).min(initial=math.inf) for x in some.T]
    share = 0.5 * math.sqrt(float(np.median(np.diff(gyro.t))) * SECONDS / 15.0)
    return [share * float(step) for step in steps]


def one_digit(summary: Summary) -> Summary:
    """A value and its interval to one significant digit."""

    def rounded(x: float) -> float:
        return float(f"{x:.1g}")

    return Summary(rounded(summary.value), summary.ci95 and (rounded(summary.ci95[0]), rounded(summary.ci95[1])))
