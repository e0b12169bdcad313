"""GNSS receivers in flight: fix, satellites and accuracies, jamming and spoofing, jumps of the position."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.core.spans import Span, inside
from attlog.flight import aiding
from attlog.flight.model import FIX_3D, Array, FlightLog, Gnss
from attlog.health.check import Check, HealthCase, Verdict, unknown
from attlog.health.flown import driven_spans, held_seconds

# Minimum fixes for a 5th percentile.
MIN_FIXES = 20
# Minimum outage; shorter ones are late messages.
MIN_OUTAGE_S = 3.0
QUALITY_LIMIT = "ok: in 95 % of the flight as good as the firmware asks before take-off, and no loss above 3 s"
# States of jamming and spoofing that receivers report.
SEEN_STATE, WARNING_STATE, CRITICAL_STATE = 1, 2, 3
# Minimum duration of a state, more than two records.
MIN_JAMMED_S = 1.0
INTERFERENCE_LIMIT = "ok: the receiver names no jamming and no spoofing for 1 s; fault: critical, or spoofing"
# Mean radius of the earth.
EARTH_M = 6.371e6
# Jump of a fix against the previous one plus mean velocity: minimum size, significance, maximum interval.
JUMP_M, JUMP_SIGMAS, MAX_FIX_INTERVAL_S = 3.0, 5.0, 1.5
JUMP_LIMIT = f"ok: no step above {JUMP_M:.0f} m and {JUMP_SIGMAS:.0f} times its usual size"


def gnss_checks(case: HealthCase) -> list[Check]:
    """Check quality, interference and jumps of each receiver that had a fix; nothing where nothing flew."""
    flown = driven_spans(case)
    found: list[Check] = []
    for receiver in case.log.gnss:
        use = inside(receiver.t, flown)
        if use.sum() >= MIN_FIXES and (receiver.fix >= FIX_3D).any():
            found.append(_quality(case.log, receiver, flown, use & (receiver.fix >= FIX_3D)))
            found += [*_interference(receiver, use), *_jumps(receiver, use)]
    return found


def gnss_outages(gnss: Gnss, flights: list[Span], log: FlightLog) -> list[Span]:
    """Return spans in flight without a 3D fix, except pauses of the logger."""
    t: NDArray[np.float64] = gnss.t[gnss.fix >= FIX_3D]
    imu = log.replay_imu
    found = []
    for begin, end in flights:
        edges = np.concatenate([[begin], t[(t > begin) & (t < end)], [end]])
        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            if b - a <= MIN_OUTAGE_S:
                continue
            if imu is not None:
                stamps = np.concatenate([[a], imu.gyro.t[(imu.gyro.t > a) & (imu.gyro.t < b)], [b]])
                if np.diff(stamps).max() > 0.5 * (b - a):
                    continue  # the logger paused
            found.append((a, b))
    return found


def _quality(log: FlightLog, receiver: Gnss, flown: list[Span], fixed: NDArray[np.bool_]) -> Check:
    """Check 5th or 95th percentiles of GNSS quality against the firmware's requirements.

    Only records with a fix count, because others report zero satellites and 100 m accuracy; outages are checked apart.
    """
    needs, reception = aiding.gnss_requirements(log), receiver.reception
    numbers: list[tuple[str, float, str, bool]] = []
    if reception is not None:
        satellites, hdop = _percentile(reception.satellites[fixed], 5.0), _percentile(reception.hdop[fixed], 95.0)
        numbers.append(("satellites", satellites, "", satellites < needs.satellites))
        numbers.append(("HDOP", hdop, "", hdop > needs.hdop))
    s_acc, h_acc = _percentile(receiver.s_acc[fixed], 95.0), _percentile(receiver.h_acc[fixed], 95.0)
    numbers.append(("speed accuracy", s_acc, " m/s", s_acc > needs.speed))
    numbers.append(("position accuracy", h_acc, " m", h_acc > needs.place))
    known = [one for one in numbers if math.isfinite(one[1])]
    if not known:
        why = "The log holds no satellites and no accuracy of GNSS."
        return unknown("gnss_quality", why, QUALITY_LIMIT, sensor=receiver.source)
    words = [f"{name} {_number(value)}{unit}" for name, value, unit, _ in known]
    bad = [word for word, one in zip(words, known, strict=True) if one[3]]
    name, value, unit, _ = known[0]
    check = Check("gnss_quality", "ok", f"GNSS is good enough in 95 % of the flight: {', '.join(words)}.")
    check.value, check.unit = round(value, 2), name if name in ("satellites", "HDOP") else unit.strip()
    check.threshold, check.source, check.sensor = QUALITY_LIMIT, needs.source, receiver.source
    check.n, check.seconds = int(fixed.sum()), round(float(sum(b - a for a, b in flown)), 1)
    if bad:
        check.verdict = "warning"
        check.text = f"GNSS is poor in 5 % of the flight: {', '.join(bad)}."
        check.evidence = [f"All of it: {', '.join(words)}."]
        check.why_no_setting = "Give the antenna free sky and distance from transmitters and USB 3."
    lost = gnss_outages(receiver, flown, log)
    if lost:
        check.verdict, check.t, check.count = "warning", round(lost[0][0], 1), len(lost)
        with_fix = [check.text, *check.evidence] if bad else [f"With a fix it has {', '.join(words)} (95 %)."]
        seconds = sum(b - a for a, b in lost)
        times = "" if len(lost) == 1 else f" in {len(lost)} outages"
        check.text = f"GNSS had no fix for {seconds:.0f} s in flight{times}, first at {lost[0][0]:.0f} s."
        check.value, check.unit, check.evidence = round(seconds, 1), "s", with_fix
    return check


def _number(x: float) -> str:
    """Format with two significant digits, integers in full."""
    return f"{x:.0f}" if x >= 10.0 or x == round(x) else f"{x:.2g}"


def _percentile(x: Array, percent: float) -> float:
    known = x[np.isfinite(x)]
    return float(np.percentile(known, percent)) if len(known) else math.nan


def _interference(receiver: Gnss, use: NDArray[np.bool_]) -> list[Check]:
    """Check the receiver's reports of jamming and spoofing, if any."""
    reception = receiver.reception
    if reception is None:
        return []
    t = receiver.t[use]
    held = held_seconds(t)
    states = {"jamming": reception.jamming_state[use], "spoofing": reception.spoofing_state[use]}
    reported = [name for name, state in states.items() if np.any(state >= SEEN_STATE)]
    if not reported:
        return []
    check = Check("gnss_interference", "ok", f"The receiver reports no {' and no '.join(reported)} in flight.")
    check.sensor, check.threshold = receiver.source, INTERFERENCE_LIMIT
    check.source, check.n = "the receiver's own jamming and spoofing state", int(use.sum())
    check.seconds = round(float(held.sum()), 1)
    level, noise = _percentile(reception.jamming[use], 95.0), _percentile(reception.noise[use], 50.0)
    if level > 0.0 or noise > 0.0:
        check.evidence = [f"Its jamming indicator is {level:.0f} of 255 (95th percentile), its noise {noise:.0f}."]
    for name in reported:
        on = states[name] >= WARNING_STATE
        seconds = float(held[on].sum())
        if seconds < MIN_JAMMED_S:
            continue
        critical = float(np.nanmax(states[name])) >= CRITICAL_STATE
        check.verdict = "fault" if name == "spoofing" or critical else "warning"
        check.t, check.value, check.unit = round(float(t[on][0]), 1), round(seconds, 1), "s"
        check.text = f"The receiver reports {name} for {seconds:.0f} s in flight, first at {t[on][0]:.0f} s."
        check.why_no_setting = "Look for transmitters near the antenna; do not rely on position modes there."
    return [check]


def _jumps(receiver: Gnss, use: NDArray[np.bool_]) -> list[Check]:
    """Check position steps between fixes against their mean velocity."""
    k = np.flatnonzero(use & (receiver.fix >= FIX_3D) & np.isfinite(receiver.lat + receiver.vel_ned[:, 0]))
    if len(k) < MIN_FIXES:
        return []
    t, v = receiver.t[k], receiver.vel_ned[k, :2]
    north = np.radians(receiver.lat[k] - receiver.lat[k[0]]) * EARTH_M
    east = np.radians(_wrapped(receiver.lon[k] - receiver.lon[k[0]])) * EARTH_M
    place = np.column_stack([north, east * np.cos(np.radians(receiver.lat[k[0]]))])
    dt = np.diff(t)
    left = np.diff(place, axis=0) - 0.5 * (v[1:] + v[:-1]) * dt[:, None]
    size = np.where((dt > 0.0) & (dt < MAX_FIX_INTERVAL_S), np.hypot(left[:, 0], left[:, 1]), 0.0)
    usual, largest = float(np.median(size)), float(size.max(initial=0.0))
    jumps = int(np.count_nonzero(size > max(JUMP_M, JUMP_SIGMAS * usual)))
    verdict: Verdict = "warning" if jumps else "ok"
    text = f"The largest step of the GNSS position beside its velocity is {largest:.1f} m in flight."
    check = Check("gnss_jumps", verdict, text, round(largest, 1), "m", JUMP_LIMIT, sensor=receiver.source)
    check.n, check.seconds = len(size), round(float(dt[dt < MAX_FIX_INTERVAL_S].sum()), 1)
    check.source = "GNSS position against GNSS velocity"
    if jumps:
        at = float(t[1:][int(np.argmax(size))])
        check.t = round(at, 1)
        check.text = f"The GNSS position jumps {jumps} times in flight, by up to {check.value:.0f} m at {at:.0f} s."
        check.evidence = [f"Usually it is {usual:.2f} m beside its velocity from fix to fix."]
        check.why_no_setting = "Give the antenna free sky; a ground plane helps against reflections."
    return [check]


def _wrapped(degrees: Array) -> Array:
    """Wrap longitude differences (n,) in deg to +-180."""
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)
