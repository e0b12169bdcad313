"""Gyro bias and size of gravity against temperature, at rest.

Block medians are averaged over bins of 1 K, so that each temperature has equal weight, and a line is fitted to the
bins. The gyro uses all rests; the size of gravity only the rest with the widest span, because another place may be less
level.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from attlog.core.spans import Span, inside
from attlog.flight.model import Array, Imu, Stream
from attlog.health.check import Check, HealthCase, graded, unknown
from attlog.health.flown import still_spans
from attlog.health.gravity import force_size
from attlog.health.imu import finite_samples, stream_blocks, usable_imus
from attlog.health.regression import interval_text

# Minimum temperature span for a slope.
SPAN_K, BIN_K, MIN_BINS = 5.0, 1.0, 4
# Significance: 4 sigma of 1.5 standard errors, because neighbouring bins are correlated.
SLOPE_SIGMAS, STANDARD_ERRORS = 4.0, 1.5
SOURCE = "limits of a bias at rest; the span is what the log holds at rest"
COLD_START_ADVICE = "Log from a cold start for ten minutes, standing still."


@dataclass(frozen=True, slots=True)
class SlopeLimits:
    """Limits of the change over the temperature span, equal to those at rest.

    ``factor``: conversion from the stream's unit to ``unit``.
    """

    question: str
    unit: str
    factor: float
    off: float
    far: float

    @property
    def text(self) -> str:
        """The limits in words."""
        return f"ok up to {self.off:g} {self.unit} over the span, fault above {self.far:.0f}"


GYRO = SlopeLimits("gyro_temperature", "deg/s", float(np.degrees(1.0)), 1.0, 3.0)
ACC = SlopeLimits("accelerometer_temperature", "m/s^2", 1.0, 0.3, 1.0)


@dataclass(frozen=True, slots=True)
class TemperatureSlope:
    """Line through bins of 1 K: ``slope`` per kelvin with its ``sigma`` (k,), from ``low`` to ``high`` degC."""

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


def temperature_checks(case: HealthCase, limits: SlopeLimits) -> list[Check]:
    """Check the temperature slope of each IMU; one ``unknown`` where none is known."""
    units = usable_imus(case)
    if not units:
        return []
    spans = still_spans(case.segments)[0]
    found, widest = [], 0.0
    for imu in units:
        near = spans if limits is GYRO or not spans else [max(spans, key=lambda span: _reach_k(imu, [span]))]
        widest = max(widest, _reach_k(imu, near))
        line = fit_temperature(imu.gyro if limits is GYRO else force_size(imu.acc), imu.temperature, near)
        if line is not None:
            found.append(_slope_check(case, imu, limits, line))
    if found:
        return found
    why = f"At rest the temperature spans {widest:.1f} K; {SPAN_K:.0f} are needed, seen at several temperatures."
    if all(imu.temperature is None for imu in units):
        why = "The log holds no temperature of its inertial units."
    elif not spans:
        why = "The vehicle never stands still on the ground in this log."
    one = unknown(limits.question, why, limits.text, sensor=units[0].gyro.source, source=SOURCE)
    one.action = COLD_START_ADVICE
    return [one]


gyro_temperature = partial(temperature_checks, limits=GYRO)
accelerometer_temperature = partial(temperature_checks, limits=ACC)


def fit_temperature(stream: Stream, temperature: Stream | None, spans: list[Span]) -> TemperatureSlope | None:
    """Fit a line over temperature to a stream at rest; None below 5 K or 4 bins."""
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
    if len(numbers) < MIN_BINS or np.ptp(warm) < SPAN_K:
        return None
    mean = np.array([np.median(values.x[bins == k], axis=0) for k in numbers])
    around = warm - warm.mean()
    line = around @ (mean - mean.mean(axis=0)) / (around @ around)
    left = mean - mean.mean(axis=0) - np.outer(around, line)
    scatter = np.sqrt(np.sum(left**2, axis=0) / (len(numbers) - 2))
    sigma = STANDARD_ERRORS * scatter / np.sqrt(around @ around)
    return TemperatureSlope(line, sigma, float(warm.min()), float(warm.max()), values.samples, values.seconds)


def _reach_k(imu: Imu, spans: list[Span]) -> float:
    """Return the temperature range in K within spans."""
    if imu.temperature is None or not spans:
        return 0.0
    celsius = imu.temperature.x[inside(imu.temperature.t, spans), 0]
    celsius = celsius[np.isfinite(celsius)]
    return float(np.ptp(celsius)) if len(celsius) else 0.0


def _slope_check(case: HealthCase, imu: Imu, limits: SlopeLimits, line: TemperatureSlope) -> Check:
    each, sigma = limits.factor * line.slope, limits.factor * line.sigma
    worst = int(np.argmax(np.abs(each)))
    size, unsure = float(each[worst]), float(sigma[worst])
    significant = abs(size) > SLOPE_SIGMAS * unsure
    verdict = graded(line.span * abs(size), limits.off, limits.far) if significant else "ok"
    source, about = (imu.gyro.source, f" about {'xyz'[worst]}") if limits is GYRO else (imu.acc.source, "")
    text = f"{source} changes by {size:+.3f} {limits.unit} per K{about} ({interval_text(size, unsure, 3)}, 95 %), "
    text += f"{line.low:.0f} to {line.high:.0f} degC."
    check = Check(limits.question, verdict, text, unit=f"{limits.unit}/K", threshold=limits.text, sensor=source)
    check.n, check.seconds, check.source = line.samples, round(line.seconds, 1), SOURCE
    check.measure(size, unsure, 4)
    if limits is GYRO:
        check.measure_axes(each, sigma, 4)
    if verdict != "ok":
        check.why_no_setting = "A calibration over temperature measures it, a flight does not."
        check.action = case.log.remedy("temperature")
    return check
