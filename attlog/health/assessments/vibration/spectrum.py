"""At which frequencies does the gyro vibrate in flight, and how sure is each of them?"""

from __future__ import annotations

import numpy as np

from attlog.flight.model import FlightLog
from attlog.flight.vibration.advice import fast_gyro
from attlog.flight.vibration.notches import notches
from attlog.flight.vibration.wanted import placed
from attlog.health.assessments.model import Assessment, HealthCase, Setting, unknown
from attlog.health.assessments.vibration.level import MOST_POINTS, flown
from attlog.health.assessments.vibration.notch import notch
from attlog.health.assessments.vibration.origin import analysed, rotors
from attlog.health.assessments.vibration.peaks import LOWEST_HZ, PROMINENT_DB, Peak, interval
from attlog.health.assessments.vibration.spectra import LEAST_RATE_HZ, WINDOW_S, Spectra, all_of

LIMIT = f"a peak stands {PROMINENT_DB:.0f} dB above its floor"
FOLLOWS = {
    "throttle": "follows throttle",
    "rotors": "follows the rotors",
    "nothing": "does not follow throttle",
    "": "cannot be compared with throttle",
}


def gyro_spectrum(case: HealthCase) -> list[Assessment]:
    """The peaks of every gyro's fastest source, with their true frequencies where those are known."""
    log, within = case.log, flown(case.segments, case.log)
    if not within or not log.kind.flies:
        return []  # without flight the level says so already, and for all questions of vibration
    sources = all_of(log, within)
    if not sources:
        found = unknown("", "gyro_spectrum", _too_slow(log), LIMIT)
        found.action = fast_gyro(log)
        return [found]
    first: dict[int, Spectra] = {}
    for one in sources:
        first.setdefault(one.unit, one)
    return [_described(log, one, analysed(log, one, within)) for one in first.values()]


def _too_slow(log: FlightLog) -> str:
    fastest = max((imu.gyro.rate for imu in log.imus), default=0.0)
    if fastest == 0.0:
        return "This log holds no samples of a gyro."
    if fastest < LEAST_RATE_HZ:
        return f"The gyro is logged at {fastest:.0f} Hz: no rotor's vibration can be seen in it."
    return f"No {WINDOW_S:.0f} s of sound flight without a gap are logged."


def _described(log: FlightLog, spectra: Spectra, found: list[Peak]) -> Assessment:
    sensor = f"GYR.{spectra.unit}"
    seen = f"{spectra.source} at {spectra.rate:.0f} Hz, {len(spectra.t)} windows of {spectra.seconds:.1f} s"
    seen += ", behind the autopilot's filters." if spectra.filtered else "."
    made = Assessment(
        sensor, "gyro_spectrum", "ok", "", n=len(spectra.t), seconds=round(len(spectra.t) * spectra.seconds, 1),
        threshold=LIMIT, evidence=[seen],
    )  # fmt: skip
    if not found:
        made.text = (
            f"Gyro {spectra.unit} shows no peak of {PROMINENT_DB:.0f} dB between {LOWEST_HZ:.0f} and "
            f"{0.48 * spectra.rate:.0f} Hz."
        )
        return made
    top = found[0]
    made.value, made.unit = round(top.true if top.true is not None else top.frequency, 1), "Hz"
    made.ci95 = interval(spectra, top)
    made.text = f"Gyro {spectra.unit} vibrates most at {made.value:.0f} Hz: {top.rms:.1f} deg/s (1 sigma)."
    if top.true is None:
        others = " or ".join(f"{f:.0f}" for f in top.possible[1:3])
        made.verdict = "unknown"
        made.text = (
            f"Gyro {spectra.unit} shows {top.rms:.1f} deg/s at {top.frequency:.0f} Hz, which may be {others} Hz folded."
        )
        made.action = fast_gyro(log)
        made.why_no_setting = "Samples at twice the highest of these frequencies would show which one it is."
    made.evidence += [_sentence(p) for p in found]
    return made


def _sentence(peak: Peak) -> str:
    told = f"{peak.frequency:.0f} Hz: {peak.rms:.2f} deg/s along {'xyz'[peak.axis]}, {peak.height:.0f} dB, "
    told += FOLLOWS[peak.follows]
    if peak.true is None:
        return f"{told}; possible {', '.join(f'{f:.0f}' for f in peak.possible)} Hz."
    if abs(peak.true - peak.frequency) > 1.0:
        return f"{told}; truly {peak.true:.0f} Hz: {peak.why}."
    return f"{told}."


def spectrum(case: HealthCase) -> list[dict[str, object]]:
    """For a figure, one dictionary for each source of gyro and accelerometer, at most 1500 lines each.

    ``sensor``, ``unit``, ``source``, ``rate`` Hz, ``filtered``; ``density_unit``; ``frequency`` (k,) Hz and ``density``
    (k, 3) of the usual window in flight, body axes; ``fold`` Hz: half the rate, what is faster is shown below it;
    ``peaks``: dictionaries of ``frequency``, ``label``, ``possible`` (k,) and ``true`` (None where not known);
    ``rotors``: frequencies in Hz of the first to fourth harmonic; ``notches``: dictionaries of ``name``, ``frequency``,
    ``width`` Hz and ``proposed``.
    """
    log, within = case.log, flown(case.segments, case.log)
    drawn = [
        {"name": n.name, "frequency": n.frequency, "width": n.width, "proposed": False}
        for n in notches(log)
        if n.frequency > 0.0
    ]
    drawn += _proposed([s for a in notch(case) for s in a.settings])
    found: list[dict[str, object]] = []
    for sensor, unit in (("gyro", "(deg/s)^2/Hz"), ("accelerometer", "(m/s^2)^2/Hz")):
        for one in all_of(log, within, sensor):
            step = -(-len(one.frequency) // MOST_POINTS)
            groups = np.arange(0, len(one.frequency), step)
            speeds = rotors(log, one)
            turns = float(np.nanmedian(speeds)) if speeds is not None else 0.0
            found.append({
                "sensor": sensor, "unit": one.unit, "source": one.source, "rate": one.rate, "filtered": one.filtered,
                "density_unit": unit, "frequency": one.frequency[groups],
                "density": np.maximum.reduceat(one.median, groups, axis=0), "fold": 0.5 * one.rate,
                "peaks": [_label(p) for p in analysed(log, one, within)],
                "rotors": [k * turns for k in (1, 2, 3, 4)] if turns else [],
                "notches": drawn if sensor == "gyro" else [],
            })  # fmt: skip
    return found


def _label(peak: Peak) -> dict[str, object]:
    label = f"{peak.frequency:.0f} Hz" + ("" if peak.true is not None else ", folded?")
    return {"frequency": peak.frequency, "label": label, "possible": peak.possible, "true": peak.true}


def _proposed(settings: list[Setting]) -> list[dict[str, object]]:
    """The notch that settings make, none where they have no fixed frequency."""
    found = placed({s.name: s.new for s in settings})
    if found is None:
        return []
    name, frequency, width = found
    return [{"name": name, "frequency": frequency, "width": width, "proposed": True}]
