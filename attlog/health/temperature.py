"""Do gyro and accelerometer follow their temperature, and does the firmware calibrate for that?

At rest only, where nothing else changes them: block medians, averaged over bins of 1 K so that time spent at one
temperature counts once, and a line through the bins. The gyro over every rest; the accelerometer's size over the one
with the widest span, since another place may be less level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.core import rotation
from attlog.core.spans import Span
from attlog.flight.model import Array, Imu, Stream
from attlog.health.check import Check, HealthCase, graded, unknown
from attlog.health.imu import finite_samples, still_spans, stream_blocks, usable_imus

GYRO_QUESTION, ACC_QUESTION = "gyro_temperature", "accelerometer_temperature"
SPAN_K, BIN_K, LEAST_BINS = 5.0, 1.0, 4
"""A slope over less than 5 K is noise and warm-up of the first seconds."""
SLOPE_SIGMAS = 4.0
STANDARD_ERROR_FACTOR = 1.5
OFF_DPS, FAR_DPS = 1.0, 3.0
OFF_M_S2, FAR_M_S2 = 0.3, 1.0
"""Over the span that was seen: the limits of a bias and of gravity's size."""
GYRO_LIMIT = f"ok up to {OFF_DPS:.0f} deg/s over the span, fault above {FAR_DPS:.0f}"
ACC_LIMIT = f"ok up to {OFF_M_S2} m/s^2 over the span, fault above {FAR_M_S2:.0f}"
SOURCE = "limits of a bias at rest; the span is what the log holds at rest"
COLD_START_ADVICE = "Log from a cold start for ten minutes, standing still."


@dataclass(frozen=True, slots=True)
class TemperatureSlope:
    """A line through bins of 1 K: ``slope`` per kelvin with one ``sigma`` (k,), from ``low`` to ``high`` degC."""

    slope: Array
    sigma: Array
    low: float
    high: float
    samples: int
    seconds: float

    @property
    def span(self) -> float:
        """Kelvin from the coldest bin to the warmest."""
        return self.high - self.low


def gyro_temperature(case: HealthCase) -> list[Check]:
    """Slope of the bias of each gyro by its temperature; one ``unknown`` where none is known."""
    return _temperature_assessments(case, GYRO_QUESTION)


def accelerometer_temperature(case: HealthCase) -> list[Check]:
    """Slope of the size of gravity by temperature of each accelerometer; one ``unknown`` where none is known."""
    return _temperature_assessments(case, ACC_QUESTION)


def _temperature_assessments(case: HealthCase, question: str) -> list[Check]:
    units = usable_imus(case)
    if not units:
        return []
    spans = still_spans(case.segments)[0]
    found = []
    widest = 0.0
    for imu in units:
        near, reach = _temperature_span(imu, spans if question == GYRO_QUESTION else _widest_rest(imu, spans))
        widest = max(widest, reach)
        line = fit_temperature(imu.gyro if question == GYRO_QUESTION else _force_norm(imu.acc), imu.temperature, near)
        if line is not None:
            found.append(_slope_assessment(case, imu, question, line))
    if found:
        return found
    why = f"At rest the temperature spans {widest:.1f} K; {SPAN_K:.0f} are needed, seen at several temperatures."
    if all(imu.temperature is None for imu in units):
        why = "The log holds no temperature of its inertial units."
    elif not spans:
        why = "The vehicle never stands still on the ground in this log."
    limit = GYRO_LIMIT if question == GYRO_QUESTION else ACC_LIMIT
    one = unknown(question, why, limit, sensor=units[0].gyro.source, source=SOURCE)
    one.action = COLD_START_ADVICE
    return [one]


def fit_temperature(stream: Stream, temperature: Stream | None, spans: list[Span]) -> TemperatureSlope | None:
    """How a stream at rest follows temperature, in its own unit per kelvin; None below 5 K or 4 bins."""
    values = stream_blocks(stream, spans)
    if temperature is None or values is None:
        return None
    t, celsius = finite_samples(temperature, spans)
    if len(t) < 2:
        return None
    at = np.interp(values.t, t, celsius[:, 0])
    bins = np.floor(at / BIN_K)
    numbers = np.unique(bins)
    warm = np.array([np.mean(at[bins == k]) for k in numbers])
    if len(numbers) < LEAST_BINS or np.ptp(warm) < SPAN_K:
        return None
    mean = np.array([np.median(values.x[bins == k], axis=0) for k in numbers])
    around = warm - warm.mean()
    line = around @ (mean - mean.mean(axis=0)) / (around @ around)
    left = mean - mean.mean(axis=0) - np.outer(around, line)
    scatter = np.sqrt(np.sum(left**2, axis=0) / (len(numbers) - 2))
    sigma = STANDARD_ERROR_FACTOR * scatter / np.sqrt(around @ around)
    return TemperatureSlope(line, sigma, float(warm.min()), float(warm.max()), values.samples, values.seconds)


def _force_norm(acc: Stream) -> Stream:
    return Stream(acc.t, rotation.length(acc.x)[:, None], acc.unit, "", acc.source, t_sample=acc.t_sample)


def _temperature_span(imu: Imu, spans: list[Span]) -> tuple[list[Span], float]:
    """The spans, and how many kelvin they reach over."""
    if imu.temperature is None:
        return spans, 0.0
    t, celsius = imu.temperature.t, imu.temperature.x[:, 0]
    inside = np.concatenate([celsius[(t >= a) & (t <= b)] for a, b in spans]) if spans else celsius[:0]
    inside = inside[np.isfinite(inside)]
    return spans, float(np.ptp(inside)) if len(inside) else 0.0


def _widest_rest(imu: Imu, spans: list[Span]) -> list[Span]:
    """The one rest over which the temperature changes most."""
    return [max(spans, key=lambda span: _temperature_span(imu, [span])[1])] if spans else []


def _slope_assessment(case: HealthCase, imu: Imu, question: str, line: TemperatureSlope) -> Check:
    is_gyro = question == GYRO_QUESTION
    factor, unit = (float(np.degrees(1.0)), "deg/s") if is_gyro else (1.0, "m/s^2")
    ok, far = (OFF_DPS, FAR_DPS) if is_gyro else (OFF_M_S2, FAR_M_S2)
    each, sigma = factor * line.slope, factor * line.sigma
    worst = int(np.argmax(np.abs(each)))
    size, unsure = float(each[worst]), float(sigma[worst])
    sure = abs(size) > SLOPE_SIGMAS * unsure
    verdict = graded(line.span * abs(size), ok, far) if sure else "ok"
    source, about = (imu.gyro.source, f" about {'xyz'[worst]}") if is_gyro else (imu.acc.source, "")
    low, high = size - 1.96 * unsure, size + 1.96 * unsure
    text = f"{source} changes by {size:+.3f} {unit} per K{about} ({low:.3f} to {high:.3f}, 95 %), "
    text += f"{line.low:.0f} to {line.high:.0f} degC."
    return Check(
        question,
        verdict,
        text,
        sensor=source,
        value=round(size, 4),
        unit=f"{unit}/K",
        ci95=(round(low, 4), round(high, 4)),
        vector=[round(float(v), 4) for v in each] if is_gyro else [],
        vector_ci95=[round(1.96 * float(v), 4) for v in sigma] if is_gyro else [],
        n=line.samples,
        seconds=round(line.seconds, 1),
        threshold=GYRO_LIMIT if is_gyro else ACC_LIMIT,
        source=SOURCE,
        why_no_setting="A calibration over temperature measures it, a flight does not." if verdict != "ok" else "",
        action=case.log.remedy("temperature") if verdict != "ok" else "",
    )
