"""Faults of control in flight: body rates that do not follow their set-point, and oscillation.

A pilot moves below 4.5 Hz, and above 20 Hz it is vibration. Limits are from docs/story.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median
from attlog.core.spans import Span, between, inside
from attlog.flight.model import FlightLog, Stream
from attlog.flight.vehicle import VehicleKind
from attlog.segments.flight_signs import true_runs
from attlog.segments.model import Segments
from attlog.story.motor_faults import MARGIN_S, DriveFault, DriveStudy, Motion, first_loss, flown_spans

Array = NDArray[np.float64]

AXES = ("Roll", "Pitch", "Yaw")
KINDS = (VehicleKind.MULTIROTOR, VehicleKind.PLANE, VehicleKind.VTOL)
# Length of a window, least rate of the gyro in Hz, and time before a crash that does not count.
WINDOW_S, MIN_GYRO_HZ, CLEAR_S = 4.0, 20.0, 2.0
GAINS_CAUSE = "Wrong rate-controller gains, a slow filter, or a weak or loose actuator."

# --- following the rate set-point --------------------------------------------------------------------------------

# Least rate and standard deviation of the set-point: below 15 deg/s noise decides.
MIN_SETPOINT_HZ, MIN_SPREAD_DPS, MIN_WINDOWS = 8.0, 15.0, 3
LAGS_S = np.arange(0.0, 0.41, 0.02)
MIN_CORRELATION, SLOPES, MAX_LAG_S = 0.65, (0.4, 1.6), 0.2


class Tracking(NamedTuple):
    """Medians over ``windows`` of an axis: correlation, slope and lag (s) of the rate against its set-point.

    ``t``, ``t_end`` s: first and last window.
    """

    axis: int
    correlation: float
    slope: float
    lag: float
    windows: int
    t: float
    t_end: float

    @property
    def is_poor(self) -> bool:
        """True if the rate does not follow."""
        followed = self.correlation >= MIN_CORRELATION and SLOPES[0] <= self.slope <= SLOPES[1]
        return not followed or self.lag >= MAX_LAG_S

    @property
    def verb(self) -> str:
        """What the rate does with its set-point."""
        if self.correlation < MIN_CORRELATION:
            return "does not follow"
        if self.slope > SLOPES[1]:
            return "overshoots"
        return "falls short of" if self.slope < SLOPES[0] else "lags" if self.is_poor else "follows"

    @property
    def text(self) -> str:
        """The numbers as a clause."""
        numbers = f"gain {100.0 * self.slope:.0f} %, lag {1000.0 * self.lag:.0f} ms"
        return f"{numbers}, correlation {self.correlation:.2f} ({self.windows} windows of 4 s)"


def rate_tracking(motion: Motion, setpoint: Stream, spans: Sequence[Span]) -> list[Tracking]:
    """Return how roll and pitch rates follow their set-point, for each axis with enough windows of movement."""
    t, rate = motion.rates
    found = []
    for axis in (0, 1):
        wanted = np.degrees(setpoint.x[:, axis])
        rows = []
        for a, b in windows(spans, WINDOW_S):
            part = between(setpoint.t, a, b - LAGS_S[-1])
            at, x = setpoint.t[part], wanted[part]
            good = np.isfinite(x)
            if np.count_nonzero(good) < MIN_SETPOINT_HZ * (b - a - LAGS_S[-1]) or np.std(x[good]) < MIN_SPREAD_DPS:
                continue
            near = between(t, a - 0.1, b + 0.1)
            if np.diff(t[near], prepend=a, append=b).max() > 2.0 / MIN_GYRO_HZ + 0.1:
                continue
            rows.append((*_best_lag(at[good], x[good], t[near], rate[near, axis]), a, b))
        if len(rows) >= MIN_WINDOWS:
            r, slope, lag = median([row[:3] for row in rows], axis=0).tolist()
            found.append(Tracking(axis, r, slope, lag, len(rows), rows[0][3], rows[-1][4]))
    return found


def _best_lag(at: Array, wanted: Array, t: Array, rate: Array) -> tuple[float, float, float]:
    """Return correlation, slope and lag in s at which a rate follows its set-point (n,) at times ``at`` best."""
    late = np.interp(at[None, :] + LAGS_S[:, None], t, rate)
    late = late - late.mean(axis=1, keepdims=True)
    wanted = wanted - wanted.mean()
    product, size = late @ wanted, float(wanted @ wanted)
    correlation = product / np.maximum(np.sqrt(np.sum(late**2, axis=1) * size), 1e-12)
    best = int(np.argmax(correlation))
    return float(correlation[best]), float(product[best] / size), float(LAGS_S[best])


def windows(spans: Sequence[Span], seconds: float, step: float | None = None) -> Iterator[Span]:
    """Yield windows of a length in s within spans, ``step`` s apart (default: adjacent)."""
    step = seconds if step is None else step
    for a, b in spans:
        for k in range(int((b - a - seconds) / step + 1e-9) + 1 if b - a >= seconds else 0):
            yield a + k * step, a + k * step + seconds


# --- oscillation -------------------------------------------------------------------------------------------------

# Band in Hz, up to a share of the sampling rate; the rate to which fast gyros are averaged.
BAND_HZ, MAX_OF_RATE, AVERAGED_HZ = (4.5, 20.0), 0.42, 100.0
# Half width of a peak in bins, its least amplitude, and its least share of the band and of all movement.
PEAK_BINS, MIN_AMPLITUDE_DPS, MIN_BAND_SHARE, MIN_ALL_SHARE = 2, 8.0, 0.6, 0.3
# Windows in a row, half overlapped, with frequencies within this share, and the time that they take.
IN_A_ROW, SAME_FREQUENCY = 4, 0.15
IN_A_ROW_S = 0.5 * WINDOW_S * (IN_A_ROW + 1)
# A pause of the gyro: an interval above so many sampling intervals.
MAX_PAUSE_STEPS = 5.0
# Below this rate of the gyro a frequency may be an alias: the autopilots' low-pass (20 Hz and more) passes its mirror.
ALIAS_HZ = 50.0


class Oscillation(NamedTuple):
    """Oscillation of an axis: ``hz``, amplitude ``dps`` (medians), ``share`` of the flight; first from t to t_end."""

    axis: int
    hz: float
    dps: float
    share: float
    t: float
    t_end: float


def oscillations(motion: Motion, spans: Sequence[Span]) -> list[Oscillation]:
    """Return the oscillation of each axis that lasts for 10 s, strongest first."""
    t, rate = motion.rates
    peaks = [_peaks(t, rate, a, b) for a, b in spans if b - a >= WINDOW_S]
    if not peaks:
        return []
    starts = np.concatenate([p[0] for p in peaks])
    flight = np.concatenate([np.full(len(p[0]), k) for k, p in enumerate(peaks)])
    hz, dps = (np.concatenate([p[k] for p in peaks]) for k in (1, 2))
    found = []
    for axis in range(3):
        runs = list(_steady_runs(hz[:, axis], flight))
        if runs:
            rows = np.concatenate([np.arange(a, b) for a, b in runs])
            first = runs[0]
            found.append(
                Oscillation(
                    axis,
                    float(median(hz[rows, axis])),
                    float(median(dps[rows, axis])),
                    len(rows) / len(starts),
                    float(starts[first[0]]),
                    float(starts[first[1] - 1] + WINDOW_S),
                )
            )
    return sorted(found, key=lambda one: -one.dps)


def _steady_runs(hz: Array, flight: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Return index ranges of at least four windows in a row with nearly the same frequency (NaN without a peak)."""
    for a, b in true_runs(np.isfinite(hz)):
        edges = np.flatnonzero(
            (np.abs(np.diff(hz[a:b])) > SAME_FREQUENCY * hz[a : b - 1]) | (np.diff(flight[a:b]) != 0)
        )
        bounds = [a, *(a + 1 + edges).tolist(), b]
        yield from ((i, j) for i, j in pairwise(bounds) if j - i >= IN_A_ROW)


def _peaks(t: Array, rate: Array, a: float, b: float) -> tuple[Array, Array, Array]:
    """Return begins (n,) of windows in [a, b] s, frequency (n, 3) Hz and amplitude (n, 3) deg/s of their peak.

    NaN where a window has no single peak or the gyro pauses.
    """
    part = between(t, a, b)
    at, x = t[part], rate[part]
    starts = np.array([w for w, _ in windows([(a, b)], WINDOW_S, 0.5 * WINDOW_S)])
    none = np.full((len(starts), 3), np.nan)
    if len(at) < 2 or not len(starts):
        return starts, none, none
    step = float(median(np.diff(at)))
    if 1.0 / step < MIN_GYRO_HZ:
        return starts, none, none
    times = np.arange(a, b, step)
    even = np.column_stack([np.interp(times, at, column) for column in x.T])
    edges = np.concatenate([[a], at, [b]])
    paused = np.diff(edges) > MAX_PAUSE_STEPS * step
    pauses = np.column_stack([edges[:-1][paused], edges[1:][paused]])
    every = max(int(1.0 / step / AVERAGED_HZ), 1)
    n = len(even) // every
    mean = even[: n * every].reshape(n, every, 3).mean(axis=1)
    size = round(WINDOW_S / (step * every))
    first = np.round((starts - a) / (step * every)).astype(np.int64)
    first = np.clip(first, 0, max(n - size, 0))
    if n < size:
        return starts, none, none
    blocks = np.lib.stride_tricks.sliding_window_view(mean, size, axis=0)[first]
    squares = np.concatenate([np.zeros((1, 3)), np.cumsum((even - even.mean(axis=0)) ** 2, axis=0)])
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(even - even.mean(axis=0), axis=0)])
    i, j = first * every, (first + size) * every
    whole = (squares[j] - squares[i]) / (size * every) - ((sums[j] - sums[i]) / (size * every)) ** 2
    hz, dps = _window_peaks(blocks, step * every, whole)
    broken = np.array([bool(np.any((pauses[:, 0] < w + WINDOW_S) & (pauses[:, 1] > w))) for w in starts])
    hz[broken] = np.nan
    return starts, hz, dps


def _window_peaks(blocks: Array, step: float, whole: Array) -> tuple[Array, Array]:
    """Return frequency and amplitude (n, 3) of the single peak of windows (n, 3, size) with variance ``whole``."""
    size = blocks.shape[-1]
    hann = np.hanning(size)
    spectrum = np.abs(np.fft.rfft((blocks - blocks.mean(axis=-1, keepdims=True)) * hann, axis=-1)) ** 2
    power = 2.0 * spectrum / (size * float(np.sum(hann**2)))  # its sum is the variance
    hz = np.fft.rfftfreq(size, step)
    low = int(np.searchsorted(hz, BAND_HZ[0]))
    high = int(np.searchsorted(hz, min(BAND_HZ[1], MAX_OF_RATE / step), side="right"))
    if high - low < 2 * PEAK_BINS:
        return np.full(whole.shape, np.nan), np.full(whole.shape, np.nan)
    k = low + np.argmax(power[..., low:high], axis=-1)
    cumulated = np.concatenate([np.zeros((*power.shape[:2], 1)), np.cumsum(power, axis=-1)], axis=-1)

    def summed(first: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
        upper = np.take_along_axis(cumulated, np.minimum(last, power.shape[-1])[..., None], -1)
        found: Array = (upper - np.take_along_axis(cumulated, first[..., None], -1))[..., 0]
        return found

    peak = summed(k - PEAK_BINS, k + PEAK_BINS + 1)
    band = cumulated[..., high] - cumulated[..., low]
    at = np.take_along_axis(power, k[..., None], -1)[..., 0]
    below = np.take_along_axis(power, k[..., None] - 1, -1)[..., 0]
    above = np.take_along_axis(power, np.minimum(k[..., None] + 1, power.shape[-1] - 1), -1)[..., 0]
    amplitude = np.sqrt(2.0 * peak)
    good = (amplitude >= MIN_AMPLITUDE_DPS) & (peak >= MIN_BAND_SHARE * band) & (peak >= MIN_ALL_SHARE * whole)
    good &= (at > below) & (at > above)
    near = np.clip(k[..., None] + np.arange(-PEAK_BINS, PEAK_BINS + 1), 0, power.shape[-1] - 1)
    weight = np.take_along_axis(power, near, -1)
    middle = np.sum(weight * hz[near], axis=-1) / np.maximum(weight.sum(axis=-1), 1e-30)  # finer than the bins
    return np.where(good, middle, np.nan), np.where(good, amplitude, np.nan)


# --- all ---------------------------------------------------------------------------------------------------------

QUESTIONS = ("rate_tracking", "oscillation")
NO_SETPOINT = "No rate set-point is logged at 8 Hz or more (ArduPilot RATE, PX4 vehicle_rates_setpoint)."
LITTLE_MOVED = "The set-point moves too little: three windows of 4 s with 15 deg/s (standard deviation) are needed."
ALIAS_ACTION = "Log the gyro at 50 Hz or more, fly again, and then lower the rate gains if the frequency stays."
SHORT_FLIGHT = f"{IN_A_ROW_S:.0f} s in the air are needed."
NO_FAST_GYRO = "No gyro is logged at 20 Hz or more."


@cached_per_log
def study_control(log: FlightLog, segments: Segments) -> DriveStudy:
    """Return how rates follow their set-point and whether they oscillate, in the flights of a multirotor or wing."""
    if log.kind not in KINDS or "airborne" in segments.unknown:
        return DriveStudy()
    end = first_loss(segments) - CLEAR_S
    spans = [(a, min(b, end)) for a, b in flown_spans(segments, MARGIN_S) if min(b, end) - a >= WINDOW_S]
    if not spans:
        return DriveStudy()
    study, motion = DriveStudy(), Motion(log)
    if motion.rate_hz < MIN_GYRO_HZ:
        study.missing.update(dict.fromkeys(QUESTIONS, NO_FAST_GYRO))
        return study
    if max(b - a for a, b in spans) < IN_A_ROW_S:
        study.missing["oscillation"] = SHORT_FLIGHT
    else:
        found = oscillations(motion, spans)
        study.faults["oscillation"] = [oscillation_fault(one, motion.rate_hz) for one in found]
        top = min(BAND_HZ[1], MAX_OF_RATE * motion.rate_hz)
        study.numbers["oscillation"] = f"No axis oscillated between {BAND_HZ[0]:g} and {top:.3g} Hz."
    setpoint = log.setpoints.rates
    if any(problem.code == "imu_decimated" for problem in log.problems):
        study.missing["rate_tracking"] = "The logger left out gyro samples, so the delay of the gyro is unknown."
    elif setpoint is None or np.count_nonzero(inside(setpoint.t, spans)) < MIN_SETPOINT_HZ * WINDOW_S:
        study.missing["rate_tracking"] = NO_SETPOINT
    else:
        followed = rate_tracking(motion, setpoint, spans)
        if not followed:
            study.missing["rate_tracking"] = f"{LITTLE_MOVED} Fly quick roll and pitch steps."
        else:
            study.faults["rate_tracking"] = [tracking_fault(one) for one in followed if one.is_poor]
            study.numbers["rate_tracking"] = "; ".join(f"{AXES[one.axis]}: {one.text}" for one in followed) + "."
    return study


def tracking_fault(one: Tracking) -> DriveFault:
    """Convert poor tracking of an axis to a fault."""
    text = f"{AXES[one.axis]} rate {one.verb} its set-point: {one.text}."
    part, value = "control", round(one.correlation, 2)
    evidence = ["gyro against the rate set-point"]
    return DriveFault("rate_tracking", part, one.t, one.t_end, text, value, "", cause=GAINS_CAUSE, evidence=evidence)


def oscillation_fault(one: Oscillation, rate_hz: float) -> DriveFault:
    """Convert an oscillation to a fault; below 50 Hz of the gyro with the frequency that has the same samples."""
    alias = rate_hz < ALIAS_HZ
    which = f"{one.hz:.1f} Hz or {rate_hz - one.hz:.1f}" if alias else f"{one.hz:.1f}"
    text = f"{AXES[one.axis]} oscillated at {which} Hz from {one.t:.1f} s: amplitude {one.dps:.0f}°/s, "
    text += f"{100.0 * one.share:.0f} % of the flight."
    cause = "Gains too high, a filter too slow, or a loose part."
    evidence = [f"gyro at {rate_hz:.0f} Hz"]
    if alias:
        cause += " Or vibration: at this rate of the gyro its alias looks the same."
        evidence = [f"gyro at {rate_hz:.0f} Hz, which cannot separate {which} Hz"]
    value, action = round(one.dps, 1), ALIAS_ACTION if alias else ""
    return DriveFault(
        "oscillation", "control", one.t, one.t_end, text, value, "°/s", cause=cause, action=action, evidence=evidence
    )
