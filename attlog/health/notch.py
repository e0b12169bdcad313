"""Gyro spectrum in flight, and notch filters against rotor vibration."""

from __future__ import annotations

import numpy as np

from attlog.core.sorting import median, nanmedian, quantile
from attlog.core.spans import Span
from attlog.flight.model import FlightLog
from attlog.flight.notches import (
    ActiveNotch,
    WantedNotch,
    active_notches,
    advise_fast_gyro,
    advise_reboot,
    filters_gyro,
    fixed_notch,
    notch_parameters,
)
from attlog.health.check import Check, HealthCase, Setting, Verdict, unknown
from attlog.health.spectrum import (
    LOWEST_HZ,
    MIN_MOVED_WINDOWS,
    MIN_RATE_HZ,
    PROMINENT_DB,
    TRUSTED_RATE_HZ,
    WINDOW_S,
    Peak,
    Spectra,
    all_spectra,
    analyse_peaks,
    burst_spectra,
    find_peaks,
    frequency_interval,
    frequency_tolerance,
    rotor_speeds,
    track_peak,
    window_means,
)
from attlog.health.vibration import sound_flight

# A notch at a wrong frequency only adds delay. So a peak must have a known frequency, follow throttle or rotors, be
# large, and appear on every IMU that can resolve it.

# Minimum RMS of a peak for a notch: a low-pass at 40 Hz reduces 2 deg/s at 100 Hz to 0.3 deg/s.
MIN_PEAK_DPS = 2.0
# Minimum number of 2 s windows, or bursts, with the peak.
MIN_WINDOWS, MIN_BURSTS = 10, 5
# Minimum attenuation by an active notch.
LOWERED_DB = 6.0
NOTCH_LIMIT = f"a peak of {MIN_PEAK_DPS:g} deg/s that follows throttle or rotors in 60 % of the windows"
NOTCH_SOURCE = "ardupilot.org, Managing Gyro Noise; docs.px4.io, MC Filter Tuning"


def notch_filter(case: HealthCase) -> list[Check]:
    """Check which notch filter would help or is active, or what to log."""
    log, within = case.log, sound_flight(case.segments, case.log)
    if not log.kind.hovers or not filters_gyro(log):
        return []
    sources = all_spectra(log, within)
    if not sources:
        return []  # already reported by the spectrum check
    best = max(sources, key=lambda s: (s.rate >= TRUSTED_RATE_HZ, not s.filtered, s.rate))
    found = analyse_peaks(log, best, within)
    active = active_notches(log)
    strong = [p for p in found if p.rms >= MIN_PEAK_DPS]
    if not strong:
        return [_no_peak(log, best, active)]
    peak = next((p for p in strong if not _refusal(log, best, p, sources)), None)
    covered = [(p, n) for p in strong for n in active if p.true is not None and n.covers(p.true)]
    if covered and (peak is None or any(p is peak for p, _ in covered)):
        return [_covered_peak(log, best, *covered[0], within)]
    measuring = [n for n in active if n.follows == "measurement"]
    if measuring and strong[0].true is None:
        return [_unknown_notch(f"{measuring[0].name} follows what it measures; this log cannot show how well.", log)]
    if peak is None:
        return [_unknown_notch(_refusal(log, best, strong[0], sources), log)]
    return [_notch_offer(log, best, peak)]


def _refusal(log: FlightLog, spectra: Spectra, peak: Peak, sources: list[Spectra]) -> str:
    """Return why no notch is proposed for a peak; empty where one is."""
    shown = f"The gyro's peak at {peak.frequency:.0f} Hz"
    if peak.true is None:
        others = " or ".join(f"{f:.0f}" for f in peak.possible[:3])
        return f"{shown} may be one at {others} Hz: {spectra.source} has {spectra.rate:.0f} Hz."
    if len(spectra.t) < min_windows(spectra):
        return f"{shown} is seen in {len(spectra.t)} windows of flight; {min_windows(spectra)} are needed."
    if peak.follows == "nothing":
        return f"{shown} does not follow throttle: a part of the frame or the electronics makes it."
    if peak.windows < MIN_MOVED_WINDOWS:
        return f"Throttle changed too little to see whether the gyro's peak at {peak.frequency:.0f} Hz follows it."
    if not peak.follows:
        return f"{shown} neither follows throttle nor stays where it is."
    beside = [s for s in sources if s.unit != spectra.unit and s.rate >= 0.9 * spectra.rate and not s.filtered]
    for other in beside:
        if not any(
            abs(p.frequency - peak.frequency) <= frequency_tolerance(spectra, peak.frequency) for p in find_peaks(other)
        ):
            return f"{shown} is not on IMU {other.unit}: it belongs to one sensor, not to the vehicle."
    return ""


def min_windows(spectra: Spectra) -> int:
    """Return the minimum number of windows for or against a peak."""
    return MIN_BURSTS if spectra.seconds < 1.0 else MIN_WINDOWS


def _no_peak(log: FlightLog, spectra: Spectra, active: list[ActiveNotch]) -> Check:
    """Return the check without a strong peak, by the range of the source."""
    if spectra.rate < TRUSTED_RATE_HZ:
        slow = f"{spectra.source} at {spectra.rate:.0f} Hz is too slow to show the rotors' vibration."
        return _unknown_notch(slow, log)
    if len(spectra.t) < min_windows(spectra):
        few = f"{len(spectra.t)} windows of flight show no peak; {min_windows(spectra)} are needed."
        return _unknown_notch(few, log)
    text = f"No peak of the gyro reaches {MIN_PEAK_DPS:g} deg/s in flight, so that no further notch is needed."
    if spectra.filtered:
        text = f"Behind the filters no peak of the gyro reaches {MIN_PEAK_DPS:g} deg/s in flight."
    return _notch_check("ok", text, spectra, [f"{n.name} is on." for n in active])


def _covered_peak(log: FlightLog, spectra: Spectra, peak: Peak, active: ActiveNotch, within: list[Span]) -> Check:
    """Return the check of an active notch, with its attenuation if bursts show it."""
    text = f"{active.name} covers the gyro's peak at {peak.true:.0f} Hz already."
    if active.follows == "measurement":
        text = f"{active.name} follows the gyro's peak at {peak.true:.0f} Hz already."
    verdict: Verdict = "ok"
    evidence = [f"The peak is {peak.rms:.1f} deg/s before the filters."]
    lowered = reduction_db(log, spectra, peak, within)
    if lowered is not None:
        evidence.append(f"Behind the filters it is {lowered:.0f} dB lower.")
        if lowered < LOWERED_DB:
            verdict = "warning"
            text = f"{active.name} is on, but lowers the peak at {peak.true:.0f} Hz by only {lowered:.0f} dB."
    return _notch_check(verdict, text, spectra, evidence, peak)


def reduction_db(log: FlightLog, spectra: Spectra, peak: Peak, within: list[Span]) -> float | None:
    """Return the attenuation in dB of a peak by the autopilot's filters; None if unknown.

    From bursts logged behind the filters.
    """
    behind = burst_spectra(
        [b for b in log.vibration.bursts if b.sensor == "gyro" and b.unit == spectra.unit and b.filtered], within
    )
    if behind is None:
        return None

    def power(of: Spectra) -> float:
        near = np.abs(of.frequency - peak.frequency) <= frequency_tolerance(of, peak.frequency)
        return float(median(of.total[:, near].sum(axis=1)) * of.step)

    return 10.0 * float(np.log10(power(spectra) / max(power(behind), 1e-12)))


def _notch_offer(log: FlightLog, spectra: Spectra, peak: Peak) -> Check:
    """Return the check that proposes notch parameters, or why none exist."""
    values = notch_parameters(log, wanted_notch(log, spectra, peak))
    settings = [Setting(n, log.param(n), value, unit) for n, (value, unit) in values.items()]
    changed = [s for s in settings if s.old is None or abs(s.old - s.new) > 1e-3 * max(1.0, abs(s.new))]
    whose = "the rotors" if peak.follows == "rotors" else "throttle"
    text = f"The gyro vibrates by {peak.rms:.1f} deg/s at {peak.true:.0f} Hz, which follows {whose}."
    evidence = [
        f"{peak.height:.0f} dB above the floor in {100 * peak.share:.0f} % of {len(spectra.t)} windows: {peak.why}."
    ]
    found = _notch_check("warning", text, spectra, evidence, peak)
    if not settings:
        found.why_no_setting = "This firmware's log names no notch parameter that could be set for it."
        return found
    if not changed:
        found.verdict, found.text = "ok", f"The notch for the gyro's peak at {peak.true:.0f} Hz is set already."
        return found
    found.settings = changed
    found.action = "Set the notch, reboot, hover for a minute and compare the gyro before and behind the filters."
    found.action = f"{advise_reboot({s.name: s.new for s in changed})} {found.action}".strip()
    return found


def wanted_notch(log: FlightLog, spectra: Spectra, peak: Peak) -> WantedNotch:
    """Return the notch for a peak whose frequency is known."""
    speeds = rotor_speeds(log, spectra)
    throttle = (
        None
        if log.power.throttle is None or len(log.power.throttle.t) < 2
        else window_means(log.power.throttle, spectra)[:, 0]
    )
    places = track_peak(spectra, peak.frequency)
    places = places[np.isfinite(places)]
    return WantedNotch(
        peak.true or peak.frequency,
        "rotors" if peak.follows == "rotors" else "throttle",
        None if throttle is None or not np.isfinite(throttle).any() else float(nanmedian(throttle)),
        peak.harmonic,
        None if speeds is None else float(quantile(speeds[~np.isnan(speeds)], 0.05)),
        float(np.ptp(quantile(places, [0.05, 0.95]))) if len(places) else 0.0,
    )


def _unknown_notch(why: str, log: FlightLog) -> Check:
    """Return a refusal with what to log."""
    check = unknown("notch", why, NOTCH_LIMIT, sensor="GYR", source=NOTCH_SOURCE)
    check.why_no_setting = check.action = advise_fast_gyro(log)
    return check


def _notch_check(verdict: Verdict, text: str, spectra: Spectra, evidence: list[str], peak: Peak | None = None) -> Check:
    check = Check("notch", verdict, text, threshold=NOTCH_LIMIT, evidence=evidence, sensor=f"GYR.{spectra.unit}")
    check.n, check.seconds = len(spectra.t), round(len(spectra.t) * spectra.seconds, 1)
    check.source = NOTCH_SOURCE
    if peak is not None:
        check.value = None if peak.true is None else round(peak.true, 1)
        check.unit, check.ci95 = "Hz", frequency_interval(spectra, peak)
    return check


# The gyro's spectrum.

PEAK_LIMIT = f"a peak stands {PROMINENT_DB:.0f} dB above its floor"
FOLLOWS_TEXT = {
    "throttle": "follows throttle",
    "rotors": "follows the rotors",
    "nothing": "does not follow throttle",
    "": "cannot be compared with throttle",
}


def gyro_spectrum(case: HealthCase) -> list[Check]:
    """Check the peaks of every gyro's fastest source, with their true frequencies where those are known."""
    log, within = case.log, sound_flight(case.segments, case.log)
    if not within or not log.kind.flies:
        return []  # without flight, the vibration level reports it
    sources = all_spectra(log, within)
    if not sources:
        found = unknown("gyro_spectrum", _too_slow(log), PEAK_LIMIT)
        found.action = advise_fast_gyro(log)
        return [found]
    first: dict[int, Spectra] = {}
    for one in sources:
        first.setdefault(one.unit, one)
    return [_spectrum_check(log, one, analyse_peaks(log, one, within)) for one in first.values()]


def _too_slow(log: FlightLog) -> str:
    fastest = max((imu.gyro.rate for imu in log.imus), default=0.0)
    if fastest == 0.0:
        return "This log holds no samples of a gyro."
    if fastest < MIN_RATE_HZ:
        return f"The gyro is logged at {fastest:.0f} Hz: no rotor's vibration can be seen in it."
    return f"No {WINDOW_S:.0f} s of sound flight without a gap are logged."


def _spectrum_check(log: FlightLog, spectra: Spectra, found: list[Peak]) -> Check:
    sensor = f"GYR.{spectra.unit}"
    seen = f"{spectra.source} at {spectra.rate:.0f} Hz, {len(spectra.t)} windows of {spectra.seconds:.1f} s"
    seen += ", behind the autopilot's filters." if spectra.filtered else "."
    made = Check("gyro_spectrum", "ok", "", sensor=sensor, n=len(spectra.t), threshold=PEAK_LIMIT, evidence=[seen])
    made.seconds = round(len(spectra.t) * spectra.seconds, 1)
    if not found:
        made.text = (
            f"Gyro {spectra.unit} shows no peak of {PROMINENT_DB:.0f} dB between {LOWEST_HZ:.0f} and "
            f"{0.48 * spectra.rate:.0f} Hz."
        )
        return made
    top = found[0]
    made.value, made.unit = round(top.true if top.true is not None else top.frequency, 1), "Hz"
    made.ci95 = frequency_interval(spectra, top)
    made.text = f"Gyro {spectra.unit} vibrates most at {made.value:.0f} Hz: {top.rms:.1f} deg/s (1 sigma)."
    if top.true is None:
        others = " or ".join(f"{f:.0f}" for f in top.possible[1:3])
        made.verdict = "unknown"
        made.text = (
            f"Gyro {spectra.unit} shows {top.rms:.1f} deg/s at {top.frequency:.0f} Hz, which may be {others} Hz folded."
        )
        made.action = advise_fast_gyro(log)
        made.why_no_setting = "Samples at twice the highest of these frequencies would show which one it is."
    made.evidence += [_peak_text(p) for p in found]
    return made


def _peak_text(peak: Peak) -> str:
    text = f"{peak.frequency:.0f} Hz: {peak.rms:.2f} deg/s along {'xyz'[peak.axis]}, {peak.height:.0f} dB, "
    text += FOLLOWS_TEXT[peak.follows]
    if peak.true is None:
        return f"{text}; possible {', '.join(f'{f:.0f}' for f in peak.possible)} Hz."
    if abs(peak.true - peak.frequency) > 1.0:
        return f"{text}; truly {peak.true:.0f} Hz: {peak.why}."
    return f"{text}."


def notch_bands(case: HealthCase) -> dict[str, list[tuple[float, float]]]:
    """Return frequency and width in Hz of fixed gyro notches, ``set`` and ``proposed``."""
    log = case.log
    if not all_spectra(log, sound_flight(case.segments, log)):
        return {}
    proposed = fixed_notch({s.name: s.new for check in notch_filter(case) for s in check.settings})
    return {
        "set": [(n.frequency, n.width) for n in active_notches(log) if n.frequency > 0.0],
        "proposed": [] if proposed is None else [proposed[1:]],
    }
