"""GNSS receivers: fix, satellites, accuracies, jamming and spoofing, jumps of the position."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.core.spans import Span, inside
from attlog.flight import aiding
from attlog.flight.model import Array, FlightLog, Gnss
from attlog.health import delays
from attlog.health.check import Check, HealthCase, unknown

MIN_OUTAGE_S = 3.0
"""A shorter outage is a late message."""
THREE_DIMENSIONAL = 3


def gnss_outages(gnss: Gnss, flights: list[tuple[float, float]], log: FlightLog) -> list[tuple[float, float]]:
    """Spans (t0, t1) s in flight without a 3D fix, from the last fix to the next; pauses of the logger are none."""
    t: NDArray[np.float64] = gnss.t[gnss.fix >= THREE_DIMENSIONAL]
    imu = log.replay_imu
    found = []
    for begin, end in flights:
        inside = t[(t > begin) & (t < end)]
        edges = np.concatenate([[begin], inside, [end]])
        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            if b - a > MIN_OUTAGE_S and (imu is None or not _logger_paused(imu.gyro.t, a, b)):
                found.append((a, b))
    return found


def _logger_paused(t: NDArray[np.float64], begin: float, end: float) -> bool:
    """Whether the inertial samples at ``t`` leave out half of a span, so that nothing at all was logged then."""
    inside = np.concatenate([[begin], t[(t > begin) & (t < end)], [end]])
    return float(np.diff(inside).max()) > 0.5 * (end - begin)


# Is GNSS any good: satellites, dilution, accuracies, loss; jamming and spoofing; jumps of the position?

QUALITY, INTERFERENCE, JUMPS = "gnss_quality", "gnss_interference", "gnss_jumps"
FIX_3D, MIN_FIXES = 3, 20
EARTH_M = 6.371e6


QUALITY_LIMIT = "ok: in 95 % of the flight as good as the firmware asks before take-off, and no loss above 3 s"
WARNING_STATE, CRITICAL_STATE = 2, 3
JAMMED_S = 1.0
INTERFERENCE_LIMIT = "ok: the receiver names no jamming and no spoofing for 1 s; fault: critical, or spoofing"
JUMP_M, JUMP_SIGMAS, MAX_FIX_INTERVAL_S = 3.0, 5.0, 1.5
"""A fix this far from where its velocity leads from the fix before; fixes further apart in time are not compared."""
JUMP_LIMIT = f"ok: no step above {JUMP_M:.0f} m and {JUMP_SIGMAS:.0f} times its usual size"


def gnss_checks(case: HealthCase) -> list[Check]:
    """Quality, interference and jumps of each receiver that had a fix; nothing where nothing flew."""
    flown = delays.flight_spans(case)
    found: list[Check] = []
    for receiver in case.log.gnss:
        use = inside(receiver.t, flown)
        if use.sum() >= MIN_FIXES and (receiver.fix >= FIX_3D).any():
            found += [_quality(case, receiver, flown, use), *_interference(receiver, use), *_jumps(case, receiver, use)]
    return found


def _quality(case: HealthCase, receiver: Gnss, flown: list[Span], use: np.ndarray) -> Check:
    """Each number's worse end (5th or 95th percentile) against what the firmware needs, while there is a fix.

    Without one receivers tell no satellites and accuracies of 100 m: that is the loss, told by itself.
    """
    needs = aiding.gnss_requirements(case.log)
    use = use & (receiver.fix >= FIX_3D)
    numbers: list[tuple[str, float, str, bool]] = []
    reception = receiver.reception
    if reception is not None:
        satellites, hdop = _percentile(reception.satellites[use], 5.0), _percentile(reception.hdop[use], 95.0)
        numbers.append(("satellites", satellites, "", satellites < needs.satellites))
        numbers.append(("HDOP", hdop, "", hdop > needs.hdop))
    s_acc, h_acc = _percentile(receiver.s_acc[use], 95.0), _percentile(receiver.h_acc[use], 95.0)
    numbers.append(("speed accuracy", s_acc, " m/s", s_acc > needs.speed))
    numbers.append(("position accuracy", h_acc, " m", h_acc > needs.place))
    known = [one for one in numbers if math.isfinite(one[1])]
    lost = gnss_outages(receiver, flown, case.log)
    if not known:
        return unknown(
            QUALITY, "The log holds no satellites and no accuracy of GNSS.", QUALITY_LIMIT, sensor=receiver.source
        )
    words = [f"{name} {_number(value)}{unit}" for name, value, unit, _ in known]
    bad = [word for word, one in zip(words, known, strict=True) if one[3]]
    told = Check(
        QUALITY, "ok", "", sensor=receiver.source, n=int(use.sum()), threshold=QUALITY_LIMIT, source=needs.source
    )
    told.seconds = round(float(sum(b - a for a, b in flown)), 1)
    told.value, told.unit = (
        round(known[0][1], 2),
        known[0][0] if known[0][0] in ("satellites", "HDOP") else known[0][2].strip(),
    )
    told.text = f"GNSS is good enough in 95 % of the flight: {', '.join(words)}."
    if bad:
        told.verdict = "warning"
        told.text = f"GNSS is poor in 5 % of the flight: {', '.join(bad)}."
        told.evidence = [f"All of it: {', '.join(words)}."]
        told.why_no_setting = "Give the antenna free sky and distance from transmitters and USB 3."
    if lost:
        told.verdict, told.t = "warning", round(lost[0][0], 1)
        seconds = sum(b - a for a, b in lost)
        if bad:
            told.evidence.insert(0, told.text)
        else:
            told.evidence = [f"With a fix it has {', '.join(words)} (95 %)."]
        times = "" if len(lost) == 1 else f" in {len(lost)} outages"
        told.text = f"GNSS had no fix for {seconds:.0f} s in flight{times}, first at {lost[0][0]:.0f} s."
        told.count = len(lost)
        told.value, told.unit = round(seconds, 1), "s"
    return told


def _number(x: float) -> str:
    """Two digits, of whole numbers all."""
    return f"{x:.0f}" if x >= 10.0 or x == round(x) else f"{x:.2g}"


def _percentile(x: Array, percent: float) -> float:
    known = x[np.isfinite(x)]
    return float(np.percentile(known, percent)) if len(known) else math.nan


def _interference(receiver: Gnss, use: np.ndarray) -> list[Check]:
    """Jamming and spoofing by the receiver's own word; nothing where it says nothing."""
    reception = receiver.reception
    if reception is None:
        return []
    t = receiver.t[use]
    held = delays.held_seconds(t)
    states = {"jamming": reception.jamming_state[use], "spoofing": reception.spoofing_state[use]}
    told = [name for name, state in states.items() if np.any(state >= 1)]
    level, noise = _percentile(reception.jamming[use], 95.0), _percentile(reception.noise[use], 50.0)
    if not told:
        return []
    found = Check(INTERFERENCE, "ok", "", sensor=receiver.source, n=int(use.sum()), threshold=INTERFERENCE_LIMIT)
    found.source, found.seconds = "the receiver's own jamming and spoofing state", round(float(held.sum()), 1)
    found.text = f"The receiver reports no {' and no '.join(told)} in flight."
    if level > 0.0 or noise > 0.0:
        found.evidence = [f"Its jamming indicator is {level:.0f} of 255 (95th percentile), its noise {noise:.0f}."]
    for name in told:
        on = states[name] >= WARNING_STATE
        seconds = float(held[on].sum())
        if seconds < JAMMED_S:
            continue
        worst = float(np.nanmax(states[name]))
        found.verdict = "fault" if name == "spoofing" or worst >= CRITICAL_STATE else "warning"
        found.t, found.value, found.unit = round(float(t[on][0]), 1), round(seconds, 1), "s"
        found.text = f"The receiver reports {name} for {seconds:.0f} s in flight, first at {t[on][0]:.0f} s."
        found.why_no_setting = "Look for transmitters near the antenna; do not rely on position modes there."
    return [found]


def _jumps(case: HealthCase, receiver: Gnss, use: np.ndarray) -> list[Check]:
    """Steps between successive fixes that their mean velocity does not explain."""
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
    usual = float(np.median(size))
    limit = max(JUMP_M, JUMP_SIGMAS * usual)
    beyond = np.flatnonzero(size > limit)
    told = Check(JUMPS, "ok", "", sensor=receiver.source, unit="m", n=len(size), threshold=JUMP_LIMIT)
    told.source, told.seconds = (
        "GNSS position against GNSS velocity",
        round(float(dt[dt < MAX_FIX_INTERVAL_S].sum()), 1),
    )
    told.value = round(float(size.max(initial=0.0)), 1)
    told.text = f"The largest step of the GNSS position beside its velocity is {told.value:.1f} m in flight."
    if len(beyond):
        at = float(t[1:][int(np.argmax(size))])
        told.verdict, told.t = "warning", round(at, 1)
        told.text = f"The GNSS position jumps {len(beyond)} times in flight, by up to {told.value:.0f} m at {at:.0f} s."
        told.evidence = [f"Usually it is {usual:.2f} m beside its velocity from fix to fix."]
        told.why_no_setting = "Give the antenna free sky; a ground plane helps against reflections."
    return [told]


def _wrapped(degrees: Array) -> Array:
    """Differences of longitudes (n,) within half a turn."""
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)
