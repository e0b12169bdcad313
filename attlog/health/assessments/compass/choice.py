"""Is another compass better than the one in use? Their headings side by side, else the size of their fields."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from attlog.flight import magnetic
from attlog.flight.model import Array, FlightLog, Mag
from attlog.health.assessments.compass.heading import heading_error, rms_deg
from attlog.health.assessments.compass.samples import air_spans
from attlog.health.assessments.compass.study import CompassStudy
from attlog.health.assessments.model import Assessment, HealthCase, Setting
from attlog.health.findings.actions import CLOSE, OFF, STEADY, calibrated, switching
from attlog.reference import declination
from attlog.segments.spans import inside

CHOICE = "compass_choice"
HALF, BETTER_DEG = 0.5, 5.0
"""Another is better where its heading errs by half as much, and by 5 deg less: attitudes do not err by that."""
SOUND_DEG = 12.0
"""A compass that errs by more is not to be flown by, as an offset that leaves more is not to be set."""
LIMIT = f"ok unless another errs by {BETTER_DEG:.0f} deg less and half as much, else by the field's size within 10 %"


def assessed(case: HealthCase, studies: Sequence[CompassStudy]) -> list[Assessment]:
    """Which compass to use; nothing where the log holds fewer than two that measure."""
    log = case.log
    mags = [mag for mag in log.mags if not magnetic.dead(mag, log.replay_imu)]
    if len(mags) < 2 or log.mag is None or case.segments is None or not air_spans(case.segments):
        return []
    used = log.mags[log.mag]
    own = next((s for s in studies if s.samples.mag is used), None)
    others = [s for s in studies if s.samples.mag is not used]
    if own is not None and others:
        return [_by_heading(log, own, others)]
    return _by_size(case, used, [mag for mag in mags if mag is not used])


def _by_heading(log: FlightLog, own: CompassStudy, others: Sequence[CompassStudy]) -> Assessment:
    """The heading errors of every compass as it is logged, and what is left after its own offset."""
    errors = {id(study): _errors(study) for study in (own, *others)}
    best = min(others, key=lambda study: errors[id(study)][0])
    now, then = errors[id(own)][0], errors[id(best)][0]
    better = then <= HALF * now and now - then >= BETTER_DEG
    one, two = best.samples.source, own.samples.source
    text = f"{two}, in use, errs by {now:.1f} deg in heading, {one} by {then:.1f} deg."
    answer = Assessment(
        two,
        CHOICE,
        "warning" if better else "ok",
        text,
        round(then - now, 1),
        "deg",
        n=own.air.n,
        seconds=round(own.samples.seconds, 1),
        threshold=LIMIT,
        evidence=[_line(study, *errors[id(study)]) for study in (own, *others)],
    )
    if better and then > SOUND_DEG:
        answer.why_no_setting = f"{one} is better, but errs too: calibrate both."
    elif better:
        _offer(log, answer, best.samples.mag, own.samples.mag)
    return answer


def _errors(study: CompassStudy) -> tuple[float, float]:
    """RMS of the heading error in deg as logged, and with the offset of the flight taken away."""
    samples = study.samples
    q, field = samples.q[samples.air], samples.measured[samples.air]
    logged, fitted = (heading_error(q, field - o, samples.earth) for o in (np.zeros(3), study.air.offset))
    return rms_deg(logged), rms_deg(fitted)


def _line(study: CompassStudy, logged: float, fitted: float) -> str:
    samples = study.samples
    size = float(np.median(np.linalg.norm(samples.measured[samples.air] - study.air.offset, axis=1)))
    earth = float(np.linalg.norm(samples.earth))
    return (
        f"{samples.source}: heading error {logged:.1f} deg, {fitted:.1f} deg without its offset of "
        f"{study.air.size:.1f} uT; then {size:.1f} of {earth:.1f} uT, residual {study.air.left_ut:.1f} uT."
    )


def _by_size(case: HealthCase, used: Mag, others: Sequence[Mag]) -> list[Assessment]:
    """The size of the fields against the earth's, which needs no attitude."""
    model = declination.model(case.log)
    if model is None or case.segments is None:
        return []
    earth, spans = 1e6 * model.strength_t, air_spans(case.segments)
    own_size, own_spread = _size(used, spans)
    seen = [(mag, *_size(mag, spans)) for mag in others]
    sound = [(m, size) for m, size, s in seen if abs(size / earth - 1.0) <= CLOSE and s <= STEADY]
    if not np.isfinite(own_size):
        return []
    better = bool(sound) and abs(own_size / earth - 1.0) > OFF
    other, size = sound[0] if sound else (seen[0][0], seen[0][1])
    text = f"{used.field.source}, in use, reads {own_size:.1f} uT of {earth:.1f}, {other.field.source} {size:.1f} uT."
    shown = [
        f"{m.field.source} reads {s:.1f} uT, varying by {100 * v:.0f} %; the earth has {earth:.1f} uT."
        for m, s, v in ((used, own_size, own_spread), *seen)
    ]
    source = used.field.source
    answer = Assessment(source, CHOICE, "warning" if better else "ok", text, threshold=LIMIT, evidence=shown)
    if better:
        _offer(case.log, answer, other, used)
    return [answer]


def _size(mag: Mag, spans: list[tuple[float, float]]) -> tuple[float, float]:
    """Median size of a field in the air, uT, and its standard deviation as a share of it."""
    norm: Array = 1e6 * np.linalg.norm(mag.field.x[inside(mag.field.t_best, spans)], axis=1)
    norm = norm[np.isfinite(norm)]
    if not len(norm):
        return float("nan"), float("nan")
    size = float(np.median(norm))
    return size, float(np.std(norm)) / max(size, 1e-9)


def _offer(log: FlightLog, answer: Assessment, other: Mag, used: Mag) -> None:
    """Adds the switches of both compasses where the log holds them, else words."""
    answer.action = f"Use {other.field.source} instead of {used.field.source}."
    if not calibrated(other):
        answer.why_no_setting = f"{other.field.source} was never calibrated: calibrate it first."
        answer.action = f"Calibrate {other.field.source} and use it instead of {used.field.source}."
        return
    answer.settings = [Setting(name, log.param(name), new) for name, new in switching(log, other, used).items()]
    if not answer.settings:
        how = f"set {log.compass_first} to {other.index}" if log.compass_first else "give that one a higher priority"
        answer.why_no_setting = f"The log holds no parameter that switches a compass: {how}."
        return
    changes = " and ".join(f"{setting.name} {setting.new:.0f}" for setting in answer.settings)
    answer.action = f"{answer.action[:-1]}: set {changes}."
