"""Power spectra of gyro and accelerometer in flight, in windows, from all sources."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import median, nanmedian, unique
from attlog.core.spans import Span, inside
from attlog.flight.model import Burst, FlightLog, OnboardSpectrum, Stream
from attlog.segments import model

Array = NDArray[np.float64]

# Window of a stream, and its length over that of a Welch segment: resolution 2 Hz.
WINDOW_S, WINDOW_SEGMENTS = 2.0, 4
# Length of a burst (0.5 s) over that of a segment: resolution 4 Hz.
BURST_SEGMENTS = 2
# Maximum windows and samples of a source, evenly over the flight, to limit time.
MAX_WINDOWS, MAX_SAMPLES = 150, 200_000
# Minimum rate of a stream: rotors turn at 30 to 250 Hz.
MIN_RATE_HZ = 90.0
# Maximum interval in a window in median intervals, and maximum share of lost samples, which are interpolated.
GAP_STEPS, MAX_LOST_SHARE = 5.0, 0.1


class Spectra(NamedTuple):
    """Spectra of one sensor over ``frequency`` (k,) Hz in windows centred at ``t`` (w,) s.

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
        """Median density (k, 3) over windows."""
        middle: Array = median(self.density, axis=0)
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
    """Return the spectra of all IMU sources in spans, fastest first."""
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
    """Return spectra of gapless 2 s windows; None for a slow stream or without windows."""
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
    starts = starts[unique(np.linspace(0, len(starts) - 1, most).round().astype(int))]
    grid = starts[:, None] + np.arange(n)
    x = np.stack([np.interp(grid, number, stream.x[:, k]) for k in range(3)], axis=-1)
    good = np.isfinite(x).all(axis=(1, 2))
    if not good.any():
        return None
    frequency, density = welch(x[good], rate, n // WINDOW_SEGMENTS, sensor)
    middle = np.interp(starts[good] + 0.5 * n, number, t)
    return Spectra(sensor, unit, stream.source, rate, n * dt, filtered, middle, frequency, density)


def sample_numbers(t: Array) -> tuple[Array, float]:
    """Return sample numbers (n,), lost samples counted, and the sample interval in s.

    Numbers instead of times, because interpolation to regular times removes high frequencies.
    """
    steps = np.diff(t)
    usual = float(median(steps))
    if not usual > 0:
        return np.arange(len(t), dtype=np.float64), 0.0
    count = np.clip(np.round(steps / usual), 1.0, GAP_STEPS)
    near = (steps > 0) & (steps < GAP_STEPS * usual)
    dt = float(steps[near].sum() / count[near].sum()) if near.any() else usual
    return np.concatenate([[0.0], np.cumsum(count)]), dt


def _whole_windows(t: Array, number: Array, within: list[Span], dt: float, n: int) -> Array:
    """Return first sample numbers (m,) of windows of ``n`` samples without gaps in spans."""
    found: list[Array] = []
    for part in model.segment_slices(inside(t, within), model.number_segments(t, GAP_STEPS * dt)):
        first, last = number[part.start], number[part.stop - 1]
        found.append(first + n * np.arange(int((last - first + 1) // n)))
    starts = np.concatenate(found) if found else np.zeros(0)
    held = np.searchsorted(number, starts + n) - np.searchsorted(number, starts)
    return starts[held >= (1.0 - MAX_LOST_SHARE) * n]


def burst_spectra(bursts: list[Burst], within: list[Span]) -> Spectra | None:
    """Return spectra of a sensor's bursts of median length and rate in spans."""
    t = np.array([b.t + 0.5 * len(b.x) / b.rate for b in bursts])
    mine = [(at, b) for at, b, good in zip(t, bursts, inside(t, within), strict=True) if good]
    if not mine:
        return None
    n = int(median([len(b.x) for _, b in mine]))
    rate = float(median([b.rate for _, b in mine]))
    mine = [(at, b) for at, b in mine if len(b.x) >= n and abs(b.rate / rate - 1.0) < 0.02]
    if not mine:
        return None
    x = np.stack([b.x[:n] for _, b in mine]).astype(np.float64)
    first = mine[0][1]
    frequency, density = welch(x, rate, n // BURST_SEGMENTS, first.sensor)
    at = np.array([a for a, _ in mine])
    return Spectra(first.sensor, first.unit, first.source, rate, n / rate, first.filtered, at, frequency, density)


def welch(x: NDArray[Any], rate: float, size: int, sensor: str = "") -> tuple[Array, Array]:
    """Return frequencies (k,) Hz and one-sided densities (w, k, c) by Welch's method.

    ``x`` (w, n, c): windows. Segments of ``size`` samples overlap by half, with mean removed and Hann taper. Gyro rad/s
    are converted to deg/s.
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


# Peaks of a spectrum, and their frequency in every window.

# Quantity that a peak's frequency follows; empty if throttle hardly changed.
Follows = Literal["throttle", "rotors", "nothing", ""]

# Minimum frequency of a peak; below are motion and control.
LOWEST_HZ = 20.0
# Minimum height above the floor; 6 dB passes a peak on every log tried.
PROMINENT_DB = 10.0
# Half width of the median that gives the floor.
FLOOR_HZ = 40.0
# Minimum distance of peaks; the higher one is kept.
MIN_PEAK_DISTANCE_HZ = 12.0
# Maximum number of peaks of a source.
MAX_PEAKS = 4
# Relative tolerance of a peak's frequency, at least 1.5 lines.
FREQUENCY_TOLERANCE = 0.04
# Minimum height of a peak in a single window.
PRESENT_DB = 6.0
# Standard error of a median over that of a mean, for a normal distribution.
MEDIAN_SD = 1.25
# Search range about a peak's median frequency: half to twice the thrust.
TRACKED_RANGE = (0.72, 1.4)


@dataclass(slots=True)
class Peak:
    """Peak at ``frequency`` Hz in the source, possibly aliased, ``height`` dB above the floor.

    ``rms`` in deg/s or m/s^2 along its strongest ``axis`` (0 to 2), ``density`` of all axes at its line. ``share`` of
    the windows contain it; it ``follows`` throttle, rotors or nothing, tested on ``windows``. ``possible``: frequencies
    in Hz with this alias; ``true``: the real one, None where unknown; ``why``: the reason. ``harmonic`` of the rotor
    speed, 0 for none.
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
    """Return the floor (k,) of a density (k,): moving median over +-40 Hz."""
    half = max(3, round(FLOOR_HZ / step))
    padded = np.pad(density, half, mode="reflect") if len(density) > half else np.pad(density, half, mode="edge")
    level: Array = median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    return level


def find_peaks(spectra: Spectra) -> list[Peak]:
    """Return the prominent peaks of the median window, the strongest first, at most four."""
    f, usual = spectra.frequency, median(spectra.total, axis=0)
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
        strong = (p for p in found if usual[k] < p.density * 10.0 ** (-PROMINENT_DB / 10.0))
        if any(TRACKED_RANGE[0] <= f[k] / p.frequency <= TRACKED_RANGE[1] for p in strong):
            continue  # within the search range of a much stronger peak
        wide = slice(max(k - 3, 0), k + 4)
        axes = spectra.median[wide].sum(axis=0)
        power = max(float(axes.max()) - float(low[wide].sum()) * float(axes.max() / axes.sum()), 0.0)
        near = spectra.total[:, wide].sum(axis=1) > 10.0 ** (PRESENT_DB / 10.0) * float(low[wide].sum())
        at, axis = _interpolated_hz(usual, int(k), spectra.step), int(np.argmax(axes))
        rms = float(np.sqrt(power * spectra.step))
        found.append(Peak(at, float(height[k]), rms, axis, float(usual[k]), float(near.mean())))
    return found


def _interpolated_hz(density: Array, k: int, step: float) -> float:
    """Return a peak's frequency in Hz by a parabola through three log densities."""
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
    clear = size > 10.0 ** (PRESENT_DB / 10.0) * np.maximum(median(spectra.total, axis=1), 1e-300)
    return np.where(clear, spectra.frequency[band][k], np.nan)


def frequency_tolerance(spectra: Spectra, frequency: float) -> float:
    """Return the tolerance in Hz about a peak's expected frequency."""
    return max(1.5 * spectra.step, FREQUENCY_TOLERANCE * frequency)


def frequency_interval(spectra: Spectra, peak: Peak) -> tuple[float, float] | None:
    """Return the 95 % interval in Hz of a peak's frequency, at least half a line each way."""
    places = track_peak(spectra, peak.frequency)
    places = places[np.isfinite(places)]
    if len(places) < 2:
        return None
    half = max(1.96 * MEDIAN_SD * float(np.std(places)) / float(np.sqrt(len(places))), 0.5 * spectra.step)
    middle = peak.true if peak.true is not None else peak.frequency
    return round(middle - half, 1), round(middle + half, 1)


# Source of a peak (throttle, rotors), and its real frequency.

# Minimum share of windows that agree, of those whose expected frequency differs from the median.
FOLLOWING_SHARE = 0.6
# Minimum number of such windows.
MIN_MOVED_WINDOWS = 4
# Minimum throttle of turning rotors.
MIN_THROTTLE = 0.02
# Maximum true frequency; rotor and blade frequencies that matter are lower.
MAX_TRUE_HZ = 500.0
# Harmonics of the rotor speed.
HARMONICS = (1, 2, 3, 4)
# Maximum share of the band covered by rotor lines; above it a coincidence is no evidence.
MAX_COVERED = 0.3
# Nominally 400 Hz. In slower streams all prominent peaks at 100 to 120 Hz were aliases.
TRUSTED_RATE_HZ = 390.0


def fold(frequency: Array | float, rate: float) -> Array:
    """Return the alias in Hz, 0 to half the rate, of frequencies (any shape) in Hz."""
    rest = np.mod(np.asarray(frequency, np.float64), rate)
    return np.minimum(rest, rate - rest)


def aliases(frequency: float, rate: float) -> list[float]:
    """Return the frequencies in Hz, up to 500, with alias ``frequency``, itself first."""
    turns = np.arange(0, int(MAX_TRUE_HZ / rate) + 2)
    found = {round(float(f), 1) for f in np.concatenate([turns * rate + frequency, turns * rate - frequency])}
    return sorted(f for f in found if frequency - 0.1 <= f <= max(MAX_TRUE_HZ, frequency))


def find_source(log: FlightLog, spectra: Spectra, peak: Peak) -> None:
    """Set whether a peak follows rotor speed, the square root of throttle, or nothing."""
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
    """Return whether a peak follows an alias or harmonic of the rotors in most windows.

    Several rotor speeds may cover much of the band, so any peak is near one. Below 400 Hz an alias may match by chance:
    then the peak must also move with it. Aliasing can reverse the direction, so the strongest line of each window is
    compared.
    """
    known = np.isfinite(speeds).all(axis=1)
    if np.count_nonzero(known) < MIN_MOVED_WINDOWS:
        return False
    if spectra.rate < TRUSTED_RATE_HZ:
        band = (spectra.frequency >= LOWEST_HZ) & (spectra.frequency <= 0.48 * spectra.rate)
        seen = spectra.frequency[band][np.argmax(spectra.total[:, band], axis=1)]
    for harmonic in HARMONICS:
        shown = fold(harmonic * speeds[known], spectra.rate)
        hit = np.abs(shown - seen[known, None]).min(axis=1) <= near
        covered = 2.0 * near * len(unique(np.round(median(shown, axis=0) / near))) / (0.5 * spectra.rate)
        usual = float(median(shown))
        if np.abs(median(shown, axis=0) - peak.frequency).min() > near:
            continue
        moved = np.abs(median(shown, axis=1) - usual) > near
        seen_moved = hit[moved] if spectra.rate < TRUSTED_RATE_HZ else hit
        if (
            covered > MAX_COVERED
            or len(seen_moved) < MIN_MOVED_WINDOWS
            or hit.mean() < FOLLOWING_SHARE
            or seen_moved.mean() < FOLLOWING_SHARE
        ):
            continue
        peak.follows, peak.windows, peak.harmonic = "rotors", len(seen_moved), harmonic
        peak.true = harmonic * float(median(speeds[known]))
        peak.why = f"the rotors turn {peak.true / harmonic:.0f} times a second"
        return True
    return False


def rotor_speeds(log: FlightLog, spectra: Spectra) -> Array | None:
    """Return mean rotor speeds (w, rotors) in Hz over the windows, None if none turns."""
    if log.power.rpm is None or len(log.power.rpm.t) < 2:
        return None
    speeds = window_means(log.power.rpm, spectra) / 60.0
    turning = nanmedian(speeds, axis=0) > LOWEST_HZ / 4.0 if np.isfinite(speeds).any() else np.zeros(1, bool)
    return speeds[:, turning] if turning.any() else None


def window_means(stream: Stream, spectra: Spectra) -> Array:
    """Return window means (w, k) of a stream, for bursts the nearest value; NaN without any."""
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
    """Set the true frequency of a peak, known for sources of 400 Hz or by rotors.

    Else the autopilot's own spectrum, of another rate, may contain one of the possible frequencies.
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

    Searched in the median spectrum, and in that with frequencies scaled to the median throttle, where peaks that vary
    widely are prominent.
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
    """Return throttle (w,) relative to its median, NaN where not logged; None without rotors."""
    if log.power.throttle is None or len(log.power.throttle.t) < 2:
        return None
    throttle = window_means(log.power.throttle, spectra)[:, 0]
    usual = float(nanmedian(throttle)) if np.isfinite(throttle).any() else 0.0
    return np.maximum(throttle, 0.0) / usual if usual > MIN_THROTTLE else None


def scaled_to_usual_throttle(log: FlightLog, spectra: Spectra) -> Spectra:
    """Return spectra with frequencies scaled by the square root of relative throttle."""
    by = relative_throttle(log, spectra)
    if by is None:
        return spectra
    factor = np.sqrt(np.clip(np.nan_to_num(by, nan=1.0), 0.25, 4.0))
    scaled = np.empty_like(spectra.density)
    for w, one in enumerate(factor):
        for axis in range(scaled.shape[2]):
            density = spectra.density[w, :, axis]
            scaled[w, :, axis] = one * np.interp(spectra.frequency * one, spectra.frequency, density)
    return spectra._replace(density=scaled)
