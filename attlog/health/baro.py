"""How noisy is the barometer in flight, and does the onboard estimator expect that much? How far is it from GNSS?

The noise is that of second differences, which a steady climb does not reach. A barometer near rotors or in the wind
shows metres; in still air 0.1 to 0.3 m. Height by GNSS strays by metres itself: it is told beside, and judges nothing.
"""

from __future__ import annotations

import numpy as np

from attlog.core.spans import Span, inside
from attlog.flight import aiding as parameters
from attlog.flight.model import Array, FlightLog, Stream
from attlog.health import delays
from attlog.health.check import Check, HealthCase

BARO_QUESTION = "barometer_noise"
MIN_BARO_SAMPLES = 50
USUAL_NOISE_M = 1.0
"""The limit where the log does not hold what the estimator expects; 26 of 28 real barometers are below 0.7 m."""
FIX_3D = 3
BARO_SOURCE = "the noise parameter of the estimator, else 28 real flights"


def barometer_noise(case: HealthCase) -> list[Check]:
    """The noise of each barometer in flight; nothing where nothing flew."""
    flown = delays.flight_spans(case)
    found = [_noise_assessment(case.log, one, flown) for one in case.log.baro]
    return [one for one in found if one is not None]


def _noise_assessment(log: FlightLog, baro: Stream, flown: list[Span]) -> Check | None:
    use = inside(baro.t, flown) & np.isfinite(baro.x[:, 0])
    t, x = without_repeats(baro.t[use], baro.x[use, 0])
    if len(t) < MIN_BARO_SAMPLES:
        return None
    size, interval = white_noise(t, x)
    tested = next((test.source for test in log.estimator.innovation_tests if test.aid == "height"), "")
    expected = parameters.noise_parameter(log, "height", tested)
    limit = USUAL_NOISE_M if expected is None else expected.old
    told = Check(
        BARO_QUESTION, "ok", "", sensor=baro.source, value=round(size, 3), unit="m", threshold=f"ok up to {limit:g} m"
    )
    told.source, told.n, told.seconds = BARO_SOURCE, len(t), round(float(delays.held_seconds(t).sum()), 1)
    told.ci95 = (round(interval[0], 3), round(interval[1], 3))
    words = "" if expected is None else f"; {expected.name} expects {expected.old:g} m"
    told.text = f"{baro.source} scatters by {size:.2f} m from sample to sample in flight{words}."
    if size > limit:
        told.verdict = "warning"
        told.why_no_setting = "Shield it from wind and rotors by foam, and fly again."
    stray = _gnss_difference_m(log, t, x, flown)
    if stray is not None:
        told.evidence = [f"Its height and that of GNSS move {stray:.1f} m against each other in flight (90 %)."]
    return told


def without_repeats(t: Array, x: Array) -> tuple[Array, Array]:
    """Samples (n,) without those that repeat the one before: some loggers are faster than the sensor."""
    new = np.flatnonzero(np.diff(x, prepend=np.nan) != 0.0)
    return t[new], x[new]


def white_noise(t: Array, x: Array) -> tuple[float, tuple[float, float]]:
    """Standard deviation of the white part of ``x`` (n,) at ``t`` (n,) s, and its 95 % interval."""
    second = np.abs(x[2:] - 2.0 * x[1:-1] + x[:-2]) / (0.6745 * np.sqrt(6.0))
    return float(np.median(second)), delays.median_interval(t[1:-1], second)


def _gnss_difference_m(log: FlightLog, t: Array, x: Array, flown: list[Span]) -> float | None:
    """How far both heights move against each other in flight, m: from the 5th to the 95th percentile."""
    receiver = next((g for g in log.gnss if (g.fix >= FIX_3D).any()), None)
    if receiver is None:
        return None
    use = inside(receiver.t, flown) & (receiver.fix >= FIX_3D) & np.isfinite(receiver.alt)
    if use.sum() < MIN_BARO_SAMPLES:
        return None
    apart = np.interp(receiver.t[use], t, x) - receiver.alt[use]
    low, high = np.percentile(apart, [5.0, 95.0])
    return float(high - low)
