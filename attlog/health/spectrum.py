"""Power spectra of gyro and accelerometer in flight, window by window, from every source a log has."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core.spans import Span, inside
from attlog.flight.model import Burst, FlightLog, OnboardSpectrum, Stream
from attlog.segments import model

Array = NDArray[np.float64]

# Windows of a stream, and their segments' lengths, which overlap by half: 2 Hz at 2 s.
WINDOW_S, WINDOW_SEGMENTS = 2.0, 4
# Segments of a burst, which is 0.5 s long: 4 Hz.
BURST_SEGMENTS = 2
# Limits of a source, evenly spread over the flight: hours of it, or 8 kHz, cost no more.
MAX_WINDOWS, MAX_SAMPLES = 150, 200_000
# Rotors turn 30 to 250 times a second: a slower stream shows nothing of them but aliases of aliases.
MIN_RATE_HZ = 90.0
# A window holds no interval longer than 5 usual ones, and lacks at most a tenth of its samples: loggers drop single
# ones, which are interpolated.
GAP_STEPS, MAX_LOST_SHARE = 5.0, 0.1


@dataclass(frozen=True, slots=True)
class Spectra:
    """Spectra of one sensor in windows with their middle at ``t`` (w,) s over ``frequency`` (k,) Hz.

    ``density`` (w, k, 3) along body axes in (deg/s)^2/Hz or (m/s^2)^2/Hz. ``rate`` Hz of the source, ``seconds`` of a
    window; ``filtered``: behind low-pass and notches of the autopilot.
    """

    sensor: str
    unit: int
    source: str
    rate: float
    seconds: float
    filtered: bool
    t: Array
    frequency: Array
    density: Array

    @property
    def median(self) -> Array:
        """Density (k, 3) of the median window."""
        middle: Array = np.median(self.density, axis=0)
        return middle

    @property
    def total(self) -> Array:
        """Density (w, k) of all three axes."""
        whole: Array = self.density.sum(axis=2)
        return whole

    @property
    def step(self) -> float:
        """Distance in Hz of neighbouring frequencies."""
        return float(self.frequency[1])


def all_spectra(log: FlightLog, within: list[Span], sensor: str = "gyro") -> list[Spectra]:
    """Return the spectra of every unit's sources in spans, fast ones first."""
    found = []
    for unit in sorted({imu.index for imu in log.imus} | {b.unit for b in log.vibration.bursts}):
        raw = [b for b in log.vibration.bursts if (b.sensor, b.unit, b.filtered) == (sensor, unit, False)]
        one = burst_spectra(raw, within) if raw else None
        found += [] if one is None else [one]
        for imu in (i for i in log.imus if i.index == unit):
            stream = imu.gyro if sensor == "gyro" else imu.acc
            behind = imu.filtered not in ("none", "driver")
            one = stream_spectra(stream, within, sensor, unit, behind)
            found += [] if one is None else [one]
    return sorted(found, key=lambda s: (-s.rate, s.unit))


def stream_spectra(stream: Stream, within: list[Span], sensor: str, unit: int, filtered: bool) -> Spectra | None:
    """Return spectra of 2 s windows without gaps; None where the stream is too slow or no window is whole."""
    t = stream.t_best
    if len(t) < 8:
        return None
    number, dt = sample_numbers(t)
    rate = 1.0 / dt if dt > 0 else 0.0
    if rate < MIN_RATE_HZ:
        return None
    n = round(WINDOW_S * rate)
    starts = _whole_windows(t, number, within, dt, n)
    if len(starts) == 0:
        return None
    most = max(1, min(MAX_WINDOWS, MAX_SAMPLES // n))
    starts = starts[np.unique(np.linspace(0, len(starts) - 1, most).round().astype(int))]
    grid = starts[:, None] + np.arange(n)
    x = np.stack([np.interp(grid, number, stream.x[:, k]) for k in range(3)], axis=-1)
    good = np.isfinite(x).all(axis=(1, 2))
    if not good.any():
        return None
    frequency, density = welch(x[good], rate, n // WINDOW_SEGMENTS, sensor)
    middle = np.interp(starts[good] + 0.5 * n, number, t)
    return Spectra(sensor, unit, stream.source, rate, n * dt, filtered, middle, frequency, density)


def sample_numbers(t: Array) -> tuple[Array, float]:
    """Return the number (n,) of each sample at ``t`` (n,) s, lost ones counted, and the seconds between two numbers.

    By numbers and not by times, because interpolation between samples would remove high frequencies.
    """
    steps = np.diff(t)
    usual = float(np.median(steps))
    if not usual > 0:
        return np.arange(len(t), dtype=np.float64), 0.0
    count = np.clip(np.round(steps / usual), 1.0, GAP_STEPS)
    near = (steps > 0) & (steps < GAP_STEPS * usual)
    dt = float(steps[near].sum() / count[near].sum()) if near.any() else usual
    return np.concatenate([[0.0], np.cumsum(count)]), dt


def _whole_windows(t: Array, number: Array, within: list[Span], dt: float, n: int) -> Array:
    """Return first numbers (m,) of windows of ``n`` numbers in spans, without gaps and with few lost samples."""
    found: list[Array] = []
    for part in model.segment_slices(inside(t, within), model.number_segments(t, GAP_STEPS * dt)):
        first, last = number[part.start], number[part.stop - 1]
        found.append(first + n * np.arange(int((last - first + 1) // n)))
    starts = np.concatenate(found) if found else np.zeros(0)
    held = np.searchsorted(number, starts + n) - np.searchsorted(number, starts)
    return starts[held >= (1.0 - MAX_LOST_SHARE) * n]


def burst_spectra(bursts: list[Burst], within: list[Span]) -> Spectra | None:
    """Return spectra of one sensor's bursts in spans, those of the median length and rate; None without any."""
    t = np.array([b.t + 0.5 * len(b.x) / b.rate for b in bursts])
    mine = [(at, b) for at, b, good in zip(t, bursts, inside(t, within), strict=True) if good]
    if not mine:
        return None
    n = int(np.median([len(b.x) for _, b in mine]))
    rate = float(np.median([b.rate for _, b in mine]))
    mine = [(at, b) for at, b in mine if len(b.x) >= n and abs(b.rate / rate - 1.0) < 0.02]
    if not mine:
        return None
    x = np.stack([b.x[:n] for _, b in mine]).astype(np.float64)
    first = mine[0][1]
    frequency, density = welch(x, rate, n // BURST_SEGMENTS, first.sensor)
    at = np.array([a for a, _ in mine])
    return Spectra(first.sensor, first.unit, first.source, rate, n / rate, first.filtered, at, frequency, density)


def welch(x: NDArray[Any], rate: float, size: int, sensor: str = "") -> tuple[Array, Array]:
    """Return frequencies (k,) Hz and one-sided densities (w, k, c) of windows ``x`` (w, n, c) by Welch's method.

    Segments of ``size`` samples overlap by half, each without its mean, with a Hann taper. A gyro's rad/s become
    deg/s.
    """
    taper = np.hanning(size + 1)[:-1][:, None]
    scale = 2.0 / (rate * float(np.sum(taper**2))) * (math.degrees(1.0) ** 2 if sensor == "gyro" else 1.0)
    frequency = np.asarray(np.fft.rfftfreq(size, 1.0 / rate), np.float64)
    density = np.zeros((len(x), len(frequency), x.shape[2]))
    begins = range(0, x.shape[1] - size + 1, max(size // 2, 1))
    for begin in begins:
        part = x[:, begin : begin + size]
        flat = (part - part.mean(axis=1, keepdims=True)) * taper
        density += np.abs(np.fft.rfft(flat, axis=1)) ** 2
    return frequency, density * (scale / len(begins))


# Peaks of a spectrum, and their place in every window.

# What a peak's frequency follows; empty where throttle hardly moved.
Follows = Literal["throttle", "rotors", "nothing", ""]

# What is slower is the flight itself and its control.
LOWEST_HZ = 20.0
# Height above the floor: 6 dB would pass a peak on every log tried.
PROMINENT_DB = 10.0
# The floor is the median within this distance on both sides.
FLOOR_HZ = 40.0
# Of closer peaks the higher one is kept.
MIN_PEAK_DISTANCE_HZ = 12.0
# Peaks of a source that are followed.
MAX_PEAKS = 4
# A peak is at its expected frequency within this share, or 1.5 lines.
FREQUENCY_TOLERANCE = 0.04
# A single window shows a peak of this height above the floor.
PRESENT_DB = 6.0
# Standard error of a median over that of a mean, for a normal distribution.
MEDIAN_SD = 1.25
# Range of a peak about its usual frequency: half to twice the usual thrust.
TRACKED_RANGE = (0.72, 1.4)


@dataclass(slots=True)
class Peak:
    """Peak at ``frequency`` Hz as the source shows it, ``height`` dB above the floor.

    ``rms`` in deg/s or m/s^2 along its strongest ``axis`` (0 to 2), ``density`` of all axes at its line. ``share`` of
    the windows show it; it ``follows`` throttle, rotors or nothing in ``windows`` that could show it. ``possible``:
    frequencies in Hz that a source of this rate shows here; ``true``: the real one, None where unknown; ``why``: the
    reason. ``harmonic`` of the rotors' speed, 0 for none.
    """

    frequency: float
    height: float
    rms: float
    axis: int
    density: float
    share: float = 0.0
    follows: Follows = ""
    windows: int = 0
    possible: list[float] = field(default_factory=list)
    true: float | None = None
    why: str = ""
    harmonic: int = 0


def noise_floor(density: Array, step: float) -> Array:
    """Return the local floor (k,) of a density (k,): its median within 40 Hz on both sides, ``step`` Hz a line."""
    half = max(3, round(FLOOR_HZ / step))
    padded = np.pad(density, half, mode="reflect") if len(density) > half else np.pad(density, half, mode="edge")
    level: Array = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    return level


def find_peaks(spectra: Spectra) -> list[Peak]:
    """Return the prominent peaks of the median window, the strongest first, at most four."""
    f, usual = spectra.frequency, np.median(spectra.total, axis=0)
    low = noise_floor(usual, spectra.step)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = 10.0 * np.log10(usual / low)
    inner = np.zeros(len(f), bool)
    inner[1:-1] = (usual[1:-1] >= usual[:-2]) & (usual[1:-1] > usual[2:])
    inner &= (f >= LOWEST_HZ) & (f <= 0.48 * spectra.rate) & (height >= PROMINENT_DB)
    found: list[Peak] = []
    for k in sorted(np.flatnonzero(inner), key=lambda k: -usual[k]):
        if any(abs(f[k] - p.frequency) < MIN_PEAK_DISTANCE_HZ for p in found) or len(found) == MAX_PEAKS:
            continue
        if any(_hidden(float(f[k] / p.frequency), float(usual[k]), p) for p in found):
            continue
        wide = slice(max(k - 3, 0), k + 4)
        axes = spectra.median[wide].sum(axis=0)
        power = max(float(axes.max()) - float(low[wide].sum()) * float(axes.max() / axes.sum()), 0.0)
        near = spectra.total[:, wide].sum(axis=1) > 10.0 ** (PRESENT_DB / 10.0) * float(low[wide].sum())
        at, axis = _interpolated_hz(usual, int(k), spectra.step), int(np.argmax(axes))
        rms = float(np.sqrt(power * spectra.step))
        found.append(Peak(at, float(height[k]), rms, axis, float(usual[k]), float(near.mean())))
    return found


def _hidden(ratio: float, density: float, peak: Peak) -> bool:
    """Return whether a line is in the range of a much stronger peak, for which it would be taken."""
    return TRACKED_RANGE[0] <= ratio <= TRACKED_RANGE[1] and density < peak.density * 10.0 ** (-PROMINENT_DB / 10.0)


def _interpolated_hz(density: Array, k: int, step: float) -> float:
    """Return a peak's frequency in Hz by the parabola through three logarithms."""
    a, b, c = np.log(np.maximum(density[k - 1 : k + 2], 1e-300))
    bend = a - 2.0 * b + c
    return float((k + (0.5 * (a - c) / bend if bend < 0 else 0.0)) * step)


def track_peak(spectra: Spectra, frequency: float) -> Array:
    """Return a peak's frequency (w,) in Hz in every window, NaN where none is above the floor."""
    band = (spectra.frequency >= TRACKED_RANGE[0] * frequency) & (spectra.frequency <= TRACKED_RANGE[1] * frequency)
    band &= (spectra.frequency >= 0.5 * LOWEST_HZ) & (spectra.frequency <= 0.48 * spectra.rate)
    if np.count_nonzero(band) < 3:
        return np.full(len(spectra.t), np.nan)
    part = spectra.total[:, band]
    k = np.argmax(part, axis=1)
    size = part[np.arange(len(k)), k]
    clear = size > 10.0 ** (PRESENT_DB / 10.0) * np.maximum(np.median(spectra.total, axis=1), 1e-300)
    return np.where(clear, spectra.frequency[band][k], np.nan)


def frequency_tolerance(spectra: Spectra, frequency: float) -> float:
    """Return how near in Hz a peak must be to its expected frequency."""
    return max(1.5 * spectra.step, FREQUENCY_TOLERANCE * frequency)


def frequency_interval(spectra: Spectra, peak: Peak) -> tuple[float, float] | None:
    """Return the 95 % interval in Hz of a peak's frequency by its windows, at least half a line each way."""
    places = track_peak(spectra, peak.frequency)
    places = places[np.isfinite(places)]
    if len(places) < 2:
        return None
    half = max(1.96 * MEDIAN_SD * float(np.std(places)) / float(np.sqrt(len(places))), 0.5 * spectra.step)
    middle = peak.true if peak.true is not None else peak.frequency
    return round(middle - half, 1), round(middle + half, 1)


# Source of a peak (throttle, rotors), and its real frequency.

# A peak follows something in so many of the windows with another expected frequency than the usual one.
FOLLOWING_SHARE = 0.6
# With fewer such windows it is unknown what a peak follows.
MIN_MOVED_WINDOWS = 4
# Below, no rotor turns, or the throttle is not that of rotors.
MIN_THROTTLE = 0.02
# Rotors and their blades that shake a vehicle stay below; higher frequencies are not named as the true ones.
MAX_TRUE_HZ = 500.0
# Of the rotors' speed: up to the second of four blades.
HARMONICS = (1, 2, 3, 4)
# Where rotors' lines cover more of the band, a peak near one of them is no evidence.
MAX_COVERED = 0.3
# 400 Hz, as stamps measure them. Of slower streams every prominent peak at 100 to 120 Hz was an alias.
TRUSTED_RATE_HZ = 390.0


def fold(frequency: Array | float, rate: float) -> Array:
    """Return where samples at ``rate`` Hz show a frequency (any shape) in Hz: between 0 and half the rate."""
    rest = np.mod(np.asarray(frequency, np.float64), rate)
    return np.minimum(rest, rate - rest)


def aliases(frequency: float, rate: float) -> list[float]:
    """Return the frequencies in Hz, up to 500, that samples at ``rate`` Hz show at ``frequency``, itself first."""
    turns = np.arange(0, int(MAX_TRUE_HZ / rate) + 2)
    found = {round(float(f), 1) for f in np.concatenate([turns * rate + frequency, turns * rate - frequency])}
    return sorted(f for f in found if frequency - 0.1 <= f <= max(MAX_TRUE_HZ, frequency))


def find_source(log: FlightLog, spectra: Spectra, peak: Peak) -> None:
    """Set what a peak follows: rotors where their speed is logged, else the root of throttle, as the notch does."""
    seen = track_peak(spectra, peak.frequency)
    near = frequency_tolerance(spectra, peak.frequency)
    speeds = rotor_speeds(log, spectra)
    if speeds is not None and _follows_rotors(spectra, peak, seen, near, speeds):
        return
    by = relative_throttle(log, spectra)
    if by is None:
        return
    expected = peak.frequency * np.sqrt(by)
    moved = np.isfinite(expected) & (np.abs(expected - peak.frequency) > near)
    moved &= (expected > TRACKED_RANGE[0] * peak.frequency) & (expected < TRACKED_RANGE[1] * peak.frequency)
    peak.windows = int(np.count_nonzero(moved))
    if peak.windows < MIN_MOVED_WINDOWS:
        return
    with np.errstate(invalid="ignore"):
        if np.mean(np.abs(seen - expected)[moved] <= near) >= FOLLOWING_SHARE:
            peak.follows = "throttle"
        elif np.mean(np.abs(seen - peak.frequency)[moved] <= near) >= FOLLOWING_SHARE:
            peak.follows = "nothing"


def _follows_rotors(spectra: Spectra, peak: Peak, seen: Array, near: float, speeds: Array) -> bool:
    """Return whether a peak is where rotors or their harmonics are shown in most windows.

    Rotors at several speeds may cover much of the band, so that any peak is near one. Below 400 Hz their aliases may
    be there by chance: then the peak must also move as they do, which a fold reverses, so the strongest line of each
    window is compared.
    """
    known = np.isfinite(speeds).all(axis=1)
    if np.count_nonzero(known) < MIN_MOVED_WINDOWS:
        return False
    if spectra.rate < TRUSTED_RATE_HZ:
        seen = strongest_lines(spectra)
    for harmonic in HARMONICS:
        shown = fold(harmonic * speeds[known], spectra.rate)
        hit = np.abs(shown - seen[known, None]).min(axis=1) <= near
        covered = 2.0 * near * len(np.unique(np.round(np.median(shown, axis=0) / near))) / (0.5 * spectra.rate)
        usual = float(np.median(shown))
        if np.abs(np.median(shown, axis=0) - peak.frequency).min() > near:
            continue
        moved = np.abs(np.median(shown, axis=1) - usual) > near
        seen_moved = hit[moved] if spectra.rate < TRUSTED_RATE_HZ else hit
        if (
            covered > MAX_COVERED
            or len(seen_moved) < MIN_MOVED_WINDOWS
            or hit.mean() < FOLLOWING_SHARE
            or seen_moved.mean() < FOLLOWING_SHARE
        ):
            continue
        peak.follows, peak.windows, peak.harmonic = "rotors", len(seen_moved), harmonic
        peak.true = harmonic * float(np.median(speeds[known]))
        peak.why = f"the rotors turn {peak.true / harmonic:.0f} times a second"
        return True
    return False


def strongest_lines(spectra: Spectra) -> Array:
    """Return the strongest line (w,) of each window in Hz."""
    band = (spectra.frequency >= LOWEST_HZ) & (spectra.frequency <= 0.48 * spectra.rate)
    if not band.any():
        return np.full(len(spectra.t), np.nan)
    lines: Array = spectra.frequency[band][np.argmax(spectra.total[:, band], axis=1)]
    return lines


def rotor_speeds(log: FlightLog, spectra: Spectra) -> Array | None:
    """Return rotor speeds (w, rotors) in turns per second over the windows, None where none turns."""
    if log.power.rpm is None or len(log.power.rpm.t) < 2:
        return None
    speeds = window_means(log.power.rpm, spectra) / 60.0
    turning = np.nanmedian(speeds, axis=0) > LOWEST_HZ / 4.0 if np.isfinite(speeds).any() else np.zeros(1, bool)
    return speeds[:, turning] if turning.any() else None


def window_means(stream: Stream, spectra: Spectra) -> Array:
    """Return means (w, k) of a slower stream's values over each window, NaN without any; the nearest for a burst."""
    out = np.full((len(spectra.t), stream.x.shape[1]), np.nan)
    half = max(0.5 * spectra.seconds, 0.5)
    begin, end = np.searchsorted(stream.t, spectra.t - half), np.searchsorted(stream.t, spectra.t + half)
    for k, (a, b) in enumerate(zip(begin, end, strict=True)):
        if b > a:
            values = stream.x[a:b]
            good = np.isfinite(values).all(axis=1)
            out[k] = values[good].mean(axis=0) if good.any() else np.nan
    return out


def find_true_frequency(spectra: Spectra, peak: Peak, onboard: OnboardSpectrum | None, within: list[Span]) -> None:
    """Set the real frequency of a peak: known above 400 Hz or by rotors, else by the autopilot's spectrum.

    That one has another rate and may show one of the possible frequencies.
    """
    peak.possible = aliases(peak.frequency, spectra.rate)
    if peak.true is not None:
        return
    if spectra.rate >= TRUSTED_RATE_HZ:
        peak.true, peak.why = peak.frequency, f"{spectra.rate:.0f} Hz show it where it is"
        return
    if onboard is None:
        return
    rows = onboard.peaks[inside(onboard.t, within)]
    if len(rows) < MIN_MOVED_WINDOWS:
        return
    near = frequency_tolerance(spectra, peak.frequency)
    with np.errstate(invalid="ignore"):
        shown = [float((np.abs(rows - f) <= near).any(axis=1).mean()) for f in peak.possible]
    agreeing = [f for f, share in zip(peak.possible, shown, strict=True) if share >= FOLLOWING_SHARE]
    if len(agreeing) == 1:
        peak.true = agreeing[0]
        peak.why = f"{onboard.source} at {onboard.rate:.0f} Hz shows it in {100 * max(shown):.0f} % of the flight"


def analyse_peaks(log: FlightLog, spectra: Spectra, within: list[Span]) -> list[Peak]:
    """Return the peaks of a source, the strongest first, with what they follow and their frequencies.

    They are searched in the median window, and in windows whose frequencies are scaled to the usual throttle: a peak
    that moves far is prominent only there.
    """
    moving = find_peaks(scaled_to_usual_throttle(log, spectra))
    for peak in moving:
        find_source(log, spectra, peak)
    found = [p for p in moving if p.follows in ("throttle", "rotors")]
    for peak in find_peaks(spectra):
        if not any(
            TRACKED_RANGE[0] <= peak.frequency / p.frequency <= TRACKED_RANGE[1] and p.density > peak.density
            for p in found
        ):
            find_source(log, spectra, peak)
            found = [
                p for p in found if abs(p.frequency - peak.frequency) > frequency_tolerance(spectra, peak.frequency)
            ]
            found.append(peak)
    for peak in found:
        find_true_frequency(spectra, peak, log.vibration.spectrum, within)
    return sorted(found, key=lambda p: -p.density)[:MAX_PEAKS]


def relative_throttle(log: FlightLog, spectra: Spectra) -> Array | None:
    """Return throttle (w,) over its median, NaN where not logged; None without a rotor's throttle."""
    if log.power.throttle is None or len(log.power.throttle.t) < 2:
        return None
    throttle = window_means(log.power.throttle, spectra)[:, 0]
    usual = float(np.nanmedian(throttle)) if np.isfinite(throttle).any() else 0.0
    return np.maximum(throttle, 0.0) / usual if usual > MIN_THROTTLE else None


def scaled_to_usual_throttle(log: FlightLog, spectra: Spectra) -> Spectra:
    """Return the spectra with the frequencies of each window scaled by the root of throttle."""
    by = relative_throttle(log, spectra)
    if by is None:
        return spectra
    factor = np.sqrt(np.clip(np.nan_to_num(by, nan=1.0), 0.25, 4.0))
    scaled = np.empty_like(spectra.density)
    for w, one in enumerate(factor):
        for axis in range(scaled.shape[2]):
            density = spectra.density[w, :, axis]
            scaled[w, :, axis] = one * np.interp(spectra.frequency * one, spectra.frequency, density)
    return replace(spectra, density=scaled)
