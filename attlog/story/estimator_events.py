"""Events of the onboard estimator, its aids and failsafes: alignments, resets, switches, rejections, GNSS."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.core.spans import Span, inside
from attlog.flight.model import FIX_3D, FlightLog, Gnss, InnovationTest
from attlog.segments.flight_signs import true_runs
from attlog.segments.model import Segments
from attlog.story.flight_events import (
    ANOMALY,
    BATTERY,
    COMPASS,
    FAILSAFE,
    HARMLESS_WORDS,
    JUMP,
    KILLED,
    LANE,
    REALIGNED,
    Event,
    EventSeverity,
    Text,
    format_time,
    matching_texts,
    quote_text,
)

# --- jumps of GNSS -----------------------------------------------------------------------------------------------

# Window around a report of a GNSS jump: an estimator rejects GNSS for some time before it reports.
JUMP_BEFORE_S, JUMP_AFTER_S = 10.0, 1.0
# Minimum time with fixes before the report.
MIN_FIX_S = 5.0
# Maximum disagreement of a steady GNSS: ArduPilot's EK2_GLITCH_RAD and EK3_GLITCH_RAD are 25 m, and a position drifts
# by some metres in minutes.
MAX_STEADY_M = 5.0
GAP_S = 2.0
# One degree of latitude on a sphere of radius 6,371 km.
M_PER_DEG = 111_195.0


def gnss_disagreement_m(receivers: Sequence[Gnss], t: float) -> float:
    """Return the largest difference in m of position and integrated velocity around ``t`` s.

    Uses the first receiver with gapless positions and velocities from 10 s before to 1 s after; infinite where a fix is
    lost, NaN without such a receiver. A receiver measures velocity (Doppler) independently of position.
    """
    for gnss in receivers:
        near = (gnss.t >= t - JUMP_BEFORE_S) & (gnss.t <= t + JUMP_AFTER_S)
        if not near.any():
            continue
        if (gnss.fix[near] < FIX_3D).any():
            return float("inf")
        use = near & np.isfinite(gnss.lat) & np.isfinite(gnss.lon) & np.isfinite(gnss.vel_ned[:, :2]).all(axis=1)
        stamps = gnss.t[use]
        if len(stamps) < 3 or t - stamps[0] < MIN_FIX_S or np.diff(stamps).max() > GAP_S:
            continue
        return _spread(stamps, gnss.lat[use], gnss.lon[use], gnss.vel_ned[use, :2])
    return float("nan")


def _spread(
    t: NDArray[np.float64], lat: NDArray[np.float64], lon: NDArray[np.float64], velocity: NDArray[np.float64]
) -> float:
    """Return the largest change in m of position minus integrated velocity (n, 2) m/s north and east."""
    north = (lat - lat[0]) * M_PER_DEG
    east = (lon - lon[0]) * M_PER_DEG * np.cos(np.radians(lat[0]))
    moved = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(t)[:, None], axis=0)
    apart = np.column_stack([north, east])
    apart[1:] -= moved
    return float(np.hypot(*np.ptp(apart, axis=0)))


# --- rejected aids -----------------------------------------------------------------------------------------------

# Minimum uninterrupted rejection; single outliers are normal.
MIN_REJECTION_S = 1.0
# Time cut from both ends of a flight: ground contact, and an impact within one record of 5 Hz.
FLIGHT_MARGIN_S = 1.0


@dataclass(frozen=True, slots=True)
class Rejection:
    """Rejection of an aid: spans of at least 1 s, largest test ratio, log record."""

    aid: str
    spans: list[Span]
    worst: float
    source: str
    seconds_flown: float

    @property
    def seconds(self) -> float:
        """Total time in s."""
        return float(sum(b - a for a, b in self.spans))

    @property
    def longest(self) -> float:
        """Longest span in s."""
        return max((b - a for a, b in self.spans), default=0.0)

    @property
    def text(self) -> str:
        """Sentence with duration and largest ratio."""
        first, last = self.spans[0][0], self.spans[-1][1]
        parts = f" in {len(self.spans)} parts of {MIN_REJECTION_S:.0f} s and more ({self.longest:.0f} s on end)"
        times = parts if len(self.spans) > 1 else ""
        return (
            f"The EKF rejected its {self.aid} for {self.seconds:.0f} s of {self.seconds_flown:.0f}{times}, "
            f"{first:.1f} to {last:.1f} s, by up to {self.worst:.1f} times its limit ({self.source})."
        )


def aid_rejections(log: FlightLog, segments: Segments) -> list[Rejection]:
    """Return the rejections, possibly none, of each aid with test ratios in flight."""
    spans = [
        (a + FLIGHT_MARGIN_S, b - FLIGHT_MARGIN_S)
        for a, b in segments.spans("airborne")
        if b - a > 2.0 * FLIGHT_MARGIN_S + MIN_REJECTION_S
    ]
    found = [_rejections_of(test, spans) for test in log.estimator.innovation_tests]
    return [one for one in found if one is not None]


def _rejections_of(test: InnovationTest, flown: list[Span]) -> Rejection | None:
    use = inside(test.t, flown) & np.isfinite(test.ratio)
    if np.count_nonzero(use) < 2:
        return None
    beyond = use & (test.ratio > 1.0)
    pairs = [(float(test.t[a]), float(test.t[b - 1])) for a, b in true_runs(beyond)]
    long = [(a, b) for a, b in pairs if b - a >= MIN_REJECTION_S]
    worst = max((float(test.ratio[beyond & inside(test.t, [pair])].max()) for pair in long), default=0.0)
    return Rejection(test.aid, long, worst, test.source, float(sum(b - a for a, b in flown)))


def rejection_events(log: FlightLog, segments: Segments) -> list[Event]:
    """Return an event for each rejected aid."""
    return [
        Event("aid_rejected", r.spans[0][0], "warning", r.text, r.spans[-1][1], round(r.worst, 2), evidence=[r.source])
        for r in aid_rejections(log, segments)
        if r.spans
    ]


# Texts of an estimator's cores within this time are one event.
TOGETHER_S = 1.5
LOST_S = 2.0
# Codes of problems: ERR 24 of ArduPilot, and PX4's estimator_selector_status.
SWITCHED = ("lane_switch", "estimator_instance_changed")


def onboard_estimator_events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """Return the estimator's events, unordered, and the texts that they quote."""
    quoted: list[Text] = []
    found = [*_realign_events(log, segments, quoted), *_reset_events(segments), *_switch_events(log, segments, quoted)]
    return [
        *found,
        *rejection_events(log, segments),
        *_gnss_lost(log, segments),
        *_gnss_jumps(log, segments, quoted),
    ], quoted


def _group_texts(texts: list[Text]) -> list[list[Text]]:
    """Return groups of texts that follow each other within a few seconds."""
    groups: list[list[Text]] = []
    for text in texts:
        if groups and text[0] - groups[-1][-1][0] <= TOGETHER_S:
            groups[-1].append(text)
        else:
            groups.append([text])
    return groups


def _driven_at(segments: Segments, t: float) -> bool:
    armed = segments.spans("armed") or segments.spans("airborne")
    return bool(inside(np.array([t]), armed).any())


def _realign_events(log: FlightLog, segments: Segments, quoted: list[Text]) -> list[Event]:
    """Return yaw alignments while armed; the first is normal, later ones are warnings."""
    found = []
    texts = matching_texts(log, REALIGNED)
    quoted += texts
    aligned: set[int] = set()
    armed = segments.spans("armed") or segments.spans("airborne")
    for group in _group_texts(texts):
        t = group[0][0]
        while_armed = next((k for k, (a, b) in enumerate(armed) if a <= t <= b), None)
        if while_armed is None:
            continue
        odd = any(ANOMALY.search(x[2]) for x in group) or while_armed in aligned
        aligned.add(while_armed)
        weight: EventSeverity = "warning" if odd else "info"
        text = f"The EKF {'re-aligned' if odd else 'aligned'} its yaw at {t:.1f} s."
        found.append(Event("realigned", t, weight, text, evidence=[quote_text(x) for x in group[:2]]))
    return found


def _reset_events(segments: Segments) -> list[Event]:
    """Return resets of the onboard attitude while armed."""
    return [
        Event("reset", s.t1, "note", f"The onboard attitude was reset at {s.t1:.1f} s: {s.why}.", evidence=[s.why])
        for s in segments.of("reset")
        if _driven_at(segments, s.t1)
    ]


def _switch_events(log: FlightLog, segments: Segments, quoted: list[Text]) -> list[Event]:
    """Return changes of the estimator's core, of the IMU and of the compass while armed."""
    found = []
    lanes = [x for x in matching_texts(log, LANE) if _driven_at(segments, x[0])]
    quoted += lanes
    for group in _group_texts(lanes):
        t, why = group[0][0], _reason(group[0][2])
        text = f"The estimator changed its core at {t:.1f} s{why}."
        found.append(Event("lane_switch", t, "warning", text, evidence=[quote_text(x) for x in group[:2]]))
    for problem in log.problems:
        at = problem.t
        known = at is None or any(abs(e.t - at) < TOGETHER_S for e in found)
        if problem.code in SWITCHED and at is not None and not known and _driven_at(segments, at):
            found.append(Event("lane_switch", at, "warning", problem.text, evidence=[problem.code]))
    line = log.imu_that_flew
    for k in range(1, len(line.value) if line is not None else 0):
        assert line is not None
        t, before, after = float(line.t[k]), line.value[k - 1], line.value[k]
        if before == after or not _driven_at(segments, t) or any(abs(e.t - t) < TOGETHER_S for e in found):
            continue
        text = f"IMU {after} replaced IMU {before} at {t:.1f} s."
        found.append(Event("sensor_switch", t, "warning", text, evidence=[line.source]))
    compasses = [x for x in matching_texts(log, COMPASS) if _driven_at(segments, x[0]) and x not in lanes]
    quoted += compasses
    for group in _group_texts(compasses):
        text = f"The compass was changed at {group[0][0]:.1f} s."
        found.append(Event("compass_switch", group[0][0], "warning", text, evidence=[quote_text(group[0])]))
    return found


def _reason(text: str) -> str:
    """Return the reason that PX4 gives in brackets."""
    found = re.search(r"\(([\w ]+)\)", text)
    return "" if found is None else f" ({found.group(1)})"


def _gnss_lost(log: FlightLog, segments: Segments) -> list[Event]:
    """Return spans in flight without a 3D fix of any receiver, after the first fix."""
    stamps = [g.t[(g.fix >= FIX_3D) & np.isfinite(g.t)] for g in log.gnss]
    t = np.sort(np.concatenate(stamps)) if stamps else np.zeros(0)
    if len(t) < 2:
        return []
    usual = float(np.median(np.diff(t)))
    found = []
    for a, b in segments.spans("airborne"):
        if a < t[0]:
            continue
        mine = np.concatenate([[a], t[(t > a) & (t < b)], [b]])
        for k in np.flatnonzero(np.diff(mine) > max(LOST_S, 5.0 * usual)).tolist():
            since, until = float(mine[k]), float(mine[k + 1])
            text = f"GNSS had no fix for {until - since:.0f} s in flight, from {since:.1f} s."
            evidence = [f"{log.gnss[0].source}: no 3D fix"]
            found.append(Event("gnss_lost", since, "warning", text, until, round(until - since, 1), "s", evidence))
    return found


def _gnss_jumps(log: FlightLog, segments: Segments, quoted: list[Text]) -> list[Event]:
    """Return the autopilot's reports of GNSS jumps, from ERR records or texts."""
    said = matching_texts(log, JUMP)
    quoted += said
    reported = [p for p in log.problems if p.code == "gnss_glitch" and p.t is not None]
    if reported and reported[0].t is not None:
        count = f", {reported[0].count} times in all" if reported[0].count > 1 else ""
        return [_gnss_jump_event(log, reported[0].t, "warning", count, reported[0].text)]
    return [
        _gnss_jump_event(
            log, group[0][0], "warning" if _driven_at(segments, group[0][0]) else "note", "", quote_text(group[0])
        )
        for group in _group_texts(said)
    ]


def _gnss_jump_event(log: FlightLog, t: float, weight: EventSeverity, count: str, evidence: str) -> Event:
    """Return a GNSS jump, or a divergence of the estimator from a steady GNSS."""
    size = gnss_disagreement_m(log.gnss, t)
    jumped = np.isfinite(size) and size >= MAX_STEADY_M
    text = f"{'GNSS jumped' if jumped else 'The EKF and GNSS came apart'} at {t:.1f} s{count}."
    quoted = [evidence]
    if np.isfinite(size):
        quoted.append(f"GNSS position and velocity agree to {size:.1f} m around it")
    value = round(float(size), 1) if np.isfinite(size) else None
    return Event("gnss_jump", t, weight, text, value=value, unit="m" if value is not None else "", evidence=quoted)


def is_estimator_jump(event: Event) -> bool:
    """Return whether GNSS position and velocity agree at a reported jump."""
    return event.kind == "gnss_jump" and event.value is not None and event.value < MAX_STEADY_M


# --- failsafes ---------------------------------------------------------------------------------------------------

# Maximum time between a failsafe and the text with its cause.
CAUSE_S = 2.0
AGAIN_S = 60.0
KILLED_S = 1.0
# Battery values in the first second of a log may be unmeasured.
MEASURED_S = 1.0
# A failsafe up to this long after landing belongs to the flight; a mode set later than this before landing did not end
# it.
ENDED_S = 2.0
AT_ONCE_S = 10.0
# Maximum time between a failsafe's text and its mode change.
SET_S = 1.0
# Name of a failsafe by its text. Rover up to 2.50 reports bits: 1 throttle, 2 ground station (APMrover2, defines.h).
FAILSAFE_NAMES = (
    (re.compile(r"\bradio|\brc\b|\bmanual control|trigger 0x[13]\b", re.I), "Radio failsafe"),
    (re.compile(r"\bgcs\b|ground station|data ?link|trigger 0x2\b", re.I), "Ground station failsafe"),
    (re.compile(r"\bekf\b", re.I), "EKF failsafe"),
    (re.compile(r"\bgps\b|\bgnss\b", re.I), "GNSS failsafe"),
    (re.compile(r"\bterrain", re.I), "Terrain failsafe"),
)
# A GNSS failsafe needs 5 s without a position, so it is false within 5 s of the first fix.
FIRST_FIX_S = 5.0
# Failsafe name by problem code (ArduPilot ERR records, PX4 flag).
FAILSAFE_CODES = {
    "err_5_1": "Radio failsafe",
    "err_7_1": "GNSS failsafe",
    "err_8_1": "Ground station failsafe",
    "err_23_1": "Terrain failsafe",
    "ekf_failsafe": "EKF failsafe",
    "vibration_failsafe": "Vibration failsafe",
    "err_31_1": "Dead reckoning failsafe",
    "failsafe": "Failsafe",
}


def failsafe_events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """Return events of failsafes, kill switch and battery, unordered, and their texts."""
    quoted: list[Text] = []
    found = _kill_switch_events(log, segments, quoted)
    said = [x for x in matching_texts(log, FAILSAFE) if not HARMLESS_WORDS.search(x[2])]
    low = matching_texts(log, BATTERY)
    for text in said:
        t = text[0]
        causes = [x for x in low if abs(x[0] - t) <= CAUSE_S and x != text]
        battery = bool(causes) or bool(BATTERY.search(text[2]))
        quoted += [text, *causes]
        kind = "battery" if battery else "failsafe"
        if any(e.kind == kind and (e.t_end or e.t) > t - AGAIN_S for e in found):
            continue
        evidence = [quote_text(x) for x in (text, *causes[:1])]
        found.append(_failsafe_event(kind, t, _failsafe_name(text, battery), evidence))
    for problem in log.problems:
        at = problem.t
        if at is None or any(abs(e.t - at) <= AGAIN_S and e.kind in ("failsafe", "battery") for e in found):
            continue
        if problem.code == "err_6_1":
            found.append(_failsafe_event("battery", at, "Battery failsafe", [problem.text]))
        elif problem.code in FAILSAFE_CODES:
            words = f"{FAILSAFE_CODES[problem.code]} {format_time(at)}."
            first = problem.code == "err_7_1" and _first_fix(log, at)
            early: EventSeverity = "note" if at < MEASURED_S or first else "warning"
            found.append(Event("failsafe", at, early, words, evidence=[problem.text]))
    return [_weigh_failsafe(e, segments) for e in found], quoted


def _first_fix(log: FlightLog, t: float) -> bool:
    """Return whether GNSS has just found its first 3D fix.

    ArduPilot 3 counts the seconds without one from its start, and begins to look only now (ArduCopter/events.pde,
    failsafe_gps_check).
    """
    first = min((float(g.t[g.fix >= FIX_3D][0]) for g in log.gnss if (g.fix >= FIX_3D).any()), default=np.inf)
    return 0.0 <= t - first < FIRST_FIX_S


def _weigh_failsafe(event: Event, segments: Segments) -> Event:
    """Set the severity of a failsafe: a note while disarmed."""
    if "armed" in segments.unknown:
        return event
    driven = [(a, b + CAUSE_S) for a, b in (*segments.spans("armed"), *segments.spans("airborne"))]
    return event if inside(np.array([event.t]), driven).any() else replace(event, severity="note")


def _failsafe_name(text: Text, battery: bool) -> str:
    """Return the name of a failsafe by the autopilot's text."""
    return (
        "Battery failsafe"
        if battery
        else next((name for words, name in FAILSAFE_NAMES if words.search(text[2])), "Failsafe")
    )


def _failsafe_event(kind: str, t: float, words: str, evidence: list[str]) -> Event:
    weight: EventSeverity = "note" if kind == "battery" and t < MEASURED_S else "warning"
    return Event(kind, t, weight, f"{words} {format_time(t)}.", evidence=evidence)


def _kill_switch_events(log: FlightLog, segments: Segments, quoted: list[Text]) -> list[Event]:
    """Return uses of the kill switch; on the ground they are notes."""

    def weight(t: float) -> EventSeverity:
        flown = [(a, b + KILLED_S) for a, b in segments.spans("airborne")]
        return "warning" if "airborne" in segments.unknown or inside(np.array([t]), flown).any() else "note"

    found: list[Event] = []
    texts = matching_texts(log, KILLED)
    quoted += texts
    for text in texts:
        if not any(abs(e.t - text[0]) < AGAIN_S for e in found):
            found.append(
                Event(
                    "failsafe",
                    text[0],
                    weight(text[0]),
                    f"Kill switch at {text[0]:.1f} s.",
                    evidence=[quote_text(text)],
                )
            )
    stopped = [p for p in log.problems if p.code == "ev_54" and p.t is not None]
    if not found and stopped and stopped[0].t is not None:
        t = stopped[0].t
        found.append(Event("failsafe", t, weight(t), f"Kill switch at {t:.1f} s.", evidence=[stopped[0].text]))
    return found


def failsafe_phrases(first: list[str], log: FlightLog, segments: Segments, events: Sequence[Event]) -> list[str]:
    """Return the first fault and, where it differs, the last failsafe in flight, for the headline.

    A failsafe that ended the flight is always named. One of a disarmed vehicle that never flew is named where nothing
    else happened.
    """
    crash = next((e.t for e in events if e.is_crash), np.inf)
    found = [e for e in events if e.kind in ("failsafe", "battery") and "Kill switch" not in e.text]
    for a, b in reversed(segments.spans("airborne")):
        aloft = [e for e in found if e.severity == "warning" and a <= e.t <= min(b + ENDED_S, crash)]
        if aloft:
            last = aloft[-1]
            both = [x if x == last.text else f"{x} {last.text}" for x in first if x] or [last.text]
            return [*both, last.text] if _ended_it(log, last.t, b) else list(dict.fromkeys((*both, *first)))
    if first == [""] and not segments.spans("airborne") and "armed" not in segments.unknown:
        idle = [e for e in found if e.t >= MEASURED_S and not inside(np.array([e.t]), segments.spans("armed")).any()]
        return [f"{idle[0].text.rstrip('.')}, disarmed.", ""] if idle else first
    return first


def _ended_it(log: FlightLog, t: float, landing: float) -> bool:
    """Return whether a failsafe at ``t`` ended the flight.

    The vehicle landed within 10 s, or in the mode set at the failsafe.
    """
    if landing - t <= AT_ONCE_S:
        return True
    set_ = (
        [] if log.state.mode is None else [x for x in log.state.mode.t.tolist() if t - SET_S <= x < landing - ENDED_S]
    )
    return bool(set_) and set_[-1] <= t + SET_S
