"""GNSS receivers in flight: fix, satellites and accuracies, jamming and spoofing, jumps of the position."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import median, quantile
from attlog.core.spans import Span, inside
from attlog.flight import aiding
from attlog.flight.model import FIX_3D, Array, FlightLog, Gnss
from attlog.health.check import Check, HealthCase, Verdict, unknown
from attlog.health.flown import driven_spans, held_seconds
from attlog.story.estimator_events import is_link_loss

# Minimum fixes for a 5th percentile.
MIN_FIXES = 20
# Minimum outage; shorter ones are late messages.
MIN_OUTAGE_S = 3.0
# Records are missing from this number of usual intervals on.
MAX_USUAL_INTERVALS = 5.0
SILENT_CAUSE = "The receiver, its cable or its driver stopped; the fix before and after is sound."
QUALITY_LIMIT = "ok: as good as the firmware requires for take-off in 95 % of the flight, and no loss above 3 s"
# States of jamming and spoofing that receivers report.
SEEN_STATE, WARNING_STATE, CRITICAL_STATE = 1, 2, 3
# Minimum duration of a state, more than two records.
MIN_JAMMED_S = 1.0
# A warning of jamming counts where the fix is worse meanwhile: accuracy by this factor, or satellites by this number.
# u-blox indicates it beside sound fixes (UBX-MON-HW, jammingState 2: interference visible but fix OK).
WORSE_ACCURACY, WORSE_SATELLITES = 1.5, 3.0
INTERFERENCE_LIMIT = (
    "ok: less than 1 s of spoofing, or of jamming that is critical or worsens the fix; fault: critical, or spoofing"
)
# Mean radius of the earth.
EARTH_M = 6.371e6
# Jump of a fix against the previous one plus mean velocity: minimum size, significance, maximum interval.
JUMP_M, JUMP_SIGMAS, MAX_FIX_INTERVAL_S = 3.0, 5.0, 1.5
# Steps within this time are one jump; a jump is at least this share of the largest.
ONE_JUMP_S, MIN_JUMP_SHARE = 2.0, 1.0 / 3.0
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


def gnss_outages(gnss: Gnss, flights: list[Span], log: FlightLog) -> tuple[list[Span], list[Span]]:
    """Return spans in flight with records but no 3D fix, and spans without records.

    Pauses of a radio link or of the logger are neither.
    """
    t: NDArray[np.float64] = gnss.t[gnss.fix >= FIX_3D]
    unfixed: NDArray[np.float64] = gnss.t[gnss.fix < FIX_3D]
    usual = float(median(np.diff(gnss.t))) if len(gnss.t) > 1 else math.inf
    lost: list[Span] = []
    silent: list[Span] = []
    for begin, end in flights:
        edges = np.concatenate([[begin], t[(t > begin) & (t < end)], [end]])
        for a, b in pairwise(edges.tolist()):
            if b - a <= MIN_OUTAGE_S:
                continue
            if ((unfixed > a) & (unfixed < b)).any():
                lost.append((a, b))
            elif b - a > MAX_USUAL_INTERVALS * usual and not is_link_loss(log, a, b):
                silent.append((a, b))
    return lost, silent


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
    no_fix, silent = gnss_outages(receiver, flown, log)
    lost = no_fix or silent
    if lost:
        check.verdict, check.t, check.count = "warning", round(lost[0][0], 1), len(lost)
        with_fix = [check.text, *check.evidence] if bad else [f"With a fix it has {', '.join(words)} (95 %)."]
        seconds = sum(b - a for a, b in lost)
        times = "" if len(lost) == 1 else f" in {len(lost)} outages"
        what = "GNSS had no fix" if no_fix else "No GNSS message arrived"
        check.text = f"{what} for {seconds:.0f} s in flight{times}, first at {lost[0][0]:.0f} s."
        if not no_fix:
            check.cause = SILENT_CAUSE
            check.action = "Check cable, power and baud rate of the receiver."
        check.value, check.unit, check.evidence = round(seconds, 1), "s", with_fix
    return check


def _number(x: float) -> str:
    """Format with two significant digits, integers in full."""
    return f"{x:.0f}" if x >= 10.0 or x == round(x) else f"{x:.2g}"


def _percentile(x: Array, percent: float) -> float:
    known = x[np.isfinite(x)]
    return float(quantile(known, percent / 100)) if len(known) else math.nan


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
        if name == "jamming" and not critical and not _is_worse(receiver, use, on):
            check.evidence.append(f"It warned of jamming for {seconds:.0f} s, but the fix was no worse.")
            continue
        check.verdict = "fault" if name == "spoofing" or critical else "warning"
        check.t, check.value, check.unit = round(float(t[on][0]), 1), round(seconds, 1), "s"
        check.text = f"The receiver reports {name} for {seconds:.0f} s in flight, first at {t[on][0]:.0f} s."
        check.why_no_setting = "Look for transmitters near the antenna; do not rely on position modes there."
    return [check]


def _is_worse(receiver: Gnss, use: NDArray[np.bool_], on: NDArray[np.bool_]) -> bool:
    """Return whether fix, accuracy or satellites are worse at the records ``on`` of those in ``use``."""
    if (receiver.fix[use][on] < FIX_3D).any():
        return True
    accuracies = [x[use] for x in (receiver.h_acc, receiver.s_acc)]
    satellites = np.full(len(on), np.nan) if receiver.reception is None else receiver.reception.satellites[use]
    worse = [_median(x[on]) > WORSE_ACCURACY * _median(x[~on]) for x in accuracies]
    return any(worse) or _median(satellites[on]) <= _median(satellites[~on]) - WORSE_SATELLITES


def _median(x: Array) -> float:
    known = x[np.isfinite(x)]
    return float(median(known)) if len(known) else math.nan


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
    usual, largest = float(median(size)), float(size.max(initial=0.0))
    steps = t[1:][size > max(JUMP_M, JUMP_SIGMAS * usual, MIN_JUMP_SHARE * largest)]
    jumps = int(np.count_nonzero(np.diff(steps, prepend=-np.inf) > ONE_JUMP_S))
    verdict: Verdict = "warning" if jumps else "ok"
    text = f"The largest step of the GNSS position beside its velocity is {largest:.1f} m in flight."
    check = Check("gnss_jumps", verdict, text, round(largest, 1), "m", JUMP_LIMIT, sensor=receiver.source)
    check.n, check.seconds = len(size), round(float(dt[dt < MAX_FIX_INTERVAL_S].sum()), 1)
    check.source = "GNSS position against GNSS velocity"
    if jumps:
        at = float(t[1:][int(np.argmax(size))])
        check.t = round(float(steps[0]), 1)
        times = "once" if jumps == 1 else "twice" if jumps == 2 else f"{jumps} times"
        check.text = f"The GNSS position jumps {times} in flight, by up to {check.value:.0f} m at {at:.0f} s."
        check.evidence = [f"Usually it is {usual:.2f} m beside its velocity from fix to fix."]
        check.why_no_setting = "Give the antenna free sky; a ground plane helps against reflections."
    return [check]


def _wrapped(degrees: Array) -> Array:
    """Wrap longitude differences (n,) in deg to +-180."""
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)
