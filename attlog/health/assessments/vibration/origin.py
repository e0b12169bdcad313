"""What makes a peak of a spectrum (throttle, rotors), and which frequency does it really have?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog, Stream
from attlog.flight.vibration.model import OnboardSpectrum
from attlog.health.assessments.vibration.peaks import LOWEST_HZ, MOST, TRACKED, Peak, peaks, tolerance, track
from attlog.health.assessments.vibration.spectra import Spectra
from attlog.segments.spans import Span, inside

Array = NDArray[np.float64]

SHARE = 0.6
"""A peak follows something where it does in so many of the windows that could tell."""
LEAST_MOVED = 4
"""So many windows must foretell another frequency than the usual one before one can say what a peak follows."""
LEAST_THROTTLE = 0.02
"""Below, no rotor turns, or the throttle is not that of rotors."""
HIGHEST_HZ = 500.0
"""Rotors and their blades that shake a vehicle stay below; higher frequencies are not named as the true ones."""
HARMONICS = (1, 2, 3, 4)
MOST_COVERED = 0.3
"""Where rotors' lines cover more of the band than this, a peak near one of them tells nothing."""
TRUSTED_RATE_HZ = 390.0
"""400 Hz, as stamps measure them. Of slower streams every prominent peak at 100 to 120 Hz was an alias."""


def fold(frequency: Array | float, rate: float) -> Array:
    """Where samples at ``rate`` Hz show a frequency (any shape) in Hz: between 0 and half the rate."""
    rest = np.mod(np.asarray(frequency, np.float64), rate)
    return np.minimum(rest, rate - rest)


def aliases(frequency: float, rate: float) -> list[float]:
    """The frequencies in Hz, up to 500, that samples at ``rate`` Hz show at ``frequency``, itself first."""
    turns = np.arange(0, int(HIGHEST_HZ / rate) + 2)
    found = {round(float(f), 1) for f in np.concatenate([turns * rate + frequency, turns * rate - frequency])}
    return sorted(f for f in found if frequency - 0.1 <= f <= max(HIGHEST_HZ, frequency))


def follow(log: FlightLog, spectra: Spectra, peak: Peak) -> None:
    """Find out what a peak follows: rotors where their speed is logged, else the root of throttle as the notch does."""
    seen = track(spectra, peak.frequency)
    near = tolerance(spectra, peak.frequency)
    speeds = rotors(log, spectra)
    if speeds is not None and _of_rotors(spectra, peak, seen, near, speeds):
        return
    by = throttle_of(log, spectra)
    if by is None:
        return
    foretold = peak.frequency * np.sqrt(by)
    moved = np.isfinite(foretold) & (np.abs(foretold - peak.frequency) > near)
    moved &= (foretold > TRACKED[0] * peak.frequency) & (foretold < TRACKED[1] * peak.frequency)
    peak.windows = int(np.count_nonzero(moved))
    if peak.windows < LEAST_MOVED:
        return
    with np.errstate(invalid="ignore"):
        if np.mean(np.abs(seen - foretold)[moved] <= near) >= SHARE:
            peak.follows = "throttle"
        elif np.mean(np.abs(seen - peak.frequency)[moved] <= near) >= SHARE:
            peak.follows = "nothing"


def _of_rotors(spectra: Spectra, peak: Peak, seen: Array, near: float, speeds: Array) -> bool:
    """Whether a peak is where rotors or their harmonics are shown in most windows.

    Rotors at several speeds may cover much of the band, so that any peak is near one; and below 400 Hz their aliases
    may lie there by chance: then the peak must also move as they do, which a fold turns around, so that it is looked
    for as the strongest line of each window.
    """
    known = np.isfinite(speeds).all(axis=1)
    if np.count_nonzero(known) < LEAST_MOVED:
        return False
    if spectra.rate < TRUSTED_RATE_HZ:
        seen = strongest(spectra)
    for harmonic in HARMONICS:
        shown = fold(harmonic * speeds[known], spectra.rate)
        hit = np.abs(shown - seen[known, None]).min(axis=1) <= near
        covered = 2.0 * near * len(np.unique(np.round(np.median(shown, axis=0) / near))) / (0.5 * spectra.rate)
        usual = float(np.median(shown))
        if np.abs(np.median(shown, axis=0) - peak.frequency).min() > near:
            continue
        moved = np.abs(np.median(shown, axis=1) - usual) > near
        told = hit[moved] if spectra.rate < TRUSTED_RATE_HZ else hit
        if covered > MOST_COVERED or len(told) < LEAST_MOVED or hit.mean() < SHARE or told.mean() < SHARE:
            continue
        peak.follows, peak.windows, peak.harmonic = "rotors", len(told), harmonic
        peak.true = harmonic * float(np.median(speeds[known]))
        peak.why = f"the rotors turn {peak.true / harmonic:.0f} times a second"
        return True
    return False


def strongest(spectra: Spectra) -> Array:
    """The strongest line (w,) of each window in Hz."""
    band = (spectra.frequency >= LOWEST_HZ) & (spectra.frequency <= 0.48 * spectra.rate)
    if not band.any():
        return np.full(len(spectra.t), np.nan)
    lines: Array = spectra.frequency[band][np.argmax(spectra.total[:, band], axis=1)]
    return lines


def rotors(log: FlightLog, spectra: Spectra) -> Array | None:
    """Rotor speeds (w, rotors) in turns per second over the windows, None where none turns."""
    if log.rpm is None or len(log.rpm.t) < 2:
        return None
    speeds = at_windows(log.rpm, spectra) / 60.0
    turning = np.nanmedian(speeds, axis=0) > LOWEST_HZ / 4.0 if np.isfinite(speeds).any() else np.zeros(1, bool)
    return speeds[:, turning] if turning.any() else None


def at_windows(stream: Stream, spectra: Spectra) -> Array:
    """Means (w, k) of a slower stream's values over each window, NaN where it has none; the nearest for a burst."""
    out = np.full((len(spectra.t), stream.x.shape[1]), np.nan)
    half = max(0.5 * spectra.seconds, 0.5)
    begin, end = np.searchsorted(stream.t, spectra.t - half), np.searchsorted(stream.t, spectra.t + half)
    for k, (a, b) in enumerate(zip(begin, end, strict=True)):
        if b > a:
            values = stream.x[a:b]
            good = np.isfinite(values).all(axis=1)
            out[k] = values[good].mean(axis=0) if good.any() else np.nan
    return out


def unfold(spectra: Spectra, peak: Peak, onboard: OnboardSpectrum | None, within: list[Span]) -> None:
    """Which frequency a peak really has: known above 400 Hz, or by rotors, or where the autopilot's own spectrum at
    another rate shows one of the possible ones."""
    peak.possible = aliases(peak.frequency, spectra.rate)
    if peak.true is not None:
        return
    if spectra.rate >= TRUSTED_RATE_HZ:
        peak.true, peak.why = peak.frequency, f"{spectra.rate:.0f} Hz show it where it is"
        return
    if onboard is None:
        return
    rows = onboard.peaks[inside(onboard.t, within)]
    if len(rows) < LEAST_MOVED:
        return
    near = tolerance(spectra, peak.frequency)
    with np.errstate(invalid="ignore"):
        shown = [float((np.abs(rows - f) <= near).any(axis=1).mean()) for f in peak.possible]
    agreeing = [f for f, share in zip(peak.possible, shown, strict=True) if share >= SHARE]
    if len(agreeing) == 1:
        peak.true = agreeing[0]
        peak.why = f"{onboard.source} at {onboard.rate:.0f} Hz shows it in {100 * max(shown):.0f} % of the flight"


def analysed(log: FlightLog, spectra: Spectra, within: list[Span]) -> list[Peak]:
    """The peaks of a source, the strongest first, with what they follow and which frequency they have.

    Looked for in the usual window, and in windows whose frequencies are scaled to the usual throttle: a peak that
    moves far stands out only there.
    """
    moving = peaks(at_usual_throttle(log, spectra))
    for peak in moving:
        follow(log, spectra, peak)
    found = [p for p in moving if p.follows in ("throttle", "rotors")]
    for peak in peaks(spectra):
        if not any(
            TRACKED[0] <= peak.frequency / p.frequency <= TRACKED[1] and p.density > peak.density for p in found
        ):
            follow(log, spectra, peak)
            found = [p for p in found if abs(p.frequency - peak.frequency) > tolerance(spectra, peak.frequency)]
            found.append(peak)
    for peak in found:
        unfold(spectra, peak, log.onboard_spectrum, within)
    return sorted(found, key=lambda p: -p.density)[:MOST]


def throttle_of(log: FlightLog, spectra: Spectra) -> Array | None:
    """Throttle (w,) over the windows by its usual value, NaN where not logged; None where it tells nothing."""
    if log.throttle is None or len(log.throttle.t) < 2:
        return None
    throttle = at_windows(log.throttle, spectra)[:, 0]
    usual = float(np.nanmedian(throttle)) if np.isfinite(throttle).any() else 0.0
    return np.maximum(throttle, 0.0) / usual if usual > LEAST_THROTTLE else None


def at_usual_throttle(log: FlightLog, spectra: Spectra) -> Spectra:
    """The same spectra with the frequencies of each window scaled by the root of throttle, as rotors turn."""
    by = throttle_of(log, spectra)
    if by is None:
        return spectra
    factor = np.sqrt(np.clip(np.nan_to_num(by, nan=1.0), 0.25, 4.0))
    scaled = np.empty_like(spectra.density)
    for w, one in enumerate(factor):
        for axis in range(scaled.shape[2]):
            density = spectra.density[w, :, axis]
            scaled[w, :, axis] = one * np.interp(spectra.frequency * one, spectra.frequency, density)
    return replace(spectra, density=scaled)
