"""Would a notch filter take the rotors' vibration out of the gyro, and with which parameters?

A notch at a false frequency only delays the gyro, so a peak counts where its frequency is known, where it follows
throttle or rotors, is large, and stands on every IMU that could show it.
"""

from __future__ import annotations

import numpy as np

from attlog.flight.model import FlightLog
from attlog.flight.vibration.advice import fast_gyro, filters_gyro
from attlog.flight.vibration.notches import ActiveNotch, notches
from attlog.flight.vibration.wanted import WantedNotch, after_reboot, values_for
from attlog.health.assessments.model import Assessment, HealthCase, Setting, Verdict, unknown
from attlog.health.assessments.vibration.level import flown
from attlog.health.assessments.vibration.origin import LEAST_MOVED, TRUSTED_RATE_HZ, analysed, at_windows, rotors
from attlog.health.assessments.vibration.peaks import Peak, interval, peaks, tolerance, track
from attlog.health.assessments.vibration.spectra import Spectra, all_of, of_bursts
from attlog.segments.spans import Span

LEAST_DPS = 2.0
"""Smaller peaks (1 sigma) are not worth a notch: a low-pass at 40 Hz leaves 0.3 deg/s of them at 100 Hz."""
LEAST_WINDOWS, LEAST_BURSTS = 10, 5
"""So many windows of 2 s, or bursts, must show the peak."""
LOWERED_DB = 6.0
"""A notch that is on lowers a peak by more than this."""
THRESHOLD = f"a peak of {LEAST_DPS:g} deg/s that follows throttle or rotors in 60 % of the windows"
SOURCE = "ardupilot.org, Managing Gyro Noise; docs.px4.io, MC Filter Tuning"


def notch(case: HealthCase) -> list[Assessment]:
    """The notch that would help, the one that does already, or what to log to know."""
    log, within = case.log, flown(case.segments, case.log)
    if not log.kind.hovers or not filters_gyro(log):
        return []
    sources = all_of(log, within)
    if not sources:
        return []  # said once, where the spectrum is asked for
    best = max(sources, key=lambda s: (s.rate >= TRUSTED_RATE_HZ, not s.filtered, s.rate))
    found = analysed(log, best, within)
    active = notches(log)
    strong = [p for p in found if p.rms >= LEAST_DPS]
    if not strong:
        return [_nothing(log, best, active)]
    peak = next((p for p in strong if not _refused(log, best, p, sources)), None)
    covered = [(p, n) for p in strong for n in active if p.true is not None and n.covers(p.true)]
    if covered and (peak is None or any(p is peak for p, _ in covered)):
        return [_covered(log, best, *covered[0], within)]
    measuring = [n for n in active if n.follows == "measurement"]
    if measuring and strong[0].true is None:
        return [_unknown(f"{measuring[0].name} follows what it measures; this log cannot show how well.", log)]
    if peak is None:
        return [_unknown(_refused(log, best, strong[0], sources), log)]
    return [_offer(log, best, peak)]


def _refused(log: FlightLog, spectra: Spectra, peak: Peak, sources: list[Spectra]) -> str:
    """Why a peak gives no notch, a sentence; empty where it does."""
    shown = f"The gyro's peak at {peak.frequency:.0f} Hz"
    if peak.true is None:
        others = " or ".join(f"{f:.0f}" for f in peak.possible[:3])
        return f"{shown} may be one at {others} Hz: {spectra.source} has {spectra.rate:.0f} Hz."
    if len(spectra.t) < least_windows(spectra):
        return f"{shown} is seen in {len(spectra.t)} windows of flight; {least_windows(spectra)} are needed."
    if peak.follows == "nothing":
        return f"{shown} does not follow throttle: a part of the frame or the electronics makes it."
    if peak.windows < LEAST_MOVED:
        return f"Throttle changed too little to see whether the gyro's peak at {peak.frequency:.0f} Hz follows it."
    if not peak.follows:
        return f"{shown} neither follows throttle nor stays where it is."
    beside = [s for s in sources if s.unit != spectra.unit and s.rate >= 0.9 * spectra.rate and not s.filtered]
    for other in beside:
        if not any(abs(p.frequency - peak.frequency) <= tolerance(spectra, peak.frequency) for p in peaks(other)):
            return f"{shown} is not on IMU {other.unit}: it belongs to one sensor, not to the vehicle."
    return ""


def least_windows(spectra: Spectra) -> int:
    """How many windows must show a peak, or the lack of one."""
    return LEAST_BURSTS if spectra.seconds < 1.0 else LEAST_WINDOWS


def _nothing(log: FlightLog, spectra: Spectra, active: list[ActiveNotch]) -> Assessment:
    """No strong peak: what that means depends on what the source could have shown."""
    if spectra.rate < TRUSTED_RATE_HZ:
        return _unknown(f"{spectra.source} at {spectra.rate:.0f} Hz is too slow to show the rotors' vibration.", log)
    if len(spectra.t) < least_windows(spectra):
        return _unknown(f"{len(spectra.t)} windows of flight show no peak; {least_windows(spectra)} are needed.", log)
    text = f"No peak of the gyro reaches {LEAST_DPS:g} deg/s in flight, so that no further notch is needed."
    if spectra.filtered:
        text = f"Behind the filters no peak of the gyro reaches {LEAST_DPS:g} deg/s in flight."
    return _assessed("ok", text, spectra, evidence=[f"{n.name} is on." for n in active])


def _covered(log: FlightLog, spectra: Spectra, peak: Peak, active: ActiveNotch, within: list[Span]) -> Assessment:
    """A notch that is on already, and by how much it lowers the peak where bursts behind the filters tell."""
    text = f"{active.name} covers the gyro's peak at {peak.true:.0f} Hz already."
    if active.follows == "measurement":
        text = f"{active.name} follows the gyro's peak at {peak.true:.0f} Hz already."
    verdict: Verdict = "ok"
    evidence, lowered = [f"The peak is {peak.rms:.1f} deg/s before the filters."], reduction(log, spectra, peak, within)
    if lowered is not None:
        evidence.append(f"Behind the filters it is {lowered:.0f} dB lower.")
        if lowered < LOWERED_DB:
            verdict = "warning"
            text = f"{active.name} is on, but lowers the peak at {peak.true:.0f} Hz by only {lowered:.0f} dB."
    return _assessed(verdict, text, spectra, peak, evidence=evidence)


def reduction(log: FlightLog, spectra: Spectra, peak: Peak, within: list[Span]) -> float | None:
    """How many dB lower a peak is behind the autopilot's filters, by bursts from there; None without them."""
    behind = of_bursts([b for b in log.bursts if b.sensor == "gyro" and b.unit == spectra.unit and b.filtered], within)
    if behind is None:
        return None

    def power(of: Spectra) -> float:
        near = np.abs(of.frequency - peak.frequency) <= tolerance(of, peak.frequency)
        return float(np.median(of.total[:, near].sum(axis=1)) * of.step)

    return 10.0 * float(np.log10(power(spectra) / max(power(behind), 1e-12)))


def _offer(log: FlightLog, spectra: Spectra, peak: Peak) -> Assessment:
    """The parameters of a notch for a peak, or why this firmware has none."""
    values = values_for(log, wanted(log, spectra, peak))
    settings = [Setting(n, log.param(n), value, unit) for n, (value, unit) in values.items()]
    changed = [s for s in settings if s.old is None or abs(s.old - s.new) > 1e-3 * max(1.0, abs(s.new))]
    whose = "the rotors" if peak.follows == "rotors" else "throttle"
    text = f"The gyro vibrates by {peak.rms:.1f} deg/s at {peak.true:.0f} Hz, which follows {whose}."
    evidence = [
        f"{peak.height:.0f} dB above the floor in {100 * peak.share:.0f} % of {len(spectra.t)} windows: {peak.why}."
    ]
    found = _assessed("warning", text, spectra, peak, evidence=evidence)
    if not settings:
        found.why_no_setting = "This firmware's log names no notch parameter that could be set for it."
        return found
    if not changed:
        found.verdict, found.text = "ok", f"The notch for the gyro's peak at {peak.true:.0f} Hz is set already."
        return found
    found.settings = changed
    found.action = "Set the notch, reboot, hover for a minute and compare the gyro before and behind the filters."
    found.action = f"{after_reboot({s.name: s.new for s in changed})} {found.action}".strip()
    return found


def wanted(log: FlightLog, spectra: Spectra, peak: Peak) -> WantedNotch:
    """The notch for a peak whose frequency is known."""
    speeds = rotors(log, spectra)
    throttle = None if log.throttle is None or len(log.throttle.t) < 2 else at_windows(log.throttle, spectra)[:, 0]
    places = track(spectra, peak.frequency)
    places = places[np.isfinite(places)]
    return WantedNotch(
        peak.true or peak.frequency,
        "rotors" if peak.follows == "rotors" else "throttle",
        None if throttle is None or not np.isfinite(throttle).any() else float(np.nanmedian(throttle)),
        peak.harmonic,
        None if speeds is None else float(np.nanquantile(speeds, 0.05)),
        float(np.ptp(np.quantile(places, [0.05, 0.95]))) if len(places) else 0.0,
    )


def _unknown(why: str, log: FlightLog) -> Assessment:
    """A refusal with what to log."""
    found = unknown("GYR", "notch", why, THRESHOLD, SOURCE)
    found.why_no_setting = found.action = fast_gyro(log)
    return found


def _assessed(
    verdict: Verdict, text: str, spectra: Spectra, peak: Peak | None = None, evidence: list[str] | None = None
) -> Assessment:
    return Assessment(
        f"GYR.{spectra.unit}",
        "notch",
        verdict,
        text,
        None if peak is None or peak.true is None else round(peak.true, 1),
        "" if peak is None else "Hz",
        None if peak is None else interval(spectra, peak),
        n=len(spectra.t),
        seconds=round(len(spectra.t) * spectra.seconds, 1),
        threshold=THRESHOLD,
        source=SOURCE,
        evidence=evidence or [],
    )
