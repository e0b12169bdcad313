"""Events of the onboard estimator, its aids and failsafes: alignments, resets, switches, rejections, GNSS."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import median
from attlog.core.spans import Span, inside
from attlog.flight.model import FIX_3D, FlightLog, Gnss, InnovationTest
from attlog.segments.flight_signs import true_runs
from attlog.segments.model import Segments
from attlog.story.flight_events import (
    ANOMALY,
    COMPASS,
    HARMLESS_WORDS,
    INTERFERENCE,
    JUMP,
    LANE,
    REALIGNED,
    Event,
    EventSeverity,
    Text,
    clean_text,
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
# Longest gap between records of one measurement, and in usual intervals.
GAP_S, MAX_INTERVALS = 2.0, 5.0
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


class Rejection(NamedTuple):
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
        parts = f" ({len(self.spans)} parts, longest {self.longest:.0f} s)"
        times = parts if len(self.spans) > 1 else ""
        return (
            f"The EKF rejected its {self.aid} for {self.seconds:.0f} s of {self.seconds_flown:.0f}{times}, "
            f"{first:.1f} to {last:.1f} s. Largest test ratio {self.worst:.1f}."
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
    pause = max(GAP_S, MAX_INTERVALS * float(median(np.diff(test.t[use]))))
    runs = [np.arange(a, b) for a, b in true_runs(beyond)]
    parts = [part for run in runs for part in np.split(run, np.flatnonzero(np.diff(test.t[run]) > pause) + 1)]
    pairs = [(float(test.t[part[0]]), float(test.t[part[-1]])) for part in parts]
    long = [(a, b) for a, b in pairs if b - a >= MIN_REJECTION_S]
    worst = max((float(test.ratio[beyond & inside(test.t, [pair])].max()) for pair in long), default=0.0)
    return Rejection(test.aid, long, worst, test.source, float(sum(b - a for a, b in flown)))


def rejection_events(log: FlightLog, segments: Segments) -> list[Event]:
    """Return an event for each rejected aid."""
    return [
        Event(
            "aid_rejected",
            r.spans[0][0],
            "warning",
            r.text,
            r.spans[-1][1],
            round(r.worst, 2),
            evidence=[r.source],
            about=r.aid,
        )
        for r in aid_rejections(log, segments)
        if r.spans
    ]


# Texts of an estimator within this time are one event, and so are those of other lanes within MAX_LANES_S: in 20 logs
# with several lanes they follow each other by up to 13.4 s, and by 80 s and more in another flight.
TOGETHER_S, MAX_LANES_S = 1.5, 20.0
UNIT = re.compile(r"\bIMU\d+\b")
# Shortest outage of GNSS.
LOST_S = 2.0
# Number of outages that are events of their own.
MAX_OUTAGES = 3
OUTAGES = {"fix": "GNSS had no fix", "messages": "No GNSS message arrived"}
# Formats of radio links, and the share of missing messages in which a pause of the attitude is one of the link.
TELEMETRY, PAUSE_SHARE = ("tlog", "mavlink"), 0.5
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
    """Return groups of texts of one event: within a few seconds, or the same text of another lane."""
    groups: list[list[Text]] = []
    for text in texts:
        if groups and (text[0] - groups[-1][-1][0] <= TOGETHER_S or _is_of_other_lane(text, groups[-1])):
            groups[-1].append(text)
        else:
            groups.append([text])
    return groups


def _is_of_other_lane(text: Text, group: list[Text]) -> bool:
    """Return whether a lane repeats what another lane, but not itself, has reported in the group."""
    if not UNIT.search(text[2]) or text[0] - group[0][0] > MAX_LANES_S:
        return False
    said = [x[2] for x in group]
    return text[2] not in said and UNIT.sub("", text[2]) in [UNIT.sub("", x) for x in said]


def _driven_at(segments: Segments, t: float) -> bool:
    """Return whether the vehicle is armed, or was at most TOGETHER_S ago."""
    armed = [(a, b + TOGETHER_S) for a, b in segments.spans("armed") or segments.spans("airborne")]
    return bool(inside(np.array([t]), armed).any())


def _realign_events(log: FlightLog, segments: Segments, quoted: list[Text]) -> list[Event]:
    """Return yaw alignments while armed; the first of each lane is normal, later ones are warnings."""
    found = []
    texts = matching_texts(log, REALIGNED)
    quoted += texts
    aligned: set[tuple[int, str]] = set()
    armed = segments.spans("armed") or segments.spans("airborne")
    for group in _group_texts(texts):
        t = group[0][0]
        while_armed = next((k for k, (a, b) in enumerate(armed) if a <= t <= b), None)
        if while_armed is None:
            continue
        now = {(while_armed, lane) for x in group for lane in UNIT.findall(x[2]) or [""]}
        odd = any(ANOMALY.search(x[2]) for x in group) or bool(aligned & now)
        aligned |= now
        weight: EventSeverity = "warning" if odd else "info"
        text = f"The EKF {'re-aligned' if odd else 'aligned'} its yaw at {t:.1f} s."
        words = next((x for x in group if ANOMALY.search(x[2])), group[0])
        quote = clean_text(words[2]) if odd else ""
        found.append(Event("realigned", t, weight, text, evidence=[quote_text(x) for x in group[:2]], quote=quote))
    return found


def _reset_events(segments: Segments) -> list[Event]:
    """Return resets of the onboard attitude while armed."""
    return [
        Event("reset", s.t1, "note", f"The onboard attitude was reset at {s.t1:.1f} s: {s.why}.", evidence=[s.why])
        for s in segments.of("reset")
        if _driven_at(segments, s.t1)
    ]


def _switch_events(log: FlightLog, segments: Segments, quoted: list[Text]) -> list[Event]:
    """Return switches of the estimator's lane, of the IMU and of the compass while armed."""
    found = []
    lanes = [x for x in matching_texts(log, LANE) if _driven_at(segments, x[0])]
    quoted += lanes
    for group in _group_texts(lanes):
        t, why = group[0][0], _reason(group[0][2])
        text = f"The EKF switched lanes at {t:.1f} s{why}."
        evidence = [quote_text(x) for x in group[:2]]
        found.append(Event("lane_switch", t, "warning", text, evidence=evidence, quote=clean_text(group[0][2])))
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
        text = f"The compass in use changed at {group[0][0]:.1f} s."
        t, evidence = group[0][0], [quote_text(group[0])]
        found.append(Event("compass_switch", t, "warning", text, evidence=evidence, quote=clean_text(group[0][2])))
    return found


def _reason(text: str) -> str:
    """Return the reason that PX4 gives in brackets."""
    found = re.search(r"\(([\w ]+)\)", text)
    return "" if found is None else f" ({found.group(1)})"


def _gnss_lost(log: FlightLog, segments: Segments) -> list[Event]:
    """Return spans in flight without a 3D fix of any receiver, after the first fix, by their records.

    Without records GNSS messages are missing: in telemetry, or where the attitude pauses too, this shows nothing.
    """
    stamps = [g.t[(g.fix >= FIX_3D) & np.isfinite(g.t)] for g in log.gnss]
    t = np.sort(np.concatenate(stamps)) if stamps else np.zeros(0)
    if len(t) < 2:
        return []
    unfixed = np.sort(np.concatenate([g.t[(g.fix < FIX_3D) & np.isfinite(g.t)] for g in log.gnss]))
    usual = float(median(np.diff(t)))
    found = []
    for a, b in segments.spans("airborne"):
        if a < t[0]:
            continue
        mine = np.concatenate([[a], t[(t > a) & (t < b)], [b]])
        for k in np.flatnonzero(np.diff(mine) > max(LOST_S, MAX_INTERVALS * usual)).tolist():
            since, until = float(mine[k]), float(mine[k + 1])
            about = "fix" if ((unfixed > since) & (unfixed < until)).any() else "messages"
            if about == "fix":
                text = f"GNSS had no fix for {until - since:.0f} s in flight, from {since:.1f} s."
                evidence = [f"{log.gnss[0].source}: no 3D fix"]
            elif is_link_loss(log, since, until):
                continue
            else:
                text = f"No GNSS message arrived for {until - since:.0f} s in flight, from {since:.1f} s."
                evidence = [f"{log.gnss[0].source}: no record; with a fix before and after"]
            size = round(until - since, 1)
            found.append(Event("gnss_lost", since, "warning", text, until, size, "s", evidence, about=about))
    return found if len(found) <= MAX_OUTAGES else [_joined_outages(found)]


def _joined_outages(found: Sequence[Event]) -> Event:
    """Return many outages, which have one cause, as one event."""
    seconds = sum(e.value or 0.0 for e in found)
    lost = {e.about for e in found}
    what = OUTAGES.get(lost.pop() if len(lost) == 1 else "", "GNSS had no fix or sent no message")
    text = f"{what} for {seconds:.0f} s in flight, in {len(found)} outages from {found[0].t:.1f} s."
    return replace(found[0], text=text, t_end=found[-1].t_end, value=round(seconds, 1))


def is_link_loss(log: FlightLog, since: float, until: float) -> bool:
    """Return whether telemetry, or a pause of the logger, explains missing messages."""
    imu = log.replay_imu
    steady = log.onboard_attitude or (None if imu is None else imu.gyro)
    if log.format in TELEMETRY or steady is None:
        return True
    edges = np.concatenate([[since], steady.t[(steady.t > since) & (steady.t < until)], [until]])
    return float(np.diff(edges).max()) > PAUSE_SHARE * (until - since)


def _gnss_jumps(log: FlightLog, segments: Segments, quoted: list[Text]) -> list[Event]:
    """Return the autopilot's reports of GNSS jumps, from ERR records or texts, and of interference."""
    found = [_interference_event(log, segments, group) for group in _interference_groups(log)]
    quoted += matching_texts(log, INTERFERENCE)
    said = [x for x in matching_texts(log, JUMP) if not (INTERFERENCE.search(x[2]) or HARMLESS_WORDS.search(x[2]))]
    quoted += said
    reported = [p for p in log.problems if p.code == "gnss_glitch" and p.t is not None]
    if reported and reported[0].t is not None:
        count = f", {reported[0].count} times in all" if reported[0].count > 1 else ""
        words = clean_text(said[0][2]) if said else ""
        return [*found, _gnss_jump_event(log, reported[0].t, "warning", count, reported[0].text, words)]
    for group in _group_texts(said):
        weight: EventSeverity = "warning" if _driven_at(segments, group[0][0]) else "note"
        found.append(_gnss_jump_event(log, group[0][0], weight, "", quote_text(group[0]), clean_text(group[0][2])))
    return found


def _interference_groups(log: FlightLog) -> list[list[Text]]:
    """Return the reports of jamming and of spoofing, each as one group."""
    said = matching_texts(log, INTERFERENCE)
    groups = ([x for x in said if ("spoof" in x[2].lower()) is spoofed] for spoofed in (False, True))
    return [group for group in groups if group]


def _interference_event(log: FlightLog, segments: Segments, texts: list[Text]) -> Event:
    """Return jamming or spoofing as the autopilot reports it, beside what GNSS shows there."""
    t, words = texts[0][0], clean_text(texts[0][2])
    weight: EventSeverity = "warning" if any(_driven_at(segments, x[0]) for x in texts) else "note"
    times = f", {len(texts)} times" if len(texts) > 1 else ""
    evidence, size = [quote_text(texts[0])], gnss_disagreement_m(log.gnss, t)
    if np.isfinite(size):
        evidence.append(f"GNSS position and velocity agree to {size:.1f} m around it")
    t_end = texts[-1][0] if len(texts) > 1 else None
    text = f"The autopilot reported “{words}” {format_time(t)}{times}."
    return Event("gnss_interference", t, weight, text, t_end, evidence=evidence, quote=words)


def _gnss_jump_event(
    log: FlightLog, t: float, weight: EventSeverity, count: str, evidence: str, words: str = ""
) -> Event:
    """Return a GNSS jump, or a divergence of the estimator from a steady GNSS."""
    size = gnss_disagreement_m(log.gnss, t)
    jumped = np.isfinite(size) and size >= MAX_STEADY_M
    text = f"{'GNSS jumped' if jumped else 'The EKF and GNSS diverged'} at {t:.1f} s{count}."
    quoted = [evidence]
    if np.isfinite(size):
        quoted.append(f"GNSS position and velocity agree to {size:.1f} m around it")
    value = round(float(size), 1) if np.isfinite(size) else None
    unit = "m" if value is not None else ""
    return Event("gnss_jump", t, weight, text, value=value, unit=unit, evidence=quoted, quote=words)


def is_estimator_jump(event: Event) -> bool:
    """Return whether GNSS position and velocity agree at a reported jump."""
    return event.kind == "gnss_jump" and event.value is not None and event.value < MAX_STEADY_M
