"""What became of the onboard estimator and of what aids it: alignments, resets, switches, rejections, GNSS."""

from __future__ import annotations

import re

import numpy as np

from attlog.flight.model import FlightLog
from attlog.segments.model import Segments
from attlog.segments.spans import inside
from attlog.story import gnss_steps, rejections
from attlog.story.event import Event, Weight
from attlog.story.words import ANOMALY, COMPASS, JUMP, LANE, REALIGNED, Text, matching, quoted

TOGETHER_S = 1.5
"""Cores of one estimator do the same within so many seconds: one event."""
LOST_S = 2.0
FIX_3D = 3
SWITCHED = ("lane_switch", "estimator_instance_changed")
"""Codes of problems: ERR 24 of ArduPilot, and PX4's estimator_selector_status."""


def events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """The events in no order, and the texts that are told in them."""
    told: list[Text] = []
    found = [*_realigned(log, segments, told), *_resets(segments), *_switches(log, segments, told)]
    return [
        *found,
        *rejections.events(log, segments),
        *_gnss_lost(log, segments),
        *_gnss_jumps(log, segments, told),
    ], told


def _grouped(texts: list[Text]) -> list[list[Text]]:
    """Texts that follow each other within a few seconds."""
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


def _realigned(log: FlightLog, segments: Segments, told: list[Text]) -> list[Event]:
    """Yaw alignments that the autopilot tells: the first after arming is its custom, others are odd."""
    found = []
    texts = matching(log, REALIGNED)
    told += texts
    aligned: set[int] = set()
    armed = segments.spans("armed") or segments.spans("airborne")
    for group in _grouped(texts):
        t = group[0][0]
        while_armed = next((k for k, (a, b) in enumerate(armed) if a <= t <= b), None)
        if while_armed is None:
            continue
        odd = any(ANOMALY.search(x[2]) for x in group) or while_armed in aligned
        aligned.add(while_armed)
        weight: Weight = "warning" if odd else "info"
        text = f"The EKF {'re-aligned' if odd else 'aligned'} its yaw at {t:.1f} s."
        found.append(Event("realigned", t, weight, text, evidence=[quoted(x) for x in group[:2]]))
    return found


def _resets(segments: Segments) -> list[Event]:
    """Steps of the onboard attitude while it was armed that are no rotation."""
    return [
        Event("reset", s.t1, "note", f"The onboard attitude was reset at {s.t1:.1f} s: {s.why}.", evidence=[s.why])
        for s in segments.of("reset")
        if _driven_at(segments, s.t1)
    ]


def _switches(log: FlightLog, segments: Segments, told: list[Text]) -> list[Event]:
    """Changes of the estimator's core, of the IMU and of the compass while it was armed."""
    found = []
    lanes = [x for x in matching(log, LANE) if _driven_at(segments, x[0])]
    told += lanes
    for group in _grouped(lanes):
        t, why = group[0][0], _reason(group[0][2])
        text = f"The estimator changed its core at {t:.1f} s{why}."
        found.append(Event("lane_switch", t, "warning", text, evidence=[quoted(x) for x in group[:2]]))
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
    compasses = [x for x in matching(log, COMPASS) if _driven_at(segments, x[0]) and x not in lanes]
    told += compasses
    for group in _grouped(compasses):
        text = f"The compass was changed at {group[0][0]:.1f} s."
        found.append(Event("compass_switch", group[0][0], "warning", text, evidence=[quoted(group[0])]))
    return found


def _reason(text: str) -> str:
    """The reason that PX4 gives in brackets."""
    found = re.search(r"\(([\w ]+)\)", text)
    return "" if found is None else f" ({found.group(1)})"


def _gnss_lost(log: FlightLog, segments: Segments) -> list[Event]:
    """Time in flight without a 3D fix of any receiver, after there had been one."""
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


def _gnss_jumps(log: FlightLog, segments: Segments, told: list[Text]) -> list[Event]:
    """Positions that jumped away from the predicted ones, by ERR records or texts; which of both jumped, by GNSS."""
    said = matching(log, JUMP)
    told += said
    reported = [p for p in log.problems if p.code == "gnss_glitch" and p.t is not None]
    if reported and reported[0].t is not None:
        count = f", {reported[0].count} times in all" if reported[0].count > 1 else ""
        return [_apart(log, reported[0].t, "warning", count, reported[0].text)]
    return [
        _apart(log, group[0][0], "warning" if _driven_at(segments, group[0][0]) else "note", "", quoted(group[0]))
        for group in _grouped(said)
    ]


def _apart(log: FlightLog, t: float, weight: Weight, count: str, evidence: str) -> Event:
    """GNSS and the estimator came apart at ``t``: GNSS jumped, or it was steady and the estimator left it."""
    size = gnss_steps.disagreement(log.gnss, t)
    jumped = np.isfinite(size) and size >= gnss_steps.STEADY_M
    text = f"{'GNSS jumped' if jumped else 'The EKF and GNSS came apart'} at {t:.1f} s{count}."
    told = [evidence]
    if np.isfinite(size):
        told.append(f"GNSS position and velocity agree to {size:.1f} m around it")
    value = round(float(size), 1) if np.isfinite(size) else None
    return Event("gnss_jump", t, weight, text, value=value, unit="m" if value is not None else "", evidence=told)


def is_steady(event: Event) -> bool:
    """Whether an event tells that the estimator left a GNSS whose position and velocity agree."""
    return event.kind == "gnss_jump" and event.value is not None and event.value < gnss_steps.STEADY_M
