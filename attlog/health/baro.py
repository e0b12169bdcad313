"""Barometer noise in flight against what the onboard estimator expects.

Noise is computed from second differences, which are insensitive to a steady climb. It is 0.1 to 0.3 m in still air and
metres near rotors or in wind. GNSS height drifts by metres itself and is only supporting evidence.
"""

from __future__ import annotations

import numpy as np

from attlog.core.sorting import median, quantile
from attlog.core.spans import Span, inside
from attlog.flight import aiding as parameters
from attlog.flight.model import FIX_3D, Array, FlightLog, Stream
from attlog.health.check import Check, HealthCase
from attlog.health.flown import driven_spans, held_seconds
from attlog.health.regression import median_interval

# Minimum samples for a median with interval: 5 s at 10 Hz.
MIN_SAMPLES = 50
# Limit where the estimator's noise parameter is not logged; 26 of 28 real barometers are below 0.7 m.
USUAL_NOISE_M = 1.0
SOURCE = "the noise parameter of the estimator, else 28 real flights"
# Median of |second differences| of white noise, relative to its standard deviation.
SECOND_DIFFERENCE_MEDIAN = 0.6745 * np.sqrt(6.0)


def barometer_noise(case: HealthCase) -> list[Check]:
    """Check the noise of each barometer in flight; nothing where nothing flew."""
    flown = driven_spans(case)
    found = [_noise_check(case.log, one, flown) for one in case.log.baro]
    return [one for one in found if one is not None]


def _noise_check(log: FlightLog, baro: Stream, flown: list[Span]) -> Check | None:
    use = inside(baro.t, flown) & np.isfinite(baro.x[:, 0])
    t, x = without_repeats(baro.t[use], baro.x[use, 0])
    if len(t) < MIN_SAMPLES:
        return None
    size, interval = white_noise(t, x)
    tested = next((test.source for test in log.estimator.innovation_tests if test.aid == "height"), "")
    expected = parameters.noise_parameter(log, "height", tested)
    limit = USUAL_NOISE_M if expected is None else expected.old
    words = "" if expected is None else f"; {expected.name} expects {expected.old:g} m"
    text = f"{baro.source} scatters by {size:.2f} m from sample to sample in flight{words}."
    noisy = size > limit
    check = Check("barometer_noise", "warning" if noisy else "ok", text, round(size, 3), "m", f"ok up to {limit:g} m")
    check.sensor, check.source = baro.source, SOURCE
    check.n, check.seconds = len(t), round(float(held_seconds(t).sum()), 1)
    check.ci95 = (round(interval[0], 3), round(interval[1], 3))
    check.why_no_setting = "Shield it from wind and rotors by foam, and fly again." if noisy else ""
    stray = _gnss_difference_m(log, t, x, flown)
    if stray is not None:
        check.evidence = [f"Its height and that of GNSS move {stray:.1f} m against each other in flight (90 %)."]
    return check


def without_repeats(t: Array, x: Array) -> tuple[Array, Array]:
    """Drop samples equal to their predecessor, from loggers faster than the sensor."""
    new = np.flatnonzero(np.diff(x, prepend=np.nan) != 0.0)
    return t[new], x[new]


def white_noise(t: Array, x: Array) -> tuple[float, tuple[float, float]]:
    """Return the white-noise standard deviation of ``x`` (n,) and its 95 % interval."""
    second = np.abs(x[2:] - 2.0 * x[1:-1] + x[:-2]) / SECOND_DIFFERENCE_MEDIAN
    return float(median(second)), median_interval(t[1:-1], second)


def _gnss_difference_m(log: FlightLog, t: Array, x: Array, flown: list[Span]) -> float | None:
    """Return the 5th to 95th percentile range in m of barometer minus GNSS height."""
    receiver = next((g for g in log.gnss if (g.fix >= FIX_3D).any()), None)
    if receiver is None:
        return None
    use = inside(receiver.t, flown) & (receiver.fix >= FIX_3D) & np.isfinite(receiver.alt)
    if use.sum() < MIN_SAMPLES:
        return None
    apart = np.interp(receiver.t[use], t, x) - receiver.alt[use]
    low, high = quantile(apart, [0.05, 0.95])
    return float(high - low)
